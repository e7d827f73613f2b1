//! Analytic surfaces. Every back end intersects them by the same function, without tessellation.

use super::cylinder;
use super::geometry::is_valid;
use super::round_cone::{self, RoundCone};
use super::sdf_cell::{self, SdfCell};
use crate::math::{Bounds, DVec3, Ray, Vec3};

/// An analytic surface in the space of its group (world space if it is in none).
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Primitive {
    /// A sphere.
    Sphere {
        /// Centre.
        center: Vec3,
        /// Radius, greater than zero.
        radius: f32,
    },
    /// An ellipse: the image of the unit disk under an affine map.
    Disk {
        /// Image of the origin.
        center: Vec3,
        /// Image of the unit disk's x axis.
        du: Vec3,
        /// Image of the unit disk's y axis; need not be perpendicular to `du`.
        dv: Vec3,
    },
    /// An open cylinder, without caps.
    Cylinder {
        /// The end of the axis at height 0.
        p0: Vec3,
        /// The other end of the axis.
        p1: Vec3,
        /// Radius, greater than zero.
        radius: f32,
    },
    /// A segment of a curve, which rays hit from the outside only.
    RoundCone(RoundCone),
    /// The part of an isosurface in one cell of a grid.
    SdfCell(SdfCell),
}

/// A hit on an analytic surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PrimitiveHit {
    /// Ray parameter, `0 < t < t_max`.
    pub t: f32,
    /// First surface coordinate.
    pub u: f32,
    /// Second surface coordinate.
    pub v: f32,
}

/// A ray in double precision.
pub(super) struct RayF64 {
    /// Origin.
    pub o: DVec3,
    /// Direction.
    pub d: DVec3,
    /// Upper bound of the ray parameter.
    pub t_max: f32,
}

impl From<&Ray> for RayF64 {
    #[inline]
    fn from(ray: &Ray) -> Self {
        RayF64 { o: ray.o.as_dvec3(), d: ray.d.as_dvec3(), t_max: ray.t_max }
    }
}

impl RayF64 {
    /// Returns `t` as `f32` if it is within the ray's extent.
    #[inline]
    pub fn within(&self, t: f64) -> Option<f32> {
        let t = t as f32;
        (t > 0.0 && t < self.t_max).then_some(t)
    }
}

impl Primitive {
    /// Returns whether the surface can be hit: all values are finite and within
    /// [`COORDINATE_LIMIT`](super::COORDINATE_LIMIT), the radius is positive, and the axes span a plane or a height.
    pub fn is_valid(&self) -> bool {
        let b = self.bounds();
        let spans = match *self {
            Primitive::Sphere { radius, .. } => radius > 0.0,
            Primitive::Disk { du, dv, .. } => du.as_dvec3().cross(dv.as_dvec3()).length_squared() > 0.0,
            Primitive::Cylinder { p0, p1, radius } => cylinder::is_valid(p0, p1, radius),
            Primitive::RoundCone(cone) => round_cone::is_valid(cone),
            Primitive::SdfCell(cell) => sdf_cell::is_valid(cell),
        };
        spans && is_valid(b.min) && is_valid(b.max)
    }

    /// Returns a bounding box, rounded outwards.
    pub fn bounds(&self) -> Bounds {
        let around = |center: Vec3, extent: DVec3| (center.as_dvec3() - extent, center.as_dvec3() + extent);
        let (min, max) = match *self {
            Primitive::Sphere { center, radius } => around(center, DVec3::splat(radius.into())),
            Primitive::Disk { center, du, dv } => {
                let (du, dv) = (du.as_dvec3(), dv.as_dvec3());
                around(center, (du * du + dv * dv).map(f64::sqrt))
            }
            Primitive::Cylinder { p0, p1, radius } => cylinder::bounds(p0, p1, radius),
            Primitive::RoundCone(cone) => round_cone::bounds(cone),
            Primitive::SdfCell(cell) => sdf_cell::bounds(cell),
        };
        let (min, max) = (min.as_vec3(), max.as_vec3());
        Bounds { min: min.map(f32::next_down), max: max.map(f32::next_up) }
    }

