//! The sun: a disc of directions with uniform radiance.

use super::directional::distant_ray;
use super::{BoundingSphere, EmitterSample, LightRay, ShadowTarget};
use crate::color::Rgb;
use crate::math::{Frame, Vec2, Vec3};
use crate::sampling::warp;
use std::f32::consts::{PI, TAU};

/// An emitter at infinity with the same radiance from all directions of a cone, as far as they are above the horizon.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SunEmitter {
    /// A frame around the direction of the centre.
    frame: Frame,
    /// `1 − cos` of the half angle of the cone.
    pub(super) one_minus_cos: f32,
    /// Unit direction to the zenith.
    up: Vec3,
    /// Radiance, W·m⁻²·sr⁻¹.
    radiance: Rgb,
    /// The bounding sphere of the scene.
    pub(super) scene: BoundingSphere,
}

impl SunEmitter {
    /// Creates the sun around the unit vector `direction` with a half angle in radians, at most π/2. No light comes
    /// from below the horizon, to which `up` is normal.
    pub fn new(direction: Vec3, half_angle: f64, up: Vec3, radiance: Rgb, scene: BoundingSphere) -> Self {
        let one_minus_cos = super::daylight::one_minus_cos(half_angle) as f32;
        SunEmitter { frame: Frame::from_normal(direction), one_minus_cos, up, radiance, scene }
    }

    /// Samples a direction uniformly in the cone; `None` if it is below the horizon.
    #[inline]
    pub fn sample(&self, u: Vec2) -> Option<EmitterSample> {
        let wi = self.frame.to_world(warp::square_to_cone(u, self.one_minus_cos)).normalize();
        (wi.dot(self.up) >= 0.0).then(|| EmitterSample {
            wi,
            target: ShadowTarget::Infinity,
            radiance: self.radiance,
            pdf: warp::square_to_cone_pdf(self.one_minus_cos),
            delta: false,
            cosine: 1.0,
        })
    }

    /// Returns whether a unit direction is in the cone. `|d − n|² = 2 (1 − cos)` has no cancellation in narrow cones.
    #[inline]
    fn contains(&self, d: Vec3) -> bool {
        (d - self.frame.n).length_squared() <= 2.0 * self.one_minus_cos
    }

    /// Returns the radiance from the unit direction `d`.
    #[inline]
    pub fn eval(&self, d: Vec3) -> Rgb {
        if self.contains(d) && d.dot(self.up) >= 0.0 { self.radiance } else { Rgb::BLACK }
    }

    /// Returns the density per unit solid angle with which [`sample`](Self::sample) samples the unit direction `d`.
    #[inline]
    pub fn pdf(&self, d: Vec3) -> f32 {
        if self.contains(d) { warp::square_to_cone_pdf(self.one_minus_cos) } else { 0.0 }
    }

    /// Returns the centre as a delta light of the same irradiance.
    pub fn centre(&self) -> EmitterSample {
        EmitterSample {
            wi: self.frame.n,
            target: ShadowTarget::Infinity,
            radiance: self.irradiance(),
            pdf: 1.0,
            delta: true,
            cosine: 1.0,
        }
    }

    /// Samples a ray from a disk with the radius of the scene, placed outside the scene in a sampled direction.
    pub fn sample_ray(&self, u_point: Vec2, u_direction: Vec2, time: f32) -> Option<LightRay> {
        let sample = self.sample(u_direction)?;
        Some(LightRay {
            ray: distant_ray(&self.scene, -sample.wi, u_point, time),
            power: self.power(),
            cosine: 1.0,
        })
    }

    /// Returns the irradiance of a surface that faces the centre, W·m⁻², without the horizon.
    pub fn irradiance(&self) -> Rgb {
        // π sin² of the half angle
        self.radiance * (PI * self.one_minus_cos * (2.0 - self.one_minus_cos))
    }

    /// Returns the power that enters the scene's bounding sphere, W, without the horizon.
    pub fn power(&self) -> Rgb {
        self.radiance * (TAU * self.one_minus_cos * PI * self.scene.radius * self.scene.radius)
    }
}
