//! The rows of an element, in order, from text or from binary data with lists of any length.

use super::header::{Element, Encoding, Kind, Number};
use super::{Fault, malformed};
use crate::util::wording::quoted;

/// The unread part of a file.
#[derive(Clone, Debug)]
pub struct Rest<'a> {
    /// The whole file.
    pub bytes: &'a [u8],
    /// The offset of the unread part.
    pub at: usize,
    pub encoding: Encoding,
}

/// A row: the value of every property (0 for a list), and the items of the selected list.
#[derive(Debug, Default)]
pub struct Row {
    pub scalars: Vec<f64>,
    pub list: Vec<i64>,
}

impl<'a> Rest<'a> {
    /// Returns the unread bytes.
    pub fn left(&self) -> &'a [u8] {
        &self.bytes[self.at..]
    }

    /// Checks that the file is long enough for the rows of an element, so that nothing is allocated for a wrong count.
    ///
    /// # Errors
    /// If it is too short.
    pub fn check(&self, element: &Element) -> Result<(), Fault> {
        let row: usize = match self.encoding {
            // Each takes at least a digit and a space or line end; the last line end may be missing.
            Encoding::Text => 2 * element.properties.len(),
            _ => element.properties.iter().map(|p| p.least_size()).sum(),
        };
        let most = if row == 0 { u64::MAX } else { (self.left().len() as u64 + 1) / row as u64 };
        match element.count <= most {
            true => Ok(()),
            false => Err(self.too_short(element)),
        }
    }

    pub fn too_short(&self, element: &Element) -> Fault {
        malformed(0, &format!("the file is too short for {} of element {}", element.count, element.name))
    }

    /// Calls `each` for every row of an element, with the items of the list property `list`.
    ///
    /// # Errors
    /// If a row is malformed, and the errors of `each`.
    pub fn each_row(
        &mut self,
        element: &Element,
        list: Option<usize>,
        mut each: impl FnMut(u64, &Row) -> Result<(), Fault>,
    ) -> Result<(), Fault> {
        self.check(element)?;
        if element.properties.is_empty() {
            return Ok(());
        }
        let mut row = Row { scalars: vec![0.0; element.properties.len()], list: Vec::new() };
        for i in 0..element.count {
            match self.encoding {
                Encoding::Text => self.text_row(element, list, &mut row)?,
                _ => self.binary_row(element, list, &mut row).ok_or_else(|| self.too_short(element))?,
            }
            each(i, &row)?;
        }
        Ok(())
    }

    /// Reads a row; `None` if the file ends or a list has a negative length.
    fn binary_row(&mut self, element: &Element, list: Option<usize>, row: &mut Row) -> Option<()> {
        for (i, property) in element.properties.iter().enumerate() {
            match property.kind {
                Kind::Scalar(number) => {
                    row.scalars[i] = number.float(self.take(number.size())?, self.encoding)
                }
                Kind::List { count, item } => {
                    let count = count.integer(self.take(count.size())?, self.encoding);
                    let size = usize::try_from(count).ok()?.checked_mul(item.size())?;
                    let (items, encoding) = (self.take(size)?, self.encoding);
                    if list == Some(i) {
                        row.list.clear();
                        row.list.extend(items.chunks_exact(item.size()).map(|b| item.integer(b, encoding)));
                    }
                }
            }
        }
        Some(())
    }

    fn take(&mut self, size: usize) -> Option<&'a [u8]> {
        let taken = self.left().get(..size)?;
        self.at += size;
        Some(taken)
    }

    /// Reads a row from the next line that is not blank.
    fn text_row(&mut self, element: &Element, list: Option<usize>, row: &mut Row) -> Result<(), Fault> {
        let (start, line) = loop {
            let left = self.left();
            if left.is_empty() {
                return Err(self.too_short(element));
            }
            let end = left.iter().position(|b| *b == b'\n').unwrap_or(left.len());
            let start = self.at;
            self.at += (end + 1).min(left.len());
            let line = left[..end].trim_ascii();
            if !line.is_empty() {
                break (start, line);
            }
        };
        parse(line, element, list, row).map_err(|message| {
            let before = self.bytes[..start].iter().filter(|b| **b == b'\n').count();
            malformed(before as u32 + 1, &message)
        })
    }
}

/// Reads a row from a line.
fn parse(line: &[u8], element: &Element, list: Option<usize>, row: &mut Row) -> Result<(), String> {
    let mut words = line.split(u8::is_ascii_whitespace).filter(|w| !w.is_empty());
    let mut word = || words.next().ok_or_else(|| format!("the line ends within a row of {}", element.name));
    for (i, property) in element.properties.iter().enumerate() {
        match property.kind {
            Kind::Scalar(number) => row.scalars[i] = scalar(word()?, number)?,
            Kind::List { count, item } => {
                let n = integer(word()?, count)?;
                if n < 0 {
                    return Err(format!("expected the length of a list, found {n}"));
                }
                row.list.clear();
                for _ in 0..n {
                    let word = word()?;
                    if list == Some(i) {
                        row.list.push(integer(word, item)?);
                    }
                }
            }
        }
    }
    match words.next() {
        None => Ok(()),
        Some(word) => {
            Err(format!("expected the end of the line, found {}", quoted(&String::from_utf8_lossy(word))))
        }
    }
}

fn scalar(word: &[u8], number: Number) -> Result<f64, String> {
    let value = match number {
        Number::F64 => fast_float2::parse::<f64, _>(word).ok(),
        Number::F16 | Number::F32 => fast_float2::parse::<f32, _>(word).ok().map(f64::from),
        Number::U64 => str::from_utf8(word).ok().and_then(|w| w.parse::<u64>().ok()).map(|v| v as f64),
        _ => return integer(word, number).map(|v| v as f64),
    };
    value.ok_or_else(|| format!("expected a number, found {}", quoted(&String::from_utf8_lossy(word))))
}

fn integer(word: &[u8], number: Number) -> Result<i64, String> {
    let (least, most) = number.range();
    let value = str::from_utf8(word).ok().and_then(|w| w.parse::<i64>().ok());
    value.filter(|v| (least..=most).contains(v)).ok_or_else(|| {
        let found = quoted(&String::from_utf8_lossy(word));
        format!("expected a whole number from {least} to {most}, found {found}")
    })
}
