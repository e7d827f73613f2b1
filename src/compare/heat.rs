//! False colour for error maps.

use crate::image::{Image, from_srgb};

/// The mapping from values to positions on the colour map.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum HeatScale {
    /// Linear from 0 to `max`.
    Linear {
        /// The value of the last colour.
        max: f64,
    },
    /// Logarithmic from `max`·10^−`decades` to `max`.
    Log {
        /// The value of the last colour.
        max: f64,
        /// The number of powers of ten that the map covers.
        decades: f64,
    },
}

impl HeatScale {
    /// Returns the position in [0, 1], or NaN for NaN.
    fn position(self, value: f64) -> f64 {
        let t = match self {
            HeatScale::Linear { max } if max > 0.0 => value / max,
            HeatScale::Log { max, decades } if max > 0.0 => 1.0 + (value.max(0.0) / max).log10() / decades,
            _ if value > 0.0 => 1.0,
            _ => value * 0.0,
        };
        if value.is_nan() { f64::NAN } else { t.clamp(0.0, 1.0) }
    }
}

/// The colour of NaN and infinite values, which is not on the map.
const INVALID: [f32; 3] = [0.0, 1.0, 1.0];

/// The sRGB-encoded colour map inferno [Smith & van der Walt 2015], which is perceptually uniform with increasing
/// lightness, as Zucker's polynomials of degree 6 (2019), constant term first.
const INFERNO: [[f64; 3]; 7] = [
    [0.000_218_940_369_119, 0.001_651_004_631_001, -0.019_480_898_437_092],
    [0.106_513_419_485_612, 0.563_956_436_788_409, 3.932_712_388_889_277],
    [11.602_493_082_471_87, -3.972_853_965_665_698, -15.942_394_106_291_4],
    [-41.703_996_131_394_59, 17.436_398_882_053_13, 44.354_145_198_728_13],
    [77.162_935_699_427, -33.402_358_942_100_92, -81.807_309_257_389_93],
    [-71.319_428_244_992_14, 32.626_064_263_977_23, 73.209_519_858_032_02],
    [25.131_126_224_773_41, -12.242_668_952_385_67, -23.070_325_002_871_72],
];

/// Returns the linear colour at a position in [0, 1].
fn inferno(t: f64) -> [f32; 3] {
    std::array::from_fn(|c| {
        let encoded = INFERNO.iter().rev().fold(0.0, |sum, k| sum * t + k[c]);
        from_srgb(encoded.clamp(0.0, 1.0)) as f32
    })
}

/// Returns false colours for an image's first channel: the channels R, G, B with the colours (linear), and the layer
/// channel `error.Y` with the values. NaN and infinite values are cyan.
///
/// # Panics
/// If the image has no channels.
pub fn heat(values: &Image, scale: HeatScale) -> Image {
    let mut image = Image::new(values.width, values.height, &["R", "G", "B", "error.Y"]);
    let pixels = values.data.chunks_exact(values.channels.len());
    for (to, from) in image.data.chunks_exact_mut(4).zip(pixels) {
        let value = from[0];
        let colour = if value.is_finite() { inferno(scale.position(f64::from(value))) } else { INVALID };
        to[..3].copy_from_slice(&colour);
        to[3] = value;
    }
    image
}

#[cfg(test)]
mod tests {
    use super::*;

    fn luminance(rgb: [f32; 3]) -> f32 {
        0.2126 * rgb[0] + 0.7152 * rgb[1] + 0.0722 * rgb[2]
    }

    #[test]
    fn the_map_rises_in_luminance_from_black_to_pale_yellow() {
        let steps: Vec<f32> = (0..=100).map(|i| luminance(inferno(f64::from(i) / 100.0))).collect();
        assert!(steps.windows(2).all(|w| w[1] > w[0]), "{steps:?}");
        assert!(steps[0] < 1e-3 && steps[100] > 0.85);
    }

    #[test]
    fn the_polynomials_meet_the_published_table() {
        // inferno at 0.5, sRGB-encoded: (0.735683, 0.215906, 0.330245).
        let expected = [0.735_683, 0.215_906, 0.330_245];
        for (value, expected) in inferno(0.5).into_iter().zip(expected) {
            assert!((crate::image::to_srgb(f64::from(value)) - expected).abs() < 0.02, "{value} {expected}");
        }
    }

    #[test]
    fn scales_end_where_they_say() {
        let linear = HeatScale::Linear { max: 4.0 };
        assert_eq!([0.0, 1.0, 4.0, 9.0].map(|v| linear.position(v)), [0.0, 0.25, 1.0, 1.0]);
        let log = HeatScale::Log { max: 10.0, decades: 4.0 };
        assert_eq!([0.0, 1e-3, 0.1, 10.0, 1e9].map(|v| log.position(v)), [0.0, 0.0, 0.5, 1.0, 1.0]);
        let none = HeatScale::Linear { max: 0.0 };
        assert_eq!([0.0, 1.0].map(|v| none.position(v)), [0.0, 1.0]);
    }

    #[test]
    fn what_is_no_number_stands_out_and_the_values_stay() {
        let mut values = Image::new(3, 1, &["error"]);
        values.data = vec![f32::NAN, f32::INFINITY, 0.5];
        let image = heat(&values, HeatScale::Linear { max: 1.0 });
        assert_eq!(image.rgb(0, 0), INVALID);
        assert_eq!(image.rgb(1, 0), INVALID);
        assert_eq!(image.pixel(2, 0)[3], 0.5);
    }
}
