//! A linear list instead of a tree, for scenes of a few dozen flat or analytic surfaces. Each surface is tested
//! against eight rays at a time.
//!
//! Two triangles that make a parallelogram are tested as one. A lane computes the distance to the plane and the
//! coordinates of the intersection in it. Where the rounding of these could change the result (near an edge, at a
//! grazing angle, for an origin far outside the scene), the triangles are tested with the watertight test of the
//! pure-Rust BVH. The list is therefore as watertight as the BVH, and it saves the tree traversal, which costs more
//! than a few dozen planes. Analytic surfaces have the hits of the code that all back ends share, those of spheres,
//! disks and cylinders computed in lanes.

use super::assembly::{Assembly, CheckedAssembly};
use super::geometry::valid_triangle;
use super::triangle::ShearedRay;
use super::{Accel, Coherence, Geometry, Hit, NO_INSTANCE, is_valid_ray};
use crate::math::lanes::{LANES, Vec3x16, bits, f32x16};
use crate::math::robust::gamma;
use crate::math::{Bounds, Ray, RayX16, Vec3};
use facet::{FacetResult, HalfFacet, ListFacet, ListTriangle, facet};
use surface::{BoundedSurface, SurfaceHits};
use wide::{f32x8, i32x8};

mod facet;
mod surface;

/// The costs of a facet and of an analytic surface, and the greatest total cost of a list. With 19 facets, a list
/// answers twice as many rays in random directions as Embree. That it is still faster at the limit is extrapolated,
/// not measured.
const FACET_COST: usize = 1;
const SURFACE_COST: usize = 2;
const MAX_COST: usize = 48;
/// The distance of a ray origin from the scene's centre, in radii of the bounding sphere, up to which lanes are used.
const REACH: f32 = 4.0;

/// The list of an assembly.
pub struct List {
    /// Parallelograms first, then single triangles.
    facets: Vec<ListFacet>,
    quads: usize,
    surfaces: Vec<BoundedSurface>,
    bounds: Bounds,
    center: Vec3,
    reach: f32,
    ray_limit: f32,
}

impl List {
    /// Creates the list of a checked assembly that has no instances, no filter, no [`Geometry::Surfaces`], no very thin
    /// triangles and a small total cost. Returns `None` for any other assembly.
    pub(super) fn new(assembly: &Assembly, checked: &CheckedAssembly) -> Option<Self> {
        Self::within(MAX_COST, assembly, checked)
    }

    /// As [`new`](Self::new), with a total cost of at most `max_cost`.
    pub(super) fn within(max_cost: usize, assembly: &Assembly, checked: &CheckedAssembly) -> Option<Self> {
        let count: usize = assembly.geometry.iter().map(Geometry::len).sum();
        let simple = assembly.groups.is_empty() && assembly.instances.is_empty() && assembly.filter.is_none();
        let many = assembly.geometry.iter().any(|g| matches!(g, Geometry::Surfaces(_)));
        if !simple || many || count > 2 * max_cost || checked.bounds.is_empty() {
            return None;
        }
        let center = checked.bounds.center();
        let reach = REACH * checked.bounds.radius();
        let (quads, single) = facets(triangles(assembly), reach)?;
        let surfaces: Vec<BoundedSurface> = surfaces(assembly).collect();
        let cost = FACET_COST * (quads.len() + single.len()) + SURFACE_COST * surfaces.len();
        let usable = cost <= max_cost && reach.is_finite() && reach < checked.ray_limit;
        usable.then(|| List {
            quads: quads.len(),
            facets: quads.into_iter().chain(single).collect(),
            surfaces,
            bounds: checked.bounds,
            center,
            reach,
            ray_limit: checked.ray_limit,
        })
    }

