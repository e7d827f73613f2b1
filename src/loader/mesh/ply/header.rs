//! The header of a PLY file: the elements and their properties.

use exr::prelude::f16;

/// The encoding of the numbers after the header.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Encoding {
    Text,
    LittleEndian,
    BigEndian,
}

/// Types of numbers. 64-bit integers and 16-bit floats are extensions of Mitsuba.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Number {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    I64,
    U64,
    F16,
    F32,
    F64,
}

/// A number of an element, or a list of numbers.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Property {
    pub name: String,
    pub kind: Kind,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    Scalar(Number),
    List { count: Number, item: Number },
}

/// A table: `count` rows with the same properties.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Element {
    pub name: String,
    pub count: u64,
    pub properties: Vec<Property>,
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Header {
    pub encoding: Encoding,
    pub elements: Vec<Element>,
    /// The offset of the first number, in bytes from the start of the file.
    pub size: usize,
}

/// The line (from 1) of a fault and its description.
pub type Fault = (u32, String);

impl Header {
    /// Reads a header.
    ///
    /// # Errors
    /// If the header is malformed.
    pub fn parse(bytes: &[u8]) -> Result<Header, Fault> {
        let mut encoding = None;
        let mut elements: Vec<Element> = Vec::new();
        let mut size = 0;
        let mut number = 0;
        for line in bytes.split_inclusive(|b| *b == b'\n') {
            number += 1;
            size += line.len();
            let fail = |message: &str| Err((number, message.to_owned()));
            let Ok(line) = str::from_utf8(line) else { return fail("the header is no text in UTF-8") };
            let words: Vec<&str> = line.split_ascii_whitespace().collect();
            if number == 1 {
                match words[..] {
                    ["ply"] => continue,
                    _ => return fail("the first line is not \"ply\""),
                }
            }
            match words[..] {
                [] | ["comment" | "obj_info", ..] => {}
                ["format", word, "1.0"] if encoding.is_none() => match Encoding::named(word) {
                    Some(known) => encoding = Some(known),
                    None => return fail("expected format ascii, binary_little_endian or binary_big_endian"),
                },
                ["element", name, count] => {
                    let Ok(count) = count.parse() else { return fail("expected the number of elements") };
                    if elements.iter().any(|e| e.name == name) {
                        return Err((number, format!("a second element {name}")));
                    }
                    elements.push(Element { name: name.to_owned(), count, properties: Vec::new() });
                }
                ["property", ref definition @ ..] => match (elements.last_mut(), Property::parse(definition))
                {
                    (None, _) => return fail("a property before the first element"),
                    (_, None) => {
                        return fail("expected \"property TYPE NAME\" or \"property list TYPE TYPE NAME\"");
                    }
                    (Some(element), Some(new)) if element.properties.iter().any(|p| p.name == new.name) => {
                        return Err((number, format!("a second property {} of {}", new.name, element.name)));
                    }
                    (Some(element), Some(new)) => element.properties.push(new),
                },
                ["end_header"] => {
                    return match encoding {
                        Some(encoding) => Ok(Header { encoding, elements, size }),
                        None => fail("the header has no line \"format\""),
                    };
                }
                _ => return fail("expected a line of a header"),
            }
        }
        Err((number, "the file ends within its header".to_owned()))
    }

    /// Returns the element of a name.
    pub fn element(&self, name: &str) -> Option<&Element> {
        self.elements.iter().find(|e| e.name == name)
    }
}

impl Encoding {
    fn named(word: &str) -> Option<Self> {
        Some(match word {
            "ascii" => Encoding::Text,
            "binary_little_endian" => Encoding::LittleEndian,
            "binary_big_endian" => Encoding::BigEndian,
            _ => return None,
        })
    }
}

