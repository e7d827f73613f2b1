//! NumPy arrays: a text header, then height x width x channels numbers, with rows from the top. The format has no
//! place for the names of the channels. [NumPy Enhancement Proposal 1]

use super::format::MAX_VALUES;
use super::{Image, Metadata};

/// The first bytes of a file.
pub(super) const MAGIC: &[u8; 6] = b"\x93NUMPY";
/// The bytes before the values of a file that is written. Readers can map the values, because 64 divides it.
const HEADER_BYTES: usize = 128;

/// Encodes a little-endian file of 32-bit floats. `data` has the top row first, with interleaved channels.
pub(super) fn encode(width: usize, height: usize, channels: usize, data: &[f32]) -> Vec<u8> {
    let text =
        format!("{{'descr': '<f4', 'fortran_order': False, 'shape': ({height}, {width}, {channels}), }}");
    let room = HEADER_BYTES - MAGIC.len() - 4;
    let mut bytes = Vec::with_capacity(HEADER_BYTES + 4 * data.len());
    bytes.extend(MAGIC);
    bytes.extend([1, 0]);
    bytes.extend((room as u16).to_le_bytes());
    bytes.extend(format!("{text:0$}\n", room - 1).into_bytes());
    bytes.extend(data.iter().flat_map(|v| v.to_le_bytes()));
    bytes
}

/// Decodes a file of 32-bit or 64-bit floats in C order: height x width, or height x width x 1, 3 or 4 channels.
pub(super) fn decode(bytes: &[u8]) -> Result<Image, String> {
    let (text, values) = split(bytes)?;
    let of_kind = match field(text, "descr")? {
        "'<f4'" | "\"<f4\"" => 4,
        "'<f8'" | "\"<f8\"" => 8,
        found => {
            return Err(format!("expected numbers of the type '<f4' (float32) or '<f8', found {found}"));
        }
    };
    if field(text, "fortran_order")? != "False" {
        return Err(
            "expected an array in C order, found Fortran order; numpy.ascontiguousarray turns it".into()
        );
    }
    let shape = field(text, "shape")?;
    let sizes: Option<Vec<usize>> = shape
        .strip_prefix('(')
        .and_then(|inside| inside.strip_suffix(')'))
        .map(|inside| inside.split(',').map(str::trim).filter(|size| !size.is_empty()))
        .and_then(|sizes| sizes.map(|size| size.parse().ok()).collect());
    let (height, width, names): (usize, usize, &[&str]) = match sizes.as_deref() {
        Some(&[height, width] | &[height, width, 1]) => (height, width, &["Y"]),
        Some(&[height, width, 3]) => (height, width, &["R", "G", "B"]),
        Some(&[height, width, 4]) => (height, width, &["R", "G", "B", "A"]),
        _ => {
            return Err(format!(
                "expected a shape of (height, width) or (height, width, channels) with 1, 3 or 4 channels, \
                 because an array has no names of layers, found {shape}"
            ));
        }
    };
    let count = (width as u64).saturating_mul(height as u64).saturating_mul(names.len() as u64);
    if count == 0 || count > MAX_VALUES {
        return Err(format!(
            "expected a size of at least 1x1 and at most {MAX_VALUES} values, found {width}x{height}"
        ));
    }
    let (expected, found) = (of_kind * count as usize, values.len());
    if found != expected {
        return Err(format!("expected {expected} bytes of pixels, found {found}"));
    }
    let data = match of_kind {
        4 => values.as_chunks::<4>().0.iter().map(|&b| f32::from_le_bytes(b)).collect(),
        _ => values.as_chunks::<8>().0.iter().map(|&b| f64::from_le_bytes(b) as f32).collect(),
    };
    let channels = names.iter().map(|&name| name.to_owned()).collect();
    Ok(Image { width, height, channels, data, metadata: Metadata::new() })
}

/// Returns the header's text and the bytes after it.
fn split(bytes: &[u8]) -> Result<(&str, &[u8]), String> {
    const INCOMPLETE: &str = "the header is not complete";
    let rest = bytes.strip_prefix(MAGIC).ok_or("the first bytes are not those of a NumPy array")?;
    let (version, rest) = rest.split_first_chunk::<2>().ok_or(INCOMPLETE)?;
    let (length, rest) = match version[0] {
        1 => rest.split_first_chunk().map(|(&length, rest)| (u16::from_le_bytes(length).into(), rest)),
        2 | 3 => rest.split_first_chunk().map(|(&length, rest)| (u32::from_le_bytes(length) as usize, rest)),
        other => return Err(format!("expected version 1, 2 or 3, found {other}")),
    }
    .ok_or(INCOMPLETE)?;
    let (text, values) = rest.split_at_checked(length).ok_or(INCOMPLETE)?;
    let text = std::str::from_utf8(text).map_err(|_| "the header is not text")?;
    Ok((text, values))
}

