//! A finished cache in a layout for lookups: for each leaf of the octree, its records in blocks of sixteen.

use super::octree::Octree;
use super::record::Record;
use super::weight::RecordsX16;
use crate::color::Rgb;
use crate::math::lanes::{LANES, Vec3x16, bits, f32x16};
use crate::math::{Bounds, Vec3};
use glam::Vec4;

/// A set of records for interpolation.
pub struct Interpolation {
    tree: Octree,
    /// For each leaf, the indices of its first block and after its last block.
    leaves: Vec<[u32; 2]>,
    blocks: Vec<RecordBlock>,
    local: Vec<LocalIrradiance>,
}

/// Up to sixteen records of a leaf.
struct RecordBlock {
    points: RecordsX16,
    records: [u32; LANES],
}

/// The irradiance of a record as a function of position and normal, for three colour channels: `constant + turn·(n ×
/// n′) + slope·p′`.
struct LocalIrradiance {
    constant: Vec4,
    normal: Vec3,
    turn: [Vec4; 3],
    slope: [Vec4; 3],
    p: Vec3,
    radius: f32,
}

impl LocalIrradiance {
    fn new(record: &Record) -> Self {
        let wide = |colour: Rgb| Vec4::new(colour.r, colour.g, colour.b, 0.0);
        LocalIrradiance {
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

/// Weighted sums over the records that cover a point.
struct WeightedSum {
    light: Vec4,
    weights: f32,
    radii: f32,
}

/// Returns the weighted mean. Negative values, which gradients may cause, become 0.
#[inline(always)]
fn mean(light: Vec4, weights: f32) -> Rgb {
    let e = (light / weights).max(Vec4::ZERO);
    Rgb::new(e.x, e.y, e.z)
}

impl Interpolation {
    /// Creates the lookup structure.
    pub fn new(records: &[Record], bounds: Bounds) -> Self {
        let tree = Octree::of(records, bounds);
        let mut blocks = Vec::new();
        let mut leaves = Vec::with_capacity(tree.leaves().len());
        for list in tree.leaves() {
            let first = blocks.len() as u32;
            for chunk in list.chunks(LANES) {
                let mut indices = [0; LANES];
                indices[..chunk.len()].copy_from_slice(chunk);
                let points = RecordsX16::new(chunk.iter().map(|&i| &records[i as usize]));
                blocks.push(RecordBlock { points, records: indices });
            }
            leaves.push([first, blocks.len() as u32]);
        }
        Interpolation { tree, leaves, blocks, local: records.iter().map(LocalIrradiance::new).collect() }
    }

    /// Computes [`irradiance`](Self::irradiance), but also returns `None` if the records' mean radius exceeds
    /// `distance`. A ray origin that near would see details that interpolation removes.
    #[inline]
    pub fn irradiance_from(&self, distance: f32, p: Vec3, n: Vec3, facing: Vec3) -> Option<Rgb> {
        let WeightedSum { light, weights, radii } = self.sum(p, n, facing);
        (weights > 0.0 && radii <= distance * weights).then(|| mean(light, weights))
    }

    /// Returns the irradiance at the point `p` of a surface with the normal `n`, for a receiver with the normal
    /// `facing` (which differs with a bump map). Returns `None` if no record covers the point. Negative values, which
    /// gradients may cause, become 0.
    #[inline]
    pub fn irradiance(&self, p: Vec3, n: Vec3, facing: Vec3) -> Option<Rgb> {
        let WeightedSum { light, weights, .. } = self.sum(p, n, facing);
        (weights > 0.0).then(|| mean(light, weights))
    }

    /// Returns the weighted mean radius of the records that cover the point; zero if there is none.
    pub fn radius(&self, p: Vec3, n: Vec3) -> f32 {
        let WeightedSum { weights, radii, .. } = self.sum(p, n, n);
        if weights > 0.0 { radii / weights } else { 0.0 }
    }

    /// Returns the distance to the nearest record among those that may cover the point; infinite if there is none.
    pub fn nearest(&self, p: Vec3) -> f32 {
        let distance = |i: &u32| (self.local[*i as usize].p - p).length();
        self.tree.near(p).iter().map(distance).fold(f32::INFINITY, f32::min)
    }

    #[inline(always)]
    fn sum(&self, p: Vec3, n: Vec3, facing: Vec3) -> WeightedSum {
        let [first, end] = self.leaves[self.tree.leaf(p)];
        let (wide_p, wide_n) = (Vec3x16::splat(p), Vec3x16::splat(n));
        let mut sum = WeightedSum { light: Vec4::ZERO, weights: 0.0, radii: 0.0 };
        for block in &self.blocks[first as usize..end as usize] {
            let w = block.points.weights(wide_p, wide_n);
            let w_of = w.as_array();
            for i in bits(w.simd_gt(f32x16::ZERO).to_bitmask()) {
                let local_irradiance = &self.local[block.records[i] as usize];
                sum.light += local_irradiance.at(p, facing) * w_of[i];
                sum.weights += w_of[i];
                sum.radii += local_irradiance.radius * w_of[i];
            }
        }
        sum
    }

    /// Returns the bytes of all lookup data.
    pub fn memory_bytes(&self) -> usize {
        self.tree.memory_bytes()
            + size_of_val(self.leaves.as_slice())
            + size_of_val(self.blocks.as_slice())
            + size_of_val(self.local.as_slice())
    }
}
