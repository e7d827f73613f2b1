//! Distribution ray tracing: several rays into every integral. [Cook 1984]
//!
//! At each surface several shadow rays go to points of the emitters, and several rays into the BSDF: glossy lobes,
//! refraction and the hemisphere alike, combined by the power heuristic as in [`super::path`]. Surfaces with Dirac
//! deltas only (mirrors, smooth glass) get one ray for each. The camera's samples do the same for the pixel, the lens
//! and time.
//!
//! The expectation is that of the path integrator at the same `max_depth`. The cost is not: a tree of n BSDF samples
//! has n^(max_depth − 1) rays at its last level, which carry the least light. Tracing one of them and more camera rays
//! is path tracing [Kajiya 1986].

use super::block::Block;
use super::lighting::{self, TechniqueCounts};
use super::settings::DistributionSettings;
use super::tree::{Tree, split};
use super::worker::{Continuation, PathWave, draw_1d, draw_2d};
use super::{Integrator, Radiance, RadianceQuery, Wave, Worker};
use crate::bsdf;
use crate::math::lanes::{f32x16, load};
use crate::sampling::{Dimension, SampleKey};
use crate::scene::Scene;
use bumpalo::Bump;

/// A branching path tracer.
pub struct DistributionIntegrator {
    settings: DistributionSettings,
}

impl DistributionIntegrator {
    /// The integrator with its settings.
    pub fn new(settings: DistributionSettings) -> Self {
        DistributionIntegrator { settings }
    }

    /// Follows the wave in the worker's hand, which has `depth` scattering events behind it, and all that comes of it.
    fn follow(&self, tree: &Tree<'_>, depth: u32, worker: &mut Worker, out: &mut [Radiance]) {
        let arena = Bump::new();
        let blocks = tree.hit_surfaces(&arena, depth, worker, out);
        let parents = std::mem::take(&mut worker.paths);
        let mut keys = Vec::new();
        if tree.samples_lights(depth) && tree.scene.needs.emitter_sampling {
            let n = self.settings.emitter_samples;
            for i in 0..n {
                self.split_keys(&parents, n, i, &mut keys);
                self.light(tree, depth, &blocks, &parents, &keys, worker);
                worker.trace_shadows(tree.scene, tree.coherence(depth), |slot, value| {
                    out[slot].value += value;
                });
            }
        }
        if tree.goes_on(depth) {
            for child in tree.specular_children(&blocks, &parents, |block| block.active & !block.finite) {
                worker.paths = child;
                self.follow(tree, depth + 1, worker, out);
            }
            let n = self.settings.bsdf_samples;
            for i in 0..n {
                self.split_keys(&parents, n, i, &mut keys);
                self.scatter(tree, depth, &blocks, &parents, &keys, worker);
                self.follow(tree, depth + 1, worker, out);
            }
        }
    }

    /// The keys of the `i`-th of `n` samples of each parent.
    fn split_keys(&self, parents: &PathWave, n: u32, i: u32, keys: &mut Vec<SampleKey>) {
        keys.clear();
        keys.extend(parents.keys.iter().map(|&key| split(key, n, i)));
    }

    /// Queues a shadow ray from each point with a finite lobe.
    fn light(
        &self,
        tree: &Tree<'_>,
        depth: u32,
        blocks: &[Block<'_>],
        parents: &PathWave,
        keys: &[SampleKey],
        worker: &mut Worker,
    ) {
        let Worker { sampler, numbers, shadows, .. } = worker;
        draw_1d(*sampler, Dimension::emitter_choice(depth), keys, &mut numbers.emitter_choice);
        draw_2d(*sampler, Dimension::emitter_point(depth), keys, &mut numbers.emitter_point);
        for block in blocks.iter().filter(|block| block.finite != 0) {
            let u_choice = load(&numbers.emitter_choice, block.first);
            let u_point = [0, 1].map(|k| load(&numbers.emitter_point[k], block.first));
            let sampled = lighting::sample_emitters(tree.scene, block, u_choice, u_point, tree.counts);
            let beta: [f32x16; 3] = std::array::from_fn(|c| load(&parents.beta[c], block.first));
            let value = std::array::from_fn(|c| beta[c] * sampled.value[c]);
            shadows.push(&sampled.rays, &parents.slots[block.first..], &value, sampled.lanes);
        }
    }

    /// Puts a ray into the BSDF of each point with a finite lobe into the worker's hand.
    fn scatter(
        &self,
        tree: &Tree<'_>,
        depth: u32,
        blocks: &[Block<'_>],
        parents: &PathWave,
        keys: &[SampleKey],
        worker: &mut Worker,
    ) {
        let Worker { sampler, numbers, paths, .. } = worker;
        draw_1d(*sampler, Dimension::bsdf_lobe(depth), keys, &mut numbers.bsdf_lobe);
        draw_2d(*sampler, Dimension::bsdf_direction(depth), keys, &mut numbers.bsdf_direction);
        paths.copy_from(parents);
        paths.keys.copy_from_slice(keys);
        let share = f32x16::splat(1.0 / tree.counts.bsdf);
        let mut alive = 0;
        for block in blocks {
            let u_lobe = load(&numbers.bsdf_lobe, block.first);
            let u = [0, 1].map(|k| load(&numbers.bsdf_direction[k], block.first));
            let sample = bsdf::lanes::sample_x16(&block.bsdfs, &block.wo, u_lobe, u, block.finite);
            let beta: [f32x16; 3] = std::array::from_fn(|c| load(&parents.beta[c], block.first));
            let beta: [f32x16; 3] = std::array::from_fn(|c| beta[c] * sample.weight[c] * share);
            let strongest = beta[0].fast_max(beta[1]).fast_max(beta[2]);
            let lanes = (sample.valid & strongest.simd_ne(f32x16::ZERO)).to_bitmask() & block.finite;
            let next = Continuation {
                rays: tree.scene.spawn_rays(&block.at, block.at.frame.to_world(sample.wi), block.rays.time),
                beta,
                pdf: sample.pdf,
                eta: load(&parents.eta, block.first) * sample.eta,
            };
            alive = paths.compact(block.first, alive, &next, lanes);
        }
        paths.truncate(alive);
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
        let DistributionSettings { max_depth, emitter_samples, bsdf_samples, hide_emitters } = self.settings;
        let emitter = if scene.needs.emitter_sampling { emitter_samples as f32 } else { 0.0 };
        let counts = TechniqueCounts { emitter, bsdf: bsdf_samples as f32 };
        let tree = Tree { scene, query, coherence: wave.coherence, max_depth, hide_emitters, counts };
        self.follow(&tree, 0, worker, out);
    }
}
