//! The path integrator. [Kajiya 1986; Veach 1997]
//!
//! A wave of paths advances one bounce at a time: all nearest hits, then shading (each path emits at most one
//! shadow ray with its pending contribution, and one next ray), then all shadow rays, then the dead paths are
//! squeezed out.

use super::lighting::{self, TechniqueCounts};
use super::settings::PathSettings;
use super::worker::{Numbers, PathWave, ShadowQueue, draw_1d, draw_2d, intersect};
use super::{Integrator, Radiance, RadianceQuery, Wave, Worker, emission};
use crate::accel::{Coherence, Hit};
use crate::bsdf::Bsdf;
use crate::math::{Vec2, Vec3};
use crate::sampling::{Dimension, SampleKey, Sampler};
use crate::scene::{Scene, SurfaceInteraction};

/// Unidirectional path tracing with next-event estimation, combined by the power heuristic.
pub struct PathIntegrator {
    settings: PathSettings,
}

/// What every path of a bounce has in common.
struct Bounce<'a> {
    scene: &'a Scene,
    /// Scattering events so far.
    depth: u32,
    /// Whether emitters are sampled at this bounce.
    next_event: bool,
    /// Whether light found by the rays of this bounce is wanted.
    add_emission: bool,
    /// Whether roulette is played at this bounce.
    roulette: bool,
}

impl PathIntegrator {
    /// The integrator with its settings.
    pub fn new(settings: PathSettings) -> Self {
        PathIntegrator { settings }
    }

    /// Whether a path may have that many edges.
    fn allows(&self, edges: u32) -> bool {
        self.settings.max_depth.is_none_or(|max| edges <= max)
    }

    /// Draws the numbers that this bounce's shading uses, and no others.
    fn draw(&self, bounce: &Bounce<'_>, sampler: Sampler, keys: &[SampleKey], numbers: &mut Numbers) {
        let depth = bounce.depth;
        if bounce.next_event {
            // With a single emitter there is nothing to choose.
            if bounce.scene.lights.len() > 1 {
                draw_1d(sampler, Dimension::emitter_choice(depth), keys, &mut numbers.emitter_choice);
            } else {
                numbers.emitter_choice.clear();
                numbers.emitter_choice.resize(keys.len(), 0.0);
            }
            draw_2d(sampler, Dimension::emitter_point(depth), keys, &mut numbers.emitter_point);
        }
        if bounce.scene.needs.lobe_choice {
            draw_1d(sampler, Dimension::bsdf_lobe(depth), keys, &mut numbers.bsdf_lobe);
        } else {
            numbers.bsdf_lobe.clear();
            numbers.bsdf_lobe.resize(keys.len(), 0.0);
        }
        draw_2d(sampler, Dimension::bsdf_direction(depth), keys, &mut numbers.bsdf_direction);
        if bounce.roulette {
            draw_1d(sampler, Dimension::roulette(depth), keys, &mut numbers.roulette);
        }
    }
}

impl Integrator for PathIntegrator {
    fn name(&self) -> &'static str {
        "path"
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
        let mut depth = 0;
        while !worker.paths.rays.is_empty() && self.allows(depth + 1) {
            let coherence = if depth == 0 { wave.coherence } else { Coherence::Incoherent };
            intersect(scene, &worker.paths.rays, coherence, &mut worker.hits, &mut worker.counters);
            if depth == 0 {
                first_hits(scene, self.settings.hide_emitters, worker, out);
            }
            let bounce = Bounce {
                scene,
                depth,
                next_event: scene.needs.emitter_sampling && self.allows(depth + 2) && query.wants(depth + 2),
                add_emission: query.wants(depth + 1) && !(depth == 0 && self.settings.hide_emitters),
                roulette: depth + 1 >= self.settings.rr_depth,
            };
            let scatter = self.allows(depth + 2) && (query.direct || query.indirect);
            if scatter {
                self.draw(&bounce, worker.sampler, &worker.paths.keys, &mut worker.numbers);
            }
            let alive = shade_wave(&bounce, scatter, worker, out);
            worker.paths.truncate(alive);
            if bounce.next_event {
                worker.trace_shadows(scene, coherence, |slot, value| out[slot].value += value);
            }
            depth += 1;
        }
    }
}

