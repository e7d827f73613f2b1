//! A BSDF for each side of a surface.

use super::{Bsdf, BsdfEval, BsdfSample};
use crate::math::{Vec2, Vec3};

/// One-sided BSDFs on front and back. For the back, the local frame is mirrored at the surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TwoSided<'a> {
    /// The BSDF of the front and that of the back.
    pub sides: [&'a Bsdf<'a>; 2],
}

/// Returns a direction mirrored at the surface.
pub fn mirrored(w: Vec3) -> Vec3 {
    Vec3::new(w.x, w.y, -w.z)
}

impl TwoSided<'_> {
    /// Evaluates the BSDF of the side of `wo`.
    pub fn eval(&self, wo: Vec3, wi: Vec3) -> BsdfEval {
        match wo.z >= 0.0 {
            true => self.sides[0].eval(wo, wi),
            false => self.sides[1].eval(mirrored(wo), mirrored(wi)),
        }
    }

    /// Samples the BSDF of the side of `wo`.
    pub fn sample(&self, wo: Vec3, u_lobe: f32, u: Vec2) -> Option<BsdfSample> {
        if wo.z >= 0.0 {
            return self.sides[0].sample(wo, u_lobe, u);
        }
        let sample = self.sides[1].sample(mirrored(wo), u_lobe, u)?;
        Some(BsdfSample { wi: mirrored(sample.wi), ..sample })
    }
}
