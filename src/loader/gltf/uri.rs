//! URIs of buffers and images: names of files, or the data themselves.

/// The target of a URI.
pub enum Target {
    /// A file, relative to the scene.
    File(String),
    /// The bytes in the URI.
    Data(Vec<u8>),
}

/// Reads a URI.
///
/// # Errors
/// If the data are not in base 64, or the scheme is not `data`.
pub fn read(uri: &str) -> Result<Target, String> {
    if let Some(data) = uri.strip_prefix("data:") {
        let Some((_, text)) = data.split_once(',').filter(|(kind, _)| kind.ends_with(";base64")) else {
            return Err("expected a data URI in base 64".to_owned());
        };
        return decode_base64(text).map(Target::Data);
    }
    if let Some((scheme, _)) = uri.split_once("://") {
        return Err(format!("expected the name of a file, found an address with \"{scheme}://\""));
    }
    Ok(Target::File(decode_percent(uri)))
}

/// Decodes base 64, with or without padding. [RFC 4648]
fn decode_base64(text: &str) -> Result<Vec<u8>, String> {
    let digits = text.trim_end_matches('=').as_bytes();
    let mut bytes = Vec::with_capacity(digits.len() / 4 * 3 + 3);
    for (i, four) in digits.chunks(4).enumerate() {
        let mut bits = 0u32;
        for (j, digit) in four.iter().enumerate() {
            let value = match digit {
                b'A'..=b'Z' => digit - b'A',
                b'a'..=b'z' => digit - b'a' + 26,
                b'0'..=b'9' => digit - b'0' + 52,
                b'+' | b'-' => 62,
                b'/' | b'_' => 63,
                _ => return Err(format!("expected base 64, found an invalid character at {}", 4 * i + j)),
            };
            bits |= u32::from(value) << (18 - 6 * j);
        }
        let whole = match four.len() {
            4 => 3,
            3 => 2,
            2 => 1,
            _ => return Err("expected base 64, found an incomplete group at its end".to_owned()),
        };
        bytes.extend_from_slice(&bits.to_be_bytes()[1..][..whole]);
    }
    Ok(bytes)
}

/// Decodes percent-encoded bytes in a name; returns the name unchanged if the result is not UTF-8.
fn decode_percent(name: &str) -> String {
    let bytes = name.as_bytes();
    let mut decoded = Vec::with_capacity(bytes.len());
    let mut i = 0;
    while i < bytes.len() {
        let code = bytes.get(i + 1..i + 3).and_then(|hex| std::str::from_utf8(hex).ok());
        let code = code.filter(|hex| hex.bytes().all(|b| b.is_ascii_hexdigit()));
        match (bytes[i], code.and_then(|hex| u8::from_str_radix(hex, 16).ok())) {
            (b'%', Some(byte)) => {
                decoded.push(byte);
                i += 3;
            }
            (byte, _) => {
                decoded.push(byte);
                i += 1;
            }
        }
    }
    String::from_utf8(decoded).unwrap_or_else(|_| name.to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn base_64_is_that_of_the_standard() {
        for (text, bytes) in [("", ""), ("Zg==", "f"), ("Zm8=", "fo"), ("Zm8", "fo"), ("Zm9vYmFy", "foobar")]
        {
            assert_eq!(decode_base64(text).unwrap(), bytes.as_bytes(), "{text}");
        }
        assert_eq!(decode_base64("+/-_").unwrap(), [0xfb, 0xff, 0xbf]);
        assert!(decode_base64("Zm9vY").unwrap_err().ends_with("incomplete group at its end"));
        assert!(decode_base64("Zm9v!").unwrap_err().ends_with("an invalid character at 4"));
    }

    #[test]
    fn names_of_files_are_decoded() {
        let file = |uri| match read(uri) {
            Ok(Target::File(name)) => name,
            Ok(Target::Data(_)) => panic!("{uri} is no data"),
            Err(error) => error,
        };
        assert_eq!(file("two%20words/%C3%A9.bin"), "two words/é.bin");
        assert_eq!(file("100%.bin"), "100%.bin");
        assert_eq!(file("%ff"), "%ff");
        assert!(file("https://example.org/a.bin").starts_with("expected the name of a file"));
        assert!(read("data:text/plain,abc").is_err());
    }
}
