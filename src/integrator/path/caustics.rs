//! Caustics that light paths find: light that mirrors and smooth glass send to a surface which the camera sees.
//!
//! A camera path finds such light by chance: it leaves the surface x by a finite lobe, is scattered by Dirac deltas
//! only, and hits an emitter. No emitter sample can do so. A light path finds it more often: it starts at the emitter,
//! meets the same deltas, and x is connected to the camera. Both are combined by the power heuristic with exponent 2.
//! [Veach 1997, Eq. 9.13] All other light is left to camera paths.
//!
//! Caustics light other surfaces, too. Between the deltas and the camera there may be up to [`MOST_SURFACES`] surfaces
//! that scatter by a finite lobe, if the paths of pixels are not reused: reused paths have densities of the group. A
//! light path that meets no delta at first ends at once.
//!
//! The weights need the ratio of the densities of both techniques. Camera paths compute it from vertex to vertex: at
//! the first surface it is the density of light paths that are connected to the camera relative to that of camera
//! paths, without the density of the emitter. Each later vertex contributes the ratio of the cosines at its two edges,
//! and, if its lobe is finite, that of the densities of its two directions.
//!
//! Light paths are [aimed](crate::integrator::bdpt::targets) at the surfaces with Dirac deltas.
//!
//! Light paths do not pay in every scene. A pilot decides how many there are, or none. Emitters that no camera path can
//! hit are left out, so the expected image does not depend on that.

use super::pilot::{LEAST_GAIN_OF_SPLITTING, handicap};
use super::splitting::Splitting;
use crate::accel::Hit;
use crate::bsdf::lanes::pdf_adjoint_x16;
use crate::estimate::metrics::RELATIVE_FLOOR;
use crate::ids::EmitterId;
use crate::integrator::bdpt::targets::{TargetChoice, Targets};
use crate::integrator::bdpt::technique::Techniques;
use crate::integrator::bdpt::weights::{Merged, Start};
use crate::integrator::bdpt::{CausticPaths, Caustics, LensConnections};
use crate::integrator::block::ShadingBlock;
use crate::integrator::light_path::EmissionNumbers;
use crate::integrator::path_wave::{Continuation, PathWave};
use crate::integrator::photon::PathSequence;
use crate::integrator::preparation::Workers;
use crate::integrator::ptracer::{LightTracer, Splat};
use crate::integrator::settings::PathLimits;
use crate::integrator::{Preparation, Radiance, RadianceQuery, Worker};
use crate::math::lanes::{bits, f32x16};
use crate::math::{Ray, Vec3};
use crate::sampling::SampleKey;
use crate::scene::Scene;
use crate::sensor::Camera;
use rayon::prelude::*;

/// The ratio of a path that has only the camera so far.
const BEGUN: f32 = f32::NEG_INFINITY;
/// The ratio of a path that is no caustic, whatever follows.
const NO_CAUSTIC: f32 = 0.0;
/// The numbers of light paths for each camera path among which the pilot chooses.
const SHARES: [f64; 5] = [0.0625, 0.125, 0.25, 0.5, 1.0];
/// Light paths must reduce error × cost to this share at least.
const PAYS: f64 = 0.9;
/// The least efficiency of split camera paths relative to others, if light paths are traced. Where there are caustics,
/// there are also rare bright paths. Both pilots miss most of them, so they expect too much of splitting.
const LEAST_GAIN_BESIDE_LIGHT_PATHS: f64 = 1.5;
/// The light paths of the pilot: one for every eight pixels, within these bounds; those of a batch, and their stream of
/// random numbers.
const PILOT: [u64; 2] = [1 << 13, 1 << 14];
const BATCH: u64 = 2048;
const STREAM: u32 = 7;
/// The rounds of as many light paths from which is learned where they start, and their stream. They end before if so
/// many light paths have contributed.
const LEARNING: u32 = 8;
const LEARNING_STREAM: u32 = 9;
const CONTRIBUTIONS: usize = 4096;
/// The number of light paths for each camera path for which is learned where they start.
const TYPICAL_SHARE: f64 = 0.125;
/// The number of blocks of the image along each axis, whose mean caustics the pilot estimates.
const BLOCKS: usize = 32;
/// The most surfaces with a finite lobe between the deltas and the camera.
pub(super) const MOST_SURFACES: u32 = 3;
/// The scale of the ratios of densities in the pilot, so that weights are not rounded to 1.
const SCALE: f64 = 1e-4;
/// The cost of a light path without its rays, in nearest-hit queries.
const LIGHT_PATH_COST: f64 = 3.0;

