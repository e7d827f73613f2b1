//! The data of one thread: sampler, counters and buffers.

use super::bdpt::sharing::SharedLightPaths;
use super::emission::skip_emitters;
use super::path_wave::{PathWave, SortBuffers};
use super::shadows::ShadowQueue;
use super::volpath::bodies::Walkers;
use super::volpath::flights;
use super::{Interrupt, Radiance};
use crate::accel::{Coherence, Hit};
use crate::color::Rgb;
use crate::math::Ray;
use crate::sampling::{Dimension, SampleKey, Sampler};
use crate::scene::Scene;
use bumpalo::Bump;
use serde::{Deserialize, Serialize};
use std::time::{Duration, Instant};

/// The counters of one worker, merged at the end.
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
pub struct Counters {
    /// Number of nearest-hit queries.
    pub closest_rays: u64,
    /// Number of occlusion queries.
    pub occlusion_rays: u64,
    /// Number of camera paths.
    pub paths: u64,
    /// Time in the accelerator for nearest hits.
    pub closest_time: Duration,
    /// Time in the accelerator for occlusion.
    pub occlusion_time: Duration,
}

impl Counters {
    /// Returns the cost of the rays in nearest-hit queries, the same on every machine.
    pub fn cost(&self, scene: &Scene) -> f64 {
        self.closest_rays as f64 + scene.occlusion_cost * self.occlusion_rays as f64
    }

    /// Adds the counts of another worker.
    pub fn merge(&mut self, other: &Counters) {
        self.closest_rays += other.closest_rays;
        self.occlusion_rays += other.occlusion_rays;
        self.paths += other.paths;
        self.closest_time += other.closest_time;
        self.occlusion_time += other.occlusion_time;
    }
}

/// The state of one thread. It does not influence the result of a sample.
pub struct Worker {
    /// The sampler.
    pub sampler: Sampler,
    /// The counts so far.
    pub counters: Counters,
    /// Nearest hits of the current wave.
    pub hits: Vec<Option<Hit>>,
    /// Shadow rays of the current wave.
    pub shadows: ShadowQueue,
    /// The current wave, for integrators that scatter.
    pub paths: PathWave,
    /// Memory for sorting the wave.
    pub sort_buffers: SortBuffers,
    /// The paths of the current wave that are in media which fill bodies.
    pub walkers: Walkers,
    /// The paths of the current wave that are in other media.
    pub flights: flights::Buffers,
    /// Random numbers of the current wave.
    pub numbers: RandomNumbers,
    /// Random numbers of the samples at a surface where paths are split.
    pub split_numbers: Vec<RandomNumbers>,
    /// For each entry of the output, whether the path has had specular lobes only. Empty if unused.
    pub specular_only: Vec<bool>,
    /// The ratios of densities of the caustics of a wave of paths.
    pub caustic_ratios: Vec<f32>,
    /// For each entry of the output, whether the path only searches for emitters. Empty if unused.
    pub probing: Vec<bool>,
    /// The light paths that belong to the current wave of camera rays, for integrators that trace both. Empty if each
    /// camera path has a light path with its own key.
    pub shared_light: SharedLightPaths,
    /// Memory for the BSDFs of the current wave that vary over the surface.
    pub arena: Bump,
    /// Memory for BSDFs that are used until the end of a wave.
    pub kept_arena: Bump,
    /// Memory for the radiance of the current wave and of its tails.
    pub radiance: Vec<Radiance>,
    /// The time of all new rays, in [0, 1] over the shutter interval; `None` if each sample draws its own.
    pub time: Option<f32>,
    /// A request to stop, after which the result of the current wave is discarded.
    pub interrupt: Interrupt,
}

/// The random numbers of one bounce, for a whole wave.
#[derive(Default)]
pub struct RandomNumbers {
    /// Choice of the emitter and position on it.
    pub emitter_point: [Vec<f32>; 2],
    /// Choice of the lobe.
    pub bsdf_lobe: Vec<f32>,
    /// Direction within the lobe.
    pub bsdf_direction: [Vec<f32>; 2],
    /// Russian roulette.
    pub roulette: Vec<f32>,
}

impl Worker {
    /// Creates a worker with empty buffers.
    pub fn new(sampler: Sampler) -> Self {
        Worker {
            sampler,
            counters: Counters::default(),
            hits: Vec::new(),
            shadows: ShadowQueue::default(),
            paths: PathWave::default(),
            sort_buffers: SortBuffers::default(),
            walkers: Walkers::default(),
            flights: flights::Buffers::default(),
            numbers: RandomNumbers::default(),
            split_numbers: Vec::new(),
            specular_only: Vec::new(),
            caustic_ratios: Vec::new(),
            probing: Vec::new(),
            shared_light: SharedLightPaths::default(),
            arena: Bump::new(),
            kept_arena: Bump::new(),
            radiance: Vec::new(),
            time: None,
            interrupt: Interrupt::default(),
        }
    }

