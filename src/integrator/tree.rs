//! Ray trees, traversed level by level: the common part of `whitted` and `distribution`.
//!
//! One level is a wave of rays with the same number of edges before them. Its children are waves with at most one ray
//! for each parent, which are traced one after the other. The memory of a tree therefore grows with its depth but not
//! with its branching factor. The pending levels are in a list, without recursion, so paths may have any number of
//! edges.

use super::block::ShadingBlock;
use super::lighting::{self, TechniqueCounts};
use super::path::first_hits;
use super::path_wave::PathWave;
use super::worker::intersect;
use super::{Radiance, RadianceQuery, Worker};
use crate::accel::{Coherence, Hit};
use crate::math::lanes::bits;
use crate::sampling::SampleKey;
use crate::sampling::hash::combine;
use crate::scene::Scene;
use bumpalo::Bump;

/// The approximate number of child rays that are created at a time. Their parents' surface interactions are computed
/// again for the next ones.
const RAYS_AT_ONCE: usize = 1 << 15;

/// The state shared by all rays of a tree.
#[derive(Clone, Copy)]
pub(super) struct RayTree<'a> {
    pub scene: &'a Scene,
    pub query: RadianceQuery,
    /// The coherence of the rays of the first level.
    pub coherence: Coherence,
    /// Greatest number of edges of a path.
    pub max_depth: u32,
    /// Whether emitters are invisible to the camera.
    pub hide_emitters: bool,
}

/// The sampling strategy of an integrator at the surfaces of a tree.
pub(super) trait TreeStrategy {
    /// Returns the number of samples of each technique at a point after `depth` scattering events, for the weights.
    fn counts(&self, depth: u32) -> TechniqueCounts;

