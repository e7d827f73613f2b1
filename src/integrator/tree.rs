//! Trees of rays, advanced level by level: what `whitted` and `distribution` have in common.
//!
//! A wave of rays that all have the same number of edges behind them is one level. Its children are waves of at most
//! one ray for each parent, taken one after the other, so that the memory of a tree grows with its depth and never
//! with its branching. The levels that are under way are a list and not a recursion: paths may have any number of
//! edges.

use super::block::Block;
use super::lighting::{self, TechniqueCounts};
use super::path::first_hits;
use super::worker::{PathWave, intersect};
use super::{Radiance, RadianceQuery, Worker};
use crate::accel::{Coherence, Hit};
use crate::math::lanes::bits;
use crate::sampling::SampleKey;
use crate::sampling::hash::combine;
use crate::scene::Scene;
use bumpalo::Bump;

/// Rays of children that are made at a time, about: what is known of their parents' surfaces is found anew for the
/// next ones.
const RAYS_AT_ONCE: usize = 1 << 15;

/// What every ray of a tree has in common.
#[derive(Clone, Copy)]
pub(super) struct Tree<'a> {
    pub scene: &'a Scene,
    pub query: RadianceQuery,
    /// What is known about the rays of the first level.
    pub coherence: Coherence,
    /// Longest path in edges.
    pub max_depth: u32,
    /// Whether emitters are invisible to the camera.
    pub hide_emitters: bool,
}

/// What an integrator does at the surfaces of a tree.
pub(super) trait Branching {
    /// Samples by either technique at a point with so many scattering events before it, for the weights.
    fn counts(&self, depth: u32) -> TechniqueCounts;

    /// The lanes of a block that send a ray into each of their Dirac deltas.
    fn delta_lanes(&self, depth: u32, block: &Block<'_>) -> u32;

    /// How many more rays leave each surface.
    fn rays(&self, depth: u32) -> u32;

    /// Adds the light of emitters that are sampled.
    fn light(
        &self,
        tree: &Tree<'_>,
        depth: u32,
        blocks: &[Block<'_>],
        parents: &PathWave,
        worker: &mut Worker,
        out: &mut [Radiance],
    );

    /// The `i`-th of the rays that leave the surfaces.
    fn scatter(
        &self,
        tree: &Tree<'_>,
        depth: u32,
        i: u32,
        blocks: &[Block<'_>],
        parents: &PathWave,
        worker: &mut Worker,
    ) -> PathWave;
}

/// A level with children that have not been followed.
struct Level {
    /// Scattering events before its surfaces.
    depth: u32,
    parents: PathWave,
    hits: Vec<Option<Hit>>,
    /// Children that are made, the next one last.
    ready: Vec<PathWave>,
    /// How many of the rays besides those into deltas are made.
    scattered: u32,
}

impl Level {
    /// Makes children until there are enough for a while.
    fn make(
        &mut self,
        tree: &Tree<'_>,
        branching: &impl Branching,
        blocks: &[Block<'_>],
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

impl<'a> Tree<'a> {
    /// Follows the wave in the worker's hand and all that comes of it.
    pub fn follow(&self, branching: &impl Branching, worker: &mut Worker, out: &mut [Radiance]) {
        let mut levels: Vec<Level> = Vec::new();
        let mut depth = 0;
        while !worker.interrupt.is_raised() {
            levels.extend(self.enter(branching, depth, worker, out));
            let Some(next) = self.next(branching, &mut levels, worker) else { break };
            depth = next;
        }
    }

    /// Puts the next wave into the worker's hand; returns the number of its scattering events, `None` if there is no
    /// wave left.
    fn next(&self, branching: &impl Branching, levels: &mut Vec<Level>, worker: &mut Worker) -> Option<u32> {
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
                    let blocks: Vec<Block<'_>> =
                        Block::all(self.scene, &arena, &level.parents.rays, &level.hits).collect();
                    level.make(self, branching, &blocks, worker);
                }
            }
        }
    }

    /// Traces the wave in the worker's hand, which has `depth` scattering events behind it, adds the light that it
    /// finds, and gives it back with its first children if it has any.
    fn enter(
        &self,
        branching: &impl Branching,
        depth: u32,
        worker: &mut Worker,
        out: &mut [Radiance],
    ) -> Option<Level> {
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
        let mut level = Level { depth, parents, hits, ready, scattered: 0 };
        level.make(self, branching, &blocks, worker);
        Some(level)
    }

    /// What is known about the rays with so many scattering events behind them.
    pub fn coherence(&self, depth: u32) -> Coherence {
        if depth == 0 { self.coherence } else { Coherence::Incoherent }
    }

    /// Whether light with so many edges is wanted from emitters that are sampled after `depth` scattering events.
    fn samples_lights(&self, depth: u32) -> bool {
        depth + 2 <= self.max_depth && self.query.wants(depth + 2)
    }

    /// Whether rays go on after `depth` scattering events.
    fn goes_on(&self, depth: u32) -> bool {
        depth + 2 <= self.max_depth && (self.query.direct || self.query.indirect)
    }

    /// Traces the wave in the worker's hand, adds the light that its rays find at emitters, and gives the surfaces that
    /// they hit. The wave in hand is left with those rays.
    fn hit_surfaces<'b>(
        &self,
        arena: &'b Bump,
        depth: u32,
        counts: TechniqueCounts,
        worker: &mut Worker,
        out: &mut [Radiance],
    ) -> Vec<Block<'b>>
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
        paths.keep_hits(hits, |paths, i| {
            if add_emission {
                let le = lighting::environment(scene, paths.rays[i].d, paths.pdf[i], counts);
                out[paths.slots[i] as usize].value += paths.beta(i) * le;
            }
        });
        let blocks: Vec<Block<'b>> = Block::all(scene, arena, &paths.rays, hits).collect();
        if add_emission {
            for block in &blocks {
                for (i, le) in lighting::emitted(scene, block, &paths.pdf, counts) {
                    let i = block.first + i;
                    out[paths.slots[i] as usize].value += paths.beta(i) * le;
                }
            }
        }
        blocks
    }

    /// The rays into every Dirac delta of the lanes that `lanes` picks in each block: wave k holds the k-th delta of
    /// each parent that has so many.
    fn delta_children(
        &self,
        blocks: &[Block<'_>],
        parents: &PathWave,
        lanes: impl Fn(&Block<'_>) -> u32,
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
                        let key = branch(parents.keys[parent], k as u32);
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

/// The key of branch `k` of a sample: a sequence of its own.
fn branch(key: SampleKey, k: u32) -> SampleKey {
    SampleKey { scramble: combine(key.scramble, k), ..key }
}

/// The key of the `i`-th of `n` samples that are drawn where one sample branches: n neighbouring points of its
/// sequence, so that they are stratified among themselves.
///
/// Where the index leaves the range of 32 bits, an independently scrambled sequence begins.
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

    /// Eight levels of three-fold splits of eight samples, past the range of 32 bits at the end.
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
        assert_ne!(branch(level[0], 0), branch(level[0], 1));
    }
}
