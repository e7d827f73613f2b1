//! Two BSDFs in parts.

use super::{Bsdf, BsdfEval, BsdfSample, Lobe};
use crate::color::Rgb;
use crate::math::{Vec2, Vec3};

/// A linear combination of two BSDFs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Blend<'a> {
    /// Share of the second, in [0, 1].
    pub weight: f32,
    /// The two.
    pub bsdfs: [&'a Bsdf<'a>; 2],
}

impl Blend<'_> {
    /// The combination of values, and of densities.
    pub fn eval(&self, wo: Vec3, wi: Vec3) -> BsdfEval {
        let [a, b] = self.bsdfs.map(|bsdf| bsdf.eval(wo, wi));
        let w = self.weight;
        BsdfEval { f: a.f * (1.0 - w) + b.f * w, pdf: a.pdf * (1.0 - w) + b.pdf * w }
    }

    /// Chooses one of the two by its share and samples it; a finite lobe is weighted by both densities.
    pub fn sample(&self, wo: Vec3, u_lobe: f32, u: Vec2) -> Option<BsdfSample> {
        let w = self.weight;
        let (bsdf, u_lobe) = match u_lobe < w {
            true => (self.bsdfs[1], u_lobe / w),
            false => (self.bsdfs[0], (u_lobe - w) / (1.0 - w)),
        };
        let sample = bsdf.sample(wo, u_lobe.min(1f32.next_down()), u)?;
        if sample.lobe == Lobe::Specular {
            return Some(sample);
        }
        let BsdfEval { f, pdf } = self.eval(wo, sample.wi);
        (pdf > 0.0).then(|| BsdfSample { weight: f * (sample.wi.z.abs() / pdf), pdf, ..sample })
    }

    /// The combination of albedos.
    pub fn albedo(&self) -> Rgb {
        self.bsdfs[0].albedo() * (1.0 - self.weight) + self.bsdfs[1].albedo() * self.weight
    }
}