/// What a pilot knows about camera paths without caustics.
#[derive(Clone, Copy, Debug)]
pub(super) struct CameraPathPilot {
    /// The relative mean squared error of one sample of a pixel, without the worst pixels.
    pub error: f64,
    /// The cost of the rays of a sample.
    pub cost: f64,
    /// The mean over the pixels and channels.
    pub mean: f64,
}

/// The light paths that find caustics.
pub struct CausticTracer {
    camera: Camera,
    targets: Targets,
    limits: PathLimits,
    /// The number of light paths for each camera path. It is infinite before it is chosen: then camera paths have the
    /// weight 0.
    share: f64,
    /// The number of directions of each camera path at its first surface.
    directions: f64,
    /// The most surfaces with a finite lobe between the deltas and the camera.
    surfaces: u32,
}

/// The result of the pilot.
struct LightPilot {
    caustics: Vec<Caustic>,
    /// For each light path, what [`Targets::learn`] needs.
    starts: Vec<(TargetChoice, f64)>,
    /// The number of light paths.
    paths: f64,
    /// The mean cost of their rays.
    cost: f64,
}

/// A contribution to the film in the pilot, as if there were one light path for each camera path.
struct Caustic {
    splat: Splat,
    /// The density of light paths relative to that of camera paths.
    ratio: f64,
}

impl Caustic {
    /// Returns the mean over the channels.
    fn grey(&self) -> f64 {
        f64::from(self.splat.value.r + self.splat.value.g + self.splat.value.b) / 3.0
    }
}

impl CausticTracer {
    /// Learns where caustic light starts. Returns `None` if none was found inside the view of the camera.
    pub fn learn(preparation: &Preparation<'_>, limits: PathLimits) -> Option<Self> {
        let (camera, share, directions) = (preparation.camera.clone(), f64::INFINITY, 1.0);
        let targets = Targets::new(preparation.scene)?;
        let mut tracer =
            CausticTracer { camera, targets, limits, share, directions, surfaces: MOST_SURFACES };
        let (mut starts, mut found) = (Vec::new(), false);
        for round in 0..LEARNING {
            starts.extend(tracer.pilot(preparation, MOST_SURFACES, (LEARNING_STREAM, round)).starts);
            found = tracer.targets.learn(preparation.scene, &starts);
            if starts.iter().filter(|(_, contribution)| *contribution > 0.0).count() >= CONTRIBUTIONS {
                break;
            }
        }
        found.then_some(tracer)
    }

    /// Returns the number of light paths for each camera path.
    pub fn share(&self) -> f64 {
        self.share
    }

    /// Returns the most surfaces with a finite lobe between the deltas and the camera.
    pub fn surfaces(&self) -> u32 {
        self.surfaces
    }

    /// Chooses the number of light paths by a pilot, their [`surfaces`](Self::surfaces), which are 1 or
    /// `most_surfaces`, and the splitting of camera paths among those that are known. Returns whether light paths are
    /// traced, which they are if `always` is true or if they pay, and the splitting.
    pub(super) fn choose_share(
        &mut self,
        preparation: &Preparation<'_>,
        camera_paths: &[(Splitting, CameraPathPilot)],
        always: bool,
        most_surfaces: u32,
    ) -> (bool, Splitting) {
        // Between them, the figures differ little.
        let mut surfaces = vec![1, most_surfaces];
        surfaces.dedup();
        let pilots: Vec<_> =
            surfaces.into_iter().map(|n| (n, self.pilot(preparation, n, (STREAM, 0)))).collect();
        let best = |camera_paths: &[(Splitting, CameraPathPilot)], shares: &[f64], least_gain: f64| {
            let efforts = camera_paths.iter().flat_map(|(splitting, paths)| {
                let errors = |pilot| self.errors(pilot, paths.mean, f64::from(splitting.directions));
                // Short light paths leave the other caustics to camera paths.
                let all = errors(&pilots[pilots.len() - 1].1)(0.0);
                let mut efforts = Vec::new();
                for (surfaces, pilot) in &pilots {
                    let errors = errors(pilot);
                    let left = (all - errors(0.0)).max(0.0);
                    for &share in shares {
                        let camera_path = preparation.scene.camera_path_cost + paths.cost;
                        let cost = camera_path + share * (LIGHT_PATH_COST + pilot.cost);
                        let error = paths.error + errors(share) + left;
                        let effort = error * cost * handicap(*splitting, least_gain);
                        efforts.push((effort, *splitting, share, *surfaces));
                    }
                }
                efforts
            });
            efforts.min_by(|a, b| a.0.total_cmp(&b.0)).expect("some")
        };
        // The error of caustics is the least certain: whether light paths pay does not depend on other choices.
        let first = &camera_paths[..1];
        let traced = always || best(first, &SHARES, 1.0).0 < PAYS * best(first, &[0.0], 1.0).0;
        let (_, splitting, share, surfaces) = match traced {
            true => best(camera_paths, &SHARES, LEAST_GAIN_BESIDE_LIGHT_PATHS),
            false => best(camera_paths, &[0.0], LEAST_GAIN_OF_SPLITTING),
        };
        (self.share, self.directions, self.surfaces) = (share, f64::from(splitting.directions), surfaces);
        (traced, splitting)
    }

