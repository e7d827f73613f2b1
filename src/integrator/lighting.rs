//! Direct lighting at surface points: emitter samples and BSDF samples, weighted against each other.

use super::block::Block;
use crate::color::Rgb;
use crate::math::lanes::{bits, f32x16};
use crate::math::{RayX16, Vec3};
use crate::sampling::mis::{weighted_power_heuristic, weighted_power_heuristic_x16};
use crate::scene::{Scene, SurfaceInteraction};

/// How many samples each technique draws at a point, for the weights.
#[derive(Clone, Copy, Debug)]
pub struct TechniqueCounts {
    /// Emitter samples.
    pub emitter: f32,
    /// BSDF samples.
    pub bsdf: f32,
}

impl TechniqueCounts {
    /// One sample of each.
    pub const ONE_EACH: TechniqueCounts = TechniqueCounts { emitter: 1.0, bsdf: 1.0 };
}

/// Shadow rays, and what they bring if they are free.
pub struct ShadowRays {
    /// The rays.
    pub rays: RayX16,
    /// Reflected radiance by channel.
    pub value: [f32x16; 3],
    /// Bits: the lanes that bring anything.
    pub lanes: u32,
}

/// One emitter sample at each point: a shadow ray, and what it brings (over the number of emitter samples) if it
/// is free.
#[inline(always)]
pub fn sample_emitters(
    scene: &Scene,
    block: &Block<'_>,
    u_choice: f32x16,
    u_point: [f32x16; 2],
    counts: TechniqueCounts,
) -> ShadowRays {
    let Block { at, .. } = block;
    let sample = scene.sample_emitters(at.p, u_choice, u_point, block.rays.time, block.finite);
    let wi = at.frame.to_local(sample.wi);
    let scattered = crate::bsdf::lanes::eval_x16(&block.bsdfs, &block.wo, &wi, block.finite);
    let [r, g, b] = scattered.f;
    let some = r.simd_gt(f32x16::ZERO) | g.simd_gt(f32x16::ZERO) | b.simd_gt(f32x16::ZERO);
    let lanes = (sample.valid & some & sample.pdf.simd_gt(f32x16::ZERO)).to_bitmask() & block.finite;
    let weight = weighted_power_heuristic_x16(counts.emitter, sample.pdf, counts.bsdf, scattered.pdf);
    let weight = sample.delta.select(f32x16::ONE, weight);
    let factor = wi.z.abs() * weight / (sample.pdf * f32x16::splat(counts.emitter));
    let value = std::array::from_fn(|c| scattered.f[c] * sample.radiance[c] * factor);
    ShadowRays { rays: scene.shadow_rays(at, &sample, block.rays.time), value, lanes }
}

/// The weighted radiance that the rays of the block find at the emitters they hit, given their densities (see
/// [`emitted_at`]): lanes that find any, one by one.
#[inline(always)]
pub fn emitted<'a>(
    scene: &'a Scene,
    block: &'a Block<'_>,
    pdf: &'a [f32],
    counts: TechniqueCounts,
) -> impl Iterator<Item = (usize, Rgb)> + 'a {
    bits(block.at.emitting & block.active).map(move |i| {
        (i, emitted_at(scene, &block.at.lane(i), block.rays.o.lane(i), pdf[block.first + i], counts))
    })
}

/// The weighted radiance that a ray of density `pdf` (per unit solid angle; infinite for delta lobes and the
/// camera) finds at the emitter it hit, seen from the ray's origin. Black where nothing is emitted.
pub fn emitted_at(
    scene: &Scene,
    at: &SurfaceInteraction,
    from: Vec3,
    pdf: f32,
    counts: TechniqueCounts,
) -> Rgb {
    let Some(emitter) = scene.emitter_at(at) else {
        return Rgb::BLACK;
    };
    let radiance = scene.emitted(emitter, at);
    if pdf.is_infinite() {
        return radiance;
    }
    let other = scene.emitter_pdf(emitter, from, at);
    radiance * weighted_power_heuristic(counts.bsdf, pdf, counts.emitter, other)
}

/// The weighted radiance that a ray in the unit direction `d` finds when it leaves the scene.
#[inline]
pub fn environment(scene: &Scene, d: Vec3, pdf: f32, counts: TechniqueCounts) -> Rgb {
    let radiance = scene.environment_radiance(d);
    if pdf.is_infinite() {
        return radiance;
    }
    radiance * weighted_power_heuristic(counts.bsdf, pdf, counts.emitter, scene.environment_pdf(d))
}
