//! Emitters: where light comes from, and how to sample it.
//!
//! A scene describes an [`Emitter`]; the compiled scene holds [`Light`]s, which can be sampled.

pub mod area;
pub mod environment_map;
pub mod lanes;
pub mod spherical_rectangle;

pub use area::AreaEmitter;
pub use environment_map::{EnvMap, EnvMapSample};
pub use lanes::EmitterSampleX16;

use crate::color::Rgb;
use crate::math::{Vec2, Vec3};
use crate::sampling::warp;
use std::f32::consts::PI;

/// An emitter that is not a shape, as a scene names it. (An area emitter belongs to its shape.)
#[derive(Clone, Debug, PartialEq)]
pub enum Emitter {
    /// An isotropic point.
    Point {
        /// Position in the world.
        position: Vec3,
        /// Radiant intensity, W·sr⁻¹.
        intensity: Rgb,
    },
    /// The same radiance from every direction.
    Constant {
        /// Radiance, W·m⁻²·sr⁻¹.
        radiance: Rgb,
    },
}

/// An emitter ready for sampling.
pub enum Light {
    /// A surface.
    Area(AreaEmitter),
    /// An isotropic point.
    Point {
        /// Position.
        position: Vec3,
        /// Radiant intensity, W·sr⁻¹.
        intensity: Rgb,
    },
    /// The same radiance from every direction.
    Constant {
        /// Radiance.
        radiance: Rgb,
        /// Radius of the scene, for the power.
        scene_radius: f32,
    },
}

/// Where a shadow ray ends.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Target {
    /// At a point, already moved off its surface towards the receiver.
    Point(Vec3),
    /// Nowhere: the direction is all.
    Infinity,
}

/// A sampled direction to an emitter.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EmitterSample {
    /// Unit direction from the receiver.
    pub wi: Vec3,
    /// The end of the shadow ray.
    pub target: Target,
    /// Incident radiance; for a point light its intensity over the squared distance.
    pub radiance: Rgb,
    /// Density per unit solid angle; 1 for a delta light, whose radiance is integrated already.
    pub pdf: f32,
    /// Whether no other technique can find this light.
    pub delta: bool,
}

impl Light {
    /// Draws a direction as seen from `from`; `None` where the light does not shine there.
    #[inline]
    pub fn sample(&self, from: Vec3, u: Vec2) -> Option<EmitterSample> {
        match self {
            Light::Area(area) => area.sample(from, u),
            Light::Point { position, intensity } => {
                let to = *position - from;
                let distance_squared = to.length_squared();
                (distance_squared > 0.0).then(|| EmitterSample {
                    wi: to / distance_squared.sqrt(),
                    target: Target::Point(*position),
                    radiance: *intensity / distance_squared,
                    pdf: 1.0,
                    delta: true,
                })
            }
            Light::Constant { radiance, .. } => Some(EmitterSample {
                wi: warp::square_to_sphere(u),
                target: Target::Infinity,
                radiance: *radiance,
                pdf: warp::SQUARE_TO_SPHERE_PDF,
                delta: false,
            }),
        }
    }

    /// The emitted power, W; for a constant environment that which enters the scene's bounding sphere.
    pub fn power(&self) -> Rgb {
        match self {
            Light::Area(area) => area.power(),
            Light::Point { intensity, .. } => *intensity * (4.0 * PI),
            Light::Constant { radiance, scene_radius } => *radiance * (PI * PI * scene_radius * scene_radius),
        }
    }

    /// The density per unit solid angle with which [`sample`](Self::sample) draws a direction that leaves the
    /// scene.
    #[inline]
    pub fn pdf_environment(&self) -> f32 {
        match self {
            Light::Constant { .. } => warp::SQUARE_TO_SPHERE_PDF,
            Light::Area(_) | Light::Point { .. } => 0.0,
        }
    }
}
