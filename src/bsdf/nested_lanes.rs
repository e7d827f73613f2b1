//! BSDFs that contain others, sixteen at a time: the inner ones are evaluated and sampled in lanes, too.

use super::lanes::{BsdfEvalX16, BsdfSampleX16, Kernel, LaneBsdfs, eval_x16, sample_x16};
use super::{Blend, Bsdf, Tilted};
use crate::math::lanes::{LANES, Vec3x16, bits, f32x16, mask_from_bits};
use crate::math::{Frame, FrameX16, Vec3};

/// A [`Blend`] in each of some lanes.
pub(super) struct BlendX16<'a> {
    /// Mask of these lanes.
    lanes: u32,
    blends: [&'a Blend<'a>; LANES],
    weight: f32x16,
    probability: f32x16,
}

/// A [`Tilted`] in each of some lanes.
pub(super) struct TiltedX16<'a> {
    /// Mask of these lanes.
    lanes: u32,
    tilted: [&'a Tilted<'a>; LANES],
}

/// The parts of a [`Tilted`] for the viewer in each lane.
struct TiltsX16<'a> {
    inner: [&'a Bsdf<'a>; LANES],
    frame: FrameX16,
    /// The roughness α² of the shadowing; 0 without shadowing.
    alpha2: f32x16,
}

impl<'a> Kernel<'a> for BlendX16<'a> {
    const IS_NESTED: bool = true;
    type Scalar = Blend<'a>;

    #[inline(always)]
    fn of(bsdf: &'a Bsdf<'a>) -> Option<&'a Blend<'a>> {
        if let Bsdf::Blend(blend) = bsdf { Some(blend) } else { None }
    }

    #[inline(always)]
    fn gather(of: &LaneBsdfs<'a, Blend<'a>>) -> Self {
        let (weight, probability) = (of.numbers(|blend| blend.weight), of.numbers(Blend::probability));
        BlendX16 { lanes: of.lanes, blends: of.bsdfs, weight, probability }
    }

    #[inline(never)]
    fn eval(&self, wo: &Vec3x16, wi: &Vec3x16) -> BsdfEvalX16 {
        self.eval_lanes(wo, wi, self.lanes)
    }

    #[inline(never)]
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
            let BsdfEvalX16 { f, pdf } = self.eval_lanes(wo, &sample.wi, lanes);
            let factor = sample.wi.z.abs() / pdf;
            sample.weight = [0, 1, 2].map(|c| finite.select(f[c] * factor, sample.weight[c]));
            sample.pdf = finite.select(pdf, sample.pdf);
            sample.valid &= !finite | pdf.simd_gt(f32x16::ZERO);
        }
        sample
    }
}

impl BlendX16<'_> {
    /// Computes [`Bsdf::eval`] in the lanes of a mask.
    fn eval_lanes(&self, wo: &Vec3x16, wi: &Vec3x16, lanes: u32) -> BsdfEvalX16 {
        let [a, b] = [0, 1].map(|k| eval_x16(&self.blends.map(|blend| blend.bsdfs[k]), wo, wi, lanes));
        let (w, p) = (self.weight, self.probability);
        BsdfEvalX16 {
            f: [0, 1, 2].map(|c| a.f[c] * (f32x16::ONE - w) + b.f[c] * w),
            pdf: a.pdf * (f32x16::ONE - p) + b.pdf * p,
        }
    }
}

impl<'a> Kernel<'a> for TiltedX16<'a> {
    const IS_NESTED: bool = true;
    type Scalar = Tilted<'a>;

    #[inline(always)]
    fn of(bsdf: &'a Bsdf<'a>) -> Option<&'a Tilted<'a>> {
        if let Bsdf::Tilted(tilted) = bsdf { Some(tilted) } else { None }
    }

    #[inline(always)]
    fn gather(of: &LaneBsdfs<'a, Tilted<'a>>) -> Self {
        TiltedX16 { lanes: of.lanes, tilted: of.bsdfs }
    }

    #[inline(never)]
    fn eval(&self, wo: &Vec3x16, wi: &Vec3x16) -> BsdfEvalX16 {
        let tilts = self.for_viewers(wo);
        let inner_wi = tilts.frame.to_local(*wi);
        let same_side = (wi.z * inner_wi.z).simd_gt(f32x16::ZERO);
        let lanes = same_side.to_bitmask() & self.lanes;
        let BsdfEvalX16 { f, pdf } = eval_x16(&tilts.inner, &tilts.frame.to_local(*wo), &inner_wi, lanes);
        let factor = tilts.shadowing(wi) * inner_wi.z.abs() / wi.z.abs();
        BsdfEvalX16 { f: f.map(|channel| (channel * factor) & same_side), pdf: pdf & same_side }
    }

    #[inline(never)]
    fn sample(&self, wo: &Vec3x16, u_lobe: f32x16, u: [f32x16; 2]) -> BsdfSampleX16 {
        let tilts = self.for_viewers(wo);
        let mut sample = sample_x16(&tilts.inner, &tilts.frame.to_local(*wo), u_lobe, u, self.lanes);
        let wi = tilts.frame.to_world(sample.wi);
        sample.valid &= (wi.z * sample.wi.z).simd_gt(f32x16::ZERO) & mask_from_bits(self.lanes);
        let factor = tilts.shadowing(&wi);
        sample.weight = sample.weight.map(|channel| channel * factor);
        sample.wi = wi;
        sample
    }
}

impl<'a> TiltedX16<'a> {
    /// Gathers the parts for viewers in the directions `wo`.
    fn for_viewers(&self, wo: &Vec3x16) -> TiltsX16<'a> {
        let mut tilted = self.tilted;
        for i in bits(self.lanes) {
            tilted[i] = tilted[i].for_viewer(wo.lane(i));
        }
        let axis = |of: fn(&Frame) -> Vec3| {
            let mut axes = Vec3x16::default();
            (0..LANES).for_each(|i| axes.set_lane(i, of(&tilted[i].frame)));
            axes
        };
        TiltsX16 {
            inner: tilted.map(|tilted| tilted.inner),
            frame: FrameX16 { s: axis(|frame| frame.s), t: axis(|frame| frame.t), n: axis(|frame| frame.n) },
            alpha2: f32x16::new(tilted.map(Tilted::alpha2)),
        }
    }
}

impl TiltsX16<'_> {
    /// Computes [`Tilted::shadowing`] in each lane.
    #[inline(always)]
    fn shadowing(&self, wi: &Vec3x16) -> f32x16 {
        let cos2 = wi.z * wi.z;
        let least = f32x16::splat(f32::MIN_POSITIVE);
        let tan2 = (f32x16::ONE - cos2).fast_max(f32x16::ZERO) / cos2.fast_max(least);
        f32x16::splat(2.0) / (f32x16::ONE + (f32x16::ONE + self.alpha2 * tan2).sqrt())
    }
}
