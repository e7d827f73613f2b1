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
use crate::math::{Bounds, Vec3};
use crate::scene::Scene;
use interpolation::Interpolation;
use overture::Level;
use record::Record;
use shading::CachedPath;

/// Interpolates the indirect light of diffuse surfaces.
pub struct IrradianceCache {
    settings: IrrcacheSettings,
    /// Traces what coarse records gather; its paths begin two surfaces later than the camera's.
    child: Box<dyn Integrator>,
    /// Renders with the fine caches.
    fine: CachedPath,
    /// The records of the fine caches.
    records: [Vec<Record>; 2],
    facts: Vec<Fact>,
}

impl IrradianceCache {
    /// The integrator with its settings, and an empty cache.
    pub fn new(settings: &IrrcacheSettings) -> Self {
        let path = match settings.child.as_ref() {
            Settings::Path(path) => *path,
            _ => PathSettings::default(),
        };
        let gathered = match settings.child.as_ref() {
            Settings::Path(path) => Settings::Path(from_surface(path, 2)),
            other => other.clone(),
        };
        let fine = CachedPath { caches: empty(), path, only_cached: settings.indirect_only, far_only: false };
        IrradianceCache {
            settings: settings.clone(),
            child: create(&gathered),
            fine,
            records: Default::default(),
            facts: Vec::new(),
        }
    }

    /// The records of each half.
    pub fn records(&self) -> [&[Record]; 2] {
        [&self.records[0], &self.records[1]]
    }

    /// The cache that the gathering rays of the fine one look light up in.
    fn coarse(&self, preparation: &Preparation<'_>) -> (CachedPath, usize) {
        let settings = IrrcacheSettings { quality: COARSE * self.settings.quality, ..self.settings.clone() };
        let records = [0, 1]
            .map(|half| overture::run(preparation, &settings, self.child.as_ref(), half, Level::Coarse));
        let count = records.iter().map(Vec::len).sum();
        let bounds = preparation.scene.bounds;
        let caches = records.map(|records| Interpolation::new(&records, bounds, 1.0));
        let path = from_surface(&self.fine.path, 1);
        (CachedPath { caches, path, only_cached: false, far_only: true }, count)
    }
}

impl Integrator for IrradianceCache {
    fn name(&self) -> &'static str {
        "irrcache"
    }

    fn shows_environment(&self) -> bool {
        !self.fine.path.hide_emitters
    }

    fn prepare(&mut self, preparation: &Preparation<'_>) -> Result<()> {
        self.child.prepare(preparation)?;
        let bounds = preparation.scene.bounds;
        let (coarse, coarse_count) = self.coarse(preparation);
        self.records = [0, 1].map(|half| match self.settings.overture {
            true => overture::run(preparation, &self.settings, &coarse, half, Level::Fine),
            false => Vec::new(),
        });
        let scale = 1.0 / self.settings.quality_adjustment;
        self.fine.caches = [0, 1].map(|half: usize| Interpolation::new(&self.records[half], bounds, scale));
        let count = self.records.iter().map(Vec::len).sum::<usize>();
        let bytes = self.fine.caches.iter().map(Interpolation::memory_bytes).sum::<usize>();
        self.facts = vec![
            Fact { name: "irradiance_records", value: count as f64 },
            Fact { name: "irradiance_records_coarse", value: coarse_count as f64 },
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
        self.fine.li(scene, wave, query, worker, out);
    }
}

/// Quality of the coarse caches, as a share of that of the fine ones: what they miss is averaged over hemispheres.
const COARSE: f32 = 0.5;

/// The settings of paths that begin so many surfaces later than the camera's.
fn from_surface(path: &PathSettings, surfaces: u32) -> PathSettings {
    let max_depth = path.max_depth.map(|depth| depth.saturating_sub(surfaces));
    PathSettings { max_depth, hide_emitters: false, ..*path }
}

fn empty() -> [Interpolation; 2] {
    let nowhere = Bounds { min: Vec3::ZERO, max: Vec3::ONE };
    [(); 2].map(|()| Interpolation::new(&[], nowhere, 1.0))
}
