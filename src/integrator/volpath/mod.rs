//! Path tracing in participating media. [Kajiya 1986; Veach 1997; Miller 2019]
//!
//! Surfaces are those of `path`. Between them, the ray of a path goes through boundaries of media that do not scatter
//! it (`null`, holes of a mask) until it is scattered in a medium or hits a surface ([`flights`]). At each event in a
//! medium an emitter is sampled, with the transmittance of the media up to it, and a direction, by the phase function.
//! Both are weighted by the power heuristic ([`event`]). In thin homogeneous media, a third technique samples points
//! near emitters ([`equiangular`]). If all media fill bodies that light enters at surfaces only, no emitter is sampled
//! in them ([`bodies`]). Without media, the integrator is `path`.

pub mod bodies;
pub mod closed;
mod emitter_samples;
mod equiangular;
mod event;
mod flights;

use self::bodies::Bodies;
use self::event::{EventNumbers, Tracer};
use self::flights::Flights;
use super::flight::stream;
use super::settings::{HiddenLight, PathLimits, PathSettings, Plugin, Source};
use super::worker::{draw_1d, draw_2d};
use super::{Integrator, PathIntegrator, Preparation, Radiance, RadianceQuery, Wave, Worker};
use crate::color::Rgb;
use crate::emitter::{Light, LitRegion};
use crate::error::Result;
use crate::ids::MediumId;
use crate::math::{Ray, Vec2, Vec3};
use crate::sampling::{Dimension, SampleKey, Sampler};
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
struct Path {
    /// The sample's key.
    key: SampleKey,
    /// The entry of the output to which the path contributes.
    slot: usize,
    /// The ray from the last event.
    ray: Ray,
    /// The medium in which the ray starts.
    medium: Option<MediumId>,
    /// The point of the last event. The ray starts beside it, by the rounding error.
    from: Vec3,
    /// Density per unit solid angle of the ray's direction; infinite after the camera or a Dirac delta.
    pdf: f32,
    /// The probability with which an emitter is sampled at the last event, if its direction has a density.
    emitter_share: f32,
    /// The product of the weights so far.
    beta: Rgb,
    /// The product of the relative indices of refraction.
    eta: f32,
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
        self.paths.trace_through(&mut Flights::new(tracer), wave, query, worker, out);
    }
}

/// The random numbers of an event, for a whole wave.
#[derive(Default)]
struct WaveNumbers {
    keys: Vec<SampleKey>,
    emitter_point: [Vec<f32>; 2],
    direction: [Vec<f32>; 2],
    roulette: Vec<f32>,
    free_flight: [Vec<f32>; 2],
    /// If there are emitters that are not at infinity.
    near_emitter: Option<([Vec<f32>; 2], Vec<f32>)>,
}

impl WaveNumbers {
    /// Creates numbers for points near emitters, too, if `has_near` is true.
    fn new(has_near: bool) -> Self {
        WaveNumbers { near_emitter: has_near.then(Default::default), ..WaveNumbers::default() }
    }

    /// Draws the random numbers of a wave's next event.
    fn draw(&mut self, bounce: u32, paths: &[Path], sampler: Sampler) {
        self.keys.clear();
        self.keys.extend(paths.iter().map(|path| path.key));
        draw_2d(sampler, Dimension::free_flight(bounce), &self.keys, &mut self.free_flight);
        draw_2d(sampler, Dimension::emitter_point(bounce), &self.keys, &mut self.emitter_point);
        if let Some((point, distance)) = &mut self.near_emitter {
            draw_2d(sampler, Dimension::emitter_point(bounce).repeat(1), &self.keys, point);
            draw_1d(sampler, Dimension::equiangular(bounce), &self.keys, distance);
        }
        draw_2d(sampler, Dimension::bsdf_direction(bounce), &self.keys, &mut self.direction);
        draw_1d(sampler, Dimension::roulette(bounce), &self.keys, &mut self.roulette);
    }

    /// Returns the numbers that choose channel and optical depth of the flight of path `i`.
    fn free_flight(&self, i: usize) -> Vec2 {
        Vec2::new(self.free_flight[0][i], self.free_flight[1][i])
    }

    /// Returns the random numbers of path `i`.
    fn of(&self, i: usize, bounce: u32) -> EventNumbers {
        let key = self.keys[i];
        let pair = |pair: &[Vec<f32>; 2]| Vec2::new(pair[0][i], pair[1][i]);
        EventNumbers {
            emitter_point: pair(&self.emitter_point),
            near_emitter: self.near_emitter.as_ref().map(|(point, distance)| (pair(point), distance[i])),
            direction: pair(&self.direction),
            roulette: self.roulette[i],
            shadow_streams: [1, 2].map(|purpose| stream(key, bounce, purpose)),
        }
    }
}
