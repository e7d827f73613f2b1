//! A smooth conductor.

use super::fresnel::ConductorFresnel;
use super::{BsdfSample, Lobe};
use crate::color::Rgb;
use crate::math::Vec3;

/// Specular reflection by a conductor on the front side; the back side is black.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Conductor {
    /// The index of refraction.
    pub fresnel: ConductorFresnel,
    /// A factor on the reflection.
    pub specular_reflectance: Rgb,
}

impl Conductor {
    /// Returns the mirror direction.
    #[inline]
    pub fn sample(&self, wo: Vec3) -> Option<BsdfSample> {
        if wo.z <= 0.0 {
            return None;
        }
        Some(BsdfSample {
            wi: Vec3::new(-wo.x, -wo.y, wo.z),
            weight: self.fresnel.reflectance(wo.z) * self.specular_reflectance,
            pdf: f32::INFINITY,
            lobe: Lobe::Specular,
            eta: 1.0,
        })
    }
}