    /// Returns the nearest hit with `0 < t < t_max`, from either side; of a round cone, from the outside.
    ///
    /// For a sphere, `u` and `v` are 0; the caller computes the coordinates from the direction to the hit. For a disk
    /// they are the coordinates of the hit in the basis (du, dv): the point is `center + u·du + v·dv`. For a
    /// cylinder, u in [0, 1) is the angle divided by 2π and v in [0, 1] the relative height, in the frame of
    /// [`cylinder_frame`](super::cylinder_frame). For a round cone, u in [0, 1] is the position on its axis of the
    /// sphere that the hit belongs to, and v is 1 on a disk at an end, else 0. For a cell of a grid, both are 0.
    ///
    /// The computation uses double precision, so the only significant rounding of `t` is that to `f32`. An origin
    /// that was moved off the surface by an error bound therefore lies strictly on one side: a ray that leaves a
    /// sphere to the outside misses it, and a ray that enters it hits the far side.
    #[inline]
    pub fn intersect(&self, ray: &Ray) -> Option<PrimitiveHit> {
        self.intersect_where(ray, |_| true)
    }

    /// Computes [`intersect`](Self::intersect) over the hits for which `accept` returns true. A sphere or cylinder
    /// may be hit on the far side if the near side is rejected. `accept` is called for nearer hits first.
    #[inline]
    pub fn intersect_where(
        &self,
        ray: &Ray,
        accept: impl FnMut(&PrimitiveHit) -> bool,
    ) -> Option<PrimitiveHit> {
        self.intersect_line(&ray.into(), accept)
    }

    /// Computes [`intersect_where`](Self::intersect_where) for a ray in double precision.
    #[inline]
    pub(super) fn intersect_line(
        &self,
        line: &RayF64,
        accept: impl FnMut(&PrimitiveHit) -> bool,
    ) -> Option<PrimitiveHit> {
        match *self {
            Primitive::Sphere { center, radius } => {
                let roots = cylinder::circle(line.o - center.as_dvec3(), line.d, radius.into())?;
                let hits = roots.into_iter().filter_map(|t| line.within(t));
                hits.map(|t| PrimitiveHit { t, u: 0.0, v: 0.0 }).find(accept)
            }
            Primitive::Disk { center, du, dv } => intersect_disk(center, du, dv, line).filter(accept),
            Primitive::Cylinder { p0, p1, radius } => cylinder::intersect((p0, p1, radius), line, accept),
            Primitive::RoundCone(cone) => round_cone::intersect(cone, line, accept),
            Primitive::SdfCell(cell) => sdf_cell::intersect(&cell, line, accept),
        }
    }
}

fn intersect_disk(center: Vec3, du: Vec3, dv: Vec3, line: &RayF64) -> Option<PrimitiveHit> {
    let (du, dv, d) = (du.as_dvec3(), dv.as_dvec3(), line.d);
    let n = du.cross(dv);
    let to_center = center.as_dvec3() - line.o;
    let t = n.dot(to_center) / n.dot(d);
    let t_rounded = line.within(t)?;
    let p = d * t - to_center;
    let n2 = n.length_squared();
    let (u, v) = (p.cross(dv).dot(n) / n2, du.cross(p).dot(n) / n2);
    (u * u + v * v <= 1.0).then_some(PrimitiveHit { t: t_rounded, u: u as f32, v: v as f32 })
}

#[cfg(test)]
mod tests {
    use super::*;

    const UNIT: Primitive = Primitive::Sphere { center: Vec3::ZERO, radius: 1.0 };

    #[test]
    fn a_sphere_is_hit_from_outside_inside_and_not_behind() {
        let hit = |o, d| UNIT.intersect(&Ray::new(o, d)).map(|h| h.t);
        assert_eq!(hit(Vec3::new(0.0, 0.0, -3.0), Vec3::Z), Some(2.0));
        assert_eq!(hit(Vec3::new(0.0, 0.0, -3.0), Vec3::Z * 4.0), Some(0.5));
        assert_eq!(hit(Vec3::ZERO, Vec3::Z), Some(1.0));
        assert_eq!(hit(Vec3::new(0.0, 0.0, 3.0), Vec3::Z), None);
        assert_eq!(hit(Vec3::new(0.0, 1.1, -3.0), Vec3::Z), None);
        let short = Ray { t_max: 2.0, ..Ray::new(Vec3::new(0.0, 0.0, -3.0), Vec3::Z) };
        assert_eq!(UNIT.intersect(&short), None);
    }

