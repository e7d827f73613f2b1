//! The sRGB transfer function and sRGB hex notation. [IEC 61966-2-1:1999]

use super::Rgb;

/// Decodes a gamma-encoded value, both in [0, 1].
pub fn srgb_to_linear(v: f32) -> f32 {
    if v <= 0.04045 { v / 12.92 } else { ((v + 0.055) / 1.055).powf(2.4) }
}

/// Encodes a linear value, both in [0, 1].
pub fn linear_to_srgb(v: f32) -> f32 {
    if v <= 0.003_130_8 { v * 12.92 } else { 1.055 * v.powf(1.0 / 2.4) - 0.055 }
}

/// Returns the linear colour of `#rrggbb`; `None` if the text does not have that form.
pub fn parse_hex(text: &str) -> Option<Rgb> {
    let digits =
        text.strip_prefix('#').filter(|d| d.len() == 6 && d.bytes().all(|b| b.is_ascii_hexdigit()))?;
    let channel = |at: usize| {
        let byte = u8::from_str_radix(&digits[at..at + 2], 16).ok()?;
        Some(srgb_to_linear(f32::from(byte) / 255.0))
    };
    Some(Rgb::new(channel(0)?, channel(2)?, channel(4)?))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_two_directions_are_inverse() {
        for byte in 0..=255u8 {
            let v = f32::from(byte) / 255.0;
            assert!((linear_to_srgb(srgb_to_linear(v)) - v).abs() < 1e-6, "{byte}");
        }
    }

    #[test]
    fn hex_is_read_and_anything_else_refused() {
        let rgb = parse_hex("#ff8000").unwrap();
        assert_eq!(rgb.r, 1.0);
        assert!((rgb.g - 0.215_860_5).abs() < 1e-6);
        assert_eq!(rgb.b, 0.0);
        for bad in ["ff8000", "#ff800", "#ff80000", "#ff80gg", "#é8000", ""] {
            assert_eq!(parse_hex(bad), None, "{bad}");
        }
    }
}
