//! A smooth conductor.

use super::fresnel::{ConductorFresnel, ConductorFresnelX16};
use super::lanes::{BsdfEvalX16, BsdfSampleX16, Kernel, LaneBsdfs};
use super::{Bsdf, BsdfSample, Lobe};
use crate::color::Rgb;
use crate::math::{Vec3, Vec3x16, f32x16};

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

/// A [`Conductor`] in each of sixteen lanes.
pub struct ConductorX16 {
    fresnel: ConductorFresnelX16,
    specular_reflectance: [f32x16; 3],
}

impl<'a> Kernel<'a> for ConductorX16 {
    type Scalar = Conductor;

    fn of(bsdf: &'a Bsdf<'a>) -> Option<&'a Conductor> {
        match bsdf {
            Bsdf::Conductor(b) => Some(b),
            _ => None,
        }
    }

    #[inline(always)]
    fn gather(lanes: &LaneBsdfs<'a, Conductor>) -> Self {
        ConductorX16 {
            fresnel: ConductorFresnelX16::gather(lanes, |b| b.fresnel),
            specular_reflectance: lanes.colors(|b| b.specular_reflectance),
        }
    }

    #[inline(always)]
    fn eval(&self, _: &Vec3x16, _: &Vec3x16) -> BsdfEvalX16 {
        BsdfEvalX16::ZERO
    }

    #[inline(always)]
    fn sample(&self, wo: &Vec3x16, _: f32x16, _: [f32x16; 2]) -> BsdfSampleX16 {
        let fresnel = self.fresnel.reflectance(wo.z);
        BsdfSampleX16 {
            wi: Vec3x16::new(-wo.x, -wo.y, wo.z),
            weight: std::array::from_fn(|c| fresnel[c] * self.specular_reflectance[c]),
            pdf: f32x16::splat(f32::INFINITY),
            eta: f32x16::ONE,
            valid: wo.z.simd_gt(f32x16::ZERO),
        }
    }
}
