//! Environment maps: light from infinity given by an image.
//!
//! The image uses latitude and longitude as in Mitsuba 3.9.1. The first row is the direction +y, the last −y. Columns
//! go from −z through +x, +z and −x; the centre of column j is at the longitude 2π (j + ½)/width, while the first and
//! the last row are at the poles. Radiance is interpolated bilinearly.
//!
//! Directions are sampled from a density per unit solid angle that is bilinear in the longitude and in h = ½ (1 − cos
//! θ), the fraction of the sphere above a direction. It has no singularity at the poles. Between two rows it is
//! proportional to the luminance except for the curvature of h(θ).

use std::f64::consts::{FRAC_1_PI, PI, TAU};

use crate::color::Rgb;
use crate::error::{Error, Result};
use crate::image::TextureImage;
use crate::math::functions::angle_x16;
use crate::math::lanes::{LANES, each_lane, f32x16, with_sign};
use crate::math::{DAffine3, DMat3, DVec3, Mat3, Vec2, Vec3, Vec3x16};
use crate::sampling::warp::sin_cos_turn_x16;
use crate::sampling::{BilinearDistribution2D, PointsX16};

/// The least luminance in excess of its mean that is sampled for its own sake, relative to the mean.
const LEAST_EXCESS: f32 = 0.03;
/// The tolerance for the orthogonality of a rotation's axes.
const ORTHOGONAL: f64 = 1e-4;

/// An image of the radiance from all directions.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct EnvMap {
    image: TextureImage,
    scale: f32,
    /// A rotation, possibly with a reflection.
    to_world: Mat3,
    /// The density over the longitude, in turns from the first column's centre, and h.
    distribution: BilinearDistribution2D,
    /// The density that is proportional to the luminance in excess of its mean.
    compensated: BilinearDistribution2D,
    mean: Rgb,
    /// The mean of the luminance in excess of its mean.
    mean_excess: f32,
}

/// A direction sampled from an [`EnvMap`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EnvMapSample {
    /// Unit direction towards the environment.
    pub wi: Vec3,
    /// Radiance from that direction.
    pub radiance: Rgb,
    /// Density per unit solid angle.
    pub pdf: f32,
}

/// An [`EnvMapSample`] in each of sixteen lanes.
pub struct EnvMapSampleX16 {
    /// Unit directions towards the environment.
    pub wi: Vec3x16,
    /// Radiance by channel.
    pub radiance: [f32x16; 3],
    /// Densities per unit solid angle; 0 where there is no sample.
    pub pdf: f32x16,
}

impl EnvMap {
    /// The memory needed to build the two distributions of directions, in bytes per texel: weights, densities and
    /// their sums.
    pub const BYTES_PER_TEXEL: u64 = 24;

    /// Creates the map of `image` times `scale`, rotated by `to_world`. Only the rotation and reflection of
    /// `to_world` matter, because the map is at infinity.
    ///
    /// # Errors
    /// If a radiance or the scale is not finite, the scale is negative, or `to_world` has shear or non-uniform
    /// scaling.
    pub fn new(image: TextureImage, scale: f32, to_world: &DAffine3) -> Result<EnvMap> {
        if !(scale >= 0.0 && scale.is_finite()) {
            return Err(Error::scene(format!("expected a finite scale of at least 0, found {scale}")));
        }
        let rotation = rotation(to_world)?;
        for y in 0..image.height() {
            for x in 0..image.width() {
                let [r, g, b] = image.rgb(x, y);
                if !(r.is_finite() && g.is_finite() && b.is_finite()) {
                    let found = format!("{r} {g} {b} in column {x} of row {y}");
                    return Err(Error::scene(format!("expected finite radiance, found {found}")));
                }
            }
        }
        let mean_luminance = mean(&image, |c| [luminance(c), 0.0, 0.0]).r;
        let excess = |c| (luminance(c) - mean_luminance).max(0.0);
        let mean_excess = mean(&image, |c| [excess(c), 0.0, 0.0]).r;
        let is_uniform = mean_excess < LEAST_EXCESS * mean_luminance;
        Ok(EnvMap {
            distribution: distribution(&image, luminance),
            compensated: distribution(&image, excess),
            mean: mean(&image, |c| c) * scale,
            mean_excess: if is_uniform { 0.0 } else { mean_excess * scale },
            image,
            scale,
            to_world: rotation.as_mat3(),
        })
    }

