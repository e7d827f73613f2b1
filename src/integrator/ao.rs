//! Ambient occlusion: how much of the hemisphere above a surface is open.

use super::block::ShadingBlock;
use super::path::first_hits;
use super::settings::{PathLimits, Plugin, Read, Source};
use super::worker::{draw_2d, intersect};
use super::{Integrator, Radiance, RadianceQuery, Wave, Worker};
use crate::color::Rgb;
use crate::error::Result;
use crate::math::lanes::{f32x16, load, with_sign};
use crate::sampling::{Dimension, warp};
use crate::scene::Scene;
use bumpalo::Bump;

/// Returns the fraction of the hemisphere above the first surface, weighted by the cosine, in which no surface is
/// nearer than a distance. That is the radiance of a white diffuse surface under a white sky, without the light of
/// other surfaces. Where rays hit nothing it is 1.
pub struct AmbientOcclusion {
    settings: AoSettings,
}

/// The parameters of ambient occlusion.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct AoSettings {
    /// The distance up to which surfaces occlude, in world units; infinite by default.
    pub radius: f32,
}

impl Plugin for AmbientOcclusion {
    const NAME: &'static str = "ao";
    type Settings = AoSettings;

    fn read(source: &mut dyn Source) -> Result<AoSettings> {
        // The name of Mitsuba 0.6.
        let name = if source.has("ray_length") { "ray_length" } else { "radius" };
        source.ignore(&["shading_samples"], "each sample of a pixel has one direction");
        Ok(AoSettings { radius: source.positive(name, f32::INFINITY)? })
    }

    fn with_limits(_: PathLimits) -> AoSettings {
        AoSettings { radius: f32::INFINITY }
    }

    fn limits(_: &AoSettings) -> PathLimits {
        PathLimits::default()
    }

    fn create(settings: &AoSettings) -> Box<dyn Integrator> {
        Box::new(AmbientOcclusion { settings: *settings })
    }
}

impl Integrator for AmbientOcclusion {
    fn name(&self) -> &'static str {
        "ao"
    }

    fn li(
        &self,
        scene: &Scene,
        wave: Wave<'_>,
        _query: RadianceQuery,
        worker: &mut Worker,
        out: &mut [Radiance],
    ) {
        out.fill(Radiance::NONE);
        worker.paths.begin(wave.rays, wave.keys);
        intersect(scene, &worker.paths.rays, wave.coherence, &mut worker.hits, &mut worker.counters);
        first_hits(scene, false, worker, out);
        let Worker { paths, hits, numbers, shadows, sampler, .. } = &mut *worker;
        for (out, _) in out.iter_mut().zip(&*hits).filter(|(_, hit)| hit.is_none()) {
            out.value = Rgb::WHITE;
        }
        paths.keep_hits(hits);
        draw_2d(*sampler, Dimension::bsdf_direction(0), &paths.keys, &mut numbers.bsdf_direction);
        for block in ShadingBlock::all(scene, &Bump::new(), &paths.rays, hits) {
            let at = &block.at;
            let u = [0, 1].map(|k| load(&numbers.bsdf_direction[k], block.first));
            let local = warp::square_to_cosine_hemisphere_x16(u);
            // The hemisphere is on the viewer's side.
            let wi = at.frame.to_world(local) * with_sign(f32x16::ONE, block.wo.z);
            // The surface itself occludes directions below it that a bent shading normal permits.
            let above = (wi.dot(at.ng) * -block.rays.d.dot(at.ng)).simd_gt(f32x16::ZERO);
            let mut rays = scene.spawn_rays(at, wi, block.rays.time);
            rays.t_max = f32x16::splat(self.settings.radius);
            let lanes = above.to_bitmask() & block.active;
            shadows.push(&rays, &paths.slots[block.first..], &[f32x16::ONE; 3], lanes);
        }
        worker.trace_shadows(scene, wave.coherence, |slot, value| out[slot].value += value);
    }
}
