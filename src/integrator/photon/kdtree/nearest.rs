//! The nearest k points.

use super::{KdTree, LEAF, Metric};
use crate::math::lanes::bits;
use crate::math::{Vec3, f32x16};

/// A point that was found: its squared distance and its slot.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Neighbour(u64);

impl Neighbour {
    #[inline(always)]
    fn new(distance_squared: f32, slot: usize) -> Self {
        // Numbers that are not negative sort as their bits do.
        Neighbour(u64::from(distance_squared.to_bits()) << 32 | slot as u64)
    }

    /// The squared distance from the query point, as the metric has it.
    #[inline]
    pub fn distance_squared(self) -> f32 {
        f32::from_bits((self.0 >> 32) as u32)
    }

    /// The slot of the point.
    #[inline]
    pub fn slot(self) -> usize {
        self.0 as u32 as usize
    }
}

/// What a query has found; kept from query to query, so that none allocates.
#[derive(Default)]
pub struct Nearest {
    found: Vec<Neighbour>,
}

impl KdTree {
    /// The `k` points nearest to `center` in the metric, of those that are closer than the root of `bound` and that
    /// `accept` takes; in no particular order. Which of several points at the same distance are taken is
    /// not said, but always the same.
    ///
    /// `accept` is given the first slot of a leaf and the bits of some of its sixteen slots, and returns those that it takes: see
    /// [`each`].
    #[inline]
    pub fn nearest<'a>(
        &self,
        center: Vec3,
        k: usize,
        bound: f32,
        metric: impl Metric,
        accept: impl Fn(usize, u32) -> u32,
        buffer: &'a mut Nearest,
    ) -> &'a [Neighbour] {
        let found = &mut buffer.found;
        found.clear();
        if k == 0 {
            return found;
        }
        // Half as many again are collected between one selection and the next: that costs a constant for each.
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
    /// The point nearest to `center` in the metric, of those that are closer than the root of `bound` and whose slots
    /// `accept` takes. Which of several points at the same distance it is is not said, but always the same.
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

/// What takes slots one by one, for [`KdTree::nearest`].
pub fn each(accept: impl Fn(usize) -> bool) -> impl Fn(usize, u32) -> u32 {
    move |first, slots| bits(slots).filter(|lane| accept(first + lane)).fold(0, |set, lane| set | 1 << lane)
}

/// Forgets all but the nearest `k`; returns the squared distance of the farthest of them.
fn keep_nearest(found: &mut Vec<Neighbour>, k: usize) -> f32 {
    let (_, farthest, _) = found.select_nth_unstable(k - 1);
    let bound = farthest.distance_squared();
    found.truncate(k);
    bound
}
