//! Diffuse reflection below a smooth boundary plus reflection by a rough one, for unpolarised light. [Baek 2018]

use super::facet::Facet;
use super::microfacet::Microfacets;
use super::plastic::specular_probability;
use super::{BsdfEval, BsdfSample, Lobe, fresnel};
use crate::color::Rgb;
use crate::math::{Vec2, Vec3};
use crate::sampling::warp;
use std::f32::consts::FRAC_1_PI;

/// Microfacet reflection, and diffuse reflection of the light that a smooth boundary lets in and out. The back side is
/// black.
///
/// In contrast to [`RoughPlastic`](super::RoughPlastic), light that the boundary reflects back inside is lost.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PolarizedPlastic {
    /// The distribution of the facets that reflect.
    pub microfacets: Microfacets,
    /// Fraction of the light inside that is reflected.
    pub diffuse_reflectance: Rgb,
    /// A factor on the reflection by facets.
    pub specular_reflectance: Rgb,
    /// Index of refraction inside relative to that outside.
    pub eta: f32,
}

impl PolarizedPlastic {
    /// Returns the fraction of light that crosses the smooth boundary.
    pub(super) fn transmittance(&self, cos: f32) -> f32 {
        1.0 - fresnel::dielectric(cos, self.eta).reflectance
    }

    pub(super) fn specular_probability(&self) -> f32 {
        specular_probability(self.diffuse_reflectance, self.specular_reflectance, 0.5)
    }

    /// Evaluates both parts.
    pub fn eval(&self, wo: Vec3, wi: Vec3) -> BsdfEval {
        if wo.z <= 0.0 || wi.z <= 0.0 {
            return BsdfEval::ZERO;
        }
        let probability = self.specular_probability();
        let mut sum = BsdfEval {
            f: self.diffuse_reflectance * (FRAC_1_PI * self.transmittance(wo.z) * self.transmittance(wi.z)),
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

    /// Samples one part, weighted by the sum of both densities.
    pub fn sample(&self, wo: Vec3, u_lobe: f32, u: Vec2) -> Option<BsdfSample> {
        if wo.z <= 0.0 {
            return None;
        }
        let (wi, lobe) = match u_lobe < self.specular_probability() {
            true => (Facet::mirror(wo, self.microfacets.sample(wo, u))?.0, Lobe::Glossy),
            false => (warp::square_to_cosine_hemisphere(u), Lobe::Diffuse),
        };
        let BsdfEval { f, pdf } = self.eval(wo, wi);
        (pdf > 0.0).then(|| BsdfSample { wi, weight: f * (wi.z / pdf), pdf, lobe, eta: 1.0 })
    }

    /// Returns the albedo of the mean facet plus that of the diffuse part under uniform light.
    pub fn albedo(&self) -> Rgb {
        let r = fresnel::dielectric(1.0, self.eta).reflectance;
        let entering = self.transmittance(1.0) * (1.0 - fresnel::diffuse_reflectance(self.eta));
        self.specular_reflectance * r + self.diffuse_reflectance * entering
    }
}
