//! Scattering of light paths: the known direction is that of the light, the sampled one that of the viewer.
//!
//! A BSDF is a function of both, but not a symmetric one: boundaries scale radiance and not power, and a bent normal is
//! turned where its *viewer* would not see it. [Veach 1997, 5.3]

use super::two_sided::mirrored;
use super::{Blend, Bsdf, BsdfEval, BsdfSample, Lobe, Mask, Tilted, TwoSided, mask};
use crate::math::{Vec2, Vec3};

/// The largest random number.
const LAST: f32 = 1f32.next_down();

impl Bsdf<'_> {
    /// Draws the direction of a viewer for light from `wo`. The weight is `f·|cosθ|/pdf` for `f` of that viewer and
    /// that light and the viewer's cosine; `eta` and the density belong to the sampled direction, as those of
    /// [`sample`](Self::sample).
    pub fn sample_adjoint(&self, wo: Vec3, u_lobe: f32, u: Vec2) -> Option<BsdfSample> {
        let sample = match self {
            Bsdf::Null => return Some(mask::through(wo)),
            Bsdf::Blend(b) => b.sample_adjoint(wo, u_lobe, u)?,
            Bsdf::Mask(b) => return b.sample_adjoint(wo, u_lobe, u),
            Bsdf::TwoSided(b) => {
                let sample = b.sample_adjoint(wo, u_lobe, u)?;
                // The side is that of the viewer, who is on the light's: neither transmits.
                if sample.wi.z * wo.z <= 0.0 {
                    return None;
                }
                sample
            }
            Bsdf::Tilted(b) => b.sample_adjoint(wo, u_lobe, u)?,
            leaf => {
                let sample = leaf.sample(wo, u_lobe, u)?;
                // Radiance is scaled at a boundary, light is not.
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

    /// The density of the finite lobes of [`sample_adjoint`](Self::sample_adjoint), per unit solid angle of `wi`.
    pub fn pdf_adjoint(&self, wo: Vec3, wi: Vec3) -> f32 {
        match self {
            Bsdf::Blend(b) => {
                let (p, [first, second]) = (b.probability(), b.bsdfs.map(|bsdf| bsdf.pdf_adjoint(wo, wi)));
                first * (1.0 - p) + second * p
            }
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
    /// A sample of the side of `wo`.
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
    /// A sample of a viewer's direction; the weight and density are those of Dirac deltas only.
    ///
    /// The normal that counts is known once the viewer is: where there are two, each is tried for half of the samples.
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
        // The light has to be on one side of both normals, and the viewer has to see this normal.
        if wo.z * inner_wo.z <= 0.0 || !std::ptr::eq(self.seen_from(wi), tilt) {
            return None;
        }
        // |cosθ| of the viewer and of the light, to the surface's normal over those to the bent one.
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
