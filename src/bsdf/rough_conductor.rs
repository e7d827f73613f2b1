//! A rough conductor with a microfacet distribution. [Walter 2007]

use super::fresnel::{ConductorFresnel, ConductorFresnelX16};
use super::lanes::{BsdfEvalX16, BsdfSampleX16, Kernel, LaneBsdfs};
use super::microfacet::{Microfacets, MicrofacetsX16};
use super::{Bsdf, BsdfEval, BsdfSample, Lobe};
use crate::color::Rgb;
use crate::math::{Vec2, Vec3, Vec3x16, f32x16};

/// Microfacet reflection by a conductor on the front side; the back side is black.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RoughConductor {
    /// The microfacet distribution.
    pub microfacets: Microfacets,
    /// The index of refraction.
    pub fresnel: ConductorFresnel,
    /// A factor on the reflection.
    pub specular_reflectance: Rgb,
}

impl RoughConductor {
    /// Evaluates `f = F·D·G / (4·cosθo·cosθi)`. [Walter 2007, Eq. 20]
    #[inline]
    pub fn eval(&self, wo: Vec3, wi: Vec3) -> BsdfEval {
        if wo.z <= 0.0 || wi.z <= 0.0 {
            return BsdfEval::ZERO;
        }
        let m = (wo + wi).normalize();
        let d = self.microfacets.d(m);
        if d == 0.0 {
            return BsdfEval::ZERO;
        }
        let g = self.microfacets.g1(wo, m) * self.microfacets.g1(wi, m);
        let fresnel = self.fresnel.reflectance(wi.dot(m).min(1.0));
        BsdfEval {
            f: fresnel * self.specular_reflectance * (d * g / (4.0 * wo.z * wi.z)),
            // [Walter 2007, Eq. 14]
            pdf: self.microfacets.pdf(wo, m) / (4.0 * wo.dot(m)),
        }
    }

    /// Samples a facet and reflects `wo` by it.
    #[inline]
    pub fn sample(&self, wo: Vec3, u: Vec2) -> Option<BsdfSample> {
        if wo.z <= 0.0 {
            return None;
        }
        let m = self.microfacets.sample(wo, u);
        let wi = (m * (2.0 * wo.dot(m)) - wo).normalize();
        if wo.dot(m) <= 0.0 || wi.z <= 0.0 {
            return None;
        }
        let pdf = self.microfacets.pdf(wo, m) / (4.0 * wo.dot(m));
        let fresnel = self.fresnel.reflectance(wi.dot(m).min(1.0)) * self.specular_reflectance;
        let g1 = self.microfacets.g1(wi, m);
        // f·cosθi/pdf with D cancelled, because D overflows and underflows for small roughness.
        let weight = if self.microfacets.sample_visible {
            fresnel * g1
        } else {
            fresnel * (self.microfacets.g1(wo, m) * g1 * wo.dot(m) / (wo.z * m.z))
        };
        (pdf > 0.0).then_some(BsdfSample { wi, weight, pdf, lobe: Lobe::Glossy, eta: 1.0 })
    }
}

/// A [`RoughConductor`] in each of sixteen lanes.
pub struct RoughConductorX16 {
    microfacets: MicrofacetsX16,
    fresnel: ConductorFresnelX16,
    specular_reflectance: [f32x16; 3],
}

impl RoughConductorX16 {
    #[inline(always)]
    fn reflectance(&self, cos_i: f32x16) -> [f32x16; 3] {
        let fresnel = self.fresnel.reflectance(cos_i.fast_min(f32x16::ONE));
        std::array::from_fn(|c| fresnel[c] * self.specular_reflectance[c])
    }
}

impl<'a> Kernel<'a> for RoughConductorX16 {
    type Scalar = RoughConductor;

    fn of(bsdf: &'a Bsdf<'a>) -> Option<&'a RoughConductor> {
        match bsdf {
            Bsdf::RoughConductor(b) if b.microfacets.sample_visible => Some(b),
            _ => None,
        }
    }

    fn alike(a: &RoughConductor, b: &RoughConductor) -> bool {
        a.microfacets.distribution == b.microfacets.distribution
    }

    #[inline(always)]
    fn gather(lanes: &LaneBsdfs<'a, RoughConductor>) -> Self {
        RoughConductorX16 {
            microfacets: MicrofacetsX16::gather(lanes, |b| b.microfacets),
            fresnel: ConductorFresnelX16::gather(lanes, |b| b.fresnel),
            specular_reflectance: lanes.colors(|b| b.specular_reflectance),
        }
    }

    #[inline(always)]
    fn eval(&self, wo: &Vec3x16, wi: &Vec3x16) -> BsdfEvalX16 {
        let m = (*wo + *wi).normalize_or_zero();
        let d = self.microfacets.d(&m);
        let cos = wo.dot(m);
        let above = wo.z.simd_gt(f32x16::ZERO) & wi.z.simd_gt(f32x16::ZERO) & cos.simd_gt(f32x16::ZERO);
        let g1_o = self.microfacets.g1(wo, &m);
        let g = g1_o * self.microfacets.g1(wi, &m);
        let four = f32x16::splat(4.0);
        let value = (d * g / (four * wo.z * wi.z)) & above;
        let pdf = (d * g1_o * cos / wo.z / (four * cos)) & above;
        BsdfEvalX16 { f: self.reflectance(wi.dot(m)).map(|fresnel| fresnel * value), pdf }
    }

    #[inline(always)]
    fn sample(&self, wo: &Vec3x16, _u_lobe: f32x16, u: [f32x16; 2]) -> BsdfSampleX16 {
        let zero = f32x16::ZERO;
        let m = self.microfacets.sample(wo, u);
        let cos = wo.dot(m);
        let wi = (m * (cos + cos) - *wo).normalize_or_zero();
        let pdf = self.microfacets.pdf(wo, &m) / (f32x16::splat(4.0) * cos);
        let g1 = self.microfacets.g1(&wi, &m);
        BsdfSampleX16 {
            wi,
            weight: self.reflectance(wi.dot(m)).map(|fresnel| fresnel * g1),
            pdf,
            eta: f32x16::ONE,
            valid: wo.z.simd_gt(zero) & cos.simd_gt(zero) & wi.z.simd_gt(zero) & pdf.simd_gt(zero),
        }
    }
}
