//! The pure-Rust back end: obvhs builds eight-wide compressed BVHs, and Buffon traverses their nodes.
//!
//! obvhs' own traversal is not used for rendering: it clamps 1/d, starts at a fixed distance, does not round its
//! slabs outwards and returns no barycentric coordinates. Here every box test is conservative and every triangle test
//! is watertight. The nearest hit is therefore the nearest over all triangles for any shape of the tree. Among hits
//! at equal distance, the one with the smallest (geometry, primitive, instance) is reported.
//!
//! One tree holds the geometries in world space and the instances. Each group has its own tree, which the traversal
//! enters with the ray in the space of the group.

use super::assembly::{Assembly, CheckedAssembly, FilterQuery, GeometryFilter};
use super::instance::{Instance, local_ray};
use super::triangle::ShearedRay;
use super::{Accel, COORDINATE_LIMIT, Geometry, Hit, NO_INSTANCE, is_valid_ray};
use crate::error::{Error, Result, counted};
use crate::math::{Bounds, DAffine3, Ray};
use crate::memory::Budget;
use build::{ANALYTIC, BvhTree, INSTANCE, LeafPrimitive, PlacedSurface};
use node::BoxTest;

mod build;
mod lbvh;
mod node;

/// The BVH of an assembly.
pub struct Bvh {
    world: BvhTree,
    groups: Vec<BvhTree>,
    instances: Vec<TraversalInstance>,
    /// All analytic surfaces.
    surfaces: Vec<PlacedSurface>,
    filter: Option<GeometryFilter>,
    bounds: Bounds,
    ray_limit: f32,
}

/// The data of an instance that traversal needs.
struct TraversalInstance {
    group: u32,
    /// The transform from world space to group space; for a moving instance, at time 0.
    inverse: DAffine3,
    moving: Option<Instance>,
}

/// The values that are constant during the query of one tree.
#[derive(Clone, Copy)]
struct TreeQuery<'a> {
    filter: FilterQuery<'a>,
    instance: u32,
}

impl Bvh {
    /// Builds the BVH with `threads` threads (0: all cores). The assembly must have been checked.
    ///
    /// # Errors
    /// If there are 2^32 primitives or more, threads cannot be started, or the memory budget is exceeded.
    pub(super) fn new(
        assembly: Assembly,
        checked: &CheckedAssembly,
        threads: usize,
        memory: &Budget,
    ) -> Result<Self> {
        let Assembly { geometry, groups, instances, filter } = assembly;
        let count = geometry.iter().map(Geometry::len).sum::<usize>() + instances.len();
        if u32::try_from(count).is_err() {
            return Err(Error::scene(format!("expected fewer than 2^32 primitives, found {count}")));
        }
        let building = memory.reserve(count as u64 * build::BYTES_PER_PRIMITIVE).map_err(|refusal| {
            let what = format!("building the BVH of {}", counted(count as u64, "primitive", "primitives"));
            Error::scene(refusal.sentence(&what, "use fewer of them"))
        })?;
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .map_err(|e| Error::internal(format!("starting the threads that build the BVH: {e}")))?;
        let surfaces = build::surfaces(&geometry);
        let (world, groups) = pool.install(|| {
            let tree = |members: &[u32], instances| BvhTree::new(&geometry, &surfaces, members, instances);
            let groups: Vec<BvhTree> = groups.iter().map(|members| tree(members, &[])).collect();
            (tree(&checked.world, &checked.instances), groups)
        });
        building.keep((world.bytes() + groups.iter().map(BvhTree::bytes).sum::<usize>()) as u64);
        let place = |instance: Instance| TraversalInstance {
            group: instance.group,
            inverse: instance.world_inverse(0.0),
            moving: instance.is_moving().then_some(instance),
        };
        Ok(Bvh {
            world,
            groups,
            instances: instances.into_iter().map(place).collect(),
            surfaces,
            filter,
            bounds: checked.bounds,
            ray_limit: checked.ray_limit,
        })
    }

    /// Returns the nearest hit or, with `ANY`, the first hit found.
    #[inline]
    fn query<const ANY: bool>(&self, ray: &Ray) -> Option<Hit> {
        if !is_valid_ray(ray, self.ray_limit) {
            return None;
        }
        let query = TreeQuery { filter: FilterQuery::new(self.filter.as_ref(), ray), instance: NO_INSTANCE };
        self.traverse::<ANY>(&self.world, ray, query, BvhHit { t: ray.t_max, hit: None }).hit
    }

    /// Visits the leaves along a ray that is valid in the space of the tree.
    #[inline]
    fn traverse<const ANY: bool>(
        &self,
        tree: &BvhTree,
        ray: &Ray,
        query: TreeQuery<'_>,
        nearest: BvhHit,
    ) -> BvhHit {
        let nearest = self.visit::<ANY>(tree, ray, query, nearest);
        match &tree.overlapping {
            Some(overlapping) if !(ANY && nearest.hit.is_some()) => {
                self.visit::<ANY>(overlapping, ray, query, nearest)
            }
            _ => nearest,
        }
    }

