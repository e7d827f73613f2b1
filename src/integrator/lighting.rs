//! Direct lighting at surface points: emitter samples and BSDF samples, combined by multiple importance sampling.

use super::Radiance;
use super::block::ShadingBlock;
use super::worker::PathWave;
use crate::accel::Hit;
use crate::color::Rgb;
use crate::math::lanes::{bits, f32x16};
use crate::math::{Ray, RayX16, Vec3};
use crate::sampling::mis::{weighted_power_heuristic, weighted_power_heuristic_x16};
use crate::scene::{Scene, SurfaceInteraction};

/// The number of samples of each technique at a point, for the weights.
#[derive(Clone, Copy, Debug)]
pub struct TechniqueCounts {
    /// Emitter samples.
    pub emitter: f32,
    /// BSDF samples.
    pub bsdf: f32,
}

impl TechniqueCounts {
    /// One sample of each technique.
    pub const ONE_EACH: TechniqueCounts = TechniqueCounts { emitter: 1.0, bsdf: 1.0 };
}

/// Shadow rays and their contributions if they are unoccluded.
pub struct ShadowRays {
    /// The rays.
    pub rays: RayX16,
    /// Reflected radiance by channel.
    pub value: [f32x16; 3],
    /// Mask of the lanes with a contribution.
    pub lanes: u32,
}

/// Draws one emitter sample at each point. Returns the shadow rays and their contributions if unoccluded, divided by
/// the number of emitter samples.
#[inline(always)]
pub fn sample_emitters(
    scene: &Scene,
    block: &ShadingBlock<'_>,
    u_choice: f32x16,
    u_point: [f32x16; 2],
    counts: TechniqueCounts,
) -> ShadowRays {
    let ShadingBlock { at, .. } = block;
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

/// Returns the weighted radiance of the emitters hit by the rays of the block, for the given densities (see
/// [`emitted_at`]), as pairs of a lane and a value.
#[inline(always)]
pub fn emitted<'a>(
    scene: &'a Scene,
    block: &'a ShadingBlock<'_>,
    pdf: &'a [f32],
    counts: TechniqueCounts,
) -> impl Iterator<Item = (usize, Rgb)> + 'a {
    bits(block.at.emitting & block.active).map(move |i| {
        (i, emitted_at(scene, &block.at.lane(i), block.rays.o.lane(i), pdf[block.first + i], counts))
    })
}

/// Returns the radiance of the emitter hit by a ray, seen from the ray's origin, times the weight for the ray's
/// density `pdf` (per unit solid angle; infinite for delta lobes and the camera). Black if nothing is emitted.
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

/// Removes the paths of a wave that hit nothing, and adds the environment's radiance for those that `wants` selects.
pub fn drop_missed(
    scene: &Scene,
    paths: &mut PathWave,
    hits: &mut Vec<Option<Hit>>,
    out: &mut [Radiance],
    wants: impl Fn(&PathWave, usize) -> bool,
) {
    paths.keep_hits(hits, |paths, i| {
        if scene.needs.environment && wants(paths, i) {
            let le = environment(scene, &paths.rays[i], paths.pdf[i], TechniqueCounts::ONE_EACH);
            out[paths.slots[i] as usize].value += paths.beta(i) * le;
        }
    });
}

/// Returns the weighted radiance of the environment for a ray with a unit direction that leaves the scene.
#[inline]
pub fn environment(scene: &Scene, ray: &Ray, pdf: f32, counts: TechniqueCounts) -> Rgb {
    let radiance = scene.environment_radiance(ray.d);
    if pdf.is_infinite() {
        return radiance;
    }
    radiance * weighted_power_heuristic(counts.bsdf, pdf, counts.emitter, scene.environment_pdf(ray.o, ray.d))
}
