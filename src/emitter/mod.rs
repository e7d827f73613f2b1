//! Emitters and their sampling.
//!
//! A scene description has an [`Emitter`]; the compiled scene has [`Light`]s, which can be sampled.

pub mod area;
mod centre;
pub mod daylight;
pub mod directional;
pub mod emission;
pub mod environment;
pub mod environment_map;
pub mod lanes;
pub mod point;
pub mod projector;
pub mod selection;
mod spherical_cap;
pub mod spherical_rectangle;
pub mod spot;
mod start;
pub mod sun;

pub use area::{AreaEmitter, EmitterHit};
pub use daylight::Sky;
pub use directional::{DirectionalEmitter, distant_ray};
pub use emission::Emission;
pub use environment::Environment;
pub use environment_map::{EnvMap, EnvMapSample};
pub use lanes::EmitterSampleX16;
pub use point::PointEmitter;
pub use projector::ProjectorEmitter;
pub use selection::{ChoiceX16, Gloss, GlossX16, LightSelection, Receiver, ReceiverX16};
pub use spot::SpotEmitter;
pub use start::StartDensity;
pub use sun::SunEmitter;

use crate::color::Rgb;
use crate::ids::TextureId;
use crate::math::{DAffine3, DVec3, Ray, Vec2, Vec3, Vec3x16, f32x16};
use crate::texture::Texture;
use std::sync::Arc;

/// An emitter that is not a shape, as described by a scene. (An area emitter belongs to its shape.)
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub enum Emitter {
    /// An isotropic point emitter.
    Point {
        /// Position in world space.
        position: Vec3,
        /// Radiant intensity, W·sr⁻¹.
        intensity: Rgb,
    },
    /// A point that emits into a cone around its +z axis.
    Spot {
        /// The transform from object space to world space.
        to_world: DAffine3,
        /// Radiant intensity along the axis, W·sr⁻¹.
        intensity: Rgb,
        /// A factor on the intensity, over the cross section of the cone.
        texture: Option<TextureId>,
        /// Angle to the axis, in radians, beyond which the intensity is zero.
        cutoff_angle: f32,
        /// Angle to the axis, in radians, within which the intensity is constant.
        beam_width: f32,
    },
    /// Parallel light from infinity.
    Directional {
        /// Direction of propagation in world space.
        direction: Vec3,
        /// Irradiance of a surface perpendicular to the direction, W·m⁻².
        irradiance: Rgb,
    },
    /// The same radiance from every direction.
    Constant {
        /// Radiance, W·m⁻²·sr⁻¹.
        radiance: Rgb,
    },
    /// An image of the radiance from every direction.
    EnvironmentMap(Arc<EnvMap>),
    /// A clear sky without the sun's disc.
    Sky(Arc<Sky>),
    /// The sun's disc.
    Sun {
        /// Unit direction to its centre.
        direction: Vec3,
        /// Half of its aperture in radians.
        half_angle: f64,
        /// Unit direction to the zenith: no light comes from below the horizon.
        up: Vec3,
        /// Radiance, W·m⁻²·sr⁻¹.
        radiance: Rgb,
    },
    /// A pinhole that projects an image.
    Projector {
        /// The transform from object space to world space.
        to_world: DAffine3,
        /// Irradiance on the plane at distance 1, divided by π.
        irradiance: TextureId,
        /// A factor on the irradiance.
        scale: f32,
        /// Tangents of half the field of view along x and y.
        half_extents: [f32; 2],
    },
}

impl Emitter {
    /// Returns whether the emitter is an environment; a scene has at most one.
    pub fn is_environment(&self) -> bool {
        matches!(self, Emitter::Constant { .. } | Emitter::EnvironmentMap(_) | Emitter::Sky(_))
    }

    /// Returns whether the light comes from a point of space.
    pub fn is_at_a_point(&self) -> bool {
        matches!(self, Emitter::Point { .. } | Emitter::Spot { .. } | Emitter::Projector { .. })
    }

    /// Returns whether no scattered ray can hit the emitter, because it is a point or its light is parallel.
    pub fn is_delta(&self) -> bool {
        self.is_at_a_point() || matches!(self, Emitter::Directional { .. })
    }

    /// Returns whether the emitter is the sun; a scene has at most one, beside an environment.
    pub fn is_sun(&self) -> bool {
        matches!(self, Emitter::Sun { .. })
    }
}

