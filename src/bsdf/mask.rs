//! A BSDF with holes.

use super::{Bsdf, BsdfEval, BsdfSample, Lobe};
use crate::color::Rgb;
use crate::math::{Vec2, Vec3};
use crate::sampling::hash::probability_below;

/// A BSDF in a share of the surface; the rest lets light pass.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mask<'a> {
    /// The share, in [0, 1].
    pub opacity: f32,
    /// What scatters there.
    pub inner: &'a Bsdf<'a>,
}

/// Light that goes straight on.
pub(super) fn through(wo: Vec3) -> BsdfSample {
    BsdfSample { wi: -wo, weight: Rgb::WHITE, pdf: f32::INFINITY, lobe: Lobe::Specular, eta: 1.0 }
}

impl Mask<'_> {
    /// The probability with which the inner BSDF is sampled.
    pub(super) fn probability(&self) -> f32 {
        probability_below(self.opacity)
    }

    /// The sample that passes.
    pub(super) fn hole(&self, wo: Vec3) -> BsdfSample {
        let hole = through(wo);
        BsdfSample { weight: hole.weight * ((1.0 - self.opacity) / (1.0 - self.probability())), ..hole }
    }

    /// The inner BSDF's share.
    pub fn eval(&self, wo: Vec3, wi: Vec3) -> BsdfEval {
        let BsdfEval { f, pdf } = self.inner.eval(wo, wi);
        BsdfEval { f: f * self.opacity, pdf: pdf * self.probability() }
    }

    /// Passes with the probability of a hole, else samples the inner BSDF.
    pub fn sample(&self, wo: Vec3, u_lobe: f32, u: Vec2) -> Option<BsdfSample> {
        let probability = self.probability();
        if u_lobe >= probability {
            return Some(self.hole(wo));
        }
        let sample = self.inner.sample(wo, (u_lobe / probability).min(1f32.next_down()), u)?;
        let weight = sample.weight * (self.opacity / probability);
        Some(BsdfSample { weight, pdf: sample.pdf * probability, ..sample })
    }
}
