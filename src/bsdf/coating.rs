//! A BSDF under a dielectric coating.

use super::facet::Facet;
use super::microfacet::Microfacets;
use super::two_sided::mirrored;
use super::{Bsdf, BsdfEval, BsdfSample, Lobe, Lobes, RoughTransmittance, SpecularLobe, fresnel};
use crate::color::Rgb;
use crate::math::{Vec2, Vec3};
use crate::sampling::hash::probability_below;

/// The largest random number below 1.
const LAST: f32 = 1f32.next_down();

/// Reflection by a coating, and a BSDF below it that light reaches by refraction. Both sides are coated.
///
/// Light that the coating reflects back inside is lost: `f = (1 − Fo)(1 − Fi)/η² · f'(ωo', ωi') · a`, where the primes
/// mark the directions inside the coating and `a` is the transmittance of its medium along both of them. If the
/// boundary is rough, `1 − F` is its transmittance, and light is refracted as by a smooth one.
/// [Weidlich & Wilkie 2007]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Coating<'a> {
    /// Index of refraction of the coating relative to that outside.
    pub eta: f32,
    /// The optical depth of the coating along its normal.
    pub depth: Rgb,
    /// A factor on the reflection by the coating.
    pub specular_reflectance: Rgb,
    /// The facets of the boundary; `None` if it is smooth.
    pub rough: Option<RoughBoundary<'a>>,
    /// The BSDF below. It does not transmit light.
    pub inner: &'a Bsdf<'a>,
}

/// A rough boundary.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RoughBoundary<'a> {
    /// The isotropic microfacet distribution.
    pub microfacets: Microfacets,
    /// The transmittance, for the same distribution and the index of the coating.
    pub transmittance: &'a RoughTransmittance,
}

/// A direction outside the coating, refracted.
#[derive(Clone, Copy)]
struct Refracted {
    /// The unit direction inside.
    w: Vec3,
    /// The reflectance of the coating.
    reflectance: f32,
}

