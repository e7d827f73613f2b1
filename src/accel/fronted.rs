//! A list of the largest simple surfaces in front of a tree of all other primitives.
//!
//! The boxes of floors, walls and balls overlap those of most other primitives, and for balls Embree has to call back.
//! Here a ray is tested against them in the lanes of a [`List`] first. The tree gets the ray that ends where it hit the
//! list, and only if it meets the tree's bounding box.

use super::assembly::{Assembly, CheckedAssembly};
use super::list::List;
use super::{Accel, Coherence, Geometry, Hit};
use crate::math::lanes::{LANES, bits, f32x16};
use crate::math::robust::gamma;
use crate::math::{Bounds, Ray, RayX16, Vec3};
use std::collections::HashMap;

/// The greatest cost of the list.
const MAX_COST: usize = 16;
/// The greatest number of primitives of a geometry in the list.
const MAX_PRIMITIVES: usize = 12;
/// The greatest number of geometries that are tried for the list.
const MAX_CANDIDATES: usize = 64;
/// The least share that the box of a surface in the list has of the area of all boxes that are not larger.
const MIN_SHARE: f64 = 1.0 / 32.0;
/// The number of rays that pass from the list to the tree at once.
const CHUNK: usize = 256;

/// A list in front of a tree.
pub struct Fronted {
    list: List,
    tree: Box<dyn Accel>,
    bounds: Bounds,
    /// The bounding box of the tree.
    behind: Bounds,
}

/// An assembly in two parts.
pub(super) struct Parts {
    /// The largest simple surfaces.
    pub list: List,
    /// All others. In the place of those of the list, there are geometries without primitives.
    pub rest: Assembly,
    /// What is known about the rest.
    pub checked: CheckedAssembly,
}

/// Takes the largest simple surfaces out of an assembly, by the area of their boxes. Returns it as it is if there are
/// none.
pub(super) fn part(
    mut assembly: Assembly,
    checked: CheckedAssembly,
) -> Result<Parts, (Assembly, CheckedAssembly)> {
    let marked = |i: usize| assembly.filter.as_ref().is_some_and(|f| f.geometry[i]);
    let is_simple = |i: usize| {
        let (of_list, bounds) = (&assembly.geometry[i], checked.geometry[i]);
        let few = (1..=MAX_PRIMITIVES).contains(&of_list.len());
        few && !matches!(of_list, Geometry::Surfaces(_)) && !bounds.is_empty() && !marked(i)
    };
    let area = |bounds: &Bounds| {
        let size = (bounds.max - bounds.min).max(Vec3::ZERO);
        size.x * size.y + size.y * size.z + size.z * size.x
    };
    let world = checked.world.iter().map(|&i| i as usize);
    let of_world = world.map(|i| (area(&checked.geometry[i]), is_simple(i).then_some(i)));
    let of_instances = checked.instances.iter().map(|bounds| (area(bounds), None));
    let mut boxes: Vec<(f32, Option<usize>)> = of_world.chain(of_instances).collect();
    boxes.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
    let mut not_larger: f64 = boxes.iter().map(|&(area, _)| f64::from(area)).sum();
    let mut candidates = Vec::new();
    for (area, simple) in boxes {
        match simple {
            Some(i) if f64::from(area) >= MIN_SHARE * not_larger => candidates.push(i),
            Some(_) => break,
            None => {}
        }
        not_larger -= f64::from(area);
    }
    candidates.truncate(MAX_CANDIDATES);
    let corners = SharedCorners::of(&assembly, &checked, &candidates);
    let mut stays = corners.of_others(&assembly, &checked, &candidates);
    let mut checked = checked;
    let list = loop {
        let mut front = Assembly::from(vec![Geometry::nothing(); assembly.geometry.len()]);
        let mut list = None;
        for (&i, stays) in candidates.iter().zip(&mut stays).filter(|(_, stays)| !**stays) {
            front.geometry[i] = assembly.geometry[i].clone();
            match List::within(MAX_COST, &front, &checked) {
                Some(longer) => list = Some(longer),
                None => {
                    front.geometry[i] = Geometry::nothing();
                    *stays = true;
                }
            }
        }
        if !corners.spread(&mut stays) {
            break list;
        }
    };
    let Some(list) = list else { return Err((assembly, checked)) };
    for (&i, _) in candidates.iter().zip(&stays).filter(|(_, stays)| !**stays) {
        assembly.geometry[i] = Geometry::nothing();
    }
    let left = checked.world.iter().map(|&i| i as usize).filter(|&i| !assembly.geometry[i].is_empty());
    let behind = left.map(|i| checked.geometry[i]).chain(checked.instances.iter().copied());
    checked.bounds = behind.fold(Bounds::EMPTY, Bounds::union);
    Ok(Parts { list, rest: assembly, checked })
}

