//! An open cylinder, without caps.

use super::primitive::{PrimitiveHit, RayF64};
use crate::math::{Bounds, DVec3, Vec3};
use std::f64::consts::TAU;

/// Returns the frame of the cylinder from `p0` to `p1`: unit vectors x and y across the axis, and the unit axis. It
/// is right-handed.
///
/// The point with the coordinates u and v is `p0 + v·(p1 − p0) + radius·(cos(2πu)·x + sin(2πu)·y)`. x and y depend on
/// the axis alone. [Duff 2017]
pub fn cylinder_frame(p0: Vec3, p1: Vec3) -> [DVec3; 3] {
    let (axis, _) = axis(p0, p1);
    let (x, y) = axis.any_orthonormal_pair();
    [x, y, axis]
}

/// Returns the unit axis and the height.
pub(super) fn axis(p0: Vec3, p1: Vec3) -> (DVec3, f64) {
    let along = p1.as_dvec3() - p0.as_dvec3();
    let height = along.length();
    (along * height.recip(), height)
}

/// Returns a box around the cylinder, before rounding.
pub(super) fn bounds(p0: Vec3, p1: Vec3, radius: f32) -> (DVec3, DVec3) {
    let (w, _) = axis(p0, p1);
    // The sine of the angle between the axis and each coordinate axis, without cancellation.
    let sine = DVec3::new(w.y.hypot(w.z), w.z.hypot(w.x), w.x.hypot(w.y));
    let extent = sine * f64::from(radius) * (1.0 + 4.0 * f64::EPSILON);
    let ends = Bounds::of([p0, p1]);
    (ends.min.as_dvec3() - extent, ends.max.as_dvec3() + extent)
}

/// Returns whether the cylinder has a positive length and radius.
pub(super) fn is_valid(p0: Vec3, p1: Vec3, radius: f32) -> bool {
    radius > 0.0 && p0 != p1
}

/// Returns the nearest accepted hit. Solves the circle's quadratic across the axis, then checks the height. The
/// quadratic has the form of [`circle`], which avoids cancellation.
pub(super) fn intersect(
    (p0, p1, radius): (Vec3, Vec3, f32),
    line: &RayF64,
    mut accept: impl FnMut(&PrimitiveHit) -> bool,
) -> Option<PrimitiveHit> {
    let from_p0 = line.o - p0.as_dvec3();
    let (axis, height) = axis(p0, p1);
    let across = |v: DVec3| v - axis * v.dot(axis);
    let roots = circle(across(from_p0), across(line.d), radius.into())?;
    let hit = |t: f64| {
        let p = from_p0 + line.d * t;
        let v = p.dot(axis) / height;
        let t = line.within(t).filter(|_| (0.0..=1.0).contains(&v))?;
        Some(PrimitiveHit { t, u: turn(axis, p), v: v as f32 })
    };
    roots.into_iter().filter_map(hit).find(|hit| accept(hit))
}

/// Returns the coordinate u of a point relative to `p0`, in the frame of [`cylinder_frame`].
pub(super) fn turn(axis: DVec3, p: DVec3) -> f32 {
    let (x, y) = axis.any_orthonormal_pair();
    let turn = p.dot(y).atan2(p.dot(x)) / TAU;
    let u = (if turn < 0.0 { turn + 1.0 } else { turn }) as f32;
    if u < 1.0 { u } else { 0.0 }
}

/// The relative margin of a test of squared distances in double precision that decides without a division.
const CERTAIN: f64 = 1e-13;

