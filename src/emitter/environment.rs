//! Infinite emitters: light from every direction.

use super::directional::distant_ray;
use super::environment_map::EnvMapSampleX16;
use super::{BoundingSphere, EmitterSample, EnvMap, EnvMapSample, LightRay, ShadowTarget, Sky};
use crate::color::Rgb;
use crate::math::{Vec2, Vec3, Vec3x16, f32x16};
use crate::sampling::warp;
use std::f32::consts::PI;
use std::sync::Arc;

/// An emitter at infinity.
pub struct Environment {
    pub(super) radiance: EnvironmentRadiance,
    pub(super) scene: BoundingSphere,
}

/// Radiance as a function of direction, W·m⁻²·sr⁻¹.
#[derive(Clone)]
pub(super) enum EnvironmentRadiance {
    Constant(Rgb),
    Map(Arc<EnvMap>),
    Sky(Arc<Sky>),
}

impl Environment {
    /// Creates an emitter with the same radiance from every direction.
    pub fn constant(radiance: Rgb, scene: BoundingSphere) -> Self {
        Environment { radiance: EnvironmentRadiance::Constant(radiance), scene }
    }

    /// Creates an emitter with the radiance of an image.
    pub fn map(map: Arc<EnvMap>, scene: BoundingSphere) -> Self {
        Environment { radiance: EnvironmentRadiance::Map(map), scene }
    }

    /// Creates an emitter with the radiance of a clear sky.
    pub fn sky(sky: Arc<Sky>, scene: BoundingSphere) -> Self {
        Environment { radiance: EnvironmentRadiance::Sky(sky), scene }
    }

    /// Returns the radiance from the unit direction `d`.
    #[inline]
    pub fn eval(&self, d: Vec3) -> Rgb {
        match &self.radiance {
            EnvironmentRadiance::Constant(radiance) => *radiance,
            EnvironmentRadiance::Map(map) => map.eval(d),
            EnvironmentRadiance::Sky(sky) => sky.eval(d),
        }
    }

    /// Returns the density per unit solid angle with which [`sample`](Self::sample) samples the unit direction `d`.
    #[inline]
    pub fn pdf(&self, d: Vec3) -> f32 {
        match &self.radiance {
            EnvironmentRadiance::Constant(_) => warp::SQUARE_TO_SPHERE_PDF,
            EnvironmentRadiance::Map(map) => map.pdf(d),
            EnvironmentRadiance::Sky(sky) => sky.map().pdf(d),
        }
    }

    /// Samples a direction.
    #[inline]
    pub fn sample(&self, u: Vec2) -> Option<EmitterSample> {
        match &self.radiance {
            EnvironmentRadiance::Constant(radiance) => {
                let (wi, pdf) = (warp::square_to_sphere(u), warp::SQUARE_TO_SPHERE_PDF);
                Some(emitter_sample(EnvMapSample { wi, radiance: *radiance, pdf }))
            }
            EnvironmentRadiance::Map(map) => map.sample(u).map(emitter_sample),
            EnvironmentRadiance::Sky(sky) => sky.sample(u).map(emitter_sample),
        }
    }

    /// Samples a direction for a point at which the BSDF is sampled too; `None` if the radiance is the same from every
    /// direction.
    #[inline]
    pub fn sample_compensated(&self, u: Vec2) -> Option<EmitterSample> {
        match &self.radiance {
            EnvironmentRadiance::Constant(_) => None,
            EnvironmentRadiance::Map(map) => map.sample_compensated(u).map(emitter_sample),
            EnvironmentRadiance::Sky(sky) => sky.sample_compensated(u).map(emitter_sample),
        }
    }

    /// Returns the density per unit solid angle with which [`sample_compensated`](Self::sample_compensated) samples the
    /// unit direction `d`.
    #[inline]
    pub fn pdf_compensated(&self, d: Vec3) -> f32 {
        match &self.radiance {
            EnvironmentRadiance::Constant(_) => 0.0,
            EnvironmentRadiance::Map(map) => map.pdf_compensated(d),
            EnvironmentRadiance::Sky(sky) => sky.map().pdf_compensated(d),
        }
    }

