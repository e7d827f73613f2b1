//! The irradiance cache. [Ward 1988; Ward and Heckbert 1992; Křivánek 2005; Schwarzhaupt et al. 2012]
//!
//! Indirect light on diffuse surfaces changes slowly. It is gathered at few places by whole hemispheres of another integrator's
//! rays, and interpolated everywhere else; direct light, caustics and what glossy surfaces reflect are sampled as ever, but for caustics
//! that the child knows everywhere (`photonmapper`'s are the density of its photons). A
//! record's hemisphere asks the child for all light but what is emitted towards the record (direct light) and caustics, with any
//! number of bounces: so nothing is missing and nothing is counted twice.
//!
//! The overture goes over the image from coarse to fine and adds records where there are none, in batches of fixed size whose records
//! are computed in parallel and merged in order: the cache depends on the scene, the view and the seed, never on threads. The
//! final render only reads. Where no record reaches, the path goes on as if there were no cache.
//!
//! Each half of the image's samples has a cache of its own, so that the halves' difference knows the caches' noise. What
//! interpolation smooths away, both miss alike: that is the bias, and it is what `quality` is for.

mod file;
mod gathering;
pub mod hemisphere;
pub mod hessian;
pub mod interpolation;
pub mod octree;
mod overture;
mod places;
pub mod record;
mod shading;
pub mod weight;

use super::settings::{Aov, IrrcacheSettings, PathSettings, PhotonmapperSettings, Settings};
use super::{Fact, Integrator, Preparation, Radiance, RadianceQuery, Wave, Worker, create, preparation};
use crate::accel::Hit;
use crate::color::Rgb;
use crate::error::{Error, Result};
use crate::math::{Bounds, Ray, Vec2, Vec3};
use crate::sampling::SampleKey;
use crate::scene::Scene;
use file::Kept;
use interpolation::Interpolation;
use overture::Level;
use record::Record;
use shading::CachedPath;

/// Interpolates the indirect light of diffuse surfaces.
pub struct IrradianceCache {
    settings: IrrcacheSettings,
    /// Traces what coarse records gather. Its paths begin two surfaces later than the camera's, and `path` counts so; photon maps count
    /// from the record.
    child: Box<dyn Integrator>,
    /// Renders with the fine caches.
    fine: CachedPath,
    /// The records of the fine caches.
    records: [Vec<Record>; 2],
    /// Size of a pixel where camera rays begin, and how much it grows per unit of length.
    pixel: [f32; 2],
    facts: Vec<Fact>,
}

impl IrradianceCache {
    /// The integrator with its settings, and an empty cache.
    pub fn new(settings: &IrrcacheSettings) -> Self {
        let path = match settings.child.as_ref() {
            Settings::Path(path) => *path,
            Settings::Photonmapper(PhotonmapperSettings { max_depth, rr_depth, hide_emitters, .. }) => {
                PathSettings { max_depth: *max_depth, rr_depth: *rr_depth, hide_emitters: *hide_emitters }
            }
            _ => PathSettings::default(),
        };
        let gathered = match settings.child.as_ref() {
            Settings::Path(path) => Settings::Path(from_surface(path, 2)),
            // Emitters are hidden from the camera only.
            Settings::Photonmapper(mapper) => {
                Settings::Photonmapper(PhotonmapperSettings { hide_emitters: false, ..*mapper })
            }
            other => other.clone(),
        };
        let only_cached = settings.indirect_only;
        let fine = CachedPath { caches: empty(), path, only_cached, caustics: None, far_only: false };
        IrradianceCache {
            settings: settings.clone(),
            child: create(&gathered),
            fine,
            records: Default::default(),
            pixel: [0.0; 2],
            facts: Vec::new(),
        }
    }

    /// The records of each half.
    pub fn records(&self) -> [&[Record]; 2] {
        [&self.records[0], &self.records[1]]
    }

    /// Draws a dot over the image wherever the rays meet a record's place.
    fn draw_records(&self, scene: &Scene, wave: Wave<'_>, worker: &mut Worker, out: &mut [Radiance]) {
        worker.intersect(scene, wave.rays, wave.coherence);
        for (i, hit) in worker.hits.iter().enumerate() {
            let Some(hit) = hit else { continue };
            let ray = &wave.rays[i];
            let at = scene.interaction(ray, hit);
            let dot = DOT * (self.pixel[0] + self.pixel[1] * hit.t * ray.d.length());
            let half = wave.keys[i].half();
            if self.fine.caches[half].nearest(at.p) <= dot {
                out[i].value = DOT_COLOUR;
            }
        }
    }

    /// What records depend on, but for the scene.
    fn origin(&self) -> u64 {
        let IrrcacheSettings { resolution, quality, gradients, clamp_neighbor, clamp_screen, child, .. } =
            &self.settings;
        let text = format!("{resolution} {quality} {gradients} {clamp_neighbor} {clamp_screen} {child:?}");
        preparation::hash_of(&text)
    }

