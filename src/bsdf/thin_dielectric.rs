//! A thin sheet of a dielectric.

use super::{BsdfSample, Lobe, fresnel};
use crate::color::Rgb;
use crate::math::Vec3;
use crate::sampling::hash::probability_below;

/// Two parallel smooth boundaries at the same position: light is reflected or passes in a straight line.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ThinDielectric {
    /// Index of refraction of the sheet relative to that of its surroundings.
    pub eta: f32,
    /// A factor on the reflection.
    pub specular_reflectance: Rgb,
    /// A factor on the transmission.
    pub specular_transmittance: Rgb,
}

impl ThinDielectric {
    /// Returns the reflectance with all internal reflections: `R + T²R + T²R³ + … = 2R/(1 + R)`. [pbrt, 9.5.1]
    fn reflectance(&self, cos: f32) -> f32 {
        let r = fresnel::dielectric(cos, self.eta).reflectance;
        2.0 * r / (1.0 + r)
    }

    /// Returns the probability with which [`sample`](Self::sample) reflects.
    pub(super) fn reflection_probability(&self, wo: Vec3) -> f32 {
        probability_below(self.reflectance(wo.z.abs()))
    }

    /// Reflects with the probability of the reflectance, otherwise passes.
    #[inline]
    pub fn sample(&self, wo: Vec3, u_lobe: f32) -> Option<BsdfSample> {
        if wo.z == 0.0 {
            return None;
        }
        let (r, probability) = (self.reflectance(wo.z.abs()), self.reflection_probability(wo));
        let (wi, weight) = if u_lobe < probability {
            (Vec3::new(-wo.x, -wo.y, wo.z), self.specular_reflectance * (r / probability))
        } else {
            (-wo, self.specular_transmittance * ((1.0 - r) / (1.0 - probability)))
        };
        Some(BsdfSample { wi, weight, pdf: f32::INFINITY, lobe: Lobe::Specular, eta: 1.0 })
    }

    /// Returns reflectance plus transmittance at normal incidence.
    pub fn albedo(&self) -> Rgb {
        let r = self.reflectance(1.0);
        self.specular_reflectance * r + self.specular_transmittance * (1.0 - r)
    }
}
