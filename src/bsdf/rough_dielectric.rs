//! A rough boundary between two dielectrics. [Walter 2007]

use super::facet::Facet;
use super::fresnel::dielectric_x16;
use super::lanes::{BsdfEvalX16, BsdfSampleX16, Kernel, LaneBsdfs};
use super::microfacet::{Microfacets, MicrofacetsX16};
use super::{Bsdf, BsdfEval, BsdfSample, Dielectric, Lobe, fresnel, mask};
use crate::color::Rgb;
use crate::math::lanes::with_sign;
use crate::math::{Vec2, Vec3, Vec3x16, f32x16};
use crate::sampling::hash::{probability_below, probability_below_x16};

/// Reflection and refraction of radiance at a boundary with a microfacet distribution.
///
/// With equal indices, all light passes unchanged, for any roughness.
///
/// The model has single scattering only: light that hits a second facet is lost. The table shows the remaining
/// fraction of the energy for an index of 1.5, at cosines of 1, 0.5 and 0.1 from above and from below:
///
/// | facets | above | below |
/// | --- | --- | --- |
/// | Beckmann 0.1 | 1.000, 1.000, 0.934 | 1.000, 1.000, 0.912 |
/// | Beckmann 0.3 | 1.000, 0.978, 0.956 | 1.000, 0.881, 0.931 |
/// | Beckmann 0.5 | 0.997, 0.963, 0.953 | 0.962, 0.770, 0.922 |
/// | Beckmann 1 | 0.967, 0.906, 0.752 | 0.544, 0.625, 0.668 |
/// | GGX 0.1 | 0.999, 0.992, 0.916 | 0.989, 0.963, 0.853 |
/// | GGX 0.3 | 0.989, 0.947, 0.850 | 0.900, 0.780, 0.740 |
/// | GGX 0.5 | 0.968, 0.883, 0.704 | 0.754, 0.643, 0.604 |
/// | GGX 1 | 0.893, 0.672, 0.400 | 0.417, 0.453, 0.342 |
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RoughDielectric {
    /// The microfacet distribution.
    pub microfacets: Microfacets,
    /// Index of refraction below the surface (−z) relative to that above it.
    pub eta: f32,
    /// A factor on the reflection.
    pub specular_reflectance: Rgb,
    /// A factor on the transmission.
    pub specular_transmittance: Rgb,
}

impl RoughDielectric {
    /// Returns whether all light passes unchanged, because both sides have the same index.
    pub fn is_passing(&self) -> bool {
        self.eta == 1.0
    }

    /// Returns the index of the far side relative to that of wo's side.
    fn eta_from(&self, wo: Vec3) -> f32 {
        if wo.z > 0.0 { self.eta } else { 1.0 / self.eta }
    }

    /// Returns the probability with which a facet reflects a sample, in proportion to reflected and transmitted
    /// light.
    fn reflection_probability(&self, reflectance: f32) -> f32 {
        let reflected = reflectance * self.specular_reflectance.max_component();
        let transmitted = (1.0 - reflectance) * self.specular_transmittance.max_component();
        let total = reflected + transmitted;
        if total > 0.0 { probability_below(reflected / total) } else { 1.0 }
    }

    /// Evaluates reflection by [Walter 2007, Eq. 20] and transmission by Eq. 21 divided by the squared ratio of the
    /// indices, because radiance is transported. [Veach 1997, Eq. 5.2]
    pub fn eval(&self, wo: Vec3, wi: Vec3) -> BsdfEval {
        if wo.z * wi.z == 0.0 || self.is_passing() {
            return BsdfEval::ZERO;
        }
        let eta = self.eta_from(wo);
        // Both sides are equivalent, so wo's side becomes the upper one.
        let side = 1f32.copysign(wo.z);
        let (wo, wi) = (wo * side, wi * side);
        let reflects = wi.z > 0.0;
        let facet = if reflects { Facet::mirroring(wo, wi) } else { Facet::refracting(wo, wi, eta) };
        let Some(Facet { m, cos_o, dm_dwi, .. }) = facet else { return BsdfEval::ZERO };
        let d = self.microfacets.d(m);
        if d == 0.0 {
            return BsdfEval::ZERO;
        }
        let g = self.microfacets.g1(wo, m) * self.microfacets.g1(wi, m);
        let r = fresnel::dielectric(cos_o, eta).reflectance;
        // Both equations have this form with their own Jacobian.
        let value = d * g * cos_o * dm_dwi / (wo.z * wi.z.abs());
        let pdf = self.microfacets.pdf(wo, m) * dm_dwi;
        let probability = self.reflection_probability(r);
        if reflects {
            BsdfEval { f: self.specular_reflectance * (value * r), pdf: pdf * probability }
        } else {
            let value = value * (1.0 - r) / (eta * eta);
            BsdfEval { f: self.specular_transmittance * value, pdf: pdf * (1.0 - probability) }
        }
    }

