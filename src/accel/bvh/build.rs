//! One tree: its primitives collected, built by obvhs, and laid out by leaf.

use super::super::geometry::valid_triangle;
use super::super::{Geometry, Primitive};
use crate::math::{Bounds, Vec3};
use obvhs::BvhBuildParams;
use obvhs::aabb::Aabb;
use obvhs::cwbvh::{CwBvh, builder::build_cwbvh};
use std::time::Duration;

/// The mark of a leaf entry that is an analytic surface.
pub const ANALYTIC: u32 = u32::MAX;
/// The mark of a leaf entry that is an instance, whose number stands in the place of the geometry's.
pub const INSTANCE: u32 = u32::MAX - 1;

/// Bytes that building takes for each primitive, the finished tree included, at its peak: boxes, places and entries here, two
/// generations of nodes, sorting keys and a binary tree in obvhs. Measured on a million triangles: 280.
pub const BYTES_PER_PRIMITIVE: u64 = 300;

/// A primitive where the leaves refer to it, so that a leaf reads memory in one place.
#[derive(Clone, Copy)]
pub struct Entry {
    /// A triangle's corners; unused for others.
    pub corners: [[f32; 3]; 3],
    pub geometry: u32,
    /// The triangle's number, or [`ANALYTIC`] or [`INSTANCE`].
    pub primitive: u32,
}

/// A tree over what stands in the world, or over a group.
pub struct Tree {
    pub nodes: CwBvh,
    pub entries: Vec<Entry>,
}

impl Tree {
    /// Builds the tree over the geometries with the numbers `members`, and over the instances' boxes.
    pub fn new(geometry: &[Geometry], members: &[u32], instances: &[Bounds]) -> Self {
        let (boxes, places) = collect(geometry, members, instances);
        let nodes = match boxes.is_empty() {
            true => CwBvh::default(),
            false => build_cwbvh(&boxes, BvhBuildParams::medium_build(), &mut Duration::default()),
        };
        drop(boxes);
        let entries = nodes.primitive_indices.iter().map(|&i| entry(geometry, places[i as usize])).collect();
        Tree { nodes: CwBvh { primitive_indices: Vec::new(), ..nodes }, entries }
    }

    /// Bytes of nodes and entries.
    pub fn bytes(&self) -> usize {
        size_of_val(&self.nodes.nodes[..]) + size_of_val(&self.entries[..])
    }
}

/// The analytic surfaces by geometry; empty if there is none.
pub fn surfaces(geometry: &[Geometry]) -> Vec<Option<Primitive>> {
    let surface = |g: &Geometry| match g {
        Geometry::Analytic(surface) => Some(*surface),
        Geometry::Triangles { .. } => None,
    };
    let surfaces: Vec<_> = geometry.iter().map(surface).collect();
    if surfaces.iter().any(Option::is_some) { surfaces } else { Vec::new() }
}

/// The boxes of all that is valid, and where each comes from: geometry and triangle, or number and mark.
fn collect(geometry: &[Geometry], members: &[u32], instances: &[Bounds]) -> (Vec<Aabb>, Vec<(u32, u32)>) {
    let count = members.iter().map(|&g| geometry[g as usize].len()).sum::<usize>() + instances.len();
    let mut boxes = Vec::with_capacity(count);
    let mut places = Vec::with_capacity(count);
    let mut repetitions = Repetitions::new();
    let mut add = |b: Bounds, place| {
        // A triangle that is the origin alone cannot be hit.
        if b.min != Vec3::ZERO || b.max != Vec3::ZERO {
            let b = repetitions.distinguish(b);
            boxes.push(Aabb::new(b.min.into(), b.max.into()));
            places.push(place);
        }
    };
    for &g in members {
        match &geometry[g as usize] {
            Geometry::Triangles { positions, indices } => {
                for (i, &triangle) in (0..).zip(indices.iter()) {
                    if let Some(corners) = valid_triangle(positions, triangle) {
                        add(Bounds::of(corners), (g, i));
                    }
                }
            }
            Geometry::Analytic(surface) if surface.is_valid() => add(surface.bounds(), (g, ANALYTIC)),
            Geometry::Analytic(_) => {}
        }
    }
    for (i, &b) in (0..).zip(instances).filter(|(_, b)| !b.is_empty()) {
        add(b, (i, INSTANCE));
    }
    (boxes, places)
}

/// Finds boxes that come again and again, and makes them differ.
///
/// The builder merges nearest neighbours. Many equal boxes have no nearest ones: they would be merged one pair at a
/// time, in quadratic time. A box that was seen often is therefore grown by a pseudo-random share of its rounding error.
struct Repetitions {
    /// By hash: a box and how often it was seen since another one took its place.
    seen: Vec<(Bounds, u32)>,
}

impl Repetitions {
    const SLOTS: usize = 1024;
    /// As many equal boxes are left as they are; two triangles of an axis-aligned rectangle are common.
    const TOLERATED: u32 = 8;

    fn new() -> Self {
        Repetitions { seen: vec![(Bounds::EMPTY, 0); Self::SLOTS] }
    }

    fn distinguish(&mut self, b: Bounds) -> Bounds {
        let corners = [b.min, b.max].map(|p| p.to_array());
        let bits = corners.as_flattened().iter().fold(0, |h, x| scramble(h ^ x.to_bits()));
        let slot = &mut self.seen[bits as usize % Self::SLOTS];
        let count = if slot.0 == b { slot.1 + 1 } else { 0 };
        *slot = (b, count);
        if count < Self::TOLERATED {
            return b;
        }
        let share = (scramble(count) >> 8) as f32 / (1 << 24) as f32;
        let grow = Vec3::splat(b.min.abs().max(b.max.abs()).max_element() * (8.0 * f32::EPSILON) * share);
        Bounds { min: b.min - grow, max: b.max + grow }
    }
}

/// A hash of 32 bits. [Wellons 2018, "lowbias32"]
fn scramble(mut x: u32) -> u32 {
    x = (x ^ (x >> 16)).wrapping_mul(0x7feb_352d);
    x = (x ^ (x >> 15)).wrapping_mul(0x846c_a68b);
    x ^ (x >> 16)
}

fn entry(geometry: &[Geometry], (number, primitive): (u32, u32)) -> Entry {
    let corners = match geometry.get(number as usize) {
        Some(Geometry::Triangles { positions, indices }) if primitive != INSTANCE => {
            indices[primitive as usize].map(|index| Vec3::to_array(&positions[index as usize]))
        }
        _ => [[0.0; 3]; 3],
    };
    Entry { corners, geometry: number, primitive }
}
