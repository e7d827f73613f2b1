//! The Fresnel equations for unpolarised light.

use super::lanes::LaneBsdfs;
use crate::color::Rgb;
use crate::math::f32x16;

/// Reflectance of a smooth boundary, and the cosine of the refracted direction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Refraction {
    /// Fraction of the light that is reflected.
    pub reflectance: f32,
    /// Cosine of the refracted direction on the far side, not negative; 0 for total internal reflection.
    pub cos_t: f32,
}

/// Returns the Fresnel reflectance between dielectrics. `cos_i ≥ 0` is the cosine on the near side, `eta` the index
/// of the far side relative to that of the near side. `eta = 1` reflects nothing. [Born and Wolf 1999, 1.5.2]
#[inline]
pub fn dielectric(cos_i: f32, eta: f32) -> Refraction {
    // cos²θt = 1 − (1 − cos²θi)/η², arranged to avoid cancellation for η near 1 at grazing angles.
    let scale = 1.0 / (eta * eta);
    let cos2_t = (eta - 1.0) * (eta + 1.0) * scale + cos_i * cos_i * scale;
    if cos2_t <= 0.0 {
        return Refraction { reflectance: 1.0, cos_t: 0.0 };
    }
    if eta == 1.0 {
        return Refraction { reflectance: 0.0, cos_t: cos_i };
    }
    let cos_t = cos2_t.sqrt();
    let r_s = (cos_i - eta * cos_t) / (cos_i + eta * cos_t);
    let r_p = (cos_t - eta * cos_i) / (cos_t + eta * cos_i);
    Refraction { reflectance: 0.5 * (r_s * r_s + r_p * r_p), cos_t }
}

/// Returns the fraction of diffuse light that a smooth boundary reflects; `eta` is the index of the far side relative
/// to that of the near side. Polynomial fits to the integral are used. Below 1, that of [Egan and Hilgeman 1973] is
/// accurate to 0.1 % from 2/3 and to 0.6 % from 1/2, but exceeds 1 at 1/3.85. From 1 on, that of [d'Eon and Irving
/// 2011] is accurate to 0.2 % up to 10.
pub fn diffuse_reflectance(eta: f32) -> f32 {
    let inverse = 1.0 / eta;
    if eta < 1.0 {
        ((-1.4399 * eta + 0.7099) * eta + 0.6681) + 0.0636 * inverse
    } else {
        [-1.36881, 4.98554, -7.80989, 6.75335, -3.4793, 0.919317]
            .into_iter()
            .fold(0.0, |sum: f32, coefficient: f32| sum * inverse + coefficient)
    }
}

/// The complex index of refraction of a conductor relative to the outside, for each channel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ConductorFresnel {
    /// Real part.
    pub eta: Rgb,
    /// Imaginary part.
    pub k: Rgb,
}

impl ConductorFresnel {
    /// Returns the reflectance at the cosine `cos_i ≥ 0` of the incident direction.
    #[inline]
    pub fn reflectance(&self, cos_i: f32) -> Rgb {
        self.eta.zip(self.k, |eta, k| conductor(cos_i, eta, k))
    }
}

/// Returns the Fresnel reflectance of a conductor with the index `eta + i k`. [Lagarde 2013, from Born and Wolf 1999,
/// 14.2]
#[inline]
pub fn conductor(cos_i: f32, eta: f32, k: f32) -> f32 {
    let cos2 = cos_i * cos_i;
    let sin2 = 1.0 - cos2;
    let t0 = eta * eta - k * k - sin2;
    let a2_plus_b2 = (t0 * t0 + 4.0 * eta * eta * k * k).sqrt();
    let a = (0.5 * (a2_plus_b2 + t0)).max(0.0).sqrt();
    let t1 = a2_plus_b2 + cos2;
    let t2 = 2.0 * cos_i * a;
    let r_s = (t1 - t2) / (t1 + t2);
    let t3 = cos2 * a2_plus_b2 + sin2 * sin2;
    let t4 = t2 * sin2;
    let r_p = r_s * (t3 - t4) / (t3 + t4);
    let r = 0.5 * (r_s + r_p);
    if r.is_finite() { r.clamp(0.0, 1.0) } else { 1.0 }
}

/// Computes [`dielectric`] in each lane: reflectances, and cosines of the refracted
/// directions. No index may be 1.
#[inline(always)]
pub fn dielectric_x16(cos_i: f32x16, eta: f32x16) -> (f32x16, f32x16) {
    let one = f32x16::ONE;
    let scale = one / (eta * eta);
    let cos2_t = (eta - one) * (eta + one) * scale + cos_i * cos_i * scale;
    let refracts = cos2_t.simd_gt(f32x16::ZERO);
    let cos_t = cos2_t.sqrt() & refracts;
    let r_s = (cos_i - eta * cos_t) / (cos_i + eta * cos_t);
    let r_p = (cos_t - eta * cos_i) / (cos_t + eta * cos_i);
    (refracts.select(f32x16::HALF * (r_s * r_s + r_p * r_p), one), cos_t)
}