/// An emitter prepared for sampling.
pub enum Light {
    /// An emitting surface.
    Area(Box<AreaEmitter>),
    /// An isotropic point emitter.
    Point(PointEmitter),
    /// A point that emits into a cone.
    Spot(SpotEmitter),
    /// Parallel light from infinity.
    Directional(DirectionalEmitter),
    /// Light from every direction.
    Environment(Environment),
    /// The sun's disc.
    Sun(SunEmitter),
    /// A pinhole that projects an image.
    Projector(ProjectorEmitter),
}

/// The end of a shadow ray.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ShadowTarget {
    /// A point, already offset from its surface towards the receiver.
    Point(Vec3),
    /// Infinity; only the direction is defined.
    Infinity,
}

/// A sampled direction to an emitter.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EmitterSample {
    /// Unit direction from the receiver.
    pub wi: Vec3,
    /// The end of the shadow ray.
    pub target: ShadowTarget,
    /// Incident radiance; for a delta light it is integrated over the solid angle.
    pub radiance: Rgb,
    /// Density per unit solid angle; 1 for a delta light.
    pub pdf: f32,
    /// Whether no other technique can sample this light.
    pub delta: bool,
    /// Cosine between the emitting surface's normal and the direction to the receiver; 1 if there is no surface.
    pub cosine: f32,
}

/// A sampled light ray.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LightRay {
    /// The ray, which starts at the emitter or, for an emitter at infinity, outside the scene.
    pub ray: Ray,
    /// Radiance times the cosine at the emitter, divided by the density of position and direction: the power that the
    /// ray represents, W.
    pub power: Rgb,
    /// Cosine between the emitting surface's normal and the ray; 1 if there is no surface.
    pub cosine: f32,
}

/// The points near an emitter that it may light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LitRegion {
    /// A sphere around the emitter.
    pub sphere: BoundingSphere,
    /// The cone that contains the points: its unit axis, and the cosine of its half angle, which is not negative. Its
    /// apex is the centre of the sphere. `None` if the points may be anywhere.
    pub cone: Option<(DVec3, f64)>,
}

/// A sphere around everything that light from infinity can hit, or around an emitter.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BoundingSphere {
    /// Centre.
    pub center: Vec3,
    /// Radius; positive, but 0 for an emitter at a point.
    pub radius: f32,
}

impl Light {
    /// Samples a direction as seen from `from`; `None` if the emitter does not illuminate that point. `time` is in
    /// [0, 1] over the shutter interval.
    #[inline]
    pub fn sample(&self, from: Vec3, u: Vec2, time: f32) -> Option<EmitterSample> {
        match self {
            Light::Area(area) => area.sample(from, u, time),
            Light::Point(point) => point.sample(from),
            Light::Spot(spot) => spot.sample(from),
            Light::Directional(directional) => Some(directional.sample()),
            Light::Environment(environment) => environment.sample(u),
            Light::Sun(sun) => sun.sample(u),
            Light::Projector(projector) => projector.sample(from),
        }
    }

    /// Samples a direction as [`sample`](Self::sample) does, for a point at which the BSDF is sampled too.
    #[inline]
    pub fn sample_compensated(&self, from: Vec3, u: Vec2, time: f32) -> Option<EmitterSample> {
        match self {
            Light::Environment(environment) => environment.sample_compensated(u),
            _ => self.sample(from, u, time),
        }
    }

    /// Samples a light ray; `None` if nothing is emitted for these numbers.
    pub fn sample_ray(&self, u_point: Vec2, u_direction: Vec2, time: f32) -> Option<LightRay> {
        match self {
            Light::Area(area) => area.sample_ray(u_point, u_direction, time),
            Light::Point(point) => Some(point.sample_ray(u_direction, time)),
            Light::Spot(spot) => spot.sample_ray(u_direction, time),
            Light::Directional(directional) => Some(directional.sample_ray(u_point, time)),
            Light::Environment(environment) => environment.sample_ray(u_point, u_direction, time),
            Light::Sun(sun) => sun.sample_ray(u_point, u_direction, time),
            Light::Projector(projector) => projector.sample_ray(u_direction, time),
        }
    }

    /// Samples a ray as [`sample_ray`](Self::sample_ray) does, with the same density. The dependence of its
    /// world-space direction on `u_point` is as small as the emitter permits.
    pub fn sample_ray_by_direction(&self, u_point: Vec2, u_direction: Vec2, time: f32) -> Option<LightRay> {
        match self {
            Light::Area(area) => area.sample_ray_by_direction(u_point, u_direction, time),
            _ => self.sample_ray(u_point, u_direction, time),
        }
    }