/// The corners of the candidates for the list, each with the indices of the candidates that have it.
///
/// The list and Embree round the edges of triangles differently, so a ray may pass between two triangles with a common
/// edge if one is in the list and the other in the tree. Meshes with common corners are therefore in the same part.
struct SharedCorners(HashMap<[u32; 3], Vec<usize>>);

impl SharedCorners {
    fn of(assembly: &Assembly, checked: &CheckedAssembly, candidates: &[usize]) -> Self {
        let mut corners: HashMap<[u32; 3], Vec<usize>> = HashMap::new();
        for (k, &i) in candidates.iter().enumerate() {
            let Geometry::Triangles { positions, .. } = &assembly.geometry[i] else { continue };
            for &p in positions.iter().filter(|&&p| checked.geometry[i].contains(p)) {
                let of_corner = corners.entry(key(p)).or_default();
                if of_corner.last() != Some(&k) {
                    of_corner.push(k);
                }
            }
        }
        SharedCorners(corners)
    }

    /// Returns for each candidate whether it has a corner in common with a mesh that is none.
    fn of_others(&self, assembly: &Assembly, checked: &CheckedAssembly, candidates: &[usize]) -> Vec<bool> {
        let mut stays = vec![false; candidates.len()];
        for i in checked.world.iter().map(|&i| i as usize).filter(|i| !candidates.contains(i)) {
            let Geometry::Triangles { positions, .. } = &assembly.geometry[i] else { continue };
            let is_in_box =
                |corner: &[u32; 3]| checked.geometry[i].contains(corner.map(f32::from_bits).into());
            if self.0.keys().any(is_in_box) {
                for &k in positions.iter().filter_map(|&p| self.0.get(&key(p))).flatten() {
                    stays[k] = true;
                }
            }
        }
        stays
    }

    /// Marks the candidates with a corner in common with one that stays in the tree. Returns whether it marked any.
    fn spread(&self, stays: &mut [bool]) -> bool {
        let mut found = false;
        for of_corner in self.0.values() {
            if of_corner.iter().any(|&k| stays[k]) {
                for &k in of_corner {
                    found |= !std::mem::replace(&mut stays[k], true);
                }
            }
        }
        found
    }
}

/// Returns the bits of a point, which are equal for 0 and −0.
fn key(p: Vec3) -> [u32; 3] {
    p.to_array().map(|c| (c + 0.0).to_bits())
}

impl Fronted {
    /// Puts a list in front of a tree.
    pub(super) fn new(list: List, tree: Box<dyn Accel>) -> Self {
        let behind = tree.bounds();
        Fronted { bounds: list.bounds().union(behind), list, tree, behind }
    }

    /// Returns a mask of the rays that may hit something in the tree before `t_max`.
    /// [Ize 2013, "Robust BVH ray traversal", for the rounding errors]
    #[inline(always)]
    fn may_hit_tree(&self, rays: &RayX16, t_max: f32x16) -> u32 {
        let Bounds { min, max } = self.behind;
        let (mut near, mut far) = (f32x16::splat(f32::NEG_INFINITY), f32x16::splat(f32::INFINITY));
        let axes = [
            (rays.o.x, rays.d.x, min.x, max.x),
            (rays.o.y, rays.d.y, min.y, max.y),
            (rays.o.z, rays.d.z, min.z, max.z),
        ];
        for (o, d, min, max) in axes {
            let per_slope = f32x16::ONE / d;
            let (a, b) = ((f32x16::splat(min) - o) * per_slope, (f32x16::splat(max) - o) * per_slope);
            // A ray along the planes of the axis meets them nowhere or everywhere: they do not exclude it.
            let meets_planes = d.abs().simd_ge(f32x16::splat(f32::MIN_POSITIVE));
            near = meets_planes.select(near.fast_max(a.fast_min(b)), near);
            far = meets_planes.select(far.fast_min(a.fast_max(b)), far);
        }
        let wider = f32x16::splat(1.0 + 2.0 * gamma(3));
        let meets = near.simd_le(far * wider) & far.simd_ge(f32x16::ZERO) & near.simd_le(t_max * wider);
        meets.to_bitmask()
    }
}

