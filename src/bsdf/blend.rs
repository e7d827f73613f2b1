//! A linear combination of BSDFs.

use super::{Bsdf, BsdfEval, BsdfSample, Lobe};
use crate::color::Rgb;
use crate::math::{Vec2, Vec3};
use crate::sampling::hash::probability_below;

/// A linear combination of two BSDFs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Blend<'a> {
    /// Weight of the second BSDF, in [0, 1].
    pub weight: f32,
    /// The two BSDFs.
    pub bsdfs: [&'a Bsdf<'a>; 2],
}

impl<'a> Blend<'a> {
    /// Returns the probability of sampling the second BSDF.
    pub(super) fn probability(&self) -> f32 {
        probability_below(self.weight)
    }

    /// Returns the combination of values and densities.
    pub fn eval(&self, wo: Vec3, wi: Vec3) -> BsdfEval {
        let [a, b] = self.bsdfs.map(|bsdf| bsdf.eval(wo, wi));
        let (w, p) = (self.weight, self.probability());
        BsdfEval { f: a.f * (1.0 - w) + b.f * w, pdf: a.pdf * (1.0 - p) + b.pdf * p }
    }

    /// Chooses one BSDF by a random number. Returns the BSDF, the number rescaled to [0, 1), and the weight of the
    /// BSDF divided by its probability.
    pub(super) fn choose(&self, u_lobe: f32) -> (&'a Bsdf<'a>, f32, f32) {
        let (w, p) = (self.weight, self.probability());
        let (bsdf, u_lobe, share) = match u_lobe < p {
            true => (self.bsdfs[1], u_lobe / p, w / p),
            false => (self.bsdfs[0], (u_lobe - p) / (1.0 - p), (1.0 - w) / (1.0 - p)),
        };
        (bsdf, u_lobe.min(1f32.next_down()), share)
    }

    /// Chooses one BSDF by its weight and samples it. A finite lobe is weighted by both densities.
    pub fn sample(&self, wo: Vec3, u_lobe: f32, u: Vec2) -> Option<BsdfSample> {
        let (bsdf, u_lobe, share) = self.choose(u_lobe);
        let sample = bsdf.sample(wo, u_lobe, u)?;
        if sample.lobe == Lobe::Specular {
            return Some(BsdfSample { weight: sample.weight * share, ..sample });
        }
        let BsdfEval { f, pdf } = self.eval(wo, sample.wi);
        (pdf > 0.0).then(|| BsdfSample { weight: f * (sample.wi.z.abs() / pdf), pdf, ..sample })
    }

    /// Returns the combination of albedos.
    pub fn albedo(&self) -> Rgb {
        self.bsdfs[0].albedo() * (1.0 - self.weight) + self.bsdfs[1].albedo() * self.weight
    }
}
