//! Distance metrics of kd-tree queries.

use crate::math::{Vec3, Vec3x16, f32x16};

/// A metric that is never smaller than the Euclidean distance.
pub trait Metric: Copy {
    /// Returns the squared distances of points from `center`.
    fn distances_squared(self, center: Vec3, points: Vec3x16) -> f32x16;
}

/// The Euclidean metric.
#[derive(Clone, Copy, Debug)]
pub struct Euclidean;

impl Metric for Euclidean {
    #[inline(always)]
    fn distances_squared(self, center: Vec3, points: Vec3x16) -> f32x16 {
        (points - Vec3x16::splat(center)).length_squared()
    }
}

/// A metric with a factor on distances along a normal, so that a ball is a flat ellipsoid. [Jensen 2001, 7.3]
#[derive(Clone, Copy, Debug)]
pub struct EllipsoidMetric {
    /// The normal, of unit length.
    pub normal: Vec3,
    /// The factor on distances along the normal, at least 1.
    pub flatness: f32,
}

impl Metric for EllipsoidMetric {
    #[inline(always)]
    fn distances_squared(self, center: Vec3, points: Vec3x16) -> f32x16 {
        let to = points - Vec3x16::splat(center);
        let height = to.dot(Vec3x16::splat(self.normal));
        to.length_squared() + height * height * f32x16::splat(self.flatness * self.flatness - 1.0)
    }
}
