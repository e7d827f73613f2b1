//! Emitters: where light comes from, and how to sample it.
//!
//! A scene describes an [`Emitter`]; the compiled scene holds [`Light`]s, which can be sampled.

pub mod area;
mod centre;
pub mod directional;
pub mod emission;
pub mod environment;
pub mod environment_map;
pub mod lanes;
pub mod point;
pub mod projector;
mod seen_sphere;
pub mod spherical_rectangle;
pub mod spot;

pub use area::{AreaEmitter, SurfacePlace};
pub use directional::Directional;
pub use emission::Emission;
pub use environment::Environment;
pub use environment_map::{EnvMap, EnvMapSample};
pub use lanes::EmitterSampleX16;
pub use point::Point;
pub use projector::Projector;
pub use spot::Spot;

use crate::color::Rgb;
use crate::ids::TextureId;
use crate::math::{DAffine3, Ray, Vec2, Vec3};
use crate::texture::Texture;
use std::sync::Arc;

/// An emitter that is not a shape, as a scene names it. (An area emitter belongs to its shape.)
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub enum Emitter {
    /// An isotropic point.
    Point {
        /// Position in the world.
        position: Vec3,
        /// Radiant intensity, W·sr⁻¹.
        intensity: Rgb,
    },
    /// A point that shines into a cone around its +z axis.
    Spot {
        /// Its coordinates to the world.
        to_world: DAffine3,
        /// Radiant intensity along the axis, W·sr⁻¹.
        intensity: Rgb,
        /// A factor on it, over the cross section of the cone.
        texture: Option<TextureId>,
        /// Angle to the axis, in radians, from which on it is dark.
        cutoff_angle: f32,
        /// Angle to the axis, in radians, up to which it is as bright as at the axis.
        beam_width: f32,
    },
    /// Parallel light from far away.
    Directional {
        /// Direction in the world in which the light travels.
        direction: Vec3,
        /// Irradiance of a surface that faces it, W·m⁻².
        irradiance: Rgb,
    },
    /// The same radiance from every direction.
    Constant {
        /// Radiance, W·m⁻²·sr⁻¹.
        radiance: Rgb,
    },
    /// An image of the radiance from every direction.
    EnvironmentMap(Arc<EnvMap>),
    /// A pinhole that casts an image.
    Projector {
        /// Its coordinates to the world.
        to_world: DAffine3,
        /// Irradiance on the plane at distance 1, up to a factor of π.
        irradiance: TextureId,
        /// A factor on it.
        scale: f32,
        /// Tangents of half the field of view along x and y.
        half_extents: [f32; 2],
    },
}

impl Emitter {
    /// Whether it shines from every direction; a scene has room for one such.
    pub fn is_environment(&self) -> bool {
        matches!(self, Emitter::Constant { .. } | Emitter::EnvironmentMap(_))
    }
}

/// An emitter ready for sampling.
pub enum Light {
    /// A surface.
    Area(Box<AreaEmitter>),
    /// An isotropic point.
    Point(Point),
    /// A point with a cone of light.
    Spot(Spot),
    /// Parallel light.
    Directional(Directional),
    /// Light from every direction.
    Environment(Environment),
    /// A pinhole that casts an image.
    Projector(Projector),
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
    /// Incident radiance; for a delta light it is integrated over the solid angle.
    pub radiance: Rgb,
    /// Density per unit solid angle; 1 for a delta light.
    pub pdf: f32,
    /// Whether no other technique can find this light.
    pub delta: bool,
}

/// A sampled ray of light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LightRay {
    /// The ray, from the emitter or, for distant ones, from outside of the scene.
    pub ray: Ray,
    /// Radiance times the cosine at the emitter over the density of position and direction: the power that the ray
    /// stands for, W.
    pub power: Rgb,
}

/// A sphere around everything that distant light can meet.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BoundingSphere {
    /// Centre.
    pub center: Vec3,
    /// Radius, positive.
    pub radius: f32,
}

impl Light {
    /// Draws a direction as seen from `from`; `None` where the light does not shine there. `time` is in [0, 1] over the
    /// shutter interval.
    #[inline]
    pub fn sample(&self, from: Vec3, u: Vec2, time: f32) -> Option<EmitterSample> {
        match self {
            Light::Area(area) => area.sample(from, u, time),
            Light::Point(point) => point.sample(from),
            Light::Spot(spot) => spot.sample(from),
            Light::Directional(directional) => Some(directional.sample()),
            Light::Environment(environment) => environment.sample(u),
            Light::Projector(projector) => projector.sample(from),
        }
    }

    /// Draws a ray of light; `None` where there is none.
    pub fn sample_ray(&self, u_point: Vec2, u_direction: Vec2, time: f32) -> Option<LightRay> {
        match self {
            Light::Area(area) => area.sample_ray(u_point, u_direction, time),
            Light::Point(point) => Some(point.sample_ray(u_direction, time)),
            Light::Spot(spot) => spot.sample_ray(u_direction, time),
            Light::Directional(directional) => Some(directional.sample_ray(u_point, time)),
            Light::Environment(environment) => environment.sample_ray(u_point, u_direction, time),
            Light::Projector(projector) => projector.sample_ray(u_direction, time),
        }
    }

    /// As [`sample_ray`](Self::sample_ray), of the same density, but with directions in the world that depend on
    /// `u_direction` as little on `u_point` as the emitter allows.
    pub fn sample_ray_by_direction(&self, u_point: Vec2, u_direction: Vec2, time: f32) -> Option<LightRay> {
        match self {
            Light::Area(area) => area.sample_ray_by_direction(u_point, u_direction, time),
            _ => self.sample_ray(u_point, u_direction, time),
        }
    }

    /// About the emitted power, W; of distant light that which enters the scene's bounding sphere. Not black for
    /// whatever may shine.
    pub fn power(&self) -> Rgb {
        match self {
            Light::Area(area) => area.power(),
            Light::Point(point) => point.power(),
            Light::Spot(spot) => spot.power(),
            Light::Directional(directional) => directional.power(),
            Light::Environment(environment) => environment.power(),
            Light::Projector(projector) => projector.power(),
        }
    }

    /// Whether samples of it are spread evenly over what is seen of it, so that no other technique is needed beside.
    pub fn is_sampled_by_solid_angle(&self) -> bool {
        match self {
            Light::Area(area) => area.is_sampled_by_solid_angle(),
            Light::Environment(_) => false,
            Light::Point(_) | Light::Spot(_) | Light::Directional(_) | Light::Projector(_) => true,
        }
    }

    /// The name of its kind in the scene language.
    pub fn kind(&self) -> &'static str {
        match self {
            Light::Area(_) => "area",
            Light::Point(_) => "point",
            Light::Spot(_) => "spot",
            Light::Directional(_) => "directional",
            Light::Environment(environment) => environment.kind(),
            Light::Projector(_) => "projector",
        }
    }
}

/// The colour of a texture with a factor, or of the factor alone.
fn textured(factor: Rgb, texture: Option<&Arc<Texture>>, uv: Vec2) -> Rgb {
    match texture {
        Some(texture) => factor * texture.eval(&crate::texture::TexturePoint::at(uv)),
        None => factor,
    }
}

/// A mean that is never black: an estimate of what a texture sends may be, although the texture is not.
fn at_least_a_little(mean: Rgb) -> Rgb {
    if mean.is_valid() && mean.luminance() > 0.0 { mean } else { Rgb::splat(f32::MIN_POSITIVE.sqrt()) }
}
