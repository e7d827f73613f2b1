//! A diffuse base under a rough dielectric coating.

use super::facet::Facet;
use super::microfacet::Microfacets;
use super::{BsdfEval, BsdfSample, Lobe, RoughTransmittance, fresnel, plastic};
use crate::color::Rgb;
use crate::math::{Vec2, Vec3};
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