    /// Returns the radiance from a unit direction.
    pub fn eval(&self, direction: Vec3) -> Rgb {
        let d = self.to_world.transpose() * direction;
        let theta = d.x.hypot(d.z).atan2(d.y);
        self.at(self.turns(d.as_dvec3()), f64::from(theta))
    }

    /// Returns the longitude in turns, in [0, 1], from the first column's centre.
    #[inline]
    fn turns(&self, d: DVec3) -> f64 {
        let turns = d.x.atan2(-d.z) / TAU - 0.5 / self.image.width() as f64;
        turns - turns.floor()
    }

    /// Returns the radiance at a longitude, in turns from the first column's centre, and an angle from the pole.
    #[inline]
    fn at(&self, turns: f64, theta: f64) -> Rgb {
        let (width, height) = (self.image.width(), self.image.height());
        let (x, y) = (turns * width as f64, theta / PI * (height - 1) as f64);
        let column = (x as usize).min(width - 1);
        let row = (y as usize).min(height.saturating_sub(2));
        let next = if column + 1 == width { 0 } else { column + 1 };
        let (s, t) = ((x - column as f64) as f32, (y - row as f64) as f32);
        let lerp = |a: Rgb, b: Rgb, t: f32| a * (1.0 - t) + b * t;
        let row_at = |y| lerp(Rgb::from(self.image.rgb(column, y)), Rgb::from(self.image.rgb(next, y)), s);
        lerp(row_at(row), row_at((row + 1).min(height - 1)), t) * self.scale
    }

    /// Samples a direction; `None` if the map is black, or is black in the direction.
    pub fn sample(&self, u: Vec2) -> Option<EnvMapSample> {
        self.sample_by(&self.distribution, u)
    }

    /// Samples a direction in proportion to the luminance in excess of its mean; `None` if there is none. [Karlík 2019,
    /// Eq. 14]
    pub fn sample_compensated(&self, u: Vec2) -> Option<EnvMapSample> {
        self.sample_by(&self.compensated, u)
    }

    fn sample_by(&self, distribution: &BilinearDistribution2D, u: Vec2) -> Option<EnvMapSample> {
        if self.scale == 0.0 {
            return None;
        }
        let ([turns, h], pdf_square) = distribution.sample(u)?;
        let (sin_theta, cos_theta) = (2.0 * (h * (1.0 - h)).max(0.0).sqrt(), 1.0 - 2.0 * h);
        let (sin_phi, cos_phi) = (TAU * (turns + 0.5 / self.image.width() as f64)).sin_cos();
        let d = DVec3::new(sin_phi * sin_theta, cos_theta, -cos_phi * sin_theta);
        let wi = (self.to_world * d.as_vec3()).normalize();
        let radiance = self.at(turns, sin_theta.atan2(cos_theta));
        Some(EnvMapSample { wi, radiance, pdf: pdf_square * SQUARE_TO_SPHERE })
    }

    /// Returns the density per unit solid angle with which [`sample`](Self::sample) samples a direction.
    pub fn pdf(&self, direction: Vec3) -> f32 {
        self.pdf_by(&self.distribution, direction)
    }

    /// Returns the density per unit solid angle with which [`sample_compensated`](Self::sample_compensated) samples a
    /// direction.
    pub fn pdf_compensated(&self, direction: Vec3) -> f32 {
        self.pdf_by(&self.compensated, direction)
    }

