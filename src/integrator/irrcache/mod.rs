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
//! Each replicate of the image's samples has a cache of its own, so that their differences know the caches' noise and
//! what pixels share of it. What interpolation smooths away, all miss alike: that is the bias, and it is what
//! `quality` is for.

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

use super::preparation::refuse_motion;
use super::settings::{Aov, IrrcacheSettings, PathSettings, PhotonmapperSettings, Settings};
use super::{Fact, Integrator, Preparation, Radiance, RadianceQuery, Wave, Worker, create};
use crate::accel::Hit;
use crate::color::Rgb;
use crate::error::{Error, Result};
use crate::math::{Bounds, DVec2, Ray, Vec2, Vec3};
use crate::sampling::SampleKey;
use crate::scene::Scene;
use crate::util::digest;
use file::Kept;
use interpolation::Interpolation;
use overture::Level;
use rayon::prelude::*;
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
    records: Vec<Vec<Record>>,
    /// Size of a pixel where camera rays begin, and how much it grows per unit of length.
    pixel: [f32; 2],
    facts: Vec<Fact>,
}

impl IrradianceCache {
    /// The integrator with its settings, and an empty cache.
    pub fn new(settings: &IrrcacheSettings) -> Self {
        // The camera's paths, and what records gather: emitters are hidden from the camera only.
        let (path, gathered) = match settings.child.as_ref() {
            Settings::Path(path) => (*path, Settings::Path(from_surface(path, 2))),
            Settings::Photonmapper(mapper) => {
                let PhotonmapperSettings { max_depth, rr_depth, hide_emitters, .. } = *mapper;
                let seen = PhotonmapperSettings { hide_emitters: false, ..*mapper };
                (PathSettings { max_depth, rr_depth, hide_emitters }, Settings::Photonmapper(seen))
            }
            other => (PathSettings::default(), other.clone()),
        };
        let only_cached = settings.indirect_only;
        let fine = CachedPath { caches: empty(), path, only_cached, caustics: None, far_only: false };
        IrradianceCache {
            settings: settings.clone(),
            child: create(&gathered),
            fine,
            records: Vec::new(),
            pixel: [0.0; 2],
            facts: Vec::new(),
        }
    }

    /// The records of each replicate.
    pub fn records(&self) -> &[Vec<Record>] {
        &self.records
    }

    /// Draws a dot over the image wherever the rays meet a record's place.
    fn draw_records(&self, scene: &Scene, wave: Wave<'_>, worker: &mut Worker, out: &mut [Radiance]) {
        worker.intersect(scene, wave.rays, wave.coherence);
        for (i, hit) in worker.hits.iter().enumerate() {
            let Some(hit) = hit else { continue };
            let ray = &wave.rays[i];
            let at = scene.interaction(ray, hit);
            let dot = DOT * (self.pixel[0] + self.pixel[1] * hit.t * ray.d.length());
            if self.fine.cache(wave.keys[i]).nearest(at.p) <= dot {
                out[i].value = DOT_COLOUR;
            }
        }
    }

    /// What records depend on, but for the scene.
    fn origin(&self, preparation: &Preparation<'_>) -> u64 {
        let replicates = preparation.sampler.replicates();
        let IrrcacheSettings { resolution, quality, gradients, clamp_neighbor, clamp_screen, child, .. } =
            &self.settings;
        digest(&(resolution, quality, gradients, clamp_neighbor, clamp_screen, child, replicates))
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
                file::load_for(&file.path, file.scene, self.origin(preparation))
            }
            Some(file) => {
                Ok(Kept { scene: file.scene, settings: self.origin(preparation), ..Kept::default() })
            }
            None if self.settings.overture => Ok(Kept::default()),
            None => Err(Error::scene(
                "irrcache: without an overture the records must come from a file: expected --cache FILE",
            )),
        }
    }

    /// Adds the records that the view needs, the coarse ones first: the hemispheres of the fine ones look light up in them.
    fn extend(&self, kept: &mut Kept, preparation: &Preparation<'_>) {
        let bounds = preparation.scene.bounds;
        let replicates = preparation.sampler.replicates();
        kept.fine.resize(replicates as usize, Vec::new());
        kept.coarse.resize(replicates as usize, Vec::new());
        let settings = IrrcacheSettings { quality: COARSE * self.settings.quality, ..self.settings.clone() };
        // All replicates at once: where one has little to compute in parallel, the others have some more.
        let all =
            |settings: &IrrcacheSettings, child: &dyn Integrator, level: Level, known: Vec<Vec<Record>>| {
                let run =
                    |(replicate, known)| overture::run(preparation, settings, child, replicate, level, known);
                let known: Vec<_> = (0..replicates).zip(known).collect();
                preparation.pool.install(|| known.into_par_iter().map(run).collect::<Vec<_>>())
            };
        kept.coarse = all(&settings, self.child.as_ref(), Level::Coarse, std::mem::take(&mut kept.coarse));
        let caches = kept.coarse.iter().map(|records| Interpolation::new(records, bounds, 1.0)).collect();
        let path = from_surface(&self.fine.path, 1);
        let caustics = self.fine.caustics.clone();
        let traced = CachedPath { caches, path, only_cached: false, caustics, far_only: true };
        kept.fine = all(&self.settings, &traced, Level::Fine, std::mem::take(&mut kept.fine));
    }
}

impl Integrator for IrradianceCache {
    fn name(&self) -> &'static str {
        "irrcache"
    }

    fn shares_noise(&self) -> bool {
        true
    }

    fn shows_environment(&self) -> bool {
        !self.fine.path.hide_emitters
    }

    fn check(&self, scene: &Scene) -> Result<()> {
        refuse_motion("irrcache", "records", scene)
    }

    fn prepare(&mut self, preparation: &Preparation<'_>) -> Result<()> {
        self.check(preparation.scene)?;
        // The file is for the records.
        self.child.prepare(&Preparation { cache: None, ..*preparation })?;
        self.fine.caustics = self.child.caustics();
        let (camera, film) = (preparation.camera, preparation.camera.film);
        let centre = DVec2::new(film.width.into(), film.height.into()) * 0.5;
        let [a, b] = [centre, centre + DVec2::X].map(|p| camera.ray(p, Vec2::splat(0.5), 0.0));
        self.pixel = [(b.o - a.o).length(), (b.d - a.d).length()];
        let mut kept = self.kept(preparation)?;
        let view = preparation.cache.as_ref().map_or(0, |file| file.view);
        if self.settings.overture && !kept.views.contains(&view) {
            self.extend(&mut kept, preparation);
            kept.views.push(view);
            if let Some(file) = preparation.cache.as_ref().filter(|_| !preparation.interrupt.is_raised()) {
                file::save(&file.path, &kept)?;
            }
        }
        let coarse_count = kept.coarse.iter().map(Vec::len).sum::<usize>();
        self.records = kept.fine;
        self.records.resize(preparation.sampler.replicates() as usize, Vec::new());
        let bounds = preparation.scene.bounds;
        let scale = 1.0 / self.settings.quality_adjustment;
        let cache = |records: &Vec<Record>| Interpolation::new(records, bounds, scale);
        self.fine.caches = self.records.iter().map(cache).collect();
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
                out[0] = self.fine.cache(key).radius(at.p, at.frame.n);
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

fn empty() -> Vec<Interpolation> {
    let nowhere = Bounds { min: Vec3::ZERO, max: Vec3::ONE };
    vec![Interpolation::new(&[], nowhere, 1.0)]
}
