//! A BSDF in a frame that leans: bump and normal maps.

use super::{Bsdf, BsdfEval, BsdfSample};
use crate::math::{Frame, Vec2, Vec3};

/// A BSDF around a normal that is not the surface's.
///
/// Directions that are on different sides of the two normals scatter nothing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tilted<'a> {
    /// The leaning frame, in the local frame of the surface.
    pub frame: Frame,
    /// Whether the terminator is softened. [Estevez 2019]
    pub soften: bool,
    /// What scatters.
    pub inner: &'a Bsdf<'a>,
}

fn tan2(w: Vec3) -> f32 {
    let cos2 = w.z * w.z;
    (1.0 - cos2).max(0.0) / cos2
}

impl Tilted<'_> {
    /// The share of the light from `wi` that is left near the terminator: Smith's shadowing of a GGX surface as rough
    /// as the normal leans. [Estevez 2019, Eq. 3 and 4]
    pub(super) fn shadowing(&self, wi: Vec3) -> f32 {
        if !self.soften {
            return 1.0;
        }
        let alpha2 = (0.125 * tan2(self.frame.n)).min(1.0);
        2.0 / (1.0 + (1.0 + alpha2 * tan2(wi)).sqrt())
    }

    /// The inner BSDF in its frame. It returns what is to be multiplied by the cosine to the surface's normal.
    pub fn eval(&self, wo: Vec3, wi: Vec3) -> BsdfEval {
        let inner_wi = self.frame.to_local(wi);
        if wi.z * inner_wi.z <= 0.0 {
            return BsdfEval::ZERO;
        }
        let BsdfEval { f, pdf } = self.inner.eval(self.frame.to_local(wo), inner_wi);
        BsdfEval { f: f * (self.shadowing(wi) * inner_wi.z.abs() / wi.z.abs()), pdf }
    }

    /// Samples the inner BSDF in its frame.
    pub fn sample(&self, wo: Vec3, u_lobe: f32, u: Vec2) -> Option<BsdfSample> {
        let sample = self.inner.sample(self.frame.to_local(wo), u_lobe, u)?;
        let wi = self.frame.to_world(sample.wi);
        if wi.z * sample.wi.z <= 0.0 {
            return None;
        }
        Some(BsdfSample { wi, weight: sample.weight * self.shadowing(wi), ..sample })
    }
}
