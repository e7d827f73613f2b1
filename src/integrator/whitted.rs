//! Whitted ray tracing: hard shadows, mirrors and glass. [Whitted 1980]
//!
//! At each surface, one shadow ray goes to the centre of each emitter, and one ray into each Dirac delta of the BSDF.
//! For glass these are both the reflection and the refraction, weighted by the Fresnel reflectance and transmittance,
//! so the rays form a binary tree. Only the position in the pixel, on the lens and in time is random.
//!
//! The result is biased for any number of samples. It lacks penumbrae, because every emitter is a point
//! ([`Light::sample_centre`](crate::emitter::Light::sample_centre)); light between diffuse or glossy surfaces; glossy
//! reflections other than highlights of emitter centres; light that reaches a surface through glass or a mirror
//! (caustics); and the environment, except where it is seen directly, in mirrors or through glass.

use super::block::ShadingBlock;
use super::lighting::TechniqueCounts;
use super::path_wave::PathWave;
use super::settings::{HiddenLight, PathLimits, Plugin, Read, Source};
use super::tree::{RayTree, TreeStrategy};
use super::{Integrator, Radiance, RadianceQuery, Wave, Worker};
use crate::emitter::Light;
use crate::error::{Error, Result};
use crate::math::lanes::bits;
use crate::scene::Scene;

/// Hard shadows, mirrors and glass. [Whitted 1980]
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
pub struct WhittedSettings {
    /// Greatest number of edges of a path from camera to emitter: 1 shows emitters only, 2 adds direct light (ray
    /// casting). At most [`MAX_DEPTH`](Self::MAX_DEPTH).
    pub max_depth: u32,
    /// Whether emitters are invisible to the camera.
    pub hide_emitters: bool,
}

impl WhittedSettings {
    /// The upper limit of `max_depth`: glass doubles the number of rays at every level.
    pub const MAX_DEPTH: u32 = 20;
    /// The greatest number of rays at the last level of a camera ray's tree.
    pub const MAX_RAYS: u64 = 1 << 20;
}

impl Default for WhittedSettings {
    fn default() -> Self {
        WhittedSettings { max_depth: 8, hide_emitters: false }
    }
}

/// Direct light from point emitters, mirrors and glass.
pub struct WhittedIntegrator {
    settings: WhittedSettings,
}

impl WhittedIntegrator {
    /// Creates the integrator.
    pub fn new(settings: WhittedSettings) -> Self {
        WhittedIntegrator { settings }
    }

    /// Queues a shadow ray to the emitter's centre from each point with a finite lobe.
    fn queue(
        &self,
        scene: &Scene,
        light: &Light,
        blocks: &[ShadingBlock<'_>],
        parents: &PathWave,
        worker: &mut Worker,
    ) {
        for block in blocks {
            for i in bits(block.finite) {
                let at = block.at.lane(i);
                let Some(sample) = light.sample_centre(at.p, at.time) else { continue };
                let wi = at.frame.to_local(sample.wi);
                let f = block.bsdfs[i].eval(block.wo.lane(i), wi).f;
                let parent = block.first + i;
                let value = parents.beta(parent) * f * sample.radiance * wi.z.abs();
                if value.is_black() {
                    continue;
                }
                worker.shadows.push_one(scene.shadow_ray(&at, &sample), parents.slots[parent], value);
            }
        }
    }
}

impl TreeStrategy for WhittedIntegrator {
    fn counts(&self, _depth: u32) -> TechniqueCounts {
        // All rays go into Dirac deltas, which no other technique samples.
        TechniqueCounts::ONE_EACH
    }

    fn delta_lanes(&self, _depth: u32, block: &ShadingBlock<'_>) -> u32 {
        block.active
    }

    fn rays(&self, _depth: u32) -> u32 {
        0
    }

    fn light(
        &self,
        tree: &RayTree<'_>,
        depth: u32,
        blocks: &[ShadingBlock<'_>],
        parents: &PathWave,
        worker: &mut Worker,
        out: &mut [Radiance],
    ) {
        for light in &tree.scene.lights {
            self.queue(tree.scene, light, blocks, parents, worker);
            worker.trace_shadows(tree.scene, tree.coherence(depth), |slot, value| out[slot].value += value);
        }
    }

    fn scatter(
        &self,
        _tree: &RayTree<'_>,
        _depth: u32,
        _i: u32,
        _blocks: &[ShadingBlock<'_>],
        _parents: &PathWave,
        _worker: &mut Worker,
    ) -> PathWave {
        PathWave::default()
    }
}

impl Plugin for WhittedIntegrator {
    const NAME: &'static str = "whitted";
    const HIDDEN_LIGHT: HiddenLight = HiddenLight::Missed;
    type Settings = WhittedSettings;

    fn read(source: &mut dyn Source) -> Result<WhittedSettings> {
        let default = WhittedSettings::default();
        Ok(WhittedSettings {
            max_depth: source.count("max_depth", 1..=WhittedSettings::MAX_DEPTH, default.max_depth)?,
            hide_emitters: source.boolean("hide_emitters", default.hide_emitters)?,
        })
    }

    fn with_limits(limits: PathLimits) -> WhittedSettings {
        let max_depth = limits.depth_within(WhittedSettings::default().max_depth);
        WhittedSettings { max_depth, hide_emitters: limits.hide_emitters }
    }

    fn limits(settings: &WhittedSettings) -> PathLimits {
        let WhittedSettings { max_depth, hide_emitters } = *settings;
        PathLimits { max_depth: Some(max_depth), hide_emitters, ..PathLimits::default() }
    }

    fn create(settings: &WhittedSettings) -> Box<dyn Integrator> {
        Box::new(WhittedIntegrator::new(*settings))
    }
}

impl Integrator for WhittedIntegrator {
    fn name(&self) -> &'static str {
        "whitted"
    }

    fn shows_environment(&self) -> bool {
        !self.settings.hide_emitters
    }

    fn check(&self, scene: &Scene) -> Result<()> {
        let (deltas, depth) = (scene.needs.deltas, self.settings.max_depth);
        let rays = u64::from(deltas).saturating_pow(depth.saturating_sub(1));
        if rays <= WhittedSettings::MAX_RAYS {
            return Ok(());
        }
        let most =
            (1..depth).rev().find(|d| u64::from(deltas).saturating_pow(d - 1) <= WhittedSettings::MAX_RAYS);
        Err(Error::scene(format!(
            "whitted: a material of the scene splits a ray into {deltas}, which makes {rays} rays for each camera ray at \
             max_depth {depth}: expected a max_depth of at most {}",
            most.unwrap_or(1)
        )))
    }

    fn li(
        &self,
        scene: &Scene,
        wave: Wave<'_>,
        query: RadianceQuery,
        worker: &mut Worker,
        out: &mut [Radiance],
    ) {
        out.fill(Radiance::NONE);
        worker.paths.begin(wave.rays, wave.keys);
        let tree = RayTree {
            scene,
            query,
            coherence: wave.coherence,
            max_depth: self.settings.max_depth,
            hide_emitters: self.settings.hide_emitters,
        };
        tree.trace(self, worker, out);
    }
}