    /// Traces a wave: `of_lane` gives the answer for rays computed in lanes, `of_hit` for the others.
    #[inline(always)]
    fn trace<const ANY: bool, T>(
        &self,
        rays: &[Ray],
        answers: &mut [T],
        of_lane: impl Fn(&HitX8, &ExactHits, usize) -> T,
        of_hit: impl Fn(Option<Hit>) -> T,
    ) {
        assert_eq!(rays.len(), answers.len(), "one answer for each ray");
        let mut exact = [None; 8];
        for first in (0..rays.len()).step_by(LANES) {
            let block = RayX16::load(rays, first);
            let rays = &rays[first..rays.len().min(first + LANES)];
            let answers = &mut answers[first..first + rays.len()];
            for (half, (rays, answers)) in rays.chunks(8).zip(answers.chunks_mut(8)).enumerate() {
                let (lanes, found, far) = RayX8::new(self, rays, &block, half);
                let found = lanes.test_all::<ANY>(self, found, &mut exact);
                for (lane, answer) in answers.iter_mut().enumerate() {
                    *answer = of_lane(&found, &exact, lane);
                }
                for lane in bits(far) {
                    answers[lane] = of_hit(self.intersect_exactly(&rays[lane]));
                }
            }
        }
    }

    /// Returns the nearest hit by testing every triangle and surface itself, without lanes.
    fn intersect_exactly(&self, ray: &Ray) -> Option<Hit> {
        if !is_valid_ray(ray, self.ray_limit) {
            return None;
        }
        let mut nearest = ListHit { t: ray.t_max, hit: None };
        let sheared = ShearedRay::new(ray);
        for (i, facet) in self.facets.iter().enumerate() {
            nearest.test_exactly(&sheared, facet, i < self.quads);
        }
        for surface in &self.surfaces {
            nearest.test_surface(ray, surface);
        }
        nearest.hit
    }
}

/// Returns all valid triangles, in the order of the assembly.
fn triangles(assembly: &Assembly) -> Vec<ListTriangle> {
    let mut triangles = Vec::new();
    for (geometry, of_list) in (0..).zip(&assembly.geometry) {
        let Geometry::Triangles { positions, indices } = of_list else { continue };
        for (primitive, &indices) in (0..).zip(indices.iter()) {
            let corners = valid_triangle(positions, indices);
            triangles.extend(corners.map(|corners| ListTriangle { geometry, primitive, corners }));
        }
    }
    triangles
}

/// Returns the parallelograms made of consecutive triangles, and the remaining triangles; `None` if a triangle is too
/// thin.
fn facets(triangles: Vec<ListTriangle>, reach: f32) -> Option<(Vec<ListFacet>, Vec<ListFacet>)> {
    let (mut quads, mut single) = (Vec::new(), Vec::new());
    let mut rest = &triangles[..];
    while let [first, following @ ..] = rest {
        let partner = following.first().filter(|next| next.geometry == first.geometry);
        let pair = partner.map(|next| facet(*first, Some(*next), reach));
        if let Some(FacetResult::Quad(quad)) = pair {
            quads.push(quad);
            rest = &following[1..];
            continue;
        }
        match facet(*first, None, reach) {
            FacetResult::Single(triangle) => single.push(triangle),
            _ => return None,
        }
        rest = following;
    }
    Some((quads, single))
}

fn surfaces(assembly: &Assembly) -> impl Iterator<Item = BoundedSurface> {
    (0..).zip(&assembly.geometry).filter_map(|(geometry, of_list)| {
        let &Geometry::Analytic(primitive) = of_list else { return None };
        primitive.is_valid().then(|| BoundedSurface::new(geometry, primitive))
    })
}

/// The nearest hit so far.
struct ListHit {
    t: f32,
    hit: Option<Hit>,
}

impl ListHit {
    #[inline]
    fn found(&mut self, hit: Hit) {
        if hit.t < self.t {
            self.t = hit.t;
            self.hit = Some(hit);
        }
    }

    /// Tests the triangles of a facet.
    fn test_exactly(&mut self, ray: &ShearedRay, facet: &ListFacet, both: bool) {
        for HalfFacet { triangle, .. } in &facet.halves[..1 + usize::from(both)] {
            let corners = triangle.corners.map(|p| p.to_array());
            if let Some((t, u, v)) = ray.intersect(&corners, self.t) {
                let ListTriangle { geometry, primitive, .. } = *triangle;
                self.found(Hit { t, u, v, geometry, primitive, instance: NO_INSTANCE });
            }
        }
    }

