//! Sampling the solid angle that a rectangle subtends. [Ureña 2013]

use crate::math::{DVec3, Vec2, Vec3};
use std::f64::consts::TAU;

/// A rectangle in space: a corner and two orthogonal edges.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rectangle {
    /// A corner.
    corner: DVec3,
    /// Unit vectors along the edges, and their cross product.
    x: DVec3,
    y: DVec3,
    z: DVec3,
    /// Lengths of the edges.
    length_x: f64,
    length_y: f64,
}

impl Rectangle {
    /// The rectangle at `corner` with the given edges; `None` unless they are orthogonal to within rounding,
    /// because only then is the map exact.
    pub fn new(corner: Vec3, edge_x: Vec3, edge_y: Vec3) -> Option<Self> {
        let (edge_x, edge_y) = (edge_x.as_dvec3(), edge_y.as_dvec3());
        let (length_x, length_y) = (edge_x.length(), edge_y.length());
        let (x, y) = (edge_x / length_x, edge_y / length_y);
        let orthogonal = x.dot(y).abs() < 4.0 * f64::from(f32::EPSILON);
        (orthogonal && length_x > 0.0 && length_y > 0.0).then(|| Rectangle {
            corner: corner.as_dvec3(),
            x,
            y,
            z: x.cross(y),
            length_x,
            length_y,
        })
    }

    /// The rectangle as seen from `p`; `None` where it subtends too little for `f64` to resolve (edge-on, or
    /// from very far), and area sampling has to serve.
    #[inline]
    pub fn seen_from(&self, p: Vec3) -> Option<SphericalRectangle<'_>> {
        let d = self.corner - p.as_dvec3();
        let (x0, y0, z0) = (d.dot(self.x), d.dot(self.y), d.dot(self.z));
        let (x1, y1) = (x0 + self.length_x, y0 + self.length_y);
        let z2 = z0 * z0;
        // z components of the unit normals of the planes through p and the edges [Ureña 2013, section 3.2]
        let n0 = -y0 / (z2 + y0 * y0).sqrt();
        let n1 = x1 / (z2 + x1 * x1).sqrt();
        let n2 = y1 / (z2 + y1 * y1).sqrt();
        let n3 = -x0 / (z2 + x0 * x0).sqrt();
        // The internal angles γ have cos γ₀ = −n₀n₁ and so on. Their sum is the argument of the product of
        // unit complex numbers: one arctangent instead of four arccosines.
        let unit = |cos: f64| (cos, ((1.0 - cos) * (1.0 + cos)).max(0.0).sqrt());
        let multiply = |a: (f64, f64), b: (f64, f64)| (a.0 * b.0 - a.1 * b.1, a.0 * b.1 + a.1 * b.0);
        let g01 = multiply(unit(-n0 * n1), unit(-n1 * n2));
        let g23 = multiply(unit(-n2 * n3), unit(-n3 * n0));
        let excess = multiply(g01, g23);
        // f32 suffices for an angle that keeps its relative precision as a tiny imaginary part.
        let angle = f64::from((excess.1 as f32).atan2(excess.0 as f32));
        let solid_angle = if angle < 0.0 { angle + TAU } else { angle };
        // γ₂ + γ₃ (Ureña's g2 and g3, at the corners of the edges 2 and 3)
        (solid_angle > MINIMUM_SOLID_ANGLE && z0 != 0.0).then_some(SphericalRectangle {
            rectangle: self,
            p: p.as_dvec3(),
            x0,
            y0,
            z0,
            x1,
            y1,
            b0: n0,
            b1: n2,
            k: (g23.0, -g23.1),
            solid_angle,
        })
    }
}

/// Below this (steradians) cancellation in `f64` would show in an `f32` density.
const MINIMUM_SOLID_ANGLE: f64 = 1e-7;

/// A [`Rectangle`] as seen from a point.
#[derive(Clone, Copy, Debug)]
pub struct SphericalRectangle<'a> {
    rectangle: &'a Rectangle,
    p: DVec3,
    x0: f64,
    y0: f64,
    z0: f64,
    x1: f64,
    y1: f64,
    b0: f64,
    b1: f64,
    /// e^{ik}, k = 2π − γ₂ − γ₃.
    k: (f64, f64),
    solid_angle: f64,
}