    /// Returns the worker with the given stop request.
    #[must_use]
    pub fn with_interrupt(self, interrupt: &Interrupt) -> Self {
        Worker { interrupt: interrupt.clone(), ..self }
    }

    /// Finds the nearest hits of `rays` and stores them in `self.hits`.
    pub fn intersect(&mut self, scene: &Scene, rays: &[Ray], coherence: Coherence) {
        intersect(scene, rays, coherence, &mut self.hits, &mut self.counters);
    }

    /// Traces the queued shadow rays, calls `add` for the unoccluded ones in queue order, and empties the queue.
    pub fn trace_shadows(&mut self, scene: &Scene, coherence: Coherence, add: impl FnMut(usize, Rgb)) {
        let mut occluded = std::mem::take(&mut self.shadows.occluded);
        let rays = &self.shadows.rays;
        occluded.clear();
        occluded.resize(rays.len(), false);
        let started = Instant::now();
        scene.accel.occluded_wave(rays, &mut occluded, coherence);
        self.counters.occlusion_time += started.elapsed();
        self.counters.occlusion_rays += rays.len() as u64;
        self.shadows.finish(scene, occluded.iter().copied(), add);
        self.shadows.occluded = occluded;
    }

    /// Computes [`trace_shadows`](Self::trace_shadows) for rays that pass through emitting shapes.
    pub fn trace_shadows_past_emitters(&mut self, scene: &Scene, add: impl FnMut(usize, Rgb)) {
        let Worker { shadows, hits, counters, .. } = self;
        intersect(scene, &shadows.rays, Coherence::Incoherent, hits, counters);
        // The whole rays go through media.
        let mut last = match shadows.has_departures() {
            false => std::mem::take(&mut shadows.rays),
            true => shadows.rays.clone(),
        };
        skip_emitters(scene, &mut last, hits, counters);
        shadows.finish(scene, hits.iter().map(Option::is_some), add);
    }
}

/// Finds nearest hits. A free function, so that `rays` may belong to the worker.
pub fn intersect(
    scene: &Scene,
    rays: &[Ray],
    coherence: Coherence,
    hits: &mut Vec<Option<Hit>>,
    counters: &mut Counters,
) {
    hits.clear();
    hits.resize(rays.len(), None);
    let started = Instant::now();
    scene.accel.intersect_wave(rays, hits, coherence);
    counters.closest_time += started.elapsed();
    counters.closest_rays += rays.len() as u64;
}

/// The random numbers that the shading of a bounce uses.
#[derive(Clone, Copy, Debug)]
pub struct BounceNumbers {
    /// Whether an emitter is sampled.
    pub next_event: bool,
    /// Whether sampling chooses among the lobes of the BSDF.
    pub lobe: bool,
    /// Whether a direction is sampled.
    pub direction: bool,
    /// Whether Russian roulette is played.
    pub roulette: bool,
}

impl RandomNumbers {
    /// Draws the random numbers that a bounce uses, and no others.
    pub fn draw(&mut self, uses: BounceNumbers, depth: u32, sampler: Sampler, keys: &[SampleKey]) {
        let zero = |numbers: &mut Vec<f32>| {
            numbers.clear();
            numbers.resize(keys.len(), 0.0);
        };
        if uses.next_event {
            draw_2d(sampler, Dimension::emitter_point(depth), keys, &mut self.emitter_point);
        }
        if uses.lobe {
            draw_1d(sampler, Dimension::bsdf_lobe(depth), keys, &mut self.bsdf_lobe);
        } else {
            zero(&mut self.bsdf_lobe);
        }
        if uses.direction {
            draw_2d(sampler, Dimension::bsdf_direction(depth), keys, &mut self.bsdf_direction);
        }
        if uses.roulette {
            draw_1d(sampler, Dimension::roulette(depth), keys, &mut self.roulette);
        }
    }
}

/// Draws one number for each key into `out`.
pub fn draw_1d(sampler: Sampler, dimension: Dimension, keys: &[SampleKey], out: &mut Vec<f32>) {
    out.resize(keys.len(), 0.0);
    sampler.fill_1d(dimension, keys, &mut out[..keys.len()]);
}

/// Draws a pair of numbers for each key into `out`.
pub fn draw_2d(sampler: Sampler, dimension: Dimension, keys: &[SampleKey], out: &mut [Vec<f32>; 2]) {
    let [x, y] = out;
    x.resize(keys.len(), 0.0);
    y.resize(keys.len(), 0.0);
    sampler.fill_2d(dimension, keys, x, y);
}
