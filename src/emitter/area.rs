//! Emitting surfaces.

use super::spherical_rectangle::{Rectangle, RectangleX16};
use super::{EmitterSample, Target};
use crate::color::Rgb;
use crate::math::ray::{offset_origin, plane_error};
use crate::math::robust::gamma;
use crate::math::{Frame, Vec2, Vec3, Vec3x16, f32x16};
use crate::sampling::mis::area_to_solid_angle;
use crate::sampling::{Distribution1D, warp};
use crate::shape::{TriangleMesh, WorldShape};
use std::sync::Arc;

/// A shape whose front emits the same radiance everywhere and in every direction.
pub struct AreaEmitter {
    surface: Surface,
    radiance: Rgb,
    area: f64,
}

/// How its points are sampled.
enum Surface {
    /// Uniformly in the solid angle.
    Rectangle(RectangleSurface),
    /// Uniformly in the solid angle from outside, in the area from inside.
    Sphere { center: Vec3, radius: f32, inward: bool },
    /// Uniformly in the area.
    Disk { center: Vec3, du: Vec3, dv: Vec3, normal: Vec3 },
    /// Uniformly in the area: a triangle in proportion to its area, then a point in it.
    Mesh { mesh: Arc<TriangleMesh>, triangles: Distribution1D },
}

/// What sampling a rectangle needs.
pub(super) struct RectangleSurface {
    pub rectangle: Rectangle,
    /// Unit normal of the front.
    pub normal: Vec3,
    /// Bound on the distance of a sampled point from the surface.
    pub error: f32,
    /// Density per unit area of a point that is uniform in the area.
    pub inverse_area: f32,
}

/// A point on an emitting surface.
struct SurfacePoint {
    p: Vec3,
    /// Bound on the distance of `p` from the surface.
    error: f32,
    /// Unit normal of the front.
    n: Vec3,
    /// Density per unit solid angle where it is known, else `None`: uniform in the area.
    pdf: Option<f32>,
}

impl AreaEmitter {
    /// The emitter on `shape`; `None` where the shape has no area.
    pub fn new(shape: &WorldShape, radiance: Rgb) -> Option<Self> {
        let (surface, area) = match shape {
            WorldShape::Rectangle { mesh, corner, edge_x, edge_y, normal } => {
                match Rectangle::new(*corner, *edge_x, *edge_y) {
                    Some(rectangle) => {
                        let area = edge_x.as_dvec3().cross(edge_y.as_dvec3()).length();
                        let reach = corner.abs() + edge_x.abs() + edge_y.abs();
                        let error = plane_error(reach * gamma(8), *normal);
                        let inverse_area = (1.0 / area) as f32;
                        let normal = *normal;
                        (
                            Surface::Rectangle(RectangleSurface { rectangle, normal, error, inverse_area }),
                            area,
                        )
                    }
                    None => mesh_surface(mesh)?,
                }
            }
            WorldShape::Mesh(mesh) => mesh_surface(mesh)?,
            WorldShape::Sphere { center, radius, inward } => {
                let area = 4.0 * std::f64::consts::PI * f64::from(*radius).powi(2);
                (Surface::Sphere { center: *center, radius: *radius, inward: *inward }, area)
            }
            WorldShape::Disk { center, du, dv, normal } => {
                let area = std::f64::consts::PI * du.as_dvec3().cross(dv.as_dvec3()).length();
                (Surface::Disk { center: *center, du: *du, dv: *dv, normal: *normal }, area)
            }
        };
        (area > 0.0 && area.is_finite()).then_some(AreaEmitter { surface, radiance, area })
    }

    /// Emitted radiance.
    pub fn radiance(&self) -> Rgb {
        self.radiance
    }

    /// Area of the surface.
    pub fn area(&self) -> f64 {
        self.area
    }

    /// The emitted power, W.
    pub fn power(&self) -> Rgb {
        self.radiance * (self.area * std::f64::consts::PI) as f32
    }

    /// The surface, if it is a rectangle.
    #[inline]
    pub(super) fn rectangle(&self) -> Option<&RectangleSurface> {
        match &self.surface {
            Surface::Rectangle(rectangle) => Some(rectangle),
            _ => None,
        }
    }

    /// Draws a point as seen from `from`.
    #[inline]
    pub fn sample(&self, from: Vec3, u: Vec2) -> Option<EmitterSample> {
        let point = self.sample_point(from, u)?;
        let to = point.p - from;
        let distance_squared = to.length_squared();
        let wi = to / distance_squared.sqrt();
        let cos = -wi.dot(point.n);
        // Not a number where `from` is the point itself.
        if cos.is_nan() || cos <= 0.0 {
            return None;
        }
        let pdf = match point.pdf {
            Some(pdf) => pdf,
            None => area_to_solid_angle((1.0 / self.area) as f32, distance_squared, cos),
        };
        Some(EmitterSample {
            wi,
            target: Target::Point(offset_origin(point.p, point.error, point.n, -wi)),
            radiance: self.radiance,
            pdf,
            delta: false,
        })
    }

    /// The density per unit solid angle with which [`sample`](Self::sample) draws the point `p` with the
    /// unit normal `n` as seen from `from`.
    #[inline]
    pub fn pdf(&self, from: Vec3, p: Vec3, n: Vec3) -> f32 {
        match &self.surface {
            Surface::Rectangle(surface) => {
                let rectangle = RectangleX16::splat(&surface.rectangle);
                let seen = rectangle.seen_from(Vec3x16::splat(from));
                if seen.resolved().to_bitmask() & 1 == 1 {
                    return 1.0 / seen.solid_angle().as_array()[0];
                }
            }
            Surface::Sphere { center, radius, .. } => {
                if let Some(cap) = one_minus_cos(*center, *radius, from) {
                    return warp::square_to_cone_pdf(cap);
                }
            }
            Surface::Disk { .. } | Surface::Mesh { .. } => {}
        }
        let to = p - from;
        let distance_squared = to.length_squared();
        let cos = to.dot(n) / distance_squared.sqrt();
        area_to_solid_angle((1.0 / self.area) as f32, distance_squared, cos)
    }

