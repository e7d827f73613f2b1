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
    /// The fraction of the transmitted light that passes through holes, so that rays do not hit the sheet: at most
    /// each channel of the factor. The BSDF has the rest of the light, divided by the probability of a hit.
    pub passing: f32,
}

impl ThinDielectric {
    /// Returns the reflectance with all internal reflections: `R + T²R + T²R³ + … = 2R/(1 + R)`. [pbrt, 9.5.1]
    fn reflectance(&self, cos: f32) -> f32 {
        let r = fresnel::dielectric(cos, self.eta).reflectance;
        2.0 * r / (1.0 + r)
    }

    /// Returns the probability that a ray hits the sheet, for the cosine of its angle.
    pub fn opacity(&self, cos: f32) -> f32 {
        1.0 - (1.0 - self.reflectance(cos)) * self.passing
    }

    /// Returns reflectance and transmittance at a hit, without their factors.
    fn shares(&self, cos: f32) -> [f32; 2] {
        let (r, opacity) = (self.reflectance(cos), self.opacity(cos));
        // Not NaN if nothing is reflected.
        if opacity > 0.0 { [(r / opacity).min(1.0), (1.0 - r) / opacity] } else { [1.0, 0.0] }
    }

    /// Returns the factor on the transmission of rays that hit the sheet.
    fn transmitted(&self) -> Rgb {
        self.specular_transmittance - Rgb::WHITE * self.passing
    }

    /// Returns the probability with which [`sample`](Self::sample) reflects.
    pub(super) fn reflection_probability(&self, wo: Vec3) -> f32 {
        probability_below(self.shares(wo.z.abs())[0])
    }

    /// Reflects with the probability of the reflectance, otherwise passes.
    #[inline]
    pub fn sample(&self, wo: Vec3, u_lobe: f32) -> Option<BsdfSample> {
        if wo.z == 0.0 {
            return None;
        }
        let ([r, t], probability) = (self.shares(wo.z.abs()), self.reflection_probability(wo));
        let (wi, weight) = if u_lobe < probability {
            (Vec3::new(-wo.x, -wo.y, wo.z), self.specular_reflectance * (r / probability))
        } else {
            (-wo, self.transmitted() * (t / (1.0 - probability)))
        };
        Some(BsdfSample { wi, weight, pdf: f32::INFINITY, lobe: Lobe::Specular, eta: 1.0 })
    }

    /// Returns reflectance plus transmittance at normal incidence.
    pub fn albedo(&self) -> Rgb {
        let [r, t] = self.shares(1.0);
        self.specular_reflectance * r + self.transmitted() * t
    }
}
