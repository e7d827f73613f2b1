//! A projector: a pinhole that projects an image, the inverse of a camera.

use super::point::towards;
use super::selection::Cone;
use super::{EmitterSample, LightRay, ShadowTarget, never_black};
use crate::color::Rgb;
use crate::math::{DAffine3, Mat3, Ray, Vec2, Vec3};
use crate::texture::{Texture, TexturePoint};
use std::f32::consts::PI;
use std::sync::Arc;

/// A pinhole that projects an image along its +z axis, with y up and x to the left.
#[derive(Clone, Debug)]
pub struct ProjectorEmitter {
    position: Vec3,
    /// The object-space axes in world space.
    axes: Mat3,
    irradiance: Arc<Texture>,
    scale: f32,
    /// Half the width and height of the image at distance 1.
    half: Vec2,
}

impl ProjectorEmitter {
    /// Creates a projector; `half` is half the width and height of the image at distance 1.
    pub fn new(to_world: &DAffine3, irradiance: Arc<Texture>, scale: f32, half: [f32; 2]) -> Self {
        let m = to_world.matrix3;
        let axes = [m.x_axis, m.y_axis, m.z_axis].map(|axis| axis.normalize().as_vec3());
        ProjectorEmitter {
            position: to_world.translation.as_vec3(),
            axes: Mat3::from_cols(axes[0], axes[1], axes[2]),
            irradiance,
            scale,
            half: half.into(),
        }
    }

    /// Returns the position in world space.
    pub fn position(&self) -> Vec3 {
        self.position
    }

    /// Returns a cone around the image, and the intensity along its axis, W·sr⁻¹.
    pub fn cone(&self) -> (Cone, Rgb) {
        let cone = Cone { axis: self.axes.z_axis, angle: self.half.length().atan() };
        (cone, never_black(self.irradiance.mean()) * (PI * self.scale))
    }

    /// Returns the radiant intensity in the local direction `d`, W·sr⁻¹: π times the image's irradiance on the plane
    /// at distance 1.
    fn intensity(&self, d: Vec3) -> Rgb {
        if d.z <= 0.0 {
            return Rgb::BLACK;
        }
        let q = Vec2::new(d.x, d.y) / (d.z * self.half);
        if !(q.abs().cmple(Vec2::ONE).all()) {
            return Rgb::BLACK;
        }
        let uv = (Vec2::ONE - q) * 0.5;
        self.irradiance.eval(&TexturePoint::at(uv)) * (PI * self.scale / (d.z * d.z * d.z))
    }

    /// Samples the only direction.
    pub fn sample(&self, from: Vec3) -> Option<EmitterSample> {
        let (wi, distance_squared) = towards(self.position, from)?;
        let radiance = self.intensity(self.axes.transpose() * -wi) / distance_squared;
        (!radiance.is_black()).then_some(EmitterSample {
            wi,
            target: ShadowTarget::Point(self.position),
            radiance,
            pdf: 1.0,
            delta: true,
            cosine: 1.0,
        })
    }

    /// Returns the density per unit solid angle with which [`sample_ray`](Self::sample_ray) samples the world-space
    /// direction `d` of the image.
    pub(super) fn ray_density(&self, d: Vec3) -> f32 {
        let cos = d.dot(self.axes.z_axis);
        1.0 / (4.0 * self.half.x * self.half.y * cos * cos * cos)
    }

    /// Samples a ray through a uniform point on the image.
    pub fn sample_ray(&self, u: Vec2, time: f32) -> Option<LightRay> {
        let q = u * 2.0 - Vec2::ONE;
        let local = (q * self.half).extend(1.0);
        let length = local.length();
        let d = local / length;
        // The area of the image at distance 1 per solid angle: 1 / cos³θ.
        let area = 4.0 * self.half.x * self.half.y;
        let power = self.intensity(d) * (area * d.z * d.z * d.z);
        let ray = Ray { o: self.position, t_max: f32::INFINITY, d: (self.axes * d).normalize(), time };
        (!power.is_black()).then_some(LightRay { ray, power, cosine: 1.0 })
    }

    /// Returns an estimate of the emitted power, W.
    pub fn power(&self) -> Rgb {
        never_black(self.irradiance.mean()) * (PI * self.scale * 4.0 * self.half.x * self.half.y)
    }
}
