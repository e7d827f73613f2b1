//! Sampling the solid angle that a rectangle subtends, for sixteen points at a time. [Ureña 2013]

use crate::math::{Vec2, Vec3, Vec3x16, f32x16, lanes::with_sign};
use crate::sampling::warp::{argument_x16, sin_cos_turn_x16};

/// A rectangle in space: a corner and two orthogonal edges.
#[derive(Clone, Copy, Debug, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub struct Rectangle {
    corner: Vec3,
    /// The edge directions and their cross product, which transform world to local coordinates. The local unit of
    /// length is the diagonal, so that products of eight lengths stay in the range of `f32` where it matters.
    x: Vec3,
    y: Vec3,
    z: Vec3,
    /// The edges.
    edge_x: Vec3,
    edge_y: Vec3,
    /// Lengths of the edges, in units of the diagonal.
    length_x: f32,
    length_y: f32,
    /// Reciprocals of the lengths.
    per_length_x: f32,
    per_length_y: f32,
    /// The square of the diagonal.
    diagonal_squared: f32,
}

/// The number of `f32` values in a [`Rectangle`].
pub const NUMBERS: usize = size_of::<Rectangle>() / size_of::<f32>();

/// Sixteen rectangles, one for each lane.
#[derive(Clone, Copy)]
pub struct RectangleX16 {
    corner: Vec3x16,
    x: Vec3x16,
    y: Vec3x16,
    z: Vec3x16,
    edge_x: Vec3x16,
    edge_y: Vec3x16,
    length_x: f32x16,
    length_y: f32x16,
    per_length_x: f32x16,
    per_length_y: f32x16,
    diagonal_squared: f32x16,
}

/// The solid angle in steradians below which the area is sampled instead. Its absolute error in `f32` of 5e-7 is then
/// a relative error of the density of 1e-4.
const MINIMUM_SOLID_ANGLE: f32 = 5e-3;

impl Rectangle {
    /// Creates the rectangle at `corner` with the given edges. Returns `None` unless they are orthogonal to within
    /// rounding, because the map is exact only then.
    pub fn new(corner: Vec3, edge_x: Vec3, edge_y: Vec3) -> Option<Self> {
        let (long_x, long_y) = (edge_x.as_dvec3(), edge_y.as_dvec3());
        let (length_x, length_y) = (long_x.length(), long_y.length());
        let (x, y) = (long_x / length_x, long_y / length_y);
        let orthogonal = x.dot(y).abs() < 4.0 * f64::from(f32::EPSILON);
        let diagonal = length_x.hypot(length_y);
        (orthogonal && length_x > 0.0 && length_y > 0.0 && diagonal.is_finite()).then(|| Rectangle {
            corner,
            x: (x / diagonal).as_vec3(),
            y: (y / diagonal).as_vec3(),
            z: (x.cross(y) / diagonal).as_vec3(),
            edge_x,
            edge_y,
            length_x: (length_x / diagonal) as f32,
            length_y: (length_y / diagonal) as f32,
            per_length_x: (diagonal / length_x) as f32,
            per_length_y: (diagonal / length_y) as f32,
            diagonal_squared: (diagonal * diagonal) as f32,
        })
    }
}

impl Rectangle {
    /// Returns all numbers of the rectangle.
    pub fn numbers(&self) -> [f32; NUMBERS] {
        bytemuck::cast(*self)
    }

    /// Returns the point at the fractions `u` of the edges.
    pub fn point(&self, u: Vec2) -> Vec3 {
        self.corner + self.edge_x * u.x + self.edge_y * u.y
    }

    /// Returns the fractions of the edges at a point.
    pub fn fractions(&self, p: Vec3) -> Vec2 {
        let d = p - self.corner;
        Vec2::new(d.dot(self.x) * self.per_length_x, d.dot(self.y) * self.per_length_y)
    }
}

impl RectangleX16 {
    /// Creates sixteen copies of a rectangle.
    #[inline]
    pub fn splat(r: &Rectangle) -> Self {
        RectangleX16::from_numbers(r.numbers().map(f32x16::splat))
    }

