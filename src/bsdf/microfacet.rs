//! Distributions of microfacet normals. [Walter 2007; Heitz 2014, 2018]

use super::lanes::LaneBsdfs;
use crate::math::functions::{angle_x16, erf_inverse_x16, erfc_x16, exp_x16, ln_x16};
use crate::math::{Vec2, Vec3, Vec3x16, f32x16};
use crate::sampling::warp::sin_cos_turn_x16;
use std::f32::consts::{PI, TAU};

/// A family of distributions of microfacet normals.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, serde::Serialize)]
pub enum Distribution {
    /// Beckmann: Gaussian slopes.
    Beckmann,
    /// Trowbridge-Reitz (GGX): longer tails.
    Ggx,
}

/// A distribution of microfacet normals with its roughness.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Microfacets {
    /// The family.
    pub distribution: Distribution,
    /// Roughness along x.
    pub alpha_x: f32,
    /// Roughness along y.
    pub alpha_y: f32,
    /// Whether [`sample`](Self::sample) samples visible normals; otherwise all normals.
    pub sample_visible: bool,
}

impl Microfacets {
    /// Returns whether the roughness depends on the direction.
    pub fn is_anisotropic(&self) -> bool {
        self.alpha_x != self.alpha_y
    }

    /// Returns the density D(m) of normals per unit solid angle and unit area of the surface. [Walter 2007, Eq. 25,
    /// 33]
    #[inline]
    pub fn d(&self, m: Vec3) -> f32 {
        if m.z <= 0.0 {
            return 0.0;
        }
        let cos2 = m.z * m.z;
        let slope2 = (m.x / self.alpha_x).powi(2) + (m.y / self.alpha_y).powi(2);
        let area = PI * self.alpha_x * self.alpha_y;
        let d = match self.distribution {
            Distribution::Beckmann => (-slope2 / cos2).exp() / (area * cos2 * cos2),
            Distribution::Ggx => 1.0 / (area * (slope2 + cos2) * (slope2 + cos2)),
        };
        if d.is_finite() { d } else { 0.0 }
    }

    /// Returns Smith's masking function: the fraction of facets visible from `w`; zero if `w` is on different sides
    /// of the facet `m` and the surface. [Heitz 2014, Eq. 43]
    #[inline]
    pub fn g1(&self, w: Vec3, m: Vec3) -> f32 {
        if w.dot(m) * w.z <= 0.0 {
            return 0.0;
        }
        1.0 / (1.0 + self.lambda(w))
    }

    /// Returns Smith's Λ. [Heitz 2014, Eq. 53 and 68]
    fn lambda(&self, w: Vec3) -> f32 {
        let tan2_alpha2 = ((w.x * self.alpha_x).powi(2) + (w.y * self.alpha_y).powi(2)) / (w.z * w.z);
        if tan2_alpha2 == 0.0 {
            return 0.0;
        }
        match self.distribution {
            Distribution::Ggx => 0.5 * ((1.0 + tan2_alpha2).sqrt() - 1.0),
            Distribution::Beckmann => {
                let a = 1.0 / tan2_alpha2.sqrt();
                let tail = (-a * a).exp();
                (0.5 * (tail * FRAC_1_SQRT_PI / a - libm::erfcf(a))).max(0.0)
            }
        }
    }

    /// Samples a facet normal for the view direction `wo` above the surface.
    #[inline]
    pub fn sample(&self, wo: Vec3, u: Vec2) -> Vec3 {
        if !self.sample_visible {
            return self.sample_all(u);
        }
        match self.distribution {
            Distribution::Ggx => self.sample_visible_ggx(wo, u),
            Distribution::Beckmann => self.sample_visible_beckmann(wo, u),
        }
    }

    /// Returns the density of [`sample`](Self::sample) per unit solid angle of m.
    #[inline]
    pub fn pdf(&self, wo: Vec3, m: Vec3) -> f32 {
        if self.sample_visible {
            // [Heitz 2014, Eq. 16]
            if wo.z <= 0.0 {
                return 0.0;
            }
            self.d(m) * self.g1(wo, m) * wo.dot(m).max(0.0) / wo.z
        } else {
            self.d(m) * m.z
        }
    }

    /// Samples all normals in proportion to D(m)·cosθ. [Walter 2007, Eq. 28, 35]
    fn sample_all(&self, u: Vec2) -> Vec3 {
        let tan2 = match self.distribution {
            Distribution::Beckmann => -(1.0 - u.x).ln(),
            Distribution::Ggx => u.x / (1.0 - u.x),
        };
        let (sin, cos) = (2.0 * PI * u.y).sin_cos();
        let r = tan2.sqrt();
        Vec3::new(self.alpha_x * r * cos, self.alpha_y * r * sin, 1.0).normalize()
    }

