//! Scattering by a hair. [Chiang 2016]

use super::{BsdfEval, BsdfSample, Lobe, fresnel};
use crate::color::Rgb;
use crate::math::{Vec2, Vec3};
use std::f32::consts::{FRAC_1_PI, PI, TAU};

/// The number of lobes. The last one is the sum of all paths with more than one reflection inside.
const LOBES: usize = 4;

/// A dielectric fibre with an absorbing interior and tilted scales. The local frame has its x axis around the fibre and
/// its y axis along it, from root to tip.
///
/// A lobe is a number p of passages through the interior: p = 0 reflects, p = 1 passes through, p = 2 is reflected once
/// inside. The light leaves at the point where it came in, on any side.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hair {
    /// Absorption per radius of the fibre.
    pub sigma_a: Rgb,
    /// Index of refraction relative to that outside.
    pub eta: f32,
    /// Shape of the lobes.
    pub fibre: Fibre,
}

/// The shape of the lobes of a [`Hair`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fibre {
    /// Variances of the angle along the fibre of the first three lobes; the last lobe is as wide as the third.
    variances: [f32; 3],
    /// The scale of the logistic distribution of the angle around the fibre.
    scale: f32,
    /// Sine and cosine of the angle by which scales turn each of the first three lobes along the fibre.
    tilts: [[f32; 2]; 3],
}

impl Fibre {
    /// Converts roughnesses along and around the fibre in (0, 1], and the tilt of the scales in radians. [Chiang 2016,
    /// Eq. 7 and 8]
    pub fn new([along, around]: [f32; 2], tilt: f32) -> Self {
        let deviation = 0.726 * along + 0.812 * along * along + 3.7 * along.powi(20);
        let first = deviation * deviation;
        let scale = 0.265 * around + 1.194 * around * around + 5.372 * around.powi(22);
        Fibre {
            variances: [first, 0.25 * first, 4.0 * first],
            scale: (PI / 8.0).sqrt() * scale,
            tilts: [-2.0 * tilt, tilt, 4.0 * tilt].map(|angle| angle.sin_cos().into()),
        }
    }

    fn variance(&self, p: usize) -> f32 {
        self.variances[p.min(2)]
    }
}

/// A direction in the coordinates of the fibre.
#[derive(Clone, Copy, Debug)]
struct Direction {
    /// Sine and cosine of the angle to the plane across the fibre.
    theta: [f32; 2],
    /// The angle around the fibre.
    phi: f32,
}

impl Direction {
    fn of(w: Vec3) -> Self {
        Direction { theta: [w.y, w.x.hypot(w.z)], phi: w.z.atan2(w.x) }
    }
}

/// What the lobes need to know of the given direction.
struct Lobes {
    wo: Direction,
    /// The fraction of the light in each lobe.
    shares: [Rgb; LOBES],
    /// The probability of sampling each lobe.
    probabilities: [f32; LOBES],
    /// The change of the angle around the fibre by each of the first three lobes without roughness.
    turns: [f32; LOBES - 1],
}

impl Hair {
    /// Computes the lobes for the direction `wo`. [Chiang 2016, Eq. 13 to 15]
    fn lobes(&self, wo: Vec3) -> Lobes {
        let direction = Direction::of(wo);
        let [sin, cos] = direction.theta;
        // The offset of the ray from the fibre's axis in radii, and the angles to the normal outside and inside.
        let offset = if cos > 0.0 { -wo.x / cos } else { 0.0 };
        let gamma = if cos > 0.0 { (-wo.x).atan2(wo.z) } else { 0.0 };
        let sin_t = sin / self.eta;
        let cos_t = (1.0 - sin_t * sin_t).max(0.0).sqrt();
        let modified = (self.eta * self.eta - sin * sin).max(0.0).sqrt();
        let sin_gamma_t = (offset * cos / modified).clamp(-1.0, 1.0);
        let cos_gamma_t = (1.0 - sin_gamma_t * sin_gamma_t).sqrt();

        let length = 2.0 * cos_gamma_t / cos_t.max(f32::MIN_POSITIVE);
        let passed = Rgb::from([0, 1, 2].map(|c| (-self.sigma_a[c] * length).exp()));
        let across = cos * (1.0 - offset * offset).max(0.0).sqrt();
        let reflected = fresnel::dielectric(across, self.eta).reflectance;
        let once = passed * ((1.0 - reflected) * (1.0 - reflected));
        let twice = once * passed * reflected;
        let more = Rgb::from([0, 1, 2].map(|c| {
            let again = passed[c] * reflected;
            if again < 1.0 { twice[c] * again / (1.0 - again) } else { 0.0 }
        }));
        let shares = [Rgb::splat(reflected), once, twice, more];
        let luminances = shares.map(Rgb::luminance);
        let sum: f32 = luminances.iter().sum();
        let gamma_t = sin_gamma_t.asin();
        Lobes {
            wo: direction,
            shares,
            probabilities: luminances.map(|l| l / sum),
            turns: [0.0, 1.0, 2.0].map(|p| 2.0 * p * gamma_t - 2.0 * gamma + p * PI),
        }
    }

