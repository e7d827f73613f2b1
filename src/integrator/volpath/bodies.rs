//! Walks of paths through media that fill bodies, sixteen at a time.
//!
//! Light gets into such media by being scattered at their boundaries only ([`SceneMedia::fill_bodies`]), so emitter
//! samples inside would find none. Between two bounces of the wave, a path is scattered in a body until it meets a
//! surface. The light that its ray finds there has the weight 1.
//!
//! Flights have the distances and weights of [`FreeFlight`](crate::medium::FreeFlight).

use crate::accel::{Coherence, Hit};
use crate::color::Rgb;
use crate::integrator::flight::before_end;
use crate::integrator::lighting::{TechniqueCounts, emitted_at};
use crate::integrator::path::between::{Between, Sides};
use crate::integrator::roulette::play_each_x16;
use crate::integrator::worker::{InMedia, PathWave, draw_2d, intersect};
use crate::integrator::{PathLimits, Radiance, Worker};
use crate::math::functions::{exp_x16, ln_x16};
use crate::math::lanes::{LANES, bits, each_lane, f32x16, load, mask_from_bits};
use crate::math::{FrameX16, Ray, RayX16, Vec3x16};
use crate::medium::Medium;
use crate::sampling::hash::{combine, digits_below, lower_digits_x16, pcg3d, to_unit};
use crate::sampling::warp::sin_cos_turn_x16;
use crate::sampling::{Dimension, SampleKey};
use crate::scene::{Scene, SceneMedia};
use std::f32::consts::TAU;

/// Selects the random numbers of events in bodies.
const EVENTS: u32 = 0x626f_6479;
/// The optical depth beyond which nothing is transmitted.
const OPAQUE: f32 = 87.0;
/// Rounding moves the points of rays by much less than this part of their coordinates and distances, unless a surface
/// is a thousand times as large.
const CLOSE: f32 = 1e-4;

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

/// The coefficients of the media of sixteen paths.
struct Coefficients {
    sigma_t: [f32x16; 3],
    sigma_s: [f32x16; 3],
    /// The mean cosine of deflection.
    g: f32x16,
    /// Whether the extinction is the same in all channels.
    grey: bool,
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

    fn coefficients(&self, in_media: &[InMedia; LANES]) -> Coefficients {
        let mut table = [[0.0; LANES]; 7];
        for (i, InMedia { medium, .. }) in in_media.iter().enumerate() {
            let Some(Medium::Homogeneous(medium)) = self.media.get(*medium) else { continue };
            let ([a, b, c], [d, e, f]) = (medium.sigma_t.to_array(), medium.sigma_s.to_array());
            for (row, value) in table.iter_mut().zip([a, b, c, d, e, f, medium.asymmetry().unwrap_or(0.0)]) {
                row[i] = value;
            }
        }
        let grey = table[0] == table[1] && table[1] == table[2];
        let [a, b, c, d, e, f, g] = table.map(f32x16::new);
        Coefficients { sigma_t: [a, b, c], sigma_s: [d, e, f], g, grey }
    }

