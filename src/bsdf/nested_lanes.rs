//! BSDFs that contain others, sixteen at a time: the inner ones are evaluated and sampled in lanes, too.
//!
//! Light paths are sampled one at a time, because a perturbed normal depends on the direction to the viewer.

use super::lanes::{BsdfEvalX16, BsdfSampleX16, eval_x16, sample_x16};
use super::{Blend, Bsdf, Tilted};
use crate::math::lanes::{LANES, Vec3x16, bits, f32x16, mask_from_bits};
use crate::math::{Frame, FrameX16, Vec3};

/// A [`Blend`] in each of some lanes.
struct BlendX16<'a> {
    lanes: u32,
    blends: [&'a Blend<'a>; LANES],
    weight: f32x16,
    probability: f32x16,
}

/// A [`Tilted`] in each of some lanes, which is the one for the viewer.
struct TiltedX16<'a> {
    lanes: u32,
    inner: [&'a Bsdf<'a>; LANES],
    frame: FrameX16,
    /// The roughness α² of the shadowing; 0 without shadowing.
    alpha2: f32x16,
}

/// Computes [`Bsdf::eval`] in those lanes of the mask `rest` that are of the kind of the lane `first`. Returns their
/// mask, too; `None` if the kind contains no others.
#[inline(never)]
pub(super) fn eval_alike<'a>(
    first: usize,
    bsdfs: &[&'a Bsdf<'a>; LANES],
    rest: u32,
    [wo, wi]: [&Vec3x16; 2],
) -> Option<(u32, BsdfEvalX16)> {
    let lanes = alike(first, bsdfs, rest);
    let eval = match bsdfs[first] {
        Bsdf::Blend(one) => BlendX16::new(bsdfs, lanes, one).eval(wo, wi, lanes),
        Bsdf::Tilted(one) => TiltedX16::new(bsdfs, lanes, one, wo).eval(wo, wi),
        _ => return None,
    };
    Some((lanes, eval))
}

/// Computes [`Bsdf::sample`] as [`eval_alike`] does.
#[inline(never)]
pub(super) fn sample_alike<'a>(
    first: usize,
    bsdfs: &[&'a Bsdf<'a>; LANES],
    rest: u32,
    wo: &Vec3x16,
    (u_lobe, u): (f32x16, [f32x16; 2]),
) -> Option<(u32, BsdfSampleX16)> {
    let lanes = alike(first, bsdfs, rest);
    let sample = match bsdfs[first] {
        Bsdf::Blend(one) => BlendX16::new(bsdfs, lanes, one).sample(wo, u_lobe, u),
        Bsdf::Tilted(one) => TiltedX16::new(bsdfs, lanes, one, wo).sample(wo, u_lobe, u),
        _ => return None,
    };
    Some((lanes, sample))
}