/// Writes the distances of the first surfaces, behind emitters that are to be hidden.
pub(super) fn first_hits(scene: &Scene, hide_emitters: bool, worker: &mut Worker, out: &mut [Radiance]) {
    for (out, hit) in out.iter_mut().zip(&worker.hits) {
        out.distance = hit.map_or(f32::INFINITY, |h| h.t);
    }
    if hide_emitters && scene.needs.hit_emitters {
        let Worker { paths, hits, counters, .. } = worker;
        let passed = emission::skip_emitters(scene, &mut paths.rays, hits, counters);
        for ((out, hit), passed) in out.iter_mut().zip(&*hits).zip(passed) {
            out.distance = hit.map_or(f32::INFINITY, |h| passed + h.t);
        }
    }
}

/// Shades every path of the wave and moves the survivors to the front; returns how many there are.
fn shade_wave(bounce: &Bounce<'_>, scatter: bool, worker: &mut Worker, out: &mut [Radiance]) -> usize {
    let Worker { hits, shadows, paths, numbers, .. } = worker;
    let mut alive = 0;
    for (i, hit) in hits.iter().enumerate() {
        let Some(hit) = hit else {
            if bounce.add_emission && bounce.scene.needs.environment {
                let le = lighting::environment(bounce.scene, paths.pdf[i], TechniqueCounts::ONE_EACH);
                out[paths.slots[i] as usize].value += paths.beta[i] * le;
            }
            continue;
        };
        if shade(bounce, scatter, i, alive, hit, paths, numbers, shadows, out) {
            alive += 1;
        }
    }
    alive
}

/// Shades path `i`: adds what it found, queues a shadow ray, and writes its continuation to place `to`.
#[expect(
    clippy::too_many_arguments,
    reason = "the arrays of a wave, split so that they can be borrowed apart"
)]
#[inline]
fn shade(
    bounce: &Bounce<'_>,
    scatter: bool,
    i: usize,
    to: usize,
    hit: &Hit,
    paths: &mut PathWave,
    numbers: &Numbers,
    shadows: &mut ShadowQueue,
    out: &mut [Radiance],
) -> bool {
    let scene = bounce.scene;
    let ray = paths.rays[i];
    let beta = paths.beta[i];
    let slot = paths.slots[i];
    let at = scene.interaction(&ray, hit);
    if bounce.add_emission && scene.needs.hit_emitters {
        let le = lighting::emitted_at(scene, &at, ray.o, paths.pdf[i], TechniqueCounts::ONE_EACH);
        if !le.is_black() {
            out[slot as usize].value += beta * le;
        }
    }
    if !scatter {
        return false;
    }
    let bsdf = scene.bsdf(&at);
    let wo = at.frame.to_local(-ray.d);
    if bounce.next_event && !bsdf.is_specular() {
        let u = Vec2::new(numbers.emitter_point[0][i], numbers.emitter_point[1][i]);
        let u = (numbers.emitter_choice[i], u);
        let sampled = lighting::sample_emitter(scene, &at, bsdf, wo, u, TechniqueCounts::ONE_EACH, ray.time);
        if let Some((shadow, value)) = sampled {
            shadows.push(shadow, slot, beta * value);
        }
    }
    continue_path(bounce, &at, bsdf, wo, i, to, paths, numbers)
}

/// Samples the BSDF and plays roulette; writes the path's continuation to place `to`.
#[expect(
    clippy::too_many_arguments,
    reason = "the arrays of a wave, split so that they can be borrowed apart"
)]
#[inline]
fn continue_path(
    bounce: &Bounce<'_>,
    at: &SurfaceInteraction,
    bsdf: &Bsdf,
    wo: Vec3,
    i: usize,
    to: usize,
    paths: &mut PathWave,
    numbers: &Numbers,
) -> bool {
    let u = Vec2::new(numbers.bsdf_direction[0][i], numbers.bsdf_direction[1][i]);
    let Some(sample) = bsdf.sample(wo, numbers.bsdf_lobe[i], u) else {
        return false;
    };
    let mut beta = paths.beta[i] * sample.weight;
    let eta = paths.eta[i] * sample.eta;
    let strongest = beta.max_component();
    if strongest == 0.0 {
        return false;
    }
    if bounce.roulette {
        // Radiance is scaled by η² inside a dielectric, which says nothing about its importance.
        let survival = (strongest * eta * eta).min(0.95);
        if numbers.roulette[i] >= survival {
            return false;
        }
        beta = beta / survival;
    }
    let time = paths.rays[i].time;
    paths.rays[to] = bounce.scene.spawn_ray(at, at.frame.to_world(sample.wi), time);
    paths.keys[to] = paths.keys[i];
    paths.slots[to] = paths.slots[i];
    paths.beta[to] = beta;
    paths.pdf[to] = sample.pdf;
    paths.eta[to] = eta;
    true
}
