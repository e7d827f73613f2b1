//! A round cone: the convex hull of two spheres, of which a curve consists.

use super::primitive::{PrimitiveHit, RayF64};
use crate::math::{DVec3, Vec3};

/// The convex hull of two spheres between two planes. Rays hit it from the outside only.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RoundCone {
    /// The centres.
    pub centers: [Vec3; 2],
    /// The radii: none is negative, one is positive.
    pub radii: [f32; 2],
    /// For each centre, the unit normal of a plane through it, in the direction from the first end to the second. The
    /// part of the hull beyond the plane is not there. Zero if there is no plane.
    pub planes: [Vec3; 2],
    /// Whether a disk in the plane closes the surface at each end.
    pub closed: [bool; 2],
}

/// The overlap of neighbours, in radii.
const OVERLAP: f64 = 1e-9;

/// Returns a box around both spheres, before rounding.
pub(super) fn bounds(RoundCone { centers, radii, .. }: RoundCone) -> (DVec3, DVec3) {
    let [a, b] = [0, 1].map(|i| (centers[i].as_dvec3(), DVec3::splat(radii[i].into())));
    ((a.0 - a.1).min(b.0 - b.1), (a.0 + a.1).max(b.0 + b.1))
}

/// Returns whether no radius is negative and one is positive.
pub(super) fn is_valid(RoundCone { centers, radii, .. }: RoundCone) -> bool {
    centers.iter().all(|c| c.is_finite()) && radii.iter().all(|r| *r >= 0.0) && radii[0].max(radii[1]) > 0.0
}

/// Returns the point where the ray enters the body between the planes, if the
/// surface is there and `accept` returns true. The surface cannot be hit from the inside.
///
/// The spheres with the centres c(v) = p₀ + v·(p₁ − p₀) and the radii r(v) = r₀ + v·(r₁ − r₀) for v in [0, 1] are
/// inside the hull, and each point of its surface is a point of one of them. `u` is the v of that sphere, so that the
/// normal points from c(u) to the hit. For a hit on a disk at an end, `v` is 1, else 0.
///
/// The hull and the planes bound a convex body, so the ray is inside between the last entry and the first exit. The
/// ray enters the hull at the least parameter at which it crosses the first or the last sphere, or the cone that
/// touches both, between its circles of contact. It leaves at the greatest one.
pub(super) fn intersect(
    RoundCone { centers, radii, planes, closed }: RoundCone,
    line: &RayF64,
    accept: impl FnOnce(&PrimitiveHit) -> bool,
) -> Option<PrimitiveHit> {
    let ([p0, p1], [r0, r1]) = (centers.map(|c| c.as_dvec3()), radii.map(f64::from));
    let a = line.d.length_squared();
    // From the origin's foot near the hull, the differences of squares keep their digits.
    let foot = (p0.midpoint(p1) - line.o).dot(line.d) / a;
    let from = line.o + line.d * foot - p0;
    let axis = p1 - p0;
    let (mut entry, mut exit) = ((f64::INFINITY, 0.0), f64::NEG_INFINITY);
    let mut cross = |t: f64, v: f64| {
        if t < entry.0 {
            entry = (t, v);
        }
        exit = exit.max(t);
    };
    for (center, radius, v) in [(DVec3::ZERO, r0, 0.0), (axis, r1, 1.0)] {
        let f = from - center;
        let b = f.dot(line.d);
        let discriminant = radius * radius - (f - line.d * (b / a)).length_squared();
        if discriminant >= 0.0 {
            let half = (a * discriminant).sqrt();
            cross((-b - half) / a, v);
            cross((-b + half) / a, v);
        }
    }
    // The point at parameter t is on the cone if f₂ t² + 2 f₁ t + f₀ = 0, and belongs to the sphere of v = y / slope.
    let length_squared = axis.length_squared();
    let taper = r0 - r1;
    let slope = length_squared - taper * taper;
    // Otherwise one sphere contains the other.
    if slope > 0.0 {
        let (along_d, shifted) = (axis.dot(line.d), axis.dot(from) - r0 * taper);
        let f2 = slope * a - along_d * along_d;
        let f1 = slope * from.dot(line.d) - along_d * shifted;
        let f0 = slope * (from.length_squared() - r0 * r0) - shifted * shifted;
        let discriminant = f1 * f1 - f2 * f0;
        if discriminant >= 0.0 {
            let q = -f1 - discriminant.sqrt().copysign(f1);
            for t in [q / f2, f0 / q] {
                let y = shifted + t * along_d;
                if (0.0..=slope).contains(&y) {
                    cross(t, y / slope);
                }
            }
        }
    }
    let (mut t, mut u) = entry;
    let mut through_plane = None;
    // Neighbours with a common plane overlap a little, so that no ray passes between them.
    let margin = OVERLAP * r0.max(r1);
    for (end, (center, inwards)) in [(DVec3::ZERO, planes[0]), (axis, -planes[1])].into_iter().enumerate() {
        let inwards = inwards.as_dvec3();
        let (speed, height) = (inwards.dot(line.d), (from - center).dot(inwards) + margin);
        let crossing = -height / speed;
        if speed > 0.0 && crossing > t {
            (t, u, through_plane) = (crossing, end as f64, Some(end));
        } else if speed < 0.0 {
            exit = exit.min(crossing);
        } else if speed == 0.0 && height < 0.0 {
            return None;
        }
    }
    // Through a plane without a disk the ray comes from the neighbour, whose inside it cannot hit either.
    if t > exit || through_plane.is_some_and(|end| !closed[end]) {
        return None;
    }
    let v = if through_plane.is_some() { 1.0 } else { 0.0 };
    let hit = PrimitiveHit { t: line.within(foot + t)?, u: u as f32, v };
    accept(&hit).then_some(hit)
}

