//! The distance to the first surface.

use super::settings::{PathLimits, Plugin, Source};
use super::{Integrator, Radiance, RadianceQuery, Wave, Worker};
use crate::color::Rgb;
use crate::error::Result;
use crate::scene::Scene;

/// Returns the distance along the ray to the first surface, measured from the near clipping plane, and 0 if there is
/// none.
pub struct DepthIntegrator;

/// It has no parameters.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
pub struct DepthSettings;

impl Plugin for DepthIntegrator {
    const NAME: &'static str = "depth";
    type Settings = DepthSettings;

    fn read(_: &mut dyn Source) -> Result<DepthSettings> {
        Ok(DepthSettings)
    }

    fn with_limits(_: PathLimits) -> DepthSettings {
        DepthSettings
    }

    fn limits(_: &DepthSettings) -> PathLimits {
        PathLimits::default()
    }

    fn create(_: &DepthSettings) -> Box<dyn Integrator> {
        Box::new(DepthIntegrator)
    }
}

impl Integrator for DepthIntegrator {
    fn name(&self) -> &'static str {
        "depth"
    }

    fn li(
        &self,
        scene: &Scene,
        wave: Wave<'_>,
        _query: RadianceQuery,
        worker: &mut Worker,
        out: &mut [Radiance],
    ) {
        worker.intersect(scene, wave.rays, wave.coherence);
        for (out, hit) in out.iter_mut().zip(&worker.hits) {
            *out = hit.map_or(Radiance::NONE, |h| Radiance { value: Rgb::splat(h.t), distance: h.t });
        }
    }
}
