//! The watertight ray/triangle test. [Woop 2013]

use crate::math::robust::gamma;
use crate::math::{DVec3, Ray, Vec3};

/// A ray prepared for the test: a permutation of the axes that makes z the dominant one, and the shear that maps the
/// direction to the z axis.
#[derive(Clone, Copy, Debug)]
pub(super) struct ShearedRay {
    o: [f32; 3],
    d: Vec3,
    axes: [usize; 3],
    shear: [f32; 3],
}

impl ShearedRay {
    /// Prepares a ray with a direction that is finite and not zero.
    #[inline]
    pub fn new(ray: &Ray) -> Self {
        let d = ray.d.to_array();
        let z = ray.d.abs().max_position();
        let (mut x, mut y) = ((z + 1) % 3, (z + 2) % 3);
        // Keeps the winding. The result does not depend on it, but the signs are then those of the paper.
        if d[z] < 0.0 {
            (x, y) = (y, x);
        }
        let shear = [d[x] / d[z], d[y] / d[z], 1.0 / d[z]];
        ShearedRay { o: ray.o.to_array(), d: ray.d, axes: [x, y, z], shear }
    }

    /// Transforms a corner to coordinates relative to the origin, sheared: (x, y, unscaled z).
    #[inline]
    fn transform(&self, corner: &[f32; 3]) -> [f32; 3] {
        let relative = |axis: usize| corner[axis] - self.o[axis];
        let [x, y, z] = self.axes.map(relative);
        [x - self.shear[0] * z, y - self.shear[1] * z, z]
    }

    /// Returns the ray parameter and the barycentric weights of the second and third corner, if `0 < t ≤ t_max`.
    ///
    /// Two triangles with a common edge compute the same edge function up to its sign. Where it is zero in `f32`, it
    /// is computed again without rounding, so no ray passes between the triangles. Both sides are hit.
    #[inline]
    pub fn intersect(&self, corners: &[[f32; 3]; 3], t_max: f32) -> Option<(f32, f32, f32)> {
        let [a, b, c] = [&corners[0], &corners[1], &corners[2]].map(|p| self.transform(p));
        let mut u = edge(c, b);
        let mut v = edge(a, c);
        let mut w = edge(b, a);
        if u == 0.0 || v == 0.0 || w == 0.0 {
            (u, v, w) = (edge_exact(c, b), edge_exact(a, c), edge_exact(b, a));
        }
        if (u < 0.0 || v < 0.0 || w < 0.0) && (u > 0.0 || v > 0.0 || w > 0.0) {
            return None;
        }
        let det = u + v + w;
        if det == 0.0 {
            return None;
        }
        let mut t = (u * a[2] + v * b[2] + w * c[2]) * self.shear[2] / det;
        let largest = |axis: usize| a[axis].abs().max(b[axis].abs()).max(c[axis].abs());
        // A generous bound on the error of t, as in [pbrt 6.8.7]. It grows with the size of the triangle, which may
        // be many times the distance. If the error could change whether t is within the ray's extent, t is computed
        // in double precision.
        let error = ROUNDING * largest(0) * largest(1) * largest(2) * self.shear[2].abs();
        if t.min((t_max - t).abs()) * det.abs() <= error {
            t = self.distance_exact(corners);
        }
        (t > 0.0 && t <= t_max).then(|| (t, v / det, w / det))
    }

    /// Returns the parameter at which the ray intersects the triangle's plane, in double precision. It is used where
    /// rounding in `f32` could change the side of the plane on which the ray starts or ends. Returns 0 for a ray in
    /// the plane.
    #[cold]
    fn distance_exact(&self, corners: &[[f32; 3]; 3]) -> f32 {
        let [a, b, c] = corners.map(|p| Vec3::from(p).as_dvec3());
        let n: DVec3 = (b - a).cross(c - a);
        let t = n.dot(a - Vec3::from(self.o).as_dvec3()) / n.dot(self.d.as_dvec3());
        if t.is_finite() { t as f32 } else { 0.0 }
    }
}

/// The relative rounding error of a distance: 9 roundings in the products of an edge function and their sum, 8 in the
/// coordinates from which they are computed, 3 in the interpolation; for three edges.
const ROUNDING: f32 = 3.0 * gamma(20);

/// Returns the edge function of the projected corners p and q, which is exactly antisymmetric.
#[inline]
fn edge(p: [f32; 3], q: [f32; 3]) -> f32 {
    p[0] * q[1] - p[1] * q[0]
}