impl SphericalRectangle<'_> {
    /// The solid angle, in steradians.
    #[inline]
    pub fn solid_angle(&self) -> f32 {
        self.solid_angle as f32
    }

    /// A point of the rectangle whose direction is uniform in the solid angle. [Ureña 2013, Eq. 6 to 15]
    #[inline]
    pub fn sample(&self, u: Vec2) -> Vec3 {
        let (sin, cos) = ((f64::from(u.x) * self.solid_angle) as f32).sin_cos();
        let (sin, cos) = (f64::from(sin), f64::from(cos));
        let (cos_au, sin_au) = (self.k.0 * cos - self.k.1 * sin, self.k.1 * cos + self.k.0 * sin);
        let fu = (cos_au * self.b0 - self.b1) / sin_au;
        let cu = (1.0 / (fu * fu + self.b0 * self.b0).sqrt()).copysign(fu).clamp(-1.0, 1.0);
        let z = -self.z0.abs();
        let xu = (-(cu * z) / (1.0 - cu * cu).sqrt()).clamp(self.x0, self.x1);
        let d = (xu * xu + z * z).sqrt();
        let h0 = self.y0 / (d * d + self.y0 * self.y0).sqrt();
        let h1 = self.y1 / (d * d + self.y1 * self.y1).sqrt();
        let hv = h0 + f64::from(u.y) * (h1 - h0);
        let rest = 1.0 - hv * hv;
        let yv = if rest > 0.0 { (hv * d / rest.sqrt()).clamp(self.y0, self.y1) } else { self.y1 };
        let r = self.rectangle;
        (self.p + r.x * xu + r.y * yv + r.z * self.z0).as_vec3()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn unit_square() -> Rectangle {
        Rectangle::new(Vec3::new(-1.0, -1.0, 0.0), Vec3::X * 2.0, Vec3::Y * 2.0).unwrap()
    }

    /// The solid angle of [−1, 1]² from (x, y, z) by the four-corner arctangent formula.
    fn exact(p: DVec3) -> f64 {
        let f = |x: f64, y: f64| (x * y / (p.z * (x * x + y * y + p.z * p.z).sqrt())).atan();
        let (x0, x1, y0, y1) = (-1.0 - p.x, 1.0 - p.x, -1.0 - p.y, 1.0 - p.y);
        (f(x1, y1) - f(x0, y1) - f(x1, y0) + f(x0, y0)).abs()
    }

    #[test]
    fn solid_angles_agree_with_the_arctangent_formula() {
        let r = unit_square();
        for p in [
            Vec3::Z,
            -Vec3::Z,
            Vec3::Z * 1e-3,
            Vec3::Z * 100.0,
            Vec3::Z * 2000.0,
            Vec3::new(3.0, -2.0, 0.5),
            Vec3::new(1.5, 0.0, 1e-3),
            Vec3::new(1.0, 1.0, 0.1),
        ] {
            let seen = r.seen_from(p).unwrap().solid_angle();
            let exact = exact(p.as_dvec3());
            assert!((f64::from(seen) / exact - 1.0).abs() < 2e-6 + 1e-14 / exact, "{p}: {seen} {exact}");
        }
        assert!(r.seen_from(Vec3::new(3.0, 0.0, 0.0)).is_none());
        assert!(r.seen_from(Vec3::Z * 1e5).is_none());
    }

    /// The share of samples in a sub-rectangle is its share of the solid angle.
    #[test]
    fn samples_are_uniform_in_solid_angle() {
        let r = unit_square();
        for p in [Vec3::new(0.2, 0.3, 0.5), Vec3::new(2.0, -1.5, -0.3), Vec3::new(0.0, 0.0, 30.0)] {
            let seen = r.seen_from(p).unwrap();
            let n = 512;
            let inside = |q: Vec3| q.x < 0.25 && q.y > -0.5;
            let mut count = 0;
            for i in 0..n * n {
                let u = Vec2::new(((i % n) as f32 + 0.5) / n as f32, ((i / n) as f32 + 0.5) / n as f32);
                let q = seen.sample(u);
                assert!(
                    q.x.abs() <= 1.00001 && q.y.abs() <= 1.00001 && q.z.abs() < 1e-5 * (1.0 + p.z.abs()),
                    "{q}"
                );
                count += usize::from(inside(q));
            }
            let part = Rectangle::new(Vec3::new(-1.0, -0.5, 0.0), Vec3::X * 1.25, Vec3::Y * 1.5).unwrap();
            let share = part.seen_from(p).unwrap().solid_angle() / seen.solid_angle();
            let found = count as f32 / (n * n) as f32;
            assert!((found - share).abs() < 2e-3, "{p}: {found} {share}");
        }
    }

    #[test]
    fn a_parallelogram_is_refused() {
        assert!(Rectangle::new(Vec3::ZERO, Vec3::X, Vec3::new(0.1, 1.0, 0.0)).is_none());
        assert!(Rectangle::new(Vec3::ZERO, Vec3::ZERO, Vec3::Y).is_none());
    }
}