/// Returns the parameters at which `f + t·d` has the distance `radius` from the origin, the nearer first.
/// [Haines, Günther, Akenine-Möller 2019, "Precision Improvements for Ray/Sphere Intersection", Eq. 5 and 10]
#[inline]
pub(super) fn circle(f: DVec3, d: DVec3, radius: f64) -> Option<[f64; 2]> {
    let r2 = radius * radius;
    let a = d.length_squared();
    let b = -f.dot(d);
    // Most misses are certain without a division: the rounding error of the difference is far below the margin.
    let f2_a = f.length_squared() * a;
    if f2_a * (1.0 - CERTAIN) - b * b > r2 * a {
        return None;
    }
    let discriminant = r2 - (f + d * (b / a)).length_squared();
    if discriminant.is_nan() || discriminant < 0.0 {
        return None;
    }
    let c = f.length_squared() - r2;
    let q = b + (a * discriminant).sqrt().copysign(b);
    // c/q is the root of smaller magnitude, q/a the other one.
    let (t0, t1) = (c / q, q / a);
    Some(if t0 < t1 { [t0, t1] } else { [t1, t0] })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::accel::Primitive;
    use crate::math::Ray;

    const TUBE: Primitive =
        Primitive::Cylinder { p0: Vec3::new(0.0, 0.0, -1.0), p1: Vec3::new(0.0, 0.0, 3.0), radius: 2.0 };

    #[test]
    fn a_tube_is_hit_from_outside_inside_and_not_at_its_ends() {
        let hit = |o, d| TUBE.intersect(&Ray::new(o, d)).map(|h| h.t);
        assert_eq!(hit(Vec3::new(5.0, 0.0, 0.0), -Vec3::X), Some(3.0));
        assert_eq!(hit(Vec3::ZERO, -Vec3::X * 0.5), Some(4.0));
        assert_eq!(hit(Vec3::new(0.5, 0.5, -9.0), Vec3::Z), None);
        assert_eq!(hit(Vec3::new(5.0, 0.0, 3.1), -Vec3::X), None);
        // The ray enters through the open end and hits the inner side.
        let through = TUBE.intersect(&Ray::new(Vec3::new(-4.0, 0.0, 5.0), Vec3::new(2.0, 0.0, -1.0)));
        assert_eq!(through.map(|h| h.t), Some(3.0));
        assert_eq!(hit(Vec3::new(5.0, 2.1, 0.0), -Vec3::X), None);
    }

    #[test]
    fn coordinates_give_the_point_of_the_hit() {
        let (p0, p1, radius) = (Vec3::new(1.0, 2.0, 3.0), Vec3::new(-1.0, 4.0, 3.5), 0.75);
        let tube = Primitive::Cylinder { p0, p1, radius };
        let [x, y, axis] = cylinder_frame(p0, p1);
        assert!((x.cross(y) - axis).length() < 1e-12);
        for i in 0..100 {
            let (u, v) = (f64::from(i) / 100.0, 0.01 + 0.98 * (f64::from(i) * 0.618).fract());
            let (sin, cos) = (TAU * u).sin_cos();
            let out = x * cos + y * sin;
            let p = p0.as_dvec3().lerp(p1.as_dvec3(), v) + out * f64::from(radius);
            let b = tube.bounds();
            assert!(p.cmpge(b.min.as_dvec3()).all() && p.cmple(b.max.as_dvec3()).all());
            let ray = Ray::new((p + out * 2.0 + axis * 0.3).as_vec3(), (-out * 2.0 - axis * 0.3).as_vec3());
            let hit = tube.intersect(&ray).expect("from outside");
            let off = (f64::from(hit.u) - u).abs();
            assert!(
                off.min(1.0 - off) < 1e-6
                    && (f64::from(hit.v) - v).abs() < 1e-6
                    && (hit.t - 1.0).abs() < 1e-6
            );
        }
    }

    #[test]
    fn a_refused_near_hit_leaves_the_far_one() {
        let ray = Ray::new(Vec3::new(5.0, 0.0, 0.0), -Vec3::X);
        let mut asked = Vec::new();
        let hit = TUBE.intersect_where(&ray, |hit| {
            asked.push(hit.t);
            hit.t > 4.0
        });
        assert_eq!((hit.map(|h| h.t), asked), (Some(7.0), vec![3.0, 7.0]));
        assert_eq!(TUBE.intersect_where(&ray, |_| false), None);
    }

    #[test]
    fn tubes_without_extent_are_invalid_and_bounds_are_tight() {
        let b = TUBE.bounds();
        assert!(b.min.x <= -2.0 && b.min.x > -2.001 && b.max.z >= 3.0 && b.max.z < 3.001);
        assert!(TUBE.is_valid());
        assert!(!Primitive::Cylinder { p0: Vec3::ONE, p1: Vec3::ONE, radius: 1.0 }.is_valid());
        assert!(!Primitive::Cylinder { p0: Vec3::ONE, p1: Vec3::ZERO, radius: 0.0 }.is_valid());
        assert!(!Primitive::Cylinder { p0: Vec3::ONE, p1: Vec3::NAN, radius: 1.0 }.is_valid());
    }
}