/// A [`ConductorFresnel`] in each of sixteen lanes.
pub struct ConductorFresnelX16 {
    eta: [f32x16; 3],
    k: [f32x16; 3],
}

impl ConductorFresnelX16 {
    /// Creates the lanes.
    #[inline(always)]
    pub(super) fn gather<T>(lanes: &LaneBsdfs<'_, T>, fresnel: impl Fn(&T) -> ConductorFresnel) -> Self {
        ConductorFresnelX16 { eta: lanes.colors(|b| fresnel(b).eta), k: lanes.colors(|b| fresnel(b).k) }
    }

    /// Computes [`ConductorFresnel::reflectance`] in each lane, by channel.
    #[inline(always)]
    pub fn reflectance(&self, cos_i: f32x16) -> [f32x16; 3] {
        std::array::from_fn(|c| conductor_x16(cos_i, self.eta[c], self.k[c]))
    }
}

/// Computes [`conductor`] in each lane.
#[inline(always)]
fn conductor_x16(cos_i: f32x16, eta: f32x16, k: f32x16) -> f32x16 {
    let (zero, one, four) = (f32x16::ZERO, f32x16::ONE, f32x16::splat(4.0));
    let cos2 = cos_i * cos_i;
    let sin2 = one - cos2;
    let t0 = eta * eta - k * k - sin2;
    let a2_plus_b2 = (t0 * t0 + four * eta * eta * k * k).sqrt();
    let a = (f32x16::HALF * (a2_plus_b2 + t0)).fast_max(zero).sqrt();
    let t1 = a2_plus_b2 + cos2;
    let t2 = (cos_i + cos_i) * a;
    let r_s = (t1 - t2) / (t1 + t2);
    let t3 = cos2 * a2_plus_b2 + sin2 * sin2;
    let t4 = t2 * sin2;
    let r_p = r_s * (t3 - t4) / (t3 + t4);
    let r = f32x16::HALF * (r_s + r_p);
    r.is_finite().select(r.fast_max(zero).fast_min(one), one)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn normal_incidence_has_its_closed_form() {
        let r = dielectric(1.0, 1.5);
        assert!((r.reflectance - 0.04).abs() < 1e-6);
        assert!((r.cos_t - 1.0).abs() < 1e-6);
        let c = conductor(1.0, 0.2, 3.0);
        let exact = ((0.2f32 - 1.0).powi(2) + 9.0) / ((0.2f32 + 1.0).powi(2) + 9.0);
        assert!((c - exact).abs() < 1e-6);
    }

    #[test]
    fn equal_indices_vanish_and_the_critical_angle_reflects_everything() {
        for cos in [1.0, 0.5, 1e-3, 0.0] {
            assert_eq!(dielectric(cos, 1.0).reflectance, if cos > 0.0 { 0.0 } else { 1.0 });
        }
        let critical = (1.0f32 - (1.0f32 / 1.5).powi(2)).sqrt();
        assert_eq!(dielectric(critical * 0.999, 1.0 / 1.5).reflectance, 1.0);
        assert!(dielectric(critical * 1.01, 1.0 / 1.5).reflectance < 1.0);
    }

    #[test]
    fn a_conductor_without_absorption_is_a_dielectric() {
        for cos in [1.0, 0.7, 0.3, 0.01] {
            let (a, b) = (conductor(cos, 1.5, 0.0), dielectric(cos, 1.5).reflectance);
            assert!((a - b).abs() < 2e-6, "{cos}: {a} {b}");
        }
    }

    #[test]
    fn reciprocity_of_refraction() {
        let r = dielectric(0.6, 1.5);
        let back = dielectric(r.cos_t, 1.0 / 1.5);
        assert!((r.reflectance - back.reflectance).abs() < 1e-6);
        assert!((back.cos_t - 0.6).abs() < 1e-6);
    }

    /// Compares the fits of the diffuse reflectance with the integral 2∫F·cosθ·d(cosθ).
    #[test]
    fn diffuse_reflectance_is_the_integral() {
        let integral = |eta: f32| {
            let n = 10_000;
            let term = |i: i32| {
                let cos = (i as f32 + 0.5) / n as f32;
                f64::from(dielectric(cos, eta).reflectance * cos)
            };
            2.0 * (0..n).map(term).sum::<f64>() / f64::from(n)
        };
        for (eta, error) in
            [(1.1, 2e-3), (1.5, 2e-3), (2.0, 2e-3), (5.0, 2e-3), (1.0 / 1.5, 2e-3), (0.5, 6e-3)]
        {
            let (fit, exact) = (f64::from(diffuse_reflectance(eta)), integral(eta));
            assert!((fit / exact - 1.0).abs() < error, "{eta}: {fit} {exact}");
        }
    }
}
