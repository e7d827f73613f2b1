//! Walks of paths through media that fill bodies, sixteen at a time.
//!
//! Light gets into such media by being scattered at their boundaries only ([`SceneMedia::fill_bodies`]), so emitter
//! samples inside would find none. Between two bounces of the wave, a path is scattered in a body until it meets a
//! surface. The light that its ray finds there has the weight 1.

use crate::accel::{Coherence, Hit};
use crate::color::Rgb;
use crate::ids::MediumId;
use crate::integrator::flight::{before_end, rounding_x16};
use crate::integrator::lighting::{TechniqueCounts, emitted_at};
use crate::integrator::path::between::{Between, Sides};
use crate::integrator::path_wave::{InMedia, PathWave};
use crate::integrator::roulette::play_each_x16;
use crate::integrator::worker::{draw_2d, intersect};
use crate::integrator::{PathLimits, Radiance, Worker};
use crate::math::lanes::{LANES, bits, each_lane, f32x16, load, mask_from_bits};
use crate::math::{Ray, RayX16};
use crate::medium::lanes::{CoefficientsX16, PhaseX16, chosen_channel, optical_depths, probabilities};
use crate::medium::{Homogeneous, Medium, Phase};
use crate::sampling::hash::{combine, digits_below, lower_digits_x16, pcg3d, to_unit};
use crate::sampling::{Dimension, SampleKey};
use crate::scene::{Scene, SceneMedia};

/// Selects the random numbers of events in bodies.
const EVENTS: u32 = 0x626f_6479;

/// The media of a scene, which fill bodies.
#[derive(Clone, Copy)]
pub struct Bodies<'a> {
    scene: &'a Scene,
    media: &'a SceneMedia,
    limits: PathLimits,
}

/// The paths of a wave that are in bodies.
#[derive(Default)]
pub struct Walkers {
    /// The indices of the paths in the wave.
    paths: Vec<u32>,
    /// Their rays.
    rays: Vec<Ray>,
    /// The ray parameters at which media scatter the paths, unless they meet a surface before.
    ends: Vec<f32>,
    /// The surfaces on their rays.
    hits: Vec<Option<Hit>>,
    /// The keys of the samples.
    keys: Vec<SampleKey>,
    /// The random numbers of the first flight (channel and optical depth), and of the direction after it.
    first: [[Vec<f32>; 2]; 2],
}

/// The walkers from an index on.
struct Block {
    /// The index.
    first: usize,
    /// Their number. The other lanes repeat the last one.
    count: usize,
    /// The indices of the paths.
    path: [usize; LANES],
    in_media: [InMedia; LANES],
    beta: [f32x16; 3],
}

impl Walkers {
    fn truncate(&mut self, n: usize) {
        self.paths.truncate(n);
        self.rays.truncate(n);
        self.ends.truncate(n);
    }

    fn block(&self, first: usize, paths: &PathWave) -> Block {
        let count = (self.paths.len() - first).min(LANES);
        let path = each_lane(|i| self.paths[first + i.min(count - 1)] as usize);
        let in_media = each_lane(|i| paths.in_media[path[i]]);
        let beta = std::array::from_fn(|c| f32x16::new(each_lane(|i| paths.beta[c][path[i]])));
        Block { first, count, path, in_media, beta }
    }
}

impl<'a> Bodies<'a> {
    /// Begins with paths outside of the bodies.
    pub fn new(scene: &'a Scene, media: &'a SceneMedia, limits: PathLimits) -> Self {
        Bodies { scene, media, limits }
    }

    /// Returns whether a path may be scattered once more.
    fn scatters(&self, depth: u32, events: u32) -> bool {
        self.limits.allows(depth.saturating_add(events).saturating_add(2))
    }

    /// Adds the emission found by paths that media have scattered and that may not be scattered once more, and ends
    /// them.
    fn end_longest(&self, depth: u32, paths: &mut PathWave, hits: &mut [Option<Hit>], out: &mut [Radiance]) {
        if self.limits.max_depth.is_none() {
            return;
        }
        for i in 0..hits.len() {
            let events = paths.in_media[i].events;
            if events == 0 || self.scatters(depth, events) {
                continue;
            }
            if let Some(hit) = hits[i].take() {
                let at = self.scene.interaction(&paths.rays[i], &hit);
                let radiance = emitted_at(self.scene, &at, paths, i, TechniqueCounts::ONE_EACH);
                out[paths.slots[i] as usize].value += paths.beta(i) * radiance;
                paths.set_beta(i, Rgb::BLACK);
            }
        }
    }