    fn test_surface(&mut self, ray: &Ray, surface: &BoundedSurface) {
        let ray = Ray { t_max: self.t, ..*ray };
        if let Some(hit) = surface.primitive.intersect(&ray) {
            let geometry = surface.geometry;
            self.found(Hit { t: hit.t, u: hit.u, v: hit.v, geometry, primitive: 0, instance: NO_INSTANCE });
        }
    }
}

/// Eight vectors.
#[derive(Clone, Copy)]
struct Vec3x8([f32x8; 3]);

impl Vec3x8 {
    /// Returns r − c for each vector r.
    #[inline(always)]
    fn relative_to(self, c: Vec3) -> Self {
        let [x, y, z] = self.0;
        Vec3x8([x - c.x, y - c.y, z - c.z])
    }

    #[inline(always)]
    fn dot(self, v: Vec3) -> f32x8 {
        let [x, y, z] = self.0;
        x.mul_add(f32x8::splat(v.x), y.mul_add(f32x8::splat(v.y), z * v.z))
    }

    #[inline(always)]
    fn dot_x8(self, o: Self) -> f32x8 {
        let ([x, y, z], [a, b, c]) = (self.0, o.0);
        x.mul_add(a, y.mul_add(b, z * c))
    }

    /// Returns a mask of the vectors whose components have magnitudes of at most `limit`; false for NaN.
    #[inline(always)]
    fn is_within(self, limit: f32x8) -> f32x8 {
        let [x, y, z] = self.0.map(|c| c.abs().simd_le(limit));
        x & y & z
    }
}

/// Eight rays.
struct RayX8<'a> {
    rays: &'a [Ray],
    o: Vec3x8,
    d: Vec3x8,
    /// The L1 norm of the direction, an upper bound of its length.
    length: f32x8,
    /// The bound on the rounding error of d·n. If |d·n| is below it, its sign is uncertain.
    grazing: f32x8,
}

/// The hits of eight rays so far. It is passed by value so that it stays in registers.
#[derive(Clone, Copy)]
struct HitX8 {
    /// The distance of the nearest hit; 0 for inactive lanes and for rays that have ended.
    t: f32x8,
    /// The index of the nearest facet, that of a surface behind all facets, or [`NOTHING`], or [`EXACT`].
    facet: i32x8,
    /// The coordinates in the facet or on the surface.
    s: f32x8,
    r: f32x8,
}

impl HitX8 {
    /// Replaces the hits of the lanes in a mask by those of the facet or surface `index`. With `ANY`, a hit ends a ray.
    #[inline(always)]
    fn set<const ANY: bool>(&mut self, hit: f32x8, index: usize, [t, s, r]: [f32x8; 3]) {
        self.t = hit.select(if ANY { f32x8::ZERO } else { t }, self.t);
        self.s = hit.select(s, self.s);
        self.r = hit.select(r, self.r);
        self.facet = bytemuck::cast::<f32x8, i32x8>(hit).select(i32x8::splat(index as i32), self.facet);
    }
}

/// No hit.
const NOTHING: i32 = -1;
/// The hit was found by an exact test of a single ray and is in [`ExactHits`].
const EXACT: i32 = -2;

/// The hits found by exact tests.
type ExactHits = [Option<Hit>; 8];

