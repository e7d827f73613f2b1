//! Curves with a round cross section, such as hair.

use crate::accel::{CurveSegments, Hit};
use crate::math::{DAffine3, Vec2, Vec3};
use std::f32::consts::TAU;
use std::sync::Arc;

/// The greatest distance between a spline and the segments that replace it, relative to the radius.
const TOLERANCE: f32 = 0.01;
/// The greatest number of segments of one cubic piece of a spline.
const MOST_SEGMENTS: usize = 32;

/// A point on the axis of a curve, and the radius there.
pub type CurvePoint = (Vec3, f32);

/// Curves as connected segments. Each segment is the convex hull of the spheres around both of its ends.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize)]
pub struct Curves {
    points: Vec<CurvePoint>,
    /// For each segment, the index of its first point.
    first_points: Vec<u32>,
    /// For each point of smooth curves, the unit tangent; empty for curves with corners. The ends of smooth curves are
    /// disks, those of others are spheres.
    tangents: Vec<Vec3>,
}

impl Curves {
    /// Creates curves that connect their points by straight segments. A curve of fewer than two points has none.
    pub fn linear<'a>(curves: impl IntoIterator<Item = &'a [CurvePoint]>) -> Self {
        let mut all = Curves::default();
        for points in curves {
            all.add(points.iter().copied());
        }
        all
    }

    /// Creates uniform cubic B-splines from their control points. A spline of fewer than four points has no segment.
    ///
    /// All cubic pieces are divided into the same number of segments: as few as keep the distance from the spline
    /// below 1 % of the radius, but at most 32.
    pub fn b_splines<'a>(curves: impl IntoIterator<Item = &'a [CurvePoint]> + Clone) -> Self {
        let parts = parts(curves.clone());
        let mut all = Curves::default();
        for points in curves {
            let starts = points.windows(4).flat_map(|piece| (0..parts).map(move |i| (piece, i)));
            let end = points.windows(4).last().map(|piece| (piece, parts));
            let at = starts.chain(end).map(|(piece, i)| b_spline(piece, i as f32 / parts as f32));
            let (points, tangents): (Vec<_>, Vec<_>) = at.unzip();
            all.add(points.into_iter());
            all.tangents.extend(tangents);
        }
        all
    }

    /// Returns the number of segments of [`b_splines`](Self::b_splines).
    pub fn b_spline_segments<'a>(curves: impl IntoIterator<Item = &'a [CurvePoint]> + Clone) -> usize {
        parts(curves.clone()) * curves.into_iter().map(|points| points.len().saturating_sub(3)).sum::<usize>()
    }

    /// Adds a curve.
    fn add(&mut self, points: impl Iterator<Item = CurvePoint>) {
        let first = self.points.len() as u32;
        self.points.extend(points);
        self.first_points.extend(first..(self.points.len() as u32).saturating_sub(1).max(first));
    }

    /// Returns the points of all curves.
    pub fn points(&self) -> &[CurvePoint] {
        &self.points
    }

    /// Returns the number of segments.
    pub fn segment_count(&self) -> usize {
        self.first_points.len()
    }
}

/// Returns the number of segments of each cubic piece of all splines.
fn parts<'a>(curves: impl IntoIterator<Item = &'a [CurvePoint]>) -> usize {
    let pieces = curves.into_iter().flat_map(|points| points.windows(4));
    pieces.map(segments_of_piece).max().unwrap_or(1)
}

/// Returns the number of segments that keep the distance from a cubic piece below the tolerance: |p″|/(8n²) for n
/// segments. p″ is linear, so its greatest magnitude is at an end.
fn segments_of_piece(piece: &[CurvePoint]) -> usize {
    let bend = |i: usize| (piece[i].0 - 2.0 * piece[i + 1].0 + piece[i + 2].0).length();
    let radius = piece.iter().map(|(_, radius)| *radius).fold(f32::INFINITY, f32::min);
    let count = (bend(0).max(bend(1)) / (8.0 * TOLERANCE * radius)).sqrt().ceil();
    // A radius of zero gives infinity or NaN.
    if count < MOST_SEGMENTS as f32 { (count as usize).max(1) } else { MOST_SEGMENTS }
}

