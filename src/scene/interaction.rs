//! Surface points: everything about a hit that shading needs, recomputed from the hit's coordinates.

use crate::ids::{MaterialId, ShapeId};
use crate::math::robust::gamma;
use crate::math::{Frame, Vec2, Vec3};
use crate::shape::{TriangleMesh, WorldShape};
use std::f32::consts::{PI, TAU};

/// A point on a surface.
#[derive(Clone, Copy, Debug)]
pub struct SurfaceInteraction {
    /// Position in the world.
    pub p: Vec3,
    /// Bound on the distance of `p` from the surface.
    pub error: f32,
    /// Geometric normal of the front, unit length.
    pub ng: Vec3,
    /// Shading frame.
    pub frame: Frame,
    /// Whether the ray came from the shape's front, before a two-sided material turned the frame.
    pub front: bool,
    /// The shape.
    pub shape: ShapeId,
    /// Its material.
    pub material: MaterialId,
}

/// Position, error bound, normals, and the tangent if it is asked for.
pub(super) struct Surface {
    pub p: Vec3,
    pub p_error: Vec3,
    pub ng: Vec3,
    pub ns: Vec3,
}

/// The point of a triangle with the barycentric weights `u`, `v` of its second and third vertex.
#[inline]
pub(super) fn mesh_point(mesh: &TriangleMesh, primitive: u32, u: f32, v: f32) -> Surface {
    let indices = mesh.indices[primitive as usize];
    let [p0, p1, p2] = indices.map(|i| mesh.positions[i as usize]);
    let w = 1.0 - u - v;
    let (a, b, c) = (p0 * w, p1 * u, p2 * v);
    let mut ng = (p1 - p0).cross(p2 - p0).normalize_or_zero();
    let mut ns = ng;
    if !mesh.normals.is_empty() {
        let [n0, n1, n2] = indices.map(|i| mesh.normals[i as usize]);
        let n = n0 * w + n1 * u + n2 * v;
        let length2 = n.length_squared();
        if length2 > 0.0 && length2.is_finite() {
            ns = n / length2.sqrt();
            // Vertex normals say which side is the front.
            if ng.dot(ns) < 0.0 {
                ng = -ng;
            }
        }
    }
    // [pbrt 6.8.5] bounds the interpolation by γ(7)·(|w p0| + |u p1| + |v p2|). A back end computes the distance
    // to the plane from differences to the corners, so their size counts, however small their weight.
    Surface { p: a + b + c, p_error: p0.abs().max(p1.abs()).max(p2.abs()) * gamma(12), ng, ns }
}

/// The point of a sphere at or near `p`, moved onto the sphere.
pub(super) fn sphere_point(center: Vec3, radius: f32, inward: bool, p: Vec3) -> Surface {
    let n = (p - center).normalize_or(Vec3::Z);
    let front = if inward { -n } else { n };
    Surface {
        p: center + n * radius,
        p_error: (center.abs() + Vec3::splat(radius)) * gamma(8),
        ng: front,
        ns: front,
    }
}

/// The point of a disk with coordinates `u`, `v` along `du` and `dv`.
pub(super) fn disk_point(center: Vec3, du: Vec3, dv: Vec3, normal: Vec3, u: f32, v: f32) -> Surface {
    Surface {
        p: center + du * u + dv * v,
        p_error: (center.abs() + du.abs() + dv.abs()) * gamma(8),
        ng: normal,
        ns: normal,
    }
}

/// The derivative of the position by the first texture coordinate, to within a positive factor: the direction
/// that anisotropic materials are oriented along. Zero where it is not defined.
pub(super) fn tangent(shape: &WorldShape, primitive: u32, u: f32, v: f32, p: Vec3) -> Vec3 {
    match shape {
        WorldShape::Mesh(mesh) | WorldShape::Rectangle { mesh, .. } => {
            let indices = mesh.indices[primitive as usize];
            let [p0, p1, p2] = indices.map(|i| mesh.positions[i as usize]);
            if mesh.uvs.is_empty() {
                return p1 - p0;
            }
            let [t0, t1, t2] = indices.map(|i| mesh.uvs[i as usize]);
            let (d1, d2) = (t1 - t0, t2 - t0);
            let determinant = d1.x * d2.y - d1.y * d2.x;
            if determinant == 0.0 {
                return Vec3::ZERO;
            }
            ((p1 - p0) * d2.y - (p2 - p0) * d1.y) * determinant.signum()
        }
        WorldShape::Sphere { center, .. } => {
            let q = p - *center;
            Vec3::new(-q.y, q.x, 0.0)
        }
        WorldShape::Disk { du, dv, .. } => *du * u + *dv * v,
    }
}

/// Texture coordinates of a hit.
pub(super) fn uv(shape: &WorldShape, primitive: u32, u: f32, v: f32, p: Vec3) -> Vec2 {
    match shape {
        WorldShape::Mesh(mesh) | WorldShape::Rectangle { mesh, .. } => {
            if mesh.uvs.is_empty() {
                return Vec2::new(u, v);
            }
            let [t0, t1, t2] = mesh.indices[primitive as usize].map(|i| mesh.uvs[i as usize]);
            t0 * (1.0 - u - v) + t1 * u + t2 * v
        }
        WorldShape::Sphere { center, radius, .. } => {
            let q = (p - *center) / *radius;
            let phi = q.y.atan2(q.x) / TAU;
            Vec2::new(if phi < 0.0 { phi + 1.0 } else { phi }, q.z.clamp(-1.0, 1.0).acos() / PI)
        }
        WorldShape::Disk { .. } => {
            let phi = v.atan2(u) / TAU;
            Vec2::new((u * u + v * v).sqrt(), if phi < 0.0 { phi + 1.0 } else { phi })
        }
    }
}
