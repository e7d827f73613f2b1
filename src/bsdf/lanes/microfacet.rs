//! Distributions of microfacet normals in sixteen lanes. [Heitz 2014, 2018]

use crate::bsdf::microfacet::{Distribution, Microfacets};
use crate::math::functions::{erf_inverse_x16, erfc_x16, exp_x16, ln_x16};
use crate::math::{LANES, Vec3x16, f32x16};
use crate::sampling::warp::sin_cos_turn_x16;
use std::f32::consts::{FRAC_2_SQRT_PI, PI, TAU};

const FRAC_1_SQRT_PI: f32 = 0.5 * FRAC_2_SQRT_PI;

/// [`Microfacets`] of one family in each of sixteen lanes, with visible normals sampled.
pub struct MicrofacetsX16 {
    distribution: Distribution,
    alpha_x: f32x16,
    alpha_y: f32x16,
}

impl MicrofacetsX16 {
    /// Creates the distributions.
    #[inline(always)]
    pub fn gather(distribution: Distribution, microfacets: [&Microfacets; LANES]) -> Self {
        MicrofacetsX16 {
            distribution,
            alpha_x: f32x16::new(microfacets.map(|m| m.alpha_x)),
            alpha_y: f32x16::new(microfacets.map(|m| m.alpha_y)),
        }
    }

    /// Computes [`Microfacets::d`] in each lane.
    #[inline(always)]
    pub fn d(&self, m: &Vec3x16) -> f32x16 {
        let cos2 = m.z * m.z;
        let (x, y) = (m.x / self.alpha_x, m.y / self.alpha_y);
        let slope2 = x * x + y * y;
        let area = f32x16::splat(PI) * self.alpha_x * self.alpha_y;
        let d = match self.distribution {
            Distribution::Beckmann => {
                let exponent = slope2 / cos2;
                let exp = exp_x16(-exponent) & exponent.simd_lt(f32x16::splat(87.0));
                exp / (area * cos2 * cos2)
            }
            Distribution::Ggx => f32x16::ONE / (area * (slope2 + cos2) * (slope2 + cos2)),
        };
        d & (m.z.simd_gt(f32x16::ZERO) & d.is_finite())
    }

    /// Computes [`Microfacets::g1`] in each lane.
    #[inline(always)]
    pub fn g1(&self, w: &Vec3x16, m: &Vec3x16) -> f32x16 {
        let visible = (w.dot(*m) * w.z).simd_gt(f32x16::ZERO);
        (f32x16::ONE / (f32x16::ONE + self.lambda(w))) & visible
    }

    #[inline(always)]
    fn lambda(&self, w: &Vec3x16) -> f32x16 {
        let (x, y) = (w.x * self.alpha_x, w.y * self.alpha_y);
        let tan2_alpha2 = (x * x + y * y) / (w.z * w.z);
        match self.distribution {
            Distribution::Ggx => f32x16::HALF * ((f32x16::ONE + tan2_alpha2).sqrt() - f32x16::ONE),
            Distribution::Beckmann => {
                let a = f32x16::ONE / tan2_alpha2.sqrt();
                let exp = exp_x16(-a * a);
                let lambda = f32x16::HALF * (exp * f32x16::splat(FRAC_1_SQRT_PI) / a - erfc_x16(a, exp));
                // Beyond this, Λ is below 10⁻⁸.
                lambda.fast_max(f32x16::ZERO) & a.simd_lt(f32x16::splat(4.0))
            }
        }
    }

    /// Computes [`Microfacets::pdf`] in each lane; `wo` is above the surface.
    #[inline(always)]
    pub fn pdf(&self, wo: &Vec3x16, m: &Vec3x16) -> f32x16 {
        self.d(m) * self.g1(wo, m) * wo.dot(*m).fast_max(f32x16::ZERO) / wo.z
    }

    /// Computes [`Microfacets::sample`] in each lane; `wo` is above the surface.
    #[inline(always)]
    pub fn sample(&self, wo: &Vec3x16, u: [f32x16; 2]) -> Vec3x16 {
        let v = Vec3x16::new(wo.x * self.alpha_x, wo.y * self.alpha_y, wo.z).normalize_or_zero();
        let h = match self.distribution {
            Distribution::Ggx => sample_visible_ggx(&v, u),
            Distribution::Beckmann => sample_visible_beckmann(&v, u),
        };
        Vec3x16::new(h.x * self.alpha_x, h.y * self.alpha_y, h.z).normalize_or_zero()
    }
}

/// Samples visible normals of unit roughness by spherical caps. [Dupuy and Benyoub 2023, listing 3]
#[inline(always)]
fn sample_visible_ggx(v: &Vec3x16, u: [f32x16; 2]) -> Vec3x16 {
    let one = f32x16::ONE;
    let z = (one - u[1]) * (one + v.z) - v.z;
    let r = (one - z * z).fast_max(f32x16::ZERO).fast_min(one).sqrt();
    let (sin, cos) = sin_cos_turn_x16(f32x16::splat(TAU) * u[0]);
    let h = Vec3x16::new(r * cos, r * sin, z) + *v;
    Vec3x16::new(h.x, h.y, h.z.fast_max(f32x16::splat(1e-12)))
}

