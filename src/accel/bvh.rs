//! The pure-Rust back end: obvhs builds an eight-wide compressed BVH, and Buffon traverses its nodes.
//!
//! obvhs' own traversal is not used for rendering: it clamps 1/d, starts at a fixed distance, does not round its
//! slabs outwards and returns no barycentric coordinates. Here every box test is conservative and every triangle
//! test watertight, so the nearest hit is that over all triangles, whatever the shape of the tree; of hits at
//! equal distance the one with the least (geometry, primitive) counts.

use super::geometry::valid_triangle;
use super::triangle::ShearedRay;
use super::{Accel, Geometry, Hit, NO_INSTANCE, Primitive, is_valid_ray};
use crate::error::{Error, Result};
use crate::math::{Bounds, Ray, Vec3};
use node::BoxTest;
use obvhs::BvhBuildParams;
use obvhs::aabb::Aabb;
use obvhs::cwbvh::{CwBvh, builder::build_cwbvh};
use std::time::Duration;

mod node;

/// The mark of a leaf entry that is an analytic surface.
const ANALYTIC: u32 = u32::MAX;

/// A primitive where the leaves refer to it, so that a leaf reads memory in one place.
#[derive(Clone, Copy)]
struct Entry {
    /// A triangle's corners; unused for an analytic surface.
    corners: [[f32; 3]; 3],
    geometry: u32,
    /// The triangle's number, or [`ANALYTIC`].
    primitive: u32,
}

/// The BVH over a list of geometries.
pub struct Bvh {
    tree: CwBvh,
    entries: Vec<Entry>,
    /// By geometry; empty if there is no analytic surface.
    surfaces: Vec<Option<Primitive>>,
    bounds: Bounds,
}

impl Bvh {
    /// Builds the BVH with `threads` threads (0 for all cores). The geometry must be checked.
    ///
    /// # Errors
    /// If there are 2^32 primitives or more, or no threads can be started.
    pub(super) fn new(geometry: Vec<Geometry>, bounds: Bounds, threads: usize) -> Result<Self> {
        let count: usize = geometry.iter().map(Geometry::len).sum();
        if u32::try_from(count).is_err() {
            return Err(Error::scene(format!("{count} primitives are more than the BVH can number")));
        }
        let (boxes, places) = collect(&geometry, count);
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .map_err(|e| Error::internal(format!("starting the threads that build the BVH: {e}")))?;
        let tree = match boxes.is_empty() {
            true => CwBvh::default(),
            false => {
                pool.install(|| build_cwbvh(&boxes, BvhBuildParams::medium_build(), &mut Duration::default()))
            }
        };
        drop(boxes);
        let entries = tree.primitive_indices.iter().map(|&i| entry(&geometry, places[i as usize])).collect();
        let surface = |g: &Geometry| match g {
            Geometry::Analytic(surface) => Some(*surface),
            Geometry::Triangles { .. } => None,
        };
        let surfaces: Vec<_> = geometry.iter().map(surface).collect();
        let surfaces = if surfaces.iter().any(Option::is_some) { surfaces } else { Vec::new() };
        let tree = CwBvh { primitive_indices: Vec::new(), ..tree };
        Ok(Bvh { tree, entries, surfaces, bounds })
    }

    /// Visits the leaves along the ray. With `ANY` it stops at the first hit, whichever that is.
    fn traverse<const ANY: bool>(&self, ray: &Ray) -> Option<Hit> {
        if !is_valid_ray(ray) || self.tree.nodes.is_empty() {
            return None;
        }
        let sheared = ShearedRay::new(ray);
        let test = BoxTest::new(ray);
        let mut nearest = Nearest { t: ray.t_max, hit: None };
        let mut stack = Stack::default();
        // A group of nodes: the index of its first, and (high byte) which are to be visited, (low byte) which
        // children are inner nodes. The root is a group of one.
        let mut group = (0u32, 0x8000_0000u32);
        loop {
            while group.1 & 0xff00_0000 == 0 {
                group = match stack.pop() {
                    Some(group) => group,
                    None => return nearest.hit,
                };
            }
            let bit = 31 - group.1.leading_zeros();
            group.1 &= !(1 << bit);
            let slot = (bit - 24) ^ (test.octant() & 0xff);
            let before = (group.1 & !(u32::MAX << slot) & 0xff).count_ones();
            let node = &self.tree.nodes[(group.0 + before) as usize];
            if group.1 & 0xff00_0000 != 0 {
                stack.push(group);
            }
            let hits = test.children(node, nearest.t);
            group = (node.child_base_idx, (hits & 0xff00_0000) | u32::from(node.imask));
            let mut leaves = hits & 0x00ff_ffff;
            while leaves != 0 {
                let entry = &self.entries[(node.primitive_base_idx + leaves.trailing_zeros()) as usize];
                leaves &= leaves - 1;
                self.intersect_entry(entry, ray, &sheared, &mut nearest);
                if ANY && nearest.hit.is_some() {
                    return nearest.hit;
                }
            }
        }
    }