impl Coating<'_> {
    /// Returns the reflectance of the coating for light at the cosine `cos` outside; `smooth` is that of a smooth one.
    fn reflectance(&self, cos: f32, smooth: f32) -> f32 {
        self.rough.map_or(smooth, |rough| 1.0 - rough.transmittance.external(cos))
    }

    /// Refracts a direction outside; `None` if all of its light is reflected.
    fn refract(&self, w: Vec3) -> Option<Refracted> {
        let refraction = fresnel::dielectric(w.z.abs(), self.eta);
        let reflectance = self.reflectance(w.z.abs(), refraction.reflectance);
        let w = Vec3::new(w.x / self.eta, w.y / self.eta, refraction.cos_t.copysign(w.z));
        (refraction.cos_t > 0.0).then_some(Refracted { w, reflectance })
    }

    /// Returns the direction outside of a direction inside the coating, and the reflectance; `None` if all of its
    /// light is reflected.
    fn leave(&self, w: Vec3) -> Option<(Vec3, Refracted)> {
        let refraction = fresnel::dielectric(w.z.abs(), 1.0 / self.eta);
        let out = Vec3::new(w.x * self.eta, w.y * self.eta, refraction.cos_t.copysign(w.z));
        let reflectance = self.reflectance(refraction.cos_t, refraction.reflectance);
        (refraction.cos_t > 0.0).then_some((out, Refracted { w, reflectance }))
    }

    /// Returns the reflectance of the coating for light from a direction outside.
    fn reflectance_of(&self, w: Vec3) -> f32 {
        self.reflectance(w.z.abs(), fresnel::dielectric(w.z.abs(), self.eta).reflectance)
    }

    /// Returns the lobes that may scatter light.
    pub(super) fn lobes(&self) -> Lobes {
        self.inner.lobes().and(if self.rough.is_some() { Lobes::GLOSSY } else { Lobes::deltas(1) })
    }

    /// Evaluates the reflection by the facets of the coating.
    fn eval_facets(&self, wo: Vec3, wi: Vec3) -> BsdfEval {
        let [wo, wi] = [wo, wi].map(|w| if wo.z < 0.0 { mirrored(w) } else { w });
        let facets = self.rough.zip(Facet::mirroring(wo, wi));
        let Some((RoughBoundary { microfacets, .. }, Facet { m, cos_o, dm_dwi, .. })) = facets else {
            return BsdfEval::ZERO;
        };
        let r = fresnel::dielectric(cos_o, self.eta).reflectance;
        let g = microfacets.g1(wo, m) * microfacets.g1(wi, m);
        BsdfEval {
            f: self.specular_reflectance * (r * microfacets.d(m) * g / (4.0 * wo.z * wi.z)),
            pdf: microfacets.pdf(wo, m) * dm_dwi,
        }
    }

    /// Returns the fraction of the light that is not lost on both ways through the coating.
    fn transmittance(&self, a: Refracted, b: Refracted) -> Rgb {
        let length = 1.0 / a.w.z.abs() + 1.0 / b.w.z.abs();
        let passing = (1.0 - a.reflectance) * (1.0 - b.reflectance);
        self.depth.map(|depth| (-depth * length).exp() * passing)
    }

    /// Returns the probability of sampling the coating, for its reflectance `r`.
    fn specular_probability(&self, r: f32) -> f32 {
        let inside = self.depth.map(|depth| (-2.0 * depth).exp()).mean() * (1.0 - r);
        let coating = r * self.specular_reflectance.mean();
        if coating + inside > 0.0 { probability_below(coating / (coating + inside)) } else { 1.0 }
    }

    /// Returns the density outside of the direction `w`, relative to that inside.
    fn compression(&self, outside: f32, inside: f32) -> f32 {
        outside / (self.eta * self.eta * inside)
    }

    /// Evaluates the finite lobes.
    pub fn eval(&self, wo: Vec3, wi: Vec3) -> BsdfEval {
        self.eval_by(wo, wi, |o, i| self.inner.eval(o, i))
    }

    /// Returns the density of [`sample_adjoint`](Self::sample_adjoint).
    pub(super) fn pdf_adjoint(&self, wo: Vec3, wi: Vec3) -> f32 {
        let inner = |o, i| BsdfEval { f: Rgb::BLACK, pdf: self.inner.pdf_adjoint(o, i) };
        self.eval_by(wo, wi, inner).pdf
    }

    fn eval_by(&self, wo: Vec3, wi: Vec3, inner: impl Fn(Vec3, Vec3) -> BsdfEval) -> BsdfEval {
        if wo.z * wi.z <= 0.0 {
            return BsdfEval::ZERO;
        }
        let probability = self.specular_probability(self.reflectance_of(wo));
        let facets = self.eval_facets(wo, wi);
        let facets = BsdfEval { f: facets.f, pdf: facets.pdf * probability };
        // Beyond the critical angle, light reaches only the facets.
        let Some((o, i)) = self.refract(wo).zip(self.refract(wi)) else { return facets };
        let inner = inner(o.w, i.w);
        let scale = 1.0 / (self.eta * self.eta);
        let below = inner.pdf * self.compression(wi.z, i.w.z);
        BsdfEval {
            f: inner.f * self.transmittance(o, i) * scale + facets.f,
            pdf: below * (1.0 - probability) + facets.pdf,
        }
    }

    /// Samples the reflection by the coating, or the BSDF below. If the coating is rough, a finite lobe is weighted by
    /// both densities.
    pub fn sample(&self, wo: Vec3, u_lobe: f32, u: Vec2) -> Option<BsdfSample> {
        let sample = self.sample_by(wo, u_lobe, u, |wo, u_lobe| self.inner.sample(wo, u_lobe, u))?;
        if self.rough.is_none() || sample.lobe == Lobe::Specular {
            return Some(sample);
        }
        let BsdfEval { f, pdf } = self.eval(wo, sample.wi);
        (pdf > 0.0).then(|| BsdfSample { weight: f * (sample.wi.z.abs() / pdf), pdf, ..sample })
    }

    /// Samples the direction towards the viewer (see [`Bsdf::sample_adjoint`]). If the coating is rough, weight and
    /// density include Dirac deltas only.
    pub(super) fn sample_adjoint(&self, wo: Vec3, u_lobe: f32, u: Vec2) -> Option<BsdfSample> {
        self.sample_by(wo, u_lobe, u, |wo, u_lobe| self.inner.sample_adjoint(wo, u_lobe, u))
    }

    /// Samples the coating or the BSDF below, and weights the sample by the density of that one alone.
    fn sample_by(
        &self,
        wo: Vec3,
        u_lobe: f32,
        u: Vec2,
        inner: impl Fn(Vec3, f32) -> Option<BsdfSample>,
    ) -> Option<BsdfSample> {
        if wo.z == 0.0 {
            return None;
        }
        let r = self.reflectance_of(wo);
        let probability = self.specular_probability(r);
        if let Some(RoughBoundary { microfacets, .. }) = self.rough.filter(|_| u_lobe < probability) {
            let upper = Vec3::new(wo.x, wo.y, wo.z.abs());
            let (wi, _) = Facet::mirror(upper, microfacets.sample(upper, u))?;
            let BsdfEval { f, pdf } = self.eval_facets(upper, wi);
            let weight = f * (wi.z / pdf);
            let wi = Vec3::new(wi.x, wi.y, wi.z.copysign(wo.z));
            let sample = BsdfSample { wi, weight, pdf, lobe: Lobe::Glossy, eta: 1.0 };
            return (pdf > 0.0).then_some(sample);
        }
        if u_lobe < probability {
            return Some(BsdfSample {
                wi: Vec3::new(-wo.x, -wo.y, wo.z),
                weight: self.specular_reflectance * (r / probability),
                pdf: f32::INFINITY,
                lobe: Lobe::Specular,
                eta: 1.0,
            });
        }
        let o = self.refract(wo)?;
        let below = 1.0 - probability;
        let sample = inner(o.w, ((u_lobe - probability) / below).min(LAST))?;
        let (wi, i) = self.leave(sample.wi)?;
        let pdf = sample.pdf * self.compression(wi.z, i.w.z) * below;
        Some(BsdfSample {
            wi,
            weight: sample.weight * self.transmittance(o, i) * (1.0 / below),
            pdf,
            ..sample
        })
    }

    /// Calls `found` for every Dirac delta (see [`Bsdf::specular_lobes`]).
    pub(super) fn specular_lobes(&self, wo: Vec3, found: &mut dyn FnMut(SpecularLobe)) {
        if wo.z == 0.0 {
            return;
        }
        let r = fresnel::dielectric(wo.z.abs(), self.eta).reflectance;
        let weight = self.specular_reflectance * r;
        if self.rough.is_none() && !weight.is_black() {
            found(SpecularLobe { wi: Vec3::new(-wo.x, -wo.y, wo.z), weight, eta: 1.0 });
        }
        let Some(o) = self.refract(wo) else { return };
        self.inner.specular_lobes(o.w, &mut |lobe| {
            if let Some((wi, i)) = self.leave(lobe.wi) {
                found(SpecularLobe { wi, weight: lobe.weight * self.transmittance(o, i), ..lobe });
            }
        });
    }

    /// Returns the reflection at normal incidence plus that of the BSDF below.
    pub fn albedo(&self) -> Rgb {
        let r = fresnel::dielectric(1.0, self.eta).reflectance;
        let through = self.depth.map(|depth| (-2.0 * depth).exp()) * ((1.0 - r) * (1.0 - r));
        self.specular_reflectance * r + self.inner.albedo() * through
    }
}
