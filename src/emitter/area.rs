//! Area emitters: emitting surfaces.

use super::spherical_cap::SphericalCap;
use super::spherical_rectangle::{Rectangle, RectanglePointX16, RectangleX16};
use super::{Emission, EmitterSample, LightRay, ShadowTarget, centre};
use crate::accel::{Hit, Instance, NO_INSTANCE, valid_triangle};
use crate::color::Rgb;
use crate::math::ray::{end_error, offset_origin, plane_error};
use crate::math::robust::gamma;
use crate::math::{Frame, Ray, Vec2, Vec3, Vec3x16, f32x16};
use crate::sampling::mis::area_to_solid_angle;
use crate::sampling::{Distribution1D, Distribution2D, warp};
use crate::shape::{Placement, TriangleMesh, WorldShape};
use crate::texture::TexturePoint;
use std::f32::consts::PI;
use std::sync::Arc;

/// A shape whose front side emits the same radiance in every direction.
pub struct AreaEmitter {
    pub(super) surface: EmitterSurface,
    pub(super) emission: Emission,
    area: f64,
    /// The shape, for texture coordinates; only with a texture.
    shape: Option<WorldShape>,
    /// The sampling density over the texture coordinates of a textured rectangle.
    light: Option<Distribution2D>,
    /// The motion of the shape's space, if it is not world space.
    pub(super) motion: Option<Instance>,
}

/// The surface, which determines how points on it are sampled.
pub(super) enum EmitterSurface {
    /// Uniform in solid angle.
    Rectangle(RectangleSurface),
    /// Uniform in solid angle from outside, uniform in area from inside.
    Sphere { center: Vec3, radius: f32, inward: bool },
    /// Uniform in area.
    Disk { center: Vec3, du: Vec3, dv: Vec3, normal: Vec3 },
    /// Uniform in area.
    Cylinder { p0: Vec3, axis: Vec3, side: [Vec3; 2], inward: bool },
    /// A triangle in proportion to its area, with an equal minimum share for each, then uniform in the triangle.
    Mesh {
        mesh: Arc<TriangleMesh>,
        triangles: Distribution1D,
        /// The centre of mass of a planar mesh.
        centre: Option<Vec3>,
    },
}

/// The data needed to sample a rectangle.
pub(super) struct RectangleSurface {
    pub rectangle: Rectangle,
    /// Unit normal of the front side.
    pub normal: Vec3,
    /// Bound on the distance of a sampled point from the surface.
    pub error: f32,
    /// Density per unit area of uniform sampling.
    pub inverse_area: f32,
}

/// A point on an emitting surface that a ray hit.
#[derive(Clone, Copy, Debug)]
pub struct EmitterHit {
    /// Position in world space.
    pub p: Vec3,
    /// Unit geometric normal.
    pub n: Vec3,
    /// The hit.
    pub hit: Hit,
    /// The position in the shape's space.
    pub local: Vec3,
    /// Time in [0, 1] over the shutter interval.
    pub time: f32,
}

/// A sampled point on an emitting surface.
pub(super) struct SampledPoint {
    pub p: Vec3,
    /// Bound on the distance of `p` from the surface.
    pub error: f32,
    /// Unit normal of the front side.
    pub n: Vec3,
    pub pdf: PointDensity,
    place: PointLocation,
    /// The vector from the receiver to the point, if it is known more precisely than as the difference of the two.
    to: Option<Vec3>,
}

/// The location of a sampled point on its surface.
pub(super) enum PointLocation {
    /// At the coordinates of a hit.
    Hit(Hit),
    /// At texture coordinates.
    Uv(Vec2),
}

/// The density of a sampled point.
#[derive(Clone, Copy)]
pub(super) enum PointDensity {
    PerSolidAngle(f32),
    PerArea(f32),
}

impl AreaEmitter {
    /// Returns whether points are sampled uniformly in the solid angle that the surface subtends.
    pub fn is_sampled_by_solid_angle(&self) -> bool {
        match self.surface {
            EmitterSurface::Rectangle(_) => true,
            EmitterSurface::Sphere { inward, .. } => !inward,
            EmitterSurface::Disk { .. } | EmitterSurface::Cylinder { .. } | EmitterSurface::Mesh { .. } => {
                false
            }
        }
    }