/// Returns a mask of those lanes of the mask `rest` that are of the kind of the lane `first`.
fn alike(first: usize, bsdfs: &[&Bsdf<'_>; LANES], rest: u32) -> u32 {
    let kind = std::mem::discriminant(bsdfs[first]);
    let alike = bits(rest).filter(|&i| std::mem::discriminant(bsdfs[i]) == kind);
    alike.fold(0, |lanes, i| lanes | 1 << i)
}

impl<'a> BlendX16<'a> {
    fn new(bsdfs: &[&'a Bsdf<'a>; LANES], lanes: u32, one: &'a Blend<'a>) -> Self {
        let mut blends = [one; LANES];
        for i in bits(lanes) {
            if let Bsdf::Blend(blend) = bsdfs[i] {
                blends[i] = blend;
            }
        }
        let weight = f32x16::new(blends.map(|blend| blend.weight));
        BlendX16 { lanes, blends, weight, probability: f32x16::new(blends.map(Blend::probability)) }
    }

    fn eval(&self, wo: &Vec3x16, wi: &Vec3x16, lanes: u32) -> BsdfEvalX16 {
        let [a, b] = [0, 1].map(|k| eval_x16(&self.blends.map(|blend| blend.bsdfs[k]), wo, wi, lanes));
        let (w, p) = (self.weight, self.probability);
        BsdfEvalX16 {
            f: [0, 1, 2].map(|c| a.f[c] * (f32x16::ONE - w) + b.f[c] * w),
            pdf: a.pdf * (f32x16::ONE - p) + b.pdf * p,
        }
    }

    fn sample(&self, wo: &Vec3x16, u_lobe: f32x16, u: [f32x16; 2]) -> BsdfSampleX16 {
        let mut chosen = self.blends.map(|blend| blend.bsdfs[0]);
        let (mut u_inner, mut share) = (u_lobe, f32x16::ZERO);
        for i in bits(self.lanes) {
            let (bsdf, u_lobe, of_bsdf) = self.blends[i].choose(u_lobe.as_array()[i]);
            chosen[i] = bsdf;
            u_inner.as_mut_array()[i] = u_lobe;
            share.as_mut_array()[i] = of_bsdf;
        }
        let mut sample = sample_x16(&chosen, wo, u_inner, u, self.lanes);
        let finite = !sample.pdf.simd_eq(f32x16::splat(f32::INFINITY));
        sample.weight = sample.weight.map(|weight| weight * share);
        let lanes = (finite & sample.valid).to_bitmask() & self.lanes;
        if lanes != 0 {
            let BsdfEvalX16 { f, pdf } = self.eval(wo, &sample.wi, lanes);
            let factor = sample.wi.z.abs() / pdf;
            sample.weight = [0, 1, 2].map(|c| finite.select(f[c] * factor, sample.weight[c]));
            sample.pdf = finite.select(pdf, sample.pdf);
            sample.valid &= !finite | pdf.simd_gt(f32x16::ZERO);
        }
        sample
    }
}

impl<'a> TiltedX16<'a> {
    fn new(bsdfs: &[&'a Bsdf<'a>; LANES], lanes: u32, one: &'a Tilted<'a>, wo: &Vec3x16) -> Self {
        let mut tilted = [one; LANES];
        for i in bits(lanes) {
            if let Bsdf::Tilted(other) = bsdfs[i] {
                tilted[i] = other.for_viewer(wo.lane(i));
            }
        }
        let axis = |of: fn(&Frame) -> Vec3| {
            let mut axes = Vec3x16::default();
            (0..LANES).for_each(|i| axes.set_lane(i, of(&tilted[i].frame)));
            axes
        };
        TiltedX16 {
            lanes,
            inner: tilted.map(|tilted| tilted.inner),
            frame: FrameX16 { s: axis(|frame| frame.s), t: axis(|frame| frame.t), n: axis(|frame| frame.n) },
            alpha2: f32x16::new(tilted.map(Tilted::alpha2)),
        }
    }

    /// Computes [`Tilted::shadowing`] in each lane.
    #[inline(always)]
    fn shadowing(&self, wi: &Vec3x16) -> f32x16 {
        let cos2 = wi.z * wi.z;
        let least = f32x16::splat(f32::MIN_POSITIVE);
        let tan2 = (f32x16::ONE - cos2).fast_max(f32x16::ZERO) / cos2.fast_max(least);
        f32x16::splat(2.0) / (f32x16::ONE + (f32x16::ONE + self.alpha2 * tan2).sqrt())
    }

    fn eval(&self, wo: &Vec3x16, wi: &Vec3x16) -> BsdfEvalX16 {
        let inner_wi = self.frame.to_local(*wi);
        let same_side = (wi.z * inner_wi.z).simd_gt(f32x16::ZERO);
        let lanes = same_side.to_bitmask() & self.lanes;
        let BsdfEvalX16 { f, pdf } = eval_x16(&self.inner, &self.frame.to_local(*wo), &inner_wi, lanes);
        let factor = self.shadowing(wi) * inner_wi.z.abs() / wi.z.abs();
        BsdfEvalX16 { f: f.map(|channel| (channel * factor) & same_side), pdf: pdf & same_side }
    }

    fn sample(&self, wo: &Vec3x16, u_lobe: f32x16, u: [f32x16; 2]) -> BsdfSampleX16 {
        let mut sample = sample_x16(&self.inner, &self.frame.to_local(*wo), u_lobe, u, self.lanes);
        let wi = self.frame.to_world(sample.wi);
        sample.valid &= (wi.z * sample.wi.z).simd_gt(f32x16::ZERO) & mask_from_bits(self.lanes);
        let factor = self.shadowing(&wi);
        sample.weight = sample.weight.map(|channel| channel * factor);
        sample.wi = wi;
        sample
    }
}
