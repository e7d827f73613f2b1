//! Direct lighting at surface points: emitter samples and BSDF samples, combined by multiple importance sampling.

use super::Radiance;
use super::block::ShadingBlock;
use super::guiding::GuidedBlock;
use super::path_wave::PathWave;
use crate::accel::Hit;
use crate::color::Rgb;
use crate::emitter::{EmitterSampleX16, GlossX16, LightSelection, ReceiverX16};
use crate::math::lanes::{bits, f32x16};
use crate::math::{LANES, RayX16, Vec3x16};
use crate::sampling::mis::{weighted_power_heuristic, weighted_power_heuristic_x16};
use crate::scene::{Scene, SurfaceInteraction};

/// The number of samples of each technique at a point, for the weights.
#[derive(Clone, Copy, Debug)]
pub struct TechniqueCounts {
    /// Emitter samples.
    pub emitter: f32,
    /// BSDF samples.
    pub bsdf: f32,
    /// Whether emitter samples omit the light that BSDF samples find well.
    compensated: bool,
}

impl TechniqueCounts {
    /// One sample of each technique at every point, so that emitter samples may omit light.
    pub const ONE_EACH: TechniqueCounts = TechniqueCounts { emitter: 1.0, bsdf: 1.0, compensated: true };

    /// One sample of each technique at most. Some points have no BSDF sample, so emitter samples omit no light.
    pub const UNCOMPENSATED: TechniqueCounts =
        TechniqueCounts { compensated: false, ..TechniqueCounts::ONE_EACH };

    /// Creates the given counts. Emitter samples omit light if there are at least as many BSDF samples.
    pub fn new(emitter: u32, bsdf: u32) -> Self {
        TechniqueCounts { emitter: emitter as f32, bsdf: bsdf as f32, compensated: bsdf >= emitter }
    }

    /// Creates the given counts for points at which emitters are chosen as with [`ONE_EACH`](Self::ONE_EACH), even if
    /// there are fewer BSDF samples.
    pub fn like_one_each(emitter: u32, bsdf: u32) -> Self {
        TechniqueCounts { compensated: true, ..TechniqueCounts::new(emitter, bsdf) }
    }

    /// Creates the given counts for techniques of which some points lack one, so that emitter samples omit no light.
    pub fn uncompensated(emitter: u32, bsdf: u32) -> Self {
        TechniqueCounts { compensated: false, ..TechniqueCounts::new(emitter, bsdf) }
    }

    /// Returns the choice among the emitters for the emitter samples.
    #[inline]
    pub fn selection<'a>(&self, scene: &'a Scene) -> &'a LightSelection {
        let compensated = scene.compensated_selection.as_ref().filter(|_| self.compensated);
        compensated.unwrap_or(&scene.light_selection)
    }

    /// Returns whether emitter samples are useful in a scene.
    pub fn samples_emitters(&self, scene: &Scene) -> bool {
        scene.needs.emitter_sampling && self.emitter > 0.0 && !self.selection(scene).is_empty()
    }
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

/// Draws one emitter sample at each point with a finite lobe.
#[inline(always)]
pub fn draw_emitters(
    scene: &Scene,
    block: &ShadingBlock<'_>,
    u_point: [f32x16; 2],
    counts: TechniqueCounts,
) -> EmitterSampleX16 {
    scene.sample_emitters(counts.selection(scene), &block.receivers(), u_point, block.rays.time, block.finite)
}

/// Returns the shadow rays of emitter samples and the light that the points in the mask `lanes` reflect if the rays
/// are unoccluded, divided by the number of emitter samples.
#[inline(always)]
pub fn reflect_emitters(
    scene: &Scene,
    block: &ShadingBlock<'_>,
    sample: &EmitterSampleX16,
    counts: TechniqueCounts,
    guided: Option<&GuidedBlock<'_>>,
    lanes: u32,
) -> ShadowRays {
    let ShadingBlock { at, .. } = block;
    let wi = at.frame.to_local(sample.wi);
    let scattered = crate::bsdf::lanes::eval_x16(&block.bsdfs, &block.wo, &wi, lanes);
    let [r, g, b] = scattered.f;
    let some = r.simd_gt(f32x16::ZERO) | g.simd_gt(f32x16::ZERO) | b.simd_gt(f32x16::ZERO);
    let lanes = (sample.valid & some & sample.pdf.simd_gt(f32x16::ZERO)).to_bitmask() & lanes;
    let pdf = guided.map_or(scattered.pdf, |guided| guided.pdf(block, &wi, scattered.pdf, lanes));
    let weight = weighted_power_heuristic_x16(counts.emitter, sample.pdf, counts.bsdf, pdf);
    let weight = sample.delta.select(f32x16::ONE, weight);
    let factor = wi.z.abs() * weight / (sample.pdf * f32x16::splat(counts.emitter));
    let value = std::array::from_fn(|c| scattered.f[c] * sample.radiance[c] * factor);
    ShadowRays { rays: scene.shadow_rays(at, sample, block.rays.time), value, lanes }
}

