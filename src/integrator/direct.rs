//! Direct illumination: emitted light and light scattered once.

use super::lighting::{self, TechniqueCounts};
use super::path::first_hits;
use super::settings::DirectSettings;
use super::worker::{PathWave, draw_1d, draw_2d, intersect};
use super::{Integrator, Radiance, RadianceQuery, Wave, Worker};
use crate::accel::{Coherence, Hit};
use crate::math::Vec2;
use crate::sampling::Dimension;
use crate::scene::{Scene, SurfaceInteraction};

/// Samples emitters and the BSDF at the first surface, each as often as told, weighted by the power heuristic.
pub struct DirectIntegrator {
    settings: DirectSettings,
    counts: TechniqueCounts,
}

/// Rays drawn from the BSDFs of a wave, and what they hit.
#[derive(Default)]
struct Scattered {
    paths: PathWave,
    hits: Vec<Option<Hit>>,
}

impl DirectIntegrator {
    /// The integrator with its settings.
    pub fn new(settings: DirectSettings) -> Self {
        let counts =
            TechniqueCounts { emitter: settings.emitter_samples as f32, bsdf: settings.bsdf_samples as f32 };
        DirectIntegrator { settings, counts }
    }

    /// Emitter sample `i` of every path in hand.
    fn emitter_sample(
        &self,
        scene: &Scene,
        i: u32,
        points: &[Option<SurfaceInteraction>],
        worker: &mut Worker,
    ) {
        let Worker { sampler, paths, numbers, shadows, .. } = worker;
        draw_1d(*sampler, Dimension::emitter_choice(0).repeat(i), &paths.keys, &mut numbers.emitter_choice);
        draw_2d(*sampler, Dimension::emitter_point(0).repeat(i), &paths.keys, &mut numbers.emitter_point);
        for (slot, at) in points.iter().enumerate() {
            let Some(at) = at else { continue };
            let bsdf = scene.bsdf(at);
            if bsdf.is_specular() {
                continue;
            }
            let ray = &paths.rays[slot];
            let u = Vec2::new(numbers.emitter_point[0][slot], numbers.emitter_point[1][slot]);
            let u = (numbers.emitter_choice[slot], u);
            let wo = at.frame.to_local(-ray.d);
            if let Some((shadow, value)) =
                lighting::sample_emitter(scene, at, bsdf, wo, u, self.counts, ray.time)
            {
                shadows.push(shadow, slot as u32, value);
            }
        }
    }

    /// BSDF sample `i` of every path in hand.
    fn bsdf_sample(
        &self,
        scene: &Scene,
        i: u32,
        points: &[Option<SurfaceInteraction>],
        worker: &mut Worker,
        Scattered { paths: scattered, hits }: &mut Scattered,
        out: &mut [Radiance],
    ) {
        let Worker { sampler, paths, numbers, counters, .. } = worker;
        draw_1d(*sampler, Dimension::bsdf_lobe(0).repeat(i), &paths.keys, &mut numbers.bsdf_lobe);
        draw_2d(*sampler, Dimension::bsdf_direction(0).repeat(i), &paths.keys, &mut numbers.bsdf_direction);
        scattered.truncate(0);
        for (slot, at) in points.iter().enumerate() {
            let Some(at) = at else { continue };
            let ray = &paths.rays[slot];
            let u = Vec2::new(numbers.bsdf_direction[0][slot], numbers.bsdf_direction[1][slot]);
            let sample = scene.bsdf(at).sample(at.frame.to_local(-ray.d), numbers.bsdf_lobe[slot], u);
            let Some(sample) = sample else { continue };
            scattered.rays.push(scene.spawn_ray(at, at.frame.to_world(sample.wi), ray.time));
            scattered.slots.push(slot as u32);
            scattered.beta.push(sample.weight / self.counts.bsdf);
            scattered.pdf.push(sample.pdf);
        }
        intersect(scene, &scattered.rays, Coherence::Incoherent, hits, counters);
        for (j, hit) in hits.iter().enumerate() {
            let ray = &scattered.rays[j];
            let counts = if scene.needs.emitter_sampling {
                self.counts
            } else {
                TechniqueCounts { emitter: 0.0, ..self.counts }
            };
            let le = match lighting::interaction(scene, ray, hit) {
                Some(at) => lighting::emitted_at(scene, &at, ray.o, scattered.pdf[j], counts),
                None => lighting::environment(scene, scattered.pdf[j], counts),
            };
            out[scattered.slots[j] as usize].value += scattered.beta[j] * le;
        }
    }
}

impl Integrator for DirectIntegrator {
    fn name(&self) -> &'static str {
        "direct"
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
        let points: Vec<Option<SurfaceInteraction>> = (worker.hits.iter().zip(&worker.paths.rays))
            .map(|(hit, ray)| lighting::interaction(scene, ray, hit))
            .collect();
        if query.emitted && !self.settings.hide_emitters {
            for ((out, at), ray) in out.iter_mut().zip(&points).zip(&worker.paths.rays) {
                out.value += match at {
                    Some(at) => lighting::emitted_at(scene, at, ray.o, f32::INFINITY, self.counts),
                    None => lighting::environment(scene, f32::INFINITY, self.counts),
                };
            }
        }
        if !query.direct {
            return;
        }
        if scene.needs.emitter_sampling {
            for i in 0..self.settings.emitter_samples {
                self.emitter_sample(scene, i, &points, worker);
                worker.trace_shadows(scene, wave.coherence, |slot, value| out[slot].value += value);
            }
        }
        if scene.needs.hit_emitters {
            let mut scattered = Scattered::default();
            for i in 0..self.settings.bsdf_samples {
                self.bsdf_sample(scene, i, &points, worker, &mut scattered, out);
            }
        }
    }
}