impl<'a> RayX8<'a> {
    /// Returns half of a block, the initial hits with the lanes that can be computed here active, and a mask of the
    /// valid rays whose origin is too far away.
    #[inline(always)]
    fn new(list: &List, rays: &'a [Ray], block: &RayX16, half: usize) -> (Self, HitX8, u32) {
        let pick = |v: f32x16| bytemuck::cast::<f32x16, [f32x8; 2]>(v)[half];
        let three = |v: Vec3x16| Vec3x8([v.x, v.y, v.z].map(pick));
        let (o, d, t_max, time) = (three(block.o), three(block.d), pick(block.t_max), pick(block.time));
        let limit = f32x8::splat(list.ray_limit);
        let [dx, dy, dz] = d.0.map(f32x8::abs);
        let length = dx + dy + dz;
        let valid = o.is_within(limit)
            & d.is_within(limit)
            & length.simd_gt(f32x8::ZERO)
            & t_max.simd_gt(f32x8::ZERO)
            & time.simd_ge(f32x8::ZERO)
            & time.simd_le(f32x8::ONE);
        let near = o.relative_to(list.center).is_within(f32x8::splat(list.reach));
        let lanes = RayX8 { rays, o, d, length, grazing: length * gamma(4) };
        let found =
            HitX8 { t: t_max & (valid & near), facet: i32x8::splat(NOTHING), s: f32x8::ZERO, r: f32x8::ZERO };
        (lanes, found, valid.to_bitmask() & !near.to_bitmask())
    }

    /// Tests a facet; `SINGLE` marks one with a single triangle. With `ANY`, a hit ends a ray.
    #[inline(always)]
    fn test<const SINGLE: bool, const ANY: bool>(
        &self,
        facet: &ListFacet,
        index: usize,
        mut found: HitX8,
        exact: &mut ExactHits,
    ) -> HitX8 {
        let from_center = self.o.relative_to(facet.center);
        let (height, slope) = (from_center.dot(facet.normal), self.d.dot(facet.normal));
        let per_slope = f32x8::ONE / slope;
        let t = -height * per_slope;
        let s = t.mul_add(self.d.dot(facet.du), from_center.dot(facet.du));
        let r = t.mul_add(self.d.dot(facet.dv), from_center.dot(facet.dv));
        let mut outside = s.abs().fast_max(r.abs()) - 0.5;
        if SINGLE {
            outside = outside.fast_max(s + r);
        }
        let margin = (self.length * per_slope).abs() * facet.margin;
        let ahead = t.simd_gt(f32x8::ZERO) & t.simd_lt(found.t);
        let grazing = slope.abs().simd_lt(self.grazing) & found.t.simd_gt(f32x8::ZERO);
        let hit = ahead & outside.simd_lt(-margin);
        let uncertain = ((ahead & outside.abs().simd_le(margin)) | grazing).to_bitmask();
        found.set::<ANY>(hit, index, [t, s, r]);
        if uncertain == 0 {
            return found;
        }
        self.test_exactly::<ANY>(uncertain, found, exact, |ray, nearest| {
            nearest.test_exactly(&ShearedRay::new(ray), facet, !SINGLE);
        })
    }

    /// Tests an analytic surface for the rays that may hit it; `index` counts from the facets on.
    #[inline(always)]
    fn test_surface<const ANY: bool>(
        &self,
        surface: &BoundedSurface,
        index: usize,
        mut found: HitX8,
        exact: &mut ExactHits,
    ) -> HitX8 {
        match surface.hits(self, found.t) {
            None => found,
            Some(SurfaceHits::Lanes { hit, t, u, v }) => {
                found.set::<ANY>(hit, index, [t, u, v]);
                found
            }
            Some(SurfaceHits::Candidates(lanes)) => {
                self.test_exactly::<ANY>(lanes, found, exact, |ray, nearest| {
                    nearest.test_surface(ray, surface)
                })
            }
        }
    }

    /// Tests the selected lanes one by one. `found` is copied to arrays and back here, so that it has no address
    /// elsewhere and stays in registers.
    #[inline(always)]
    fn test_exactly<const ANY: bool>(
        &self,
        lanes: u32,
        mut found: HitX8,
        exact: &mut ExactHits,
        query: impl Fn(&Ray, &mut ListHit),
    ) -> HitX8 {
        let (mut t, mut facet) = (found.t.to_array(), found.facet.to_array());
        test_each_exactly::<ANY>(self.rays, lanes, (&mut t, &mut facet), exact, query);
        (found.t, found.facet) = (f32x8::new(t), i32x8::new(facet));
        found
    }

