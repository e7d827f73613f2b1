//! A cell of a grid of signed distances: the isosurface of a trilinear function in a box.

use super::primitive::{PrimitiveHit, RayF64};
use crate::math::{DVec3, Vec3};

/// The points of a box where the trilinear function of the values at its corners is zero.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SdfCell {
    /// The corner at (0, 0, 0).
    pub corner: Vec3,
    /// The vector to the opposite corner, at (1, 1, 1). No component is zero.
    pub size: Vec3,
    /// The values at the corners; that of (x, y, z) is at x + 2y + 4z.
    pub values: [f32; 8],
}

/// The roundings of a corner by which neighbours overlap, so that no ray passes between them.
const OVERLAP: f64 = 4.0 * f32::EPSILON as f64;

impl SdfCell {
    /// Returns the value and the gradient in local coordinates at a point in local coordinates.
    pub fn value(&self, p: DVec3) -> (f64, DVec3) {
        let v = self.values.map(f64::from);
        // Along x, then y, then z: the value, and its derivatives.
        let x = [0, 2, 4, 6].map(|i| (v[i] + (v[i + 1] - v[i]) * p.x, v[i + 1] - v[i]));
        let y = [0, 2].map(|i| {
            let [(a, da), (b, db)] = [x[i], x[i + 1]];
            (a + (b - a) * p.y, da + (db - da) * p.y, b - a)
        });
        let [(a, dxa, dya), (b, dxb, dyb)] = y;
        (a + (b - a) * p.z, DVec3::new(dxa + (dxb - dxa) * p.z, dya + (dyb - dya) * p.z, b - a))
    }

    /// Converts a point to local coordinates.
    pub fn local(&self, p: DVec3) -> DVec3 {
        (p - self.corner.as_dvec3()) / self.size.as_dvec3()
    }
}

/// Returns the box with its overlap, before rounding.
pub(super) fn bounds(SdfCell { corner, size, .. }: SdfCell) -> (DVec3, DVec3) {
    let (a, b) = (corner.as_dvec3(), corner.as_dvec3() + size.as_dvec3());
    let overlap = (a.abs().max(b.abs())) * OVERLAP;
    (a.min(b) - overlap, a.max(b) + overlap)
}

/// Returns whether the box has a volume, and the function has finite values of both signs.
pub(super) fn is_valid(SdfCell { size, values, .. }: SdfCell) -> bool {
    let (below, above) = (values.iter().any(|v| *v < 0.0), values.iter().any(|v| *v >= 0.0));
    size.cmpne(Vec3::ZERO).all() && values.iter().all(|v| v.is_finite()) && below && above
}

/// Returns the nearest hit that `accept` takes. Along a ray, the function is a cubic polynomial. [Hansson-Söderlund et
/// al. 2022, section 3]
pub(super) fn intersect(
    cell: &SdfCell,
    line: &RayF64,
    accept: impl FnMut(&PrimitiveHit) -> bool,
) -> Option<PrimitiveHit> {
    let (low, high) = bounds(*cell);
    let [a, b] = [low, high].map(|corner| (corner - line.o) / line.d);
    // A ray in the plane of a face has 0 / 0 there and may miss. That face is in the overlap, where a neighbour is hit.
    let enter = a.x.min(b.x).max(a.y.min(b.y)).max(a.z.min(b.z));
    let leave = a.x.max(b.x).min(a.y.max(b.y)).min(a.z.max(b.z));
    let beside = (line.d.cmpeq(DVec3::ZERO) & (line.o.cmplt(low) | line.o.cmpgt(high))).any();
    if beside || !(enter < leave && leave > 0.0) {
        return None;
    }
    // From the middle, the polynomial keeps its digits also for a far origin.
    let (middle, half) = (0.5 * (enter + leave), 0.5 * (leave - enter));
    let cubic = along(cell, cell.local(line.o + line.d * middle), line.d * half / cell.size.as_dvec3());
    let hits = roots(cubic).into_iter().flatten().filter_map(|s| line.within(middle + half * s));
    hits.map(|t| PrimitiveHit { t, u: 0.0, v: 0.0 }).find(accept)
}

/// Returns the coefficients, the constant first, of the function at `o + s·d`, in local coordinates.
fn along(cell: &SdfCell, o: DVec3, d: DVec3) -> [f64; 4] {
    let v = cell.values.map(f64::from);
    // Each step interpolates polynomials along one axis: a + (b − a)(o + s·d).
    let step = |a: [f64; 4], b: [f64; 4], o: f64, d: f64| {
        let change = [0, 1, 2, 3].map(|i| b[i] - a[i]);
        let shifted = |i: usize| if i == 0 { 0.0 } else { change[i - 1] * d };
        [0, 1, 2, 3].map(|i| a[i] + change[i] * o + shifted(i))
    };
    let constant = |i: usize| [v[i], 0.0, 0.0, 0.0];
    let x = [0, 2, 4, 6].map(|i| step(constant(i), constant(i + 1), o.x, d.x));
    let y = [0, 2].map(|i| step(x[i], x[i + 1], o.y, d.y));
    step(y[0], y[1], o.z, d.z)
}