impl Property {
    fn parse(words: &[&str]) -> Option<Self> {
        let (kind, name) = match *words {
            ["list", count, item, name] => {
                let count = Number::named(count)?;
                if count.is_float() {
                    return None;
                }
                (Kind::List { count, item: Number::named(item)? }, name)
            }
            [kind, name] => (Kind::Scalar(Number::named(kind)?), name),
            _ => return None,
        };
        Some(Property { name: name.to_owned(), kind })
    }

    /// Returns the bytes of the number, or of the length of the list.
    pub fn least_size(&self) -> usize {
        match self.kind {
            Kind::Scalar(number) | Kind::List { count: number, .. } => number.size(),
        }
    }
}

impl Element {
    /// Returns the index of the property of a name.
    pub fn find(&self, name: &str) -> Option<usize> {
        self.properties.iter().position(|p| p.name == name)
    }
}

impl Number {
    fn named(word: &str) -> Option<Self> {
        Some(match word {
            "char" | "int8" => Number::I8,
            "uchar" | "uint8" => Number::U8,
            "short" | "int16" => Number::I16,
            "ushort" | "uint16" => Number::U16,
            "int" | "int32" => Number::I32,
            "uint" | "uint32" => Number::U32,
            "long" | "int64" => Number::I64,
            "ulong" | "uint64" => Number::U64,
            "half" | "float16" => Number::F16,
            "float" | "float32" => Number::F32,
            "double" | "float64" => Number::F64,
            _ => return None,
        })
    }

    /// Returns the bytes of a number.
    pub fn size(self) -> usize {
        match self {
            Number::I8 | Number::U8 => 1,
            Number::I16 | Number::U16 | Number::F16 => 2,
            Number::I32 | Number::U32 | Number::F32 => 4,
            Number::I64 | Number::U64 | Number::F64 => 8,
        }
    }

    pub fn is_float(self) -> bool {
        matches!(self, Number::F16 | Number::F32 | Number::F64)
    }

    /// Returns the range of an integer type, limited to that of `i64`; the range of `i64` for floats.
    pub fn range(self) -> (i64, i64) {
        match self {
            Number::I8 => (i8::MIN.into(), i8::MAX.into()),
            Number::U8 => (0, u8::MAX.into()),
            Number::I16 => (i16::MIN.into(), i16::MAX.into()),
            Number::U16 => (0, u16::MAX.into()),
            Number::I32 => (i32::MIN.into(), i32::MAX.into()),
            Number::U32 => (0, u32::MAX.into()),
            Number::U64 => (0, i64::MAX),
            Number::I64 | Number::F16 | Number::F32 | Number::F64 => (i64::MIN, i64::MAX),
        }
    }

    /// Decodes the integer at the start of `bytes`. Floats are truncated, and integers above the range of `i64` are
    /// clamped to it.
    ///
    /// # Panics
    /// If there are fewer bytes than [`size`](Number::size).
    #[inline]
    pub fn integer(self, bytes: &[u8], encoding: Encoding) -> i64 {
        match self {
            Number::I8 => bytes[0].cast_signed().into(),
            Number::U8 => bytes[0].into(),
            Number::I16 => (array(bytes, encoding, u16::from_le_bytes, u16::from_be_bytes) as i16).into(),
            Number::U16 => array(bytes, encoding, u16::from_le_bytes, u16::from_be_bytes).into(),
            Number::I32 => array(bytes, encoding, i32::from_le_bytes, i32::from_be_bytes).into(),
            Number::U32 => array(bytes, encoding, u32::from_le_bytes, u32::from_be_bytes).into(),
            Number::I64 => array(bytes, encoding, i64::from_le_bytes, i64::from_be_bytes),
            Number::U64 => {
                let value = array(bytes, encoding, u64::from_le_bytes, u64::from_be_bytes);
                i64::try_from(value).unwrap_or(i64::MAX)
            }
            Number::F16 | Number::F32 | Number::F64 => self.float(bytes, encoding) as i64,
        }
    }