    fn sample_point(&self, from: Vec3, u: Vec2) -> Option<SurfacePoint> {
        Some(match &self.surface {
            Surface::Rectangle(surface) => {
                let rectangle = RectangleX16::splat(&surface.rectangle);
                let seen = rectangle.seen_from(Vec3x16::splat(from));
                let resolved = seen.resolved().to_bitmask() & 1 == 1;
                SurfacePoint {
                    p: seen.sample([f32x16::splat(u.x), f32x16::splat(u.y)]).lane(0),
                    error: surface.error,
                    n: surface.normal,
                    pdf: resolved.then(|| 1.0 / seen.solid_angle().as_array()[0]),
                }
            }
            Surface::Sphere { center, radius, inward } => {
                let (n, pdf) = match one_minus_cos(*center, *radius, from) {
                    Some(cap) => {
                        (sphere_normal(*center, *radius, from, u, cap), Some(warp::square_to_cone_pdf(cap)))
                    }
                    None => (warp::square_to_sphere(u), None),
                };
                SurfacePoint {
                    p: *center + n * *radius,
                    error: plane_error((center.abs() + Vec3::splat(*radius)) * gamma(8), n),
                    n: if *inward { -n } else { n },
                    pdf,
                }
            }
            Surface::Disk { center, du, dv, normal } => {
                let d = warp::square_to_disk(u);
                SurfacePoint {
                    p: *center + *du * d.x + *dv * d.y,
                    error: plane_error((center.abs() + du.abs() + dv.abs()) * gamma(8), *normal),
                    n: *normal,
                    pdf: None,
                }
            }
            Surface::Mesh { mesh, triangles } => {
                let choice = triangles.sample(u.x)?;
                let b = warp::square_to_triangle(Vec2::new(choice.u, u.y));
                let [p0, p1, p2] = mesh.triangle(choice.index);
                let n = front_of(mesh, choice.index);
                SurfacePoint {
                    p: p0 * (1.0 - b.x - b.y) + p1 * b.x + p2 * b.y,
                    error: plane_error(p0.abs().max(p1.abs()).max(p2.abs()) * gamma(10), n),
                    n,
                    pdf: None,
                }
            }
        })
    }
}

fn mesh_surface(mesh: &Arc<TriangleMesh>) -> Option<(Surface, f64)> {
    let areas: Vec<f64> = (0..mesh.indices.len())
        .map(|i| {
            let [a, b, c] = mesh.triangle(i).map(Vec3::as_dvec3);
            0.5 * (b - a).cross(c - a).length()
        })
        .collect();
    let triangles = Distribution1D::new(&areas);
    let area = areas.iter().filter(|a| a.is_finite()).sum();
    (!triangles.is_empty()).then(|| (Surface::Mesh { mesh: mesh.clone(), triangles }, area))
}

/// The unit normal of a triangle, on the side of its vertex normals where it has them.
fn front_of(mesh: &TriangleMesh, i: usize) -> Vec3 {
    let [a, b, c] = mesh.triangle(i);
    let n = (b - a).cross(c - a).normalize_or_zero();
    let against = !mesh.normals.is_empty() && {
        let [i0, i1, i2] = mesh.indices[i].map(|v| mesh.normals[v as usize]);
        (i0 + i1 + i2).dot(n) < 0.0
    };
    if against { -n } else { n }
}

/// `1 − cos` of the half angle of the cone around a sphere as seen from `from`; `None` from inside.
fn one_minus_cos(center: Vec3, radius: f32, from: Vec3) -> Option<f32> {
    let distance2 = (center - from).as_dvec3().length_squared();
    let radius2 = f64::from(radius).powi(2);
    // A point on the sphere (its origin offset within rounding) counts as inside.
    if distance2 <= radius2 * (1.0 + 1e-6) {
        return None;
    }
    let sin2 = radius2 / distance2;
    // 1 − √(1 − s) = s / (1 + √(1 − s)): no cancellation for distant spheres.
    Some((sin2 / (1.0 + (1.0 - sin2).sqrt())) as f32)
}

/// The outward normal at the point where a direction uniform in the cone meets the sphere. [pbrt 6.2.4]
fn sphere_normal(center: Vec3, radius: f32, from: Vec3, u: Vec2, cap: f32) -> Vec3 {
    let w = warp::square_to_cone(u, cap);
    let to = (center - from).as_dvec3();
    let distance = to.length();
    let sin2_max = (f64::from(radius) / distance).powi(2);
    let sin2 = f64::from(w.x * w.x + w.y * w.y);
    // Angle at the centre between the direction to `from` and the point. [pbrt Eq. 6.8]
    let cos_a = sin2 / sin2_max.sqrt() + f64::from(w.z) * (1.0 - sin2 / sin2_max).max(0.0).sqrt();
    let sin_a = (1.0 - cos_a * cos_a).max(0.0).sqrt() as f32;
    let axis = (to / -distance).as_vec3();
    let frame = Frame::from_normal(axis);
    let planar = Vec2::new(w.x, w.y).normalize_or_zero();
    frame.to_world(Vec3::new(-planar.x * sin_a, -planar.y * sin_a, cos_a as f32)).normalize()
}