/// Returns the point and the unit tangent of a uniform cubic B-spline at `t` in [0, 1].
fn b_spline(piece: &[CurvePoint], t: f32) -> (CurvePoint, Vec3) {
    let s = 1.0 - t;
    let weights =
        [s * s * s, 3.0 * t * t * t - 6.0 * t * t + 4.0, 3.0 * s * s * s - 6.0 * s * s + 4.0, t * t * t];
    let slopes = [-s * s, t * (3.0 * t - 4.0), -s * (3.0 * s - 4.0), t * t];
    let (mut p, mut radius, mut tangent) = (Vec3::ZERO, 0.0, Vec3::ZERO);
    for ((point, r), (weight, slope)) in piece.iter().zip(weights.into_iter().zip(slopes)) {
        p += *point * (weight / 6.0);
        radius += r * (weight / 6.0);
        tangent += *point * slope;
    }
    ((p, radius), tangent.normalize_or_zero())
}

/// Curves in world space. The accelerator shares the segments.
pub struct WorldCurves {
    /// The segments.
    pub segments: Arc<CurveSegments>,
}

impl WorldCurves {
    /// Transforms the axes of curves. Radii do not change, as in Mitsuba.
    pub fn new(curves: Curves, to_world: &DAffine3) -> Self {
        let Curves { mut points, first_points, mut tangents } = curves;
        for (p, _) in &mut points {
            *p = to_world.transform_point3(p.as_dvec3()).as_vec3();
        }
        for tangent in &mut tangents {
            *tangent = to_world.transform_vector3(tangent.as_dvec3()).normalize_or_zero().as_vec3();
        }
        WorldCurves { segments: Arc::new(CurveSegments { points, first_points, tangents }) }
    }

    /// Returns the centre and the radius of the sphere that a hit belongs to, and the segment's unit axis.
    fn sphere(&self, hit: &Hit) -> (CurvePoint, Vec3) {
        let [(p0, r0), (p1, r1)] = self.segments.ends(hit.primitive as usize);
        ((p0.lerp(p1, hit.u), r0 + (r1 - r0) * hit.u), (p1 - p0).normalize_or(Vec3::Z))
    }

    /// Moves a point at or near `p` onto the surface. Returns it with its unit normal, the unit normal for shading, and
    /// the greatest magnitude of its coordinates.
    pub fn surface(&self, hit: &Hit, p: Vec3) -> (Vec3, [Vec3; 2], Vec3) {
        let ((center, radius), axis) = self.sphere(hit);
        let [(p0, r0), (p1, r1)] = self.segments.ends(hit.primitive as usize);
        let reach = p0.abs().max(p1.abs()) + Vec3::splat(r0.max(r1));
        if hit.v > 0.0 {
            let [first, last] = self.segments.tangents(hit.primitive as usize);
            let n = if hit.u > 0.5 { last } else { -first };
            return (p - n * (p - center).dot(n), [n; 2], reach);
        }
        let n = (p - center).normalize_or(axis.any_orthonormal_vector());
        (center + n * radius, [n, self.shading_normal(hit, n)], reach)
    }

    /// Returns the normal of the smooth curve, given that of the segment.
    ///
    /// The surface is swept by a circle across the tangent T. Along the axis, a point in the direction e from the axis
    /// moves by (1 − r e·T′) T + r′ e.
    fn shading_normal(&self, hit: &Hit, n: Vec3) -> Vec3 {
        let [first, last] = self.segments.tangents(hit.primitive as usize);
        let [(p0, r0), (p1, r1)] = self.segments.ends(hit.primitive as usize);
        let (tangent, length) = (first.lerp(last, hit.u).normalize_or_zero(), p0.distance(p1));
        let e = (n - tangent * n.dot(tangent)).normalize_or_zero();
        let radius = r0 + (r1 - r0) * hit.u;
        let stretch = 1.0 - radius * e.dot(last - first) / length;
        // Where the radius exceeds that of the bend, the smooth surface folds over.
        if tangent == Vec3::ZERO || stretch <= 0.0 || stretch.is_nan() {
            return n;
        }
        (e * stretch - tangent * ((r1 - r0) / length)).normalize_or(n)
    }

