//! Scattering of light paths: the known direction points towards the light, the sampled one towards the viewer.
//!
//! A BSDF is a function of both directions but not a symmetric one: dielectric boundaries scale radiance but not
//! power, and a perturbed normal is mirrored if its *viewer* is behind it. [Veach 1997, 5.3]

use super::two_sided::mirrored;
use super::{Blend, Bsdf, BsdfEval, BsdfSample, Lobe, Mask, Tilted, TwoSided, mask};
use crate::math::{Vec2, Vec3};

/// The largest random number below 1.
const LAST: f32 = 1f32.next_down();

impl Bsdf<'_> {
    /// Samples the direction towards the viewer for light from `wo`. The weight is `f·|cosθ|/pdf`, where `f` is the
    /// BSDF for that viewer and that light, and the cosine is the viewer's. `eta` and the density belong to the
    /// sampled direction, as in [`sample`](Self::sample).
    pub fn sample_adjoint(&self, wo: Vec3, u_lobe: f32, u: Vec2) -> Option<BsdfSample> {
        let sample = match self {
            Bsdf::Null => return Some(mask::unscattered(wo)),
            Bsdf::Blend(b) => b.sample_adjoint(wo, u_lobe, u)?,
            Bsdf::Coating(b) => b.sample_adjoint(wo, u_lobe, u)?,
            Bsdf::Mask(b) => return b.sample_adjoint(wo, u_lobe, u),
            Bsdf::TwoSided(b) => {
                let sample = b.sample_adjoint(wo, u_lobe, u)?;
                // The viewer selects the side, which is also the light's, because neither side transmits.
                if sample.wi.z * wo.z <= 0.0 {
                    return None;
                }
                sample
            }
            Bsdf::Tilted(b) => b.sample_adjoint(wo, u_lobe, u)?,
            leaf => {
                let sample = leaf.sample(wo, u_lobe, u)?;
                // The scaling at a boundary applies to radiance, but not to power.
                BsdfSample { weight: sample.weight * (sample.eta * sample.eta), ..sample }
            }
        };
        if sample.lobe == Lobe::Specular {
            return Some(sample);
        }
        let pdf = self.pdf_adjoint(wo, sample.wi);
        let weight = self.eval(sample.wi, wo).f * (sample.wi.z.abs() / pdf);
        (pdf > 0.0).then_some(BsdfSample { weight, pdf, ..sample })
    }

    /// Returns the density of the finite lobes of [`sample_adjoint`](Self::sample_adjoint), per unit solid angle of
    /// `wi`.
    pub fn pdf_adjoint(&self, wo: Vec3, wi: Vec3) -> f32 {
        match self {
            Bsdf::Blend(b) => {
                let (p, [first, second]) = (b.probability(), b.bsdfs.map(|bsdf| bsdf.pdf_adjoint(wo, wi)));
                first * (1.0 - p) + second * p
            }
            Bsdf::Coating(b) => b.pdf_adjoint(wo, wi),
            Bsdf::Mask(b) => b.inner.pdf_adjoint(wo, wi) * b.probability(),
            Bsdf::TwoSided(b) if wo.z >= 0.0 => b.sides[0].pdf_adjoint(wo, wi),
            Bsdf::TwoSided(b) => b.sides[1].pdf_adjoint(mirrored(wo), mirrored(wi)),
            Bsdf::Tilted(b) => b.pdf_adjoint(wo, wi),
            leaf => {
                let BsdfEval { pdf, .. } = leaf.eval(wo, wi);
                pdf
            }
        }
    }
}

impl TwoSided<'_> {
    /// Samples the BSDF of the side of `wo`.
    fn sample_adjoint(&self, wo: Vec3, u_lobe: f32, u: Vec2) -> Option<BsdfSample> {
        if wo.z >= 0.0 {
            return self.sides[0].sample_adjoint(wo, u_lobe, u);
        }
        let sample = self.sides[1].sample_adjoint(mirrored(wo), u_lobe, u)?;
        Some(BsdfSample { wi: mirrored(sample.wi), ..sample })
    }
}

impl Blend<'_> {
    fn sample_adjoint(&self, wo: Vec3, u_lobe: f32, u: Vec2) -> Option<BsdfSample> {
        let (bsdf, u_lobe, share) = self.choose(u_lobe);
        let sample = bsdf.sample_adjoint(wo, u_lobe, u)?;
        Some(BsdfSample { weight: sample.weight * share, ..sample })
    }
}

impl Mask<'_> {
    fn sample_adjoint(&self, wo: Vec3, u_lobe: f32, u: Vec2) -> Option<BsdfSample> {
        let probability = self.probability();
        if u_lobe >= probability {
            return Some(self.hole(wo));
        }
        let sample = self.inner.sample_adjoint(wo, (u_lobe / probability).min(LAST), u)?;
        let weight = sample.weight * (self.opacity / probability);
        Some(BsdfSample { weight, pdf: sample.pdf * probability, ..sample })
    }
}

impl Tilted<'_> {
    /// Samples the viewer's direction. Weight and density include Dirac deltas only.
    ///
    /// The normal depends on the viewer, who is not yet known. If there are two normals, each is used for half of the
    /// samples.
    fn sample_adjoint(&self, wo: Vec3, u_lobe: f32, u: Vec2) -> Option<BsdfSample> {
        let (tilt, u_lobe, share) = match self.turned {
            None => (self, u_lobe, 1.0),
            Some(turned) if u_lobe < 0.5 => (turned, 2.0 * u_lobe, 2.0),
            Some(_) => (self, 2.0 * u_lobe - 1.0, 2.0),
        };
        let inner_wo = tilt.frame.to_local(wo);
        let sample = tilt.inner.sample_adjoint(inner_wo, u_lobe, u)?;
        let wi = tilt.frame.to_world(sample.wi);
        if sample.lobe != Lobe::Specular {
            return Some(BsdfSample { wi, ..sample });
        }
        // The light must be on the same side of both normals, and this normal must be the viewer's.
        if wo.z * inner_wo.z <= 0.0 || !std::ptr::eq(self.for_viewer(wi), tilt) {
            return None;
        }
        // The |cosθ| of viewer and light with the surface's normal, divided by those with the perturbed normal.
        let cosines = (wi.z / sample.wi.z).abs() * (inner_wo.z / wo.z).abs();
        let weight = sample.weight * (share * tilt.shadowing(wo) * cosines);
        Some(BsdfSample { wi, weight, ..sample })
    }

    fn pdf_adjoint(&self, wo: Vec3, wi: Vec3) -> f32 {
        let pdf =
            |tilt: &Tilted<'_>| tilt.inner.pdf_adjoint(tilt.frame.to_local(wo), tilt.frame.to_local(wi));
        match self.turned {
            None => pdf(self),
            Some(turned) => 0.5 * (pdf(self) + pdf(turned)),
        }
    }
}