    /// What the file has, or nothing yet.
    fn kept(&self, preparation: &Preparation<'_>) -> Result<Kept> {
        match &preparation.cache {
            Some(file) if file.path.exists() => {
                let length = std::fs::metadata(&file.path).map_or(0, |about| about.len());
                // Its bytes, and the records that they are.
                let _reserved = preparation.memory.reserve(length.saturating_mul(3)).map_err(|refusal| {
                    let message = refusal.sentence("reading its records", "remove it");
                    Error::output(message).in_file(&file.path)
                })?;
                file::load_for(&file.path, file.scene, self.origin())
            }
            Some(file) => Ok(Kept { scene: file.scene, settings: self.origin(), ..Kept::default() }),
            None if self.settings.overture => Ok(Kept::default()),
            None => Err(Error::scene(
                "irrcache: without an overture the records must come from a file: expected --cache FILE",
            )),
        }
    }

    /// Adds the records that the view needs, the coarse ones first: the hemispheres of the fine ones look light up in them.
    fn extend(&self, kept: &mut Kept, preparation: &Preparation<'_>) {
        let bounds = preparation.scene.bounds;
        let [fine_a, fine_b, coarse_a, coarse_b] = std::mem::take(&mut kept.records);
        let settings = IrrcacheSettings { quality: COARSE * self.settings.quality, ..self.settings.clone() };
        // Both halves at once: where one has little to compute in parallel, the other has some more.
        let both =
            |settings: &IrrcacheSettings, child: &dyn Integrator, level: Level, known: [Vec<Record>; 2]| {
                let [a, b] = known;
                let run = |half, known| overture::run(preparation, settings, child, half, level, known);
                let (a, b) = preparation.pool.install(|| rayon::join(|| run(0, a), || run(1, b)));
                [a, b]
            };
        let coarse = both(&settings, self.child.as_ref(), Level::Coarse, [coarse_a, coarse_b]);
        let caches = [0, 1].map(|half: usize| Interpolation::new(&coarse[half], bounds, 1.0));
        let path = from_surface(&self.fine.path, 1);
        let caustics = self.fine.caustics.clone();
        let traced = CachedPath { caches, path, only_cached: false, caustics, far_only: true };
        let [fine_a, fine_b] = both(&self.settings, &traced, Level::Fine, [fine_a, fine_b]);
        let [coarse_a, coarse_b] = coarse;
        kept.records = [fine_a, fine_b, coarse_a, coarse_b];
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
        // The file is for the records.
        self.child.prepare(&Preparation { cache: None, ..*preparation })?;
        self.fine.caustics = self.child.caustics();
        let (camera, film) = (preparation.camera, preparation.camera.film);
        let centre = Vec2::new(film.width as f32, film.height as f32) * 0.5;
        let [a, b] = [centre, centre + Vec2::X].map(|p| camera.ray(p, Vec2::splat(0.5), 0.0));
        self.pixel = [(b.o - a.o).length(), (b.d - a.d).length()];
        let mut kept = self.kept(preparation)?;
        let view = preparation.cache.as_ref().map_or(0, |file| file.view);
        if self.settings.overture && !kept.views.contains(&view) {
            self.extend(&mut kept, preparation);
            kept.views.push(view);
            if let Some(file) = preparation.cache.as_ref().filter(|_| !(preparation.interrupted)()) {
                file::save(&file.path, &kept)?;
            }
        }
        let [fine_a, fine_b, coarse_a, coarse_b] = kept.records;
        self.records = [fine_a, fine_b];
        let coarse_count = coarse_a.len() + coarse_b.len();
        let bounds = preparation.scene.bounds;
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

    fn keeps_caches(&self) -> bool {
        true
    }

    fn layer(
        &self,
        layer: Aov,
        scene: &Scene,
        ray: &Ray,
        key: SampleKey,
        hit: Option<&Hit>,
        out: &mut [f32],
    ) {
        match (layer, hit) {
            (Aov::RecordRadius, Some(hit)) => {
                let at = scene.interaction(ray, hit);
                out[0] = self.fine.caches[key.half()].radius(at.p, at.frame.n);
            }
            _ => layer.evaluate(scene, ray, hit, out),
        }
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
        if self.settings.debug {
            self.draw_records(scene, wave, worker, out);
        }
    }
}

/// Radius of a record's dot in pixels.
const DOT: f32 = 1.0;
/// Colour of a record's dot: the customary yellow.
const DOT_COLOUR: Rgb = Rgb::new(1.0, 0.9, 0.0);
/// Quality of the coarse caches, as a share of that of the fine ones: what they miss is averaged over hemispheres.
const COARSE: f32 = 0.7;

/// The settings of paths that begin so many surfaces later than the camera's.
fn from_surface(path: &PathSettings, surfaces: u32) -> PathSettings {
    let max_depth = path.max_depth.map(|depth| depth.saturating_sub(surfaces));
    PathSettings { max_depth, hide_emitters: false, ..*path }
}

fn empty() -> [Interpolation; 2] {
    let nowhere = Bounds { min: Vec3::ZERO, max: Vec3::ONE };
    [(); 2].map(|()| Interpolation::new(&[], nowhere, 1.0))
}
