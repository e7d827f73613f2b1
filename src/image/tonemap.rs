//! Tone curves: from scene radiance to the values of an 8-bit image.

use super::srgb::to_srgb;
use std::fmt;
use std::str::FromStr;

/// A map from linear colours to sRGB-encoded ones.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Tonemap {
    /// Linear up to 1, then clipped.
    #[default]
    None,
    /// A film-like curve with a toe and a shoulder, per channel; white is 11.2 at exposure 1. [Hable 2010]
    Filmic,
    /// AgX with its default contrast: bright colours become pale instead of clipped. A polynomial replaces the table
    /// of the contrast. [Sobotka 2022; Wrensch 2023]
    Agx,
}

impl Tonemap {
    /// All tone curves.
    pub const ALL: [Tonemap; 3] = [Tonemap::None, Tonemap::Filmic, Tonemap::Agx];

    /// Returns its name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Tonemap::None => "none",
            Tonemap::Filmic => "filmic",
            Tonemap::Agx => "agx",
        }
    }

    /// Returns the sRGB-encoded colour of a linear one; the result may be outside [0, 1].
    pub fn encode(self, linear: [f64; 3]) -> [f64; 3] {
        let linear = linear.map(|v| v.max(0.0));
        match self {
            Tonemap::None => linear.map(to_srgb),
            Tonemap::Filmic => linear.map(|v| to_srgb(hable(2.0 * v) / hable(11.2))),
            Tonemap::Agx => agx(linear),
        }
    }
}

impl fmt::Display for Tonemap {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for Tonemap {
    type Err = String;

    fn from_str(s: &str) -> Result<Self, String> {
        Tonemap::ALL.into_iter().find(|t| t.name() == s).ok_or_else(|| {
            let names = Tonemap::ALL.map(Tonemap::name).join(", ");
            format!("unknown tone curve \"{s}\"; there are {names}")
        })
    }
}

/// The curve of [Hable 2010].
fn hable(x: f64) -> f64 {
    let [a, b, c, d, e, f] = [0.15, 0.5, 0.1, 0.2, 0.02, 0.3];
    (x * (a * x + c * b) + d * e) / (x * (a * x + b) + d * f) - e / f
}

/// The rows of the matrix that moves the primaries inwards. [Wrensch 2023]
const INSET: [[f64; 3]; 3] = [
    [0.842_479_062_253_094, 0.078_433_599_999_999_2, 0.079_223_745_147_764_3],
    [0.042_328_242_261_012_3, 0.878_468_636_469_772, 0.079_166_127_460_554_3],
    [0.042_375_654_905_705_1, 0.078_433_6, 0.879_142_973_793_104],
];
/// The rows of its inverse.
const OUTSET: [[f64; 3]; 3] = [
    [1.196_879_005_120_17, -0.098_020_881_140_136_8, -0.099_029_744_079_720_5],
    [-0.052_896_851_757_456_2, 1.151_903_129_904_17, -0.098_961_176_844_843_3],
    [-0.052_971_635_514_443_8, -0.098_043_450_117_124_1, 1.151_073_672_641_16],
];
/// The logarithms to base 2 of black and white.
const RANGE: [f64; 2] = [-12.473_93, 4.026_069];

fn agx(linear: [f64; 3]) -> [f64; 3] {
    let times = |m: [[f64; 3]; 3], v: [f64; 3]| m.map(|row| row[0] * v[0] + row[1] * v[1] + row[2] * v[2]);
    let logarithms = times(INSET, linear).map(|v| {
        let exponent = v.max(f64::MIN_POSITIVE).log2().clamp(RANGE[0], RANGE[1]);
        (exponent - RANGE[0]) / (RANGE[1] - RANGE[0])
    });
    let contrast = logarithms.map(|x| {
        let coefficients = [15.5, -40.14, 31.96, -6.868, 0.4298, 0.1191, -0.002_32];
        coefficients.into_iter().fold(0.0, |sum, c| sum * x + c)
    });
    // The result is for a display with a gamma of 2.2.
    times(OUTSET, contrast).map(|v| to_srgb(v.max(0.0).powf(2.2)))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Greys stay grey and rise from black to white. AgX shows 0.18 as the middle of the range.
    #[test]
    fn greys_rise_from_black_to_white() {
        for tonemap in Tonemap::ALL {
            let mut last = -1e-3;
            for i in 0..=2000 {
                let v = (f64::from(i) * 0.02 - 24.0).exp2();
                let [r, g, b] = tonemap.encode([v; 3]);
                assert!((r - g).abs() < 1e-3 && (g - b).abs() < 1e-3, "{tonemap} {v}: {r} {g} {b}");
                assert!(g >= last - 1e-6, "{tonemap} {v}: {g} after {last}");
                last = g;
            }
            assert!(tonemap.encode([0.0; 3])[1].abs() < 1e-3 && last > 0.98, "{tonemap}: {last}");
            assert_eq!(tonemap.to_string().parse(), Ok(tonemap));
        }
        assert!((Tonemap::Agx.encode([0.18; 3])[1] - 0.5).abs() < 0.01);
        assert!((Tonemap::Filmic.encode([5.6; 3])[1] - 1.0).abs() < 1e-12);
        assert_eq!(
            "log".parse::<Tonemap>(),
            Err("unknown tone curve \"log\"; there are none, filmic, agx".into())
        );
    }

    /// A saturated bright colour loses saturation with AgX and is clipped without a curve.
    #[test]
    fn bright_colours_become_pale() {
        let blue = [0.0, 0.0, 10.0];
        assert_eq!(Tonemap::None.encode(blue)[..2], [0.0, 0.0]);
        let [r, g, b] = Tonemap::Agx.encode(blue);
        assert!(r > 0.3 && g > 0.3 && b > 0.9, "{r} {g} {b}");
    }
}
