//! Sampling the solid angle that a rectangle subtends. [Ureña 2013]

use crate::math::{Vec2, Vec3};
use crate::sampling::warp::sin_cos_quarter;
use glam::{Vec4, Vec4Swizzles};
use std::f32::consts::{FRAC_PI_4, TAU};

/// A rectangle in space: a corner and two orthogonal edges.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rectangle {
    corner: Vec3,
    /// Unit vectors along the edges, and their cross product.
    x: Vec3,
    y: Vec3,
    z: Vec3,
    /// Lengths of the edges.
    length_x: f32,
    length_y: f32,
    center: Vec3,
    /// Beyond this squared distance of the centre the rectangle counts as far.
    far_squared: f32,
}

/// Diagonals of the rectangle beyond which its area is sampled instead: on a Cornell box, sampling the solid
/// angle out to three diagonals lowers the relMSE by 5 % and costs 30 % of the time.
const FAR: f32 = 1.0;
/// Below this (steradians) the rounding of `f32` would show in the density: an error of 5e-7 is 1e-4 of it.
const MINIMUM_SOLID_ANGLE: f32 = 5e-3;

impl Rectangle {
    /// The rectangle at `corner` with the given edges; `None` unless they are orthogonal to within rounding,
    /// because only then is the map exact.
    pub fn new(corner: Vec3, edge_x: Vec3, edge_y: Vec3) -> Option<Self> {
        let (long_x, long_y) = (edge_x.as_dvec3(), edge_y.as_dvec3());
        let (length_x, length_y) = (long_x.length(), long_y.length());
        let (x, y) = (long_x / length_x, long_y / length_y);
        let orthogonal = x.dot(y).abs() < 4.0 * f64::from(f32::EPSILON);
        (orthogonal && length_x > 0.0 && length_y > 0.0).then(|| Rectangle {
            corner,
            x: x.as_vec3(),
            y: y.as_vec3(),
            z: x.cross(y).as_vec3(),
            length_x: length_x as f32,
            length_y: length_y as f32,
            center: corner + (edge_x + edge_y) * 0.5,
            far_squared: FAR * FAR * (length_x * length_x + length_y * length_y) as f32,
        })
    }

    /// The rectangle as seen from `p`; `None` where it subtends so little (far away, or nearly edge-on) that
    /// sampling its area serves as well, or `f32` cannot resolve the solid angle.
    #[inline]
    pub fn seen_from(&self, p: Vec3) -> Option<SphericalRectangle<'_>> {
        if (self.center - p).length_squared() > self.far_squared {
            return None;
        }
        let d = self.corner - p;
        let (x0, y0, z0) = (d.dot(self.x), d.dot(self.y), d.dot(self.z));
        let (x1, y1) = (x0 + self.length_x, y0 + self.length_y);
        let z2 = z0 * z0;
        // z components of the unit normals of the planes through p and the edges. [Ureña 2013, section 3.2]
        let edges = Vec4::new(-y0, x1, y1, -x0);
        let lengths_squared = edges * edges + Vec4::splat(z2);
        let inverse = lengths_squared.recip();
        let n = edges * inverse.map(f32::sqrt);
        // The internal angles γ have cos γ₀ = −n₀n₁ and so on; sin² = 1 − n₀²n₁² = (1 − n₀²) + n₀²(1 − n₁²)
        // with 1 − n² = z²/(z² + e²) has no cancellation. The sum of the angles is the argument of the
        // product of unit complex numbers: one arctangent instead of four arccosines.
        let cos = -(n * n.yzwx());
        let sin = ((inverse + n * n * inverse.yzwx()) * z2).map(f32::sqrt);
        let g01 = multiply((cos.x, sin.x), (cos.y, sin.y));
        let g23 = multiply((cos.z, sin.z), (cos.w, sin.w));
        let solid_angle = full_argument(multiply(g01, g23));
        // False for the NaN of a point in the plane on the border, too.
        (solid_angle > MINIMUM_SOLID_ANGLE && z2 > 0.0).then_some(SphericalRectangle {
            rectangle: self,
            z0,
            x: [x0, x1],
            y: [y0, y1],
            b0: n.x,
            b1: n.z,
            k: (g23.0, -g23.1),
            solid_angle,
        })
    }
}

#[inline]
fn multiply(a: (f32, f32), b: (f32, f32)) -> (f32, f32) {
    (a.0 * b.0 - a.1 * b.1, a.0 * b.1 + a.1 * b.0)
}