    fn pdf_by(&self, distribution: &BilinearDistribution2D, direction: Vec3) -> f32 {
        if self.scale == 0.0 {
            return 0.0;
        }
        let d = (self.to_world.transpose() * direction).as_dvec3();
        // The fraction of the sphere above d is sin² (θ/2), computed without cancellation.
        let (up, across) = (d.y, d.x * d.x + d.z * d.z);
        let length = (across + up * up).sqrt();
        let cap = 0.5 * across / (length * (length + up.abs()));
        let h = if up >= 0.0 { cap } else { 1.0 - cap };
        distribution.pdf([self.turns(d), h]) * SQUARE_TO_SPHERE
    }

    /// Computes [`sample`](Self::sample) in sixteen lanes, or [`sample_compensated`](Self::sample_compensated).
    /// Densities are 0 where there is no sample.
    pub fn sample_x16(&self, compensated: bool, u: [f32x16; 2]) -> EnvMapSampleX16 {
        let distribution = self.distribution_of(compensated);
        if self.scale == 0.0 || distribution.is_empty() {
            return EnvMapSampleX16 {
                wi: Vec3x16::splat(Vec3::Y),
                radiance: [f32x16::ZERO; 3],
                pdf: f32x16::ZERO,
            };
        }
        let (at, pdf) = distribution.sample_x16(u);
        let (width, rows) = (self.image.width() as f32, distribution.rows());
        let (mut cos_theta, mut sin_theta) = ([0.0; LANES], [0.0; LANES]);
        for (i, &band) in at.bands.iter().enumerate() {
            let h = rows[band] + f64::from(at.t.as_array()[i]) * (rows[band + 1] - rows[band]);
            cos_theta[i] = (1.0 - 2.0 * h) as f32;
            sin_theta[i] = 2.0 * ((h * (1.0 - h)) as f32).max(0.0).sqrt();
        }
        let (sin_theta, cos_theta) = (f32x16::new(sin_theta), f32x16::new(cos_theta));
        let column = f32x16::new(at.columns.map(|column| column as f32)) + at.s + f32x16::HALF;
        let column = column - (f32x16::splat(width) & column.simd_ge(f32x16::splat(width)));
        let (sin_phi, cos_phi) = sin_cos_turn_x16(column * f32x16::splat((TAU / f64::from(width)) as f32));
        let d = Vec3x16::new(sin_phi * sin_theta, cos_theta, -cos_phi * sin_theta);
        let wi = self.rotate(d).normalize_or_zero();
        let bands = f32x16::new(at.bands.map(|band| band as f32));
        let row = self.rows_from_pole(sin_theta, cos_theta) - bands;
        let row = row.fast_max(f32x16::ZERO).fast_min(f32x16::ONE);
        let radiance = self.radiance_x16(&PointsX16 { t: row, ..at });
        EnvMapSampleX16 { wi, radiance, pdf: pdf * f32x16::splat(SQUARE_TO_SPHERE) }
    }

