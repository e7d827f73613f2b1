//! The pure-Rust back end: obvhs builds eight-wide compressed BVHs, and Buffon traverses their nodes.
//!
//! obvhs' own traversal is not used for rendering: it clamps 1/d, starts at a fixed distance, does not round its
//! slabs outwards and returns no barycentric coordinates. Here every box test is conservative and every triangle
//! test watertight, so the nearest hit is that over all triangles, whatever the shape of the tree; of hits at
//! equal distance the one with the least (geometry, primitive, instance) counts.
//!
//! One tree holds what stands in the world, instances among it; each group has its own, in which the ray goes on in
//! the group's coordinates.

use super::assembly::{Assembly, Checked, Filtered, Question};
use super::instance::{Instance, local_ray};
use super::triangle::ShearedRay;
use super::{Accel, COORDINATE_LIMIT, Geometry, Hit, NO_INSTANCE, Primitive, is_valid_ray};
use crate::error::{Error, Result, counted};
use crate::math::{Bounds, DAffine3, Ray};
use crate::memory::Budget;
use build::{ANALYTIC, Entry, INSTANCE, Tree};
use node::BoxTest;

mod build;
mod crowd;
mod node;

/// The BVH over an assembly.
pub struct Bvh {
    world: Tree,
    groups: Vec<Tree>,
    instances: Vec<Placed>,
    /// By geometry; empty if there is no analytic surface.
    surfaces: Vec<Option<Primitive>>,
    filter: Option<Filtered>,
    bounds: Bounds,
    ray_limit: f32,
}

/// An instance as the traversal needs it.
struct Placed {
    group: u32,
    /// From the world; that at time 0 for a moving instance.
    inverse: DAffine3,
    moving: Option<Instance>,
}

/// What stays the same during the query of one tree.
#[derive(Clone, Copy)]
struct Ask<'a> {
    filter: Question<'a>,
    instance: u32,
}

impl Bvh {
    /// Builds the BVH with `threads` threads (0 for all cores). The assembly must be checked.
    ///
    /// # Errors
    /// If there are 2^32 primitives or more, no threads can be started, or the budget has too little memory left.
    pub(super) fn new(
        assembly: Assembly,
        checked: &Checked,
        threads: usize,
        memory: &Budget,
    ) -> Result<Self> {
        let Assembly { geometry, groups, instances, filter } = assembly;
        let count = geometry.iter().map(Geometry::len).sum::<usize>() + instances.len();
        if u32::try_from(count).is_err() {
            return Err(Error::scene(format!("{count} primitives are more than the BVH can number")));
        }
        let building = memory.reserve(count as u64 * build::BYTES_PER_PRIMITIVE).map_err(|refusal| {
            let what = format!("building the BVH of {}", counted(count as u64, "primitive", "primitives"));
            Error::scene(refusal.sentence(&what, "use fewer triangles"))
        })?;
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .map_err(|e| Error::internal(format!("starting the threads that build the BVH: {e}")))?;
        let (world, groups) = pool.install(|| {
            let groups: Vec<Tree> = groups.iter().map(|members| Tree::new(&geometry, members, &[])).collect();
            (Tree::new(&geometry, &checked.world, &checked.instances), groups)
        });
        building.keep((world.bytes() + groups.iter().map(Tree::bytes).sum::<usize>()) as u64);
        let place = |instance: Instance| Placed {
            group: instance.group,
            inverse: instance.world_inverse(0.0),
            moving: instance.is_moving().then_some(instance),
        };
        Ok(Bvh {
            world,
            groups,
            instances: instances.into_iter().map(place).collect(),
            surfaces: build::surfaces(&geometry),
            filter,
            bounds: checked.bounds,
            ray_limit: checked.ray_limit,
        })
    }

    /// With `ANY` it stops at the first hit, whichever that is.
    #[inline]
    fn query<const ANY: bool>(&self, ray: &Ray) -> Option<Hit> {
        if !is_valid_ray(ray, self.ray_limit) {
            return None;
        }
        let ask = Ask { filter: Question::new(self.filter.as_ref(), ray), instance: NO_INSTANCE };
        self.traverse::<ANY>(&self.world, ray, ask, Nearest { t: ray.t_max, hit: None }).hit
    }

