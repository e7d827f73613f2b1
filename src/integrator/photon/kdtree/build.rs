//! The construction of a balanced kd-tree.

use super::{KdTree, LEAF, Leaf, SplitPlane};
use crate::math::Vec3;
use rayon::prelude::*;

/// The number of points below which a subtree is built by one thread.
const PARALLEL: usize = 1 << 12;

/// A tree and the point in each of its slots.
pub struct BuiltTree {
    /// The tree.
    pub tree: KdTree,
    /// The index of the point in each slot.
    pub order: Vec<u32>,
}

/// A point with its index.
#[derive(Clone, Copy)]
struct TreePoint {
    p: [f32; 3],
    index: u32,
}

impl KdTree {
    /// The greatest number of points in a tree.
    pub const MAX_POINTS: usize = 1 << 31;

    /// Builds the tree of the points `position(0)` to `position(len - 1)`. The result does not depend on the number
    /// of threads: points with equal coordinates are ordered by index.
    ///
    /// # Panics
    /// If a point is not finite, or there are more than [`MOST`](Self::MAX_POINTS).
    pub fn build(len: usize, position: impl Fn(usize) -> Vec3 + Sync) -> BuiltTree {
        assert!(len <= Self::MAX_POINTS, "{len} points are more than a kd-tree can hold");
        let entry = |i: usize| {
            let p = position(i);
            assert!(p.is_finite(), "a kd-tree holds finite points only, not {p}");
            TreePoint { p: p.to_array(), index: i as u32 }
        };
        let mut entries: Vec<TreePoint> = (0..len).into_par_iter().map(entry).collect();
        let count = len.div_ceil(LEAF);
        let mut leaves = vec![Leaf::EMPTY; count];
        // SplitPlane i is between leaf i and the next leaf.
        let mut between = vec![SplitPlane::default(); count.saturating_sub(1)];
        if count > 0 {
            build_node(&mut entries, &mut leaves, &mut between);
        }
        let mut splits = vec![SplitPlane::default(); count];
        place_splits(&between, 1, &mut splits);
        let order = entries.iter().map(|e| e.index).collect();
        BuiltTree { tree: KdTree { splits, leaves, len }, order }
    }
}

/// Sorts the points below a node into its leaves and computes the splits between them.
fn build_node(entries: &mut [TreePoint], leaves: &mut [Leaf], between: &mut [SplitPlane]) {
    if let [leaf] = leaves {
        return fill_leaf(entries, leaf);
    }
    let left = leaves_on_the_left(leaves.len());
    let axis = widest_axis(entries);
    let (_, first, _) = entries.select_nth_unstable_by_key(left * LEAF, |e| sort_key(e, axis));
    let at = first.p[axis];
    let parallel = entries.len() >= PARALLEL;
    let (left_entries, right_entries) = entries.split_at_mut(left * LEAF);
    let (left_leaves, right_leaves) = leaves.split_at_mut(left);
    let (left_between, rest) = between.split_at_mut(left - 1);
    let (root, right_between) = rest.split_at_mut(1);
    root[0] = SplitPlane { at, axis: axis as u32 };
    let mut on_the_left = || build_node(left_entries, left_leaves, left_between);
    let mut on_the_right = || build_node(right_entries, right_leaves, right_between);
    if parallel {
        rayon::join(on_the_left, on_the_right);
    } else {
        on_the_left();
        on_the_right();
    }
}

fn fill_leaf(entries: &mut [TreePoint], leaf: &mut Leaf) {
    entries.sort_unstable_by_key(|e| e.index);
    for (lane, entry) in entries.iter().enumerate() {
        for (coordinates, value) in leaf.0.iter_mut().zip(entry.p) {
            coordinates[lane] = value;
        }
    }
}

/// Writes the splits below a node, given from left to right, to the indices of their nodes.
fn place_splits(between: &[SplitPlane], node: usize, splits: &mut [SplitPlane]) {
    if between.is_empty() {
        return;
    }
    let left = leaves_on_the_left(between.len() + 1);
    splits[node] = between[left - 1];
    place_splits(&between[..left - 1], 2 * node, splits);
    place_splits(&between[left..], 2 * node + 1, splits);
}

/// Returns the number of leaves to the left of the root of a tree whose levels are full, except for the last one,
/// which is filled from the left.
fn leaves_on_the_left(leaves: usize) -> usize {
    let full = 1 << leaves.ilog2();
    full / 2 + (leaves - full).min(full / 2)
}

/// Returns a key that sorts by coordinate, then by index.
#[inline(always)]
fn sort_key(entry: &TreePoint, axis: usize) -> u64 {
    let bits = entry.p[axis].to_bits();
    let negative = (bits as i32 >> 31) as u32;
    u64::from(bits ^ (negative | 1 << 31)) << 32 | u64::from(entry.index)
}

/// Returns the axis of the points' greatest extent.
fn widest_axis(entries: &[TreePoint]) -> usize {
    let (mut min, mut max) = ([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]);
    for TreePoint { p, .. } in entries {
        for c in 0..3 {
            min[c] = if p[c] < min[c] { p[c] } else { min[c] };
            max[c] = if p[c] > max[c] { p[c] } else { max[c] };
        }
    }
    // Halves avoid overflow in the difference of finite numbers.
    let [x, y, z]: [f32; 3] = std::array::from_fn(|c| max[c] * 0.5 - min[c] * 0.5);
    match () {
        _ if x >= y && x >= z => 0,
        _ if y >= z => 1,
        _ => 2,
    }
}
