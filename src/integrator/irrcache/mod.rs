//! The irradiance cache. [Ward 1988; Ward and Heckbert 1992; Křivánek 2005]
//!
//! Indirect light on diffuse surfaces changes slowly. It is gathered at few places by whole hemispheres of another integrator's
//! rays, and interpolated everywhere else; direct light, caustics and what glossy surfaces reflect are sampled as ever. A
//! record's hemisphere asks the child for all light but what is emitted towards the record (direct light) and caustics, with any
//! number of bounces: so nothing is missing and nothing is counted twice.
//!
//! The overture goes over the image from coarse to fine and adds records where there are none, in batches of fixed size whose records
//! are computed in parallel and merged in order: the cache depends on the scene, the view and the seed, never on threads. The
//! final render only reads. Where no record reaches, the path goes on as if there were no cache.
//!
//! Each half of the image's samples has a cache of its own, so that the halves' difference knows the caches' noise. What
//! interpolation smooths away, both miss alike: that is the bias, and it is what `quality` is for.

mod gathering;
pub mod hemisphere;
pub mod interpolation;
pub mod octree;
mod overture;
mod places;
pub mod record;
mod shading;
pub mod weight;

use super::settings::{IrrcacheSettings, PathSettings, Settings};
use super::{Fact, Integrator, Preparation, Radiance, RadianceQuery, Wave, Worker, create};
use crate::error::Result;
use crate::math::Bounds;
use crate::scene::Scene;
use interpolation::Interpolation;
use record::Record;

/// Interpolates the indirect light of diffuse surfaces.
pub struct IrradianceCache {
    settings: IrrcacheSettings,
    /// What the lengths of paths may be, and which emitters are seen.
    path: PathSettings,
    /// Traces what records gather; its paths begin one surface later than the camera's.
    child: Box<dyn Integrator>,
    /// A cache for each half of the samples.
    caches: [Cache; 2],
    facts: Vec<Fact>,
}

/// The records of one half.
struct Cache {
    records: Vec<Record>,
    interpolation: Interpolation,
}

impl Cache {
    fn new(records: Vec<Record>, bounds: Bounds, scale: f32) -> Self {
        let interpolation = Interpolation::new(&records, bounds, scale);
        Cache { records, interpolation }
    }
}

impl IrradianceCache {
    /// The integrator with its settings, and an empty cache.
    pub fn new(settings: &IrrcacheSettings) -> Self {
        let path = match settings.child.as_ref() {
            Settings::Path(path) => *path,
            _ => PathSettings::default(),
        };
        let gathered = match settings.child.as_ref() {
            Settings::Path(path) => Settings::Path(PathSettings {
                max_depth: path.max_depth.map(|depth| depth.saturating_sub(1)),
                hide_emitters: false,
                ..*path
            }),
            other => other.clone(),
        };
        let nowhere = Bounds { min: crate::math::Vec3::ZERO, max: crate::math::Vec3::ONE };
        IrradianceCache {
            settings: settings.clone(),
            path,
            child: create(&gathered),
            caches: [(); 2].map(|()| Cache::new(Vec::new(), nowhere, 1.0)),
            facts: Vec::new(),
        }
    }

    /// The records of each half.
    pub fn records(&self) -> [&[Record]; 2] {
        [&self.caches[0].records, &self.caches[1].records]
    }
}

impl Integrator for IrradianceCache {
    fn name(&self) -> &'static str {
        "irrcache"
    }

    fn shows_environment(&self) -> bool {
        !self.path.hide_emitters
    }

    fn prepare(&mut self, preparation: &Preparation<'_>) -> Result<()> {
        self.child.prepare(preparation)?;
        let bounds = preparation.scene.bounds;
        let records = [0, 1].map(|half| match self.settings.overture {
            true => overture::run(preparation, &self.settings, self.child.as_ref(), half),
            false => Vec::new(),
        });
        let scale = 1.0 / self.settings.quality_adjustment;
        self.caches = records.map(|records| Cache::new(records, bounds, scale));
        let count = self.caches.iter().map(|cache| cache.records.len()).sum::<usize>();
        let bytes = self.caches.iter().map(|cache| cache.interpolation.memory_bytes()).sum::<usize>();
        self.facts = vec![
            Fact { name: "irradiance_records", value: count as f64 },
            Fact { name: "irradiance_cache_bytes", value: bytes as f64 },
        ];
        self.facts.extend(self.child.facts());
        Ok(())
    }

    fn facts(&self) -> Vec<Fact> {
        self.facts.clone()
    }

    fn li(
        &self,
        scene: &Scene,
        wave: Wave<'_>,
        query: RadianceQuery,
        worker: &mut Worker,
        out: &mut [Radiance],
    ) {
        shading::li(self, scene, wave, query, worker, out);
    }
}
