//! Sampling the solid angle that a sphere subtends.

use crate::math::{DVec3, Frame, FrameX16, LANES, Vec2, Vec3, Vec3x16, f32x16};
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

/// A sphere that emits outward in each of sixteen lanes, as seen from a point.
pub(super) struct SphericalCapX16 {
    /// The vectors from the points to the centres.
    to_center: [[f64; LANES]; 3],
    radius: [f64; LANES],
    distance: [f64; LANES],
    tangent_squared: [f64; LANES],
    cap: f32x16,
}

impl SphericalCapX16 {
    /// Computes [`SphericalCap::new`] in each lane. The result is undefined for points inside.
    #[inline(always)]
    pub fn new(center: &Vec3x16, radius: f32x16, from: &Vec3x16) -> Self {
        let difference = |a: f32x16, b: f32x16| {
            let (a, b) = (a.to_array(), b.to_array());
            std::array::from_fn(|i| f64::from(a[i]) - f64::from(b[i]))
        };
        let to_center =
            [difference(center.x, from.x), difference(center.y, from.y), difference(center.z, from.z)];
        let [x, y, z]: &[[f64; LANES]; 3] = &to_center;
        let radius = radius.to_array().map(f64::from);
        let squared: [f64; LANES] = std::array::from_fn(|i| x[i] * x[i] + y[i] * y[i] + z[i] * z[i]);
        let tangent_squared: [f64; LANES] = std::array::from_fn(|i| squared[i] - radius[i] * radius[i]);
        let cap = std::array::from_fn(|i| {
            let sin2 = radius[i] * radius[i] / squared[i];
            (sin2 / (1.0 + (tangent_squared[i] / squared[i]).sqrt())) as f32
        });
        let distance = squared.map(f64::sqrt);
        SphericalCapX16 { to_center, radius, distance, tangent_squared, cap: f32x16::new(cap) }
    }

    /// Returns a mask of the lanes whose point is outside.
    #[inline(always)]
    pub fn outside(&self) -> u32 {
        let bit = |i: usize| u32::from(self.tangent_squared[i] > 0.0) << i;
        (0..LANES).fold(0, |bits, i| bits | bit(i))
    }

    /// Computes [`SphericalCap::pdf`] in each lane.
    #[inline(always)]
    pub fn pdf(&self) -> f32x16 {
        f32x16::ONE / (f32x16::splat(std::f32::consts::TAU) * self.cap)
    }

    /// Computes [`SphericalCap::sample`] in each lane.
    #[inline(always)]
    pub fn sample(&self, u: [f32x16; 2]) -> (Vec3x16, Vec3x16) {
        let SphericalCapX16 { to_center: [x, y, z], radius, distance, tangent_squared, cap } = self;
        let w = warp::square_to_cone_x16(u, *cap);
        let (sin2, cos) = ((w.x * w.x + w.y * w.y).to_array(), w.z.to_array());
        let t: [f64; LANES] = std::array::from_fn(|i| {
            let half_chord =
                (radius[i] * radius[i] - distance[i] * distance[i] * f64::from(sin2[i])).max(0.0).sqrt();
            tangent_squared[i] / (distance[i] * f64::from(cos[i]) + half_chord)
        });
        let across = f32x16::new(std::array::from_fn(|i| (t[i] / radius[i]) as f32));
        let axis = |to: &[f64; LANES]| f32x16::new(std::array::from_fn(|i| (to[i] / -distance[i]) as f32));
        let frame = FrameX16::from_normal(Vec3x16::new(axis(x), axis(y), axis(z)));
        let (x, y) = (w.x * across, w.y * across);
        let height = (f32x16::ONE - x * x - y * y).fast_max(f32x16::ZERO).sqrt();
        let n = frame.to_world(Vec3x16::new(-x, -y, height)).normalize_or_zero();
        (n, frame.to_world(-w) * f32x16::new(t.map(|t| t as f32)))
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
            let lanes = Vec3x16::splat(from);
            let lanes = SphericalCapX16::new(&Vec3x16::splat(center), f32x16::splat(radius), &lanes);
            assert_eq!(lanes.outside(), 0xffff);
            assert!((lanes.pdf().as_array()[1] / projection.pdf() - 1.0).abs() < 1e-6);
            for i in 0..128 {
                let u = Vec2::new((i % 8) as f32 / 8.0, (i % 64 / 8) as f32 / 7.5);
                let (n, to) = if i < 64 {
                    projection.sample(u)
                } else {
                    let (n, to) = lanes.sample([u.x, u.y].map(f32x16::splat));
                    (n.lane(9), to.lane(9))
                };
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
        let mut from = Vec3x16::splat(Vec3::splat(0.1));
        from.set_lane(2, on);
        let lanes = SphericalCapX16::new(&Vec3x16::default(), f32x16::ONE, &from);
        assert_eq!(lanes.outside(), 0b100);
    }
}
