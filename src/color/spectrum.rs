//! Spectra as functions of wavelength, converted to linear Rec.709 as in Mitsuba 3's rgb variants.

use super::{Rgb, cie};

/// The quantity that a spectrum represents, which determines its conversion to RGB.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Quantity {
    /// A fraction in [0, 1] of reflected or transmitted light, under the illuminant D65.
    Reflectance,
    /// A property without an upper bound such as an absorption coefficient, under the illuminant D65.
    Unbounded,
    /// An index of refraction, under the illuminant D65. That of measured conductors may be slightly negative.
    Index,
    /// Emitted light.
    Emission,
}

/// A spectrum of a scene description.
#[derive(Clone, Debug, PartialEq)]
pub enum Spectrum {
    /// The same value at every wavelength.
    Constant(f64),
    /// Values at wavelengths in nm, interpolated linearly, and zero outside.
    Samples(Vec<(f64, f64)>),
}

/// A spectrum converted to RGB.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reduced {
    /// The colour, clamped to the range of the quantity.
    pub rgb: Rgb,
    /// The colour before clamping, if clamping changed it.
    pub out_of_gamut: Option<Rgb>,
}

/// The number of wavelengths over [360, 830] nm, as in Mitsuba.
const STEPS: usize = 1000;
/// The integral of ȳ, which normalises a spectrum of ones to the luminance 1.
const Y_INTEGRAL: f64 = 106.750_259_399_414_06;
/// The factor that normalises D65 to the luminance 1.
const D65_SCALE: f64 = 98.997_417_518_762_55;
/// The matrix from CIE XYZ to linear Rec.709.
const XYZ_TO_RGB: [[f64; 3]; 3] =
    [[3.240479, -1.537150, -0.498535], [-0.969256, 1.875991, 0.041556], [0.055648, -0.204043, 1.057311]];

impl Spectrum {
    /// Creates a sampled spectrum.
    ///
    /// # Errors
    /// If there are fewer than two samples, the wavelengths do not increase, or a number is not finite; the error is a
    /// sentence.
    pub fn from_samples(samples: Vec<(f64, f64)>) -> Result<Self, String> {
        if samples.len() < 2 {
            return Err(format!("expected at least two wavelength:value pairs, found {}", samples.len()));
        }
        if let Some(&(nm, v)) = samples.iter().find(|s| !(s.0.is_finite() && s.0 > 0.0 && s.1.is_finite())) {
            return Err(format!("expected positive wavelengths and finite values, found {nm}:{v}"));
        }
        match samples.windows(2).find(|pair| pair[0].0 >= pair[1].0) {
            Some(pair) => {
                Err(format!("expected increasing wavelengths, found {} after {}", pair[1].0, pair[0].0))
            }
            None => Ok(Spectrum::Samples(samples)),
        }
    }

    /// Converts the spectrum to linear Rec.709, as the given quantity.
    ///
    /// Samples are integrated at 1000 wavelengths with the CIE 1931 2° observer, and with D65 unless they are
    /// emission. A constant needs no integration: as reflectance or index it is neutral. As emission it is the
    /// equal-energy white, which differs from the neutral (D65) white of Rec.709.
    pub fn to_rgb(&self, quantity: Quantity) -> Reduced {
        let xyz = match self {
            Spectrum::Constant(v) if quantity == Quantity::Emission => [*v; 3],
            Spectrum::Constant(v) => return Reduced { rgb: Rgb::splat(*v as f32), out_of_gamut: None },
            Spectrum::Samples(samples) => integrate(samples, quantity != Quantity::Emission),
        };
        let channel = |row: [f64; 3]| (row[0] * xyz[0] + row[1] * xyz[1] + row[2] * xyz[2]) as f32;
        let raw = Rgb::from(XYZ_TO_RGB.map(channel));
        let [low, high] = match quantity {
            Quantity::Reflectance => [0.0, 1.0],
            Quantity::Unbounded | Quantity::Emission => [0.0, f32::MAX],
            Quantity::Index => [f32::MIN, f32::MAX],
        };
        let rgb = raw.map(|v| v.clamp(low, high));
        Reduced { rgb, out_of_gamut: (rgb != raw).then_some(raw) }
    }
}

/// The shortest and longest visible wavelengths, nm.
pub const VISIBLE: [f64; 2] = [360.0, 830.0];
/// The number of wavelengths at which the spectrum of a black body is tabulated.
const BLACKBODY_STEPS: usize = 471;

/// Returns samples of the radiance of a black body between two wavelengths in nm, in W·m⁻²·sr⁻¹·nm⁻¹, at a temperature
/// in K.
pub fn black_body(temperature: f64, [low, high]: [f64; 2]) -> Vec<(f64, f64)> {
    let nm = |i: usize| low + (high - low) * i as f64 / (BLACKBODY_STEPS - 1) as f64;
    (0..BLACKBODY_STEPS).map(|i| (nm(i), planck(nm(i), temperature))).collect()
}

/// Returns the radiance of a black body, W·m⁻²·sr⁻¹·nm⁻¹, at a wavelength in nm and a temperature in K. [Planck 1901]
fn planck(nm: f64, temperature: f64) -> f64 {
    const H: f64 = 6.626_070_15e-34;
    const C: f64 = 299_792_458.0;
    const K: f64 = 1.380_649e-23;
    let lambda = nm * 1e-9;
    1e-9 * 2.0 * H * C * C / lambda.powi(5) / (H * C / (lambda * K * temperature)).exp_m1()
}

/// Returns XYZ of a sampled spectrum, with D65 if `lit`, on the scale in which a spectrum of ones has the luminance
/// 1.
fn integrate(samples: &[(f64, f64)], lit: bool) -> [f64; 3] {
    let mut sum = [0.0; 3];
    for i in 0..STEPS {
        let nm = cie::FIRST_NM + i as f64 / (STEPS - 1) as f64 * (cie::LAST_NM - cie::FIRST_NM);
        let Some(value) = interpolate(samples, nm) else { continue };
        let at = ((nm - cie::FIRST_NM) / cie::STEP_NM).min((cie::OBSERVER.len() - 1) as f64);
        let low = (at as usize).min(cie::OBSERVER.len() - 2);
        let mix = |a: f64, b: f64| a + (at - low as f64) * (b - a);
        let light = if lit { mix(cie::D65[low], cie::D65[low + 1]) / D65_SCALE } else { 1.0 };
        for (channel, total) in sum.iter_mut().enumerate() {
            *total += value * light * mix(cie::OBSERVER[low][channel], cie::OBSERVER[low + 1][channel]);
        }
    }
    sum.map(|v| v * (cie::LAST_NM - cie::FIRST_NM) / STEPS as f64 / Y_INTEGRAL)
}

/// Returns the value at a wavelength; `None` outside the samples.
fn interpolate(samples: &[(f64, f64)], nm: f64) -> Option<f64> {
    let above = samples.partition_point(|s| s.0 <= nm);
    let (last_nm, last) = *samples.last()?;
    if above == 0 || nm > last_nm {
        return None;
    }
    let Some(&(x1, y1)) = samples.get(above) else { return Some(last) };
    let (x0, y0) = samples[above - 1];
    Some(y0 + (nm - x0) / (x1 - x0) * (y1 - y0))
}

#[cfg(test)]
mod tests;