    fn coefficients(&self, in_media: &[InMedia; LANES]) -> CoefficientsX16 {
        CoefficientsX16::of(&in_media.map(|InMedia { medium, .. }| self.homogeneous(medium)))
    }

    fn homogeneous(&self, medium: Option<MediumId>) -> Option<&Homogeneous> {
        match self.media.get(medium) {
            Some(Medium::Homogeneous(medium)) => Some(medium),
            _ => None,
        }
    }

    /// Returns a mask of the paths whose flights are sampled. Where nothing scatters, or where paths end, only the
    /// transmittance counts.
    fn sampled(&self, coefficients: &CoefficientsX16, depth: u32, in_media: &[InMedia; LANES]) -> f32x16 {
        let mut scatters = coefficients.scatter();
        if self.limits.max_depth.is_some() {
            let allowed = each_lane(|i| u32::from(self.scatters(depth, in_media[i].events)) << i);
            scatters &= mask_from_bits(allowed.into_iter().sum());
        }
        scatters
    }

    /// Samples the first flights of walkers.
    fn depart(&self, first: usize, depth: u32, walkers: &mut Walkers, paths: &PathWave) {
        let Block { count, in_media, beta, .. } = walkers.block(first, paths);
        let rays = RayX16::load(&walkers.rays, first);
        let [channel, u] = [0, 1].map(|k| load(&walkers.first[0][k], first));
        let depths = optical_depths(u, lower_digits_x16(u, rays.o));
        let coefficients = self.coefficients(&in_media);
        let sampled = self.sampled(&coefficients, depth, &in_media);
        let ends = coefficients.ends(chosen_channel(&beta, channel), depths, sampled)
            / rays.d.length_squared().sqrt();
        walkers.ends[first..first + count].copy_from_slice(&ends.as_array()[..count]);
    }

    /// Lets walkers arrive where their flights end. Those that go on in their bodies become the walkers from index `to`
    /// on. Returns the index after the last.
    fn arrive(
        &self,
        Block { first, count, path, mut in_media, beta }: Block,
        mut to: usize,
        (depth, is_first): (u32, bool),
        walkers: &mut Walkers,
        paths: &mut PathWave,
        hits: &mut [Option<Hit>],
    ) -> usize {
        let active = (1 << count) - 1;
        let rays = RayX16::load(&walkers.rays, first);
        let found = each_lane(|i| walkers.hits[first + i.min(count - 1)]);
        let surface = f32x16::new(found.map(|hit| hit.map_or(f32::INFINITY, |hit| hit.t)));
        let end = load(&walkers.ends, first);
        let speed = rays.d.length_squared().sqrt();
        let coefficients = self.coefficients(&in_media);
        let sampled = self.sampled(&coefficients, depth, &in_media);
        let scattered = end.simd_lt(surface);
        let [weights, _] =
            coefficients.transport(&probabilities(&beta), end.fast_min(surface) * speed, sampled, scattered);
        let beta = std::array::from_fn(|c| beta[c] * weights[c]);
        let scattered = scattered.to_bitmask() & active;
        for i in bits(active & !scattered) {
            (0..3).for_each(|c| paths.beta[c][path[i]] = beta[c].as_array()[i]);
            hits[path[i]] = found[i];
            if !is_first {
                paths.rays[path[i]] = Ray { t_max: f32::INFINITY, ..walkers.rays[first + i] };
            }
        }
        if scattered == 0 {
            return to;
        }
        let mut p = rays.o + rays.d * end;
        let close = ((surface - end) * speed).simd_le(rounding_x16(rays.o, surface * speed));
        for i in bits(close.to_bitmask() & scattered) {
            if let Some(hit) = found[i] {
                let ray = walkers.rays[first + i];
                let at = self.scene.interaction(&ray, &hit);
                p.set_lane(i, before_end(p.lane(i), Some(&at), ray.d));
            }
        }
        let keys = each_lane(|i| paths.keys[path[i]]);
        let [mut x, mut y, roulette] = numbers(&keys, &in_media, 1).map(units);
        if is_first {
            [x, y] = [0, 1].map(|k| load(&walkers.first[1][k], first));
        }
        let phases = in_media.map(|InMedia { medium, .. }| {
            self.homogeneous(medium).map_or(&Phase::Isotropic, |medium| &medium.phase)
        });
        let d = PhaseX16::of(&phases).sample(rays.d / speed, [x, y]);
        in_media.iter_mut().for_each(|in_media| in_media.events += 1);
        let edges = f32x16::new(in_media.map(|in_media| depth.saturating_add(in_media.events) as f32));
        let eta = f32x16::new(each_lane(|i| paths.eta[path[i]]));
        let (beta, alive) = play_each_x16(edges, self.limits.rr_depth, beta, eta * eta, roulette);
        let some = beta[0].fast_max(beta[1]).fast_max(beta[2]).simd_ne(f32x16::ZERO);
        let alive = (alive & some).to_bitmask() & scattered;
        for i in bits(scattered) {
            let lives = alive >> i & 1 == 1;
            (0..3).for_each(|c| paths.beta[c][path[i]] = if lives { beta[c].as_array()[i] } else { 0.0 });
            paths.in_media[path[i]] = in_media[i];
            paths.pdf[path[i]] = f32::INFINITY;
            if !lives {
                hits[path[i]] = None;
            }
        }
        let [channel, u, digits] = numbers(&keys, &in_media, 0);
        let u = units(u);
        let lower = f32x16::new(each_lane(|i| digits_below(u.as_array()[i], digits[i])));
        let sampled = self.sampled(&coefficients, depth, &in_media);
        let ends =
            coefficients.ends(chosen_channel(&beta, units(channel)), optical_depths(u, lower), sampled);
        for i in bits(alive) {
            let end = ends.as_array()[i];
            // Twice the distance leaves room for rounding.
            let t_max = if end >= f32::MIN_POSITIVE { 2.0 * end } else { f32::INFINITY };
            walkers.rays[to] = Ray { o: p.lane(i), d: d.lane(i), t_max, time: walkers.rays[first + i].time };
            walkers.ends[to] = end;
            walkers.paths[to] = path[i] as u32;
            to += 1;
        }
        to
    }
}