    /// Computes [`eval`](Self::eval) in sixteen lanes, and [`pdf`](Self::pdf) or
    /// [`pdf_compensated`](Self::pdf_compensated).
    pub fn eval_x16(&self, direction: &Vec3x16, compensated: bool) -> ([f32x16; 3], f32x16) {
        let [x, y, z] =
            self.to_world.to_cols_array_2d().map(|axis| direction.dot(Vec3x16::splat(axis.into())));
        let across_squared = x * x + z * z;
        let across = across_squared.sqrt();
        // At the poles, any longitude will do.
        let z = across.simd_gt(f32x16::ZERO).select(z, f32x16::ONE);
        let (width, height) = (self.image.width(), self.image.height());
        let turns = with_sign(angle_x16(x.abs(), -z), x) * f32x16::splat(0.5 * FRAC_1_PI as f32)
            - f32x16::splat(0.5 / width as f32);
        let column = (turns - turns.floor()) * f32x16::splat(width as f32);
        let row = self.rows_from_pole(across, y);
        let cell = |v: f32x16, n: usize| v.to_array().map(|v| (v as usize).min(n));
        let (columns, bands) = (cell(column, width - 1), cell(row, height.saturating_sub(2)));
        let s = column - f32x16::new(columns.map(|column| column as f32));
        let from_band = row - f32x16::new(bands.map(|band| band as f32));
        let at = PointsX16 { bands, columns, s, t: from_band };
        let radiance = self.radiance_x16(&at);
        let distribution = self.distribution_of(compensated);
        if self.scale == 0.0 || distribution.is_empty() {
            return (radiance, f32x16::ZERO);
        }
        // The fraction of the sphere above or below d is sin² (θ/2), computed without cancellation.
        let length = (across_squared + y * y).sqrt();
        let cap = f32x16::HALF * across_squared / (length * (length + y.abs()));
        let (caps, up, rows) = (cap.as_array(), y.as_array(), distribution.rows());
        let t = each_lane(|i| {
            let h = if up[i] >= 0.0 { f64::from(caps[i]) } else { 1.0 - f64::from(caps[i]) };
            let (low, high) = (rows[bands[i]], rows[bands[i] + 1]);
            ((h - low) / (high - low)).clamp(0.0, 1.0) as f32
        });
        let pdf = distribution.pdf_x16(&PointsX16 { t: f32x16::new(t), ..at });
        (radiance, pdf * f32x16::splat(SQUARE_TO_SPHERE))
    }

    /// Returns the distance from the pole in rows of texels, given multiples of the sine and cosine of the angle.
    #[inline(always)]
    fn rows_from_pole(&self, sin: f32x16, cos: f32x16) -> f32x16 {
        angle_x16(sin, cos) * f32x16::splat(((self.image.height() - 1) as f64 / PI) as f32)
    }

    /// Returns the radiance at points between the texels.
    #[inline(always)]
    fn radiance_x16(&self, at: &PointsX16) -> [f32x16; 3] {
        let (width, last) = (self.image.width(), self.image.height() - 1);
        let next = at.columns.map(|column| if column + 1 == width { 0 } else { column + 1 });
        let rows = [at.bands, at.bands.map(|band| (band + 1).min(last))];
        let color = self.image.bilinear_x16(&[at.columns, next], &rows, [at.s, at.t]);
        color.map(|c| c * f32x16::splat(self.scale))
    }

    /// Returns directions in world space.
    #[inline(always)]
    fn rotate(&self, d: Vec3x16) -> Vec3x16 {
        let [x, y, z] = self.to_world.to_cols_array_2d().map(|axis| Vec3x16::splat(axis.into()));
        x * d.x + y * d.y + z * d.z
    }

    fn distribution_of(&self, compensated: bool) -> &BilinearDistribution2D {
        if compensated { &self.compensated } else { &self.distribution }
    }

    /// Returns the mean radiance over all directions.
    pub fn mean_radiance(&self) -> Rgb {
        self.mean
    }

    /// Returns the mean over all directions of the luminance in excess of its mean, W·m⁻²·sr⁻¹; 0 if it is so small a
    /// part of the mean luminance that the map counts as uniform.
    pub fn mean_excess(&self) -> f32 {
        self.mean_excess
    }

    /// Returns the power that enters a sphere of the given radius, W.
    pub fn power(&self, scene_radius: f32) -> Rgb {
        let pi = std::f32::consts::PI;
        self.mean * (4.0 * pi * pi * scene_radius * scene_radius)
    }

    /// Returns the bytes of the image and its distribution.
    pub fn memory_bytes(&self) -> usize {
        self.image.memory_bytes() + self.distribution.memory_bytes() + self.compensated.memory_bytes()
    }
}

/// The density per unit solid angle of a unit density over longitude in turns and fraction of the sphere: 1/4π.
const SQUARE_TO_SPHERE: f32 = 0.25 * std::f32::consts::FRAC_1_PI;

