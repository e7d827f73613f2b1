//! A diffuse base under a rough dielectric coating.

use super::facet::Facet;
use super::fresnel::dielectric_x16;
use super::lanes::{BsdfEvalX16, BsdfSampleX16, Kernel, LaneBsdfs};
use super::microfacet::{Microfacets, MicrofacetsX16};
use super::plastic::{self, Coated, CoatedX16};
use super::{Bsdf, BsdfEval, BsdfSample, Lobe, RoughTransmittance, fresnel};
use crate::color::Rgb;
use crate::math::lanes::each_lane;
use crate::math::{LANES, Vec2, Vec3, Vec3x16, f32x16};
use crate::sampling::warp;
use std::f32::consts::FRAC_1_PI;

/// Microfacet reflection by a coating, and diffuse reflection of the light that enters and leaves it. The back side
/// is black.
///
/// The base is as in [`Plastic`](super::Plastic), with the transmittance of a rough boundary.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RoughPlastic<'a> {
    /// The isotropic microfacet distribution of the coating.
    pub microfacets: Microfacets,
    /// Fraction of the light that the base reflects.
    pub diffuse_reflectance: Rgb,
    /// A factor on the reflection by the coating.
    pub specular_reflectance: Rgb,
    /// Index of refraction of the coating relative to that outside.
    pub eta: f32,
    /// Whether multiple scattering multiplies the base's colour several times.
    pub nonlinear: bool,
    /// The transmittance of the coating, for the same distribution and index.
    pub transmittance: &'a RoughTransmittance,
}

impl RoughPlastic<'_> {
    pub(super) fn base(&self) -> Rgb {
        plastic::base(self.diffuse_reflectance, self.transmittance.internal(), self.eta, self.nonlinear)
    }

    /// Returns the share of the coating in the reflection of light from `wo`, as the probability of sampling it.
    pub(super) fn specular_share(&self, wo: Vec3) -> f32 {
        self.specular_probability(self.transmittance.external(wo.z))
    }

    fn specular_probability(&self, t_o: f32) -> f32 {
        plastic::specular_probability(self.diffuse_reflectance, self.specular_reflectance, 1.0 - t_o)
    }

    /// Evaluates coating and base.
    pub fn eval(&self, wo: Vec3, wi: Vec3) -> BsdfEval {
        if wo.z <= 0.0 || wi.z <= 0.0 {
            return BsdfEval::ZERO;
        }
        let [t_o, t_i] = [wo, wi].map(|w| self.transmittance.external(w.z));
        let probability = self.specular_probability(t_o);
        let mut sum = BsdfEval {
            f: self.base() * (FRAC_1_PI * t_o * t_i),
            pdf: (1.0 - probability) * warp::square_to_cosine_hemisphere_pdf(wi),
        };
        if let Some(Facet { m, cos_o, dm_dwi, .. }) = Facet::mirroring(wo, wi) {
            let r = fresnel::dielectric(cos_o, self.eta).reflectance;
            let g = self.microfacets.g1(wo, m) * self.microfacets.g1(wi, m);
            sum.f += self.specular_reflectance * (r * self.microfacets.d(m) * g / (4.0 * wo.z * wi.z));
            sum.pdf += probability * self.microfacets.pdf(wo, m) * dm_dwi;
        }
        sum
    }

    /// Samples the coating or the base, weighted by the sum of both densities.
    pub fn sample(&self, wo: Vec3, u_lobe: f32, u: Vec2) -> Option<BsdfSample> {
        if wo.z <= 0.0 {
            return None;
        }
        let probability = self.specular_probability(self.transmittance.external(wo.z));
        let (wi, lobe) = match u_lobe < probability {
            true => (Facet::mirror(wo, self.microfacets.sample(wo, u))?.0, Lobe::Glossy),
            false => (warp::square_to_cosine_hemisphere(u), Lobe::Diffuse),
        };
        let BsdfEval { f, pdf } = self.eval(wo, wi);
        (pdf > 0.0).then(|| BsdfSample { wi, weight: f * (wi.z / pdf), pdf, lobe, eta: 1.0 })
    }

    /// Returns the albedo of the mean facet plus that of the base under uniform light.
    pub fn albedo(&self) -> Rgb {
        let r = fresnel::dielectric(1.0, self.eta).reflectance;
        let entering = self.transmittance.external(1.0) * self.transmittance.external_mean();
        self.specular_reflectance * r + self.base() * entering
    }
}

