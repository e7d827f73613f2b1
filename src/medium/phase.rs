//! Phase functions: the distribution of directions of light that is scattered in a medium.

use crate::error::{Error, Result};
use crate::math::{Frame, Vec2, Vec3};
use crate::sampling::warp;
use std::f32::consts::TAU;
use std::f64::consts::PI;

/// A phase function. It depends on the angle between the directions of propagation before and after the scattering
/// only, and integrates to 1 over the sphere.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub enum Phase {
    /// The same density in all directions.
    Isotropic,
    /// The function of [Henyey and Greenstein 1941].
    HenyeyGreenstein {
        /// The mean cosine of the angle of deflection, in (−1, 1). Forward scattering is positive.
        g: f32,
    },
    /// Scattering by particles much smaller than the wavelength, `3 (1 + cos²) / 16π`. [Rayleigh 1871]
    Rayleigh,
    /// Piecewise linear in the cosine.
    Tabulated(Tabulated),
    /// The sum of two functions, of which the second has the weight `weight` in [0, 1] and the first the rest.
    Blend {
        /// The weight of the second function.
        weight: f32,
        /// The functions.
        phases: Box<[Phase; 2]>,
    },
}

/// A density of the cosine of deflection that is linear between equidistant cosines from −1 to 1.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Tabulated {
    /// The densities at the cosines, which integrate to 1.
    densities: Vec<f64>,
    /// The integrals from −1 to each cosine.
    sums: Vec<f64>,
}

impl Tabulated {
    /// Creates the density from values in proportion to it.
    ///
    /// # Errors
    /// If there are fewer than two values, if one is negative or not finite, or if all are zero.
    pub fn new(values: &[f64]) -> Result<Self> {
        let step = 2.0 / (values.len().max(2) - 1) as f64;
        let integral: f64 = values.windows(2).map(|pair| 0.5 * (pair[0] + pair[1]) * step).sum();
        if !(values.iter().all(|v| *v >= 0.0) && integral > 0.0 && integral.is_finite()) {
            return Err(Error::scene(
                "expected at least two numbers that are not negative, not all of them 0",
            ));
        }
        let densities: Vec<f64> = values.iter().map(|v| v / integral).collect();
        let mut sums = vec![0.0];
        for pair in densities.windows(2) {
            sums.push(sums[sums.len() - 1] + 0.5 * (pair[0] + pair[1]) * step);
        }
        Ok(Tabulated { densities, sums })
    }

    fn step(&self) -> f64 {
        2.0 / (self.densities.len() - 1) as f64
    }

    fn eval(&self, cos: f64) -> f64 {
        let x = ((cos.clamp(-1.0, 1.0) + 1.0) / self.step()).min((self.densities.len() - 1) as f64);
        let i = (x as usize).min(self.densities.len() - 2);
        let t = x - i as f64;
        self.densities[i] * (1.0 - t) + self.densities[i + 1] * t
    }

    /// Returns the cosine at which the cumulative distribution is `u`.
    fn invert(&self, u: f64) -> f64 {
        let target = u * self.sums[self.sums.len() - 1];
        let above = self.sums.partition_point(|sum| *sum <= target);
        let i = above.clamp(1, self.sums.len() - 1) - 1;
        let (a, b, step) = (self.densities[i], self.densities[i + 1], self.step());
        // The part t of the interval satisfies a t + (b − a) t² / 2 = rest.
        let rest = (target - self.sums[i]) / step;
        let root = (a * a + 2.0 * (b - a) * rest).max(0.0).sqrt();
        let t = if a + root > 0.0 { 2.0 * rest / (a + root) } else { 0.0 };
        -1.0 + (i as f64 + t.min(1.0)) * step
    }
}

impl Phase {
    /// Returns the mean cosine of the angle of deflection if the function is that of Henyey and Greenstein, of which
    /// isotropic scattering is a case.
    pub fn asymmetry(&self) -> Option<f32> {
        match self {
            Phase::Isotropic => Some(0.0),
            Phase::HenyeyGreenstein { g } => Some(*g),
            Phase::Rayleigh | Phase::Tabulated(_) | Phase::Blend { .. } => None,
        }
    }

    /// Returns the value for the cosine `cos` of the angle of deflection, sr⁻¹. It is also the density per unit solid
    /// angle of [`sample`](Self::sample).
    pub fn eval(&self, cos: f32) -> f32 {
        match self {
            Phase::Isotropic => warp::SQUARE_TO_SPHERE_PDF,
            Phase::HenyeyGreenstein { g } => {
                let (g, cos) = (f64::from(*g), f64::from(cos));
                // [Henyey and Greenstein 1941, Eq. 2], normalised. The sum of squares is 1 + g² − 2g·cos.
                let denominator = (1.0 - g) * (1.0 - g) + 2.0 * g * (1.0 - cos);
                ((1.0 - g * g) / (4.0 * PI * denominator * denominator.sqrt())) as f32
            }
            Phase::Rayleigh => 3.0 / (8.0 * TAU) * (1.0 + cos * cos),
            Phase::Tabulated(table) => table.eval(cos.into()) as f32 / TAU,
            Phase::Blend { weight, phases } => {
                phases[0].eval(cos) * (1.0 - weight) + phases[1].eval(cos) * weight
            }
        }
    }