    /// Returns a mask of the lanes of a block that send a ray into each of their Dirac deltas.
    fn delta_lanes(&self, depth: u32, block: &ShadingBlock<'_>) -> u32;

    /// Returns the number of other rays from each surface.
    fn rays(&self, depth: u32) -> u32;

    /// Adds the light of sampled emitters.
    fn light(
        &self,
        tree: &RayTree<'_>,
        depth: u32,
        blocks: &[ShadingBlock<'_>],
        parents: &PathWave,
        worker: &mut Worker,
        out: &mut [Radiance],
    );

    /// Samples the `i`-th ray from each surface.
    fn scatter(
        &self,
        tree: &RayTree<'_>,
        depth: u32,
        i: u32,
        blocks: &[ShadingBlock<'_>],
        parents: &PathWave,
        worker: &mut Worker,
    ) -> PathWave;
}

/// A level with untraced children.
struct TreeLevel {
    /// The number of scattering events before its surfaces.
    depth: u32,
    parents: PathWave,
    hits: Vec<Option<Hit>>,
    /// Children that have been created, the next one last.
    ready: Vec<PathWave>,
    /// The number of sampled rays created so far, without those into deltas.
    scattered: u32,
}

impl TreeLevel {
    /// Creates children until there are about [`RAYS_AT_ONCE`] rays.
    fn make(
        &mut self,
        tree: &RayTree<'_>,
        branching: &impl TreeStrategy,
        blocks: &[ShadingBlock<'_>],
        worker: &mut Worker,
    ) {
        let mut rays = 0;
        while rays < RAYS_AT_ONCE && self.scattered < branching.rays(self.depth) {
            let child = branching.scatter(tree, self.depth, self.scattered, blocks, &self.parents, worker);
            self.scattered += 1;
            rays += self.parents.rays.len();
            self.ready.push(child);
        }
        self.ready.reverse();
    }
}

impl<'a> RayTree<'a> {
    /// Traces the worker's current wave and all its descendants.
    pub fn trace(&self, branching: &impl TreeStrategy, worker: &mut Worker, out: &mut [Radiance]) {
        let mut levels: Vec<TreeLevel> = Vec::new();
        let mut depth = 0;
        while !worker.interrupt.is_raised() {
            levels.extend(self.trace_level(branching, depth, worker, out));
            let Some(next) = self.next(branching, &mut levels, worker) else { break };
            depth = next;
        }
    }

    /// Makes the next wave the worker's current one. Returns the number of its scattering events, or `None` if no
    /// wave is left.
    fn next(
        &self,
        branching: &impl TreeStrategy,
        levels: &mut Vec<TreeLevel>,
        worker: &mut Worker,
    ) -> Option<u32> {
        loop {
            let level = levels.last_mut()?;
            let depth = level.depth + 1;
            let all_made = level.scattered >= branching.rays(level.depth);
            match level.ready.pop() {
                Some(child) => {
                    worker.paths = child;
                    if all_made && level.ready.is_empty() {
                        levels.pop();
                    }
                    return Some(depth);
                }
                None if all_made => {
                    levels.pop();
                }
                None => {
                    let arena = Bump::new();
                    let blocks: Vec<ShadingBlock<'_>> =
                        ShadingBlock::all(self.scene, &arena, &level.parents.rays, &level.hits).collect();
                    level.make(self, branching, &blocks, worker);
                }
            }
        }
    }

    /// Traces the worker's current wave, which has `depth` scattering events behind it, and adds the light that it
    /// finds. Returns its level with the first children, if it has any.
    fn trace_level(
        &self,
        branching: &impl TreeStrategy,
        depth: u32,
        worker: &mut Worker,
        out: &mut [Radiance],
    ) -> Option<TreeLevel> {
        let arena = Bump::new();
        let counts = branching.counts(depth.saturating_sub(1));
        let blocks = self.hit_surfaces(&arena, depth, counts, worker, out);
        let parents = std::mem::take(&mut worker.paths);
        let hits = std::mem::take(&mut worker.hits);
        if self.samples_lights(depth) {
            branching.light(self, depth, &blocks, &parents, worker, out);
        }
        if !self.goes_on(depth) || parents.rays.is_empty() {
            return None;
        }
        let ready = self.delta_children(&blocks, &parents, |block| branching.delta_lanes(depth, block));
        let mut level = TreeLevel { depth, parents, hits, ready, scattered: 0 };
        level.make(self, branching, &blocks, worker);
        Some(level)
    }

    /// Returns the coherence of rays after `depth` scattering events.
    pub fn coherence(&self, depth: u32) -> Coherence {
        if depth == 0 { self.coherence } else { Coherence::Incoherent }
    }

    /// Returns whether the query includes light from emitters sampled after `depth` scattering events.
    fn samples_lights(&self, depth: u32) -> bool {
        depth + 2 <= self.max_depth && self.query.wants(depth + 2)
    }

    /// Returns whether paths continue after `depth` scattering events.
    fn goes_on(&self, depth: u32) -> bool {
        depth + 2 <= self.max_depth && (self.query.direct || self.query.indirect)
    }

    /// Traces the worker's current wave, adds the emission found, and returns the blocks of surfaces that were hit.
    /// The current wave keeps only the rays with hits.
    fn hit_surfaces<'b>(
        &self,
        arena: &'b Bump,
        depth: u32,
        counts: TechniqueCounts,
        worker: &mut Worker,
        out: &mut [Radiance],
    ) -> Vec<ShadingBlock<'b>>
    where
        'a: 'b,
    {
        let scene = self.scene;
        intersect(scene, &worker.paths.rays, self.coherence(depth), &mut worker.hits, &mut worker.counters);
        if depth == 0 {
            first_hits(scene, self.hide_emitters, worker, out);
        }
        let add_emission = self.query.wants(depth + 1) && !(depth == 0 && self.hide_emitters);
        let Worker { paths, hits, .. } = worker;
        lighting::drop_missed(scene, paths, hits, out, counts, |_, _| add_emission);
        let blocks: Vec<ShadingBlock<'b>> = ShadingBlock::all(scene, arena, &paths.rays, hits).collect();
        if add_emission {
            for block in &blocks {
                for (i, le) in lighting::emitted(scene, block, paths, counts) {
                    let i = block.first + i;
                    out[paths.slots[i] as usize].value += paths.beta(i) * le;
                }
            }
        }
        blocks
    }

    /// Creates the rays into every Dirac delta of the lanes that `lanes` selects in each block. Wave k has the k-th
    /// delta of each parent.
    fn delta_children(
        &self,
        blocks: &[ShadingBlock<'_>],
        parents: &PathWave,
        lanes: impl Fn(&ShadingBlock<'_>) -> u32,
    ) -> Vec<PathWave> {
        let mut children: Vec<PathWave> = Vec::new();
        for block in blocks {
            for i in bits(lanes(block)) {
                let parent = block.first + i;
                let at = block.at.lane(i);
                let mut k = 0;
                block.bsdfs[i].specular_lobes(block.wo.lane(i), &mut |lobe| {
                    if k == children.len() {
                        children.push(PathWave::default());
                    }
                    let beta = parents.beta(parent) * lobe.weight;
                    if !beta.is_black() {
                        let ray = self.scene.spawn_ray(&at, at.frame.to_world(lobe.wi), at.time);
                        let key = branch_key(parents.keys[parent], k as u32);
                        children[k].push(
                            ray,
                            key,
                            parents.slots[parent],
                            beta,
                            parents.eta[parent] * lobe.eta,
                        );
                    }
                    k += 1;
                });
            }
        }
        children
    }
}

/// Returns the key of branch `k` of a sample, with a sequence of its own.
fn branch_key(key: SampleKey, k: u32) -> SampleKey {
    SampleKey { scramble: combine(key.scramble, k), ..key }
}

/// Returns the key of sample `i` of `n` where one sample branches: the n samples are consecutive points of its
/// sequence, so they are stratified among themselves.
///
/// An index beyond 32 bits continues with an independently scrambled sequence.
pub(super) fn split(key: SampleKey, n: u32, i: u32) -> SampleKey {
    let index = u64::from(key.index) * u64::from(n) + u64::from(i);
    let scramble = match (index >> 32) as u32 {
        0 => key.scramble,
        beyond => combine(key.scramble, beyond),
    };
    SampleKey { scramble, index: index as u32, ..key }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::HashSet;

    /// Eight levels of three-fold splits of eight samples; the last index exceeds 32 bits.
    #[test]
    fn no_two_nodes_of_a_level_share_a_key() {
        let mut level: Vec<SampleKey> =
            (0..8).map(|i| SampleKey { index: 700_000 + i, ..SampleKey::new(1, 2, 3, 0) }).collect();
        for depth in 0..8 {
            level = level.iter().flat_map(|&key| (0..3).map(move |i| split(key, 3, i))).collect();
            let distinct: HashSet<(u32, u32)> = level.iter().map(|k| (k.scramble, k.index)).collect();
            assert_eq!(distinct.len(), level.len(), "level {depth}");
        }
        assert!(level.iter().all(|k| k.scramble != SampleKey::new(1, 2, 3, 0).scramble));
        assert_ne!(branch_key(level[0], 0), branch_key(level[0], 1));
    }
}
