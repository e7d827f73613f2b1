//! A balanced kd-tree over points in space, for the nearest k and for all within a distance. [Bentley 1975]
//!
//! Points stand in leaves of sixteen, which are full but for the last, one array for each coordinate: a leaf's distances are
//! computed in one go. The inner nodes are an array in which node i has the children 2i and 2i + 1, so there are no
//! pointers, and no memory but twelve bytes a point and half a byte for the nodes.
//!
//! A query goes to the nearer child first and keeps, for what it puts off, how far the query point is from the
//! cell along each axis. [Arya and Mount 1993] These distances are rounded as those of points are, so that a
//! cell is never farther than a point in it.

mod build;
mod metric;
mod nearest;
#[cfg(test)]
mod tests;

pub use build::Built;
pub use metric::{Disc, Euclidean, Metric};
pub use nearest::{Nearest, Neighbour, each};

use crate::math::lanes::{LANES, bits};
use crate::math::{Vec3, Vec3x16, f32x16};

/// Points of a leaf.
const LEAF: usize = LANES;

/// A balanced kd-tree; what belongs to a point is found by its slot.
#[derive(Clone, Debug, PartialEq)]
pub struct KdTree {
    /// The inner nodes from place 1; as many places as there are leaves.
    splits: Vec<Split>,
    leaves: Vec<Leaf>,
    len: usize,
}

/// A plane across an axis: no point of the left child is above it, none of the right one below.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Split {
    at: f32,
    axis: u32,
}

/// Coordinates of sixteen points; those that are missing are infinite.
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

/// A cell that a query has put off.
#[derive(Clone, Copy)]
struct Pending {
    node: u32,
    distance_squared: f32,
    /// How far the query point is from the cell along each axis.
    offset: [f32; 3],
}

/// There are no more inner nodes between the root and a leaf.
const DEPTH: usize = 32;

impl KdTree {
    /// How many points there are.
    pub fn len(&self) -> usize {
        self.len
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.len == 0
    }

    /// The point in a slot.
    ///
    /// # Panics
    /// If there are not so many slots.
    #[inline]
    pub fn point(&self, slot: usize) -> Vec3 {
        assert!(slot < self.len);
        let Leaf(coordinates) = &self.leaves[slot / LEAF];
        Vec3::from_array(coordinates.map(|c| c[slot % LEAF]))
    }

    /// Bytes on the heap.
    pub fn memory_bytes(&self) -> usize {
        size_of_val(&self.splits[..]) + size_of_val(&self.leaves[..])
    }

    /// Hands `visit` the slot of every point closer than the root of `distance_squared`, and its squared distance.
    pub fn for_each_within(&self, center: Vec3, distance_squared: f32, mut visit: impl FnMut(usize, f32)) {
        self.for_each_leaf(center, distance_squared, |leaf, bound| {
            let distances = Euclidean.distances_squared(center, self.leaves[leaf].points());
            for lane in bits(distances.simd_lt(f32x16::splat(bound)).to_bitmask()) {
                visit(leaf * LEAF + lane, distances.as_array()[lane]);
            }
            bound
        });
    }

    /// Hands `visit` the leaves whose cells are closer than the root of `bound`, near ones first; it returns the bound from
    /// there on.
    #[inline(always)]
    fn for_each_leaf(&self, center: Vec3, mut bound: f32, mut visit: impl FnMut(usize, f32) -> f32) {
        let leaves = self.leaves.len();
        if leaves == 0 {
            return;
        }
        // Leaves count from the left. Those of the lowest level come first, but stand last in the array of nodes.
        let lowest = leaves.next_power_of_two();
        let center = center.to_array();
        let mut stack = [Pending { node: 0, distance_squared: 0.0, offset: [0.0; 3] }; DEPTH];
        let mut height = 0;
        let mut at = Pending { node: 1, distance_squared: 0.0, offset: [0.0; 3] };
        loop {
            let mut node = at.node as usize;
            while node < leaves {
                let Split { at: plane, axis } = self.splits[node];
                let beyond = center[axis as usize] - plane;
                let near = 2 * node + usize::from(beyond > 0.0);
                let mut offset = at.offset;
                offset[axis as usize] = beyond;
                let distance_squared = offset[0] * offset[0] + offset[1] * offset[1] + offset[2] * offset[2];
                stack[height] = Pending { node: near as u32 ^ 1, distance_squared, offset };
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