/// Draws one emitter sample at each point. Returns the shadow rays and their contributions if unoccluded, divided by
/// the number of emitter samples.
#[inline(always)]
pub fn sample_emitters(
    scene: &Scene,
    block: &ShadingBlock<'_>,
    u_point: [f32x16; 2],
    counts: TechniqueCounts,
) -> ShadowRays {
    let sample = draw_emitters(scene, block, u_point, counts);
    reflect_emitters(scene, block, &sample, counts, None, block.finite)
}

/// Returns the weighted radiance of the emitters hit by the rays of the block, which are those of `paths` (see
/// [`emitted_at`]), as pairs of a lane and a value.
#[inline(always)]
pub fn emitted<'a>(
    scene: &'a Scene,
    block: &'a ShadingBlock<'_>,
    paths: &'a PathWave,
    counts: TechniqueCounts,
) -> impl Iterator<Item = (usize, Rgb)> + 'a {
    bits(block.at.emitting & block.active).map(move |i| {
        let path = block.first + i;
        (i, emitted_at(scene, &block.at.lane(i), paths, path, counts))
    })
}

/// Returns the radiance of the emitter hit at a surface point by the ray of path `i`, times the weight for the ray's
/// density, which is infinite for delta lobes and the camera. Black if nothing is emitted.
pub fn emitted_at(
    scene: &Scene,
    at: &SurfaceInteraction,
    paths: &PathWave,
    i: usize,
    counts: TechniqueCounts,
) -> Rgb {
    let Some(emitter) = scene.emitter_at(at) else {
        return Rgb::BLACK;
    };
    let (radiance, pdf) = (scene.emitted(emitter, at), paths.pdf[i]);
    if pdf.is_infinite() {
        return radiance;
    }
    let other = scene.emitter_pdf(counts.selection(scene), emitter, paths.receiver(i), paths.rays[i].o, at);
    radiance * weighted_power_heuristic(counts.bsdf, pdf, counts.emitter, other)
}

/// Removes the paths of a wave that hit nothing, and adds the weighted radiance of the environment for those that
/// `wants` selects.
pub fn drop_missed(
    scene: &Scene,
    paths: &mut PathWave,
    hits: &mut Vec<Option<Hit>>,
    out: &mut [Radiance],
    counts: TechniqueCounts,
    wants: impl Fn(&PathWave, usize) -> bool,
) {
    add_missed(scene, paths, hits, out, counts, wants);
    paths.keep_hits(hits);
}

/// Adds the weighted radiance of the environment for the paths of a wave that hit nothing and that `wants` selects.
pub fn add_missed(
    scene: &Scene,
    paths: &PathWave,
    hits: &[Option<Hit>],
    out: &mut [Radiance],
    counts: TechniqueCounts,
    wants: impl Fn(&PathWave, usize) -> bool,
) {
    if !scene.needs.environment {
        return;
    }
    let (mut missed, mut count) = ([0; LANES], 0);
    for i in 0..hits.len() {
        if hits[i].is_none() && wants(paths, i) {
            missed[count] = i;
            count += 1;
        }
        if count == LANES || (count > 0 && i + 1 == hits.len()) {
            add_environment(scene, paths, &missed[..count], counts, out);
            count = 0;
        }
    }
}

/// Adds the weighted radiance of the environment and the sun for at most sixteen paths.
fn add_environment(
    scene: &Scene,
    paths: &PathWave,
    missed: &[usize],
    counts: TechniqueCounts,
    out: &mut [Radiance],
) {
    let (mut from, mut d, mut pdf) = (Vec3x16::default(), Vec3x16::default(), [f32::INFINITY; LANES]);
    for (lane, &i) in missed.iter().enumerate() {
        from.set_lane(lane, paths.from[i]);
        d.set_lane(lane, paths.rays[i].d);
        pdf[lane] = paths.pdf[i];
    }
    let pdf = f32x16::new(pdf);
    let finite = pdf.simd_lt(f32x16::splat(f32::INFINITY));
    let all = (1 << missed.len()) - 1;
    let gloss = GlossX16::of_lanes(all, |lane| paths.receiver(missed[lane]).gloss);
    let from = ReceiverX16 { p: from, gloss };
    let selection = counts.selection(scene);
    // Each emitter is weighted against its own samples, as if it were alone.
    for emitter in scene.distant_emitters() {
        let (mut radiance, density) = scene.distant_x16(selection, emitter, &d);
        if finite.any() {
            let other = scene.distant_pmf_x16(selection, emitter, &from, missed.len()) * density;
            let weight = weighted_power_heuristic_x16(counts.bsdf, pdf, counts.emitter, other);
            radiance = radiance.map(|c| c * finite.select(weight, f32x16::ONE));
        }
        let [r, g, b] = radiance.map(f32x16::to_array);
        for (lane, &i) in missed.iter().enumerate() {
            out[paths.slots[i] as usize].value += paths.beta(i) * Rgb::new(r[lane], g[lane], b[lane]);
        }
    }
}
