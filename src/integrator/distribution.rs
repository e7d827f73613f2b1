//! Distribution ray tracing: several rays for each integral. [Cook 1984]
//!
//! At each surface, several shadow rays go to points on the emitters, and several rays sample the BSDF: glossy lobes,
//! refraction and the hemisphere alike, combined by the power heuristic as in [`super::path`]. A surface whose BSDF
//! has only Dirac deltas (mirrors, smooth glass) sends one ray into each delta, as long as a camera ray's tree has at
//! most [`MAX_RAYS`](DistributionSettings::MAX_RAYS) rays in its last level; beyond that, each surface continues with
//! one ray. The camera's samples distribute rays over the pixel, the lens and time.
//!
//! The expected value is that of the path integrator with the same `max_depth`, but the cost differs: a tree with n
//! BSDF samples has n^(max_depth − 1) rays at its last level, which carry the least light. Path tracing [Kajiya 1986]
//! traces one of them and more camera rays instead.

use super::block::ShadingBlock;
use super::lighting::{self, TechniqueCounts};
use super::path_wave::{Continuation, PathWave};
use super::settings::{HiddenLight, MAX_SAMPLES, PathLimits, Plugin, Read, Source};
use super::tree::{RayTree, TreeStrategy, split};
use super::worker::{draw_1d, draw_2d};
use super::{Integrator, Radiance, RadianceQuery, Wave, Worker};
use crate::bsdf;
use crate::error::Result;
use crate::math::lanes::{f32x16, load};
use crate::sampling::{Dimension, SampleKey};
use crate::scene::Scene;

/// Distribution ray tracing. [Cook 1984]
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
pub struct DistributionSettings {
    /// Greatest number of edges of a path from camera to emitter: 1 shows emitters only, 2 adds direct light.
    pub max_depth: u32,
    /// Samples of the emitters at each surface.
    pub emitter_samples: u32,
    /// BSDF samples at each surface, at least 1; each Dirac delta gets one.
    pub bsdf_samples: u32,
    /// Whether emitters are invisible to the camera.
    pub hide_emitters: bool,
}

impl DistributionSettings {
    /// The greatest number of rays at the last level of a camera ray's tree. If Dirac deltas would exceed it, each
    /// surface continues with one ray.
    pub const MAX_RAYS: u64 = 1 << 20;

    /// Returns the greatest number of rays at the last level of a camera ray's tree, Dirac deltas excepted.
    pub fn rays_at_last_level(&self) -> u64 {
        u64::from(self.bsdf_samples).saturating_pow(self.max_depth.saturating_sub(1))
    }
}

impl Default for DistributionSettings {
    fn default() -> Self {
        DistributionSettings { max_depth: 4, emitter_samples: 4, bsdf_samples: 4, hide_emitters: false }
    }
}

/// A branching path tracer.
pub struct DistributionIntegrator {
    settings: DistributionSettings,
}

/// The ray tree of one wave.
struct DistributionTree {
    settings: DistributionSettings,
    /// The number of emitter samples at each surface.
    emitter_samples: u32,
    /// The number of scattering events from which each surface continues with one ray.
    single_from: u32,
}

impl DistributionIntegrator {
    /// Creates the integrator.
    pub fn new(settings: DistributionSettings) -> Self {
        DistributionIntegrator { settings }
    }
}

impl DistributionTree {
    fn new(settings: DistributionSettings, scene: &Scene) -> Self {
        let emitter_samples = if scene.needs.emitter_sampling { settings.emitter_samples } else { 0 };
        // A surface sends one ray into each of its deltas or, if it has finite lobes, `bsdf_samples` rays.
        let most = u64::from(settings.bsdf_samples.max(scene.needs.deltas));
        let grows = |depth: &u32| most.saturating_pow(*depth) <= DistributionSettings::MAX_RAYS;
        let single_from = if most > 1 { (0..64).take_while(grows).last().unwrap_or(0) } else { u32::MAX };
        DistributionTree { settings, emitter_samples, single_from }
    }

    /// Returns whether each surface continues with one ray.
    fn is_single(&self, depth: u32) -> bool {
        depth >= self.single_from
    }

    /// Computes the keys of sample `i` of `n` of each parent.
    fn split_keys(&self, parents: &PathWave, n: u32, i: u32, keys: &mut Vec<SampleKey>) {
        keys.clear();
        keys.extend(parents.keys.iter().map(|&key| split(key, n, i)));
    }
}

impl TreeStrategy for DistributionTree {
    fn counts(&self, depth: u32) -> TechniqueCounts {
        TechniqueCounts::new(self.emitter_samples, self.rays(depth))
    }

    fn delta_lanes(&self, depth: u32, block: &ShadingBlock<'_>) -> u32 {
        if self.is_single(depth) { 0 } else { block.active & !block.finite }
    }

    fn rays(&self, depth: u32) -> u32 {
        if self.is_single(depth) { 1 } else { self.settings.bsdf_samples }
    }