    /// Creates the emitter of `shape`; `None` if the shape has no area. `motion` is that of the shape's space.
    pub fn new(shape: &WorldShape, emission: Emission, motion: Option<Instance>) -> Option<Self> {
        let (surface, area) = match shape {
            WorldShape::Rectangle { mesh, corner, edge_x, edge_y, normal } => {
                match Rectangle::new(*corner, *edge_x, *edge_y) {
                    Some(rectangle) => {
                        let area = edge_x.as_dvec3().cross(edge_y.as_dvec3()).length();
                        let reach = corner.abs() + edge_x.abs() + edge_y.abs();
                        let error = plane_error(reach * gamma(8), *normal);
                        let inverse_area = (1.0 / area) as f32;
                        let normal = *normal;
                        let surface = RectangleSurface { rectangle, normal, error, inverse_area };
                        (EmitterSurface::Rectangle(surface), area)
                    }
                    None => mesh_surface(mesh)?,
                }
            }
            WorldShape::Mesh(mesh) => mesh_surface(mesh)?,
            WorldShape::Sphere { center, radius, inward, .. } => {
                let area = 4.0 * std::f64::consts::PI * f64::from(*radius).powi(2);
                (EmitterSurface::Sphere { center: *center, radius: *radius, inward: *inward }, area)
            }
            WorldShape::Disk { center, du, dv, normal } => {
                let area = std::f64::consts::PI * du.as_dvec3().cross(dv.as_dvec3()).length();
                (EmitterSurface::Disk { center: *center, du: *du, dv: *dv, normal: *normal }, area)
            }
            WorldShape::Cylinder { p0, p1, side, inward } => {
                let axis = *p1 - *p0;
                let around = std::f64::consts::TAU * side[0].as_dvec3().length();
                let area = around * axis.as_dvec3().length();
                (EmitterSurface::Cylinder { p0: *p0, axis, side: *side, inward: *inward }, area)
            }
            WorldShape::Curves(_) | WorldShape::SdfGrid(_) => return None,
        };
        let textured = emission.constant().is_none();
        let light = match (&surface, &emission) {
            (EmitterSurface::Rectangle(_), Emission::Texture(texture)) => texture.uv_distribution(),
            _ => None,
        };
        let shape = textured.then(|| shape.clone());
        // The density must be representable in `f32`.
        let density = (1.0 / area) as f32;
        (density > 0.0 && density.is_finite()).then_some(AreaEmitter {
            surface,
            emission,
            area,
            shape,
            light,
            motion,
        })
    }

    /// Returns the emitted radiance at a point of the surface, given in the shape's space.
    #[inline]
    pub fn radiance(&self, hit: &Hit, p: Vec3) -> Rgb {
        match (&self.emission, &self.shape) {
            (Emission::Constant(radiance), _) => *radiance,
            (emission, Some(shape)) => emission.eval(&shape.texture_point(hit, p)),
            (Emission::Texture(_), None) => Rgb::BLACK,
        }
    }

    fn radiance_at(&self, point: &SampledPoint) -> Rgb {
        match &point.place {
            PointLocation::Hit(hit) => self.radiance(hit, point.p),
            PointLocation::Uv(uv) => self.emission.eval(&TexturePoint::at(*uv)),
        }
    }

    /// Returns the area of the surface, in the shape's space.
    pub fn area(&self) -> f64 {
        self.area
    }

    /// Returns an estimate of the emitted power, W.
    pub fn power(&self) -> Rgb {
        self.emission.mean() * (self.area * std::f64::consts::PI) as f32
    }

    /// Returns the surface and its radiance, if it is a rectangle at rest with constant radiance.
    #[inline]
    pub(super) fn rectangle(&self) -> Option<(&RectangleSurface, Rgb)> {
        match (&self.surface, self.emission.constant(), &self.motion) {
            (EmitterSurface::Rectangle(rectangle), Some(radiance), None) => Some((rectangle, radiance)),
            _ => None,
        }
    }

    /// Returns centre, radius and radiance of a sphere at rest that emits outward with constant radiance.
    #[inline]
    pub(super) fn sphere(&self) -> Option<(Vec3, f32, Rgb)> {
        match (&self.surface, self.emission.constant(), &self.motion) {
            (EmitterSurface::Sphere { center, radius, inward: false }, Some(radiance), None) => {
                Some((*center, *radius, radiance))
            }
            _ => None,
        }
    }