    /// Samples visible normals by spherical caps. [Dupuy and Benyoub 2023, listing 3]
    fn sample_visible_ggx(&self, wo: Vec3, u: Vec2) -> Vec3 {
        let v = Vec3::new(wo.x * self.alpha_x, wo.y * self.alpha_y, wo.z).normalize();
        let z = (1.0 - u.y) * (1.0 + v.z) - v.z;
        let r = (1.0 - z * z).clamp(0.0, 1.0).sqrt();
        let (sin, cos) = (2.0 * PI * u.x).sin_cos();
        let h = Vec3::new(r * cos, r * sin, z) + v;
        Vec3::new(h.x * self.alpha_x, h.y * self.alpha_y, h.z.max(1e-12)).normalize()
    }

    /// Samples visible normals by inversion of the distribution of slopes. [Heitz and d'Eon 2014, supplemental 1]
    fn sample_visible_beckmann(&self, wo: Vec3, u: Vec2) -> Vec3 {
        let v = Vec3::new(wo.x * self.alpha_x, wo.y * self.alpha_y, wo.z).normalize();
        let sin = (v.x * v.x + v.y * v.y).sqrt();
        let (slope_x, slope_y) = (beckmann_slope_along(v.z, sin, u.x), beckmann_slope_across(u.y));
        let (cos_phi, sin_phi) = if sin > 0.0 { (v.x / sin, v.y / sin) } else { (1.0, 0.0) };
        let x = cos_phi * slope_x - sin_phi * slope_y;
        let y = sin_phi * slope_x + cos_phi * slope_y;
        Vec3::new(-x * self.alpha_x, -y * self.alpha_y, 1.0).normalize()
    }
}

const FRAC_1_SQRT_PI: f32 = 0.564_189_6;

/// Samples the slope, along the azimuth 0, of a visible facet with unit roughness. The view direction has the azimuth
/// 0 and a polar angle with the given `cos` and `sin`. The perpendicular slope is independent of it:
/// [`beckmann_slope_across`].
///
/// The marginal density is `∝ (cosθ − sinθ·x)·exp(−x²)` for `x < cotθ`. Its cumulative distribution is inverted by
/// Newton steps guarded by bisection, in `f64`, to full `f32` precision.
pub(super) fn beckmann_slope_along(cos: f32, sin: f32, u: f32) -> f32 {
    let (cos, sin) = (f64::from(cos), f64::from(sin));
    let u = inside(u);
    // ∫ (c − s x) e^{−x²} dx = c √π/2 erf(x) + s/2 e^{−x²}
    let half_sqrt_pi = 0.5 * std::f64::consts::PI.sqrt();
    let primitive = |x: f64| cos * half_sqrt_pi * (1.0 + libm::erf(x)) + 0.5 * sin * (-x * x).exp();
    let end = if sin > 0.0 { (cos / sin).min(6.0) } else { 6.0 };
    let (mut low, mut high) = (-6.0f64, end);
    let target = u * primitive(end);
    let mut x = (low + high) * 0.5;
    for _ in 0..40 {
        let f = primitive(x) - target;
        if f > 0.0 {
            high = x
        } else {
            low = x
        }
        let derivative = (cos - sin * x).max(0.0) * (-x * x).exp();
        let newton = x - f / derivative;
        let next = if newton > low && newton < high { newton } else { 0.5 * (low + high) };
        if (next - x).abs() < 1e-9 {
            x = next;
            break;
        }
        x = next;
    }
    x as f32
}

/// Samples the perpendicular slope of a facet with unit roughness, for any view direction.
pub(super) fn beckmann_slope_across(u: f32) -> f32 {
    erf_inverse(2.0 * inside(u) - 1.0) as f32
}

/// Moves a uniform number strictly inside (0, 1), because the ends map to slopes of ±∞.
fn inside(u: f32) -> f64 {
    (f64::from(u) + 2f64.powi(-26)).min(1.0 - 2f64.powi(-26))
}

/// Returns the inverse error function with a relative error of about 1e-7. [Giles 2012, single precision]
fn erf_inverse(x: f64) -> f64 {
    let w = -((1.0 - x) * (1.0 + x)).ln();
    let (w, coefficients): (f64, [f64; 9]) = if w < 5.0 {
        (
            w - 2.5,
            [
                2.810_226_36e-8,
                3.432_739_39e-7,
                -3.523_387_7e-6,
                -4.391_506_54e-6,
                0.000_218_580_87,
                -0.001_253_725_03,
                -0.004_177_681_64,
                0.246_640_727,
                1.501_409_41,
            ],
        )
    } else {
        (
            w.sqrt() - 3.0,
            [
                -0.000_200_214_257,
                0.000_100_950_558,
                0.001_349_343_22,
                -0.003_673_428_44,
                0.005_739_507_73,
                -0.007_622_461_3,
                0.009_438_870_47,
                1.001_674_06,
                2.832_976_82,
            ],
        )
    };
    coefficients.into_iter().fold(0.0, |p, c| p * w + c) * x
}