    fn visit<const ANY: bool>(
        &self,
        tree: &BvhTree,
        ray: &Ray,
        query: TreeQuery<'_>,
        mut nearest: BvhHit,
    ) -> BvhHit {
        if tree.nodes.nodes.is_empty() {
            return nearest;
        }
        let sheared = ShearedRay::new(ray);
        let test = BoxTest::new(ray);
        let mut stack = Stack::default();
        // A group of sibling nodes: the index of its first node, a mask of the nodes still to be visited (high byte),
        // and a mask of the children that are inner nodes (low byte). The root is a group of one.
        let mut group = (0u32, 0x8000_0000u32);
        loop {
            while group.1 & 0xff00_0000 == 0 {
                group = match stack.pop() {
                    Some(group) => group,
                    None => return nearest,
                };
            }
            let bit = 31 - group.1.leading_zeros();
            group.1 &= !(1 << bit);
            let slot = (bit - 24) ^ (test.octant() & 0xff);
            let before = (group.1 & !(u32::MAX << slot) & 0xff).count_ones();
            let node = &tree.nodes.nodes[(group.0 + before) as usize];
            if group.1 & 0xff00_0000 != 0 {
                stack.push(group);
            }
            let hits = test.children(node, nearest.t);
            group = (node.child_base_idx, (hits & 0xff00_0000) | u32::from(node.imask));
            let mut leaves = hits & 0x00ff_ffff;
            while leaves != 0 {
                let entry = &tree.entries[(node.primitive_base_idx + leaves.trailing_zeros()) as usize];
                leaves &= leaves - 1;
                self.intersect_entry::<ANY>(entry, ray, &sheared, &query, &mut nearest);
                if ANY && nearest.hit.is_some() {
                    return nearest;
                }
            }
        }
    }

    #[inline]
    fn intersect_entry<const ANY: bool>(
        &self,
        entry: &LeafPrimitive,
        ray: &Ray,
        sheared: &ShearedRay,
        query: &TreeQuery<'_>,
        nearest: &mut BvhHit,
    ) {
        if entry.primitive >= INSTANCE {
            return match entry.primitive {
                ANALYTIC => self.intersect_surface(entry.geometry, ray, query, nearest),
                _ => self.traverse_instance::<ANY>(entry.geometry, ray, query, nearest),
            };
        }
        if let Some((t, u, v)) = sheared.intersect(&entry.corners, nearest.t) {
            let LeafPrimitive { geometry, primitive, .. } = *entry;
            let hit = Hit { t, u, v, geometry, primitive, instance: query.instance };
            nearest.replace_if_nearer(hit, ray.t_max, |hit| query.filter.accepts(ray, hit));
        }
    }

    #[inline]
    fn intersect_surface(&self, index: u32, ray: &Ray, query: &TreeQuery<'_>, nearest: &mut BvhHit) {
        let PlacedSurface { geometry, primitive, surface } = self.surfaces[index as usize];
        let instance = query.instance;
        let place = |h: &super::PrimitiveHit| Hit { t: h.t, u: h.u, v: h.v, geometry, primitive, instance };
        // The bound is exclusive. The next float keeps hits at exactly the nearest distance, which may win by order.
        let within = Ray { t_max: nearest.t.next_up(), ..*ray };
        let found = surface.intersect_where(&within, |h| query.filter.accepts(ray, &place(h)));
        if let Some(found) = found {
            nearest.replace_if_nearer(place(&found), ray.t_max, |_| true);
        }
    }

    /// Continues the traversal in the tree of an instance's group.
    #[inline(never)]
    fn traverse_instance<const ANY: bool>(
        &self,
        instance: u32,
        ray: &Ray,
        query: &TreeQuery<'_>,
        nearest: &mut BvhHit,
    ) {
        let placed = &self.instances[instance as usize];
        let local = match &placed.moving {
            None => local_ray(&placed.inverse, ray),
            Some(moving) => local_ray(&moving.world_inverse(ray.time), ray),
        };
        // A direction close to zero may become zero in group space.
        if is_valid_ray(&local, COORDINATE_LIMIT) {
            let tree = &self.groups[placed.group as usize];
            *nearest = self.traverse::<ANY>(tree, &local, TreeQuery { instance, ..*query }, *nearest);
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
        let trees = self.world.bytes() + self.groups.iter().map(BvhTree::bytes).sum::<usize>();
        trees + size_of_val(&self.instances[..]) + size_of_val(&self.surfaces[..])
    }

    fn intersect(&self, ray: &Ray) -> Option<Hit> {
        self.query::<false>(ray)
    }

    fn occluded(&self, ray: &Ray) -> bool {
        self.query::<true>(ray).is_some()
    }
}

/// The nearest hit so far.
#[derive(Clone, Copy)]
struct BvhHit {
    /// The ray parameter of the hit, or the ray's `t_max` if there is none.
    t: f32,
    hit: Option<Hit>,
}

impl BvhHit {
    /// Replaces the nearest hit by one with `0 < t ≤ self.t`, if that is below `t_max`, is nearer (or equally near
    /// and first in order), and is accepted.
    #[inline]
    fn replace_if_nearer(&mut self, hit: Hit, t_max: f32, accept: impl FnOnce(&Hit) -> bool) {
        let order = |hit: &Hit| (hit.geometry, hit.primitive, hit.instance);
        let nearer = match &self.hit {
            None => hit.t < t_max,
            Some(old) => hit.t < old.t || order(&hit) < order(old),
        };
        if nearer && accept(&hit) {
            self.t = hit.t;
            self.hit = Some(hit);
        }
    }
}

/// The traversal stack: groups of nodes still to be visited, at most one for each level of the tree.
struct Stack {
    groups: [(u32, u32); Stack::DEPTH],
    len: usize,
    /// Overflow for trees deeper than [`Stack::DEPTH`].
    overflow: Vec<(u32, u32)>,
}

impl Default for Stack {
    #[inline]
    fn default() -> Self {
        Stack { groups: [(0, 0); Stack::DEPTH], len: 0, overflow: Vec::new() }
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
            None => self.overflow.push(group),
        }
    }

    #[inline]
    fn pop(&mut self) -> Option<(u32, u32)> {
        if let Some(group) = self.overflow.pop() {
            return Some(group);
        }
        self.len = self.len.checked_sub(1)?;
        Some(self.groups[self.len])
    }
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