    /// Returns the mean over all directions of the luminance that [`sample_compensated`](Self::sample_compensated)
    /// samples, W·m⁻²·sr⁻¹.
    pub fn mean_excess(&self) -> f32 {
        match &self.radiance {
            EnvironmentRadiance::Constant(_) => 0.0,
            EnvironmentRadiance::Map(map) => map.mean_excess(),
            EnvironmentRadiance::Sky(sky) => sky.map().mean_excess(),
        }
    }

    /// Samples a ray from a disk with the radius of the scene, placed outside the scene in a sampled direction.
    pub fn sample_ray(&self, u_point: Vec2, u_direction: Vec2, time: f32) -> Option<LightRay> {
        let sample = self.sample(u_direction)?;
        let area = PI * self.scene.radius * self.scene.radius;
        let ray = distant_ray(&self.scene, -sample.wi, u_point, time);
        Some(LightRay { ray, power: sample.radiance * (area / sample.pdf), cosine: 1.0 })
    }

    /// Returns the mean radiance over all directions, W·m⁻²·sr⁻¹.
    pub fn mean_radiance(&self) -> Rgb {
        match &self.radiance {
            EnvironmentRadiance::Constant(radiance) => *radiance,
            EnvironmentRadiance::Map(map) => map.mean_radiance(),
            EnvironmentRadiance::Sky(sky) => sky.map().mean_radiance(),
        }
    }

    /// Returns the power that enters the scene's bounding sphere, W.
    pub fn power(&self) -> Rgb {
        self.mean_radiance() * (4.0 * PI * PI * self.scene.radius * self.scene.radius)
    }

    /// Returns the name of the emitter's type in the scene language.
    pub fn kind(&self) -> &'static str {
        match &self.radiance {
            EnvironmentRadiance::Constant(_) => "constant",
            EnvironmentRadiance::Map(_) => "envmap",
            EnvironmentRadiance::Sky(_) => "sky",
        }
    }
}

impl EnvironmentRadiance {
    /// Samples directions in sixteen lanes: those of [`Environment::sample`], or of
    /// [`Environment::sample_compensated`]. Densities are 0 where there is no sample.
    #[inline]
    pub fn sample_x16(&self, compensated: bool, u: [f32x16; 2]) -> EnvMapSampleX16 {
        match self {
            EnvironmentRadiance::Constant(radiance) => EnvMapSampleX16 {
                wi: warp::square_to_sphere_x16(u),
                radiance: radiance.to_array().map(f32x16::splat),
                pdf: f32x16::splat(if compensated { 0.0 } else { warp::SQUARE_TO_SPHERE_PDF }),
            },
            EnvironmentRadiance::Map(map) => map.sample_x16(compensated, u),
            EnvironmentRadiance::Sky(sky) => sky.sample_x16(compensated, u),
        }
    }

    /// Returns the radiance from sixteen unit directions, and the densities with which
    /// [`sample_x16`](Self::sample_x16) samples them.
    #[inline]
    pub fn eval_x16(&self, d: &Vec3x16, compensated: bool) -> ([f32x16; 3], f32x16) {
        match self {
            EnvironmentRadiance::Constant(radiance) => {
                let pdf = if compensated { 0.0 } else { warp::SQUARE_TO_SPHERE_PDF };
                (radiance.to_array().map(f32x16::splat), f32x16::splat(pdf))
            }
            EnvironmentRadiance::Map(map) => map.eval_x16(d, compensated),
            EnvironmentRadiance::Sky(sky) => sky.eval_x16(d, compensated),
        }
    }
}

fn emitter_sample(sample: EnvMapSample) -> EmitterSample {
    let EnvMapSample { wi, radiance, pdf } = sample;
    EmitterSample { wi, target: ShadowTarget::Infinity, radiance, pdf, delta: false, cosine: 1.0 }
}
