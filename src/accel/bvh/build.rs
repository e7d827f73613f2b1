//! One tree: its primitives collected, built by obvhs, and laid out by leaf.

use super::super::geometry::valid_triangle;
use super::super::{Geometry, Primitive};
use super::crowd;
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
    /// What crowds in few places, which is none of the others.
    pub crowd: Option<Box<Tree>>,
}

impl Tree {
    /// Builds the tree over the geometries with the numbers `members`, and over the instances' boxes.
    pub fn new(geometry: &[Geometry], members: &[u32], instances: &[Bounds]) -> Self {
        let (mut boxes, mut places) = collect(geometry, members, instances);
        let crowd = crowd::find(&boxes);
        let entries = |nodes: &CwBvh, places: &[(u32, u32)]| {
            nodes.primitive_indices.iter().map(|&i| entry(geometry, places[i as usize])).collect()
        };
        let crowd = (!crowd.is_empty()).then(|| {
            let mut others = vec![true; boxes.len()];
            crowd.iter().for_each(|&i| others[i as usize] = false);
            let tree = Tree::of(crowd::tree(&boxes, crowd), |nodes| entries(nodes, &places));
            let (mut of_boxes, mut of_places) = (others.iter(), others.iter());
            boxes.retain(|_| of_boxes.next() == Some(&true));
            places.retain(|_| of_places.next() == Some(&true));
            Box::new(tree)
        });
        let nodes = match boxes.is_empty() {
            true => CwBvh::default(),
            false => build_cwbvh(&boxes, BvhBuildParams::medium_build(), &mut Duration::default()),
        };
        drop(boxes);
        Tree { crowd, ..Tree::of(nodes, |nodes| entries(nodes, &places)) }
    }

    fn of(nodes: CwBvh, entries: impl FnOnce(&CwBvh) -> Vec<Entry>) -> Self {
        let entries = entries(&nodes);
        Tree { nodes: CwBvh { primitive_indices: Vec::new(), ..nodes }, entries, crowd: None }
    }

    /// Bytes of nodes and entries.
    pub fn bytes(&self) -> usize {
        let crowd = self.crowd.as_ref().map_or(0, |crowd| crowd.bytes());
        size_of_val(&self.nodes.nodes[..]) + size_of_val(&self.entries[..]) + crowd
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
    let mut add = |b: Bounds, place| {
        boxes.push(Aabb::new(b.min.into(), b.max.into()));
        places.push(place);
    };
    for &g in members {
        match &geometry[g as usize] {
            Geometry::Triangles { positions, indices } => {
                for (i, &triangle) in (0..).zip(indices.iter()) {
                    // One with equal corners cannot be hit: of its edge functions one is zero, the others cancel out.
                    let hittable = |c: &[Vec3; 3]| c[0] != c[1] && c[1] != c[2] && c[2] != c[0];
                    if let Some(corners) = valid_triangle(positions, triangle).filter(hittable) {
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

fn entry(geometry: &[Geometry], (number, primitive): (u32, u32)) -> Entry {
    let corners = match geometry.get(number as usize) {
        Some(Geometry::Triangles { positions, indices }) if primitive != INSTANCE => {
            indices[primitive as usize].map(|index| Vec3::to_array(&positions[index as usize]))
        }
        _ => [[0.0; 3]; 3],
    };
    Entry { corners, geometry: number, primitive }
}