    /// Creates sixteen rectangles from the numbers of [`Rectangle::numbers`].
    #[inline(always)]
    pub fn from_numbers(n: [f32x16; NUMBERS]) -> Self {
        let vector = |i: usize| Vec3x16::new(n[i], n[i + 1], n[i + 2]);
        RectangleX16 {
            corner: vector(0),
            x: vector(3),
            y: vector(6),
            z: vector(9),
            edge_x: vector(12),
            edge_y: vector(15),
            length_x: n[18],
            length_y: n[19],
            per_length_x: n[20],
            per_length_y: n[21],
            diagonal_squared: n[22],
        }
    }

    /// Computes the rectangles' projections onto the unit sphere around `p`.
    #[inline(always)]
    pub fn projected_from(&self, p: Vec3x16) -> SphericalRectangleX16<'_> {
        let d = self.corner - p;
        let (x0, y0, z0) = (d.dot(self.x), d.dot(self.y), d.dot(self.z));
        let (x1, y1) = (x0 + self.length_x, y0 + self.length_y);
        let z = z0.abs();
        let z2 = z * z;
        // The planes through p and the edges: sᵢ² = eᵢ² + z² are the squared distances of p from the edges' lines,
        // and eᵢ/sᵢ are the z components of the planes' unit normals. [Ureña 2013, section 3.2]
        let edges = [-y0, x1, y1, -x0];
        let squares = edges.map(|e| e * e);
        let [s0, s2] = [0, 2].map(|i| (squares[i] + z2).sqrt());
        let [q1, q3] = [1, 3].map(|i| squares[i] + z2);
        // The internal angles γ satisfy cos γ₀ = −n₀n₁ and so on. As complex numbers of length s₀s₁ they are −e₀e₁ +
        // i·z·r, where r is the distance of p from the corner; this form has no cancellation. The sum of the angles
        // is the argument of their product, so one arctangent replaces four arccosines.
        let corner = |i: usize, j: usize| (-(edges[i] * edges[j]), z * (squares[i] + squares[j] + z2).sqrt());
        let s02 = s0 * s2;
        let inverse = f32x16::ONE / (s02 * s02 * (q1 * q3));
        let g01 = scale(multiply(corner(0, 1), corner(1, 2)), inverse * (q3 * s02));
        let g23 = scale(multiply(corner(2, 3), corner(3, 0)), inverse * (q1 * s02));
        let (re, im) = multiply(g01, g23);
        let solid_angle = argument_x16(re, im);
        // Also false for NaN, which results from a point on the border.
        let resolved = solid_angle.simd_gt(f32x16::splat(MINIMUM_SOLID_ANGLE)) & z2.simd_gt(f32x16::ZERO);
        let per_s = inverse * (q1 * q3 * s02);
        let per_s0 = per_s * s2;
        SphericalRectangleX16 {
            rectangle: self,
            from: p,
            z0,
            z,
            x: [x0, x1],
            y: [y0, y1],
            b0: edges[0] * per_s0,
            b1: edges[2] * (per_s * s0),
            z_per_s0: z * per_s0,
            k: (g23.0, -g23.1),
            solid_angle,
            resolved,
        }
    }
}

#[inline(always)]
fn scale(a: (f32x16, f32x16), factor: f32x16) -> (f32x16, f32x16) {
    (a.0 * factor, a.1 * factor)
}

#[inline(always)]
fn multiply(a: (f32x16, f32x16), b: (f32x16, f32x16)) -> (f32x16, f32x16) {
    (a.0 * b.0 - a.1 * b.1, a.0 * b.1 + a.1 * b.0)
}

/// Points of rectangles, and the vectors to them from the reference points.
#[derive(Clone, Copy)]
pub struct RectanglePointX16 {
    /// The points, whose distance to the rectangle's plane is a rounding error of the rectangle itself.
    pub p: Vec3x16,
    /// The vectors. If a rectangle is [resolved](SphericalRectangleX16::resolved), their directions are accurate to
    /// the rounding of `f32` at any distance.
    pub to: Vec3x16,
}

