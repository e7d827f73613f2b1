//! A balanced kd-tree over points in space, for queries of the nearest k points and of all points within a distance.
//! [Bentley 1975]
//!
//! Points are in leaves of sixteen, which are full except for the last, with one array for each coordinate; a query
//! computes all distances of a leaf at once. The inner nodes are an array in which node i has the children 2i and 2i
//! + 1. There are no pointers; the memory is twelve bytes for each point and half a byte for the nodes.
//!
//! A query visits the nearer child first. For a postponed child it stores the distance from the query point to the
//! cell along each axis. [Arya and Mount 1993] These distances are rounded in the same way as those of points, so a
//! cell is never farther than a point in it.

mod build;
mod metric;
mod nearest;
#[cfg(test)]
mod tests;

pub use build::BuiltTree;
pub use metric::{EllipsoidMetric, Euclidean, Metric};
pub use nearest::{Neighbour, NeighbourBuffer, each};

use crate::math::lanes::{LANES, bits};
use crate::math::{Vec3, Vec3x16, f32x16};

/// The number of points in a leaf.
const LEAF: usize = LANES;

/// A balanced kd-tree. The data of a point is found by its slot.
#[derive(Clone, Debug, PartialEq)]
pub struct KdTree {
    /// The inner nodes from index 1. The array is as long as the list of leaves.
    splits: Vec<SplitPlane>,
    leaves: Vec<Leaf>,
    len: usize,
}

/// A splitting plane: no point of the left child is above it, none of the right child below.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct SplitPlane {
    at: f32,
    axis: u32,
}

/// The coordinates of sixteen points; those of missing points are infinite.
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C, align(64))]
struct Leaf([[f32; LEAF]; 3]);

impl Leaf {
    const EMPTY: Leaf = Leaf([[f32::INFINITY; LEAF]; 3]);

    #[inline(always)]
    fn points(&self) -> Vec3x16 {
        let [x, y, z] = self.0.map(f32x16::new);
        Vec3x16::new(x, y, z)
    }
}

/// A cell whose visit is postponed.
#[derive(Clone, Copy)]
struct PendingCell {
    node: u32,
    distance_squared: f32,
    /// The distance from the query point to the cell along each axis.
    offset: [f32; 3],
}

/// The greatest number of inner nodes between the root and a leaf.
const DEPTH: usize = 32;

impl KdTree {
    /// Returns the number of points.
    pub fn len(&self) -> usize {
        self.len
    }

    /// Returns whether there are no points.
    pub fn is_empty(&self) -> bool {
        self.len == 0
    }

    /// Returns the point in a slot.
    ///
    /// # Panics
    /// If the slot is out of range.
    #[inline]
    pub fn point(&self, slot: usize) -> Vec3 {
        assert!(slot < self.len);
        let Leaf(coordinates) = &self.leaves[slot / LEAF];
        Vec3::from_array(coordinates.map(|c| c[slot % LEAF]))
    }

    /// Returns the bytes on the heap.
    pub fn memory_bytes(&self) -> usize {
        size_of_val(&self.splits[..]) + size_of_val(&self.leaves[..])
    }

    /// Calls `visit` for every point nearer than the square root of `distance_squared`, with its slot and squared
    /// distance.
    pub fn for_each_within(&self, center: Vec3, distance_squared: f32, mut visit: impl FnMut(usize, f32)) {
        self.for_each_leaf(center, distance_squared, |leaf, bound| {
            let distances = Euclidean.distances_squared(center, self.leaves[leaf].points());
            for lane in bits(distances.simd_lt(f32x16::splat(bound)).to_bitmask()) {
                visit(leaf * LEAF + lane, distances.as_array()[lane]);
            }
            bound
        });
    }

    /// Calls `visit` for the leaves whose cells are nearer than the square root of `bound`, near ones first. `visit`
    /// returns the new bound.
    #[inline(always)]
    fn for_each_leaf(&self, center: Vec3, mut bound: f32, mut visit: impl FnMut(usize, f32) -> f32) {
        let leaves = self.leaves.len();
        if leaves == 0 {
            return;
        }
        // Leaves are numbered from the left. Those of the lowest level come first, although they are last in the
        // array of nodes.
        let lowest = leaves.next_power_of_two();
        let center = center.to_array();
        let mut stack = [PendingCell { node: 0, distance_squared: 0.0, offset: [0.0; 3] }; DEPTH];
        let mut height = 0;
        let mut at = PendingCell { node: 1, distance_squared: 0.0, offset: [0.0; 3] };
        loop {
            let mut node = at.node as usize;
            while node < leaves {
                let SplitPlane { at: plane, axis } = self.splits[node];
                let beyond = center[axis as usize] - plane;
                let near = 2 * node + usize::from(beyond > 0.0);
                let mut offset = at.offset;
                offset[axis as usize] = beyond;
                let distance_squared = offset[0] * offset[0] + offset[1] * offset[1] + offset[2] * offset[2];
                stack[height] = PendingCell { node: near as u32 ^ 1, distance_squared, offset };
                height += usize::from(distance_squared < bound);
                node = near;
            }
            let leaf = if node >= lowest { node - lowest } else { node + leaves - lowest };
            bound = visit(leaf, bound);
            loop {
                if height == 0 {
                    return;
                }
                height -= 1;
                if stack[height].distance_squared < bound {
                    break;
                }
            }
            at = stack[height];
        }
    }
}
