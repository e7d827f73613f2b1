//! An octree, in plain arrays, that finds the records covering a point. [Ward 1988]
//!
//! Every leaf lists all records whose volume of positive weight may overlap it, so a lookup visits a single leaf.

use super::record::Record;
use super::weight::THICKNESS;
use crate::math::{Bounds, Vec3};

/// The number of records above which a leaf is split, unless all of them cover the whole leaf.
const FULL: usize = 16;
/// The greatest depth of the tree, at which `f32` positions cannot be separated any more.
const MAX_DEPTH: u32 = 20;
/// The bit that marks a leaf.
const LEAF: u32 = 1 << 31;

/// An octree of records, which are referenced by index.
#[derive(Clone, Debug)]
pub struct Octree {
    center: Vec3,
    half: f32,
    /// For each node, the index of the first of its eight children, or [`LEAF`] plus the index of the leaf.
    nodes: Vec<u32>,
    leaves: Vec<Vec<u32>>,
}

/// A cube of the tree.
#[derive(Clone, Copy)]
struct Cube {
    center: Vec3,
    half: f32,
}

impl Cube {
    fn child(self, i: usize) -> Cube {
        let half = 0.5 * self.half;
        let sign = |bit: usize| if i >> bit & 1 == 1 { half } else { -half };
        Cube { center: self.center + Vec3::new(sign(0), sign(1), sign(2)), half }
    }

    /// Returns the child that contains `p`.
    #[inline(always)]
    fn octant(self, p: Vec3) -> usize {
        let above = p.cmpge(self.center);
        above.bitmask() as usize
    }

    /// Returns whether the volume of positive weight of a record may overlap the cube.
    fn touches(self, record: &Record) -> bool {
        let radius = record.radius;
        let to = record.p - self.center;
        let outside = (to.abs() - Vec3::splat(self.half)).max(Vec3::ZERO);
        // The half extent of the cube along the normal.
        let extent = self.half * record.n.abs().element_sum();
        outside.length_squared() <= radius * radius && to.dot(record.n).abs() <= extent + THICKNESS * radius
    }
}

impl Octree {
    /// Creates an empty tree over the bounds.
    pub fn new(bounds: Bounds) -> Self {
        let half = (0.5 * (bounds.max - bounds.min).max_element()).max(f32::MIN_POSITIVE);
        Octree { center: bounds.center(), half, nodes: vec![LEAF], leaves: vec![Vec::new()] }
    }

    /// Creates the tree of all records.
    pub fn of(records: &[Record], bounds: Bounds) -> Self {
        let mut tree = Octree::new(bounds);
        (0..records.len()).for_each(|i| tree.insert(i as u32, records));
        tree
    }

    /// Inserts record `i` of `records` into every leaf that it may overlap.
    pub fn insert(&mut self, i: u32, records: &[Record]) {
        self.insert_into(0, Cube { center: self.center, half: self.half }, 0, i, records);
    }

    fn insert_into(&mut self, node: usize, cube: Cube, depth: u32, i: u32, records: &[Record]) {
        if !cube.touches(&records[i as usize]) && depth > 0 {
            return;
        }
        if self.nodes[node] & LEAF == 0 {
            let first = self.nodes[node] as usize;
            for k in 0..8 {
                self.insert_into(first + k, cube.child(k), depth + 1, i, records);
            }
            return;
        }
        let leaf = (self.nodes[node] & !LEAF) as usize;
        self.leaves[leaf].push(i);
        let list = &self.leaves[leaf];
        // Splitting is useful only if some record is smaller than the cube.
        let least = list.iter().map(|&i| records[i as usize].radius).fold(f32::INFINITY, f32::min);
        if list.len() <= FULL || depth >= MAX_DEPTH || least > 2.0 * cube.half {
            return;
        }
        let list = std::mem::take(&mut self.leaves[leaf]);
        let first = self.nodes.len();
        self.nodes[node] = first as u32;
        for k in 0..8 {
            let child = cube.child(k);
            let of_child: Vec<u32> =
                list.iter().copied().filter(|&i| child.touches(&records[i as usize])).collect();
            // The first child reuses the index of the split leaf.
            let index = if k == 0 { leaf } else { self.leaves.len() };
            if k > 0 {
                self.leaves.push(Vec::new());
            }
            self.leaves[index] = of_child;
            self.nodes.push(LEAF | index as u32);
        }
    }

    /// Returns the leaf that contains `p`.
    #[inline]
    pub fn leaf(&self, p: Vec3) -> usize {
        let mut cube = Cube { center: self.center, half: self.half };
        let mut node = self.nodes[0];
        while node & LEAF == 0 {
            let octant = cube.octant(p);
            node = self.nodes[node as usize + octant];
            cube = cube.child(octant);
        }
        (node & !LEAF) as usize
    }

    /// Returns the records that may cover `p`.
    pub fn near(&self, p: Vec3) -> &[u32] {
        &self.leaves[self.leaf(p)]
    }

    /// Returns the record lists of all leaves.
    pub fn leaves(&self) -> &[Vec<u32>] {
        &self.leaves
    }

    /// Returns the bytes of nodes and lists.
    pub fn memory_bytes(&self) -> usize {
        let lists: usize = self.leaves.iter().map(|l| l.capacity() * 4 + size_of::<Vec<u32>>()).sum();
        self.nodes.capacity() * 4 + lists
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::integrator::irrcache::weight::weight;
    use crate::sampling::hash::{pcg3d, to_unit};

    fn random(i: u32, k: u32) -> Vec3 {
        Vec3::from_array(pcg3d(i, k, 1).map(to_unit))
    }

    /// The leaf of a point lists every record with positive weight there, also at the corners of the bounds and after
    /// a record's radius was reduced.
    #[test]
    fn the_leaf_of_a_point_lists_every_record_that_reaches_it() {
        let mut records: Vec<Record> = (0..2000)
            .map(|i| Record {
                p: random(i, 0),
                n: (random(i, 1) - Vec3::splat(0.5)).normalize(),
                radius: 0.3 * to_unit(pcg3d(i, 2, 2)[0]).powi(3) + 1e-4,
                ..Record::default()
            })
            .collect();
        let bounds = Bounds { min: Vec3::ZERO, max: Vec3::ONE };
        for factor in [1.0, 2.0] {
            records.iter_mut().for_each(|r| r.radius *= factor);
            let tree = Octree::of(&records, bounds);
            let corners = (0..8).map(|i| Vec3::new((i & 1) as f32, (i >> 1 & 1) as f32, (i >> 2) as f32));
            let mut found = 0;
            for p in (0..2000).map(|i| random(i, 7)).chain(corners).chain(records.iter().map(|r| r.p)) {
                let listed = tree.near(p);
                for (i, record) in records.iter().enumerate() {
                    if weight(record, p, record.n) > 0.0 {
                        assert!(listed.contains(&(i as u32)), "record {i} is not listed at {p}");
                        found += 1;
                    }
                }
            }
            assert!(found > 10_000, "{found}");
            records.iter_mut().for_each(|r| r.radius *= 0.5);
        }
    }

    #[test]
    fn records_at_one_point_do_not_divide_for_ever() {
        let records = vec![Record { p: Vec3::ONE, n: Vec3::Z, radius: 1e-9, ..Record::default() }; 100];
        let tree = Octree::of(&records, Bounds { min: Vec3::ZERO, max: Vec3::ONE });
        assert_eq!(tree.near(Vec3::ONE).len(), 100);
        assert!(tree.memory_bytes() < 1 << 16);
    }
}