#[cfg(test)]
mod tests {
    use super::RoundCone;
    use crate::accel::Primitive;
    use crate::math::{Ray, Vec3};
    use std::f32::consts::PI;

    const NONE: [Vec3; 2] = [Vec3::ZERO; 2];

    fn cone(planes: [Vec3; 2]) -> Primitive {
        let (centers, radii) = ([Vec3::ZERO, Vec3::X * 2.0], [0.5, 1.0]);
        Primitive::RoundCone(RoundCone { centers, radii, planes, closed: [true, false] })
    }

    /// Returns the area that rays along −y hit, by a grid.
    fn projected_area(surface: &Primitive) -> f32 {
        let n = 400;
        let at = |i: i32| -1.0 + 5.0 * (i as f32 + 0.5) / n as f32;
        let ray = |i, j| Ray::new(Vec3::new(at(i), 7.0, at(j) - 1.5), -Vec3::Y);
        let hits = (0..n).flat_map(|i| (0..n).map(move |j| (i, j)));
        hits.filter(|&(i, j)| surface.intersect(&ray(i, j)).is_some()).count() as f32 * 25.0 / (n * n) as f32
    }

    /// The outline consists of two arcs and two tangents.
    #[test]
    fn the_projection_is_the_hull_of_two_disks() {
        let sine = (0.5f32 - 1.0) / 2.0;
        let (angle, cosine) = (sine.asin(), (1.0 - sine * sine).sqrt());
        let arcs = 0.5 * (0.25 * (PI + 2.0 * angle) + (PI - 2.0 * angle));
        let area = projected_area(&cone(NONE));
        assert!((area / (arcs + 1.5 * 2.0 * cosine) - 1.0).abs() < 2e-3, "{area}");
        // Between planes across the axis, the outline is cut at both centres.
        let between = projected_area(&cone([Vec3::X; 2]));
        let tangent = |x: f32| (0.5 - sine * x) / cosine;
        let chord = |r: f32, x: f32| (r * r - x * x).max(0.0).sqrt();
        let steps = 2000;
        let outline = (0..steps).map(|i| 2.0 * (i as f32 + 0.5) / steps as f32);
        let height = |x: f32| tangent(x).max(0.0);
        let expected: f32 = outline
            .map(|x| {
                // The tangent ends where the last disk is touched.
                let last = 2.0 + sine;
                2.0 * (if x < last { height(x) } else { chord(1.0, x - 2.0) }) * 2.0 / steps as f32
            })
            .sum();
        assert!((between / expected - 1.0).abs() < 5e-3, "{between} {expected}");
    }

