//! A smooth boundary between two dielectrics.

use super::fresnel;
use super::{BsdfSample, Lobe};
use crate::color::Rgb;
use crate::math::Vec3;
use crate::sampling::hash::probability_below;

/// Reflection and refraction of radiance at a smooth boundary.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Dielectric {
    /// Index of refraction below the surface (−z) relative to that above it.
    pub eta: f32,
    /// A factor on the reflection.
    pub specular_reflectance: Rgb,
    /// A factor on the transmission.
    pub specular_transmittance: Rgb,
}

impl Dielectric {
    /// Returns the index of the far side relative to that of wo's side.
    fn eta_from(&self, wo: Vec3) -> f32 {
        if wo.z > 0.0 { self.eta } else { 1.0 / self.eta }
    }

    /// Returns the probability with which [`sample`](Self::sample) reflects.
    pub(super) fn reflection_probability(&self, wo: Vec3) -> f32 {
        probability_below(fresnel::dielectric(wo.z.abs(), self.eta_from(wo)).reflectance)
    }

    /// Reflects with the probability of the Fresnel reflectance, otherwise refracts.
    ///
    /// Refracted radiance is scaled by the squared ratio of the indices, because the solid angle changes. [Veach
    /// 1997, Eq. 5.2]
    #[inline]
    pub fn sample(&self, wo: Vec3, u_lobe: f32) -> Option<BsdfSample> {
        if wo.z == 0.0 {
            return None;
        }
        let eta = self.eta_from(wo);
        let r = fresnel::dielectric(wo.z.abs(), eta);
        let probability = probability_below(r.reflectance);
        if u_lobe < probability {
            return Some(BsdfSample {
                wi: Vec3::new(-wo.x, -wo.y, wo.z),
                weight: self.specular_reflectance * (r.reflectance / probability),
                pdf: f32::INFINITY,
                lobe: Lobe::Specular,
                eta: 1.0,
            });
        }
        let scale = 1.0 / eta;
        let share = (1.0 - r.reflectance) / (1.0 - probability);
        Some(BsdfSample {
            wi: Vec3::new(-scale * wo.x, -scale * wo.y, (-r.cos_t).copysign(-wo.z)).normalize(),
            weight: self.specular_transmittance * (scale * scale * share),
            pdf: f32::INFINITY,
            lobe: Lobe::Specular,
            eta,
        })
    }

    /// Returns reflectance plus transmittance at normal incidence.
    pub fn albedo(&self) -> Rgb {
        let r = fresnel::dielectric(1.0, self.eta).reflectance;
        self.specular_reflectance * r + self.specular_transmittance * (1.0 - r)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn refraction_obeys_snell_and_conserves_flux() {
        let glass =
            Dielectric { eta: 1.5, specular_reflectance: Rgb::WHITE, specular_transmittance: Rgb::WHITE };
        let wo = Vec3::new(0.6, 0.0, 0.8);
        let s = glass.sample(wo, 1f32.next_down()).unwrap();
        assert!((s.wi.x + 0.4).abs() < 1e-6 && s.wi.z < 0.0);
        assert!((s.weight.r - 1.0 / 2.25).abs() < 1e-6);
        // The reverse direction has the same path and the inverse scale.
        let back = glass.sample(s.wi, 1f32.next_down()).unwrap();
        assert!((back.wi - wo).length() < 1e-6);
        assert!((back.weight.r * s.weight.r - 1.0).abs() < 1e-6);
    }

    #[test]
    fn equal_indices_let_light_pass_unchanged() {
        let air =
            Dielectric { eta: 1.0, specular_reflectance: Rgb::WHITE, specular_transmittance: Rgb::WHITE };
        let wo = Vec3::new(0.6, 0.0, 0.8);
        let s = air.sample(wo, 0.0).unwrap();
        assert!((s.wi + wo).length() < 1e-6);
        assert_eq!(s.weight, Rgb::WHITE);
    }
}