/// Returns the rotation or reflection in the transform of an emitter at infinity.
///
/// # Errors
/// If the transform has more than a uniform scale and a translation in addition.
pub fn rotation(to_world: &DAffine3) -> Result<DMat3> {
    let matrix = &to_world.matrix3;
    let scale = matrix.determinant().abs().cbrt();
    let rotation = *matrix * (1.0 / scale);
    let off = rotation.transpose() * rotation - DMat3::IDENTITY;
    let orthogonal = off.to_cols_array().iter().all(|v| v.abs() < ORTHOGONAL);
    if scale > 0.0 && scale.is_finite() && orthogonal {
        return Ok(rotation);
    }
    Err(Error::scene("expected a to_world transform that rotates, mirrors or scales evenly"))
}

/// Returns the luminance of a colour. Negative radiance has a positive luminance too.
fn luminance(color: [f32; 3]) -> f32 {
    Rgb::from(color).map(f32::abs).luminance()
}

/// Creates the distribution of a function of the colour over longitude and fraction of the sphere.
fn distribution(image: &TextureImage, weight: impl Fn([f32; 3]) -> f32) -> BilinearDistribution2D {
    let (width, height) = (image.width(), image.height());
    // The first column is repeated at the end.
    let row = |y: usize| -> Vec<f32> { (0..=width).map(|x| weight(image.rgb(x % width, y))).collect() };
    if height == 1 {
        return BilinearDistribution2D::new(width + 1, vec![0.0, 1.0], &[row(0), row(0)].concat());
    }
    let mut weights = Vec::with_capacity((width + 1) * height);
    for y in 0..height {
        let neighbour = match y {
            0 => 1,
            _ if y + 1 == height => height - 2,
            _ => {
                weights.extend(row(y));
                continue;
            }
        };
        // Near a pole, h grows as θ². With the other row fixed, this is the best approximation of a radiance linear
        // in θ among densities linear in h. It is positive if either row is.
        weights.extend(row(y).iter().zip(row(neighbour)).map(|(pole, other)| 0.7 * pole + 0.3 * other));
    }
    let bands = (height - 1) as f64;
    let above = |y: usize| if y + 1 == height { 1.0 } else { (0.5 * PI * y as f64 / bands).sin().powi(2) };
    BilinearDistribution2D::new(width + 1, (0..height).map(above).collect(), &weights)
}

/// Returns the mean over all directions of a function of an image's colour, interpolated between texels.
fn mean(image: &TextureImage, f: impl Fn([f32; 3]) -> [f32; 3]) -> Rgb {
    let (width, height) = (image.width(), image.height());
    let mut sum = [0.0f64; 3];
    for y in 0..height {
        let share = row_share(y, height) / width as f64;
        for x in 0..width {
            for (sum, value) in sum.iter_mut().zip(f(image.rgb(x, y))) {
                *sum += share * f64::from(value);
            }
        }
    }
    Rgb::from(sum.map(|s| s as f32))
}