    /// Returns a mask of the paths whose flights are sampled. Where nothing scatters, or where paths end, only the
    /// transmittance counts.
    fn sampled(&self, coefficients: &Coefficients, depth: u32, in_media: &[InMedia; LANES]) -> f32x16 {
        let [r, g, b] = coefficients.sigma_s.map(|sigma| sigma.simd_gt(f32x16::ZERO));
        let mut scatters = r | g | b;
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
        let ends = coefficients.ends(&beta, channel, depths, sampled) / rays.d.length_squared().sqrt();
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
        let beta = coefficients.transport(beta, end.fast_min(surface) * speed, sampled, scattered);
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
        let largest = p.x.abs().fast_max(p.y.abs()).fast_max(p.z.abs());
        let rounding = f32x16::splat(CLOSE) * (end + largest / speed);
        for i in bits((surface - end).simd_lt(rounding).to_bitmask() & scattered) {
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
        let d = deflected(rays.d / speed, coefficients.g, [x, y]);
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
        let ends = coefficients.ends(&beta, units(channel), optical_depths(u, lower), sampled);
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

impl Coefficients {
    /// Returns the distances at which flights end: at optical depths in channels that are chosen in proportion to the
    /// throughput. Flights that are not sampled have no end.
    #[inline(always)]
    fn ends(&self, beta: &[f32x16; 3], channel: f32x16, depths: f32x16, sampled: f32x16) -> f32x16 {
        let x = channel * (beta[0] + beta[1] + beta[2]);
        let first = x.simd_lt(beta[0]);
        let third = !x.simd_lt(beta[0] + beta[1]) & beta[2].simd_gt(f32x16::ZERO);
        // Rounding must not choose a channel without throughput.
        let second = !third & beta[1].simd_gt(f32x16::ZERO);
        let [r, g, b] = self.sigma_t;
        let sigma = first.select(r, third.select(b, second.select(g, r)));
        sampled.select(depths / sigma, f32x16::splat(f32::INFINITY))
    }

    /// Returns the throughputs after flights over `lengths`, which media ended by scattering in the lanes of the mask
    /// `scattered`.
    #[inline(always)]
    fn transport(
        &self,
        beta: [f32x16; 3],
        lengths: f32x16,
        sampled: f32x16,
        scattered: f32x16,
    ) -> [f32x16; 3] {
        let zero = f32x16::ZERO;
        // Where there is no extinction, the length may be infinite.
        let depths = self
            .sigma_t
            .map(|sigma| sigma.simd_gt(zero).select(sigma * lengths, zero).fast_min(f32x16::splat(f32::MAX)));
        let least = depths[0].fast_min(depths[1]).fast_min(depths[2]);
        // The transmittances relative to that of the clearest channel.
        let relative = match self.grey {
            true => [f32x16::ONE; 3],
            false => depths.map(|depth| exp_x16(least - depth)),
        };
        let weight: [f32x16; 3] =
            std::array::from_fn(|c| scattered.select(self.sigma_s[c], f32x16::ONE) * relative[c]);
        let density = |c: usize| beta[c] * scattered.select(self.sigma_t[c], f32x16::ONE) * relative[c];
        let sum = beta[0] + beta[1] + beta[2];
        let mut factor = sum / (density(0) + density(1) + density(2));
        if !sampled.all() {
            let transmittance = least.simd_lt(f32x16::splat(OPAQUE)).select(exp_x16(-least), zero);
            factor = sampled.select(factor, transmittance);
        }
        std::array::from_fn(|c| beta[c] * weight[c] * factor)
    }
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

/// Returns −ln x for the random numbers x = u + lower, with a relative error below 10⁻⁶.
#[inline(always)]
fn optical_depths(u: f32x16, lower: f32x16) -> f32x16 {
    let one = f32x16::ONE;
    let upper = u.simd_ge(f32x16::HALF);
    let rest = (one - u) - lower;
    // Half of the least step makes the number positive.
    let x = upper.select(one - rest, u + (lower + f32x16::splat(2f32.powi(-58))));
    let logarithm = -ln_x16(x);
    // Near 1, the logarithm of the rounded number is corrected.
    let rounded = one - x;
    let corrected = rounded.simd_eq(f32x16::ZERO).select(rest, logarithm * (rest / rounded));
    upper.select(corrected, logarithm)
}

/// Returns directions after scattering with the mean cosines `g` by the function of [Henyey and Greenstein 1941].
///
/// For the random number u, 1 − cos = 2 (1 − g)² (1 − u) (1 + gu) / s² and 1 + cos = 2 (1 + g)² u (1 − g (1 − u)) / s²
/// with s = 1 − g + 2gu. All sums are written such that nothing cancels.
#[inline(always)]
fn deflected(d: Vec3x16, g: f32x16, [u, azimuth]: [f32x16; 2]) -> Vec3x16 {
    let (one, two) = (f32x16::ONE, f32x16::splat(2.0));
    let rest = one - u;
    let forward = g.simd_gt(f32x16::ZERO);
    let s = forward.select(one - g + two * g * u, one + g - two * g * rest);
    let (back, ahead) = ((one - g) / s, (one + g) / s);
    let versine = two * back * back * rest * forward.select(one + g * u, one + g - g * rest);
    let coversine = two * ahead * ahead * u * forward.select(one - g + g * u, one - g * rest);
    let cos = versine.simd_lt(one).select(one - versine, coversine - one);
    let sin = (versine * coversine).fast_max(f32x16::ZERO).sqrt();
    let (sin_phi, cos_phi) = sin_cos_turn_x16(f32x16::splat(TAU) * azimuth);
    FrameX16::from_normal(d).to_world(Vec3x16::new(sin * cos_phi, sin * sin_phi, cos)).normalize_or_zero()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::{Vec2, Vec3};
    use crate::medium::{FreeFlight, Homogeneous, Phase, Segment, Stream};

    /// The logarithm is exact for numbers that are close to 0 and to 1, and digits below those of the number count.
    #[test]
    fn optical_depths_are_logarithms() {
        let step = 2f32.powi(-24);
        for u in
            [0.0, 2f32.powi(-32), 1e-6, 0.004, 0.3, 0.5 - step, 0.5, 0.7, 0.999, 1.0 - 3.0 * step, 1.0 - step]
        {
            for digits in [0, 1 << 31, u32::MAX] {
                let lower = digits_below(u, digits);
                let found = optical_depths(f32x16::splat(u), f32x16::splat(lower)).as_array()[5];
                let x = f64::from(u) + f64::from(lower) + 2f64.powi(-58);
                let exact = if x > 0.5 { -(x - 1.0).ln_1p() } else { -x.ln() };
                assert!((f64::from(found) / exact - 1.0).abs() < 1e-6, "{u} {lower}: {found}, {exact}");
            }
        }
    }

    /// The directions are those of the scalar phase functions.
    #[test]
    fn deflections_are_those_of_the_phase_function() {
        let d = Vec3::new(0.3, -0.7, 0.2).normalize();
        for g in [-0.999f32, -0.6, 0.0, 1e-6, 0.3, 0.9, 0.9999] {
            for (u, v) in [(0.0, 0.3), (1e-4, 0.9), (0.2, 0.1), (0.5, 0.6), (0.97, 0.4), (1.0 - 1e-6, 0.8)] {
                let numbers = [u, v].map(f32x16::splat);
                let found = deflected(Vec3x16::splat(d), f32x16::splat(g), numbers).lane(3);
                let exact = Phase::HenyeyGreenstein { g }.sample(d, Vec2::new(u, v));
                assert!((found - exact).length() < 1e-5, "{g} {u} {v}: {found}, {exact}");
            }
        }
    }

    /// Ends of flights and throughputs are those of [`FreeFlight`], within 10⁻⁵.
    #[test]
    fn flights_are_those_of_one_path() {
        let media =
            [([1.0, 0.3, 4.0], [0.9, 0.3, 2.0]), ([2.0; 3], [1.0; 3]), ([0.0, 2.0, 0.5], [0.0, 2.0, 0.0])];
        for (sigma_t, sigma_s) in media {
            let homogeneous =
                Homogeneous { sigma_t: sigma_t.into(), sigma_s: sigma_s.into(), phase: Phase::Isotropic };
            let medium = Medium::Homogeneous(homogeneous);
            let coefficients = Coefficients {
                sigma_t: sigma_t.map(f32x16::splat),
                sigma_s: sigma_s.map(f32x16::splat),
                g: f32x16::ZERO,
                grey: sigma_t == [2.0; 3],
            };
            let all = mask_from_bits(0xffff);
            for i in 0..400 {
                let [a, b, c] = pcg3d(i, 5, 7).map(to_unit);
                let beta = Rgb::new(0.7, 0.2, if i % 2 == 0 { 0.05 } else { 0.0 });
                let lanes = beta.to_array().map(f32x16::splat);
                let depth = optical_depths(f32x16::splat(b), f32x16::ZERO);
                let end = coefficients.ends(&lanes, f32x16::splat(a), depth, all).as_array()[0];
                let at = Vec3::ONE;
                let mut flight = FreeFlight::sampled(beta, Vec2::new(a, b), at, Stream::new([0; 2]));
                let length = 3.0 * c;
                let segment = Segment { origin: at, direction: Vec3::X, length: length.into() };
                let ended = flight.advance(&medium, &segment);
                // Where the digits below those of the number decide, both are right.
                if (end / length - 1.0).abs() < 1e-4 {
                    continue;
                }
                assert_eq!(ended.is_some(), end < length, "{i}: {ended:?}, {end}");
                assert!(ended.is_none_or(|exact| (f64::from(end) / exact - 1.0).abs() < 1e-4), "{i}: {end}");
                let weight = if ended.is_some() { flight.scattered(&medium) } else { flight.passed() };
                let scattered = if ended.is_some() { all } else { f32x16::ZERO };
                let travelled = f32x16::splat(end.min(length));
                let found = coefficients.transport(lanes, travelled, all, scattered);
                for (found, exact) in found.iter().zip((beta * weight).to_array()) {
                    let found = found.as_array()[0];
                    assert!((found - exact).abs() <= 1e-4 * exact + 1e-7, "{i}: {found}, expected {exact}");
                }
            }
        }
    }
}
