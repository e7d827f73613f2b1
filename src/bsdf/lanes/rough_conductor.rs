//! Rough conductors in sixteen lanes. [Walter 2007]

use super::fresnel::conductor_x16;
use super::microfacet::MicrofacetsX16;
use super::{BsdfEvalX16, BsdfSampleX16, Kernel, channels};
use crate::bsdf::microfacet::Microfacets;
use crate::bsdf::{Bsdf, RoughConductor};
use crate::math::{LANES, Vec3x16, f32x16};

/// A [`RoughConductor`] in each of sixteen lanes.
pub struct RoughConductorX16 {
    microfacets: MicrofacetsX16,
    eta: [f32x16; 3],
    k: [f32x16; 3],
    specular_reflectance: [f32x16; 3],
}

impl RoughConductorX16 {
    #[inline(always)]
    fn reflectance(&self, cos_i: f32x16) -> [f32x16; 3] {
        let cos_i = cos_i.fast_min(f32x16::ONE);
        std::array::from_fn(|c| conductor_x16(cos_i, self.eta[c], self.k[c]) * self.specular_reflectance[c])
    }
}

impl Kernel for RoughConductorX16 {
    type Scalar = RoughConductor;

    fn of<'a>(bsdf: &'a Bsdf<'_>) -> Option<(&'a RoughConductor, &'a Microfacets)> {
        match bsdf {
            Bsdf::RoughConductor(b) => Some((b, &b.microfacets)),
            _ => None,
        }
    }

    #[inline(always)]
    fn gather(bsdfs: [&RoughConductor; LANES]) -> Self {
        RoughConductorX16 {
            microfacets: MicrofacetsX16::gather(
                bsdfs[0].microfacets.distribution,
                bsdfs.map(|b| &b.microfacets),
            ),
            eta: channels(bsdfs.map(|b| b.fresnel.eta)),
            k: channels(bsdfs.map(|b| b.fresnel.k)),
            specular_reflectance: channels(bsdfs.map(|b| b.specular_reflectance)),
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