    /// Samples a point as seen from `from`, at a time in [0, 1] over the shutter interval.
    #[inline]
    pub fn sample(&self, from: Vec3, u: Vec2, time: f32) -> Option<EmitterSample> {
        let (point, radiance) = self.sample_at(Some(from), u, time)?;
        let to = point.to.unwrap_or(point.p - from);
        let distance_squared = to.length_squared();
        let wi = to / distance_squared.sqrt();
        let cos = -wi.dot(point.n);
        // NaN if `from` is the point itself.
        if cos.is_nan() || cos <= 0.0 {
            return None;
        }
        let pdf = match point.pdf {
            PointDensity::PerSolidAngle(pdf) => pdf,
            PointDensity::PerArea(pdf) => area_to_solid_angle(pdf, distance_squared, cos),
        };
        Some(EmitterSample {
            wi,
            target: ShadowTarget::Point(offset_origin(point.p, point.error + end_error(to), point.n, -wi)),
            radiance,
            pdf,
            delta: false,
            cosine: cos,
        })
    }

    /// Samples a point in world space at a time, and evaluates its radiance.
    pub(super) fn sample_at(&self, from: Option<Vec3>, u: Vec2, time: f32) -> Option<(SampledPoint, Rgb)> {
        let Some(motion) = &self.motion else {
            let point = self.sample_point(from, u)?;
            let radiance = self.radiance_at(&point);
            return Some((point, radiance));
        };
        let point = self.sample_point(None, u)?;
        let radiance = self.radiance_at(&point);
        let placed = Placement::new(motion, time);
        let PointDensity::PerArea(pdf) = point.pdf else { return None };
        let world = placed.surface(motion, time, point.p, point.error, point.n);
        let pdf = PointDensity::PerArea(pdf / placed.stretch(point.n));
        let SampledPoint { place, to, .. } = point;
        Some((SampledPoint { p: world.p, error: world.error, n: world.n, pdf, place, to }, radiance))
    }

    /// Returns the density per unit solid angle with which [`sample`](Self::sample) samples a point of the surface as
    /// seen from `from`.
    #[inline]
    pub fn pdf(&self, from: Vec3, at: &EmitterHit) -> f32 {
        let to = at.p - from;
        let distance_squared = to.length_squared();
        // The point itself is never sampled.
        if distance_squared == 0.0 {
            return 0.0;
        }
        let cos = to.dot(at.n) / distance_squared.sqrt();
        if let Some(motion) = &self.motion {
            let placed = Placement::new(motion, at.time);
            let pdf = self.density(&at.hit, at.local) / placed.stretch(placed.local_normal(at.n));
            return area_to_solid_angle(pdf, distance_squared, cos);
        }
        match &self.surface {
            EmitterSurface::Rectangle(surface) if self.light.is_none() => {
                let rectangle = RectangleX16::splat(&surface.rectangle);
                let projection = rectangle.projected_from(Vec3x16::splat(from));
                if projection.resolved().to_bitmask() & 1 == 1 {
                    return 1.0 / projection.solid_angle().as_array()[0];
                }
            }
            EmitterSurface::Sphere { center, radius, inward } => {
                if let Some(projection) = SphericalCap::new(*center, *radius, *inward, from) {
                    return projection.pdf();
                }
            }
            _ => {}
        }
        area_to_solid_angle(self.density(&at.hit, at.local), distance_squared, cos)
    }

    /// Samples a ray with a uniform point on the area and a cosine-distributed direction.
    pub fn sample_ray(&self, u_point: Vec2, u_direction: Vec2, time: f32) -> Option<LightRay> {
        let (point, radiance) = self.sample_at(None, u_point, time)?;
        let PointDensity::PerArea(pdf) = point.pdf else { return None };
        let d = Frame::from_normal(point.n).to_world(warp::square_to_cosine_hemisphere(u_direction));
        let o = offset_origin(point.p, point.error, point.n, point.n);
        let power = radiance * (PI / pdf);
        let ray = Ray { o, t_max: f32::INFINITY, d, time };
        Some(LightRay { ray, power, cosine: d.dot(point.n) })
    }

    /// Samples a ray as [`sample_ray`](Self::sample_ray) does, with the same density. For a sphere at rest without a
    /// texture, however, the world-space direction depends on `u_direction` only: it is uniform over all directions,
    /// and `u_point` selects a point on the disk that the sphere presents in that direction.
    pub fn sample_ray_by_direction(&self, u_point: Vec2, u_direction: Vec2, time: f32) -> Option<LightRay> {
        let by_direction = self.sample_ray_towards(u_point, warp::square_to_sphere(u_direction), time);
        by_direction.or_else(|| self.sample_ray(u_point, u_direction, time))
    }

