//! Flat pieces of a list: parallelograms, made of two triangles each, and triangles that have no partner.

use crate::math::robust::gamma;
use crate::math::{DVec3, Vec3};

/// A triangle by its place in the assembly.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Triangle {
    pub geometry: u32,
    pub primitive: u32,
    pub corners: [Vec3; 3],
}

/// A parallelogram or half of one, in coordinates relative to the parallelogram's centre: a point r of its plane has
/// the coordinates (r·du, r·dv), within ±½ inside.
#[derive(Clone, Debug)]
pub(super) struct Facet {
    pub center: Vec3,
    pub normal: Vec3,
    pub du: Vec3,
    pub dv: Vec3,
    /// By so much the coordinates of a ray along the normal may be off; of others, by this over the cosine.
    pub margin: f32,
    /// The half where the coordinates add up to less than 0, and the other one.
    pub halves: [Half; 2],
}

/// A triangle of a facet, and its second and third barycentric weights as linear functions of the coordinates.
#[derive(Clone, Copy, Debug)]
pub(super) struct Half {
    pub triangle: Triangle,
    /// u = u[0] + u[1]·s + u[2]·t
    pub u: [f32; 3],
    pub v: [f32; 3],
}

/// What a pair of triangles or a single one becomes.
pub(super) enum Made {
    /// Both halves are there.
    Quad(Facet),
    /// The second half repeats the first and is never hit.
    Lone(Facet),
    /// Too thin for the precision that is needed, or without area.
    Refused,
}

/// A facet of `first`, and of `second` if the two make a parallelogram. `reach` is the distance from the
/// scene's middle of the farthest ray origin for which coordinates are computed.
pub(super) fn facet(first: Triangle, second: Option<Triangle>, reach: f32) -> Made {
    let Some(turn) = second.map_or(Some(0), |second| shared_edge(&first, &second)) else {
        return Made::Refused;
    };
    // a is the corner that the triangles do not share.
    let [a, b, c] = [0, 1, 2].map(|i| first.corners[(turn + i) % 3].as_dvec3());
    let (e1, e2) = (b - a, c - a);
    let n = e1.cross(e2);
    let n2 = n.length_squared();
    let (du, dv) = (e2.cross(n) / n2, n.cross(e1) / n2);
    let steepness = du.length().max(dv.length()) as f32;
    // The distance of the plane, the slope of the ray and the coordinates themselves have five roundings each, of sums
    // whose terms' magnitudes add up to at most 3.4 times `reach`.
    let margin = gamma(40) * 2.0 * reach * steepness;
    // False for a triangle without area, too.
    let usable = n2 > 0.0 && margin <= MOST_MARGIN;
    if !usable {
        return Made::Refused;
    }
    let corner = |i: usize| [[-0.5, -0.5], [0.5, -0.5], [-0.5, 0.5]][(i + 3 - turn) % 3];
    let half = Half::new(first, [0, 1, 2].map(corner));
    let make = |other| Facet {
        center: (a + 0.5 * (e1 + e2)).as_vec3(),
        normal: n.normalize().as_vec3(),
        du: du.as_vec3(),
        dv: dv.as_vec3(),
        margin,
        halves: [half, other],
    };
    let Some(second) = second else { return Made::Lone(make(half)) };
    let place = |p: Vec3| {
        let r = p.as_dvec3() - a - 0.5 * (e1 + e2);
        [r.dot(du).round_to_corner(), r.dot(dv).round_to_corner()]
    };
    Made::Quad(make(Half::new(second, second.corners.map(place))))
}

/// The widest margin that is still worth while.
const MOST_MARGIN: f32 = 0.02;

trait RoundToCorner {
    /// −½ or ½, whichever is nearer.
    fn round_to_corner(self) -> f32;
}

impl RoundToCorner for f64 {
    fn round_to_corner(self) -> f32 {
        0.5f32.copysign(self as f32)
    }
}

impl Half {
    /// A triangle whose corners have the given coordinates.
    fn new(triangle: Triangle, at: [[f32; 2]; 3]) -> Self {
        let [p, q, r] = at;
        let (q, r) = ([q[0] - p[0], q[1] - p[1]], [r[0] - p[0], r[1] - p[1]]);
        let det = q[0] * r[1] - q[1] * r[0];
        let through = |x: f32, y: f32| [-(x * p[0] + y * p[1]) / det, x / det, y / det];
        Half { triangle, u: through(r[1], -r[0]), v: through(-q[1], q[0]) }
    }
}

/// Which corner of `first` is not in `second`, if the two share the other two and make a parallelogram.
fn shared_edge(first: &Triangle, second: &Triangle) -> Option<usize> {
    (0..3).find(|&turn| {
        let [a, b, c] = [0, 1, 2].map(|i| first.corners[(turn + i) % 3]);
        let others: Vec<Vec3> = second.corners.into_iter().filter(|p| *p != b && *p != c).collect();
        let [d] = others[..] else { return false };
        let exact: DVec3 = b.as_dvec3() + c.as_dvec3() - a.as_dvec3();
        // As flat, and with sides as parallel, as its rounded corners can be.
        let rounding = a.abs().max(b.abs()).max(c.abs()).max(d.abs()) * (4.0 * f32::EPSILON);
        (d.as_dvec3() - exact).abs().cmple(rounding.as_dvec3()).all()
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn triangle(corners: [Vec3; 3]) -> Triangle {
        Triangle { geometry: 0, primitive: 0, corners }
    }

    #[test]
    fn halves_know_their_barycentric_weights_however_their_corners_are_ordered() {
        let [a, b, c] = [Vec3::new(1.0, 0.0, 2.0), Vec3::new(3.0, 0.5, 2.0), Vec3::new(1.0, 1.0, 4.0)];
        let d = b + c - a;
        for turn in 0..3 {
            for back in 0..3 {
                let turned = |corners: [Vec3; 3], by: usize| [0, 1, 2].map(|i| corners[(i + by) % 3]);
                let pair = [triangle(turned([a, b, c], turn)), triangle(turned([d, c, b], back))];
                let Made::Quad(quad) = facet(pair[0], Some(pair[1]), 10.0) else { panic!() };
                for (half, own) in quad.halves.iter().zip(pair) {
                    assert_eq!(half.triangle, own);
                    let p = own.corners[0] * 0.25 + own.corners[1] * 0.6 + own.corners[2] * 0.15;
                    let (s, t) = ((p - quad.center).dot(quad.du), (p - quad.center).dot(quad.dv));
                    let weight = |w: [f32; 3]| w[0] + w[1] * s + w[2] * t;
                    assert!((weight(half.u) - 0.6).abs() < 1e-6 && (weight(half.v) - 0.15).abs() < 1e-6);
                    assert_eq!(s + t < 0.0, own == pair[0]);
                }
            }
        }
    }

    #[test]
    fn what_is_no_parallelogram_or_too_thin_is_refused() {
        let first = triangle([Vec3::ZERO, Vec3::X, Vec3::Y]);
        for corner in [Vec3::new(1.0, 1.001, 0.0), Vec3::new(1.0, 1.0, 0.001), Vec3::NAN] {
            let second = triangle([Vec3::X, corner, Vec3::Y]);
            assert!(matches!(facet(first, Some(second), 10.0), Made::Refused));
        }
        let needle = triangle([Vec3::ZERO, Vec3::X, Vec3::new(0.5, 1e-5, 0.0)]);
        assert!(matches!(facet(needle, None, 10.0), Made::Refused));
        assert!(matches!(facet(triangle([Vec3::X; 3]), None, 10.0), Made::Refused));
    }
}