    #[test]
    fn an_origin_beside_the_surface_hits_only_what_lies_ahead() {
        let outside = Vec3::new(0.0, 0.0, 1f32.next_up());
        let inside = Vec3::new(0.0, 0.0, 1f32.next_down());
        assert_eq!(UNIT.intersect(&Ray::new(outside, Vec3::Z)), None);
        let across = UNIT.intersect(&Ray::new(inside, -Vec3::Z)).expect("the far side").t;
        assert!((across - 2.0).abs() < 1e-6);
        let out = UNIT.intersect(&Ray::new(inside, Vec3::Z)).expect("the near side").t;
        assert!(out > 0.0 && out < 1e-6);
    }

    #[test]
    fn far_origins_and_near_tangents_keep_their_digits() {
        let o = Vec3::new(1e4, 0.999_999, 0.0);
        let hit = UNIT.intersect(&Ray::new(o, -Vec3::X)).expect("just inside the silhouette");
        let expected = 1e4 - (1.0 - 0.999_999f64.powi(2)).sqrt();
        assert!((f64::from(hit.t) - expected).abs() <= 1e-3);
        assert_eq!(UNIT.intersect(&Ray::new(Vec3::new(1e4, 1.000_001, 0.0), -Vec3::X)), None);
    }

    #[test]
    fn a_skewed_disk_returns_its_own_coordinates() {
        let (center, du, dv) = (Vec3::new(1.0, 2.0, 3.0), Vec3::new(2.0, 0.0, 0.0), Vec3::new(1.0, 1.0, 0.5));
        let disk = Primitive::Disk { center, du, dv };
        let target = center + du * 0.3 - dv * 0.6;
        let ray = Ray::new(target + Vec3::new(0.1, 0.2, 5.0), Vec3::new(-0.1, -0.2, -5.0));
        let hit = disk.intersect(&ray).expect("inside");
        assert!((hit.t - 1.0).abs() < 1e-6 && (hit.u - 0.3).abs() < 1e-5 && (hit.v + 0.6).abs() < 1e-5);
        let beside = Ray::new(center + du * 0.8 + dv * 0.8 + Vec3::Z, -Vec3::Z);
        assert_eq!(disk.intersect(&beside), None);
        let in_plane = Ray::new(center - du * 3.0, du);
        assert_eq!(disk.intersect(&in_plane), None);
    }

    #[test]
    fn bounds_contain_the_surface_and_invalid_surfaces_are_found() {
        let disk = Primitive::Disk { center: Vec3::ONE, du: Vec3::X, dv: Vec3::new(1.0, 1.0, 0.0) };
        let b = disk.bounds();
        assert!(b.max.x >= 1.0 + 2f32.sqrt() && b.max.y >= 2.0 && b.min.z < 1.0 && b.max.z > 1.0);
        assert!(disk.is_valid() && UNIT.is_valid());
        assert!(!Primitive::Disk { center: Vec3::ZERO, du: Vec3::X, dv: Vec3::X }.is_valid());
        assert!(!Primitive::Sphere { center: Vec3::NAN, radius: 1.0 }.is_valid());
        assert!(!Primitive::Sphere { center: Vec3::ZERO, radius: f32::INFINITY }.is_valid());
    }

    #[test]
    fn invalid_rays_hit_nothing() {
        for (o, d) in [(Vec3::NAN, Vec3::X), (Vec3::ZERO, Vec3::NAN), (Vec3::ZERO, Vec3::ZERO)] {
            assert_eq!(UNIT.intersect(&Ray::new(o, d)), None);
            let disk = Primitive::Disk { center: Vec3::Z, du: Vec3::X, dv: Vec3::Y };
            assert_eq!(disk.intersect(&Ray::new(o, d)), None);
        }
    }
}
