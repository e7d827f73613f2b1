//! The sun: a disc of directions with uniform radiance.

use super::directional::distant_ray;
use super::environment_map::EnvMapSampleX16;
use super::{BoundingSphere, EmitterSample, LightRay, ShadowTarget};
use crate::color::Rgb;
use crate::math::{Frame, Vec2, Vec3, Vec3x16, f32x16};
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

    /// Computes [`eval`](Self::eval) and [`pdf`](Self::pdf) in sixteen lanes.
    #[inline]
    pub fn eval_x16(&self, d: &Vec3x16) -> ([f32x16; 3], f32x16) {
        let off = (*d - Vec3x16::splat(self.frame.n)).length_squared();
        let inside = off.simd_le(f32x16::splat(2.0 * self.one_minus_cos));
        let seen = inside & d.dot(Vec3x16::splat(self.up)).simd_ge(f32x16::ZERO);
        let pdf = f32x16::splat(warp::square_to_cone_pdf(self.one_minus_cos)) & inside;
        (self.radiance.to_array().map(|c| f32x16::splat(c) & seen), pdf)
    }

    /// Computes [`sample`](Self::sample) in sixteen lanes. Densities are 0 where there is no sample.
    #[inline]
    pub fn sample_x16(&self, u: [f32x16; 2]) -> EnvMapSampleX16 {
        let local = warp::square_to_cone_x16(u, f32x16::splat(self.one_minus_cos));
        let Frame { s, t, n } = self.frame;
        let [s, t, n] = [s, t, n].map(Vec3x16::splat);
        let wi = (s * local.x + t * local.y + n * local.z).normalize_or_zero();
        let above = wi.dot(Vec3x16::splat(self.up)).simd_ge(f32x16::ZERO);
        let pdf = f32x16::splat(warp::square_to_cone_pdf(self.one_minus_cos)) & above;
        EnvMapSampleX16 { wi, radiance: self.radiance.to_array().map(f32x16::splat), pdf }
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lanes_compute_what_scalars_do() {
        let scene = BoundingSphere { center: Vec3::ZERO, radius: 1.0 };
        // A part of the disc is below the horizon.
        let direction = Vec3::new(1.0, 0.002, 0.5).normalize();
        let sun = SunEmitter::new(direction, 0.005, Vec3::Y, Rgb::new(1.0, 2.0, 3.0), scene);
        for i in 0..200u16 {
            let u = Vec2::new(f32::from(i) / 200.0, f32::from(i * 7 % 200) / 200.0);
            let sample = sun.sample_x16(u.to_array().map(f32x16::splat));
            let alone = sun.sample(u);
            assert_eq!(sample.pdf.as_array()[9] > 0.0, alone.is_some(), "{u}");
            let d = alone.map_or(Vec3::X, |alone| alone.wi);
            let (radiance, pdf) = sun.eval_x16(&Vec3x16::splat(d));
            assert_eq!(Rgb::from(radiance.map(|c| c.as_array()[4])), sun.eval(d));
            assert_eq!(pdf.as_array()[4], sun.pdf(d));
            let Some(alone) = alone else { continue };
            assert!((sample.wi.lane(9) - alone.wi).length() < 1e-6, "{u}");
            assert_eq!(sample.pdf.as_array()[9], alone.pdf);
        }
    }
}