    /// Returns the sine and cosine of the angle along the fibre of `wo` as the scales of lobe `p` turn it.
    fn tilted(&self, [sin, cos]: [f32; 2], p: usize) -> [f32; 2] {
        let Some([sin_tilt, cos_tilt]) = self.fibre.tilts.get(p) else { return [sin, cos] };
        [sin * cos_tilt + cos * sin_tilt, (cos * cos_tilt - sin * sin_tilt).abs()]
    }

    /// Evaluates all lobes.
    pub fn eval(&self, wo: Vec3, wi: Vec3) -> BsdfEval {
        self.eval_lobes(&self.lobes(wo), wi)
    }

    fn eval_lobes(&self, lobes: &Lobes, wi: Vec3) -> BsdfEval {
        let wi_direction = Direction::of(wi);
        let (mut value, mut pdf) = (Rgb::BLACK, 0.0);
        for p in 0..LOBES {
            let theta = self.tilted(lobes.wo.theta, p);
            let along = along_fibre(theta, wi_direction.theta, self.fibre.variance(p));
            let around = match lobes.turns.get(p) {
                Some(turn) => around_fibre(wi_direction.phi - lobes.wo.phi - turn, self.fibre.scale),
                None => 0.5 * FRAC_1_PI,
            };
            value += lobes.shares[p] * (along * around);
            pdf += lobes.probabilities[p] * (along * around);
        }
        // The lobes include the cosine of `wi`.
        BsdfEval { f: value / wi.z.abs().max(LEAST_COSINE), pdf }
    }

    /// Samples a lobe, weighted by the sum of all. [Chiang 2016, Sec. 4.3; d'Eon 2013]
    pub fn sample(&self, wo: Vec3, u_lobe: f32, u: Vec2) -> Option<BsdfSample> {
        let lobes = self.lobes(wo);
        let (mut p, mut rest) = (0, u_lobe);
        while p + 1 < LOBES && rest >= lobes.probabilities[p] {
            rest -= lobes.probabilities[p];
            p += 1;
        }
        let u_around = (rest / lobes.probabilities[p]).clamp(0.0, 1f32.next_down());
        let [sin_tilted, cos_tilted] = self.tilted(lobes.wo.theta, p);
        let v = self.fibre.variance(p);
        // One minus the cosine of the angle to the cone of reflection.
        let versine = (-v * (u.x + (1.0 - u.x) * (-2.0 / v).exp()).ln()).clamp(0.0, 2.0);
        let (cos, sin) = (1.0 - versine, (versine * (2.0 - versine)).sqrt());
        let sin_i = (-cos * sin_tilted + sin * (TAU * u.y).cos() * cos_tilted).clamp(-1.0, 1.0);
        let cos_i = ((1.0 - sin_i) * (1.0 + sin_i)).sqrt();
        let turn = match lobes.turns.get(p) {
            Some(turn) => turn + sample_around(u_around, self.fibre.scale),
            None => TAU * u_around,
        };
        let (sin_phi, cos_phi) = (lobes.wo.phi + turn).sin_cos();
        let wi = Vec3::new(cos_i * cos_phi, sin_i, cos_i * sin_phi).normalize();
        let BsdfEval { f, pdf } = self.eval_lobes(&lobes, wi);
        let weight = f * (wi.z.abs() / pdf);
        (pdf > 0.0 && weight.is_valid()).then_some(BsdfSample {
            wi,
            weight,
            pdf,
            lobe: Lobe::Glossy,
            eta: 1.0,
        })
    }

    /// Returns the sum of the lobes for a ray along the normal.
    pub fn albedo(&self) -> Rgb {
        self.lobes(Vec3::Z).shares.into_iter().fold(Rgb::BLACK, |sum, share| sum + share)
    }
}