    /// Samples a ray in the world-space direction `d` from the sphere of
    /// [`constant_sphere`](Self::constant_sphere). Its power is that of a uniform density over all directions.
    pub fn sample_ray_towards(&self, u_point: Vec2, d: Vec3, time: f32) -> Option<LightRay> {
        match self {
            Light::Area(area) => area.sample_ray_towards(u_point, d, time),
            _ => None,
        }
    }

    /// Returns the emitting surface if it is a sphere at rest without a texture.
    pub fn constant_sphere(&self) -> Option<BoundingSphere> {
        match self {
            Light::Area(area) => area.sphere().map(|(center, radius, _)| BoundingSphere { center, radius }),
            _ => None,
        }
    }

    /// Returns an estimate of the emitted power, W; for an emitter at infinity, of the power that enters the scene's
    /// bounding sphere. It is not black if the emitter may emit anything.
    pub fn power(&self) -> Rgb {
        match self {
            Light::Area(area) => area.power(),
            Light::Point(point) => point.power(),
            Light::Spot(spot) => spot.power(),
            Light::Directional(directional) => directional.power(),
            Light::Environment(environment) => environment.power(),
            Light::Sun(sun) => sun.power(),
            Light::Projector(projector) => projector.power(),
        }
    }

    /// Returns whether samples are uniform in the solid angle of the visible surface, so that no other technique is
    /// needed.
    pub fn is_sampled_by_solid_angle(&self) -> bool {
        match self {
            Light::Area(area) => area.is_sampled_by_solid_angle(),
            Light::Environment(_) => false,
            Light::Sun(_)
            | Light::Point(_)
            | Light::Spot(_)
            | Light::Directional(_)
            | Light::Projector(_) => true,
        }
    }

    /// Returns the radiance of an emitter at infinity that rays can hit, from sixteen unit directions, and the
    /// densities per unit solid angle with which [`sample`](Self::sample), or
    /// [`sample_compensated`](Self::sample_compensated), samples them; zero for other emitters.
    #[inline]
    pub fn distant_x16(&self, d: &Vec3x16, compensated: bool) -> ([f32x16; 3], f32x16) {
        match self {
            Light::Environment(environment) => environment.radiance.eval_x16(d, compensated),
            Light::Sun(sun) => sun.eval_x16(d),
            _ => ([f32x16::ZERO; 3], f32x16::ZERO),
        }
    }

    /// Returns the radiance of an emitter at infinity that rays can hit, from the unit direction `d`; black for other
    /// emitters.
    #[inline]
    pub fn distant_radiance(&self, d: Vec3) -> Rgb {
        match self {
            Light::Environment(environment) => environment.eval(d),
            Light::Sun(sun) => sun.eval(d),
            _ => Rgb::BLACK,
        }
    }

    /// Returns the density per unit solid angle with which [`sample`](Self::sample), or
    /// [`sample_compensated`](Self::sample_compensated), samples the unit direction `d` of an emitter at infinity that
    /// rays can hit; 0 for other emitters.
    #[inline]
    pub fn distant_pdf(&self, d: Vec3, compensated: bool) -> f32 {
        match self {
            Light::Environment(environment) if compensated => environment.pdf_compensated(d),
            Light::Environment(environment) => environment.pdf(d),
            Light::Sun(sun) => sun.pdf(d),
            _ => 0.0,
        }
    }

    /// Returns the name of the emitter's type in the scene language.
    pub fn kind(&self) -> &'static str {
        match self {
            Light::Area(_) => "area",
            Light::Point(_) => "point",
            Light::Spot(_) => "spot",
            Light::Directional(_) => "directional",
            Light::Environment(environment) => environment.kind(),
            Light::Sun(_) => "sun",
            Light::Projector(_) => "projector",
        }
    }
}

/// Returns the colour of a texture times a factor, or the factor alone.
fn textured(factor: Rgb, texture: Option<&Arc<Texture>>, uv: Vec2) -> Rgb {
    match texture {
        Some(texture) => factor * texture.eval(&crate::texture::TexturePoint::at(uv)),
        None => factor,
    }
}

/// Returns a mean that is never black: the estimated mean of a texture may be black although the texture is not.
fn never_black(mean: Rgb) -> Rgb {
    if mean.is_valid() && mean.luminance() > 0.0 { mean } else { Rgb::splat(f32::MIN_POSITIVE.sqrt()) }
}
