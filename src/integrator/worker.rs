//! The data of one thread: sampler, counters and buffers.

use super::bdpt::sharing::SharedLightPaths;
use super::emission::skip_emitters;
use super::shadows::ShadowQueue;
use super::volpath::bodies::Walkers;
use super::volpath::flights;
use super::volpath::scattering::Scattered;
use super::{Interrupt, Radiance};
use crate::accel::{Coherence, Hit};
use crate::color::Rgb;
use crate::emitter::{Gloss, GlossX16, Receiver};
use crate::ids::MediumId;
use crate::math::lanes::bits;
use crate::math::{Ray, RayX16, Vec3, Vec3x16, f32x16};
use crate::sampling::{Dimension, SampleKey, Sampler};
use crate::scene::Scene;
use bumpalo::Bump;
use serde::{Deserialize, Serialize};
use std::ops::Range;
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

/// The state of a wave of paths, as a structure of arrays of equal length.
#[derive(Default)]
pub struct PathWave {
    /// The next ray.
    pub rays: Vec<Ray>,
    /// The sample's key.
    pub keys: Vec<SampleKey>,
    /// The entry of the output to which the path contributes.
    pub slots: Vec<u32>,
    /// Throughput by channel: the product of the weights so far.
    pub beta: [Vec<f32>; 3],
    /// The surface point at which the ray's direction was sampled. The ray starts beside it, by the rounding error.
    pub from: Vec<Vec3>,
    /// The glossy lobe there for which emitters were chosen. Empty if unused.
    pub gloss: Vec<Gloss>,
    /// Density per unit solid angle of the ray's direction; infinite after the camera or a specular lobe.
    pub pdf: Vec<f32>,
    /// Product of the relative indices of refraction along the path.
    pub eta: Vec<f32>,
    /// Where the path is in media. Empty if unused.
    pub in_media: Vec<InMedia>,
}

/// Where a path is in media.
#[derive(Clone, Copy, Debug)]
pub struct InMedia {
    /// The medium in which the path's ray starts.
    pub medium: Option<MediumId>,
    /// The number of times that bodies have scattered the path.
    pub events: u32,
    /// The index of the point at which a medium scattered the path last, if points near emitters were sampled on that
    /// ray.
    pub on_leg: Option<u32>,
    /// The probability with which an emitter was sampled at the last event; 1 at a surface.
    pub emitter_share: f32,
}

impl InMedia {
    /// Returns the state of a path that no medium has scattered last.
    pub fn in_medium(medium: Option<MediumId>) -> Self {
        InMedia { medium, events: 0, on_leg: None, emitter_share: 1.0 }
    }
}

/// Memory for sorting a wave.
#[derive(Default)]
pub struct SortBuffers {
    order: Vec<u32>,
    paths: PathWave,
    hits: Vec<Option<Hit>>,
}

/// Replaces the contents of `to` by the elements of `from` in the given order.
fn take<T: Copy>(to: &mut Vec<T>, from: &[T], order: &[u32]) {
    to.clear();
    to.extend(order.iter().map(|&i| from[i as usize]));
}

impl PathWave {
    /// Starts a path on every ray.
    pub fn begin(&mut self, rays: &[Ray], keys: &[SampleKey]) {
        assert_eq!(rays.len(), keys.len());
        let n = rays.len();
        self.rays.clear();
        self.rays.extend_from_slice(rays);
        self.keys.clear();
        self.keys.extend_from_slice(keys);
        self.slots.clear();
        self.slots.extend(0..n as u32);
        self.from.clear();
        self.from.extend(rays.iter().map(|ray| ray.o));
        self.gloss.clear();
        self.in_media.clear();
        let [r, g, b] = &mut self.beta;
        let ones = [r, g, b, &mut self.eta].map(|values| (values, 1.0));
        for (values, v) in ones.into_iter().chain([(&mut self.pdf, f32::INFINITY)]) {
            values.clear();
            values.resize(n, v);
        }
    }

    /// Adds a path whose last ray was sampled from a Dirac delta.
    pub fn push(&mut self, ray: Ray, key: SampleKey, slot: u32, beta: Rgb, eta: f32) {
        self.rays.push(ray);
        self.keys.push(key);
        self.slots.push(slot);
        for (channel, value) in self.beta.iter_mut().zip(beta.to_array()) {
            channel.push(value);
        }
        self.from.push(ray.o);
        if !self.gloss.is_empty() {
            self.gloss.push(Gloss::NONE);
        }
        self.pdf.push(f32::INFINITY);
        self.eta.push(eta);
    }