/// Returns the edge function with the exact sign: the products of two `f32` are exact in `f64`.
#[cold]
fn edge_exact(p: [f32; 3], q: [f32; 3]) -> f32 {
    let (px, py, qx, qy) = (f64::from(p[0]), f64::from(p[1]), f64::from(q[0]), f64::from(q[1]));
    (px * qy - py * qx) as f32
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::Vec3;

    const CORNERS: [[f32; 3]; 3] = [[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [0.0, 3.0, 0.0]];

    #[test]
    fn u_and_v_weigh_the_second_and_third_corner_from_both_sides() {
        for side in [1.0, -1.0] {
            let ray = Ray::new(Vec3::new(0.5, 1.5, side), Vec3::new(0.0, 0.0, -2.0 * side));
            let (t, u, v) = ShearedRay::new(&ray).intersect(&CORNERS, 1.0).expect("a hit");
            assert!((t - 0.5).abs() < 1e-6 && (u - 0.25).abs() < 1e-6 && (v - 0.5).abs() < 1e-6);
        }
    }

    /// A ray that starts on a plane, or as near to it as `f32` can represent, hits it only if the plane lies ahead.
    #[test]
    fn the_side_on_which_a_ray_starts_is_certain() {
        let tiny = 1.8e-16;
        let floor = [[-3.0, tiny, 3.0], [3.0, tiny, 3.0], [3.0, -tiny, -3.0]];
        for i in 0..2000 {
            let [x, y, z] = [0.618, 0.755, 0.569].map(|step: f32| (i as f32 * step).fract());
            let (p, q) = (0.1 + 0.8 * x.max(y), 0.1 + 0.7 * x.min(y));
            let weights = [1.0 - p, p - q, q];
            let [px, py, pz] = [0, 1, 2].map(|axis| (0..3).map(|k| weights[k] * floor[k][axis]).sum());
            let up = Vec3::new(2.0 * x - 1.0, 0.02 + z, 2.0 * y - 1.0);
            for (start, d, met) in
                [(1e-21, up, false), (1e-21, -up, true), (-1e-21, up, true), (-1e-21, -up, false)]
            {
                let ray = Ray::new(Vec3::new(px, py + start, pz), d);
                let hit = ShearedRay::new(&ray).intersect(&floor, f32::INFINITY);
                assert_eq!(hit.is_some(), met, "{i}: {ray:?}: {hit:?}");
            }
        }
    }

    /// A ray that ends before a large triangle does not hit it, and a ray that ends behind it does. The distances are
    /// representable in `f32` but smaller than the rounding error relative to the triangle's size.
    #[test]
    fn the_side_on_which_a_ray_ends_is_certain() {
        let height = 1e-3;
        let ceiling = [[-1.0, height, 1.0], [1.0, height, 1.0], [0.9, height, -1.0]];
        for i in 0..2000 {
            let [x, z] = [0.618, 0.755].map(|step: f32| (i as f32 * step).fract() * 0.01 - 0.005);
            let o = Vec3::new(x, 0.0, z);
            let to = Vec3::new(4.0 * z, height, 3.0 * x);
            for (end, met) in [(1.0 - 1e-6, false), (1.0 + 1e-6, true)] {
                let ray = Ray::new(o, to * end);
                let hit = ShearedRay::new(&ray).intersect(&ceiling, 1.0);
                assert_eq!(hit.is_some(), met, "{i}: {ray:?}: {hit:?}");
            }
        }
    }

    #[test]
    fn corners_and_edges_belong_to_the_triangle_and_the_plane_does_not() {
        for (x, y) in [(0.0, 0.0), (2.0, 0.0), (0.0, 3.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.5)] {
            let ray = Ray::new(Vec3::new(x, y, 1.0), -Vec3::Z);
            assert!(ShearedRay::new(&ray).intersect(&CORNERS, f32::INFINITY).is_some(), "({x}, {y})");
        }
        let in_plane = Ray::new(Vec3::new(-1.0, 1.0, 0.0), Vec3::X);
        assert_eq!(ShearedRay::new(&in_plane).intersect(&CORNERS, f32::INFINITY), None);
        let point = [[1.0; 3]; 3];
        let at_it = Ray::new(Vec3::ZERO, Vec3::ONE);
        assert_eq!(ShearedRay::new(&at_it).intersect(&point, f32::INFINITY), None);
    }
}
