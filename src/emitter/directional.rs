//! Parallel light from far away.

use super::{BoundingSphere, EmitterSample, LightRay, Target};
use crate::color::Rgb;
use crate::math::{Frame, Ray, Vec2, Vec3};
use crate::sampling::warp;
use std::f32::consts::PI;

/// Light that arrives from one direction everywhere.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Directional {
    /// Unit direction in which the light travels.
    pub direction: Vec3,
    /// Irradiance of a surface that faces it, W·m⁻².
    pub irradiance: Rgb,
    /// What it can meet.
    pub scene: BoundingSphere,
}

impl Directional {
    /// The one direction.
    #[inline]
    pub fn sample(&self) -> EmitterSample {
        EmitterSample {
            wi: -self.direction,
            target: Target::Infinity,
            radiance: self.irradiance,
            pdf: 1.0,
            delta: true,
        }
    }

    /// A ray from a disk as wide as the scene.
    pub fn sample_ray(&self, u: Vec2, time: f32) -> LightRay {
        LightRay { ray: distant_ray(&self.scene, self.direction, u, time), power: self.power() }
    }

    /// Power that enters the scene's bounding sphere, W.
    pub fn power(&self) -> Rgb {
        self.irradiance * (PI * self.scene.radius * self.scene.radius)
    }
}

/// A ray in a direction, from a point uniform on the disk before the sphere.
pub(super) fn distant_ray(scene: &BoundingSphere, direction: Vec3, u: Vec2, time: f32) -> Ray {
    let disk = warp::square_to_disk(u);
    let frame = Frame::from_normal(direction);
    let o = scene.center + (frame.s * disk.x + frame.t * disk.y - direction) * scene.radius;
    Ray { o, t_max: f32::INFINITY, d: direction, time }
}