    fn light(
        &self,
        tree: &RayTree<'_>,
        depth: u32,
        blocks: &[ShadingBlock<'_>],
        parents: &PathWave,
        worker: &mut Worker,
        out: &mut [Radiance],
    ) {
        let (n, counts) = (self.emitter_samples, self.counts(depth));
        if !counts.samples_emitters(tree.scene) {
            return;
        }
        let mut keys = Vec::new();
        for i in 0..n {
            self.split_keys(parents, n, i, &mut keys);
            let Worker { sampler, numbers, shadows, .. } = &mut *worker;
            draw_2d(*sampler, Dimension::emitter_point(depth), &keys, &mut numbers.emitter_point);
            for block in blocks.iter().filter(|block| block.finite != 0) {
                let u_point = [0, 1].map(|k| load(&numbers.emitter_point[k], block.first));
                let sampled = lighting::sample_emitters(tree.scene, block, u_point, counts);
                let beta: [f32x16; 3] = std::array::from_fn(|c| load(&parents.beta[c], block.first));
                let value = std::array::from_fn(|c| beta[c] * sampled.value[c]);
                shadows.push(&sampled.rays, &parents.slots[block.first..], &value, sampled.lanes);
            }
            worker.trace_shadows(tree.scene, tree.coherence(depth), |slot, value| out[slot].value += value);
        }
    }

    /// Samples a ray from each point with a finite lobe, or from every point if surfaces continue with one ray.
    fn scatter(
        &self,
        tree: &RayTree<'_>,
        depth: u32,
        i: u32,
        blocks: &[ShadingBlock<'_>],
        parents: &PathWave,
        worker: &mut Worker,
    ) -> PathWave {
        let mut keys = Vec::new();
        self.split_keys(parents, self.rays(depth), i, &mut keys);
        let Worker { sampler, numbers, .. } = worker;
        draw_1d(*sampler, Dimension::bsdf_lobe(depth), &keys, &mut numbers.bsdf_lobe);
        draw_2d(*sampler, Dimension::bsdf_direction(depth), &keys, &mut numbers.bsdf_direction);
        let mut paths = PathWave::default();
        paths.copy_from(parents);
        paths.keys.copy_from_slice(&keys);
        let share = f32x16::splat(1.0 / self.rays(depth) as f32);
        let single = self.is_single(depth);
        let mut alive = 0;
        for block in blocks {
            let lanes = if single { block.active } else { block.finite };
            let u_lobe = load(&numbers.bsdf_lobe, block.first);
            let u = [0, 1].map(|k| load(&numbers.bsdf_direction[k], block.first));
            let sample = bsdf::lanes::sample_x16(&block.bsdfs, &block.wo, u_lobe, u, lanes);
            let beta: [f32x16; 3] = std::array::from_fn(|c| load(&parents.beta[c], block.first));
            let beta: [f32x16; 3] = std::array::from_fn(|c| beta[c] * sample.weight[c] * share);
            let strongest = beta[0].fast_max(beta[1]).fast_max(beta[2]);
            let lanes = (sample.valid & strongest.simd_ne(f32x16::ZERO)).to_bitmask() & lanes;
            let next = Continuation {
                from: block.at.p,
                gloss: None,
                rays: tree.scene.spawn_rays(&block.at, block.at.frame.to_world(sample.wi), block.rays.time),
                beta,
                pdf: sample.pdf,
                eta: load(&parents.eta, block.first) * sample.eta,
            };
            alive = paths.compact(block.first, alive, &next, lanes);
        }
        paths.truncate(alive);
        paths
    }
}

impl Plugin for DistributionIntegrator {
    const NAME: &'static str = "distribution";
    const HIDDEN_LIGHT: HiddenLight = HiddenLight::Missed;
    type Settings = DistributionSettings;

    fn read(source: &mut dyn Source) -> Result<DistributionSettings> {
        let default = DistributionSettings::default();
        let settings = DistributionSettings {
            max_depth: source.count("max_depth", 1..=u32::MAX, default.max_depth)?,
            emitter_samples: source.count("emitter_samples", 0..=MAX_SAMPLES, default.emitter_samples)?,
            bsdf_samples: source.count("bsdf_samples", 1..=MAX_SAMPLES, default.bsdf_samples)?,
            hide_emitters: source.boolean("hide_emitters", default.hide_emitters)?,
        };
        match settings.rays_at_last_level() {
            0..=DistributionSettings::MAX_RAYS => Ok(settings),
            _ => Err(source.object_error(&format!(
                "bsdf_samples {} at max_depth {} are more than {} rays for each camera ray: expected fewer of either",
                settings.bsdf_samples,
                settings.max_depth,
                DistributionSettings::MAX_RAYS
            ))),
        }
    }

    fn with_limits(limits: PathLimits) -> DistributionSettings {
        let default = DistributionSettings::default();
        let max_depth = limits.depth_within(default.max_depth);
        DistributionSettings { max_depth, hide_emitters: limits.hide_emitters, ..default }
    }

    fn limits(settings: &DistributionSettings) -> PathLimits {
        let DistributionSettings { max_depth, hide_emitters, .. } = *settings;
        PathLimits { max_depth: Some(max_depth), hide_emitters, ..PathLimits::default() }
    }

    fn create(settings: &DistributionSettings) -> Box<dyn Integrator> {
        Box::new(DistributionIntegrator::new(*settings))
    }
}

impl Integrator for DistributionIntegrator {
    fn name(&self) -> &'static str {
        "distribution"
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
        let DistributionSettings { max_depth, hide_emitters, .. } = self.settings;
        let tree = RayTree { scene, query, coherence: wave.coherence, max_depth, hide_emitters };
        tree.trace(&DistributionTree::new(self.settings, scene), worker, out);
    }
}