/// The least cosine by which the lobes are divided, so that their product with the cosine is finite.
const LEAST_COSINE: f32 = 1e-30;

/// Returns the density of the angle along the fibre, per unit sine. [d'Eon 2011, Eq. 7]
///
/// The formula of the paper is `exp(−s)·I₀(c) / (2v·sinh(1/v))` with `c = cosθₒ·cosθᵢ/v` and `s = sinθₒ·sinθᵢ/v`. Here
/// the exponents are joined, so that none overflows.
fn along_fibre([sin_o, cos_o]: [f32; 2], [sin_i, cos_i]: [f32; 2], v: f32) -> f32 {
    // One minus the cosine of the sum of both angles.
    let versine = 0.5 * ((cos_o - cos_i).powi(2) + (sin_o + sin_i).powi(2));
    (-versine / v).exp() * scaled_bessel_i0(cos_o * cos_i / v) / (-v * (-2.0 / v).exp_m1())
}

/// Computes `exp(−x)·I₀(x)` for `x ≥ 0` with a relative error below 3·10⁻⁷. [Abramowitz and Stegun 1964, 9.8.1 and
/// 9.8.2]
fn scaled_bessel_i0(x: f32) -> f32 {
    let polynomial = |coefficients: &[f32], t: f32| coefficients.iter().rev().fold(0.0, |sum, c| sum * t + c);
    if x < 3.75 {
        let t = (x / 3.75).powi(2);
        (-x).exp()
            * polynomial(
                &[1.0, 3.515_622_9, 3.089_942_4, 1.206_749_2, 0.265_973_2, 0.036_076_8, 0.004_581_3],
                t,
            )
    } else {
        let coefficients = [
            0.398_942_3,
            0.013_285_92,
            0.002_253_19,
            -0.001_575_65,
            0.009_162_81,
            -0.020_577_06,
            0.026_355_37,
            -0.016_476_33,
            0.003_923_77,
        ];
        polynomial(&coefficients, 3.75 / x) / x.sqrt()
    }
}

/// Returns the density of an angle around the fibre: a logistic distribution, cut off at ±π. [Chiang 2016, Eq. 9]
fn around_fibre(angle: f32, scale: f32) -> f32 {
    let angle = angle - TAU * (angle / TAU).round();
    let e = (-angle.abs() / scale).exp();
    e / (scale * (1.0 + e) * (1.0 + e) * (PI / (2.0 * scale)).tanh())
}

/// Samples [`around_fibre`] by inversion.
fn sample_around(u: f32, scale: f32) -> f32 {
    let x = 0.5 + (u - 0.5) * (PI / (2.0 * scale)).tanh();
    let odds = x / (1.0 - x).max(f32::MIN_POSITIVE);
    (scale * odds.max(f32::MIN_POSITIVE).ln()).clamp(-PI, PI)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_bessel_function_is_that_of_the_tables() {
        for (x, value) in [(0.0, 1.0), (1.0, 0.465_759_6), (3.75, 0.214_457_05), (10.0, 0.127_833_34)] {
            assert!((scaled_bessel_i0(x) / value - 1.0).abs() < 1e-6, "{x}: {}", scaled_bessel_i0(x));
        }
    }

    /// Both distributions have the integral 1.
    #[test]
    fn angles_are_normalised() {
        for roughness in [0.02, 0.3, 1.0] {
            let fibre = Fibre::new([roughness; 2], 0.0);
            let midpoints = (0..20_000).map(|i| (i as f32 + 0.5) / 20_000.0);
            let around: f64 =
                midpoints.clone().map(|x| f64::from(around_fibre(TAU * (x - 0.5), fibre.scale) * TAU)).sum();
            assert!((around / 2e4 - 1.0).abs() < 1e-4, "{roughness}: {around}");
            for p in 0..LOBES {
                for angle in [-1.4f32, 0.0, 0.7] {
                    let along = |x: f32| {
                        let theta = PI * (x - 0.5);
                        let wi = theta.sin_cos().into();
                        f64::from(
                            along_fibre(angle.sin_cos().into(), wi, fibre.variance(p)) * theta.cos() * PI,
                        )
                    };
                    let sum: f64 = midpoints.clone().map(along).sum();
                    assert!((sum / 2e4 - 1.0).abs() < 1e-4, "{roughness} {p} {angle}: {sum}");
                }
            }
        }
    }
}
