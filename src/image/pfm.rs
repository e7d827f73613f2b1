//! The portable float map: a text header, then 32-bit floats, with rows from the bottom up. [Debevec, PFM]

use super::format::MAX_VALUES;
use super::{Image, Metadata};

/// Encodes a little-endian file with one or three channels. `data` has the top row first.
pub(super) fn encode(width: usize, height: usize, channels: usize, data: &[f32]) -> Vec<u8> {
    let kind = if channels == 3 { "PF" } else { "Pf" };
    let mut bytes = format!("{kind}\n{width} {height}\n-1.0\n").into_bytes();
    bytes.reserve(4 * data.len());
    for row in data.chunks_exact(width * channels).rev() {
        bytes.extend(row.iter().flat_map(|v| v.to_le_bytes()));
    }
    bytes
}

/// Decodes a file of either endianness. If the magnitude of the scale is not 1, the values are multiplied by it.
pub(super) fn decode(bytes: &[u8]) -> Result<Image, String> {
    let mut rest = bytes;
    let channels = match token(&mut rest)? {
        "PF" => 3,
        "Pf" => 1,
        other => return Err(format!("expected PF or Pf, found \"{other}\"")),
    };
    let width: usize = number(&mut rest, "the width")?;
    let height: usize = number(&mut rest, "the height")?;
    let scale: f32 = number(&mut rest, "the scale")?;
    if !scale.is_normal() {
        return Err(format!("expected a scale other than 0, found {scale}"));
    }
    let values = (width as u64).saturating_mul(height as u64).saturating_mul(channels as u64);
    if values == 0 || values > MAX_VALUES {
        return Err(format!(
            "expected a size of at least 1x1 and at most {MAX_VALUES} values, found {width}x{height}"
        ));
    }
    let (expected, found) = (4 * values as usize, rest.len());
    if found < expected {
        return Err(format!("expected {expected} bytes of pixels, found {found}"));
    }
    let factor = scale.abs();
    let mut data = Vec::with_capacity(values as usize);
    for row in rest[..expected].chunks_exact(4 * width * channels).rev() {
        data.extend(row.as_chunks::<4>().0.iter().map(|&b| {
            let value = if scale < 0.0 { f32::from_le_bytes(b) } else { f32::from_be_bytes(b) };
            if factor == 1.0 { value } else { value * factor }
        }));
    }
    let names: &[&str] = if channels == 3 { &["R", "G", "B"] } else { &["Y"] };
    let channels = names.iter().map(|&n| n.to_owned()).collect();
    Ok(Image { width, height, channels, data, metadata: Metadata::new() })
}

/// Returns the next word of the header and skips one whitespace byte after it.
fn token<'a>(rest: &mut &'a [u8]) -> Result<&'a str, String> {
    let bytes = rest.trim_ascii_start();
    let end = bytes.iter().position(u8::is_ascii_whitespace).filter(|&end| end <= 64);
    let end = end.ok_or("the header is not complete")?;
    let word = std::str::from_utf8(&bytes[..end]).map_err(|_| "the header is not text")?;
    *rest = &bytes[end + 1..];
    Ok(word)
}

/// Returns the next word of the header as a number.
fn number<T: std::str::FromStr>(rest: &mut &[u8], what: &str) -> Result<T, String> {
    let word = token(rest)?;
    word.parse().map_err(|_| format!("expected {what} as a number, found \"{word}\""))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_bytes_are_the_format_s_own() {
        let bytes = encode(1, 2, 1, &[1.0, 2.0]);
        let mut expected = b"Pf\n1 2\n-1.0\n".to_vec();
        expected.extend(2.0f32.to_le_bytes());
        expected.extend(1.0f32.to_le_bytes());
        assert_eq!(bytes, expected);
    }

    #[test]
    fn both_endiannesses_are_read() {
        let mut bytes = b"PF\n1 1\n1.0\n".to_vec();
        bytes.extend([1.5f32, -0.0, 3.0].iter().flat_map(|v| v.to_be_bytes()));
        let image = decode(&bytes).unwrap();
        assert_eq!((image.channels.join(""), image.data), ("RGB".into(), vec![1.5, -0.0, 3.0]));
    }

    #[test]
    fn bits_survive_the_round_trip() {
        let data: Vec<f32> =
            [0u32, 1, 0x8000_0000, 0x7f7f_ffff, 0x7f80_0000, 0x7fc0_1234].map(f32::from_bits).to_vec();
        let image = decode(&encode(1, 2, 3, &data)).unwrap();
        let bits = |v: &[f32]| v.iter().map(|v| v.to_bits()).collect::<Vec<_>>();
        assert_eq!(bits(&image.data), bits(&data));
    }

    #[test]
    fn bad_files_are_named_sentences() {
        let says = |bytes: &[u8]| decode(bytes).unwrap_err();
        assert_eq!(says(b"PF\n2 "), "the header is not complete");
        assert_eq!(says(b"PF\n2 x 1\n"), "expected the height as a number, found \"x\"");
        assert_eq!(says(b"PF\n-2 2\n1\n"), "expected the width as a number, found \"-2\"");
        assert_eq!(says(b"PF\n2 2\n0\n"), "expected a scale other than 0, found 0");
        assert_eq!(says(b"PF\n2 2\nnan\n"), "expected a scale other than 0, found NaN");
        assert_eq!(says(b"PF\n2 2\n-1.0\n1234"), "expected 48 bytes of pixels, found 4");
        assert_eq!(
            says(b"PF\n0 2\n-1.0\n"),
            "expected a size of at least 1x1 and at most 4294967296 values, found 0x2"
        );
        let huge = format!("PF\n{0} {0}\n-1.0\n", usize::MAX);
        assert!(says(huge.as_bytes()).starts_with("expected a size"));
    }
}
