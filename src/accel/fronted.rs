//! A list of the largest simple surfaces in front of a tree of all other primitives.
//!
//! The boxes of floors, walls and balls overlap those of most other primitives, and for balls Embree has to call back.
//! Here a ray is tested against them in the lanes of a [`List`] first. The tree gets the ray that ends where it hit the
//! list, and only if it meets the tree's bounding box.

use super::assembly::{Assembly, CheckedAssembly};
use super::geometry::valid_triangle;
use super::list::List;
use super::{Accel, Coherence, Geometry, Hit};
use crate::math::lanes::{LANES, bits, f32x16};
use crate::math::robust::gamma;
use crate::math::{Bounds, Ray, RayX16, Vec3};
use std::collections::{HashMap, HashSet};

/// The greatest cost of the list.
const MAX_COST: usize = 32;
/// The greatest number of primitives of a geometry in the list.
const MAX_PRIMITIVES: usize = 12;
/// The greatest number of geometries that are tried for the list.
const MAX_CANDIDATES: usize = 64;
/// The least share that boxes of the list have, on average, of the area of all boxes that are not in it.
const MIN_SHARE: f64 = 1.0 / 32.0;
/// The greatest number of analytic surfaces that are in the list however small they are, because Embree calls back for
/// each box of them that a ray meets.
const FEW_ANALYTIC: usize = 4;
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
        f64::from(size.x * size.y + size.y * size.z + size.z * size.x)
    };
    let world = || checked.world.iter().map(|&i| i as usize);
    let boxes = world().map(|i| &checked.geometry[i]).chain(&checked.instances);
    let mut area_left: f64 = boxes.map(area).sum();
    let mut candidates: Vec<(f64, usize)> =
        world().filter(|&i| is_simple(i)).map(|i| (area(&checked.geometry[i]), i)).collect();
    candidates.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
    candidates.truncate(MAX_CANDIDATES);
    let candidates: Vec<usize> = candidates.into_iter().map(|(_, i)| i).collect();
    let mut front = Assembly::from(vec![Geometry::nothing(); assembly.geometry.len()]);
    let analytic = assembly.geometry.iter().filter(|g| matches!(g, Geometry::Analytic(_)));
    let few_analytic = analytic.count() <= FEW_ANALYTIC;
    let mut list = None;
    for members in connected(&assembly, &checked, &candidates) {
        let area: f64 = members.iter().map(|&i| area(&checked.geometry[i])).sum();
        let is_analytic = |&i: &usize| matches!(assembly.geometry[i], Geometry::Analytic(_));
        let free = few_analytic && members.iter().all(is_analytic);
        if !free && area < MIN_SHARE * members.len() as f64 * area_left {
            continue;
        }
        let exchange = |a: &mut Assembly, b: &mut Assembly| {
            members.iter().for_each(|&i| std::mem::swap(&mut a.geometry[i], &mut b.geometry[i]));
        };
        exchange(&mut assembly, &mut front);
        match List::within(MAX_COST, &front, &checked) {
            Some(longer) => (list, area_left) = (Some(longer), area_left - area),
            None => exchange(&mut assembly, &mut front),
        }
    }
    let Some(list) = list else { return Err((assembly, checked)) };
    let mut checked = checked;
    let left = checked.world.iter().map(|&i| i as usize).filter(|&i| !assembly.geometry[i].is_empty());
    let behind = left.map(|i| checked.geometry[i]).chain(checked.instances.iter().copied());
    checked.bounds = behind.fold(Bounds::EMPTY, Bounds::union);
    Ok(Parts { list, rest: assembly, checked })
}

