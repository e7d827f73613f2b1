//! A finished cache, laid out to be read: for each leaf of the octree its records' places, sixteen beside each other.

use super::octree::Octree;
use super::record::Record;
use super::weight::Places;
use crate::color::Rgb;
use crate::math::lanes::{LANES, Vec3x16, bits, f32x16};
use crate::math::{Bounds, Vec3};
use glam::Vec4;

/// Records to interpolate among.
pub struct Interpolation {
    tree: Octree,
    /// By leaf: its first block, and one past its last.
    leaves: Vec<[u32; 2]>,
    blocks: Vec<Block>,
    changes: Vec<Change>,
}

/// Up to sixteen records of a leaf.
struct Block {
    places: Places,
    records: [u32; LANES],
}

/// A record's irradiance as a function of place and normal, its three colours side by side:
/// `constant + turn·(n × n′) + slope·p′`.
struct Change {
    constant: Vec4,
    normal: Vec3,
    turn: [Vec4; 3],
    slope: [Vec4; 3],
    p: Vec3,
    radius: f32,
}

impl Change {
    fn new(record: &Record) -> Self {
        let wide = |colour: Rgb| Vec4::new(colour.r, colour.g, colour.b, 0.0);
        Change {
            constant: wide(record.irradiance),
            normal: record.n,
            turn: record.rotation.along.map(wide),
            slope: record.translation.along.map(wide),
            p: record.p,
            radius: record.radius,
        }
    }

    #[inline(always)]
    fn at(&self, p: Vec3, n: Vec3) -> Vec4 {
        let (to, turn) = (p - self.p, self.normal.cross(n));
        self.constant
            + self.slope[0] * to.x
            + self.slope[1] * to.y
            + self.slope[2] * to.z
            + self.turn[0] * turn.x
            + self.turn[1] * turn.y
            + self.turn[2] * turn.z
    }
}

/// Weighted sums over the records that reach a point.
struct Sum {
    light: Vec4,
    weights: f32,
    radii: f32,
}

/// What gradients make negative is black.
#[inline(always)]
fn mean(light: Vec4, weights: f32) -> Rgb {
    let e = (light / weights).max(Vec4::ZERO);
    Rgb::new(e.x, e.y, e.z)
}

impl Interpolation {
    /// The records, with radii `scale` times as large.
    pub fn new(records: &[Record], bounds: Bounds, scale: f32) -> Self {
        let tree = Octree::of(records, bounds, scale);
        let mut blocks = Vec::new();
        let mut leaves = Vec::with_capacity(tree.leaves().len());
        for list in tree.leaves() {
            let first = blocks.len() as u32;
            for chunk in list.chunks(LANES) {
                let mut indices = [0; LANES];
                indices[..chunk.len()].copy_from_slice(chunk);
                let places = Places::new(chunk.iter().map(|&i| &records[i as usize]), scale);
                blocks.push(Block { places, records: indices });
            }
            leaves.push([first, blocks.len() as u32]);
        }
        Interpolation { tree, leaves, blocks, changes: records.iter().map(Change::new).collect() }
    }

    /// As [`irradiance`](Self::irradiance), but also `None` where the records are spread wider than `distance`: from so near, what
    /// they smooth away would be seen.
    #[inline]
    pub fn irradiance_from(&self, distance: f32, p: Vec3, n: Vec3, facing: Vec3) -> Option<Rgb> {
        let Sum { light, weights, radii } = self.sum(p, n, facing);
        (weights > 0.0 && radii <= distance * weights).then(|| mean(light, weights))
    }

    /// Irradiance at the point `p` of a surface whose normal is `n`, for a receiver with the normal `facing` (which differs under
    /// a bump map); `None` where no record reaches. What gradients make negative is black.
    #[inline]
    pub fn irradiance(&self, p: Vec3, n: Vec3, facing: Vec3) -> Option<Rgb> {
        let Sum { light, weights, .. } = self.sum(p, n, facing);
        (weights > 0.0).then(|| mean(light, weights))
    }

    /// The mean radius of the records that reach the point, by their weights; zero where none does.
    pub fn radius(&self, p: Vec3, n: Vec3) -> f32 {
        let Sum { weights, radii, .. } = self.sum(p, n, n);
        if weights > 0.0 { radii / weights } else { 0.0 }
    }

    /// The distance of the nearest record among those that may reach the point; infinite where there is none.
    pub fn nearest(&self, p: Vec3) -> f32 {
        let distance = |i: &u32| (self.changes[*i as usize].p - p).length();
        self.tree.near(p).iter().map(distance).fold(f32::INFINITY, f32::min)
    }

    #[inline(always)]
    fn sum(&self, p: Vec3, n: Vec3, facing: Vec3) -> Sum {
        let [first, end] = self.leaves[self.tree.leaf(p)];
        let (wide_p, wide_n) = (Vec3x16::splat(p), Vec3x16::splat(n));
        let mut sum = Sum { light: Vec4::ZERO, weights: 0.0, radii: 0.0 };
        for block in &self.blocks[first as usize..end as usize] {
            let w = block.places.weights(wide_p, wide_n);
            let w_of = w.as_array();
            for i in bits(w.simd_gt(f32x16::ZERO).to_bitmask()) {
                let change = &self.changes[block.records[i] as usize];
                sum.light += change.at(p, facing) * w_of[i];
                sum.weights += w_of[i];
                sum.radii += change.radius * w_of[i];
            }
        }
        sum
    }

    /// Bytes of all that is there to be read.
    pub fn memory_bytes(&self) -> usize {
        self.tree.memory_bytes()
            + size_of_val(self.leaves.as_slice())
            + size_of_val(self.blocks.as_slice())
            + size_of_val(self.changes.as_slice())
    }
}
