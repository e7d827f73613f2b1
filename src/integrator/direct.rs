//! Direct illumination: emitted light and light scattered once.

use super::block::ShadingBlock;
use super::lighting::{self, TechniqueCounts};
use super::path::first_hits;
use super::path_wave::{Continuation, PathWave};
use super::settings::{MAX_SAMPLES, PathLimits, Plugin, Read, Source};
use super::worker::{draw_1d, draw_2d, intersect};
use super::{Integrator, Radiance, RadianceQuery, Wave, Worker};
use crate::accel::Coherence;
use crate::bsdf;
use crate::error::Result;
use crate::math::lanes::{f32x16, load};
use crate::sampling::Dimension;
use crate::scene::Scene;
use bumpalo::Bump;

/// Direct illumination only.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
pub struct DirectSettings {
    /// Samples of the emitters at each shading point.
    pub emitter_samples: u32,
    /// Samples of the BSDF at each shading point.
    pub bsdf_samples: u32,
    /// Whether emitters are invisible to the camera.
    pub hide_emitters: bool,
}

impl Default for DirectSettings {
    fn default() -> Self {
        DirectSettings { emitter_samples: 1, bsdf_samples: 1, hide_emitters: false }
    }
}

/// Samples the emitters and the BSDF at the first surface, with a given number of samples each, weighted by the power
/// heuristic.
pub struct DirectIntegrator {
    settings: DirectSettings,
    counts: TechniqueCounts,
}

impl DirectIntegrator {
    /// Creates the integrator.
    pub fn new(settings: DirectSettings) -> Self {
        let counts = TechniqueCounts::new(settings.emitter_samples, settings.bsdf_samples);
        DirectIntegrator { settings, counts }
    }

