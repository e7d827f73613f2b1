//! Sampling the solid angle that a sphere subtends.

use crate::math::{DVec3, Frame, Vec2, Vec3};
use crate::sampling::warp;

/// A sphere as seen from a point outside.
pub(super) struct SphericalCap {
    /// The vector from the point to the centre.
    to_center: DVec3,
    radius: f64,
    /// The squared length of a tangent from the point to the sphere.
    tangent_squared: f64,
    /// `1 − cos` of the half angle of the cone of directions that intersect the sphere.
    cap: f32,
}

impl SphericalCap {
    /// Returns `None` from inside. For a sphere that emits inward, a point on it may appear to be outside because its
    /// coordinates and those of the centre are rounded; such a point counts as inside.
    pub fn new(center: Vec3, radius: f32, inward: bool, from: Vec3) -> Option<Self> {
        let to_center = center.as_dvec3() - from.as_dvec3();
        let radius = f64::from(radius);
        let (distance_squared, radius_squared) = (to_center.length_squared(), radius * radius);
        let tangent_squared = distance_squared - radius_squared;
        let slack = if inward { rounding(center, from) } else { 0.0 };
        if tangent_squared <= 2.0 * radius * slack + slack * slack {
            return None;
        }
        let sin2 = radius_squared / distance_squared;
        // 1 − √(1 − s) = s / (1 + √(1 − s)): no cancellation for distant spheres.
        let cap = (sin2 / (1.0 + (tangent_squared / distance_squared).sqrt())) as f32;
        Some(SphericalCap { to_center, radius, tangent_squared, cap })
    }

    /// Returns the density of [`sample`](Self::sample) per unit solid angle, which is constant in the cone.
    pub fn pdf(&self) -> f32 {
        warp::square_to_cone_pdf(self.cap)
    }

    /// Samples a uniform direction in the cone. Returns the outward normal at the point where it intersects the
    /// sphere, and the vector to that point.
    pub fn sample(&self, u: Vec2) -> (Vec3, Vec3) {
        let w = warp::square_to_cone(u, self.cap);
        let distance = self.to_center.length();
        let sin2 = f64::from(w.x * w.x + w.y * w.y);
        let half_chord = (self.radius * self.radius - distance * distance * sin2).max(0.0).sqrt();
        // The nearer root of the quadratic equation by Vieta's formula, without cancellation close to the sphere.
        let t = self.tangent_squared / (distance * f64::from(w.z) + half_chord);
        // The sine of the angle at the centre between the axis and the point is t sin θ / r.
        let across = (t / self.radius) as f32;
        let (x, y) = (w.x * across, w.y * across);
        let frame = Frame::from_normal((self.to_center / -distance).as_vec3());
        let n = frame.to_world(Vec3::new(-x, -y, (1.0 - x * x - y * y).max(0.0).sqrt())).normalize();
        (n, frame.to_world(-w) * t as f32)
    }
}

/// Returns a bound on the sum of the rounding errors of two points.
fn rounding(a: Vec3, b: Vec3) -> f64 {
    ROUNDING * f64::from(a.abs().max_element() + b.abs().max_element())
}

/// The bound on the error of a hit point relative to its largest coordinate. [pbrt 6.8.4]
const ROUNDING: f64 = 16.0 * f32::EPSILON as f64;

#[cfg(test)]
mod tests {
    use super::*;

    /// Direction, distance and normal are consistent with one point on the sphere, at any distance.
    #[test]
    fn samples_are_on_the_sphere() {
        let (center, radius) = (Vec3::new(0.5, -0.25, 2.0), 0.75f32);
        for height in [1e-6f32, 1e-3, 0.5, 1e3] {
            let from = center - Vec3::new(0.6, 0.0, 0.8) * (radius + height);
            let projection = SphericalCap::new(center, radius, false, from).expect("outside");
            for i in 0..64 {
                let u = Vec2::new((i % 8) as f32 / 8.0, (i / 8) as f32 / 7.5);
                let (n, to) = projection.sample(u);
                let p = from.as_dvec3() + to.as_dvec3();
                let off = (p - center.as_dvec3()).length() - f64::from(radius);
                let rounding = 1e-6 * f64::from(to.length());
                assert!(off.abs() < rounding + 1e-12, "{height} {u}: off by {off}");
                let off = (p - center.as_dvec3()) / f64::from(radius) - n.as_dvec3();
                assert!(off.length() < 2e-6 * f64::from(1.0 + height), "{height} {u}: off by {off}");
            }
        }
    }

    #[test]
    fn inside_is_inside() {
        let on = Vec3::new(0.0, 0.0, 1f32.next_up());
        assert!(SphericalCap::new(Vec3::ZERO, 1.0, true, on).is_none());
        let far = Vec3::splat(1e5);
        assert!(SphericalCap::new(far, 1.0, true, far + Vec3::X * 1.03).is_none());
        assert!(SphericalCap::new(Vec3::ZERO, 1.0, true, Vec3::X * 1.001).is_some());
        assert!(SphericalCap::new(Vec3::ZERO, 1.0, false, on).is_some());
        assert!(SphericalCap::new(Vec3::ZERO, 1.0, false, Vec3::Z).is_none());
        assert!(SphericalCap::new(Vec3::ZERO, 1.0, false, Vec3::splat(0.1)).is_none());
    }
}