/// [`Microfacets`] of one family in each of sixteen lanes, with visible normals sampled.
pub struct MicrofacetsX16 {
    distribution: Distribution,
    alpha_x: f32x16,
    alpha_y: f32x16,
}

impl MicrofacetsX16 {
    /// Creates the distributions, all of the family of the first.
    #[inline(always)]
    pub(super) fn gather<T>(lanes: &LaneBsdfs<'_, T>, microfacets: impl Fn(&T) -> Microfacets) -> Self {
        MicrofacetsX16 {
            distribution: microfacets(lanes.bsdfs[0]).distribution,
            alpha_x: lanes.numbers(|b| microfacets(b).alpha_x),
            alpha_y: lanes.numbers(|b| microfacets(b).alpha_y),
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
/// 2·10⁻⁶. The variable is the error function of the slope, in which the cumulative distribution is almost linear, so
/// two steps of Halley's method suffice. [Jakob 2014]
#[inline(always)]
fn beckmann_slope_along_x16(cos: f32x16, sin: f32x16, u: f32x16) -> f32x16 {
    let (one, k) = (f32x16::ONE, f32x16::splat(FRAC_1_SQRT_PI));
    let (u, rest) = inside_x16(u);
    let end = (cos / sin).fast_min(f32x16::splat(6.0));
    let exp = exp_x16(-end * end);
    let beyond = erfc_x16(end, exp);
    // F(x) = cosθ·(1 + x) + sinθ/√π·exp(−slope²) with x = erf(slope); `whole` is its value at the end.
    let whole = cos * (one + one - beyond) + sin * k * exp;
    let target = u * whole;
    let last = one - beyond;
    let least = f32x16::splat(-0.999_999_9);
    let angle = angle_x16(sin, cos);
    let cubic = |a: f32, x: f32x16| f32x16::splat(a) + angle * x;
    let power = cubic(1.0, cubic(-0.876, cubic(0.4265, f32x16::splat(-0.0594))));
    let mut x = last - (one + last) * exp_x16(power * ln_x16(rest));
    let mut slope = f32x16::ZERO;
    for step in 0..3 {
        x = x.fast_max(least).fast_min(last.fast_min(-least));
        let product = (one - x) * (one + x);
        slope = erf_inverse_x16(x, -ln_x16(product));
        if step < 2 {
            let exp = exp_x16(-slope * slope);
            // The derivative is zero at the end, where a quotient would be rounding errors.
            let derivative = (cos - slope * sin).fast_max(f32x16::splat(1e-3));
            let newton = (cos * (one + x) + sin * k * exp - target) / derivative;
            // The second derivative is −sinθ·√π/2·exp(slope²).
            let bend = f32x16::splat(0.25 / FRAC_1_SQRT_PI) * newton * sin / (exp * derivative);
            x -= newton / (one + bend).fast_max(f32x16::HALF);
        }
    }
    slope
}

/// Computes the slope of `beckmann_slope_across` in each lane.
#[inline(always)]
fn beckmann_slope_across_x16(u: f32x16) -> f32x16 {
    let (u, rest) = inside_x16(u);
    erf_inverse_x16(u - rest, -ln_x16(f32x16::splat(4.0) * u * rest))
}

/// Moves uniform numbers strictly inside (0, 1), because the ends map to slopes of ±∞. Returns the numbers and their
/// differences from 1.
#[inline(always)]
fn inside_x16(u: f32x16) -> (f32x16, f32x16) {
    const SHIFT: f32 = 1.490_116_1e-8; // 2⁻²⁶
    (u + f32x16::splat(SHIFT), (f32x16::ONE - u) - f32x16::splat(SHIFT))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::LANES;

    #[test]
    fn the_inverse_error_function_inverts() {
        for x in [-0.999_999, -0.9, -0.1, 1e-6, 0.3, 0.7, 0.99, 0.999_999] {
            assert!((libm::erf(erf_inverse(x)) - x).abs() < 3e-7, "{x}");
        }
    }

    #[test]
    fn masking_has_its_limits() {
        for distribution in [Distribution::Beckmann, Distribution::Ggx] {
            let m = Microfacets { distribution, alpha_x: 0.3, alpha_y: 0.3, sample_visible: true };
            assert_eq!(m.g1(Vec3::Z, Vec3::Z), 1.0);
            assert!(m.g1(Vec3::new(1.0, 0.0, 1e-4).normalize(), Vec3::Z) < 1e-2);
            assert_eq!(m.g1(Vec3::Z, -Vec3::Z), 0.0);
        }
    }

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