/// A [`RoughPlastic`] in each of sixteen lanes.
pub struct RoughPlasticX16<'a> {
    microfacets: MicrofacetsX16,
    coated: CoatedX16,
    transmittance: [&'a RoughTransmittance; LANES],
}

impl RoughPlasticX16<'_> {
    /// Computes [`RoughTransmittance::external`] in each lane.
    #[inline(always)]
    fn external(&self, cos: f32x16) -> f32x16 {
        let cos = cos.as_array();
        f32x16::new(each_lane(|i| self.transmittance[i].external(cos[i])))
    }

    /// Computes [`RoughPlastic::eval`] in each lane, for the transmittance of `wo` and the probability of sampling the
    /// coating.
    #[inline(always)]
    fn eval_with(&self, wo: &Vec3x16, wi: &Vec3x16, t_o: f32x16, probability: f32x16) -> BsdfEvalX16 {
        let (zero, one, four) = (f32x16::ZERO, f32x16::ONE, f32x16::splat(4.0));
        let inverse_pi = f32x16::splat(FRAC_1_PI);
        let above = wo.z.simd_gt(zero) & wi.z.simd_gt(zero);
        let m = (*wo + *wi).normalize_or_zero();
        let cos = wo.dot(m);
        let (r, _) = dielectric_x16(cos, self.coated.eta);
        let g1_o = self.microfacets.g1(wo, &m);
        let d = self.microfacets.d(&m);
        let joined = above & cos.simd_gt(zero);
        let coating = (r * d * (g1_o * self.microfacets.g1(wi, &m)) / (four * wo.z * wi.z)) & joined;
        let facets = (d * g1_o / (four * wo.z)) & joined;
        let base = (inverse_pi * t_o * self.external(wi.z)) & above;
        BsdfEvalX16 {
            f: std::array::from_fn(|c| self.coated.base[c] * base + self.coated.specular[c] * coating),
            pdf: (((one - probability) * (wi.z * inverse_pi)) & above) + probability * facets,
        }
    }
}

impl<'a> Kernel<'a> for RoughPlasticX16<'a> {
    type Scalar = RoughPlastic<'a>;

    fn of(bsdf: &'a Bsdf<'a>) -> Option<&'a RoughPlastic<'a>> {
        match bsdf {
            Bsdf::RoughPlastic(b) if b.microfacets.sample_visible && b.eta != 1.0 => Some(b),
            _ => None,
        }
    }

    fn alike(a: &RoughPlastic<'a>, b: &RoughPlastic<'a>) -> bool {
        a.microfacets.distribution == b.microfacets.distribution
    }

    #[inline(always)]
    fn gather(lanes: &LaneBsdfs<'a, RoughPlastic<'a>>) -> Self {
        RoughPlasticX16 {
            microfacets: MicrofacetsX16::gather(lanes, |b| b.microfacets),
            coated: CoatedX16::gather(lanes, |b| Coated {
                base: b.diffuse_reflectance,
                coating: b.specular_reflectance,
                internal: b.transmittance.internal(),
                eta: b.eta,
                nonlinear: b.nonlinear,
            }),
            transmittance: each_lane(|i| lanes.bsdfs[i].transmittance),
        }
    }

    #[inline(always)]
    fn eval(&self, wo: &Vec3x16, wi: &Vec3x16) -> BsdfEvalX16 {
        let t_o = self.external(wo.z);
        self.eval_with(wo, wi, t_o, self.coated.specular_probability(f32x16::ONE - t_o))
    }

    #[inline(always)]
    fn sample(&self, wo: &Vec3x16, u_lobe: f32x16, u: [f32x16; 2]) -> BsdfSampleX16 {
        let zero = f32x16::ZERO;
        let t_o = self.external(wo.z);
        let probability = self.coated.specular_probability(f32x16::ONE - t_o);
        let m = self.microfacets.sample(wo, u);
        let cos = wo.dot(m);
        let mirrored = (m * (cos + cos) - *wo).normalize_or_zero();
        let mirrors = u_lobe.simd_lt(probability);
        let wi = Vec3x16::select(mirrors, mirrored, warp::square_to_cosine_hemisphere_x16(u));
        let BsdfEvalX16 { f, pdf } = self.eval_with(wo, &wi, t_o, probability);
        let factor = wi.z / pdf;
        let visible = (cos.simd_gt(zero) & wi.z.simd_gt(zero)) | !mirrors;
        BsdfSampleX16 {
            wi,
            weight: f.map(|f| f * factor),
            pdf,
            eta: f32x16::ONE,
            valid: wo.z.simd_gt(zero) & visible & pdf.simd_gt(zero),
        }
    }
}
