//! The integrator `photonmapper`. [Jensen 1996; Jensen 2001; Christensen 1999]
//!
//! Before the render, light paths leave photons on surfaces: the global map holds all of them, the caustic map those that
//! Dirac deltas alone have brought. At every fourth photon of the global map the irradiance is computed.
//!
//! A camera path follows mirrors, glass and glossy lobes to the first surface with a diffuse part. Direct light there is
//! sampled; caustics are the density of the caustic map; all other light is gathered by rays over the hemisphere, each of which
//! ends where it meets a diffuse part, at the irradiance of the nearest point that knows it. Where it meets none it goes
//! on. Rays that meet a surface closer than that point's disc is wide go on as a path, too, or corners would show blotches;
//! and those that see no such point, for light does not pass walls.
//!
//! It is biased: what gathering rays find is blurred over the discs of the global map and ends at `max_depth` counted from there,
//! so that paths by way of mirrors may be longer by the mirrored edges; caustics are blurred over the discs of the
//! caustic map. More photons blur less. Coated surfaces that gathering rays find count the light's directions as uniform.
//!
//! Each replicate of the image's samples has maps of its own, so that their differences know the maps' noise and what
//! pixels share of it. They do not know the maps' blur, which is the same in all.

mod caustics;
mod debug;
mod maps;
mod paths;

use super::{DensityEstimator, Place};
use crate::error::Result;
use crate::integrator::block::Block;
use crate::integrator::preparation::refuse_motion;
use crate::integrator::settings::{PhotonDebug, PhotonmapperSettings};
use crate::integrator::{Fact, Integrator, Preparation, Radiance, RadianceQuery, Wave, Worker};
use crate::scene::Scene;
use maps::Maps;
use std::sync::Arc;

pub use caustics::CausticMaps;

/// Final gathering over photon maps.
pub struct Photonmapper {
    settings: PhotonmapperSettings,
    /// For each replicate of the samples: as many as there are, a power of two.
    maps: Vec<Maps>,
    caustics: Arc<CausticMaps>,
    global: DensityEstimator,
    facts: Vec<Fact>,
}

impl Photonmapper {
    /// The integrator with its settings, and without photons.
    pub fn new(settings: PhotonmapperSettings) -> Self {
        let [caustics, global] = estimators(&settings, 1.0, 2);
        let caustics = Arc::new(CausticMaps::new(caustics, vec![None]));
        Photonmapper { settings, maps: vec![Maps::default()], caustics, global, facts: Vec::new() }
    }
}

/// How photons become light, of the caustic map and of the global one, in a scene of that radius. The maps of a half
/// of the samples share its photons and what is looked up of them, so that discs are as wide for any number of
/// replicates.
fn estimators(settings: &PhotonmapperSettings, scale: f32, replicates: u32) -> [DensityEstimator; 2] {
    let lookup_size = maps::share_of_half(u64::from(settings.lookup_size), replicates).max(2) as usize;
    [settings.caustic_lookup_radius, settings.global_lookup_radius].map(|radius| DensityEstimator {
        kernel: settings.kernel,
        lookup_size,
        lookup_radius: radius * scale,
    })
}

/// The place of a lane, on the side that the ray came from.
fn place(block: &Block<'_>, i: usize) -> Place {
    let (n, d) = (block.at.ng.lane(i), block.rays.d.lane(i));
    Place { p: block.at.p.lane(i), n: if n.dot(d) > 0.0 { -n } else { n } }
}

impl Integrator for Photonmapper {
    fn name(&self) -> &'static str {
        "photonmapper"
    }

    fn shares_noise(&self) -> bool {
        true
    }

    fn shows_environment(&self) -> bool {
        !self.settings.hide_emitters
    }

    fn check(&self, scene: &Scene) -> Result<()> {
        refuse_motion("photonmapper", "photons", scene)
    }

    fn prepare(&mut self, preparation: &Preparation<'_>) -> Result<()> {
        self.check(preparation.scene)?;
        let replicates = preparation.sampler.replicates();
        let [caustics, global] = estimators(&self.settings, preparation.scene.bounds.radius(), replicates);
        let prepared = maps::prepare(preparation, &self.settings, &global)?;
        self.caustics = Arc::new(CausticMaps::new(caustics, prepared.caustic));
        (self.global, self.maps, self.facts) = (global, prepared.maps, prepared.facts);
        Ok(())
    }

    fn facts(&self) -> Vec<Fact> {
        self.facts.clone()
    }

    fn keeps_caches(&self) -> bool {
        true
    }

    fn caustics(&self) -> Option<Arc<CausticMaps>> {
        (!self.caustics.is_empty()).then(|| Arc::clone(&self.caustics))
    }

    fn li(
        &self,
        scene: &Scene,
        wave: Wave<'_>,
        query: RadianceQuery,
        worker: &mut Worker,
        out: &mut [Radiance],
    ) {
        match self.settings.debug {
            PhotonDebug::None => paths::li(self, scene, wave, query, worker, out),
            show => debug::li(self, scene, show, wave, worker, out),
        }
    }
}