    /// Samples a ray in the world-space direction `d`. Its power is that of a uniform density over all directions.
    /// Returns `None` for all but spheres at rest without a texture.
    pub fn sample_ray_towards(&self, u_point: Vec2, d: Vec3, time: f32) -> Option<LightRay> {
        let (center, radius, radiance) = self.sphere()?;
        let disk = warp::square_to_disk(u_point);
        let height = (1.0 - disk.length_squared()).max(0.0).sqrt();
        let n = Frame::from_normal(d).to_world(disk.extend(height)).normalize();
        let error = plane_error((center.abs() + Vec3::splat(radius)) * gamma(8), n);
        let o = offset_origin(center + n * radius, error, n, n);
        let ray = Ray { o, t_max: f32::INFINITY, d, time };
        Some(LightRay { ray, power: radiance * (PI / self.uniform()), cosine: d.dot(n) })
    }

    /// Returns the density per unit area of uniform sampling.
    fn uniform(&self) -> f32 {
        (1.0 / self.area) as f32
    }

    /// Returns the density per unit area of a point, for surfaces not sampled by solid angle.
    fn density(&self, hit: &Hit, p: Vec3) -> f32 {
        match (&self.surface, &self.light, &self.shape) {
            // Rounding may give coordinates outside the unit square at its border.
            (_, Some(light), Some(shape)) => {
                self.uniform() * light.pdf(shape.uv(hit, p).clamp(Vec2::ZERO, Vec2::ONE))
            }
            (EmitterSurface::Mesh { mesh, triangles, .. }, ..) => {
                density_of_triangle(mesh, triangles, hit.primitive as usize)
            }
            _ => self.uniform(),
        }
    }

    /// Samples a point as seen from another point or, without one, uniformly in area.
    fn sample_point(&self, from: Option<Vec3>, u: Vec2) -> Option<SampledPoint> {
        let uniform = PointDensity::PerArea(self.uniform());
        Some(match &self.surface {
            EmitterSurface::Rectangle(surface) => {
                let (p, to, pdf) = match from {
                    _ if self.light.is_some() => {
                        let (uv, pdf) = self.light.as_ref()?.sample(u)?;
                        (surface.rectangle.point(uv), None, PointDensity::PerArea(self.uniform() * pdf))
                    }
                    None => (surface.rectangle.point(u), None, uniform),
                    Some(from) => {
                        let rectangle = RectangleX16::splat(&surface.rectangle);
                        let projection = rectangle.projected_from(Vec3x16::splat(from));
                        let RectanglePointX16 { p, to } =
                            projection.sample([f32x16::splat(u.x), f32x16::splat(u.y)]);
                        let (p, to) = (p.lane(0), Some(to.lane(0)));
                        match projection.resolved().to_bitmask() & 1 {
                            1 => (
                                p,
                                to,
                                PointDensity::PerSolidAngle(1.0 / projection.solid_angle().as_array()[0]),
                            ),
                            _ => (p, to, uniform),
                        }
                    }
                };
                let place = PointLocation::Uv(surface.rectangle.fractions(p));
                SampledPoint { p, error: surface.error, n: surface.normal, pdf, place, to }
            }
            EmitterSurface::Sphere { center, radius, inward } => {
                let projection = from.and_then(|from| SphericalCap::new(*center, *radius, *inward, from));
                let (n, to, pdf) = match projection {
                    Some(projection) => {
                        let (n, to) = projection.sample(u);
                        (n, Some(to), PointDensity::PerSolidAngle(projection.pdf()))
                    }
                    None => (warp::square_to_sphere(u), None, uniform),
                };
                SampledPoint {
                    p: *center + n * *radius,
                    error: plane_error((center.abs() + Vec3::splat(*radius)) * gamma(8), n),
                    n: if *inward { -n } else { n },
                    pdf,
                    place: PointLocation::Hit(hit_at(0, 0.0, 0.0)),
                    to,
                }
            }
            EmitterSurface::Disk { center, du, dv, normal } => {
                let d = warp::square_to_disk(u);
                SampledPoint {
                    p: *center + *du * d.x + *dv * d.y,
                    error: plane_error((center.abs() + du.abs() + dv.abs()) * gamma(8), *normal),
                    n: *normal,
                    pdf: uniform,
                    place: PointLocation::Hit(hit_at(0, d.x, d.y)),
                    to: None,
                }
            }
            EmitterSurface::Cylinder { p0, axis, side, inward } => {
                let (sin, cos) = (u.x * std::f32::consts::TAU).sin_cos();
                let out = side[0] * cos + side[1] * sin;
                let n = out.normalize();
                let reach = p0.abs() + axis.abs() + side[0].abs() + side[1].abs();
                SampledPoint {
                    p: *p0 + *axis * u.y + out,
                    error: plane_error(reach * gamma(10), n),
                    n: if *inward { -n } else { n },
                    pdf: uniform,
                    place: PointLocation::Hit(hit_at(0, u.x, u.y)),
                    to: None,
                }
            }
            EmitterSurface::Mesh { mesh, triangles, .. } => {
                let choice = triangles.sample(u.x)?;
                let b = warp::square_to_triangle(Vec2::new(choice.u, u.y));
                let [p0, p1, p2] = mesh.triangle(choice.index);
                let n = front_of(mesh, choice.index);
                SampledPoint {
                    p: p0 * (1.0 - b.x - b.y) + p1 * b.x + p2 * b.y,
                    error: plane_error(p0.abs().max(p1.abs()).max(p2.abs()) * gamma(10), n),
                    n,
                    pdf: PointDensity::PerArea(density_of_triangle(mesh, triangles, choice.index)),
                    place: PointLocation::Hit(hit_at(choice.index as u32, b.x, b.y)),
                    to: None,
                }
            }
        })
    }
}

