//! Densities of the starts of light paths, for the weights of bidirectional path tracing.
//!
//! The weights of a path's techniques may be any that sum to 1 (Veach 1997, 9.2), if all techniques compute the same.
//! These densities are those of sampling uniformly in area and without a guide, although some emitters are sampled
//! better, and light paths are guided.

use super::{BoundingSphere, Light};
use crate::math::Vec3;
use crate::sampling::warp;
use std::f64::consts::PI;

/// The densities of a point on an emitter and of the ray that leaves it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StartDensity {
    /// Density of the point per unit area or, for an emitter at infinity, of the direction per unit solid angle; 1 for
    /// a delta light.
    pub point: f64,
    /// Density of the ray: `point` times the density of the direction per unit solid angle or, at infinity, of the
    /// position per unit area.
    pub ray: f64,
}

impl Light {
    /// Returns the densities of a light path that starts in the world-space direction `d`. `cosine` is that between
    /// `d` and the normal of an emitting surface.
    pub fn start_density(&self, d: Vec3, cosine: f32) -> StartDensity {
        let per_disk = |radius: f32| 1.0 / (PI * f64::from(radius) * f64::from(radius));
        match self {
            Light::Area(area) => {
                let point = 1.0 / area.area();
                StartDensity { point, ray: point * f64::from(cosine) / PI }
            }
            Light::Point(_) => StartDensity { point: 1.0, ray: 0.25 / PI },
            Light::Spot(spot) => StartDensity { point: 1.0, ray: spot.ray_density().into() },
            Light::Projector(projector) => StartDensity { point: 1.0, ray: projector.ray_density(d).into() },
            Light::Directional(parallel) => StartDensity { point: 1.0, ray: per_disk(parallel.scene.radius) },
            Light::Environment(environment) => {
                let point = f64::from(environment.pdf(-d));
                StartDensity { point, ray: point * per_disk(environment.scene.radius) }
            }
            Light::Sun(sun) => {
                let point = f64::from(warp::square_to_cone_pdf(sun.one_minus_cos));
                StartDensity { point, ray: point * per_disk(sun.scene.radius) }
            }
        }
    }

    /// Returns whether no scattered ray can hit the emitter.
    pub fn is_delta(&self) -> bool {
        matches!(self, Light::Point(_) | Light::Spot(_) | Light::Directional(_) | Light::Projector(_))
    }

    /// Returns the sphere around everything that an emitter at infinity can hit.
    pub fn surroundings(&self) -> Option<&BoundingSphere> {
        match self {
            Light::Directional(parallel) => Some(&parallel.scene),
            Light::Environment(environment) => Some(&environment.scene),
            Light::Sun(sun) => Some(&sun.scene),
            Light::Area(_) | Light::Point(_) | Light::Spot(_) | Light::Projector(_) => None,
        }
    }

    /// Returns whether the emitter is at infinity.
    pub fn is_distant(&self) -> bool {
        self.surroundings().is_some()
    }
}
