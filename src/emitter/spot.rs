//! A spot emitter: a point that emits into a cone.

use super::point::towards;
use super::selection::Cone;
use super::{EmitterSample, LightRay, ShadowTarget, never_black, textured};
use crate::color::Rgb;
use crate::math::{DAffine3, Mat3, Ray, Vec2, Vec3};
use crate::sampling::warp;
use crate::texture::Texture;
use std::f32::consts::{FRAC_PI_2, TAU};
use std::sync::Arc;

/// A point that emits into a cone around its axis. The intensity is constant in the beam and then falls linearly with
/// the angle to zero.
#[derive(Clone, Debug)]
pub struct SpotEmitter {
    position: Vec3,
    /// The object-space axes in world space; the third is the axis of the cone.
    axes: Mat3,
    intensity: Rgb,
    texture: Option<Arc<Texture>>,
    cutoff_angle: f32,
    beam_width: f32,
    /// A tangent beyond which angles are greater than `cutoff_angle`.
    outside: f32,
    /// A tangent up to which angles are less than `beam_width`.
    inside: f32,
}

impl SpotEmitter {
    /// Creates a spot. Angles to the axis are in radians; with a texture, `beam_width ≤ cutoff_angle < π/2`.
    pub fn new(
        to_world: &DAffine3,
        intensity: Rgb,
        texture: Option<Arc<Texture>>,
        cutoff_angle: f32,
        beam_width: f32,
    ) -> Self {
        // The cone is round in world space, even if the transform has shear.
        let m = to_world.matrix3;
        let z = m.z_axis.normalize();
        let x = (m.x_axis - z * m.x_axis.dot(z)).normalize();
        let axes = [x, z.cross(x) * m.determinant().signum(), z].map(|axis| axis.as_vec3());
        SpotEmitter {
            position: to_world.translation.as_vec3(),
            axes: Mat3::from_cols(axes[0], axes[1], axes[2]),
            intensity,
            texture,
            cutoff_angle,
            beam_width,
            outside: if cutoff_angle < FRAC_PI_2 { cutoff_angle.tan() * (1.0 + 1e-5) } else { f32::INFINITY },
            inside: if beam_width < FRAC_PI_2 { beam_width.tan() * (1.0 - 1e-5) } else { 0.0 },
        }
    }

    /// Returns the position in world space.
    pub fn position(&self) -> Vec3 {
        self.position
    }

    /// Returns whether the intensity is multiplied by a texture.
    pub fn has_texture(&self) -> bool {
        self.texture.is_some()
    }

    /// Returns the cone of full intensity, the angle in radians over which the intensity then falls to zero, and that
    /// intensity, W·sr⁻¹.
    pub fn cone(&self) -> (Cone, f32, Rgb) {
        let mean = self.texture.as_ref().map_or(Rgb::WHITE, |t| never_black(t.mean()));
        let cone = Cone { axis: self.axes.z_axis, angle: self.beam_width };
        (cone, self.cutoff_angle - self.beam_width, self.intensity * mean)
    }

    /// Returns the radiant intensity in the local direction `d`, W·sr⁻¹.
    fn intensity(&self, d: Vec3) -> Rgb {
        // In front, tangents are compared first: most points are outside of the cone.
        let across = (d.x * d.x + d.y * d.y).sqrt();
        if d.z > 0.0 && across > self.outside * d.z {
            return Rgb::BLACK;
        }
        if d.z > 0.0 && across <= self.inside * d.z && self.texture.is_none() {
            return self.intensity;
        }
        let angle = across.atan2(d.z);
        if angle >= self.cutoff_angle {
            return Rgb::BLACK;
        }
        let falloff = match angle <= self.beam_width {
            true => 1.0,
            false => (self.cutoff_angle - angle) / (self.cutoff_angle - self.beam_width),
        };
        if self.texture.is_none() {
            return self.intensity * falloff;
        }
        let width = d.z * self.cutoff_angle.tan();
        let uv = Vec2::splat(0.5) + Vec2::new(d.x, d.y) * (0.5 / width);
        textured(self.intensity, self.texture.as_ref(), uv) * falloff
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

    /// Returns `1 − cos` of the cone's half angle.
    fn cap(&self) -> f32 {
        let half = (0.5 * self.cutoff_angle).sin();
        2.0 * half * half
    }

    /// Returns the density per unit solid angle of the rays of [`sample_ray`](Self::sample_ray).
    pub(super) fn ray_density(&self) -> f32 {
        warp::square_to_cone_pdf(self.cap())
    }

    /// Samples a ray with a uniform direction in the cone.
    pub fn sample_ray(&self, u: Vec2, time: f32) -> Option<LightRay> {
        let local = warp::square_to_cone(u, self.cap());
        let power = self.intensity(local) / warp::square_to_cone_pdf(self.cap());
        let ray = Ray { o: self.position, t_max: f32::INFINITY, d: (self.axes * local).normalize(), time };
        (!power.is_black()).then_some(LightRay { ray, power, cosine: 1.0 })
    }

    /// Returns an estimate of the emitted power, W.
    pub fn power(&self) -> Rgb {
        let mean = self.texture.as_ref().map_or(Rgb::WHITE, |t| never_black(t.mean()));
        // The falloff counts half. The formula 1 − cos α = 2 sin² (α/2) avoids cancellation for narrow beams.
        let half = (0.25 * (self.beam_width + self.cutoff_angle)).sin();
        self.intensity * mean * (2.0 * TAU * half * half)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// With and without the comparison of tangents, for narrow and wide cones, and on the axis behind the spot.
    #[test]
    fn the_intensity_falls_linearly_with_the_angle() {
        for (cutoff, beam) in
            [(0.4, 0.3), (0.4, 0.0), (0.4, 0.4), (FRAC_PI_2, 1.0), (2.5, 2.0), (2.5, 0.0), (1.0, 0.999)]
        {
            let spot = SpotEmitter::new(&DAffine3::IDENTITY, Rgb::WHITE, None, cutoff, beam);
            for i in 0..=3000 {
                let angle = i as f32 / 3000.0 * std::f32::consts::PI;
                let d = Vec3::new(angle.sin(), 0.0, angle.cos());
                let expected = ((cutoff - angle) / (cutoff - beam).max(1e-6)).clamp(0.0, 1.0);
                // Where the intensity falls steeply, the rounding of the angle counts. No angle here is on a border.
                let tolerance = (1e-5 + 1e-6 / (cutoff - beam).max(1e-6)).min(2e-3);
                let found = spot.intensity(d).g;
                assert!((found - expected).abs() < tolerance, "{cutoff} {beam}, at {angle}: {found}");
            }
            assert!(
                spot.intensity(Vec3::NEG_Z).is_black()
                    && spot.intensity(Vec3::new(0.0, -0.0, -1.0)).is_black()
            );
        }
    }
}
