//! Ray tracing after Whitted: hard shadows, mirrors and glass. [Whitted 1980]
//!
//! At each surface one shadow ray goes to the middle of each emitter, and one ray into each Dirac delta of the BSDF:
//! both the reflection and the refraction of glass, weighted by their shares, so that rays form a binary tree. Nothing
//! is drawn at random but the position in the pixel, on the lens and in time.
//!
//! This is biased by design, and no number of samples makes up for it. Missing are: penumbrae, because every emitter
//! is a point ([`Light::sample_centre`](crate::emitter::Light::sample_centre)); light between diffuse or glossy surfaces;
//! reflections in glossy surfaces but the highlights of emitters' middles; light that reaches a surface through glass
//! or by a mirror (caustics); and the environment, except where it is seen directly, in mirrors or through glass.

use super::block::Block;
use super::lighting::TechniqueCounts;
use super::settings::WhittedSettings;
use super::tree::{Branching, Tree};
use super::worker::PathWave;
use super::{Integrator, Radiance, RadianceQuery, Wave, Worker};
use crate::emitter::Light;
use crate::error::{Error, Result};
use crate::math::lanes::bits;
use crate::scene::Scene;

/// Direct light from points, mirrors and glass.
pub struct WhittedIntegrator {
    settings: WhittedSettings,
}

impl WhittedIntegrator {
    /// The integrator with its settings.
    pub fn new(settings: WhittedSettings) -> Self {
        WhittedIntegrator { settings }
    }

    /// Queues a shadow ray from each point with a finite lobe to the middle of the light.
    fn queue(
        &self,
        scene: &Scene,
        light: &Light,
        blocks: &[Block<'_>],
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

impl Branching for WhittedIntegrator {
    fn counts(&self, _depth: u32) -> TechniqueCounts {
        // All rays go into Dirac deltas, which no other technique finds.
        TechniqueCounts::ONE_EACH
    }

    fn delta_lanes(&self, _depth: u32, block: &Block<'_>) -> u32 {
        block.active
    }

    fn rays(&self, _depth: u32) -> u32 {
        0
    }

    fn light(
        &self,
        tree: &Tree<'_>,
        depth: u32,
        blocks: &[Block<'_>],
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
        _tree: &Tree<'_>,
        _depth: u32,
        _i: u32,
        _blocks: &[Block<'_>],
        _parents: &PathWave,
        _worker: &mut Worker,
    ) -> PathWave {
        PathWave::default()
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
        let tree = Tree {
            scene,
            query,
            coherence: wave.coherence,
            max_depth: self.settings.max_depth,
            hide_emitters: self.settings.hide_emitters,
        };
        tree.follow(self, worker, out);
    }
}
