//! Phase functions: the distribution of directions of light that is scattered in a medium.

use crate::math::{Frame, Vec2, Vec3};
use crate::sampling::warp;
use std::f32::consts::TAU;
use std::f64::consts::PI;

/// A phase function. It depends on the angle between the directions of propagation before and after the scattering
/// only, and integrates to 1 over the sphere.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub enum Phase {
    /// The same density in all directions.
    Isotropic,
    /// The function of [Henyey and Greenstein 1941].
    HenyeyGreenstein {
        /// The mean cosine of the angle of deflection, in (−1, 1). Forward scattering is positive.
        g: f32,
    },
}

impl Phase {
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
        }
    }

    /// Samples the direction of propagation after scattering; `d` is the unit direction before it.
    pub fn sample(&self, d: Vec3, u: Vec2) -> Vec3 {
        match self {
            Phase::Isotropic => warp::square_to_sphere(u),
            Phase::HenyeyGreenstein { g } => {
                let cos = henyey_greenstein_cosine(f64::from(*g), f64::from(u.x));
                let sin = ((1.0 - cos) * (1.0 + cos)).max(0.0).sqrt() as f32;
                let (sin_phi, cos_phi) = (TAU * u.y).sin_cos();
                let local = Vec3::new(sin * cos_phi, sin * sin_phi, cos as f32);
                Frame::from_normal(d).to_world(local).normalize()
            }
        }
    }
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
    fn without_asymmetry_scattering_is_isotropic() {
        for cos in [-1.0, -0.2, 0.7, 1.0] {
            let (a, b) = (Phase::Isotropic.eval(cos), Phase::HenyeyGreenstein { g: 0.0 }.eval(cos));
            assert!((a / b - 1.0).abs() < 1e-6, "{a} {b}");
        }
    }
}