    /// Samples a facet and reflects or refracts `wo` by it, with the probability of the facet's Fresnel term.
    pub fn sample(&self, wo: Vec3, u_lobe: f32, u: Vec2) -> Option<BsdfSample> {
        if wo.z == 0.0 {
            return None;
        }
        if self.is_passing() {
            return Some(BsdfSample { weight: self.specular_transmittance, ..mask::unscattered(wo) });
        }
        let eta = self.eta_from(wo);
        let side = 1f32.copysign(wo.z);
        let wo = wo * side;
        let m = self.microfacets.sample(wo, u);
        let r = fresnel::dielectric(wo.dot(m).max(0.0), eta);
        let probability = self.reflection_probability(r.reflectance);
        let (wi, facet, weight, probability, eta) = if u_lobe < probability {
            let (wi, facet) = Facet::mirror(wo, m)?;
            let weight = self.specular_reflectance * (r.reflectance / probability);
            (wi, facet, weight, probability, 1.0)
        } else {
            let (wi, facet) = Facet::refract(wo, m, r.cos_t, eta)?;
            let probability = 1.0 - probability;
            let share = (1.0 - r.reflectance) / (probability * eta * eta);
            (wi, facet, self.specular_transmittance * share, probability, eta)
        };
        let pdf = self.microfacets.pdf(wo, m) * facet.dm_dwi * probability;
        // G·(wo·m)·D/(cosθo·pdf(m)) with D cancelled, because D overflows and underflows for small roughness.
        let g1 = self.microfacets.g1(wi, m);
        let g = match self.microfacets.sample_visible {
            true => g1,
            false => g1 * self.microfacets.g1(wo, m) * facet.cos_o / (wo.z * m.z),
        };
        (pdf > 0.0).then_some(BsdfSample { wi: wi * side, weight: weight * g, pdf, lobe: Lobe::Glossy, eta })
    }

    /// Returns the albedo of the smooth boundary.
    pub fn albedo(&self) -> Rgb {
        let RoughDielectric { eta, specular_reflectance, specular_transmittance, .. } = *self;
        Dielectric { eta, specular_reflectance, specular_transmittance }.albedo()
    }
}

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

impl<'a> Kernel<'a> for RoughDielectricX16 {
    type Scalar = RoughDielectric;

    fn of(bsdf: &'a Bsdf<'a>) -> Option<&'a RoughDielectric> {
        match bsdf {
            Bsdf::RoughDielectric(b) if b.microfacets.sample_visible && !b.is_passing() => Some(b),
            _ => None,
        }
    }

    fn alike(a: &RoughDielectric, b: &RoughDielectric) -> bool {
        a.microfacets.distribution == b.microfacets.distribution
    }

    #[inline(always)]
    fn gather(lanes: &LaneBsdfs<'a, RoughDielectric>) -> Self {
        RoughDielectricX16 {
            microfacets: MicrofacetsX16::gather(lanes, |b| b.microfacets),
            eta: lanes.numbers(|b| b.eta),
            reflectance: lanes.colors(|b| b.specular_reflectance),
            transmittance: lanes.colors(|b| b.specular_transmittance),
            strongest: [
                lanes.numbers(|b| b.specular_reflectance.max_component()),
                lanes.numbers(|b| b.specular_transmittance.max_component()),
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
