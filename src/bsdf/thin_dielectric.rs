//! A thin sheet of a dielectric.

use super::{BsdfSample, Lobe, fresnel};
use crate::color::Rgb;
use crate::math::Vec3;
use crate::sampling::hash::probability_below;

/// Two parallel smooth boundaries with nothing between them: light is mirrored or goes straight on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ThinDielectric {
    /// Index of refraction of the sheet over that around it.
    pub eta: f32,
    /// A factor on the reflection.
    pub specular_reflectance: Rgb,
    /// A factor on the transmission.
    pub specular_transmittance: Rgb,
}

impl ThinDielectric {
    /// The share that is mirrored after any number of reflections inside: `R + T²R + T²R³ + … = 2R/(1 + R)`.
    /// [pbrt, 9.5.1]
    fn reflectance(&self, cos: f32) -> f32 {
        let r = fresnel::dielectric(cos, self.eta).reflectance;
        2.0 * r / (1.0 + r)
    }

    /// The probability with which [`sample`](Self::sample) reflects.
    pub(super) fn reflection_probability(&self, wo: Vec3) -> f32 {
        probability_below(self.reflectance(wo.z.abs()))
    }

    /// Mirrors with the probability of the reflectance, else passes.
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

    /// Reflectance plus transmittance along the normal.
    pub fn albedo(&self) -> Rgb {
        let r = self.reflectance(1.0);
        self.specular_reflectance * r + self.specular_transmittance * (1.0 - r)
    }
}
