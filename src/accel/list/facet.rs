//! The flat surfaces of a list: parallelograms made of two triangles, and single triangles.

use crate::math::robust::gamma;
use crate::math::{DVec3, Vec3};

/// A triangle with its indices in the assembly.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct ListTriangle {
    pub geometry: u32,
    pub primitive: u32,
    pub corners: [Vec3; 3],
}

/// A parallelogram or half of one. In coordinates relative to its centre, a point r of the plane has the coordinates
/// (r·du, r·dv), which are within ±½ inside the parallelogram.
#[derive(Clone, Debug)]
pub(super) struct ListFacet {
    pub center: Vec3,
    pub normal: Vec3,
    pub du: Vec3,
    pub dv: Vec3,
    /// The error bound of the coordinates for a ray along the normal. For other rays it is divided by the cosine.
    pub margin: f32,
    /// The triangle with s + t < 0, and the other one.
    pub halves: [HalfFacet; 2],
}

/// A triangle of a facet, with its second and third barycentric weights as linear functions of the coordinates.
#[derive(Clone, Copy, Debug)]
pub(super) struct HalfFacet {
    pub triangle: ListTriangle,
    /// u = u[0] + u[1]·s + u[2]·t
    pub u: [f32; 3],
    pub v: [f32; 3],
}

/// The result of [`facet`].
pub(super) enum FacetResult {
    /// Two triangles that make a parallelogram.
    Quad(ListFacet),
    /// A single triangle. The second half repeats the first and is never hit.
    Single(ListFacet),
    /// Too thin for the required precision, or without area, or not a parallelogram.
    Unusable,
}

/// Creates a facet of `first`, and of `second` if the two make a parallelogram. `reach` is the distance from the
/// scene's centre of the farthest ray origin that lanes compute.
pub(super) fn facet(first: ListTriangle, second: Option<ListTriangle>, reach: f32) -> FacetResult {
    let Some(turn) = second.map_or(Some(0), |second| shared_edge(&first, &second)) else {
        return FacetResult::Unusable;
    };
    // a is the corner of `first` that is not shared.
    let [a, b, c] = [0, 1, 2].map(|i| first.corners[(turn + i) % 3].as_dvec3());
    let (e1, e2) = (b - a, c - a);
    let n = e1.cross(e2);
    let n2 = n.length_squared();
    let (du, dv) = (e2.cross(n) / n2, n.cross(e1) / n2);
    let steepness = du.length().max(dv.length()) as f32;
    // The distance to the plane, the slope of the ray and the coordinates have five roundings each. The magnitudes of
    // the summed terms add up to at most 3.4 times `reach`.
    let margin = gamma(40) * 2.0 * reach * steepness;
    // Also false for a triangle without area.
    let usable = n2 > 0.0 && margin <= MAX_MARGIN;
    if !usable {
        return FacetResult::Unusable;
    }
    let corner = |i: usize| [[-0.5, -0.5], [0.5, -0.5], [-0.5, 0.5]][(i + 3 - turn) % 3];
    let half = HalfFacet::new(first, [0, 1, 2].map(corner));
    let make = |other| ListFacet {
        center: (a + 0.5 * (e1 + e2)).as_vec3(),
        normal: n.normalize().as_vec3(),
        du: du.as_vec3(),
        dv: dv.as_vec3(),
        margin,
        halves: [half, other],
    };
    let Some(second) = second else { return FacetResult::Single(make(half)) };
    let place = |p: Vec3| {
        let r = p.as_dvec3() - a - 0.5 * (e1 + e2);
        [r.dot(du).round_to_corner(), r.dot(dv).round_to_corner()]
    };
    FacetResult::Quad(make(HalfFacet::new(second, second.corners.map(place))))
}

/// The widest useful margin: wider ones would send too many rays to the exact test.
const MAX_MARGIN: f32 = 0.02;

trait RoundToCorner {
    /// Returns −½ or ½, whichever is nearer.
    fn round_to_corner(self) -> f32;
}

impl RoundToCorner for f64 {
    fn round_to_corner(self) -> f32 {
        0.5f32.copysign(self as f32)
    }
}

impl HalfFacet {
    /// Creates a half of a triangle whose corners have the given coordinates.
    fn new(triangle: ListTriangle, at: [[f32; 2]; 3]) -> Self {
        let [p, q, r] = at;
        let (q, r) = ([q[0] - p[0], q[1] - p[1]], [r[0] - p[0], r[1] - p[1]]);
        let det = q[0] * r[1] - q[1] * r[0];
        let through = |x: f32, y: f32| [-(x * p[0] + y * p[1]) / det, x / det, y / det];
        HalfFacet { triangle, u: through(r[1], -r[0]), v: through(-q[1], q[0]) }
    }
}

/// Returns the index of the corner of `first` that is not in `second`, if the two triangles share the other two
/// corners and make a parallelogram.
fn shared_edge(first: &ListTriangle, second: &ListTriangle) -> Option<usize> {
    (0..3).find(|&turn| {
        let [a, b, c] = [0, 1, 2].map(|i| first.corners[(turn + i) % 3]);
        let others: Vec<Vec3> = second.corners.into_iter().filter(|p| *p != b && *p != c).collect();
        let [d] = others[..] else { return false };
        let exact: DVec3 = b.as_dvec3() + c.as_dvec3() - a.as_dvec3();
        // The tolerance is the rounding error of the corners.
        let rounding = a.abs().max(b.abs()).max(c.abs()).max(d.abs()) * (4.0 * f32::EPSILON);
        (d.as_dvec3() - exact).abs().cmple(rounding.as_dvec3()).all()
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn triangle(corners: [Vec3; 3]) -> ListTriangle {
        ListTriangle { geometry: 0, primitive: 0, corners }
    }

    #[test]
    fn halves_know_their_barycentric_weights_however_their_corners_are_ordered() {
        let [a, b, c] = [Vec3::new(1.0, 0.0, 2.0), Vec3::new(3.0, 0.5, 2.0), Vec3::new(1.0, 1.0, 4.0)];
        let d = b + c - a;
        for turn in 0..3 {
            for back in 0..3 {
                let turned = |corners: [Vec3; 3], by: usize| [0, 1, 2].map(|i| corners[(i + by) % 3]);
                let pair = [triangle(turned([a, b, c], turn)), triangle(turned([d, c, b], back))];
                let FacetResult::Quad(quad) = facet(pair[0], Some(pair[1]), 10.0) else { panic!() };
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
            assert!(matches!(facet(first, Some(second), 10.0), FacetResult::Unusable));
        }
        let needle = triangle([Vec3::ZERO, Vec3::X, Vec3::new(0.5, 1e-5, 0.0)]);
        assert!(matches!(facet(needle, None, 10.0), FacetResult::Unusable));
        assert!(matches!(facet(triangle([Vec3::X; 3]), None, 10.0), FacetResult::Unusable));
    }
}