/// Returns the fraction of the sphere that belongs to a row: half the integral of sin θ times the row's hat function.
fn row_share(y: usize, height: usize) -> f64 {
    if height == 1 {
        return 1.0;
    }
    let step = PI / (height - 1) as f64;
    let angle = step * y as f64;
    let integral = |low: f64, high: f64, rising: bool| {
        let slope = (high.sin() - low.sin()) / (high - low);
        if rising { slope - high.cos() } else { low.cos() - slope }
    };
    let above = if y == 0 { 0.0 } else { integral(angle - step, angle, true) };
    let below = if y + 1 == height { 0.0 } else { integral(angle, angle + step, false) };
    0.5 * (above + below)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sampling::hash::{combine, to_unit};

    /// Lanes compute what the scalar functions do, also at the poles, at the seam and in images of one row or column. A
    /// lane's position in a texel differs by rounding, so the tolerance grows with the number of texels.
    #[test]
    fn lanes_compute_what_scalars_do() {
        let mut seed = 0;
        let mut random = || {
            seed += 1;
            to_unit(combine(11, seed))
        };
        let turn = DAffine3::from_mat3(DMat3::from_rotation_x(0.7) * DMat3::from_rotation_z(2.0));
        let cases = [(37, 19, 3), (512, 256, 1), (1, 5, 3), (6, 1, 3), (2, 2, 1), (1, 1, 1)];
        for ((width, height, channels), turn) in
            cases.into_iter().flat_map(|case| [(case, turn), (case, DAffine3::IDENTITY)])
        {
            let mut values = vec![0.0; width * height * channels];
            for value in &mut values {
                *value =
                    if random() < 0.3 { 0.0 } else { random() + if random() < 0.01 { 50.0 } else { 0.0 } };
            }
            let image = TextureImage::from_floats(width, height, channels, values).expect("an image");
            let map = EnvMap::new(image, 1.5, &turn).expect("a map");
            let tolerance = 4e-6 * width.max(height) as f32;
            let close = |found: f32, expected: f32, largest: f32| {
                let error = (found - expected).abs();
                assert!(error <= tolerance * (largest + expected), "{width} {height}: {found} {expected}");
            };
            // A pole has any longitude.
            for pole in [Vec3::Y, -Vec3::Y].map(|pole| (turn.matrix3 * pole.as_dvec3()).as_vec3()) {
                let (radiance, pdf) = map.eval_x16(&Vec3x16::splat(pole), false);
                assert!((0.0..80.0).contains(&radiance[0].as_array()[1]) && pdf.as_array()[2] >= 0.0);
            }
            for round in 0..200 {
                let mut d = Vec3x16::default();
                for i in 0..LANES {
                    let axis =
                        if i % 4 < 2 { Vec3::X } else { Vec3::Z } * if i % 2 == 0 { 1.0 } else { -1.0 };
                    let random = Vec3::new(random() - 0.5, random() - 0.5, random() - 0.5);
                    // The seam of the longitude is at an axis.
                    let exact = round == 0 && turn == DAffine3::IDENTITY;
                    d.set_lane(i, if exact { axis } else { random.normalize_or(Vec3::X) });
                }
                let u = [(); 2].map(|()| f32x16::new([(); LANES].map(|()| random())));
                for compensated in [false, true] {
                    let (radiance, pdf) = map.eval_x16(&d, compensated);
                    let samples = map.sample_x16(compensated, u);
                    let (most, densest) = (80.0, 80.0 / map.mean.luminance().max(0.1));
                    let colors_are_close = |found: &[f32x16; 3], i: usize, expected: Rgb| {
                        for (found, expected) in found.iter().zip(expected.to_array()) {
                            close(found.as_array()[i], expected, most);
                        }
                    };
                    for i in 0..LANES {
                        let d = d.lane(i);
                        let alone = if compensated { map.pdf_compensated(d) } else { map.pdf(d) };
                        close(pdf.as_array()[i], alone, densest);
                        colors_are_close(&radiance, i, map.eval(d));
                        let u = Vec2::new(u[0].as_array()[i], u[1].as_array()[i]);
                        let alone = if compensated { map.sample_compensated(u) } else { map.sample(u) };
                        let found = samples.pdf.as_array()[i];
                        assert_eq!(found > 0.0, alone.is_some(), "{width} {height}");
                        let Some(alone) = alone else { continue };
                        // In dark texels, positions are rounded more.
                        let wi = samples.wi.lane(i);
                        assert!((wi - alone.wi).length() < 2e-4, "{width} {height}: {u}");
                        close(
                            found,
                            if compensated { map.pdf_compensated(wi) } else { map.pdf(wi) },
                            densest,
                        );
                        colors_are_close(&samples.radiance, i, map.eval(wi));
                    }
                }
            }
        }
        let black = TextureImage::from_floats(4, 2, 1, vec![0.0; 8]).expect("an image");
        let black = EnvMap::new(black, 1.0, &DAffine3::IDENTITY).expect("a map");
        assert_eq!(black.sample_x16(false, [f32x16::HALF; 2]).pdf, f32x16::ZERO);
        assert_eq!(black.eval_x16(&Vec3x16::splat(Vec3::Y), true), ([f32x16::ZERO; 3], f32x16::ZERO));
    }
}