/// Returns the candidates for the list, those with common edges together, without those that may have an edge in common
/// with any other mesh. The order is that of the first of each.
///
/// The list and Embree round the edges of triangles differently, so a ray may pass between two triangles with a common
/// edge if one is in the list and the other in the tree. Meshes with common edges are therefore in the same part.
fn connected(assembly: &Assembly, checked: &CheckedAssembly, candidates: &[usize]) -> Vec<Vec<usize>> {
    // For each candidate, the first one that is connected with it; none if it is connected with another mesh.
    let mut first: Vec<Option<usize>> = (0..candidates.len()).map(Some).collect();
    let join = |first: &mut [Option<usize>], a: Option<usize>, b: Option<usize>| {
        first.iter_mut().filter(|f| **f == a || **f == b).for_each(|f| *f = a.min(b));
    };
    let mut owners: HashMap<[[u32; 3]; 2], usize> = HashMap::new();
    for (k, &i) in candidates.iter().enumerate() {
        for edge in edges(&assembly.geometry[i]) {
            let owner = *owners.entry(edge).or_insert(k);
            let (a, b) = (first[k], first[owner]);
            join(&mut first, a, b);
        }
    }
    let corners: HashSet<[u32; 3]> = owners.keys().flatten().copied().collect();
    for i in checked.world.iter().map(|&i| i as usize).filter(|i| !candidates.contains(i)) {
        let Geometry::Triangles { positions, .. } = &assembly.geometry[i] else { continue };
        let is_in_box = |corner: &[u32; 3]| checked.geometry[i].contains(corner.map(f32::from_bits).into());
        if !corners.iter().any(is_in_box) {
            continue;
        }
        let common: HashSet<_> = positions.iter().map(|&p| key(p)).filter(|p| corners.contains(p)).collect();
        for (edge, &owner) in &owners {
            if edge.iter().all(|corner| common.contains(corner)) {
                let a = first[owner];
                join(&mut first, a, None);
            }
        }
    }
    let mut groups = vec![Vec::new(); candidates.len()];
    for (first, &i) in first.iter().zip(candidates) {
        first.iter().for_each(|&first| groups[first].push(i));
    }
    groups.retain(|members| !members.is_empty());
    groups
}

/// Returns both corners of each edge of the valid triangles, in an order that is the same for all triangles.
fn edges(geometry: &Geometry) -> Vec<[[u32; 3]; 2]> {
    let Geometry::Triangles { positions, indices } = geometry else { return Vec::new() };
    let corners = indices.iter().filter_map(|&triangle| valid_triangle(positions, triangle));
    let of_triangle = |corners: [Vec3; 3]| {
        let [a, b, c] = corners.map(key);
        [[a, b], [b, c], [c, a]].map(|[p, q]| [p.min(q), p.max(q)])
    };
    corners.flat_map(of_triangle).collect()
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
        mesh(count, [at, at + Vec3::X, at + Vec3::Y])
    }

    /// Returns a triangle that is repeated.
    fn mesh(count: usize, corners: [Vec3; 3]) -> Geometry {
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
        geometry.extend((1..=24).map(|i| ball(3.0 * i as f32, 0.05 * i as f32)));
        // A ball costs 2.
        assert_eq!(listed(geometry.clone().into()), (11..=26).collect::<Vec<_>>());
        let mut with_holes = Assembly::from(geometry);
        let marks = (0..with_holes.geometry.len()).map(|i| i == 26).collect();
        with_holes.filter = Some(GeometryFilter { filter: Arc::new(All), geometry: marks });
        assert_eq!(listed(with_holes), (10..=25).collect::<Vec<_>>());
        assert_eq!(listed(vec![triangles(100, Vec3::ZERO)].into()), [0; 0]);
        // A few balls are in the list even if they are small.
        assert_eq!(listed(vec![triangles(100, Vec3::ZERO), ball(9.0, 1e-3)].into()), [1]);
        // Meshes with a common edge are in the same part.
        let (x, y) = (Vec3::X, Vec3::Y);
        let neighbours = [mesh(2, [x, y, x + y]), mesh(2, [2.0 * x, x + y, x]), ball(20.0, 9.0)];
        let with = |corners| listed([vec![mesh(100, corners)], neighbours.to_vec()].concat().into());
        assert_eq!(with([y, Vec3::ZERO, x]), [3]);
        assert_eq!(with([y, Vec3::ZERO, -x]), [1, 2, 3]);
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
