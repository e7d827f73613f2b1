//! Rough dielectric boundaries in sixteen lanes. [Walter 2007]

use super::fresnel::dielectric_x16;
use super::microfacet::MicrofacetsX16;
use super::{BsdfEvalX16, BsdfSampleX16, Kernel, channels};
use crate::bsdf::microfacet::Microfacets;
use crate::bsdf::{Bsdf, RoughDielectric};
use crate::math::lanes::with_sign;
use crate::math::{LANES, Vec3x16, f32x16};
use crate::sampling::hash::probability_below_x16;

/// A [`RoughDielectric`] in each of sixteen lanes.
pub struct RoughDielectricX16 {
    microfacets: MicrofacetsX16,
    eta: f32x16,
    reflectance: [f32x16; 3],
    transmittance: [f32x16; 3],
    /// The greatest components of the two factors.
    strongest: [f32x16; 2],
}

impl RoughDielectricX16 {
    /// Returns the indices of the far sides relative to those of the sides of `wo`.
    #[inline(always)]
    fn eta_from(&self, wo: &Vec3x16) -> f32x16 {
        wo.z.simd_gt(f32x16::ZERO).select(self.eta, f32x16::ONE / self.eta)
    }

    /// Computes [`RoughDielectric::reflection_probability`] in each lane.
    #[inline(always)]
    fn reflection_probability(&self, reflectance: f32x16) -> f32x16 {
        let reflected = reflectance * self.strongest[0];
        let total = reflected + (f32x16::ONE - reflectance) * self.strongest[1];
        let some = total.simd_gt(f32x16::ZERO);
        some.select(probability_below_x16(reflected / total), f32x16::ONE)
    }
}

/// Returns the solid angle of the normal of a refracting facet per solid angle of the refracted direction.
#[inline(always)]
fn refraction_jacobian(cos_o: f32x16, cos_t: f32x16, eta: f32x16) -> f32x16 {
    let one = f32x16::ONE;
    let difference = (one - eta) * (one + eta) / (cos_o + eta * cos_t);
    eta * eta * cos_t / (difference * difference)
}

impl Kernel for RoughDielectricX16 {
    type Scalar = RoughDielectric;

    fn of<'a>(bsdf: &'a Bsdf<'_>) -> Option<(&'a RoughDielectric, &'a Microfacets)> {
        match bsdf {
            Bsdf::RoughDielectric(b) if !b.is_passing() => Some((b, &b.microfacets)),
            _ => None,
        }
    }

    #[inline(always)]
    fn gather(bsdfs: [&RoughDielectric; LANES]) -> Self {
        RoughDielectricX16 {
            microfacets: MicrofacetsX16::gather(
                bsdfs[0].microfacets.distribution,
                bsdfs.map(|b| &b.microfacets),
            ),
            eta: f32x16::new(bsdfs.map(|b| b.eta)),
            reflectance: channels(bsdfs.map(|b| b.specular_reflectance)),
            transmittance: channels(bsdfs.map(|b| b.specular_transmittance)),
            strongest: [
                f32x16::new(bsdfs.map(|b| b.specular_reflectance.max_component())),
                f32x16::new(bsdfs.map(|b| b.specular_transmittance.max_component())),
            ],
        }
    }

    #[inline(always)]
    fn eval(&self, wo: &Vec3x16, wi: &Vec3x16) -> BsdfEvalX16 {
        let (zero, one) = (f32x16::ZERO, f32x16::ONE);
        let eta = self.eta_from(wo);
        let side = with_sign(one, wo.z);
        let (wo, wi) = (*wo * side, *wi * side);
        let reflects = wi.z.simd_gt(zero);
        let m = (wo + wi * reflects.select(one, eta)).normalize_or_zero();
        let m = m * with_sign(one, m.z);
        let (cos_o, cos_i) = (wo.dot(m), wi.dot(m));
        let joined = cos_o.simd_gt(zero) & (cos_i * wi.z).simd_gt(zero) & (wo.z * wi.z).simd_ne(zero);
        let mirrored = one / (f32x16::splat(4.0) * cos_o);
        let dm_dwi = reflects.select(mirrored, refraction_jacobian(cos_o, -cos_i, eta));
        let d = self.microfacets.d(&m);
        let g1_o = self.microfacets.g1(&wo, &m);
        let g = g1_o * self.microfacets.g1(&wi, &m);
        let (r, _) = dielectric_x16(cos_o, eta);
        let value = d * g * cos_o * dm_dwi / (wo.z * wi.z.abs());
        let value = reflects.select(value * r, value * (one - r) / (eta * eta)) & joined;
        let probability = self.reflection_probability(r);
        let probability = reflects.select(probability, one - probability);
        BsdfEvalX16 {
            f: std::array::from_fn(|c| reflects.select(self.reflectance[c], self.transmittance[c]) * value),
            pdf: (d * g1_o * cos_o / wo.z * dm_dwi * probability) & joined,
        }
    }

    #[inline(always)]
    fn sample(&self, wo: &Vec3x16, u_lobe: f32x16, u: [f32x16; 2]) -> BsdfSampleX16 {
        let (zero, one) = (f32x16::ZERO, f32x16::ONE);
        let eta = self.eta_from(wo);
        let side = with_sign(one, wo.z);
        let wo = *wo * side;
        let m = self.microfacets.sample(&wo, u);
        let cos_o = wo.dot(m);
        let (r, cos_t) = dielectric_x16(cos_o.fast_max(zero), eta);
        let probability = self.reflection_probability(r);
        let reflects = u_lobe.simd_lt(probability);
        let inverse = reflects.select(one, one / eta);
        let wi = m * reflects.select(cos_o + cos_o, cos_o / eta - cos_t) - wo * inverse;
        let wi = wi.normalize_or_zero();
        let mirrored = one / (f32x16::splat(4.0) * cos_o);
        let dm_dwi = reflects.select(mirrored, refraction_jacobian(cos_o, cos_t, eta));
        let share = reflects.select(r, (one - r) / (eta * eta));
        let probability = reflects.select(probability, one - probability);
        let pdf = self.microfacets.pdf(&wo, &m) * dm_dwi * probability;
        let factor = self.microfacets.g1(&wi, &m) * (share / probability);
        let onward = reflects.select(wi.z, -wi.z).simd_gt(zero);
        BsdfSampleX16 {
            wi: wi * side,
            weight: std::array::from_fn(|c| {
                reflects.select(self.reflectance[c], self.transmittance[c]) * factor
            }),
            pdf,
            eta: reflects.select(one, eta),
            valid: wo.z.simd_gt(zero) & cos_o.simd_gt(zero) & onward & pdf.simd_gt(zero),
        }
    }
}
