//! A rough conductor with a microfacet distribution. [Walter 2007]

use super::fresnel::ConductorFresnel;
use super::microfacet::Microfacets;
use super::{BsdfEval, BsdfSample, Lobe};
use crate::color::Rgb;
use crate::math::{Vec2, Vec3};

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
