//! The radiance of a clear sky. [Hosek 2012]
//!
//! The radiance is the model's formula, evaluated at each direction. An [`EnvMap`] of the sky only gives the density of
//! the sampled directions, so it can be coarse. Interpolated, an image of 1024 × 513 texels would differ by up to 20 %
//! at 0.2° above the horizon if the sun is at 5°, and light would leak below the horizon.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use hw_skymodel::rgb::{SkyParams, SkyState};

use crate::color::Rgb;
use crate::emitter::environment_map::EnvMapSampleX16;
use crate::emitter::{EnvMap, EnvMapSample};
use crate::error::{Error, Result};
use crate::image::TextureImage;
use crate::math::functions::{angle_x16, exp_x16};
use crate::math::{DAffine3, DMat3, DVec3, Frame, Vec2, Vec3, Vec3x16, f32x16};

/// The width of the map of densities, in texels.
const WIDTH: usize = 512;
/// The height of the map of densities, in texels. It is odd, so that a row is at the horizon.
const HEIGHT: usize = 257;
/// The integral of ȳ of the CIE 1931 observer, nm, by which the model's luminance is divided, as in Mitsuba 3.9.1.
const Y_INTEGRAL: f32 = 106.750_26;

/// What a sky depends on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SkySettings {
    /// The amount of haze, from 1 (none) to 10.
    pub turbidity: f64,
    /// The reflectance of the ground, from 0 to 1.
    pub albedo: Rgb,
    /// Unit direction to the zenith.
    pub up: Vec3,
    /// Unit direction to the sun, at or above the horizon.
    pub sun: Vec3,
    /// A factor on the radiance.
    pub scale: f32,
    /// Whether the radiance at the horizon continues below it. Otherwise it is black there.
    pub extends: bool,
}

/// A clear sky, without the sun's disc.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Sky {
    radiance: SkyRadiance,
    /// The density of the directions.
    map: EnvMap,
}

/// The radiance as a function of the direction.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
struct SkyRadiance {
    /// The coefficients A to I of each channel, H after I. [Hosek 2012, Eq. 8]
    coefficients: [[f32; 9]; 3],
    /// The factor on each channel, W·m⁻²·sr⁻¹·nm⁻¹.
    scale: [f32; 3],
    up: Vec3,
    sun: Vec3,
    extends: bool,
}

impl Sky {
    /// The memory that a sky needs, in bytes.
    pub const BYTES: u64 = (WIDTH * HEIGHT) as u64 * (12 + EnvMap::BYTES_PER_TEXEL);

    /// Creates a sky.
    ///
    /// # Errors
    /// If the turbidity or the albedo is out of range, the sun is below the horizon, or the scale is negative or not
    /// finite.
    pub fn new(settings: &SkySettings) -> Result<Sky> {
        let SkySettings { turbidity, albedo, up, sun, scale, extends } = *settings;
        let elevation = f64::from(sun.dot(up)).clamp(-1.0, 1.0).asin() as f32;
        let params = SkyParams { elevation, turbidity: turbidity as f32, albedo: albedo.to_array() };
        let state = SkyState::new(&params).map_err(|error| Error::scene(error.to_string()))?;
        let (coefficients, factors) = state.raw();
        let radiance = SkyRadiance {
            coefficients: std::array::from_fn(|c| std::array::from_fn(|i| coefficients[9 * c + i])),
            scale: factors.map(|factor| factor * scale / Y_INTEGRAL),
            up,
            sun,
            extends,
        };
        Ok(Sky { map: radiance.map()?, radiance })
    }

    /// Returns the radiance from a unit direction.
    #[inline]
    pub fn eval(&self, d: Vec3) -> Rgb {
        self.radiance.eval(d)
    }

    /// Samples a direction; `None` if the sky is black in it.
    pub fn sample(&self, u: Vec2) -> Option<EnvMapSample> {
        self.with_radiance(self.map.sample(u)?)
    }

    /// Samples a direction in proportion to the luminance in excess of its mean; `None` if there is none.
    pub fn sample_compensated(&self, u: Vec2) -> Option<EnvMapSample> {
        self.with_radiance(self.map.sample_compensated(u)?)
    }

    fn with_radiance(&self, sample: EnvMapSample) -> Option<EnvMapSample> {
        let radiance = self.eval(sample.wi);
        (!radiance.is_black()).then_some(EnvMapSample { radiance, ..sample })
    }

    /// Computes [`sample`](Self::sample) in sixteen lanes, or [`sample_compensated`](Self::sample_compensated).
    /// Densities are 0 where there is no sample.
    pub fn sample_x16(&self, compensated: bool, u: [f32x16; 2]) -> EnvMapSampleX16 {
        let EnvMapSampleX16 { wi, pdf, .. } = self.map.sample_x16(compensated, u);
        let radiance = self.radiance.eval_x16(&wi);
        let [r, g, b] = radiance.map(|c| c.simd_ne(f32x16::ZERO));
        EnvMapSampleX16 { wi, radiance, pdf: pdf & (r | g | b) }
    }

    /// Returns the radiance from sixteen unit directions, and the densities with which
    /// [`sample_x16`](Self::sample_x16) samples them.
    pub fn eval_x16(&self, d: &Vec3x16, compensated: bool) -> ([f32x16; 3], f32x16) {
        (self.radiance.eval_x16(d), self.map.eval_x16(d, compensated).1)
    }

    /// Returns the map that gives the densities of the samples and the mean radiance.
    pub fn map(&self) -> &EnvMap {
        &self.map
    }
}

