//! Surface interactions: all data of a hit that shading needs, recomputed from the hit's surface coordinates.

use crate::accel::Hit;
use crate::ids::{MaterialId, ShapeId};
use crate::math::lanes::mask_from_bits;
use crate::math::ray::{plane_error, plane_error_x16};
use crate::math::robust::gamma;
use crate::math::{Frame, FrameX16, LANES, Vec3, Vec3x16, f32x16};
use crate::shape::{TriangleMesh, WorldCurves, WorldSdfGrid};

/// A point on a surface.
#[derive(Clone, Copy, Debug)]
pub struct SurfaceInteraction {
    /// Position in world space.
    pub p: Vec3,
    /// Bound on the distance of `p` from the surface.
    pub error: f32,
    /// Geometric normal of the front side, of unit length.
    pub ng: Vec3,
    /// Shading frame.
    pub frame: Frame,
    /// Whether the shape emits towards the ray's origin, which must be on its geometric front side.
    pub emitting: bool,
    /// The hit from which it was computed.
    pub hit: Hit,
    /// Time in [0, 1] over the shutter interval.
    pub time: f32,
    /// The shape's material.
    pub material: MaterialId,
}

/// Sixteen surface points.
#[derive(Clone, Copy, Debug)]
pub struct SurfaceInteractionX16 {
    /// Positions in world space.
    pub p: Vec3x16,
    /// Bounds on the distances of `p` from the surfaces.
    pub error: f32x16,
    /// Geometric normals of the front sides, of unit length.
    pub ng: Vec3x16,
    /// Shading frames.
    pub frame: FrameX16,
    /// Mask of the shapes that emit towards the ray's origin, which must be on their geometric front side.
    pub emitting: u32,
    /// The hits from which they were computed.
    pub hit: [Hit; LANES],
    /// Times in [0, 1] over the shutter interval.
    pub time: f32x16,
    /// The shapes' materials.
    pub material: [MaterialId; LANES],
}

/// What decides which media are on the sides of a surface point.
#[derive(Clone, Copy, Debug)]
pub struct Facet {
    /// The shape.
    pub shape: ShapeId,
    /// Its material.
    pub material: MaterialId,
    /// The geometric normal of the front side.
    pub ng: Vec3,
}

impl SurfaceInteraction {
    /// Returns what decides which media are on the sides.
    pub fn facet(&self) -> Facet {
        Facet { shape: self.shape(), material: self.material, ng: self.ng }
    }

    /// Returns the shape.
    pub fn shape(&self) -> ShapeId {
        ShapeId(self.hit.geometry)
    }
}

impl SurfaceInteractionX16 {
    /// Returns what decides which media are on the sides in one lane.
    #[inline]
    pub fn facet(&self, i: usize) -> Facet {
        Facet { shape: self.shape(i), material: self.material[i], ng: self.ng.lane(i) }
    }

    /// Returns the shape of one lane.
    #[inline]
    pub fn shape(&self, i: usize) -> ShapeId {
        ShapeId(self.hit[i].geometry)
    }

    /// Returns the surface point of one lane.
    pub fn lane(&self, i: usize) -> SurfaceInteraction {
        SurfaceInteraction {
            p: self.p.lane(i),
            error: self.error.as_array()[i],
            ng: self.ng.lane(i),
            frame: self.frame.lane(i),
            emitting: self.emitting >> i & 1 == 1,
            hit: self.hit[i],
            time: self.time.as_array()[i],
            material: self.material[i],
        }
    }
}

/// A point on an analytic surface: position, bound on its distance from the surface, and normals.
pub(super) struct AnalyticPoint {
    pub p: Vec3,
    pub error: f32,
    pub ng: Vec3,
    pub ns: Vec3,
}

impl AnalyticPoint {
    /// Creates a point with the same normal for shading.
    fn new(p: Vec3, error: f32, n: Vec3) -> Self {
        AnalyticPoint { p, error, ng: n, ns: n }
    }
}

/// The corners of sixteen triangles and their vertex normals, which are zero if the mesh has none.
pub(super) struct CornersX16 {
    positions: [[[f32; LANES]; 3]; 3],
    normals: Option<[[[f32; LANES]; 3]; 3]>,
}

/// Positions, bounds on their distances from the surfaces, and geometric and shading normals.
pub(super) struct SurfaceX16 {
    pub p: Vec3x16,
    pub error: f32x16,
    pub ng: Vec3x16,
    pub ns: Vec3x16,
}

impl SurfaceX16 {
    /// Replaces the lanes in the mask `lanes` by those of `other`.
    #[inline(always)]
    pub fn set_lanes(&mut self, lanes: u32, other: &Self) {
        let mask = mask_from_bits(lanes);
        self.p = Vec3x16::select(mask, other.p, self.p);
        self.error = mask.select(other.error, self.error);
        self.ng = Vec3x16::select(mask, other.ng, self.ng);
        self.ns = Vec3x16::select(mask, other.ns, self.ns);
    }
}

impl CornersX16 {
    /// Creates an empty set.
    #[inline(always)]
    pub fn new() -> Self {
        CornersX16 { positions: [[[0.0; LANES]; 3]; 3], normals: None }
    }