    /// Visits the leaves of a tree along the ray, which is valid in the tree's coordinates.
    #[inline]
    fn traverse<const ANY: bool>(&self, tree: &Tree, ray: &Ray, ask: Ask<'_>, nearest: Nearest) -> Nearest {
        let nearest = self.visit::<ANY>(tree, ray, ask, nearest);
        match &tree.crowd {
            Some(crowd) if !(ANY && nearest.hit.is_some()) => self.visit::<ANY>(crowd, ray, ask, nearest),
            _ => nearest,
        }
    }

    fn visit<const ANY: bool>(&self, tree: &Tree, ray: &Ray, ask: Ask<'_>, mut nearest: Nearest) -> Nearest {
        if tree.nodes.nodes.is_empty() {
            return nearest;
        }
        let sheared = ShearedRay::new(ray);
        let test = BoxTest::new(ray);
        let mut stack = Stack::default();
        // A group of nodes: the index of its first, and (high byte) which are to be visited, (low byte) which
        // children are inner nodes. The root is a group of one.
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
                self.intersect_entry::<ANY>(entry, ray, &sheared, &ask, &mut nearest);
                if ANY && nearest.hit.is_some() {
                    return nearest;
                }
            }
        }
    }

    #[inline]
    fn intersect_entry<const ANY: bool>(
        &self,
        entry: &Entry,
        ray: &Ray,
        sheared: &ShearedRay,
        ask: &Ask<'_>,
        nearest: &mut Nearest,
    ) {
        if entry.primitive >= INSTANCE {
            return match entry.primitive {
                ANALYTIC => self.intersect_surface(entry.geometry, ray, ask, nearest),
                _ => self.enter::<ANY>(entry.geometry, ray, ask, nearest),
            };
        }
        if let Some((t, u, v)) = sheared.intersect(&entry.corners, nearest.t) {
            let Entry { geometry, primitive, .. } = *entry;
            let hit = Hit { t, u, v, geometry, primitive, instance: ask.instance };
            nearest.offer(hit, ray.t_max, |hit| ask.filter.accepts(ray, hit));
        }
    }

    #[inline]
    fn intersect_surface(&self, geometry: u32, ray: &Ray, ask: &Ask<'_>, nearest: &mut Nearest) {
        let Some(surface) = self.surfaces[geometry as usize] else { return };
        let place = |h: &super::PrimitiveHit| Hit {
            t: h.t,
            u: h.u,
            v: h.v,
            geometry,
            primitive: 0,
            instance: ask.instance,
        };
        // The bound is exclusive, and a hit at the nearest distance so far must be seen.
        let within = Ray { t_max: nearest.t.next_up(), ..*ray };
        let found = surface.intersect_where(&within, |h| ask.filter.accepts(ray, &place(h)));
        if let Some(found) = found {
            nearest.offer(place(&found), ray.t_max, |_| true);
        }
    }

    /// Goes on in the tree of an instance's group.
    #[inline(never)]
    fn enter<const ANY: bool>(&self, instance: u32, ray: &Ray, ask: &Ask<'_>, nearest: &mut Nearest) {
        let placed = &self.instances[instance as usize];
        let local = match &placed.moving {
            None => local_ray(&placed.inverse, ray),
            Some(moving) => local_ray(&moving.world_inverse(ray.time), ray),
        };
        // A direction that is next to nothing may vanish in the group's coordinates.
        if is_valid_ray(&local, COORDINATE_LIMIT) {
            let tree = &self.groups[placed.group as usize];
            *nearest = self.traverse::<ANY>(tree, &local, Ask { instance, ..*ask }, *nearest);
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
        let trees = self.world.bytes() + self.groups.iter().map(Tree::bytes).sum::<usize>();
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
struct Nearest {
    /// Its parameter, or the ray's bound.
    t: f32,
    hit: Option<Hit>,
}

impl Nearest {
    /// Takes a hit with `0 < t ≤ self.t` if it is below the ray's bound and nearer, or equally near and first in order,
    /// and accepted.
    #[inline]
    fn offer(&mut self, hit: Hit, t_max: f32, accept: impl FnOnce(&Hit) -> bool) {
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