/// Rectangles projected onto unit spheres around reference points.
#[derive(Clone, Copy)]
pub struct SphericalRectangleX16<'a> {
    rectangle: &'a RectangleX16,
    /// The reference points.
    from: Vec3x16,
    /// The signed distance of the plane, and its magnitude.
    z0: f32x16,
    z: f32x16,
    x: [f32x16; 2],
    y: [f32x16; 2],
    b0: f32x16,
    b1: f32x16,
    /// √(1 − b₀²).
    z_per_s0: f32x16,
    /// e^{ik}, k = 2π − γ₂ − γ₃.
    k: (f32x16, f32x16),
    solid_angle: f32x16,
    resolved: f32x16,
}

impl SphericalRectangleX16<'_> {
    /// Returns the solid angles in steradians, which are valid if [resolved](Self::resolved).
    #[inline(always)]
    pub fn solid_angle(&self) -> f32x16 {
        self.solid_angle
    }

    /// Returns a mask that is false for rectangles whose solid angle is too small for `f32` (far away, or nearly
    /// edge-on).
    #[inline(always)]
    pub fn resolved(&self) -> f32x16 {
        self.resolved
    }

    /// Samples points of the rectangles: uniformly in solid angle [Ureña 2013, Eq. 6 to 15] if
    /// [resolved](Self::resolved), otherwise uniformly in area.
    #[inline(always)]
    pub fn sample(&self, [u, v]: [f32x16; 2]) -> RectanglePointX16 {
        let r = self.rectangle;
        let one = f32x16::ONE;
        let (sin, cos) = sin_cos_turn_x16(u * self.solid_angle);
        let (cos_au, sin_au) = multiply(self.k, (cos, sin));
        // With f = N/sin, c = sign f/√(f² + b₀²) and x = c·z/√(1 − c²), the division and one square root cancel.
        let n = cos_au * self.b0 - self.b1;
        let w = sin_au * self.z_per_s0;
        let root = ((n - w) * (n + w)).fast_max(f32x16::ZERO).sqrt();
        let xu = with_sign(f32x16::ONE, n) * sin_au * self.z / root;
        let xu = xu.fast_max(self.x[0]).fast_min(self.x[1]);
        let d2 = xu * xu + self.z * self.z;
        let [t0, t1] = self.y.map(|y| (d2 + y * y).sqrt());
        let inverse = one / (t0 * t1);
        let h0 = self.y[0] * t1 * inverse;
        let h1 = self.y[1] * t0 * inverse;
        let hv = h0 + v * (h1 - h0);
        let rest = (one - hv) * (one + hv);
        let yv = rest.simd_gt(f32x16::ZERO).select(hv * (d2 / rest).sqrt(), self.y[1]);
        let yv = yv.fast_max(self.y[0]).fast_min(self.y[1]);
        // Computed from the corner, so that the point's distance to the plane is a rounding error of the rectangle
        // itself.
        let along_x = self.resolved.select((xu - self.x[0]) * r.per_length_x, u);
        let along_y = self.resolved.select((yv - self.y[0]) * r.per_length_y, v);
        let p = r.corner + r.edge_x * along_x + r.edge_y * along_y;
        // Avoids the cancellation in the difference of two nearly equal points.
        let near = (r.x * xu + r.y * yv + r.z * self.z0) * r.diagonal_squared;
        RectanglePointX16 { p, to: Vec3x16::select(self.resolved, near, p - self.from) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::{DVec3, Vec2};

    fn unit_square() -> Rectangle {
        Rectangle::new(Vec3::new(-1.0, -1.0, 0.0), Vec3::X * 2.0, Vec3::Y * 2.0).unwrap()
    }

    /// Returns the solid angle from `p`, if it is resolved, and the sample at `u`.
    fn projection(r: &Rectangle, p: Vec3, u: Vec2) -> (Option<f32>, Vec3) {
        let r = RectangleX16::splat(r);
        let projection = r.projected_from(Vec3x16::splat(p));
        let q = projection.sample([f32x16::splat(u.x), f32x16::splat(u.y)]).p.lane(6);
        let resolved = projection.resolved().to_bitmask() & 1 == 1;
        (resolved.then_some(projection.solid_angle().as_array()[0]), q)
    }

    /// Returns the solid angle of [x0, x1] × [y0, y1] in the plane z = 0 from p by the four-corner arctangent
    /// formula.
    fn exact(p: DVec3, [x0, x1]: [f64; 2], [y0, y1]: [f64; 2]) -> f64 {
        let f = |x: f64, y: f64| (x * y / (p.z * (x * x + y * y + p.z * p.z).sqrt())).atan();
        let (x0, x1, y0, y1) = (x0 - p.x, x1 - p.x, y0 - p.y, y1 - p.y);
        (f(x1, y1) - f(x0, y1) - f(x1, y0) + f(x0, y0)).abs()
    }

    #[test]
    fn solid_angles_agree_with_the_arctangent_formula() {
        let r = unit_square();
        for p in [
            Vec3::Z,
            -Vec3::Z,
            Vec3::Z * 1e-3,
            Vec3::Z * 2.8,
            Vec3::Z * 28.0,
            Vec3::new(1.0, -2.0, 0.5),
            Vec3::new(1.5, 0.0, 1e-2),
            Vec3::new(1.0, 1.0, 0.1),
            Vec3::new(5.0, -7.0, 9.0),
        ] {
            let found = projection(&r, p, Vec2::ZERO).0.expect("resolved");
            let exact = exact(p.as_dvec3(), [-1.0, 1.0], [-1.0, 1.0]);
            assert!((f64::from(found) / exact - 1.0).abs() < 1e-4, "{p}: {found} {exact}");
        }
        // Points in the plane, nearly edge-on, and far away.
        for p in
            [Vec3::new(3.0, 0.0, 0.0), Vec3::new(3.0, 0.0, 1e-4), Vec3::Z * 50.0, Vec3::new(1.0, 0.0, 0.0)]
        {
            let (solid_angle, q) = projection(&r, p, Vec2::new(0.25, 0.75));
            assert_eq!(solid_angle, None, "{p}");
            assert_eq!(q, Vec3::new(-0.5, 0.5, 0.0), "uniform in the area");
        }
    }

    /// The fraction of samples in a sub-rectangle is equal to its fraction of the solid angle.
    #[test]
    fn samples_are_uniform_in_solid_angle() {
        let r = unit_square();
        for p in [
            Vec3::new(0.2, 0.3, 0.5),
            Vec3::new(1.2, -1.1, -0.3),
            Vec3::new(0.0, 0.0, 1.5),
            Vec3::new(-15.0, 3.0, 18.0),
        ] {
            let n = 512;
            let inside = |q: Vec3| q.x < 0.25 && q.y > -0.5;
            let mut count = 0;
            for i in 0..n * n {
                let u = Vec2::new(((i % n) as f32 + 0.5) / n as f32, ((i / n) as f32 + 0.5) / n as f32);
                let q = projection(&r, p, u).1;
                assert!(
                    q.x.abs() <= 1.00001 && q.y.abs() <= 1.00001 && q.z.abs() < 1e-5 * (1.0 + p.z.abs()),
                    "{q}"
                );
                count += usize::from(inside(q));
            }
            let part = exact(p.as_dvec3(), [-1.0, 0.25], [-0.5, 1.0]);
            let share = part as f32 / projection(&r, p, Vec2::ZERO).0.expect("resolved");
            let found = count as f32 / (n * n) as f32;
            assert!((found - share).abs() < 2e-3, "{p}: {found} {share}");
        }
    }

    #[test]
    fn each_lane_has_its_own_rectangle() {
        let (small, unit) = (Rectangle::new(Vec3::Y, Vec3::X * 0.5, Vec3::Z).unwrap(), unit_square());
        let p = Vec3x16::splat(Vec3::new(0.2, 0.3, 0.5));
        let mut numbers = unit.numbers().map(f32x16::splat);
        for (number, value) in numbers.iter_mut().zip(small.numbers()) {
            number.as_mut_array()[5] = value;
        }
        let gathered = RectangleX16::from_numbers(numbers);
        let both = gathered.projected_from(p).solid_angle().to_array();
        let [alone, other] =
            [small, unit].map(|r| RectangleX16::splat(&r).projected_from(p).solid_angle().to_array()[0]);
        assert_eq!((both[5], both[4]), (alone, other));
    }

    #[test]
    fn a_parallelogram_is_refused() {
        assert!(Rectangle::new(Vec3::ZERO, Vec3::X, Vec3::new(0.1, 1.0, 0.0)).is_none());
        assert!(Rectangle::new(Vec3::ZERO, Vec3::ZERO, Vec3::Y).is_none());
    }
}