    #[inline(always)]
    fn test_all<const ANY: bool>(&self, list: &List, mut found: HitX8, exact: &mut ExactHits) -> HitX8 {
        let (quads, single) = list.facets.split_at(list.quads);
        for (i, facet) in quads.iter().enumerate() {
            found = self.test::<false, ANY>(facet, i, found, exact);
        }
        for (i, facet) in single.iter().enumerate() {
            found = self.test::<true, ANY>(facet, quads.len() + i, found, exact);
        }
        for (i, surface) in list.surfaces.iter().enumerate() {
            found = self.test_surface::<ANY>(surface, list.facets.len() + i, found, exact);
        }
        found
    }
}

#[inline(never)]
fn test_each_exactly<const ANY: bool>(
    rays: &[Ray],
    lanes: u32,
    (t, facet): (&mut [f32; 8], &mut [i32; 8]),
    exact: &mut ExactHits,
    query: impl Fn(&Ray, &mut ListHit),
) {
    for lane in bits(lanes) {
        let mut nearest = ListHit { t: t[lane], hit: None };
        query(&rays[lane], &mut nearest);
        if let Some(hit) = nearest.hit {
            t[lane] = if ANY { 0.0 } else { hit.t };
            facet[lane] = EXACT;
            exact[lane] = Some(hit);
        }
    }
}

impl List {
    /// Returns the nearest hit of a lane.
    #[inline]
    fn hit(&self, found: &HitX8, exact: &ExactHits, lane: usize) -> Option<Hit> {
        let i = match found.facet.as_array()[lane] {
            NOTHING => return None,
            EXACT => return exact[lane],
            i => i as usize,
        };
        let (t, s, r) = (found.t.as_array()[lane], found.s.as_array()[lane], found.r.as_array()[lane]);
        if let Some(BoundedSurface { geometry, .. }) = self.surfaces.get(i.wrapping_sub(self.facets.len())) {
            return Some(Hit { t, u: s, v: r, geometry: *geometry, primitive: 0, instance: NO_INSTANCE });
        }
        let HalfFacet { triangle, u, v } =
            &self.facets[i].halves[usize::from(i < self.quads && s + r >= 0.0)];
        Some(Hit {
            t,
            u: (u[0] + u[1] * s + u[2] * r).max(0.0),
            v: (v[0] + v[1] * s + v[2] * r).max(0.0),
            geometry: triangle.geometry,
            primitive: triangle.primitive,
            instance: NO_INSTANCE,
        })
    }
}

impl Accel for List {
    fn name(&self) -> &'static str {
        "list"
    }

    fn bounds(&self) -> Bounds {
        self.bounds
    }

    fn memory_bytes(&self) -> usize {
        size_of_val(self.facets.as_slice()) + size_of_val(self.surfaces.as_slice())
    }

    fn intersect(&self, ray: &Ray) -> Option<Hit> {
        let mut hit = [None];
        self.intersect_wave(std::slice::from_ref(ray), &mut hit, Coherence::Incoherent);
        hit[0]
    }

    fn occluded(&self, ray: &Ray) -> bool {
        let mut occluded = [false];
        self.occluded_wave(std::slice::from_ref(ray), &mut occluded, Coherence::Incoherent);
        occluded[0]
    }

    fn intersect_wave(&self, rays: &[Ray], hits: &mut [Option<Hit>], _coherence: Coherence) {
        self.trace::<false, _>(rays, hits, |found, exact, lane| self.hit(found, exact, lane), |hit| hit);
    }

    fn occluded_wave(&self, rays: &[Ray], occluded: &mut [bool], _coherence: Coherence) {
        let is_hit = |found: &HitX8, _: &ExactHits, lane: usize| found.facet.as_array()[lane] != NOTHING;
        self.trace::<true, _>(rays, occluded, is_hit, |hit| hit.is_some());
    }
}