    /// Sets the triangle of lane `i`.
    #[inline(always)]
    pub fn set_lane(&mut self, i: usize, mesh: &TriangleMesh, primitive: u32) {
        let indices = mesh.indices[primitive as usize];
        let put = |corners: &mut [[[f32; LANES]; 3]; 3], vectors: &[Vec3]| {
            for (corner, index) in corners.iter_mut().zip(indices) {
                let v = vectors[index as usize];
                (corner[0][i], corner[1][i], corner[2][i]) = (v.x, v.y, v.z);
            }
        };
        put(&mut self.positions, &mesh.positions);
        if !mesh.normals.is_empty() {
            put(self.normals.get_or_insert([[[0.0; LANES]; 3]; 3]), &mesh.normals);
        }
    }

    /// Computes the points with the barycentric weights `u`, `v` of the second and third corners.
    #[inline(always)]
    pub fn surface(&self, u: f32x16, v: f32x16) -> SurfaceX16 {
        let vector =
            |c: &[[f32; LANES]; 3]| Vec3x16::new(f32x16::new(c[0]), f32x16::new(c[1]), f32x16::new(c[2]));
        let [p0, p1, p2] = [0, 1, 2].map(|i| vector(&self.positions[i]));
        let w = f32x16::ONE - u - v;
        let mut ng = (p1 - p0).cross(p2 - p0).normalize_or_zero();
        let mut ns = ng;
        if let Some(normals) = &self.normals {
            let [n0, n1, n2] = [0, 1, 2].map(|i| vector(&normals[i]));
            let n = (n0 * w + n1 * u + n2 * v).normalize_or_zero();
            let usable = n.length_squared().simd_gt(f32x16::ZERO);
            ns = Vec3x16::select(usable, n, ng);
            // Vertex normals define the front side of a triangle.
            ng = Vec3x16::select(ng.dot(n0 + n1 + n2).simd_lt(f32x16::ZERO), -ng, ng);
        }
        // [pbrt 6.8.5] bounds the interpolation error by γ(7)·(|w p0| + |u p1| + |v p2|). A back end computes the
        // distance to the plane from differences with the corners, so the bound uses the corners' magnitudes without
        // their weights.
        let p_error = p0.abs().max(p1.abs()).max(p2.abs()) * f32x16::splat(gamma(12));
        SurfaceX16 { p: p0 * w + p1 * u + p2 * v, error: plane_error_x16(p_error, ng), ng, ns }
    }
}

/// Sixteen spheres.
#[derive(Default)]
pub(super) struct SpheresX16 {
    center: [[f32; LANES]; 3],
    radius: [f32; LANES],
    /// −1 where the front side is the inside, otherwise 1.
    side: [f32; LANES],
}

impl SpheresX16 {
    /// Sets the sphere of lane `i`.
    #[inline(always)]
    pub fn set_lane(&mut self, i: usize, center: Vec3, radius: f32, inward: bool) {
        let [x, y, z] = &mut self.center;
        (x[i], y[i], z[i]) = (center.x, center.y, center.z);
        self.radius[i] = radius;
        self.side[i] = if inward { -1.0 } else { 1.0 };
    }

    /// Moves points at or near `p` onto the spheres.
    #[inline(always)]
    pub fn surface(&self, p: Vec3x16) -> SurfaceX16 {
        let [x, y, z] = self.center.map(f32x16::new);
        let (center, radius) = (Vec3x16::new(x, y, z), f32x16::new(self.radius));
        let n = (p - center).normalize_or_zero();
        let usable = n.length_squared().simd_gt(f32x16::ZERO);
        let n = Vec3x16::select(usable, n, Vec3x16::splat(Vec3::Z));
        let reach = center.abs() + Vec3x16::new(radius, radius, radius);
        let error = plane_error_x16(reach * f32x16::splat(gamma(8)), n);
        let ng = n * f32x16::new(self.side);
        SurfaceX16 { p: center + n * radius, error, ng, ns: ng }
    }
}

/// Returns the point of a disk with the coordinates `u`, `v` along `du` and `dv`.
pub(super) fn disk_point(center: Vec3, du: Vec3, dv: Vec3, normal: Vec3, u: f32, v: f32) -> AnalyticPoint {
    let error = plane_error((center.abs() + du.abs() + dv.abs()) * gamma(8), normal);
    AnalyticPoint::new(center + du * u + dv * v, error, normal)
}

/// Moves a point at or near `p` onto the cylinder.
pub(super) fn cylinder_point(ends: [Vec3; 2], side: [Vec3; 2], inward: bool, p: Vec3) -> AnalyticPoint {
    let axis = (ends[1] - ends[0]).normalize();
    let q = p - ends[0];
    let height = q.dot(axis);
    let n = (q - axis * height).normalize_or(side[0].normalize());
    let radius = side[0].length();
    let reach = ends[0].abs().max(ends[1].abs()) + Vec3::splat(radius);
    let error = plane_error(reach * gamma(16), n);
    AnalyticPoint::new(ends[0] + axis * height + n * radius, error, if inward { -n } else { n })
}

/// Moves a point at or near `p` onto the curve.
pub(super) fn curve_point(curves: &WorldCurves, hit: &Hit, p: Vec3) -> AnalyticPoint {
    let (p, [ng, ns], reach) = curves.surface(hit, p);
    AnalyticPoint { p, error: plane_error(reach * gamma(16), ng), ng, ns }
}

/// Moves a point at or near `p` onto the isosurface.
pub(super) fn sdf_point(grid: &WorldSdfGrid, hit: &Hit, p: Vec3) -> AnalyticPoint {
    let (p, [ng, ns], reach) = grid.surface(hit, p);
    AnalyticPoint { p, error: plane_error(reach * gamma(16), ng), ng, ns }
}