/// Samples visible normals of unit roughness by inversion of the distribution of slopes. [Heitz and d'Eon 2014,
/// supplemental 1]
#[inline(always)]
fn sample_visible_beckmann(v: &Vec3x16, u: [f32x16; 2]) -> Vec3x16 {
    let sin = (v.x * v.x + v.y * v.y).sqrt();
    let along = beckmann_slope_along_x16(v.z, sin, u[0]);
    let across = beckmann_slope_across_x16(u[1]);
    let inclined = sin.simd_gt(f32x16::ZERO);
    let (cos_phi, sin_phi) = (inclined.select(v.x / sin, f32x16::ONE), (v.y / sin) & inclined);
    let x = cos_phi * along - sin_phi * across;
    let y = sin_phi * along + cos_phi * across;
    Vec3x16::new(-x, -y, f32x16::ONE)
}

/// Computes the slope of `beckmann_slope_along` in each lane, with an error of its cumulative distribution below
/// 2·10⁻⁶. The variable of the Newton steps is the error function of the slope, in which the cumulative distribution is
/// almost linear. [Jakob 2014]
#[inline(always)]
fn beckmann_slope_along_x16(cos: f32x16, sin: f32x16, u: f32x16) -> f32x16 {
    let (one, k) = (f32x16::ONE, f32x16::splat(FRAC_1_SQRT_PI));
    let (u, _) = inside(u);
    let end = (cos / sin).fast_min(f32x16::splat(6.0));
    let exp = exp_x16(-end * end);
    let beyond = erfc_x16(end, exp);
    // F(x) = cosθ·(1 + x) + sinθ/√π·exp(−slope²) with x = erf(slope); `whole` is its value at the end.
    let whole = cos * (one + one - beyond) + sin * k * exp;
    let target = u * whole;
    let last = one - beyond;
    let least = f32x16::splat(-0.999_999_9);
    let r = (-ln_x16(u)).fast_max(f32x16::ZERO).sqrt();
    let mut x = last - (one + last) * (one - erfc_x16(r, u));
    let mut slope = f32x16::ZERO;
    for step in 0..5 {
        x = x.fast_max(least).fast_min(last.fast_min(-least));
        let product = (one - x) * (one + x);
        slope = erf_inverse_x16(x, -ln_x16(product));
        if step < 4 {
            let value = cos * (one + x) + sin * k * exp_x16(-slope * slope) - target;
            // The derivative is zero at the end, where a quotient would be rounding errors.
            x -= value / (cos - slope * sin).fast_max(f32x16::splat(1e-3));
        }
    }
    slope
}

/// Computes the slope of `beckmann_slope_across` in each lane.
#[inline(always)]
fn beckmann_slope_across_x16(u: f32x16) -> f32x16 {
    let (u, rest) = inside(u);
    erf_inverse_x16(u - rest, -ln_x16(f32x16::splat(4.0) * u * rest))
}

/// Moves uniform numbers strictly inside (0, 1), because the ends map to slopes of ±∞. Returns the numbers and their
/// differences from 1.
#[inline(always)]
fn inside(u: f32x16) -> (f32x16, f32x16) {
    const SHIFT: f32 = 1.490_116_1e-8; // 2⁻²⁶
    (u + f32x16::splat(SHIFT), (f32x16::ONE - u) - f32x16::splat(SHIFT))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The cumulative distribution of the slope is the uniform number, for all view directions.
    #[test]
    fn slopes_invert_their_distribution() {
        let half_sqrt_pi = 0.5 * std::f64::consts::PI.sqrt();
        let us = (0..1000).map(|i| i as f32 / 1000.0);
        let tails = (1..24).map(|i| 0.5f32.powi(i));
        let us: Vec<f32> = us.chain(tails.clone()).chain(tails.map(|u| 1.0 - u)).collect();
        for angle in (0..=300).map(|i| i as f32 * PI / 600.0).chain([1e-4, 0.499_97 * PI, 0.499_998 * PI]) {
            let (sin, cos) = (angle.sin(), angle.cos().max(1e-7));
            let (c, s) = (f64::from(cos), f64::from(sin));
            let primitive = |x: f64| c * half_sqrt_pi * (1.0 + libm::erf(x)) + 0.5 * s * (-x * x).exp();
            let whole = primitive(if s > 0.0 { (c / s).min(6.0) } else { 6.0 });
            for us in us.chunks(LANES) {
                let u: [f32; LANES] = std::array::from_fn(|i| us[i.min(us.len() - 1)]);
                let slopes = beckmann_slope_along_x16(f32x16::splat(cos), f32x16::splat(sin), f32x16::new(u));
                for (slope, u) in slopes.as_array().iter().zip(u) {
                    let found = primitive(f64::from(*slope)) / whole;
                    assert!((found - f64::from(u)).abs() < 2e-6, "{angle} {u}: {slope} gives {found}");
                }
            }
        }
    }
}
