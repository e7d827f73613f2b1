//! An isotropic point emitter.

use super::{EmitterSample, LightRay, ShadowTarget};
use crate::color::Rgb;
use crate::math::{Ray, Vec2, Vec3};
use crate::sampling::warp;
use std::f32::consts::PI;

/// A point that emits the same intensity in every direction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PointEmitter {
    /// Position in world space.
    pub position: Vec3,
    /// Radiant intensity, W·sr⁻¹.
    pub intensity: Rgb,
}

impl PointEmitter {
    /// Samples the only direction.
    #[inline]
    pub fn sample(&self, from: Vec3) -> Option<EmitterSample> {
        let (wi, distance_squared) = towards(self.position, from)?;
        Some(EmitterSample {
            wi,
            target: ShadowTarget::Point(self.position),
            radiance: self.intensity / distance_squared,
            pdf: 1.0,
            delta: true,
            cosine: 1.0,
        })
    }

    /// Samples a ray with a uniform direction.
    pub fn sample_ray(&self, u: Vec2, time: f32) -> LightRay {
        let d = warp::square_to_sphere(u);
        let ray = Ray { o: self.position, t_max: f32::INFINITY, d, time };
        LightRay { ray, power: self.power(), cosine: 1.0 }
    }

    /// Returns the emitted power, W.
    pub fn power(&self) -> Rgb {
        self.intensity * (4.0 * PI)
    }
}

/// Returns the unit direction from one point to another and the squared distance; `None` if the points are equal.
#[inline]
pub(super) fn towards(to: Vec3, from: Vec3) -> Option<(Vec3, f32)> {
    let vector = to - from;
    let distance_squared = vector.length_squared();
    (distance_squared > 0.0).then(|| (vector / distance_squared.sqrt(), distance_squared))
}
