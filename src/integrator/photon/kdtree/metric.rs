//! How distances are measured.

use crate::math::{Vec3, Vec3x16, f32x16};

/// A way to measure distances; none is shorter than the Euclidean one.
pub trait Metric: Copy {
    /// Squared distances of points from `center`.
    fn distances_squared(self, center: Vec3, points: Vec3x16) -> f32x16;
}

/// The length of the difference.
#[derive(Clone, Copy, Debug)]
pub struct Euclidean;

impl Metric for Euclidean {
    #[inline(always)]
    fn distances_squared(self, center: Vec3, points: Vec3x16) -> f32x16 {
        (points - Vec3x16::splat(center)).length_squared()
    }
}

/// Distances along a normal count several times, so that a ball is a flat ellipsoid. [Jensen 2001, 7.3]
#[derive(Clone, Copy, Debug)]
pub struct Disc {
    /// The normal, of unit length.
    pub normal: Vec3,
    /// How many times a distance along the normal counts, at least 1.
    pub flatness: f32,
}

impl Metric for Disc {
    #[inline(always)]
    fn distances_squared(self, center: Vec3, points: Vec3x16) -> f32x16 {
        let to = points - Vec3x16::splat(center);
        let height = to.dot(Vec3x16::splat(self.normal));
        to.length_squared() + height * height * f32x16::splat(self.flatness * self.flatness - 1.0)
    }
}