impl SkyRadiance {
    /// Returns a map of the radiance, whose +y is the zenith.
    fn map(&self) -> Result<EnvMap> {
        let Frame { s, t, n } = Frame::from_normal(self.up);
        let to_world = DMat3::from_cols(s.as_dvec3(), n.as_dvec3(), -t.as_dvec3());
        let mut values = Vec::with_capacity(3 * WIDTH * HEIGHT);
        for y in 0..HEIGHT {
            // The row at the horizon is above it, whatever the rounding.
            let angle = if y == HEIGHT / 2 { FRAC_PI_2 - 1e-6 } else { PI * y as f64 / (HEIGHT - 1) as f64 };
            let (sin, cos) = angle.sin_cos();
            for x in 0..WIDTH {
                let (sin_phi, cos_phi) = (TAU * (x as f64 + 0.5) / WIDTH as f64).sin_cos();
                let d = to_world * DVec3::new(sin_phi * sin, cos, -cos_phi * sin);
                values.extend(self.eval(d.as_vec3()).to_array());
            }
        }
        let image = TextureImage::from_floats(WIDTH, HEIGHT, 3, values)?;
        EnvMap::new(image, 1.0, &DAffine3::from_mat3(to_world))
    }

    /// Returns the radiance from a unit direction.
    fn eval(&self, d: Vec3) -> Rgb {
        let cos_theta = d.dot(self.up);
        if cos_theta >= 0.0 {
            return self.above(cos_theta, d);
        }
        match (self.extends, (d - self.up * cos_theta).try_normalize()) {
            (true, Some(horizontal)) => self.above(0.0, horizontal),
            _ => Rgb::BLACK,
        }
    }

    /// Computes [`eval`](Self::eval) in sixteen lanes.
    fn eval_x16(&self, d: &Vec3x16) -> [f32x16; 3] {
        let (up, sun) = (Vec3x16::splat(self.up), Vec3x16::splat(self.sun));
        let cos_theta = d.dot(up);
        let above = cos_theta.simd_ge(f32x16::ZERO);
        let horizontal = (*d - up * cos_theta).normalize_or_zero();
        let d = Vec3x16::select(above, *d, horizontal);
        let seen = match self.extends {
            true => above | horizontal.length_squared().simd_gt(f32x16::ZERO),
            false => above,
        };
        let cos_theta = cos_theta.fast_max(f32x16::ZERO);
        let cos_gamma = d.dot(sun);
        let gamma = angle_x16(d.cross(sun).length_squared().sqrt(), cos_gamma);
        std::array::from_fn(|channel| {
            let [a, b, c, d, e, f, g, i, h] = self.coefficients[channel].map(f32x16::splat);
            let one = f32x16::ONE;
            let base = (one + h * h - f32x16::splat(2.0) * h * cos_gamma).fast_max(f32x16::ZERO);
            let chi = (one + cos_gamma * cos_gamma) / (base * base.sqrt());
            let zenith = one + a * exp_x16(b / (cos_theta + f32x16::splat(0.01)));
            let around = d * exp_x16(e * gamma) + f * cos_gamma * cos_gamma + g * chi;
            let radiance = zenith * (c + around + i * cos_theta.sqrt());
            (f32x16::splat(self.scale[channel]) * radiance) & seen
        })
    }

    /// Returns the radiance from a unit direction with a cosine to the zenith of at least 0.
    fn above(&self, cos_theta: f32, d: Vec3) -> Rgb {
        let cos_gamma = d.dot(self.sun);
        let gamma = d.cross(self.sun).length().atan2(cos_gamma);
        let channel = |c: usize| {
            let [a, b, c, d, e, f, g, i, h] = self.coefficients[c];
            // [Hosek 2012, Eq. 9]
            let base = (1.0 + h * h - 2.0 * h * cos_gamma).max(0.0);
            let chi = (1.0 + cos_gamma * cos_gamma) / (base * base.sqrt());
            (1.0 + a * (b / (cos_theta + 0.01)).exp())
                * (c + d * (e * gamma).exp() + f * cos_gamma * cos_gamma + g * chi + i * cos_theta.sqrt())
        };
        Rgb::from([0, 1, 2].map(|c| self.scale[c] * channel(c)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lanes_compute_what_scalars_do() {
        let sun = Vec3::new(0.5, 0.3, -0.4).normalize();
        for extends in [false, true] {
            let (albedo, up) = (Rgb::splat(0.2), Vec3::Y);
            let settings = SkySettings { turbidity: 3.0, albedo, up, sun, scale: 0.5, extends };
            let sky = Sky::new(&settings).expect("a sky");
            for i in 0..400u16 {
                let turn = f32::from(i) * 2.4;
                let y = 1.0 - f32::from(i) / 200.0;
                let r = (1.0 - y * y).max(0.0).sqrt();
                let d = Vec3::new(r * turn.cos(), y, r * turn.sin());
                let (radiance, pdf) = sky.eval_x16(&Vec3x16::splat(d), true);
                let (expected, expected_pdf) = (sky.eval(d).to_array(), sky.map().pdf_compensated(d));
                for (found, expected) in radiance.iter().zip(expected) {
                    assert!((found.as_array()[5] - expected).abs() <= 1e-5 * expected, "{d}");
                }
                assert!((pdf.as_array()[5] - expected_pdf).abs() < 1e-3 * (1.0 + expected_pdf), "{d}");
                let u = [f32::from(i) / 400.0, f32::from(i * 7 % 400) / 400.0];
                let sample = sky.sample_x16(false, u.map(f32x16::splat));
                let alone = sky.sample(u.into());
                assert_eq!(sample.pdf.as_array()[2] > 0.0, alone.is_some(), "{u:?}");
                let Some(alone) = alone else { continue };
                assert!((sample.wi.lane(2) - alone.wi).length() < 2e-5, "{u:?}");
                assert!((sample.pdf.as_array()[2] / alone.pdf - 1.0).abs() < 1e-3, "{u:?}");
            }
        }
    }
}