    /// Returns the texture coordinates of a hit at `p`: the angle around the axis in turns, and the position along all
    /// segments.
    pub fn uv(&self, hit: &Hit, p: Vec3) -> Vec2 {
        let ((center, _), axis) = self.sphere(hit);
        let (q, y) = (p - center, guide(axis));
        let turn = q.dot(y).atan2(q.dot(y.cross(axis))) / TAU;
        let along = (hit.primitive as f32 + hit.u) / self.segments.first_points.len() as f32;
        Vec2::new(if turn < 0.0 { turn + 1.0 } else { turn }, along)
    }

    /// Returns the derivatives of the position with respect to the texture coordinates.
    pub fn partials(&self, hit: &Hit, p: Vec3) -> [Vec3; 2] {
        let ((center, _), axis) = self.sphere(hit);
        let [(p0, r0), (p1, r1)] = self.segments.ends(hit.primitive as usize);
        let n = (p - center).normalize_or_zero();
        let count = self.segments.first_points.len() as f32;
        [axis.cross(p - center) * TAU, (p1 - p0 + n * (r1 - r0)) * count]
    }

    /// Returns the bytes of the arrays.
    pub fn memory_bytes(&self) -> usize {
        size_of_val(&self.segments.points[..])
            + size_of_val(&self.segments.first_points[..])
            + size_of_val(&self.segments.tangents[..])
    }
}

/// Returns the unit vector across the axis that is nearest to +z, which is at a quarter turn.
fn guide(axis: Vec3) -> Vec3 {
    (Vec3::Z - axis * axis.z).normalize_or(Vec3::Y)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn arc(points: usize) -> Vec<CurvePoint> {
        let angle = |i: usize| i as f32 * 0.3;
        (0..points).map(|i| (Vec3::new(angle(i).cos(), angle(i).sin(), 0.1 * i as f32), 0.01)).collect()
    }

    #[test]
    fn segments_connect_the_points_of_one_curve_only() {
        let curves = [arc(3), arc(1), arc(2)];
        let linear = Curves::linear(curves.iter().map(Vec::as_slice));
        assert_eq!((linear.points.len(), &linear.first_points[..]), (6, &[0, 1, 4][..]));
        let splines = Curves::b_splines([arc(3), arc(6)].iter().map(Vec::as_slice));
        assert_eq!(splines.segment_count() % 3, 0);
        assert_eq!(
            splines.segment_count(),
            Curves::b_spline_segments([arc(3), arc(6)].iter().map(Vec::as_slice))
        );
        assert_eq!(splines.points.len(), splines.segment_count() + 1);
        assert_eq!(splines.tangents.len(), splines.points.len());
    }

    /// A B-spline through equal steps on a line is the line; its weights sum to one anywhere.
    #[test]
    fn splines_are_within_their_tolerance() {
        let line: Vec<CurvePoint> = (0..4).map(|i| (Vec3::X * i as f32, 1.0 + i as f32)).collect();
        for t in [0.0, 0.25, 0.7, 1.0] {
            let ((p, radius), tangent) = b_spline(&line, t);
            assert!((p - Vec3::X * (1.0 + t)).length() < 1e-6 && (radius - 2.0 - t).abs() < 1e-6);
            assert!((tangent - Vec3::X).length() < 1e-6);
        }
        assert_eq!(segments_of_piece(&line), 1);
        let bent = arc(4);
        let count = segments_of_piece(&bent);
        let at = |t: f32| b_spline(&bent, t).0.0;
        for i in 0..count {
            let [a, b] = [i, i + 1].map(|i| at(i as f32 / count as f32));
            let off = at((i as f32 + 0.5) / count as f32) - 0.5 * (a + b);
            assert!(off.length() < TOLERANCE * 0.01 * 1.01, "{off}");
        }
        let thin: Vec<CurvePoint> = bent.iter().map(|(p, _)| (*p, 0.0)).collect();
        assert_eq!(segments_of_piece(&thin), MOST_SEGMENTS);
    }
}
