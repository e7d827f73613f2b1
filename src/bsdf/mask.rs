//! A BSDF with holes.

use super::{Bsdf, BsdfEval, BsdfSample, Lobe};
use crate::color::Rgb;
use crate::math::{Vec2, Vec3};
use crate::sampling::hash::probability_below;

/// A BSDF on a fraction of the surface; the remaining light passes unchanged.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mask<'a> {
    /// The fraction, in [0, 1].
    pub opacity: f32,
    /// The BSDF on that fraction.
    pub inner: &'a Bsdf<'a>,
}

/// Returns the sample of unscattered light.
pub(super) fn unscattered(wo: Vec3) -> BsdfSample {
    BsdfSample { wi: -wo, weight: Rgb::WHITE, pdf: f32::INFINITY, lobe: Lobe::Specular, eta: 1.0 }
}

impl Mask<'_> {
    /// Returns the probability of sampling the inner BSDF.
    pub(super) fn probability(&self) -> f32 {
        probability_below(self.opacity)
    }

    /// Returns the sample of light that passes through a hole.
    pub(super) fn hole(&self, wo: Vec3) -> BsdfSample {
        let hole = unscattered(wo);
        BsdfSample { weight: hole.weight * ((1.0 - self.opacity) / (1.0 - self.probability())), ..hole }
    }

    /// Returns the inner BSDF times the opacity.
    pub fn eval(&self, wo: Vec3, wi: Vec3) -> BsdfEval {
        let BsdfEval { f, pdf } = self.inner.eval(wo, wi);
        BsdfEval { f: f * self.opacity, pdf: pdf * self.probability() }
    }

    /// Passes through with the probability of a hole, otherwise samples the inner BSDF.
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