/// The rays of a chunk that go on to the tree.
struct Queue {
    rays: [Ray; CHUNK],
    /// The index of each in the chunk.
    index: [u8; CHUNK],
    len: usize,
}

impl Queue {
    /// Collects the rays that may hit something in the tree before `end(i)`, which is 0 for a ray that has ended.
    #[inline(always)]
    fn new(fronted: &Fronted, rays: &[Ray], end: impl Fn(usize) -> f32) -> Self {
        let mut queue = Queue { rays: bytemuck::Zeroable::zeroed(), index: [0; CHUNK], len: 0 };
        for first in (0..rays.len()).step_by(LANES) {
            let block = RayX16::load(rays, first);
            let count = LANES.min(rays.len() - first);
            let ends: [f32; LANES] = std::array::from_fn(|i| if i < count { end(first + i) } else { 0.0 });
            let ends_x16 = f32x16::from(ends);
            let alive = ends_x16.simd_gt(f32x16::ZERO).to_bitmask();
            for lane in bits(alive & fronted.may_hit_tree(&block, ends_x16)) {
                queue.rays[queue.len] = Ray { t_max: ends[lane], ..rays[first + lane] };
                queue.index[queue.len] = (first + lane) as u8;
                queue.len += 1;
            }
        }
        queue
    }
}