    /// Traces some light paths with the given number of [`surfaces`](Self::surfaces) and sequence of random numbers.
    fn pilot(
        &self,
        preparation: &Preparation<'_>,
        surfaces: u32,
        (stream, number): (u32, u32),
    ) -> LightPilot {
        let Preparation { scene, camera, sampler, seed, pool, interrupt, .. } = *preparation;
        let workers = Workers::new(pool, sampler, interrupt);
        let sequence = PathSequence { seed, stream, number, first: 0 };
        let batches = (pixels(camera) / 8).clamp(PILOT[0], PILOT[1]) / BATCH;
        let which = Caustics { targets: &self.targets, vertices: surfaces };
        let trace = |batch: u64| {
            workers.with(|worker| {
                let keys: Vec<SampleKey> = (0..BATCH).map(|i| sequence.key(batch * BATCH + i)).collect();
                let before = worker.counters.cost(scene);
                let mut numbers = EmissionNumbers::default();
                numbers.draw(scene, &keys, worker);
                let mut contributions = vec![0.0; keys.len()];
                let mut caustics = Vec::new();
                let paths = CausticPaths { density: SCALE, which };
                let connections = self.connections(scene, camera, 0.0, paths);
                connections.splat(&keys, worker, |point, splat| {
                    let value = splat.value / point.weight as f32;
                    let ratio = (point.weight / (1.0 - point.weight)).sqrt() / SCALE;
                    let caustic = Caustic { splat: Splat { value, ..splat }, ratio };
                    let square = (TYPICAL_SHARE * ratio).powi(2);
                    let contribution = caustic.grey() * square / (1.0 + square);
                    if contribution.is_finite() {
                        contributions[point.path as usize] += contribution;
                    }
                    caustics.push(caustic);
                });
                let starts: Vec<_> = contributions
                    .into_iter()
                    .enumerate()
                    .filter_map(|(i, contribution)| {
                        Some((self.targets.choose(scene, &numbers, i)?, contribution))
                    })
                    .collect();
                (caustics, starts, worker.counters.cost(scene) - before)
            })
        };
        let paths = (batches * BATCH) as f64;
        let traced: Vec<_> = pool.install(|| (0..batches).into_par_iter().map(trace).collect());
        let mut pilot = LightPilot { caustics: Vec::new(), starts: Vec::new(), paths, cost: 0.0 };
        for (caustics, starts, cost) in traced {
            pilot.caustics.extend(caustics);
            pilot.starts.extend(starts);
            pilot.cost += cost / paths;
        }
        pilot
    }