    #[test]
    fn rays_hit_from_the_outside_only() {
        let hit = |o, d| cone(NONE).intersect(&Ray::new(o, d)).map(|h| (h.t, h.u));
        assert_eq!(hit(Vec3::X * -3.0, Vec3::X), Some((2.5, 0.0)));
        assert_eq!(hit(Vec3::X * 5.0, -Vec3::X), Some((2.0, 1.0)));
        assert_eq!(hit(Vec3::X, Vec3::Y), None);
        assert_eq!(hit(Vec3::Y * 3.0, Vec3::Y), None);
        // A sphere inside the other one changes nothing.
        let (centers, radii) = ([Vec3::ZERO, Vec3::X * 0.1], [1.0, 0.2]);
        let inside = Primitive::RoundCone(RoundCone { centers, radii, planes: NONE, closed: [false; 2] });
        assert_eq!(
            inside.intersect(&Ray::new(Vec3::Z * 3.0, -Vec3::Z)).map(|h| (h.t, h.u)),
            Some((2.0, 0.0))
        );
    }

    /// With planes, the first end is closed by a disk and the second one is open to its neighbour.
    #[test]
    fn disks_close_the_ends_of_curves() {
        let surface = cone([Vec3::X; 2]);
        let hit = |o, d| surface.intersect(&Ray::new(o, d)).map(|h| (h.t, h.u, h.v));
        assert_eq!(hit(Vec3::X * -3.0, Vec3::X), Some((3.0, 0.0, 1.0)));
        assert_eq!(hit(Vec3::new(-3.0, 0.6, 0.0), Vec3::X).map(|h| h.2), Some(0.0));
        assert_eq!(hit(Vec3::X * 5.0, -Vec3::X), None);
        assert_eq!(hit(Vec3::new(-0.1, 3.0, 0.0), -Vec3::Y), None);
        assert!(hit(Vec3::new(0.1, 3.0, 0.0), -Vec3::Y).is_some());
    }

    /// The hit is on the sphere that it belongs to, and a ray from there to the outside misses.
    #[test]
    fn hits_are_on_their_spheres_and_rays_leave() {
        let number = |i: i32| (i as f32 * 0.618_034).fract() - 0.5;
        for i in 0..2000 {
            let v = |j: i32| Vec3::new(number(7 * i + j), number(11 * i + j + 3), number(13 * i + j + 5));
            let (centers, radii) = ([v(0), v(1)], [0.3 * number(i).abs(), 0.3 * number(17 * i + 1).abs()]);
            let surface =
                Primitive::RoundCone(RoundCone { centers, radii, planes: NONE, closed: [false; 2] });
            let target = centers[0].lerp(centers[1], 0.5 + number(5 * i));
            let d = v(9) + Vec3::new(0.0, 0.0, 0.01);
            let ray = Ray::new(target - d * 1e3, d);
            let Some(hit) = surface.intersect(&ray) else {
                assert!(radii[0].max(radii[1]) < 1e-3, "the ray is aimed at the axis");
                continue;
            };
            let p = ray.o.as_dvec3() + ray.d.as_dvec3() * f64::from(hit.t);
            let center = centers[0].lerp(centers[1], hit.u).as_dvec3();
            let radius = f64::from(radii[0] + (radii[1] - radii[0]) * hit.u);
            assert!(((p - center).length() - radius).abs() < 1e-4, "{p} {center} {radius}");
            let n = (p - center).normalize().as_vec3();
            let out = Ray::new(center.as_vec3() + n * (radius as f32 + 1e-6), n + v(4) * 0.5);
            assert!(surface.intersect(&out).is_none());
        }
    }
}
