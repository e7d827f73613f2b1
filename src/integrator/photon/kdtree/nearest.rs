//! Queries for the nearest k points.

use super::{KdTree, LEAF, Metric};
use crate::math::lanes::bits;
use crate::math::{Vec3, f32x16};

/// A point found by a query: its squared distance and its slot.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Neighbour(u64);

impl Neighbour {
    #[inline(always)]
    fn new(distance_squared: f32, slot: usize) -> Self {
        // Non-negative floats have the same order as their bits.
        Neighbour(u64::from(distance_squared.to_bits()) << 32 | slot as u64)
    }

    /// Returns the squared distance from the query point in the query's metric.
    #[inline]
    pub fn distance_squared(self) -> f32 {
        f32::from_bits((self.0 >> 32) as u32)
    }

    /// Returns the slot of the point.
    #[inline]
    pub fn slot(self) -> usize {
        self.0 as u32 as usize
    }
}

/// The results of a query; reused by later queries to avoid allocation.
#[derive(Default)]
pub struct NeighbourBuffer {
    found: Vec<Neighbour>,
}

impl KdTree {
    /// Finds the `k` points nearest to `center` in the metric, among those that are nearer than the square root of
    /// `bound` and accepted, in no particular order. Of several points at the same distance, the choice is
    /// unspecified but deterministic.
    ///
    /// `accept` gets the first slot of a leaf and a mask of some of its sixteen slots, and returns a mask of the
    /// accepted ones: see [`each`].
    #[inline]
    pub fn nearest<'a>(
        &self,
        center: Vec3,
        k: usize,
        bound: f32,
        metric: impl Metric,
        accept: impl Fn(usize, u32) -> u32,
        buffer: &'a mut NeighbourBuffer,
    ) -> &'a [Neighbour] {
        let found = &mut buffer.found;
        found.clear();
        if k == 0 {
            return found;
        }
        // Selections run only after half as many points again were collected, so each point has a constant cost.
        let room = k + (k / 2).max(LEAF);
        found.reserve(room + LEAF);
        self.for_each_leaf(center, bound, |leaf, mut bound| {
            let distances = metric.distances_squared(center, self.leaves[leaf].points());
            let close = distances.simd_lt(f32x16::splat(bound)).to_bitmask();
            if close != 0 {
                for lane in bits(accept(leaf * LEAF, close)) {
                    found.push(Neighbour::new(distances.as_array()[lane], leaf * LEAF + lane));
                }
            }
            if found.len() > room {
                bound = keep_nearest(found, k);
            }
            bound
        });
        if found.len() > k {
            keep_nearest(found, k);
        }
        found
    }
}

impl KdTree {
    /// Finds the point nearest to `center` in the metric, among those that are nearer than the square root of `bound`
    /// and whose slots are accepted. Of several points at the same distance, the choice is unspecified but
    /// deterministic.
    #[inline]
    pub fn nearest_one(
        &self,
        center: Vec3,
        bound: f32,
        metric: impl Metric,
        accept: impl Fn(usize) -> bool,
    ) -> Option<Neighbour> {
        let mut nearest = None;
        self.for_each_leaf(center, bound, |leaf, mut bound| {
            let distances = metric.distances_squared(center, self.leaves[leaf].points());
            for lane in bits(distances.simd_lt(f32x16::splat(bound)).to_bitmask()) {
                let (distance, slot) = (distances.as_array()[lane], leaf * LEAF + lane);
                if distance < bound && accept(slot) {
                    bound = distance;
                    nearest = Some(Neighbour::new(distance, slot));
                }
            }
            bound
        });
        nearest
    }
}

/// Converts a predicate on single slots to the form that [`KdTree::nearest`] needs.
pub fn each(accept: impl Fn(usize) -> bool) -> impl Fn(usize, u32) -> u32 {
    move |first, slots| bits(slots).filter(|lane| accept(first + lane)).fold(0, |set, lane| set | 1 << lane)
}

/// Removes all but the nearest `k` points. Returns the squared distance of the farthest remaining one.
fn keep_nearest(found: &mut Vec<Neighbour>, k: usize) -> f32 {
    let (_, farthest, _) = found.select_nth_unstable(k - 1);
    let bound = farthest.distance_squared();
    found.truncate(k);
    bound
}
