//! The distance to the first surface.

use super::{Integrator, Radiance, RadianceQuery, Wave, Worker};
use crate::color::Rgb;
use crate::scene::Scene;

/// Returns the distance along the ray to the first surface, measured from the near clipping plane, and 0 if there is
/// none.
pub struct DepthIntegrator;

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
