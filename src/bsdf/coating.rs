//! A BSDF under a smooth dielectric coating.

use super::{Bsdf, BsdfEval, BsdfSample, Lobe, SpecularLobe, fresnel};
use crate::color::Rgb;
use crate::math::{Vec2, Vec3};
use crate::sampling::hash::probability_below;

/// The largest random number below 1.
const LAST: f32 = 1f32.next_down();

/// Specular reflection by a coating, and a BSDF below it that light reaches by refraction. The back side is black.
///
/// Light that the coating reflects back inside is lost: `f = (1 − Fo)(1 − Fi)/η² · f'(ωo', ωi') · a`, where the primes
/// mark the directions inside the coating and `a` is the transmittance of its medium along both of them.
/// [Weidlich & Wilkie 2007]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Coating<'a> {
    /// Index of refraction of the coating relative to that outside.
    pub eta: f32,
    /// The optical depth of the coating along its normal.
    pub depth: Rgb,
    /// A factor on the reflection by the coating.
    pub specular_reflectance: Rgb,
    /// The BSDF below. It does not transmit light.
    pub inner: &'a Bsdf<'a>,
}

/// A direction outside the coating, refracted.
#[derive(Clone, Copy)]
struct Refracted {
    /// The unit direction inside.
    w: Vec3,
    /// The Fresnel reflectance of the coating.
    reflectance: f32,
}

impl Coating<'_> {
    /// Refracts a direction above the surface; `None` if all of its light is reflected.
    fn refract(&self, w: Vec3) -> Option<Refracted> {
        let refraction = fresnel::dielectric(w.z, self.eta);
        let w = Vec3::new(w.x / self.eta, w.y / self.eta, refraction.cos_t);
        (refraction.cos_t > 0.0).then_some(Refracted { w, reflectance: refraction.reflectance })
    }

    /// Returns the direction outside of a direction inside the coating, and the Fresnel reflectance; `None` if all of
    /// its light is reflected.
    fn leave(&self, w: Vec3) -> Option<(Vec3, Refracted)> {
        let refraction = fresnel::dielectric(w.z, 1.0 / self.eta);
        let out = Vec3::new(w.x * self.eta, w.y * self.eta, refraction.cos_t);
        let leaves = w.z > 0.0 && refraction.cos_t > 0.0;
        leaves.then_some((out, Refracted { w, reflectance: refraction.reflectance }))
    }

    /// Returns the fraction of the light that is not lost on both ways through the coating.
    fn transmittance(&self, a: Refracted, b: Refracted) -> Rgb {
        let length = 1.0 / a.w.z + 1.0 / b.w.z;
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
        let Some([o, i]) = self.refract_both(wo, wi) else { return BsdfEval::ZERO };
        let inner = self.inner.eval(o.w, i.w);
        let scale = 1.0 / (self.eta * self.eta);
        BsdfEval {
            f: inner.f * self.transmittance(o, i) * scale,
            pdf: inner.pdf * self.compression(wi.z, i.w.z) * (1.0 - self.specular_probability(o.reflectance)),
        }
    }

    /// Returns the density of [`sample_adjoint`](Self::sample_adjoint).
    pub(super) fn pdf_adjoint(&self, wo: Vec3, wi: Vec3) -> f32 {
        let Some([o, i]) = self.refract_both(wo, wi) else { return 0.0 };
        let pdf = self.inner.pdf_adjoint(o.w, i.w) * self.compression(wi.z, i.w.z);
        pdf * (1.0 - self.specular_probability(o.reflectance))
    }

    fn refract_both(&self, wo: Vec3, wi: Vec3) -> Option<[Refracted; 2]> {
        if wo.z <= 0.0 || wi.z <= 0.0 {
            return None;
        }
        Some([self.refract(wo)?, self.refract(wi)?])
    }

    /// Samples the reflection by the coating, or the BSDF below.
    pub fn sample(&self, wo: Vec3, u_lobe: f32, u: Vec2) -> Option<BsdfSample> {
        self.sample_by(wo, u_lobe, |wo, u_lobe| self.inner.sample(wo, u_lobe, u))
    }

    /// Samples the direction towards the viewer (see [`Bsdf::sample_adjoint`]).
    pub(super) fn sample_adjoint(&self, wo: Vec3, u_lobe: f32, u: Vec2) -> Option<BsdfSample> {
        self.sample_by(wo, u_lobe, |wo, u_lobe| self.inner.sample_adjoint(wo, u_lobe, u))
    }

    fn sample_by(
        &self,
        wo: Vec3,
        u_lobe: f32,
        inner: impl Fn(Vec3, f32) -> Option<BsdfSample>,
    ) -> Option<BsdfSample> {
        if wo.z <= 0.0 {
            return None;
        }
        let r = fresnel::dielectric(wo.z, self.eta).reflectance;
        let probability = self.specular_probability(r);
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
        if wo.z <= 0.0 {
            return;
        }
        let r = fresnel::dielectric(wo.z, self.eta).reflectance;
        let weight = self.specular_reflectance * r;
        if !weight.is_black() {
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
