//! The parametrisation of shapes by texture coordinates.

use super::WorldShape;
use crate::accel::Hit;
use crate::math::{Vec2, Vec3};
use crate::texture::TexturePoint;
use std::f32::consts::{PI, TAU};

impl WorldShape {
    /// Returns the derivatives of the position with respect to the texture coordinates; zero where they are
    /// undefined.
    pub fn partials(&self, hit: &Hit, p: Vec3) -> [Vec3; 2] {
        match self {
            WorldShape::Mesh(mesh) | WorldShape::Rectangle { mesh, .. } => {
                let indices = mesh.indices[hit.primitive as usize];
                let [p0, p1, p2] = indices.map(|i| mesh.positions[i as usize]);
                let (e1, e2) = (p1 - p0, p2 - p0);
                if mesh.uvs.is_empty() {
                    return [e1, e2];
                }
                let [t0, t1, t2] = indices.map(|i| mesh.uvs[i as usize]);
                let (d1, d2) = (t1 - t0, t2 - t0);
                let determinant = d1.x * d2.y - d1.y * d2.x;
                if determinant == 0.0 {
                    return [Vec3::ZERO; 2];
                }
                [(e1 * d2.y - e2 * d1.y) / determinant, (e2 * d1.x - e1 * d2.x) / determinant]
            }
            WorldShape::Sphere { center, axes, .. } => {
                let q = axes.transpose() * (p - *center);
                let r = q.x.hypot(q.y);
                let (cos, sin) = if r > 0.0 { (q.x / r, q.y / r) } else { (1.0, 0.0) };
                let du = Vec3::new(-q.y, q.x, 0.0) * TAU;
                let dv = Vec3::new(q.z * cos, q.z * sin, -r) * PI;
                [*axes * du, *axes * dv]
            }
            WorldShape::Disk { du, dv, .. } => {
                let r = hit.u.hypot(hit.v);
                let radial = if r > 0.0 { (*du * hit.u + *dv * hit.v) / r } else { *du };
                [radial, (*dv * hit.u - *du * hit.v) * TAU]
            }
            WorldShape::Cylinder { p0, p1, side, .. } => {
                let (x, y) = ((p - *p0).dot(side[0]), (p - *p0).dot(side[1]));
                let r = x.hypot(y);
                let (cos, sin) = if r > 0.0 { (x / r, y / r) } else { (1.0, 0.0) };
                [(side[1] * cos - side[0] * sin) * TAU, *p1 - *p0]
            }
            WorldShape::Curves(curves) => curves.partials(hit, p),
            WorldShape::SdfGrid(_) => [Vec3::ZERO; 2],
        }
    }

    /// Returns the texture coordinates of a hit.
    pub fn uv(&self, hit: &Hit, p: Vec3) -> Vec2 {
        let (u, v) = (hit.u, hit.v);
        match self {
            WorldShape::Mesh(mesh) | WorldShape::Rectangle { mesh, .. } => {
                if mesh.uvs.is_empty() {
                    return Vec2::new(u, v);
                }
                let [t0, t1, t2] = mesh.indices[hit.primitive as usize].map(|i| mesh.uvs[i as usize]);
                t0 * (1.0 - u - v) + t1 * u + t2 * v
            }
            WorldShape::Sphere { center, radius, axes, .. } => {
                let q = axes.transpose() * (p - *center) / *radius;
                Vec2::new(turn(q.x, q.y), q.z.clamp(-1.0, 1.0).acos() / PI)
            }
            WorldShape::Disk { .. } => Vec2::new((u * u + v * v).sqrt(), turn(u, v)),
            WorldShape::Cylinder { p0, p1, side, .. } => {
                let (q, axis) = (p - *p0, *p1 - *p0);
                let height = q.dot(axis) / axis.length_squared();
                Vec2::new(turn(q.dot(side[0]), q.dot(side[1])), height.clamp(0.0, 1.0))
            }
            WorldShape::Curves(curves) => curves.uv(hit, p),
            WorldShape::SdfGrid(_) => Vec2::ZERO,
        }
    }

    /// Converts a hit to the input of textures.
    pub fn texture_point(&self, hit: &Hit, p: Vec3) -> TexturePoint<'_> {
        let uv = self.uv(hit, p);
        match self {
            WorldShape::Mesh(mesh) => TexturePoint {
                uv,
                attributes: &mesh.attributes,
                face: hit.primitive,
                vertices: mesh.indices[hit.primitive as usize],
                barycentric: Vec2::new(hit.u, hit.v),
            },
            _ => TexturePoint::at(uv),
        }
    }
}

/// Returns the angle between (x, y) and the x axis in turns, in [0, 1].
fn turn(x: f32, y: f32) -> f32 {
    let turn = y.atan2(x) / TAU;
    if turn < 0.0 { turn + 1.0 } else { turn }
}