    /// Adds paths that media have scattered.
    pub fn push_scattered(&mut self, scattered: &[Scattered]) {
        self.rays.extend(scattered.iter().map(Scattered::ray));
        self.keys.extend(scattered.iter().map(|path| path.key));
        self.slots.extend(scattered.iter().map(|path| path.slot));
        for (c, channel) in self.beta.iter_mut().enumerate() {
            channel.extend(scattered.iter().map(|path| path.beta[c]));
        }
        self.from.extend(scattered.iter().map(|path| path.p));
        if !self.gloss.is_empty() {
            self.gloss.resize(self.rays.len(), Gloss::NONE);
        }
        self.pdf.extend(scattered.iter().map(|path| path.pdf));
        self.eta.extend(scattered.iter().map(|path| path.eta));
        self.in_media.extend(scattered.iter().map(Scattered::in_media));
    }

    /// Copies another wave.
    pub fn copy_from(&mut self, other: &PathWave) {
        self.rays.clone_from(&other.rays);
        self.keys.clone_from(&other.keys);
        self.slots.clone_from(&other.slots);
        self.beta.clone_from(&other.beta);
        self.from.clone_from(&other.from);
        self.gloss.clone_from(&other.gloss);
        self.pdf.clone_from(&other.pdf);
        self.eta.clone_from(&other.eta);
        self.in_media.clone_from(&other.in_media);
    }

    /// Keeps the first `n` paths.
    pub fn truncate(&mut self, n: usize) {
        self.rays.truncate(n);
        self.keys.truncate(n);
        self.slots.truncate(n);
        self.beta.iter_mut().for_each(|channel| channel.truncate(n));
        self.from.truncate(n);
        self.gloss.truncate(n);
        self.pdf.truncate(n);
        self.eta.truncate(n);
        self.in_media.truncate(n);
    }

    /// Makes room for more paths behind the others, up to `n`.
    pub fn make_room(&mut self, n: usize) {
        let (Some(&ray), Some(&key)) = (self.rays.last(), self.keys.last()) else { return };
        self.rays.resize(n, ray);
        self.keys.resize(n, key);
        self.slots.resize(n, 0);
        self.beta.iter_mut().for_each(|channel| channel.resize(n, 0.0));
        self.from.resize(n, Vec3::ZERO);
        if !self.gloss.is_empty() {
            self.gloss.resize(n, Gloss::NONE);
        }
        self.pdf.resize(n, 0.0);
        self.eta.resize(n, 0.0);
        if !self.in_media.is_empty() {
            self.in_media.resize(n, InMedia::in_medium(None));
        }
    }

    /// Removes a range of paths. The last ones take their places.
    pub fn remove(&mut self, range: Range<usize>) {
        fn fill<T: Copy>(list: &mut Vec<T>, gap: &Range<usize>) {
            let last = gap.end.max(list.len() - gap.len());
            list.copy_within(last.., gap.start);
            list.truncate(list.len() - gap.len());
        }
        fill(&mut self.rays, &range);
        fill(&mut self.keys, &range);
        fill(&mut self.slots, &range);
        self.beta.iter_mut().for_each(|channel| fill(channel, &range));
        fill(&mut self.from, &range);
        if !self.gloss.is_empty() {
            fill(&mut self.gloss, &range);
        }
        fill(&mut self.pdf, &range);
        fill(&mut self.eta, &range);
        if !self.in_media.is_empty() {
            fill(&mut self.in_media, &range);
        }
    }

    /// Keeps the paths that have hit something, sorted by the bucket of the shape. Paths of a bucket keep their order.
    /// Without buckets, all do.
    pub fn keep_sorted(&mut self, hits: &mut Vec<Option<Hit>>, bucket_of: &[u8], buffers: &mut SortBuffers) {
        let bucket = |hit: &Hit| bucket_of[hit.geometry as usize] as usize;
        let mut starts = [0; 256];
        if !bucket_of.is_empty() {
            hits.iter().flatten().for_each(|hit| starts[bucket(hit)] += 1);
        }
        if starts.iter().filter(|count| **count > 0).count() < 2 {
            return self.keep_hits(hits, |_, _| {});
        }
        let mut sum = 0;
        for start in &mut starts {
            (*start, sum) = (sum, sum + *start);
        }
        let SortBuffers { order, paths, hits: sorted } = buffers;
        order.resize(sum, 0);
        for (i, hit) in hits.iter().enumerate() {
            if let Some(hit) = hit {
                let to = &mut starts[bucket(hit)];
                order[*to] = i as u32;
                *to += 1;
            }
        }
        take(sorted, hits, order);
        take(&mut paths.rays, &self.rays, order);
        take(&mut paths.keys, &self.keys, order);
        take(&mut paths.slots, &self.slots, order);
        for (to, from) in paths.beta.iter_mut().zip(&self.beta) {
            take(to, from, order);
        }
        take(&mut paths.from, &self.from, order);
        if self.gloss.is_empty() {
            paths.gloss.clear();
        } else {
            take(&mut paths.gloss, &self.gloss, order);
        }
        take(&mut paths.pdf, &self.pdf, order);
        take(&mut paths.eta, &self.eta, order);
        if self.in_media.is_empty() {
            paths.in_media.clear();
        } else {
            take(&mut paths.in_media, &self.in_media, order);
        }
        std::mem::swap(self, paths);
        std::mem::swap(hits, sorted);
    }

