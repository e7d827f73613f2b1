//! Elements in binary data whose rows all have the same width.

use super::attributes::{self, Group};
use super::header::{Element, Encoding, Kind, Number};
use super::rows::Rest;
use super::{Fault, number};
use crate::texture::Attribute;
use rayon::prelude::*;

/// The least number of rows in a task.
const LEAST_ROWS: usize = 4096;
/// The value of an index that is out of range.
const OUTSIDE: u32 = u32::MAX;

/// The rows of an element.
pub struct Table<'a> {
    rows: &'a [u8],
    width: usize,
    /// The offset of each property's number or list (without its length) in a row.
    offsets: Vec<usize>,
    element: &'a Element,
    encoding: Encoding,
}

/// A number of every row.
#[derive(Clone, Copy)]
struct Column {
    offset: usize,
    number: Number,
    encoding: Encoding,
}

impl Column {
    #[inline]
    fn get(self, row: &[u8]) -> f64 {
        self.number.float(&row[self.offset..], self.encoding)
    }
}

impl<'a> Table<'a> {
    /// Reads an element; `None` if it is text or has lists.
    ///
    /// # Errors
    /// If the file is too short.
    pub fn take(rest: &mut Rest<'a>, element: &'a Element) -> Result<Option<Self>, Fault> {
        let scalars = element.properties.iter().all(|p| matches!(p.kind, Kind::Scalar(_)));
        if rest.encoding == Encoding::Text || !scalars {
            return Ok(None);
        }
        Table::of_width(rest, element, 0).map(Some).ok_or_else(|| rest.too_short(element))
    }

    /// Reads an element if it has a single list, with three items in every row.
    pub fn take_triangles(rest: &mut Rest<'a>, element: &'a Element, list: usize) -> Option<Self> {
        let lists = element.properties.iter().filter(|p| matches!(p.kind, Kind::List { .. })).count();
        let Kind::List { count, .. } = element.properties[list].kind else { return None };
        if rest.encoding == Encoding::Text || lists != 1 {
            return None;
        }
        let mut tried = rest.clone();
        let table = Table::of_width(&mut tried, element, 3)?;
        let count =
            Column { offset: table.offsets[list] - count.size(), number: count, encoding: rest.encoding };
        let triangles =
            table.rows().all(|row| count.number.integer(&row[count.offset..], count.encoding) == 3);
        triangles.then(|| {
            *rest = tried;
            table
        })
    }

    /// Reads an element with `items` items in every list.
    fn of_width(rest: &mut Rest<'a>, element: &'a Element, items: usize) -> Option<Self> {
        let mut width = 0;
        let mut offsets = Vec::with_capacity(element.properties.len());
        for property in &element.properties {
            let (before, after) = match property.kind {
                Kind::Scalar(number) => (0, number.size()),
                Kind::List { count, item } => (count.size(), items * item.size()),
            };
            offsets.push(width + before);
            width += before + after;
        }
        let size = usize::try_from(element.count).ok()?.checked_mul(width)?;
        let rows = rest.left().get(..size)?;
        rest.at += size;
        Some(Table { rows, width: width.max(1), offsets, element, encoding: rest.encoding })
    }

    fn rows(&self) -> impl IndexedParallelIterator<Item = &'a [u8]> {
        self.rows.par_chunks_exact(self.width).with_min_len(LEAST_ROWS)
    }

    fn column(&self, i: usize) -> Column {
        Column { offset: self.offsets[i], number: number(self.element, i), encoding: self.encoding }
    }

    /// Returns the vectors whose coordinates are these columns.
    pub fn vectors<const N: usize, T: From<[f32; N]> + Send>(&self, columns: [usize; N]) -> Vec<T> {
        let columns = columns.map(|i| self.column(i));
        let single = |c: &Column| c.number == Number::F32 && c.encoding == Encoding::LittleEndian;
        if columns.iter().all(single) {
            let at = |row: &[u8], offset: usize| {
                f32::from_le_bytes(*row[offset..].first_chunk().expect("a row has its columns"))
            };
            return self.rows().map(|row| T::from(columns.map(|c| at(row, c.offset)))).collect();
        }
        self.rows().map(|row| T::from(columns.map(|c| c.get(row) as f32))).collect()
    }

    /// Returns the values of an attribute.
    pub fn attribute(&self, group: &Group) -> Attribute {
        let columns: Vec<Column> = group.columns.iter().map(|i| self.column(*i)).collect();
        let channels = columns.len();
        let mut values = vec![0.0; self.rows.len() / self.width * channels];
        self.rows().zip(values.par_chunks_exact_mut(channels)).for_each(|(row, values)| {
            for (value, column) in values.iter_mut().zip(&columns) {
                *value = attributes::decode(column.number, column.get(row));
            }
        });
        Attribute { name: group.name.clone(), channels, values }
    }

    /// Returns the first three items of a list; an item that is negative or too large for an index is [`OUTSIDE`].
    pub fn triangles(&self, list: usize) -> Vec<[u32; 3]> {
        let Column { offset, number, encoding } = self.column(list);
        let size = number.size();
        let plain = matches!(number, Number::I32 | Number::U32) && encoding == Encoding::LittleEndian;
        let most = if number == Number::I32 { i32::MAX as u32 } else { OUTSIDE };
        self.rows()
            .map(|row| {
                let items = &row[offset..];
                [0, 1, 2].map(|i| match plain {
                    true => {
                        let item =
                            u32::from_le_bytes(*items[4 * i..].first_chunk().expect("a row has three items"));
                        if item > most { OUTSIDE } else { item }
                    }
                    false => u32::try_from(number.integer(&items[i * size..], encoding)).unwrap_or(OUTSIDE),
                })
            })
            .collect()
    }

    /// Returns the first item of a row's list that is not the index of a vertex.
    pub fn corner_outside(&self, row: usize, list: usize, vertices: usize) -> i64 {
        let Column { offset, number, encoding } = self.column(list);
        let items = self.rows[row * self.width + offset..].chunks_exact(number.size()).take(3);
        let mut items = items.map(|b| number.integer(b, encoding));
        items.find(|c| !(0..vertices as i64).contains(c)).unwrap_or_default()
    }
}

/// Returns the first triangle with a corner outside `0..vertices`.
pub fn first_outside(triangles: &[[u32; 3]], vertices: usize) -> Option<usize> {
    let outside = |t: &[u32; 3]| t.iter().any(|i| *i as usize >= vertices);
    triangles.par_iter().with_min_len(LEAST_ROWS).position_first(outside)
}
