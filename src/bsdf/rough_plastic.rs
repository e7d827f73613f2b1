//! A diffuse base under a rough dielectric coating.

use super::facet::Facet;
use super::microfacet::{Distribution, Microfacets};
use super::{BsdfEval, BsdfSample, Lobe, fresnel, plastic};
use crate::color::Rgb;
use crate::math::{Vec2, Vec3};
use crate::sampling::warp;
use std::f32::consts::FRAC_1_PI;

/// Reflection by a coating of microfacets, and diffuse reflection of the light that enters and leaves it. The back is
/// black.
///
/// The base is as in [`Plastic`](super::Plastic), with the transmittance of a rough boundary.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RoughPlastic<'a> {
    /// The coating's facets, isotropic.
    pub microfacets: Microfacets,
    /// Share of the light that the base reflects.
    pub diffuse_reflectance: Rgb,
    /// A factor on the reflection by the coating.
    pub specular_reflectance: Rgb,
    /// Index of refraction of the coating over that outside.
    pub eta: f32,
    /// Whether light that is reflected several times takes on the base's colour several times.
    pub nonlinear: bool,
    /// What the coating lets pass, for the same facets and index.
    pub transmittance: &'a RoughTransmittance,
}

impl RoughPlastic<'_> {
    fn base(&self) -> Rgb {
        plastic::base(self.diffuse_reflectance, self.transmittance.internal, self.eta, self.nonlinear)
    }

    fn specular_probability(&self, t_o: f32) -> f32 {
        plastic::specular_probability(self.diffuse_reflectance, self.specular_reflectance, 1.0 - t_o)
    }

    /// Coating and base.
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

    /// Samples the coating or the base, weighted by the sum of both.
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

    /// The mean facet, and the base by uniform light.
    pub fn albedo(&self) -> Rgb {
        let r = fresnel::dielectric(1.0, self.eta).reflectance;
        let entering = self.transmittance.external(1.0) * self.transmittance.external_mean();
        self.specular_reflectance * r + self.base() * entering
    }
}

/// What a rough dielectric boundary lets pass from outside, and what it throws back from inside.
#[derive(Clone, Debug, PartialEq)]
pub struct RoughTransmittance {
    /// Transmittance at cosines that divide [0, 1] evenly.
    external: [f32; RESOLUTION],
    /// The share of diffuse light from inside that is thrown back.
    internal: f32,
}

const RESOLUTION: usize = 64;

impl RoughTransmittance {
    /// Integrates over the visible facets, which takes some tens of milliseconds. `eta` is the index below over that
    /// outside.
    pub fn new(distribution: Distribution, alpha: f32, eta: f32) -> Self {
        let facets = Microfacets { distribution, alpha_x: alpha, alpha_y: alpha, sample_visible: true };
        let mut external = [0.0; RESOLUTION];
        let mut internal = 0.0;
        for (i, t) in external.iter_mut().enumerate() {
            let cos = (i as f32 / (RESOLUTION - 1) as f32).max(1e-6);
            *t = transmittance(&facets, cos, eta) as f32;
            // A mean of samples, ends included, that is no quadrature but what the scene language means.
            internal += 2.0 * f64::from(cos) * reflectance(&facets, cos, 1.0 / eta) / RESOLUTION as f64;
        }
        RoughTransmittance { external, internal: internal as f32 }
    }

    /// The share of light at the cosine `cos` outside that enters, interpolated linearly.
    pub fn external(&self, cos: f32) -> f32 {
        let x = cos * (RESOLUTION - 1) as f32;
        let i = (x as usize).min(RESOLUTION - 2);
        let w = x - i as f32;
        self.external[i] * (1.0 - w) + self.external[i + 1] * w
    }

    /// The share of diffuse light outside that enters.
    fn external_mean(&self) -> f32 {
        let n = 2 * RESOLUTION;
        let term = |i: usize| {
            let cos = (i as f32 + 0.5) / n as f32;
            2.0 * cos * self.external(cos) / n as f32
        };
        (0..n).map(term).sum()
    }
}

/// The mean of `value` over the facets that are visible at the cosine `cos`.
fn mean_over_facets(facets: &Microfacets, cos: f32, n: u32, value: impl Fn(Vec3, Vec3) -> f32) -> f64 {
    let wo = Vec3::new((1.0 - cos * cos).sqrt(), 0.0, cos);
    // Midpoints of t in u = t²(3 − 2t): the slopes go to infinity at the ends of u, the weights 6t(1 − t) to zero.
    let nodes: Vec<(f32, f64)> = (0..n)
        .map(|i| {
            let t = (f64::from(i) + 0.5) / f64::from(n);
            ((t * t * (3.0 - 2.0 * t)) as f32, 6.0 * t * (1.0 - t) / f64::from(n))
        })
        .collect();
    let mut sum = 0.0;
    for &(x, weight_x) in &nodes {
        for &(y, weight_y) in &nodes {
            let m = facets.sample(wo, Vec2::new(x, y));
            sum += weight_x * weight_y * f64::from(value(wo, m));
        }
    }
    sum
}

fn transmittance(facets: &Microfacets, cos: f32, eta: f32) -> f64 {
    mean_over_facets(facets, cos, nodes(eta), |wo, m| {
        let r = fresnel::dielectric(wo.dot(m).max(0.0), eta);
        Facet::refract(wo, m, r.cos_t, eta).map_or(0.0, |(wi, _)| (1.0 - r.reflectance) * facets.g1(wi, m))
    })
}

fn reflectance(facets: &Microfacets, cos: f32, eta: f32) -> f64 {
    mean_over_facets(facets, cos, nodes(eta), |wo, m| {
        let r = fresnel::dielectric(wo.dot(m).max(0.0), eta).reflectance;
        Facet::mirror(wo, m).map_or(0.0, |(wi, _)| r * facets.g1(wi, m))
    })
}

/// More nodes where total reflection begins with a kink.
fn nodes(eta: f32) -> u32 {
    if eta > 1.0 { 32 } else { 64 }
}