/// Creates a hit for coordinates on a surface, without a ray.
fn hit_at(primitive: u32, u: f32, v: f32) -> Hit {
    Hit { t: 0.0, u, v, geometry: 0, primitive, instance: NO_INSTANCE }
}

/// Returns the area of a triangle of a mesh; 0 for a triangle that no ray can hit.
fn area_of_triangle(mesh: &TriangleMesh, i: usize) -> f64 {
    valid_triangle(&mesh.positions, mesh.indices[i]).map_or(0.0, |corners| {
        let [a, b, c] = corners.map(Vec3::as_dvec3);
        0.5 * (b - a).cross(c - a).length()
    })
}

/// Returns the density per unit area of a point of triangle `i`: the probability of choosing the triangle divided by
/// its area.
fn density_of_triangle(mesh: &TriangleMesh, triangles: &Distribution1D, i: usize) -> f32 {
    match triangles.pmf(i) {
        0.0 => 0.0,
        probability => (f64::from(probability) / area_of_triangle(mesh, i)) as f32,
    }
}

/// The fraction of the samples that is distributed equally over the triangles, regardless of their areas. The largest
/// triangle may face away from the surfaces that others illuminate.
const UNIFORM_FRACTION: f64 = 0.1;

fn mesh_surface(mesh: &Arc<TriangleMesh>) -> Option<(EmitterSurface, f64)> {
    let areas: Vec<f64> = (0..mesh.indices.len()).map(|i| area_of_triangle(mesh, i)).collect();
    let area: f64 = areas.iter().sum();
    let each = area / Distribution1D::count(&areas).max(1) as f64;
    let share = |area: &f64| {
        if *area > 0.0 { (1.0 - UNIFORM_FRACTION) * area + UNIFORM_FRACTION * each } else { 0.0 }
    };
    let triangles = Distribution1D::new(&areas.iter().map(share).collect::<Vec<_>>());
    let centre = centre::of_plane(mesh, &areas);
    (!triangles.is_empty()).then(|| (EmitterSurface::Mesh { mesh: mesh.clone(), triangles, centre }, area))
}

/// Returns the unit normal of a triangle, on the side of its vertex normals if it has them.
pub(super) fn front_of(mesh: &TriangleMesh, i: usize) -> Vec3 {
    let [a, b, c] = mesh.triangle(i);
    let n = (b - a).cross(c - a).normalize_or_zero();
    let against = !mesh.normals.is_empty() && {
        let [i0, i1, i2] = mesh.indices[i].map(|v| mesh.normals[v as usize]);
        (i0 + i1 + i2).dot(n) < 0.0
    };
    if against { -n } else { n }
}
