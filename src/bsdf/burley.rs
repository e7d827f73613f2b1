//! Common parts of the two principled models. [Burley 2012; 2015]

use super::microfacet::{Distribution, Microfacets};
use crate::color::Rgb;
use crate::math::{Vec2, Vec3};
use std::f32::consts::PI;

/// The cosine-weighted mean of [`schlick_weight`] over the hemisphere: `2∫(1 − c)⁵·c·dc`.
pub const MEAN_SCHLICK_WEIGHT: f32 = 1.0 / 21.0;

/// Returns `(1 − cosθ)⁵`.
#[inline]
pub fn schlick_weight(cos: f32) -> f32 {
    let m = (1.0 - cos).clamp(0.0, 1.0);
    m * m * m * m * m
}

/// Returns Schlick's approximation of the Fresnel reflectance with the reflectance `r0` at normal incidence, at the
/// cosine `cos_i ≥ 0` on the near side. From a denser medium (`eta ≤ 1`), the cosine of the refracted direction is
/// used.
#[inline]
pub fn schlick(r0: Rgb, cos_i: f32, eta: f32) -> Rgb {
    let cos = match eta > 1.0 {
        true => cos_i,
        false => (1.0 - (1.0 - cos_i * cos_i) / (eta * eta)).max(0.0).sqrt(),
    };
    let weight = schlick_weight(cos);
    r0.map(|r0| r0 + (1.0 - r0) * weight)
}

/// Returns the reflectance at normal incidence between dielectrics.
#[inline]
pub fn r0_from_eta(eta: f32) -> f32 {
    let r = (eta - 1.0) / (eta + 1.0);
    r * r
}

/// Returns a colour divided by its luminance; white for black, which has no hue. [Burley 2012, 5]
#[inline]
pub fn tint(color: Rgb) -> Rgb {
    let luminance = color.luminance();
    if luminance > 0.0 { color / luminance } else { Rgb::WHITE }
}

/// Interpolates between white and [`tint`] with the weight `share`.
#[inline]
pub fn tinted(color: Rgb, share: f32) -> Rgb {
    if share > 0.0 { Rgb::WHITE * (1.0 - share) + tint(color) * share } else { Rgb::WHITE }
}

/// Returns a GGX distribution whose roughness is the square of the parameter, at least 0.001. [Burley 2012, 5]
#[inline]
pub fn microfacets(roughness: f32, anisotropy: f32) -> Microfacets {
    let alpha = roughness * roughness;
    let aspect = if anisotropy == 0.0 { 1.0 } else { (1.0 - 0.9 * anisotropy).sqrt() };
    Microfacets {
        distribution: Distribution::Ggx,
        alpha_x: (alpha / aspect).max(1e-3),
        alpha_y: (alpha * aspect).max(1e-3),
        sample_visible: true,
    }
}

/// Returns the diffuse reflection with retro-reflection, relative to ρ/π. `flatness` is the weight of an
/// approximation of subsurface scattering. `cos_d` is the cosine between a direction and the half vector. [Burley
/// 2012, 5.3; 2015]
#[inline]
pub fn diffuse(cos_o: f32, cos_i: f32, cos_d: f32, roughness: f32, flatness: f32) -> f32 {
    let (w_o, w_i) = (schlick_weight(cos_o), schlick_weight(cos_i));
    let retro = 2.0 * roughness * cos_d * cos_d;
    let rough = (1.0 - 0.5 * w_o) * (1.0 - 0.5 * w_i) + retro * (w_o + w_i + w_o * w_i * (retro - 1.0));
    if flatness == 0.0 {
        return rough;
    }
    let f90 = 0.5 * retro;
    let fss = (1.0 + (f90 - 1.0) * w_o) * (1.0 + (f90 - 1.0) * w_i);
    let flat = 1.25 * (fss * (1.0 / (cos_o + cos_i) - 0.5) + 0.5);
    rough + (flat - rough) * flatness
}

/// The isotropic, long-tailed microfacet distribution of a clear coat. [Burley 2012, Eq. 4]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gtr1 {
    alpha2: f32,
}

impl Gtr1 {
    /// Creates the distribution; the roughness is 0.1 for a gloss of 0 and 0.001 for a gloss of 1.
    pub fn from_gloss(gloss: f32) -> Self {
        let alpha = 0.1 + (0.001 - 0.1) * gloss;
        Gtr1 { alpha2: alpha * alpha }
    }

    /// Returns the square of the roughness.
    pub fn alpha2(self) -> f32 {
        self.alpha2
    }

    /// Returns the density of normals per unit solid angle and unit area of the surface.
    pub fn d(&self, m: Vec3) -> f32 {
        let a = self.alpha2 - 1.0;
        // Computes 1 + (α² − 1)·cos² without cancellation near the normal.
        let sin2 = m.x * m.x + m.y * m.y;
        a / (PI * self.alpha2.ln() * (sin2 + self.alpha2 * m.z * m.z))
    }

    /// Samples a normal in proportion to `D·cosθ`. [Burley 2012, Eq. 5]
    pub fn sample(&self, u: Vec2) -> Vec3 {
        // sin²θ = (α^(2 − 2u) − α²)/(1 − α²)
        let sin2 = (self.alpha2.powf(1.0 - u.y) - self.alpha2) / (1.0 - self.alpha2);
        let (sin_phi, cos_phi) = (2.0 * PI * u.x).sin_cos();
        let sin = sin2.max(0.0).sqrt();
        Vec3::new(sin * cos_phi, sin * sin_phi, (1.0 - sin2).max(0.0).sqrt())
    }

    /// Returns the density of [`sample`](Self::sample) per unit solid angle.
    pub fn pdf(&self, m: Vec3) -> f32 {
        self.d(m) * m.z.max(0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::PI as PI64;

    #[test]
    fn a_clear_coats_facets_cover_the_surface_once() {
        for gloss in [0.0, 0.5, 1.0] {
            let gtr1 = Gtr1::from_gloss(gloss);
            // Integrates over ln(sin²θ + α²), in which the density is smooth.
            let low = f64::from(gtr1.alpha2).ln();
            let n = 20_000;
            let mut area = 0.0;
            for i in 0..n {
                let t = (low * (1.0 - (f64::from(i) + 0.5) / f64::from(n))).exp();
                let sin2 = (t - low.exp()) / (1.0 - low.exp());
                let m = Vec3::new(sin2.sqrt() as f32, 0.0, (1.0 - sin2).sqrt() as f32);
                area += f64::from(gtr1.d(m)) * PI64 * t * -low / (1.0 - low.exp()) / f64::from(n);
            }
            assert!((area - 1.0).abs() < 1e-4, "{gloss}: {area}");
        }
    }

    #[test]
    fn schlick_has_its_ends() {
        let r0 = Rgb::new(0.04, 0.2, 1.0);
        for eta in [1.5, 1.0 / 1.5] {
            assert_eq!(schlick(r0, 1.0, eta), r0);
            assert_eq!(schlick(r0, 0.0, eta), Rgb::WHITE);
        }
        assert_eq!(tint(Rgb::BLACK), Rgb::WHITE);
        assert!((r0_from_eta(1.5) - 0.04).abs() < 1e-7);
    }
}
