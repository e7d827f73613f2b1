//! The rounding error of stored image values.

use crate::image::Image;

/// Significant bits of a half.
const HALF_BITS: i32 = 11;
/// Significant bits of a float.
const FLOAT_BITS: i32 = 24;
/// The exponents of the least normal half and of the largest half.
const HALF_EXPONENTS: [i32; 2] = [-14, 15];
/// The least number of significant bits that identifies a format; values such as 0.5, 1 or 2.5 have fewer.
const TELLING_BITS: i32 = 8;

/// The format to which an image's values were rounded, as inferred from the values.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Rounding {
    /// To 16-bit floats.
    Half,
    /// To 32-bit floats.
    Float,
}

impl Rounding {
    /// Returns `Half` if every value is a half and some value has about as many significant bits as a half. (One in
    /// 2^13 32-bit floats is a half by chance.)
    pub fn of(image: &Image) -> Self {
        let mut telling = false;
        for &value in image.data.iter().filter(|v| v.is_finite() && **v != 0.0) {
            let bits = significant_bits(value);
            let exponent = exponent(value);
            let room = HALF_BITS - (HALF_EXPONENTS[0] - exponent).max(0);
            if bits > room || exponent > HALF_EXPONENTS[1] {
                return Rounding::Float;
            }
            telling |= bits >= TELLING_BITS;
        }
        if telling { Rounding::Half } else { Rounding::Float }
    }

    /// Returns the largest distance between `value` and the value before rounding: half a step of the format, or 0 if
    /// `value` is not finite.
    pub fn bound(self, value: f32) -> f64 {
        if !value.is_finite() {
            return 0.0;
        }
        let step = match self {
            Rounding::Half => exponent(value).max(HALF_EXPONENTS[0]) + 1 - HALF_BITS,
            Rounding::Float if value == 0.0 => return 0.0,
            Rounding::Float => exponent(value) + 1 - FLOAT_BITS,
        };
        0.5 * f64::from(step).exp2()
    }
}

/// Returns the exponent e such that |value| is in [2^e, 2^(e+1)); for zero and subnormal numbers, that of the least
/// normal float.
fn exponent(value: f32) -> i32 {
    let biased = value.to_bits() >> 23 & 0xff;
    biased.max(1) as i32 - 127
}

/// Returns the number of bits from the first to the last set bit, for a normal number.
fn significant_bits(value: f32) -> i32 {
    let fraction = value.to_bits() & 0x7f_ffff;
    FLOAT_BITS - (fraction | 1 << 23).trailing_zeros() as i32
}

#[cfg(test)]
mod tests {
    use super::*;

    fn image(values: &[f32]) -> Image {
        let mut image = Image::new(values.len(), 1, &["Y"]);
        image.data = values.to_vec();
        image
    }

    #[test]
    fn halves_are_told_from_floats_and_from_round_numbers() {
        // 0.1 and 10⁻⁶ as halves, the largest half, and a value that is not a half.
        let halves = [0.099_975_586, 9.536_743e-7, 65504.0, 0.0, -0.5];
        assert_eq!(Rounding::of(&image(&halves)), Rounding::Half);
        assert_eq!(Rounding::of(&image(&[0.099_975_586, 0.1])), Rounding::Float);
        assert_eq!(Rounding::of(&image(&[0.099_975_586, 65536.0])), Rounding::Float);
        assert_eq!(Rounding::of(&image(&[0.099_975_586, 1e-8])), Rounding::Float);
        assert_eq!(Rounding::of(&image(&[0.5, 1.0, 2.5, 0.0])), Rounding::Float);
        assert_eq!(Rounding::of(&image(&[0.0, 0.0])), Rounding::Float);
    }

    #[test]
    fn bounds_are_half_a_step() {
        assert_eq!(Rounding::Half.bound(1.5), 2f64.powi(-11));
        assert_eq!(Rounding::Half.bound(-0.75), 2f64.powi(-12));
        assert_eq!(Rounding::Half.bound(0.0), 2f64.powi(-25));
        assert_eq!(Rounding::Float.bound(1.5), 2f64.powi(-24));
        assert_eq!(Rounding::Float.bound(0.0), 0.0);
        assert_eq!(Rounding::Half.bound(f32::NAN), 0.0);
    }
}