impl Accel for Fronted {
    fn name(&self) -> &'static str {
        match self.tree.name() {
            "embree" => "list+embree",
            _ => "list+obvhs",
        }
    }

    fn bounds(&self) -> Bounds {
        self.bounds
    }

    fn memory_bytes(&self) -> usize {
        self.list.memory_bytes() + self.tree.memory_bytes()
    }

    fn intersect(&self, ray: &Ray) -> Option<Hit> {
        let near = self.list.intersect(ray);
        let behind = Ray { t_max: near.map_or(ray.t_max, |hit| hit.t), ..*ray };
        self.tree.intersect(&behind).or(near)
    }

    fn occluded(&self, ray: &Ray) -> bool {
        self.list.occluded(ray) || self.tree.occluded(ray)
    }

    fn intersect_wave(&self, rays: &[Ray], hits: &mut [Option<Hit>], coherence: Coherence) {
        assert_eq!(rays.len(), hits.len(), "one hit for each ray");
        let mut behind = [None; CHUNK];
        for (rays, hits) in rays.chunks(CHUNK).zip(hits.chunks_mut(CHUNK)) {
            self.list.intersect_wave(rays, hits, coherence);
            let queue = Queue::new(self, rays, |i| hits[i].map_or(rays[i].t_max, |hit| hit.t));
            let behind = &mut behind[..queue.len];
            self.tree.intersect_wave(&queue.rays[..queue.len], behind, coherence);
            for (&i, hit) in queue.index.iter().zip(behind) {
                hits[usize::from(i)] = hit.or(hits[usize::from(i)]);
            }
        }
    }

    fn occluded_wave(&self, rays: &[Ray], occluded: &mut [bool], coherence: Coherence) {
        assert_eq!(rays.len(), occluded.len(), "one answer for each ray");
        let mut behind = [false; CHUNK];
        for (rays, occluded) in rays.chunks(CHUNK).zip(occluded.chunks_mut(CHUNK)) {
            self.list.occluded_wave(rays, occluded, coherence);
            let queue = Queue::new(self, rays, |i| if occluded[i] { 0.0 } else { rays[i].t_max });
            let behind = &mut behind[..queue.len];
            self.tree.occluded_wave(&queue.rays[..queue.len], behind, coherence);
            for (&i, &mut hit) in queue.index.iter().zip(behind) {
                occluded[usize::from(i)] |= hit;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::accel::{AccelKind, GeometryFilter, HitFilter, Primitive, build};
    use std::sync::Arc;

    fn ball(x: f32, radius: f32) -> Geometry {
        Geometry::Analytic(Primitive::Sphere { center: Vec3::X * x, radius })
    }

    fn triangles(count: usize, at: Vec3) -> Geometry {
        let corners = [at, at + Vec3::X, at + Vec3::Y];
        let positions: Vec<Vec3> = corners.into_iter().cycle().take(3 * count).collect();
        let indices = (0..count as u32).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
        Geometry::Triangles { positions: Arc::new(positions.into()), indices: Arc::new(indices) }
    }

    struct All;

    impl HitFilter for All {
        fn accepts(&self, _: u32, _: &Ray, _: &Hit) -> bool {
            true
        }
    }

    /// Returns the indices of the geometries in the list.
    fn listed(mut assembly: Assembly) -> Vec<usize> {
        let checked = assembly.check().expect("fine");
        let full: Vec<bool> = assembly.geometry.iter().map(|g| !g.is_empty()).collect();
        match part(assembly, checked) {
            Ok(parts) => (0..full.len()).filter(|&i| full[i] && parts.rest.geometry[i].is_empty()).collect(),
            Err(_) => Vec::new(),
        }
    }

    #[test]
    fn the_largest_surfaces_are_in_the_list_up_to_its_cost_but_not_those_with_holes() {
        let mut geometry = vec![triangles(100, Vec3::ZERO), triangles(2, Vec3::Z), triangles(13, -Vec3::Z)];
        geometry.extend((1..=12).map(|i| ball(3.0 * i as f32, 0.05 * i as f32)));
        // A ball costs 2, two equal triangles cost 2.
        assert_eq!(listed(geometry.clone().into()), [1, 8, 9, 10, 11, 12, 13, 14]);
        let mut with_holes = Assembly::from(geometry);
        let marks = (0..with_holes.geometry.len()).map(|i| i == 14).collect();
        with_holes.filter = Some(GeometryFilter { filter: Arc::new(All), geometry: marks });
        assert_eq!(listed(with_holes), [1, 7, 8, 9, 10, 11, 12, 13]);
        assert_eq!(listed(vec![triangles(100, Vec3::ZERO)].into()), [0; 0]);
        // A mesh with a corner of one that stays in the tree stays there, too, and so does its neighbour.
        let neighbours = vec![triangles(100, Vec3::ZERO), triangles(2, Vec3::X), triangles(2, Vec3::X * 2.0)];
        assert_eq!(listed([neighbours, vec![ball(20.0, 9.0)]].concat().into()), [3]);
        // Of many equal balls, none is worth a test of each ray. A floor below them is.
        let mut many: Vec<Geometry> = (0..40).map(|i| ball(i as f32, 0.3)).collect();
        assert_eq!(listed(many.clone().into()), [0; 0]);
        many.push(ball(0.0, 50.0));
        assert_eq!(listed(many.into()), [40]);
    }

    /// Rays along axes that start in the planes of the tree's box, beside it, and far away: single rays, which are not
    /// compared with the box, have the same hits.
    #[test]
    fn rays_past_the_box_of_the_tree_are_those_without_a_hit_in_it() {
        let near_box = [-1.0, -0.5, 0.0, 0.3, 1.0, 2.0, 1e6];
        let point = |i: usize| Vec3::from([i % 7, i / 7 % 7, i / 49].map(|k| near_box[k]));
        let mut rays = Vec::new();
        for i in 0..343 {
            for d in [Vec3::X, Vec3::NEG_Y, Vec3::Z, Vec3::new(-1e-38, 0.0, 2.0), point(342 - i) - point(i)] {
                rays.extend([f32::INFINITY, 0.7].map(|t_max| Ray { t_max, ..Ray::new(point(i), d) }));
            }
        }
        let behind = triangles(60, Vec3::ZERO);
        let accel = build(AccelKind::Auto, vec![ball(9.0, 0.5), behind], 1, true).expect("built").accel;
        assert!(accel.name().starts_with("list+"));
        let (mut hits, mut occluded) = (vec![None; rays.len()], vec![false; rays.len()]);
        accel.intersect_wave(&rays, &mut hits, Coherence::Incoherent);
        accel.occluded_wave(&rays, &mut occluded, Coherence::Incoherent);
        for ((ray, hit), occluded) in rays.iter().zip(&hits).zip(occluded) {
            assert_eq!(*hit, accel.intersect(ray), "{ray:?}");
            assert_eq!(occluded, hit.is_some(), "{ray:?}");
        }
        let in_tree = hits.iter().flatten().filter(|hit| hit.geometry == 1).count();
        assert!(in_tree > 100 && in_tree < rays.len() / 2, "{in_tree}");
    }
}