    /// Adds emitter sample `i` of every path in the current wave.
    fn emitter_sample(&self, scene: &Scene, i: u32, blocks: &[ShadingBlock<'_>], worker: &mut Worker) {
        let Worker { sampler, paths, numbers, shadows, .. } = worker;
        draw_2d(*sampler, Dimension::emitter_point(0).repeat(i), &paths.keys, &mut numbers.emitter_point);
        for block in blocks.iter().filter(|block| block.finite != 0) {
            let u_point = [0, 1].map(|k| load(&numbers.emitter_point[k], block.first));
            let sampled = lighting::sample_emitters(scene, block, u_point, self.counts);
            shadows.push(&sampled.rays, &paths.slots[block.first..], &sampled.value, sampled.lanes);
        }
    }

    /// Adds BSDF sample `i` of every path in the current wave.
    fn bsdf_sample(
        &self,
        scene: &Scene,
        i: u32,
        blocks: &[ShadingBlock<'_>],
        worker: &mut Worker,
        scattered: &mut PathWave,
        out: &mut [Radiance],
    ) {
        let Worker { sampler, paths, numbers, hits, counters, .. } = worker;
        draw_1d(*sampler, Dimension::bsdf_lobe(0).repeat(i), &paths.keys, &mut numbers.bsdf_lobe);
        draw_2d(*sampler, Dimension::bsdf_direction(0).repeat(i), &paths.keys, &mut numbers.bsdf_direction);
        scattered.copy_from(paths);
        let mut alive = 0;
        for block in blocks {
            let u_lobe = load(&numbers.bsdf_lobe, block.first);
            let u = [0, 1].map(|k| load(&numbers.bsdf_direction[k], block.first));
            let sample = bsdf::lanes::sample_x16(&block.bsdfs, &block.wo, u_lobe, u, block.active);
            let wi = block.at.frame.to_world(sample.wi);
            let next = Continuation {
                from: block.at.p,
                gloss: None,
                rays: scene.spawn_rays(&block.at, wi, block.rays.time),
                beta: sample.weight.map(|w| w / f32x16::splat(self.counts.bsdf)),
                pdf: sample.pdf,
                eta: sample.eta,
            };
            let lanes = sample.valid.to_bitmask() & block.active;
            alive = scattered.compact(block.first, alive, &next, lanes);
        }
        scattered.truncate(alive);
        intersect(scene, &scattered.rays, Coherence::Incoherent, hits, counters);
        lighting::drop_missed(scene, scattered, hits, out, self.counts, |_, _| true);
        for block in ShadingBlock::all(scene, &Bump::new(), &scattered.rays, hits) {
            for (i, le) in lighting::emitted(scene, &block, scattered, self.counts) {
                let i = block.first + i;
                out[scattered.slots[i] as usize].value += scattered.beta(i) * le;
            }
        }
    }
}

impl Plugin for DirectIntegrator {
    const NAME: &'static str = "direct";
    type Settings = DirectSettings;

    fn read(source: &mut dyn Source) -> Result<DirectSettings> {
        let default = DirectSettings::default();
        let both = source.integer("shading_samples", 0..=i64::from(MAX_SAMPLES))?.map(|n| n as u32);
        if both.is_some() && (source.has("emitter_samples") || source.has("bsdf_samples")) {
            let message = "expected either shading_samples or emitter_samples and bsdf_samples, found both";
            return Err(source.error("shading_samples", message));
        }
        let mut count = |name, default| source.count(name, 0..=MAX_SAMPLES, both.unwrap_or(default));
        let settings = DirectSettings {
            emitter_samples: count("emitter_samples", default.emitter_samples)?,
            bsdf_samples: count("bsdf_samples", default.bsdf_samples)?,
            hide_emitters: source.boolean("hide_emitters", default.hide_emitters)?,
        };
        match settings.emitter_samples + settings.bsdf_samples {
            0 => Err(source.object_error("expected at least one emitter or bsdf sample")),
            _ => Ok(settings),
        }
    }

    fn with_limits(limits: PathLimits) -> DirectSettings {
        DirectSettings { hide_emitters: limits.hide_emitters, ..DirectSettings::default() }
    }

    fn limits(settings: &DirectSettings) -> PathLimits {
        PathLimits { hide_emitters: settings.hide_emitters, ..PathLimits::default() }
    }

    fn create(settings: &DirectSettings) -> Box<dyn Integrator> {
        Box::new(DirectIntegrator::new(*settings))
    }
}

impl Integrator for DirectIntegrator {
    fn name(&self) -> &'static str {
        "direct"
    }

    fn shows_emitters(&self) -> bool {
        !self.settings.hide_emitters
    }

    fn adapts(&self) -> bool {
        true
    }

    fn shows_environment(&self) -> bool {
        !self.settings.hide_emitters
    }

    fn li(
        &self,
        scene: &Scene,
        wave: Wave<'_>,
        query: RadianceQuery,
        worker: &mut Worker,
        out: &mut [Radiance],
    ) {
        out.fill(Radiance::NONE);
        worker.paths.begin(wave.rays, wave.keys);
        intersect(scene, &worker.paths.rays, wave.coherence, &mut worker.hits, &mut worker.counters);
        first_hits(scene, self.settings.hide_emitters, worker, out);
        let see = query.emitted && !self.settings.hide_emitters;
        let Worker { paths, hits, .. } = worker;
        lighting::drop_missed(scene, paths, hits, out, self.counts, |_, _| see);
        let arena = Bump::new();
        let blocks: Vec<ShadingBlock<'_>> = ShadingBlock::all(scene, &arena, &paths.rays, hits).collect();
        if see {
            for block in &blocks {
                for (i, le) in lighting::emitted(scene, block, paths, self.counts) {
                    out[paths.slots[block.first + i] as usize].value += le;
                }
            }
        }
        if !query.direct {
            return;
        }
        if self.counts.samples_emitters(scene) {
            for i in 0..self.settings.emitter_samples {
                self.emitter_sample(scene, i, &blocks, worker);
                worker.trace_shadows(scene, wave.coherence, |slot, value| out[slot].value += value);
            }
        }
        if scene.needs.hit_emitters {
            let mut scattered = PathWave::default();
            for i in 0..self.settings.bsdf_samples {
                self.bsdf_sample(scene, i, &blocks, worker, &mut scattered, out);
            }
        }
    }
}