    /// Returns the relative mean squared error of the caustics in one sample of a pixel, as a function of the number of
    /// light paths for each camera path, each of which has the given number of directions. `mean` is that of the other
    /// light.
    fn errors(&self, pilot: &LightPilot, mean: f64, directions: f64) -> impl Fn(f64) -> f64 + use<> {
        let LightPilot { caustics, paths, .. } = pilot;
        let size = [self.camera.film.width, self.camera.film.height].map(f64::from);
        let block = move |splat: &Splat| {
            let along = |x: f64, length: f64| ((x / length * BLOCKS as f64) as usize).min(BLOCKS - 1);
            along(splat.film.y, size[1]) * BLOCKS + along(splat.film.x, size[0])
        };
        let mut means = vec![mean; BLOCKS * BLOCKS];
        for caustic in caustics {
            means[block(&caustic.splat)] += caustic.grey() * (BLOCKS * BLOCKS) as f64 / paths;
        }
        // The squared contribution of each light path, relative to its block, and its ratio.
        let squares: Vec<[f64; 2]> = caustics
            .iter()
            .map(|caustic| {
                let mean = means[block(&caustic.splat)];
                let square = caustic.grey().powi(2) / (mean * mean + RELATIVE_FLOOR) / paths;
                [square, caustic.ratio / directions]
            })
            .filter(|[square, ratio]| square.is_finite() && ratio.is_finite())
            .collect();
        move |share| {
            let error = |[square, ratio]: &[f64; 2]| {
                // The squared weights, divided by the densities relative to a light path for each camera path.
                let square_of_ratio = (share * ratio).powi(2);
                let of_light = if share > 0.0 { square_of_ratio * square_of_ratio / share } else { 0.0 };
                square * (of_light + ratio) / (1.0 + square_of_ratio).powi(2)
            };
            squares.iter().map(error).sum()
        }
    }

    /// Returns the connections to a camera. The density of the light paths is relative to one for each direction of a
    /// camera path.
    fn connections<'a>(
        &'a self,
        scene: &'a Scene,
        camera: &'a Camera,
        margin: f64,
        paths: CausticPaths<'a>,
    ) -> LensConnections<'a> {
        LensConnections {
            scene,
            camera,
            guide: None,
            limits: self.limits,
            techniques: Techniques::All,
            query: RadianceQuery::ALL,
            margin,
            merged: Merged::default(),
            media: None,
            caustics: Some(paths),
        }
    }

    /// Returns the weight of a camera path that hits an emitter. Its last ray has the direction `d`, and ends at the
    /// point `o` with the cosine `cosine` or, if the emitter is at infinity, passes `o`.
    fn weight(
        &self,
        scene: &Scene,
        emitter: EmitterId,
        (o, d): (Vec3, Vec3),
        cosine: f32,
        ratio: f32,
    ) -> f32 {
        let i = emitter.index();
        let started = self.targets.density(scene, i, (o, -d), cosine);
        let start = Start::new(&scene.lights[i], -d, cosine, 0.0, started);
        let ratio = start.ray * f64::from(ratio) / f64::from(cosine);
        // Not NaN, if an infinite ratio meets a density of 0.
        (1.0 / (1.0 + ratio * ratio)).max(0.0) as f32
    }
}

/// Returns the number of pixels of a camera's whole image.
fn pixels(camera: &Camera) -> u64 {
    u64::from(camera.film.width) * u64::from(camera.film.height)
}

impl LightTracer for CausticTracer {
    fn trace(
        &self,
        scene: &Scene,
        camera: &Camera,
        margin: f64,
        keys: &[SampleKey],
        worker: &mut Worker,
        out: &mut Vec<Splat>,
    ) {
        // Neighbours in the sequence are well distributed, so the first ones are traced.
        let traced = ((keys.len() as f64 * self.share).ceil() as usize).min(keys.len());
        let factor = keys.len() as f32 / traced as f32;
        let which = Caustics { targets: &self.targets, vertices: self.surfaces };
        let paths = CausticPaths { density: self.share / self.directions, which };
        let connections = self.connections(scene, camera, margin, paths);
        connections.splat(&keys[..traced], worker, |_, splat| {
            out.push(Splat { value: splat.value * factor, ..splat });
        });
    }
}

/// The caustics among the camera paths of a wave.
pub(super) struct CausticWave<'a> {
    tracer: &'a CausticTracer,
    /// The camera rays.
    rays: &'a [Ray],
    /// The number of light paths for each camera path, divided by that of emitter samples at the first surface, which
    /// are in the densities of directions there.
    share: f64,
    /// For each entry of the output, the density of light paths relative to that of camera paths, without the density
    /// of the emitter: positive for a path that was scattered by finite lobes and then by Dirac deltas only, at least
    /// one of each. It is negative if the delta is still to come; at the first surface it is without the density of the
    /// camera ray.
    ratios: Vec<f32>,
}

