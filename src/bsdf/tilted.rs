//! A BSDF in the frame of a perturbed normal, for bump and normal maps.

use super::{Bsdf, BsdfEval, BsdfSample};
use crate::math::{Frame, Vec2, Vec3};

/// A BSDF around a normal that differs from the surface's normal.
///
/// A pair of directions scatters nothing if one of them is on different sides of the two normals.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tilted<'a> {
    /// The perturbed frame, in the local frame of the surface.
    pub frame: Frame,
    /// Whether the shadow terminator is softened. [Estevez 2019]
    pub soften: bool,
    /// The BSDF in the perturbed frame.
    pub inner: &'a Bsdf<'a>,
    /// The BSDF for a viewer on different sides of this normal and the surface's normal. `None` if there is no other
    /// BSDF, or if the viewer is known and this is the BSDF for it.
    pub turned: Option<&'a Tilted<'a>>,
}

/// Returns the squared tangent, which is finite.
fn tan2(w: Vec3) -> f32 {
    let cos2 = w.z * w.z;
    (1.0 - cos2).max(0.0) / cos2.max(f32::MIN_POSITIVE)
}

impl<'a> Tilted<'a> {
    /// Returns the shadowing factor near the terminator for light from `wi`: Smith's shadowing of a GGX surface with
    /// a roughness given by the tilt of the normal. [Estevez 2019, Eq. 3 and 4]
    pub(super) fn shadowing(&self, wi: Vec3) -> f32 {
        2.0 / (1.0 + (1.0 + self.alpha2() * tan2(wi)).sqrt())
    }

    /// Returns the roughness α² of that surface; 0 without shadowing.
    pub(super) fn alpha2(&self) -> f32 {
        if self.soften { (0.125 * tan2(self.frame.n)).min(1.0) } else { 0.0 }
    }

    /// Returns the BSDF for a viewer in the direction `wo`.
    pub(super) fn for_viewer(&'a self, wo: Vec3) -> &'a Self {
        match self.turned {
            Some(turned) if wo.z * self.frame.n.dot(wo) <= 0.0 => turned,
            _ => self,
        }
    }

    /// Evaluates the inner BSDF in its frame. The result is to be multiplied by the cosine with the surface's normal.
    pub fn eval(&self, wo: Vec3, wi: Vec3) -> BsdfEval {
        let Tilted { frame, inner, .. } = self.for_viewer(wo);
        let inner_wi = frame.to_local(wi);
        if wi.z * inner_wi.z <= 0.0 {
            return BsdfEval::ZERO;
        }
        let BsdfEval { f, pdf } = inner.eval(frame.to_local(wo), inner_wi);
        BsdfEval { f: f * (self.shadowing(wi) * inner_wi.z.abs() / wi.z.abs()), pdf }
    }

    /// Samples the inner BSDF in its frame.
    pub fn sample(&self, wo: Vec3, u_lobe: f32, u: Vec2) -> Option<BsdfSample> {
        let Tilted { frame, inner, .. } = self.for_viewer(wo);
        let sample = inner.sample(frame.to_local(wo), u_lobe, u)?;
        let wi = frame.to_world(sample.wi);
        if wi.z * sample.wi.z <= 0.0 {
            return None;
        }
        Some(BsdfSample { wi, weight: sample.weight * self.shadowing(wi), ..sample })
    }
}