    #[inline]
    fn intersect_entry(&self, entry: &Entry, ray: &Ray, sheared: &ShearedRay, nearest: &mut Nearest) {
        let found = if entry.primitive == ANALYTIC {
            self.surfaces[entry.geometry as usize].and_then(|surface| {
                // The bound is exclusive, and a hit at the nearest distance so far must be seen.
                let ray = Ray { t_max: nearest.t.next_up(), ..*ray };
                surface.intersect(&ray).map(|h| (h.t, h.u, h.v))
            })
        } else {
            sheared.intersect(&entry.corners, nearest.t)
        };
        if let Some((t, u, v)) = found {
            let primitive = if entry.primitive == ANALYTIC { 0 } else { entry.primitive };
            nearest.offer(
                Hit { t, u, v, geometry: entry.geometry, primitive, instance: NO_INSTANCE },
                ray.t_max,
            );
        }
    }
}

impl Accel for Bvh {
    fn name(&self) -> &'static str {
        "obvhs"
    }

    fn bounds(&self) -> Bounds {
        self.bounds
    }

    fn memory_bytes(&self) -> usize {
        size_of_val(&self.tree.nodes[..]) + size_of_val(&self.entries[..]) + size_of_val(&self.surfaces[..])
    }

    fn intersect(&self, ray: &Ray) -> Option<Hit> {
        self.traverse::<false>(ray)
    }

    fn occluded(&self, ray: &Ray) -> bool {
        self.traverse::<true>(ray).is_some()
    }
}

/// The nearest hit so far.
struct Nearest {
    /// Its parameter, or the ray's bound.
    t: f32,
    hit: Option<Hit>,
}

impl Nearest {
    /// Takes a hit with `0 < t ≤ self.t` if it is below the ray's bound and nearer, or equally near and first in order.
    #[inline]
    fn offer(&mut self, hit: Hit, t_max: f32) {
        let first = |old: &Hit| (hit.geometry, hit.primitive) < (old.geometry, old.primitive);
        let nearer = match &self.hit {
            None => hit.t < t_max,
            Some(old) => hit.t < old.t || first(old),
        };
        if nearer {
            self.t = hit.t;
            self.hit = Some(hit);
        }
    }
}

/// Groups of nodes that are still to be visited: one for each level of the tree.
struct Stack {
    groups: [(u32, u32); Stack::DEPTH],
    len: usize,
    /// Only for trees that are deeper than any real scene's.
    more: Vec<(u32, u32)>,
}

impl Default for Stack {
    #[inline]
    fn default() -> Self {
        Stack { groups: [(0, 0); Stack::DEPTH], len: 0, more: Vec::new() }
    }
}

impl Stack {
    const DEPTH: usize = 32;

    #[inline]
    fn push(&mut self, group: (u32, u32)) {
        match self.groups.get_mut(self.len) {
            Some(top) => {
                *top = group;
                self.len += 1;
            }
            None => self.more.push(group),
        }
    }

    #[inline]
    fn pop(&mut self) -> Option<(u32, u32)> {
        if let Some(group) = self.more.pop() {
            return Some(group);
        }
        self.len = self.len.checked_sub(1)?;
        Some(self.groups[self.len])
    }
}

/// The boxes of all valid primitives, and where each comes from: (geometry, triangle or [`ANALYTIC`]).
fn collect(geometry: &[Geometry], count: usize) -> (Vec<Aabb>, Vec<(u32, u32)>) {
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
    for (g, entry) in (0..).zip(geometry) {
        match entry {
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

fn entry(geometry: &[Geometry], (g, i): (u32, u32)) -> Entry {
    let corners = match &geometry[g as usize] {
        Geometry::Triangles { positions, indices } => {
            indices[i as usize].map(|index| Vec3::to_array(&positions[index as usize]))
        }
        Geometry::Analytic(_) => [[0.0; 3]; 3],
    };
    Entry { corners, geometry: g, primitive: i }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_stack_deeper_than_its_array_spills_and_returns_in_order() {
        let mut stack = Stack::default();
        for i in 0..100 {
            stack.push((i, 0));
        }
        let popped: Vec<u32> = std::iter::from_fn(|| stack.pop()).map(|g| g.0).collect();
        assert_eq!(popped, (0..100).rev().collect::<Vec<_>>());
    }
}