    /// Decodes the number at the start of `bytes`.
    ///
    /// # Panics
    /// If there are fewer bytes than [`size`](Number::size).
    #[inline]
    pub fn float(self, bytes: &[u8], encoding: Encoding) -> f64 {
        match self {
            Number::F32 => array(bytes, encoding, f32::from_le_bytes, f32::from_be_bytes).into(),
            Number::F64 => array(bytes, encoding, f64::from_le_bytes, f64::from_be_bytes),
            Number::F16 => {
                f16::from_bits(array(bytes, encoding, u16::from_le_bytes, u16::from_be_bytes)).into()
            }
            Number::U64 => array(bytes, encoding, u64::from_le_bytes, u64::from_be_bytes) as f64,
            _ => self.integer(bytes, encoding) as f64,
        }
    }
}

/// Decodes the first `N` bytes in either byte order.
#[inline]
fn array<const N: usize, T>(
    bytes: &[u8],
    encoding: Encoding,
    little: fn([u8; N]) -> T,
    big: fn([u8; N]) -> T,
) -> T {
    let bytes = *bytes.first_chunk().expect("the caller checked the length");
    if encoding == Encoding::BigEndian { big(bytes) } else { little(bytes) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn headers_are_read_with_either_line_end() {
        let text = "ply\nformat binary_big_endian 1.0\ncomment no\nobj_info no\n\nelement vertex 7\nproperty float32 x\n\
                    property list uchar int i\nend_header\n";
        for text in [text.to_owned(), text.replace('\n', "\r\n")] {
            let header = Header::parse(&[text.as_bytes(), b"\n\xff"].concat()).unwrap();
            assert_eq!(header.size, text.len());
            assert_eq!(header.encoding, Encoding::BigEndian);
            let properties = &header.element("vertex").unwrap().properties;
            assert_eq!(properties[0], Property { name: "x".into(), kind: Kind::Scalar(Number::F32) });
            assert_eq!(properties[1].kind, Kind::List { count: Number::U8, item: Number::I32 });
        }
    }

    #[test]
    fn malformed_headers_have_their_line() {
        let fault = |text: &str| {
            let (line, message) = Header::parse(text.as_bytes()).unwrap_err();
            format!("{line}: {message}")
        };
        let start = "ply\nformat ascii 1.0\n";
        assert_eq!(fault(""), "0: the file ends within its header");
        assert_eq!(fault("plx\n"), "1: the first line is not \"ply\"");
        assert_eq!(fault(&format!("{start}element a -1\n")), "3: expected the number of elements");
        assert_eq!(fault(&format!("{start}property float x\n")), "3: a property before the first element");
        assert_eq!(
            fault(&format!("{start}element a 1\nproperty list float int x\n")),
            "4: expected \"property TYPE NAME\" or \"property list TYPE TYPE NAME\""
        );
        assert_eq!(fault(&format!("{start}element a 1\nelement a 1\n")), "4: a second element a");
        assert_eq!(
            fault(&format!("{start}element a 1\nproperty int b\nproperty int b\n")),
            "5: a second property b of a"
        );
        assert_eq!(fault("ply\nend_header\n"), "2: the header has no line \"format\"");
        assert_eq!(fault(&format!("{start}elements 1\n")), "3: expected a line of a header");
    }

    #[test]
    fn numbers_are_decoded_in_both_orders() {
        let bytes = [0xfe, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff];
        assert_eq!(Number::I16.integer(&bytes, Encoding::LittleEndian), -2);
        assert_eq!(Number::I16.integer(&bytes, Encoding::BigEndian), -257);
        assert_eq!(Number::I8.integer(&bytes, Encoding::BigEndian), -2);
        assert_eq!(Number::U64.integer(&bytes, Encoding::LittleEndian), i64::MAX);
        assert_eq!(Number::F16.float(&[0x00, 0x3c], Encoding::LittleEndian), 1.0);
        assert_eq!(Number::F64.float(&2.5f64.to_be_bytes(), Encoding::BigEndian), 2.5);
    }
}