/// Returns the roots in [−1, 1] of a cubic polynomial where its sign changes, in increasing order. Between −1, the
/// extrema and 1 it is monotonic.
fn roots(cubic: [f64; 4]) -> [Option<f64>; 3] {
    let [c0, c1, c2, c3] = cubic;
    let at = |s: f64| c0 + s * (c1 + s * (c2 + s * c3));
    let mut ends = [-1.0, 1.0, 1.0, 1.0];
    // The extrema: 3c₃s² + 2c₂s + c₁ = 0.
    let discriminant = c2 * c2 - 3.0 * c3 * c1;
    if discriminant > 0.0 {
        let q = -(c2 + discriminant.sqrt().copysign(c2));
        let (a, b) = (q / (3.0 * c3), c1 / q);
        let mut count = 1;
        for s in [a.min(b), a.max(b)] {
            if s > -1.0 && s < 1.0 {
                ends[count] = s;
                count += 1;
            }
        }
    }
    [0, 1, 2].map(|i| {
        let (low, high) = (ends[i], ends[i + 1]);
        (low < high && (at(low) < 0.0) != (at(high) < 0.0)).then(|| root_between(low, high, at))
    })
}

/// Returns the point in [low, high] where the sign of a monotonic function changes, by bisection and the rule of false
/// position in turns.
fn root_between(mut low: f64, mut high: f64, at: impl Fn(f64) -> f64) -> f64 {
    let (mut below, mut above) = (at(low), at(high));
    let negative = below < 0.0;
    for i in 0..100 {
        let crossing = low + (high - low) * (below / (below - above));
        let s =
            if i % 3 == 2 || !(crossing > low && crossing < high) { 0.5 * (low + high) } else { crossing };
        let value = at(s);
        if value == 0.0 || s <= low || s >= high {
            return s;
        }
        if (value < 0.0) == negative {
            (low, below) = (s, value);
        } else {
            (high, above) = (s, value);
        }
        if high - low < 1e-15 {
            break;
        }
    }
    0.5 * (low + high)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::accel::Primitive;
    use crate::math::Ray;
    use crate::sampling::hash::{pcg3d, to_unit};

    fn number(i: u32, k: u32) -> f64 {
        2.0 * f64::from(to_unit(pcg3d(i, k, 7)[0])) - 1.0
    }

    #[test]
    fn roots_are_where_the_sign_changes() {
        for i in 0..2000 {
            let mut expected = [number(i, 0), number(i, 1), number(i, 2)].map(|r| 1.4 * r);
            expected.sort_by(f64::total_cmp);
            let [a, b, c] = expected;
            let scale = number(i, 3);
            let cubic = [-a * b * c, a * b + b * c + c * a, -(a + b + c), 1.0].map(|k| k * scale);
            let found: Vec<f64> = roots(cubic).into_iter().flatten().collect();
            let expected: Vec<f64> = expected.into_iter().filter(|r| r.abs() < 1.0).collect();
            assert_eq!(found.len(), expected.len(), "{expected:?} {found:?}");
            for (found, expected) in found.iter().zip(&expected) {
                assert!((found - expected).abs() < 1e-6, "{expected} {found}");
            }
        }
        // A line, a parabola and a constant.
        assert_eq!(roots([-0.5, 1.0, 0.0, 0.0]), [Some(0.5), None, None]);
        let [a, b, c] = roots([-0.25, 0.0, 1.0, 0.0]);
        assert!(
            (a.expect("a root") + 0.5).abs() < 1e-15
                && (b.expect("a root") - 0.5).abs() < 1e-15
                && c.is_none()
        );
        assert_eq!(roots([1.0, 0.0, 0.0, 0.0]), [None; 3]);
    }

    /// A hit is a point of the box where the function is zero, and no sign changes before it.
    #[test]
    fn hits_are_the_first_zeros() {
        let mut hits = 0;
        for i in 0..4000 {
            let values = [0, 1, 2, 3, 4, 5, 6, 7].map(|k| number(i, 10 + k) as f32);
            let size = Vec3::new(0.5, if i % 2 == 0 { 2.0 } else { -2.0 }, 1.0);
            let cell = SdfCell { corner: Vec3::new(3.0, -1.0, 0.2), size, values };
            let inside = |k: u32| {
                cell.corner + size * Vec3::from([0, 1, 2].map(|a| 0.5 + 0.5 * number(i, k + a) as f32))
            };
            let (from, to) =
                (inside(20) + Vec3::new(number(i, 26) as f32, 3.0, number(i, 27) as f32), inside(23));
            let ray = Ray::new(from, to - from);
            let sign = |t: f64| {
                let p = cell.local(from.as_dvec3() + ray.d.as_dvec3() * t);
                let within = p.cmpge(DVec3::splat(-1e-9)).all() && p.cmple(DVec3::splat(1.0 + 1e-9)).all();
                within.then(|| cell.value(p).0)
            };
            let until = match Primitive::SdfCell(cell).intersect(&ray) {
                Some(hit) => {
                    hits += 1;
                    let p = cell.local(from.as_dvec3() + ray.d.as_dvec3() * f64::from(hit.t));
                    let (value, gradient) = cell.value(p);
                    let slope = gradient.dot(ray.d.as_dvec3() / size.as_dvec3()).abs();
                    assert!(value.abs() < 1e-5 * (slope + 1.0), "{i} {value}");
                    assert!(p.cmpge(DVec3::splat(-1e-5)).all() && p.cmple(DVec3::splat(1.00001)).all());
                    f64::from(hit.t) - 1e-4
                }
                None => 3.0,
            };
            let signs: Vec<bool> =
                (0..3000).filter_map(|k| sign(until * f64::from(k) / 3000.0)).map(|v| v < 0.0).collect();
            assert!(signs.windows(2).filter(|w| w[0] != w[1]).count() == 0, "{i}");
        }
        assert!(hits > 1500, "{hits}");
    }
}
