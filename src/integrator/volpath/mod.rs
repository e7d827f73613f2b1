//! Path tracing in participating media. [Kajiya 1986; Veach 1997; Miller 2019]
//!
//! Surfaces are those of `path`. Between them, the ray of a path goes through boundaries of media that do not scatter
//! it (`null`, holes of a mask) until it is scattered in a medium or hits a surface ([`flights`]). At each event in a
//! medium an emitter is sampled, with the transmittance of the media up to it, and a direction, by the phase function.
//! Both are weighted by the power heuristic ([`scattering`]). In thin homogeneous media, a third technique samples
//! points near emitters ([`near_emitters`]). If all media fill bodies that light enters at surfaces only, no emitter is
//! sampled in them ([`bodies`]). Without media, the integrator is `path`.

pub mod bodies;
pub mod closed;
mod emitter_samples;
mod equiangular;
pub mod flights;
mod near_emitters;
pub mod scattering;
mod tracer;

use self::bodies::Bodies;
use self::flights::Flights;
use self::tracer::Tracer;
use super::settings::{HiddenLight, PathLimits, PathSettings, Plugin, Source};
use super::{Integrator, PathIntegrator, Preparation, Radiance, RadianceQuery, Wave, Worker};
use crate::emitter::{Light, LitRegion};
use crate::error::Result;
use crate::math::{Ray, Vec3};
use crate::scene::Scene;

/// Unidirectional path tracing in media, with next-event estimation.
pub struct VolpathIntegrator {
    limits: PathLimits,
    /// The paths between events in media.
    paths: PathIntegrator,
    /// Whether all media [are in closed bodies](closed::are_closed).
    in_bodies: bool,
    /// The points that each emitter may light; `None` at infinity.
    regions: Vec<Option<LitRegion>>,
}

/// A path up to its last event.
#[derive(Clone, Copy, Debug)]
pub struct Path {
    /// The ray from the last event.
    ray: Ray,
    /// The point of the last event. The ray starts beside it, by the rounding error.
    from: Vec3,
    /// Density per unit solid angle of the ray's direction; infinite after the camera or a Dirac delta.
    pdf: f32,
    /// The probability with which an emitter is sampled at the last event, if its direction has a density.
    emitter_share: f32,
    /// The number of scattering events. To pass a surface unscattered is none.
    depth: u32,
    /// The index of the last event's point on the ray before it, if points near emitters were sampled there.
    on_leg: Option<u32>,
}

impl VolpathIntegrator {
    /// Creates the integrator.
    pub fn new(limits: PathLimits) -> Self {
        let paths = PathIntegrator::new(PathSettings::independent(limits));
        VolpathIntegrator { limits, paths, in_bodies: false, regions: Vec::new() }
    }
}

impl Plugin for VolpathIntegrator {
    const NAME: &'static str = "volpath";
    const HIDDEN_LIGHT: HiddenLight = HiddenLight::Missed;
    type Settings = PathLimits;

    fn read(source: &mut dyn Source) -> Result<PathLimits> {
        PathLimits::read(source)
    }

    fn with_limits(limits: PathLimits) -> PathLimits {
        limits
    }

    fn limits(limits: &PathLimits) -> PathLimits {
        *limits
    }

    fn create(limits: &PathLimits) -> Box<dyn Integrator> {
        Box::new(VolpathIntegrator::new(*limits))
    }
}

impl Integrator for VolpathIntegrator {
    fn name(&self) -> &'static str {
        "volpath"
    }

    fn shows_emitters(&self) -> bool {
        !self.limits.hide_emitters && self.limits.allows(1)
    }

    fn adapts(&self) -> bool {
        true
    }

    fn shows_environment(&self) -> bool {
        !self.limits.hide_emitters
    }

    fn check(&self, scene: &Scene) -> Result<()> {
        scene.check_media()
    }

    fn prepares(&self) -> bool {
        true
    }

    fn prepare(&mut self, preparation: &Preparation<'_>) -> Result<()> {
        let scene = preparation.scene;
        self.in_bodies = closed::are_closed(scene);
        if scene.media.as_ref().is_some_and(|media| media.scatters()) {
            self.regions = scene.lights.iter().map(Light::lit_region).collect();
        }
        Ok(())
    }

    fn li(
        &self,
        scene: &Scene,
        wave: Wave<'_>,
        query: RadianceQuery,
        worker: &mut Worker,
        out: &mut [Radiance],
    ) {
        let Some(media) = &scene.media else {
            return self.paths.li(scene, wave, query, worker, out);
        };
        if self.in_bodies && query == RadianceQuery::ALL {
            let mut bodies = Bodies::new(scene, media, self.limits);
            return self.paths.trace_through(&mut bodies, wave, query, worker, out);
        }
        let has_near = self.regions.iter().any(Option::is_some);
        let (limits, regions) = (self.limits, &self.regions);
        let tracer = Tracer { scene, media, limits, query, regions, has_near };
        let mut flights = Flights::new(tracer, std::mem::take(&mut worker.flights));
        self.paths.trace_through(&mut flights, wave, query, worker, out);
        worker.flights = flights.into_buffers();
    }
}