    /// Sets the throughput of path `i`.
    #[inline]
    pub fn set_beta(&mut self, i: usize, beta: Rgb) {
        for (channel, value) in self.beta.iter_mut().zip(beta.to_array()) {
            channel[i] = value;
        }
    }

    /// Returns the throughput of path `i`.
    #[inline]
    pub fn beta(&self, i: usize) -> Rgb {
        Rgb::new(self.beta[0][i], self.beta[1][i], self.beta[2][i])
    }

    /// Returns the point at which the direction of path `i` was sampled, as emitters were chosen for it.
    #[inline]
    pub fn receiver(&self, i: usize) -> Receiver {
        Receiver { p: self.from[i], gloss: self.gloss.get(i).copied().unwrap_or(Gloss::NONE) }
    }

    /// Writes the continuations of paths `first..first + 16`, for the lanes in the mask `lanes`, to the indices from
    /// `to` on. Returns the index after the last. The paths up to `first + 16` must have been read before.
    #[inline(always)]
    pub fn compact(&mut self, first: usize, mut to: usize, next: &Continuation, lanes: u32) -> usize {
        let rays = next.rays.to_rays();
        let [r, g, b] = next.beta.map(f32x16::to_array);
        let (pdf, eta) = (next.pdf.to_array(), next.eta.to_array());
        if next.gloss.is_some() {
            self.gloss.resize(self.rays.len(), Gloss::NONE);
        }
        if !self.in_media.is_empty() {
            for (to, i) in (to..).zip(bits(lanes)) {
                self.in_media[to] = self.in_media[first + i];
            }
        }
        for i in bits(lanes) {
            if let Some(gloss) = self.gloss.get_mut(to) {
                *gloss = next.gloss.as_ref().map_or(Gloss::NONE, |gloss| gloss.lane(i));
            }
            self.rays[to] = rays[i];
            self.keys[to] = self.keys[first + i];
            self.slots[to] = self.slots[first + i];
            (self.beta[0][to], self.beta[1][to], self.beta[2][to]) = (r[i], g[i], b[i]);
            self.from[to] = next.from.lane(i);
            self.pdf[to] = pdf[i];
            self.eta[to] = eta[i];
            to += 1;
        }
        to
    }

    /// Removes the paths that hit nothing, and their entries in `hits`, after calling `missed` for each.
    pub fn keep_hits(&mut self, hits: &mut Vec<Option<Hit>>, mut missed: impl FnMut(&PathWave, usize)) {
        if hits.iter().all(Option::is_some) {
            return;
        }
        let mut to = 0;
        for i in 0..hits.len() {
            if hits[i].is_none() {
                missed(self, i);
                continue;
            }
            hits[to] = hits[i];
            self.rays[to] = self.rays[i];
            self.keys[to] = self.keys[i];
            self.slots[to] = self.slots[i];
            self.beta.iter_mut().for_each(|channel| channel[to] = channel[i]);
            self.from[to] = self.from[i];
            if !self.gloss.is_empty() {
                self.gloss[to] = self.gloss[i];
            }
            self.pdf[to] = self.pdf[i];
            self.eta[to] = self.eta[i];
            if !self.in_media.is_empty() {
                self.in_media[to] = self.in_media[i];
            }
            to += 1;
        }
        hits.truncate(to);
        self.truncate(to);
    }
}

/// The continuations of sixteen paths.
pub struct Continuation {
    /// The next rays.
    pub rays: RayX16,
    /// The surface points at which the directions were sampled.
    pub from: Vec3x16,
    /// The glossy lobes there for which emitters were chosen.
    pub gloss: Option<GlossX16>,
    /// The throughputs by channel.
    pub beta: [f32x16; 3],
    /// The densities of the directions.
    pub pdf: f32x16,
    /// The products of the relative indices of refraction.
    pub eta: f32x16,
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
}

impl Worker {
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