/// The argument of a unit complex number, in [0, 2π).
#[inline]
fn full_argument((re, im): (f32, f32)) -> f32 {
    let t = im / (1.0 + re);
    if (0.0..0.3).contains(&t) {
        // 2·atan t by its series, to the rounding of f32 for so small an angle.
        let q = t * t;
        let series = 1.0 / 7.0 - q * (1.0 / 9.0 - q * (1.0 / 11.0 - q * (1.0 / 13.0)));
        return 2.0 * t * (1.0 - q * (1.0 / 3.0 - q * (1.0 / 5.0 - q * series)));
    }
    let angle = im.atan2(re);
    if angle < 0.0 { angle + TAU } else { angle }
}

/// A [`Rectangle`] as seen from a point.
#[derive(Clone, Copy, Debug)]
pub struct SphericalRectangle<'a> {
    rectangle: &'a Rectangle,
    z0: f32,
    x: [f32; 2],
    y: [f32; 2],
    b0: f32,
    b1: f32,
    /// e^{ik}, k = 2π − γ₂ − γ₃.
    k: (f32, f32),
    solid_angle: f32,
}

impl SphericalRectangle<'_> {
    /// The solid angle, in steradians.
    #[inline]
    pub fn solid_angle(&self) -> f32 {
        self.solid_angle
    }

    /// A point of the rectangle whose direction is uniform in the solid angle. [Ureña 2013, Eq. 6 to 15]
    #[inline]
    pub fn sample(&self, u: Vec2) -> Vec3 {
        let angle = u.x * self.solid_angle;
        let (sin, cos) = if angle < FRAC_PI_4 { sin_cos_quarter(angle / FRAC_PI_4) } else { angle.sin_cos() };
        let (cos_au, sin_au) = multiply(self.k, (cos, sin));
        let fu = (cos_au * self.b0 - self.b1) / sin_au;
        let cu = (1.0 / (fu * fu + self.b0 * self.b0).sqrt()).min(1.0).copysign(fu);
        let z = self.z0.abs();
        let xu = (cu * z / ((1.0 - cu) * (1.0 + cu)).sqrt()).max(self.x[0]).min(self.x[1]);
        let d2 = xu * xu + z * z;
        let h0 = self.y[0] / (d2 + self.y[0] * self.y[0]).sqrt();
        let h1 = self.y[1] / (d2 + self.y[1] * self.y[1]).sqrt();
        let hv = h0 + u.y * (h1 - h0);
        let rest = (1.0 - hv) * (1.0 + hv);
        let yv = if rest > 0.0 { hv * (d2 / rest).sqrt() } else { self.y[1] };
        let yv = yv.max(self.y[0]).min(self.y[1]);
        // From the corner, so that the point lies in the plane to the rounding of the rectangle itself.
        let r = self.rectangle;
        r.corner + r.x * (xu - self.x[0]) + r.y * (yv - self.y[0])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::DVec3;

    fn unit_square() -> Rectangle {
        Rectangle::new(Vec3::new(-1.0, -1.0, 0.0), Vec3::X * 2.0, Vec3::Y * 2.0).unwrap()
    }

    /// The solid angle of [x0, x1] × [y0, y1] in the plane z = 0 from p by the four-corner arctangent formula.
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
            Vec3::new(1.0, -2.0, 0.5),
            Vec3::new(1.5, 0.0, 1e-2),
            Vec3::new(1.0, 1.0, 0.1),
        ] {
            let seen = r.seen_from(p).unwrap().solid_angle();
            let exact = exact(p.as_dvec3(), [-1.0, 1.0], [-1.0, 1.0]);
            assert!((f64::from(seen) / exact - 1.0).abs() < 1e-4, "{p}: {seen} {exact}");
        }
        // In the plane, nearly edge-on, and far away.
        for p in
            [Vec3::new(3.0, 0.0, 0.0), Vec3::new(3.0, 0.0, 1e-4), Vec3::Z * 2.9, Vec3::new(1.0, 0.0, 0.0)]
        {
            assert!(r.seen_from(p).is_none(), "{p}");
        }
    }

    /// The share of samples in a sub-rectangle is its share of the solid angle.
    #[test]
    fn samples_are_uniform_in_solid_angle() {
        let r = unit_square();
        for p in [Vec3::new(0.2, 0.3, 0.5), Vec3::new(1.2, -1.1, -0.3), Vec3::new(0.0, 0.0, 1.5)] {
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
            let part = exact(p.as_dvec3(), [-1.0, 0.25], [-0.5, 1.0]);
            let share = part as f32 / seen.solid_angle();
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
