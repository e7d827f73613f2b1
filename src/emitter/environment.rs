//! Light from every direction, from far away.

use super::directional::distant_ray;
use super::{BoundingSphere, EmitterSample, EnvMap, EnvMapSample, LightRay, Target};
use crate::color::Rgb;
use crate::math::{Vec2, Vec3};
use crate::sampling::warp;
use std::f32::consts::PI;
use std::sync::Arc;

/// Light from every direction.
pub struct Environment {
    radiance: Radiance,
    scene: BoundingSphere,
}

/// Radiance by direction, W·m⁻²·sr⁻¹.
enum Radiance {
    Constant(Rgb),
    Map(Arc<EnvMap>),
}

impl Environment {
    /// The same radiance from every direction.
    pub fn constant(radiance: Rgb, scene: BoundingSphere) -> Self {
        Environment { radiance: Radiance::Constant(radiance), scene }
    }

    /// The radiance that an image shows.
    pub fn map(map: Arc<EnvMap>, scene: BoundingSphere) -> Self {
        Environment { radiance: Radiance::Map(map), scene }
    }

    /// Radiance from the unit direction `d`.
    #[inline]
    pub fn eval(&self, d: Vec3) -> Rgb {
        match &self.radiance {
            Radiance::Constant(radiance) => *radiance,
            Radiance::Map(map) => map.eval(d),
        }
    }

    /// The density per unit solid angle with which [`sample`](Self::sample) draws the unit direction `d`.
    #[inline]
    pub fn pdf(&self, d: Vec3) -> f32 {
        match &self.radiance {
            Radiance::Constant(_) => warp::SQUARE_TO_SPHERE_PDF,
            Radiance::Map(map) => map.pdf(d),
        }
    }

    /// Draws a direction.
    #[inline]
    pub fn sample(&self, u: Vec2) -> Option<EmitterSample> {
        let (wi, radiance, pdf) = match &self.radiance {
            Radiance::Constant(radiance) => {
                (warp::square_to_sphere(u), *radiance, warp::SQUARE_TO_SPHERE_PDF)
            }
            Radiance::Map(map) => {
                let EnvMapSample { wi, radiance, pdf } = map.sample(u)?;
                (wi, radiance, pdf)
            }
        };
        Some(EmitterSample { wi, target: Target::Infinity, radiance, pdf, delta: false })
    }

    /// A ray from a disk as wide as the scene, before it in a sampled direction.
    pub fn sample_ray(&self, u_point: Vec2, u_direction: Vec2, time: f32) -> Option<LightRay> {
        let sample = self.sample(u_direction)?;
        let area = PI * self.scene.radius * self.scene.radius;
        let ray = distant_ray(&self.scene, -sample.wi, u_point, time);
        Some(LightRay { ray, power: sample.radiance * (area / sample.pdf) })
    }

    /// Power that enters the scene's bounding sphere, W.
    pub fn power(&self) -> Rgb {
        let mean = match &self.radiance {
            Radiance::Constant(radiance) => *radiance,
            Radiance::Map(map) => map.mean_radiance(),
        };
        mean * (4.0 * PI * PI * self.scene.radius * self.scene.radius)
    }

    /// The name of its kind in the scene language.
    pub fn kind(&self) -> &'static str {
        match &self.radiance {
            Radiance::Constant(_) => "constant",
            Radiance::Map(_) => "envmap",
        }
    }
}