    /// Samples the direction of propagation after scattering; `d` is the unit direction before it.
    pub fn sample(&self, d: Vec3, u: Vec2) -> Vec3 {
        match self {
            Phase::Isotropic => warp::square_to_sphere(u),
            Phase::HenyeyGreenstein { g } => {
                deflected(d, henyey_greenstein_cosine(f64::from(*g), f64::from(u.x)), u.y)
            }
            Phase::Rayleigh => deflected(d, rayleigh_cosine(f64::from(u.x)), u.y),
            Phase::Tabulated(table) => deflected(d, table.invert(f64::from(u.x)), u.y),
            Phase::Blend { weight, phases } => {
                let second = u.x < *weight;
                let (phase, x) = match second {
                    true => (&phases[1], u.x / weight),
                    false => (&phases[0], (u.x - weight) / (1.0 - weight)),
                };
                phase.sample(d, Vec2::new(x.min(1f32.next_down()), u.y))
            }
        }
    }
}

/// Returns the unit direction `d` after a deflection with the cosine `cos`; `u` selects the azimuth.
fn deflected(d: Vec3, cos: f64, u: f32) -> Vec3 {
    let sin = ((1.0 - cos) * (1.0 + cos)).max(0.0).sqrt() as f32;
    let (sin_phi, cos_phi) = (TAU * u).sin_cos();
    Frame::from_normal(d).to_world(Vec3::new(sin * cos_phi, sin * sin_phi, cos as f32)).normalize()
}

/// Returns the cosine at which the cumulative distribution of Rayleigh's function, (4 + 3c + c³)/8, is `u`: the real
/// root of the cubic. [Frisvad 2011, Eq. 7]
fn rayleigh_cosine(u: f64) -> f64 {
    let half = 4.0 * u - 2.0;
    let root = (half + half.signum() * (half * half + 1.0).sqrt()).cbrt();
    (root - 1.0 / root).clamp(-1.0, 1.0)
}

/// Returns the cosine of the angle of deflection at which the cumulative distribution of Henyey and Greenstein's
/// function is `u`. The usual form, (1 + g² − ((1 − g²)/(1 + gv))²)/(2g) with v = 2u − 1, is expanded, so that `g` may
/// be 0.
fn henyey_greenstein_cosine(g: f64, u: f64) -> f64 {
    let v = 2.0 * u - 1.0;
    let numerator = 2.0 * v + g * (v * v + 3.0) + g * g * (2.0 * v) + g * g * g * (v * v - 1.0);
    let root = 1.0 + g * v;
    (numerator / (2.0 * root * root)).clamp(-1.0, 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The cumulative distribution of the sampled cosine is the random number.
    #[test]
    fn cosines_invert_the_distribution() {
        for g in [-0.999f64, -0.5, -1e-9, 0.0, 1e-12, 1e-5, 0.3, 0.9, 0.999] {
            for (u, end) in [(0.0, -1.0), (1.0, 1.0)] {
                assert!((henyey_greenstein_cosine(g, u) - end).abs() < 1e-8, "{g}");
            }
            for u in [0.001f64, 0.25, 0.5, 0.9, 0.999] {
                let cos = henyey_greenstein_cosine(g, u);
                // The integral of the function from -1 to the cosine, where it is well conditioned.
                let below = if g.abs() < 1e-4 {
                    0.5 * (1.0 + cos) + 0.75 * g * (cos * cos - 1.0)
                } else {
                    let s = (1.0 + g * g - 2.0 * g * cos).sqrt();
                    (1.0 - g * g) / (2.0 * g) * (1.0 / s - 1.0 / (1.0 + g))
                };
                assert!((below - u).abs() < 1e-8, "g {g}, u {u}: {cos}, {below}");
            }
        }
    }

    #[test]
    fn other_cosines_invert_their_distributions() {
        for u in [0.0f64, 1e-9, 0.1, 0.5, 0.77, 1.0] {
            let c = rayleigh_cosine(u);
            assert!(((4.0 + 3.0 * c + c * c * c) / 8.0 - u).abs() < 1e-9, "{u}: {c}");
        }
        let table = Tabulated::new(&[0.0, 2.0, 2.0, 0.0, 1.0]).unwrap();
        for u in [0.0f64, 0.05, 0.3, 0.5, 0.8, 0.93, 1.0] {
            let c = table.invert(u);
            // The integral up to the cosine, by the midpoint rule.
            const N: usize = 20_000;
            let h = (c + 1.0) / N as f64;
            let below: f64 = (0..N).map(|i| table.eval(-1.0 + (i as f64 + 0.5) * h) * h).sum();
            assert!((below - u).abs() < 1e-6, "{u}: {c}, {below}");
        }
        assert!(Tabulated::new(&[1.0]).is_err());
        assert!(Tabulated::new(&[0.0, 0.0]).is_err());
        assert!(Tabulated::new(&[1.0, -1.0]).is_err());
    }

    #[test]
    fn without_asymmetry_scattering_is_isotropic() {
        for cos in [-1.0, -0.2, 0.7, 1.0] {
            let (a, b) = (Phase::Isotropic.eval(cos), Phase::HenyeyGreenstein { g: 0.0 }.eval(cos));
            assert!((a / b - 1.0).abs() < 1e-6, "{a} {b}");
        }
    }
}
