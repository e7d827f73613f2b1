//! The construction of one tree: collects the primitives, builds with obvhs, and lays the primitives out by leaf.

use super::super::geometry::valid_triangle;
use super::super::{Geometry, Primitive};
use super::lbvh;
use crate::math::{Bounds, Vec3};
use obvhs::BvhBuildParams;
use obvhs::aabb::Aabb;
use obvhs::cwbvh::{CwBvh, builder::build_cwbvh};
use std::time::Duration;

/// The value of [`LeafPrimitive::primitive`] for an analytic surface; [`LeafPrimitive::geometry`] is then its index in
/// the [`Surfaces`].
pub const ANALYTIC: u32 = u32::MAX;
/// The value of [`LeafPrimitive::primitive`] for an instance; [`LeafPrimitive::geometry`] is then the index of the
/// instance.
pub const INSTANCE: u32 = u32::MAX - 1;

/// The peak memory of construction in bytes per primitive, the finished tree included: boxes, origins and leaf
/// entries here; two generations of nodes, sort keys and a binary tree in obvhs. Measured for 10⁶ triangles: 280.
pub const BYTES_PER_PRIMITIVE: u64 = 300;

/// A primitive copied into leaf order, so that a leaf reads contiguous memory.
#[derive(Clone, Copy)]
pub struct LeafPrimitive {
    /// The corners of a triangle; unused for other primitives.
    pub corners: [[f32; 3]; 3],
    pub geometry: u32,
    /// The index of the triangle, or [`ANALYTIC`] or [`INSTANCE`].
    pub primitive: u32,
}

/// A tree over the geometries in world space and the instances, or over a group.
pub struct BvhTree {
    pub nodes: CwBvh,
    pub entries: Vec<LeafPrimitive>,
    /// A second tree over the boxes of [`lbvh::find_overlapping`](super::lbvh::find_overlapping). Those are not in
    /// `nodes`.
    pub overlapping: Option<Box<BvhTree>>,
}

impl BvhTree {
    /// Builds the tree over the geometries with the indices `members` and over the instances' boxes.
    pub fn new(
        geometry: &[Geometry],
        surfaces: &[PlacedSurface],
        members: &[u32],
        instances: &[Bounds],
    ) -> Self {
        let (mut boxes, mut origins) = collect(geometry, surfaces, members, instances);
        let overlapping = lbvh::find_overlapping(&boxes);
        let entries = |nodes: &CwBvh, origins: &[(u32, u32)]| {
            nodes.primitive_indices.iter().map(|&i| entry(geometry, origins[i as usize])).collect()
        };
        let overlapping = (!overlapping.is_empty()).then(|| {
            let mut others = vec![true; boxes.len()];
            overlapping.iter().for_each(|&i| others[i as usize] = false);
            let tree = BvhTree::of(lbvh::tree(&boxes, overlapping), |nodes| entries(nodes, &origins));
            let (mut of_boxes, mut of_places) = (others.iter(), others.iter());
            boxes.retain(|_| of_boxes.next() == Some(&true));
            origins.retain(|_| of_places.next() == Some(&true));
            Box::new(tree)
        });
        let nodes = match boxes.is_empty() {
            true => CwBvh::default(),
            false => build_cwbvh(&boxes, BvhBuildParams::medium_build(), &mut Duration::default()),
        };
        drop(boxes);
        BvhTree { overlapping, ..BvhTree::of(nodes, |nodes| entries(nodes, &origins)) }
    }

    fn of(nodes: CwBvh, entries: impl FnOnce(&CwBvh) -> Vec<LeafPrimitive>) -> Self {
        let entries = entries(&nodes);
        BvhTree { nodes: CwBvh { primitive_indices: Vec::new(), ..nodes }, entries, overlapping: None }
    }

    /// Returns the bytes of nodes and entries.
    pub fn bytes(&self) -> usize {
        let overlapping = self.overlapping.as_ref().map_or(0, |overlapping| overlapping.bytes());
        size_of_val(&self.nodes.nodes[..]) + size_of_val(&self.entries[..]) + overlapping
    }
}

/// A valid analytic surface, with its geometry and its index in the geometry.
#[derive(Clone, Copy)]
pub struct PlacedSurface {
    pub geometry: u32,
    pub primitive: u32,
    pub surface: Primitive,
}

/// Returns all valid analytic surfaces, in the order of the geometries.
pub fn surfaces(geometry: &[Geometry]) -> Vec<PlacedSurface> {
    let mut surfaces = Vec::new();
    for (number, of_list) in (0..).zip(geometry) {
        let place = |(primitive, surface)| PlacedSurface { geometry: number, primitive, surface };
        match of_list {
            Geometry::Triangles { .. } => {}
            Geometry::Analytic(surface) => {
                surfaces.extend(Some((0, *surface)).filter(|(_, s)| s.is_valid()).map(place));
            }
            Geometry::Surfaces(many) => surfaces.extend(many.valid().map(place)),
        }
    }
    surfaces
}

/// Returns the boxes of all valid primitives, and for each its (geometry, triangle), or its index and mark.
fn collect(
    geometry: &[Geometry],
    surfaces: &[PlacedSurface],
    members: &[u32],
    instances: &[Bounds],
) -> (Vec<Aabb>, Vec<(u32, u32)>) {
    let count = members.iter().map(|&g| geometry[g as usize].len()).sum::<usize>() + instances.len();
    let mut boxes = Vec::with_capacity(count);
    let mut origins = Vec::with_capacity(count);
    let mut add = |b: Bounds, place| {
        boxes.push(Aabb::new(b.min.into(), b.max.into()));
        origins.push(place);
    };
    for &g in members {
        match &geometry[g as usize] {
            Geometry::Triangles { positions, indices } => {
                for (i, &triangle) in (0..).zip(indices.iter()) {
                    // A triangle with two equal corners cannot be hit: one edge function is zero and the other two
                    // cancel out.
                    let hittable = |c: &[Vec3; 3]| c[0] != c[1] && c[1] != c[2] && c[2] != c[0];
                    if let Some(corners) = valid_triangle(positions, triangle).filter(hittable) {
                        add(Bounds::of(corners), (g, i));
                    }
                }
            }
            Geometry::Analytic(_) | Geometry::Surfaces(_) => {
                let first = surfaces.partition_point(|s| s.geometry < g);
                for (i, placed) in
                    (first as u32..).zip(&surfaces[first..]).take_while(|(_, s)| s.geometry == g)
                {
                    add(placed.surface.bounds(), (i, ANALYTIC));
                }
            }
        }
    }
    for (i, &b) in (0..).zip(instances).filter(|(_, b)| !b.is_empty()) {
        add(b, (i, INSTANCE));
    }
    (boxes, origins)
}

fn entry(geometry: &[Geometry], (number, primitive): (u32, u32)) -> LeafPrimitive {
    let corners = match geometry.get(number as usize) {
        Some(Geometry::Triangles { positions, indices }) if primitive < INSTANCE => {
            indices[primitive as usize].map(|index| Vec3::to_array(&positions[index as usize]))
        }
        _ => [[0.0; 3]; 3],
    };
    LeafPrimitive { corners, geometry: number, primitive }
}
