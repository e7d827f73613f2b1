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
//! Each half of the image's samples has maps of its own, so that the halves' difference knows the maps' noise. It does not
//! know their blur, which is the same in both.

mod caustics;
mod debug;
mod maps;
mod paths;

use super::DensityEstimator;
use crate::error::Result;
use crate::integrator::settings::{PhotonDebug, PhotonmapperSettings};
use crate::integrator::{Fact, Integrator, Preparation, Radiance, RadianceQuery, Wave, Worker};
use crate::scene::Scene;
use maps::Maps;
use std::sync::Arc;

pub use caustics::CausticMaps;

/// Final gathering over photon maps.
pub struct Photonmapper {
    settings: PhotonmapperSettings,
    /// For each half of the samples.
    maps: [Maps; 2],
    caustics: Arc<CausticMaps>,
    global: DensityEstimator,
    facts: Vec<Fact>,
}

impl Photonmapper {
    /// The integrator with its settings, and without photons.
    pub fn new(settings: PhotonmapperSettings) -> Self {
        let [caustics, global] = estimators(&settings, 1.0);
        let caustics = Arc::new(CausticMaps::new(caustics, [None, None]));
        Photonmapper { settings, maps: Default::default(), caustics, global, facts: Vec::new() }
    }
}

/// How photons become light, of the caustic map and of the global one, in a scene of that radius.
fn estimators(settings: &PhotonmapperSettings, scale: f32) -> [DensityEstimator; 2] {
    [settings.caustic_lookup_radius, settings.global_lookup_radius].map(|radius| DensityEstimator {
        kernel: settings.kernel,
        lookup_size: settings.lookup_size as usize,
        lookup_radius: radius * scale,
    })
}

impl Integrator for Photonmapper {
    fn name(&self) -> &'static str {
        "photonmapper"
    }

    fn shows_environment(&self) -> bool {
        !self.settings.hide_emitters
    }

    fn prepare(&mut self, preparation: &Preparation<'_>) -> Result<()> {
        let [caustics, global] = estimators(&self.settings, preparation.scene.bounds.radius());
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