impl<'a> CausticWave<'a> {
    /// Creates the state before the first bounce. Entries of the output behind those of the split paths have no
    /// caustics.
    pub fn new(
        tracer: &'a CausticTracer,
        rays: &'a [Ray],
        splitting: Splitting,
        entries: usize,
        mut buffer: Vec<f32>,
    ) -> Self {
        buffer.clear();
        buffer.resize(splitting.directions as usize * rays.len(), BEGUN);
        buffer.resize(entries, NO_CAUSTIC);
        CausticWave { tracer, rays, share: tracer.share / f64::from(splitting.emitters), ratios: buffer }
    }

    /// Returns the buffer, for another wave.
    pub fn into_buffer(self) -> Vec<f32> {
        self.ratios
    }

    /// Returns whether light that the path with the given entry of the output meets now is a caustic.
    #[inline]
    pub fn are_in(&self, slot: u32) -> bool {
        self.ratios[slot as usize] > 0.0
    }

    /// Updates the ratios of the paths of a block that continue, after `depth` earlier surfaces. Those of split paths
    /// are `entries` behind those of the paths from which they are split.
    pub fn scatter(
        &mut self,
        block: &ShadingBlock<'_>,
        paths: &PathWave,
        next: &Continuation,
        survivors: u32,
        entries: u32,
        depth: u32,
    ) {
        let may_be_finite = depth < self.tracer.surfaces;
        let reverse = if depth > 0 && may_be_finite {
            let wi = block.at.frame.to_local(next.rays.d);
            let finite = next.pdf.simd_lt(f32x16::splat(f32::INFINITY)).to_bitmask() & survivors;
            pdf_adjoint_x16(&block.bsdfs, &wi, &block.wo, finite)
        } else {
            f32x16::ZERO
        };
        let cosines = next.rays.d.dot(block.at.ng).abs() / block.rays.d.dot(block.at.ng).abs();
        let pdf = next.pdf.as_array();
        for i in bits(survivors) {
            let path = block.first + i;
            let slot = (paths.slots[path] + entries) as usize;
            let (ratio, cosines) = (self.ratios[slot], cosines.as_array()[i]);
            self.ratios[slot] = match pdf[i].is_finite() {
                true if ratio == BEGUN => -cosines / pdf[i],
                finite if ratio < 0.0 && ratio != BEGUN && (may_be_finite || !finite) => {
                    let here = if finite { cosines * reverse.as_array()[i] / pdf[i] } else { -cosines };
                    let of_first = if depth == 1 {
                        let ray = &self.rays[slot % self.rays.len()];
                        self.share / self.tracer.camera.density(paths.from[path], ray.d, ray.time)
                    } else {
                        1.0
                    };
                    (f64::from(ratio * here) * of_first) as f32
                }
                false if ratio > 0.0 => ratio * cosines,
                _ => NO_CAUSTIC,
            };
        }
    }

    /// Adds the caustic light from infinity for the paths that hit nothing.
    pub fn add_missed(&self, scene: &Scene, paths: &PathWave, hits: &[Option<Hit>], out: &mut [Radiance]) {
        for i in (0..hits.len()).filter(|&i| hits[i].is_none() && self.are_in(paths.slots[i])) {
            let (slot, d) = (paths.slots[i] as usize, paths.rays[i].d);
            for emitter in scene.distant_emitters() {
                let weight = self.tracer.weight(scene, emitter, (paths.rays[i].o, d), 1.0, self.ratios[slot]);
                out[slot].value += paths.beta(i) * scene.distant_radiance(emitter, d) * weight;
            }
        }
    }

    /// Adds the caustic light of the emitters that the paths of a block hit, for the lanes of a mask. Returns the lanes
    /// of caustics.
    pub fn add_emitted(
        &self,
        scene: &Scene,
        block: &ShadingBlock<'_>,
        paths: &PathWave,
        out: &mut [Radiance],
        lanes: u32,
    ) -> u32 {
        let mut caustics = 0;
        for i in bits(block.at.emitting & block.active & lanes) {
            let path = block.first + i;
            let slot = paths.slots[path];
            if self.are_in(slot) {
                caustics |= 1 << i;
                let (at, d) = (block.at.lane(i), block.rays.d.lane(i));
                let Some(emitter) = scene.emitter_at(&at) else { continue };
                let ratio = self.ratios[slot as usize];
                let weight = self.tracer.weight(scene, emitter, (at.p, d), d.dot(at.ng).abs(), ratio);
                out[slot as usize].value += paths.beta(path) * scene.emitted(emitter, &at) * weight;
            }
        }
        caustics
    }
}