/// Returns the value of a key in the header, which is a dictionary in Python's notation: text in quotes, a name, or
/// numbers in parentheses.
fn field<'a>(text: &'a str, key: &str) -> Result<&'a str, String> {
    let after = ['\'', '"'].iter().find_map(|quote| {
        let (_, rest) = text.split_once(&format!("{quote}{key}{quote}"))?;
        rest.trim_start().strip_prefix(':')
    });
    let value = after.map(str::trim_start).unwrap_or_default();
    let end = match value.chars().next() {
        Some('(') => value.find(')').map(|end| end + 1),
        // The types of a structured array are a list.
        Some('[') => value.find(']').map(|end| end + 1),
        Some(_) => value.find([',', '}']),
        None => None,
    };
    end.map(|end| value[..end].trim_end()).ok_or_else(|| format!("expected \"{key}\" in the header"))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns a file with this header and these bytes.
    fn file(text: &str, values: &[u8]) -> Vec<u8> {
        [&MAGIC[..], &[1, 0], &(text.len() as u16).to_le_bytes(), text.as_bytes(), values].concat()
    }

    #[test]
    fn the_bytes_are_the_format_s_own() {
        let bytes = encode(2, 1, 1, &[1.0, 2.0]);
        assert_eq!(bytes[..10], *b"\x93NUMPY\x01\x00\x76\x00");
        let text = std::str::from_utf8(&bytes[10..128]).unwrap();
        assert_eq!(text.trim_end(), "{'descr': '<f4', 'fortran_order': False, 'shape': (1, 2, 1), }");
        assert!(text.ends_with(" \n"));
        assert_eq!(bytes[128..], [1.0f32.to_le_bytes(), 2.0f32.to_le_bytes()].concat());
        let largest = encode(i32::MAX as usize, i32::MAX as usize, usize::MAX, &[]);
        assert_eq!((largest.len(), largest[127]), (128, b'\n'));
    }

    #[test]
    fn bits_survive_the_round_trip() {
        let data: Vec<f32> =
            [0u32, 1, 0x8000_0000, 0x7f7f_ffff, 0x7f80_0000, 0x7fc0_1234].map(f32::from_bits).to_vec();
        let image = decode(&encode(1, 2, 3, &data)).unwrap();
        assert_eq!((image.width, image.height, image.channels.join("")), (1, 2, "RGB".into()));
        let bits = |v: &[f32]| v.iter().map(|v| v.to_bits()).collect::<Vec<_>>();
        assert_eq!(bits(&image.data), bits(&data));
    }

    #[test]
    fn other_files_of_numpy_are_read() {
        let doubles = [0.5f64.to_le_bytes(), 0.25f64.to_le_bytes()].concat();
        let text = "{\"shape\":(2,1,),\"fortran_order\":False,\"descr\":\"<f8\"}\n";
        let image = decode(&file(text, &doubles)).unwrap();
        assert_eq!((image.channels.join(""), image.data), ("Y".into(), vec![0.5, 0.25]));
        let mut long = encode(1, 1, 4, &[1.0, 2.0, 3.0, 0.5]);
        long.splice(6..10, [2, 0, 118, 0, 0, 0]);
        assert_eq!(decode(&long).unwrap().channels.join(""), "RGBA");
    }

    #[test]
    fn bad_files_are_named_sentences() {
        let says = |bytes: &[u8]| decode(bytes).unwrap_err();
        let array = |descr: &str, order: &str, shape: &str| {
            says(&file(
                &format!("{{'descr': {descr}, 'fortran_order': {order}, 'shape': {shape}, }}\n"),
                &[0; 4],
            ))
        };
        assert_eq!(says(b"\x93NUMPY\x01"), "the header is not complete");
        assert_eq!(says(b"\x93NUMPY\x01\x00\x76\x00{'descr'"), "the header is not complete");
        assert_eq!(says(b"\x93NUMPY\x04\x00\x00\x00"), "expected version 1, 2 or 3, found 4");
        assert_eq!(says(b"\x93NUMPY\x01\x00\x01\x00\xff"), "the header is not text");
        assert_eq!(says(&file("{}", &[])), "expected \"descr\" in the header");
        assert_eq!(says(&file("{'descr': (", &[])), "expected \"descr\" in the header");
        assert_eq!(says(&file("{'descr': '<f4', }", &[])), "expected \"fortran_order\" in the header");
        let types = "expected numbers of the type '<f4' (float32) or '<f8', found";
        assert_eq!(array("'>f4'", "False", "(1, 1)"), format!("{types} '>f4'"));
        assert_eq!(array("[('x', '<f4')]", "False", "(1, 1)"), format!("{types} [('x', '<f4')]"));
        assert_eq!(
            array("'<f4'", "True", "(1, 1)"),
            "expected an array in C order, found Fortran order; numpy.ascontiguousarray turns it"
        );
        for shape in ["()", "(4,)", "(1, 1, 7)", "(1, x)", "(1, 1, 1, 1)", "(-1, 1)"] {
            let expected = "expected a shape of (height, width) or (height, width, channels) with 1, 3 or 4 \
                            channels, because an array has no names of layers, found";
            assert_eq!(array("'<f4'", "False", shape), format!("{expected} {shape}"));
        }
        assert_eq!(
            array("'<f4'", "False", "(0, 2)"),
            "expected a size of at least 1x1 and at most 4294967296 values, found 2x0"
        );
        let huge = format!("({0}, {0})", usize::MAX);
        assert!(array("'<f4'", "False", &huge).starts_with("expected a size"));
        assert_eq!(array("'<f4'", "False", "(2, 1)"), "expected 8 bytes of pixels, found 4");
    }
}
