//! A directional emitter: parallel light from infinity.

use super::{BoundingSphere, EmitterSample, LightRay, ShadowTarget};
use crate::color::Rgb;
use crate::math::{Frame, Ray, Vec2, Vec3};
use crate::sampling::warp;
use std::f32::consts::PI;

/// An emitter with the same direction everywhere.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DirectionalEmitter {
    /// Unit direction of propagation.
    pub direction: Vec3,
    /// Irradiance of a surface perpendicular to the direction, W·m⁻².
    pub irradiance: Rgb,
    /// The bounding sphere of the scene.
    pub scene: BoundingSphere,
}

impl DirectionalEmitter {
    /// Samples the only direction.
    #[inline]
    pub fn sample(&self) -> EmitterSample {
        EmitterSample {
            wi: -self.direction,
            target: ShadowTarget::Infinity,
            radiance: self.irradiance,
            pdf: 1.0,
            delta: true,
            cosine: 1.0,
        }
    }

    /// Samples a ray from a disk with the radius of the scene.
    pub fn sample_ray(&self, u: Vec2, time: f32) -> LightRay {
        LightRay { ray: distant_ray(&self.scene, self.direction, u, time), power: self.power(), cosine: 1.0 }
    }

    /// Returns the power that enters the scene's bounding sphere, W.
    pub fn power(&self) -> Rgb {
        self.irradiance * (PI * self.scene.radius * self.scene.radius)
    }
}

/// Samples a ray in a direction, from a uniform point on a disk outside the sphere.
pub fn distant_ray(scene: &BoundingSphere, direction: Vec3, u: Vec2, time: f32) -> Ray {
    let disk = warp::square_to_disk(u);
    let frame = Frame::from_normal(direction);
    let o = scene.center + (frame.s * disk.x + frame.t * disk.y - direction) * scene.radius;
    Ray { o, t_max: f32::INFINITY, d: direction, time }
}
