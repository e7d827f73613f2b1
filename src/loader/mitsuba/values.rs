//! Parsing of values: numbers, lists of numbers, colours, spectra.

use crate::color::spectrum::Spectrum;
use crate::color::srgb;
use crate::math::DVec3;
use crate::util::wording::quoted;

/// Parses a number: finite, in decimal or scientific notation.
///
/// # Errors
/// A sentence with the text that was found, as for all functions here.
pub fn float(text: &str) -> Result<f64, String> {
    let number = text.trim().parse::<f64>().ok().filter(|v| v.is_finite());
    number.ok_or_else(|| format!("expected a number, found {}", quoted(text)))
}

/// Parses a whole number.
pub fn integer(text: &str) -> Result<i64, String> {
    text.trim().parse().map_err(|_| format!("expected a whole number, found {}", quoted(text)))
}

/// Parses `true` or `false`, in any case.
pub fn boolean(text: &str) -> Result<bool, String> {
    match text.trim().to_ascii_lowercase().as_str() {
        "true" => Ok(true),
        "false" => Ok(false),
        _ => Err(format!("expected true or false, found {}", quoted(text))),
    }
}

/// Parses numbers separated by white space, commas or both.
pub fn floats(text: &str) -> Result<Vec<f64>, String> {
    tokens(text).map(float).collect()
}

/// Parses three numbers, or one number for all three.
pub fn triple(text: &str) -> Result<[f64; 3], String> {
    match floats(text)?[..] {
        [v] => Ok([v; 3]),
        [x, y, z] => Ok([x, y, z]),
        ref other => Err(format!("expected one or three numbers, found {}", other.len())),
    }
}

/// Parses three numbers.
pub fn vector(text: &str) -> Result<DVec3, String> {
    match floats(text)?[..] {
        [x, y, z] => Ok(DVec3::new(x, y, z)),
        ref other => Err(format!("expected three numbers, found {}", other.len())),
    }
}

/// Parses a colour: three linear values, one for all three, or `#rrggbb` in sRGB.
pub fn rgb(text: &str) -> Result<[f64; 3], String> {
    if !text.trim().starts_with('#') {
        return triple(text);
    }
    let colour = srgb::parse_hex(text.trim());
    let colour = colour.ok_or_else(|| format!("expected a colour like #ff8000, found {}", quoted(text)))?;
    Ok(colour.to_array().map(f64::from))
}

/// Parses a colour in sRGB: three values from 0 to 1, one for all three, or `#rrggbb`.
pub fn srgb(text: &str) -> Result<[f64; 3], String> {
    if text.trim().starts_with('#') {
        return rgb(text);
    }
    Ok(triple(text)?.map(|v| f64::from(srgb::srgb_to_linear(v as f32))))
}

/// Parses a spectrum: one value for all wavelengths, or `wavelength:value` pairs in nm.
pub fn spectrum(text: &str) -> Result<Spectrum, String> {
    if !text.contains(':') {
        return match floats(text)?[..] {
            [v] => Ok(Spectrum::Constant(v)),
            ref other => {
                Err(format!("expected one value or wavelength:value pairs, found {} values", other.len()))
            }
        };
    }
    let pair = |token: &str| {
        let (nm, value) = token
            .split_once(':')
            .ok_or_else(|| format!("expected wavelength:value, found {}", quoted(token)))?;
        Ok((float(nm)?, float(value)?))
    };
    Spectrum::from_samples(tokens(text).map(pair).collect::<Result<_, String>>()?)
}

/// Parses the lines of a spectrum file: wavelength and value, with comments from `#` on.
pub fn spectrum_file(text: &str) -> Result<Spectrum, (usize, String)> {
    let mut samples = Vec::new();
    for (i, line) in text.lines().enumerate() {
        let line = line.split('#').next().unwrap_or_default();
        match floats(line).map_err(|e| (i + 1, e))?[..] {
            [] => {}
            [nm, value] => samples.push((nm, value)),
            ref other => {
                return Err((
                    i + 1,
                    format!("expected a wavelength and a value, found {} numbers", other.len()),
                ));
            }
        }
    }
    Spectrum::from_samples(samples).map_err(|e| (0, e))
}

fn tokens(text: &str) -> impl Iterator<Item = &str> {
    text.split(|c: char| c == ',' || c.is_whitespace()).filter(|t| !t.is_empty())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_read_in_every_notation_and_nothing_else_is() {
        assert_eq!(float(" -1.5e-3 "), Ok(-1.5e-3));
        assert_eq!(float("+.5"), Ok(0.5));
        for bad in ["1,0", "", "0.3f", "nan", "inf", "1e999", "0x10"] {
            assert_eq!(float(bad), Err(format!("expected a number, found \"{bad}\"")));
        }
        assert_eq!(integer(" 7 "), Ok(7));
        assert_eq!(integer("7.0"), Err("expected a whole number, found \"7.0\"".into()));
        assert_eq!(boolean("True"), Ok(true));
        assert_eq!(boolean("1"), Err("expected true or false, found \"1\"".into()));
    }

    #[test]
    fn lists_are_separated_by_space_or_comma() {
        assert_eq!(triple("1, 2,3"), Ok([1.0, 2.0, 3.0]));
        assert_eq!(triple("\t1\n2 3,"), Ok([1.0, 2.0, 3.0]));
        assert_eq!(triple("0.5"), Ok([0.5; 3]));
        assert_eq!(triple("1 2"), Err("expected one or three numbers, found 2".into()));
        assert_eq!(vector("1"), Err("expected three numbers, found 1".into()));
        assert_eq!(rgb("#ffffff"), Ok([1.0; 3]));
        assert_eq!(rgb("#fff"), Err("expected a colour like #ff8000, found \"#fff\"".into()));
    }

    #[test]
    fn spectra_are_constants_or_pairs() {
        assert_eq!(spectrum("0.4"), Ok(Spectrum::Constant(0.4)));
        assert_eq!(spectrum("400:0.1, 700:0.9"), Ok(Spectrum::Samples(vec![(400.0, 0.1), (700.0, 0.9)])));
        assert_eq!(
            spectrum("1 2"),
            Err("expected one value or wavelength:value pairs, found 2 values".into())
        );
        assert_eq!(spectrum("400:1 5"), Err("expected wavelength:value, found \"5\"".into()));
        assert_eq!(
            spectrum_file("# gold\n400 1\n\n700 2 # end\n"),
            Ok(Spectrum::Samples(vec![(400.0, 1.0), (700.0, 2.0)]))
        );
        assert_eq!(
            spectrum_file("400 1\n5\n"),
            Err((2, "expected a wavelength and a value, found 1 numbers".into()))
        );
    }
}