impl<'a> Between<'a> for Bodies<'a> {
    fn sides(&self) -> Sides<'a> {
        Sides { scene: self.scene, media: self.media }
    }

    fn passes_hidden(&self) -> bool {
        false
    }

    fn advance(&mut self, depth: u32, worker: &mut Worker, out: &mut [Radiance]) {
        if depth == 0 {
            worker.paths.in_media.resize(worker.paths.rays.len(), InMedia::in_medium(None));
        }
        let Worker { paths, hits, walkers, counters, sampler, interrupt, .. } = worker;
        walkers.truncate(0);
        walkers.keys.clear();
        walkers.hits.clear();
        for i in (0..hits.len()).filter(|&i| paths.in_media[i].medium.is_some()) {
            walkers.paths.push(i as u32);
            walkers.rays.push(paths.rays[i]);
            walkers.keys.push(paths.keys[i]);
            walkers.hits.push(hits[i]);
        }
        walkers.ends.resize(walkers.rays.len(), f32::INFINITY);
        let [flight, direction] = &mut walkers.first;
        draw_2d(*sampler, Dimension::free_flight(depth), &walkers.keys, flight);
        draw_2d(*sampler, Dimension::bsdf_direction(depth).repeat(1), &walkers.keys, direction);
        for first in (0..walkers.rays.len()).step_by(LANES) {
            self.depart(first, depth, walkers, paths);
        }
        let mut is_first = true;
        while !walkers.rays.is_empty() && !interrupt.is_raised() {
            if !is_first {
                intersect(self.scene, &walkers.rays, Coherence::Incoherent, &mut walkers.hits, counters);
            }
            let mut alive = 0;
            for first in (0..walkers.rays.len()).step_by(LANES) {
                let block = walkers.block(first, paths);
                alive = self.arrive(block, alive, (depth, is_first), walkers, paths, hits);
            }
            walkers.truncate(alive);
            is_first = false;
        }
        self.end_longest(depth, paths, hits, out);
    }

    fn rejoin(&mut self, _: &mut PathWave) {}
}

/// Returns three hashes for the event of each of sixteen paths; there are two sets.
#[inline(always)]
fn numbers(keys: &[SampleKey; LANES], in_media: &[InMedia; LANES], set: u32) -> [[u32; LANES]; 3] {
    let mut hashes = [[0; LANES]; 3];
    for i in 0..LANES {
        let event = in_media[i].events.wrapping_mul(2) + set;
        [hashes[0][i], hashes[1][i], hashes[2][i]] =
            pcg3d(combine(keys[i].scramble, EVENTS), keys[i].index, event);
    }
    hashes
}

#[inline(always)]
fn units(hashes: [u32; LANES]) -> f32x16 {
    f32x16::new(hashes.map(to_unit))
}
