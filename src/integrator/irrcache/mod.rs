//! The irradiance cache. [Ward 1988; Ward and Heckbert 1992; Křivánek 2005; Schwarzhaupt et al. 2012]
//!
//! Indirect light on diffuse surfaces varies slowly. The cache gathers it at few points, each with a full hemisphere
//! of rays of another integrator, and interpolates it elsewhere. Direct light, caustics and glossy reflections are
//! sampled as usual. The only exception are caustics for which the child has a map (`photonmapper` has the density of
//! its photons). The hemisphere of a record queries the child for all light, with any number of bounces, except
//! caustics and the light emitted towards the record (direct light). No light is therefore lost or counted twice.
//!
//! The overture pass goes over the image from coarse to fine and adds records where no record covers the surface. It
//! works in batches of fixed size, whose records are computed in parallel and merged in order, so the cache depends
//! on the scene, the view and the seed, but not on threads. The final render only reads the cache. Where no record
//! covers a point, the path continues as without a cache.
//!
//! Each replicate of the image's samples has its own cache, so the differences between replicates include the noise
//! of the caches, also where pixels share it. The smoothing of the interpolation is the same in all replicates. It is
//! the bias, which `quality` controls.

mod diffuse_points;
mod file;
mod gathering;
pub mod hemisphere;
pub mod hessian;
pub mod interpolation;
pub mod octree;
mod overture;
pub mod record;
mod shading;
pub mod weight;

use super::preparation::reject_motion;
use super::settings::{
    Aov, HiddenLight, PathLimits, PathSettings, PhotonmapperSettings, Plugin, Read, Settings, Source,
};
use super::{
    Counters, Integrator, PathIntegrator, Photonmapper, Preparation, Radiance, RadianceQuery, Statistic,
    Wave, Worker,
};
use crate::accel::Hit;
use crate::color::Rgb;
use crate::error::{Error, Result};
use crate::math::{Bounds, DVec2, Ray, Vec2, Vec3};
use crate::sampling::SampleKey;
use crate::scene::Scene;
use crate::util::digest;
use crate::util::wording::quoted;
use file::CacheContents;
use interpolation::Interpolation;
use octree::Octree;
use overture::RecordLevel;
use rayon::prelude::*;
use record::Record;
use shading::CachedPath;

/// Irradiance caching around another integrator. [Ward 1988]
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct IrrcacheSettings {
    /// Number of elevation strata of a record's hemisphere, at least 2; there are π times as many azimuth strata.
    /// Each of the eight replicates has its own records.
    pub resolution: u32,
    /// Accuracy, positive. The radii of records are inversely proportional to it, so their number grows with its
    /// square.
    pub quality: f32,
    /// Whether interpolation uses the records' gradients.
    pub gradients: bool,
    /// Whether a record's radius is limited by its neighbours' radii. [Křivánek 2006]
    pub clamp_neighbor: bool,
    /// Whether the radii of records are clamped to a range in pixels.
    pub clamp_screen: bool,
    /// Whether an overture pass creates records over the image. Otherwise records come only from a cache file.
    pub overture: bool,
    /// Factor on the quality when the cache is used, in (0, 1]; a smaller factor averages more records.
    pub quality_adjustment: f32,
    /// Whether only the light from the cache is shown.
    pub indirect_only: bool,
    /// Whether the positions of records are drawn over the image.
    pub debug: bool,
    /// The integrator of the light that records gather.
    pub child: Box<Settings>,
}

impl Default for IrrcacheSettings {
    fn default() -> Self {
        IrrcacheSettings {
            resolution: 9,
            quality: 1.0,
            gradients: true,
            clamp_neighbor: true,
            clamp_screen: true,
            overture: true,
            quality_adjustment: 0.7,
            indirect_only: false,
            debug: false,
            child: Box::default(),
        }
    }
}

/// The integrators that can compute the light that records gather.
const GATHERERS: [&str; 2] = [PathIntegrator::NAME, Photonmapper::NAME];

/// An integrator that interpolates the indirect light of diffuse surfaces.
pub struct IrradianceCache {
    settings: IrrcacheSettings,
    /// The integrator of the light that coarse records gather. Its paths begin two surfaces after the camera's; the
    /// depth limits of `path` take this into account, while photon maps count from the record.
    child: Box<dyn Integrator>,
    /// The integrator of the image, which uses the fine caches.
    fine: CachedPath,
    /// The records of the fine caches.
    records: Vec<Vec<Record>>,
    /// The size of a pixel at the origin of camera rays, and its growth per unit of length.
    pixel: [f32; 2],
    statistics: Vec<Statistic>,
}

impl IrradianceCache {
    /// Creates the integrator with an empty cache.
    pub fn new(settings: &IrrcacheSettings) -> Self {
        // Emitters are hidden from the camera only, not from the rays of records.
        let (path, gathered) = match settings.child.as_ref() {
            Settings::Path(path) => {
                let gathered = from_surface(&path.limits, 2);
                (path.limits, Settings::Path(PathSettings::independent(gathered)))
            }
            Settings::Photonmapper(mapper) => {
                let limits = PathLimits { hide_emitters: false, ..mapper.limits };
                (mapper.limits, Settings::Photonmapper(PhotonmapperSettings { limits, ..*mapper }))
            }
            other => (PathLimits::default(), other.clone()),
        };
        let only_cached = settings.indirect_only;
        let fine = CachedPath { caches: empty(), path, only_cached, caustics: None, far_only: false };
        IrradianceCache {
            settings: settings.clone(),
            child: gathered.create(),
            fine,
            records: Vec::new(),
            pixel: [0.0; 2],
            statistics: Vec::new(),
        }
    }

    /// Returns the records of each replicate.
    pub fn records(&self) -> &[Vec<Record>] {
        &self.records
    }

    /// Draws a dot where a ray hits the surface near a record.
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

    /// Returns the hash of the settings on which records depend.
    fn origin(&self, preparation: &Preparation<'_>) -> u64 {
        let replicates = preparation.sampler.replicates();
        let IrrcacheSettings { resolution, quality, gradients, clamp_neighbor, clamp_screen, child, .. } =
            &self.settings;
        digest(&(resolution, quality, gradients, clamp_neighbor, clamp_screen, child, replicates))
    }

    /// Returns the content of the cache file, or an empty cache.
    fn contents(&self, preparation: &Preparation<'_>) -> Result<CacheContents> {
        match &preparation.cache {
            Some(file) if file.path.exists() => {
                let length = std::fs::metadata(&file.path).map_or(0, |about| about.len());
                // The factor accounts for the file's bytes and the decoded records.
                let _reserved = preparation.memory.reserve(length.saturating_mul(3)).map_err(|refusal| {
                    let message = refusal.sentence("reading its records", "remove it");
                    Error::output(message).in_file(&file.path)
                })?;
                file::load_for(&file.path, file.scene, self.origin(preparation))
            }
            Some(file) => Ok(CacheContents {
                scene: file.scene,
                settings: self.origin(preparation),
                ..CacheContents::default()
            }),
            None if self.settings.overture => Ok(CacheContents::default()),
            None => Err(Error::scene(
                "irrcache: with overture=false, records come from a file only: expected --cache FILE",
            )),
        }
    }

    /// Returns the records with radii that are divided by the quality adjustment. With clamping, the radii of
    /// neighbours still differ by at most their distance: otherwise far records, which are often darker, would
    /// have much weight among small ones.
    fn widened(&self, records: &[Record], bounds: Bounds) -> Vec<Record> {
        let widen = |r: &Record| Record { radius: r.radius / self.settings.quality_adjustment, ..*r };
        let mut widened: Vec<Record> = records.iter().map(widen).collect();
        if self.settings.clamp_neighbor {
            let tree = Octree::of(&widened, bounds);
            for (record, own) in records.iter().zip(widened.clone()) {
                for &i in tree.near(record.p) {
                    let other = &mut widened[i as usize];
                    if other.n.dot(record.n) > 0.0 {
                        let most = own.radius + (other.p - record.p).length();
                        other.radius = other.radius.min(most.max(records[i as usize].radius));
                    }
                }
            }
        }
        widened
    }

    /// Adds the records that the view needs, and counts the rays. The coarse records come first, because the
    /// hemispheres of the fine ones use them.
    fn extend(&self, contents: &mut CacheContents, preparation: &Preparation<'_>, rays: &mut Counters) {
        let bounds = preparation.scene.bounds;
        let replicates = preparation.sampler.replicates();
        contents.fine.resize(replicates as usize, Vec::new());
        contents.coarse.resize(replicates as usize, Vec::new());
        let settings = IrrcacheSettings { quality: COARSE * self.settings.quality, ..self.settings.clone() };
        // All replicates run at the same time, so that threads stay busy while one replicate has little parallel
        // work.
        let mut all = |settings: &IrrcacheSettings,
                       child: &dyn Integrator,
                       level: RecordLevel,
                       known: Vec<Vec<Record>>| {
            let run =
                |(replicate, known)| overture::run(preparation, settings, child, replicate, level, known);
            let known: Vec<_> = (0..replicates).zip(known).collect();
            let added = preparation.pool.install(|| known.into_par_iter().map(run).collect::<Vec<_>>());
            let (records, counters): (Vec<_>, Vec<_>) = added.into_iter().unzip();
            counters.iter().for_each(|counters| rays.merge(counters));
            records
        };
        contents.coarse =
            all(&settings, self.child.as_ref(), RecordLevel::Coarse, std::mem::take(&mut contents.coarse));
        let caches = contents.coarse.iter().map(|records| Interpolation::new(records, bounds)).collect();
        let path = from_surface(&self.fine.path, 1);
        let caustics = self.fine.caustics.clone();
        let traced = CachedPath { caches, path, only_cached: false, caustics, far_only: true };
        contents.fine = all(&self.settings, &traced, RecordLevel::Fine, std::mem::take(&mut contents.fine));
    }
}

impl Plugin for IrradianceCache {
    const NAME: &'static str = "irrcache";
    const HIDDEN_LIGHT: HiddenLight = HiddenLight::Missed;
    type Settings = IrrcacheSettings;

    fn read(source: &mut dyn Source) -> Result<IrrcacheSettings> {
        let default = IrrcacheSettings::default();
        let child = source.integrator()?.map_or(default.child, Box::new);
        if !GATHERERS.contains(&child.name()) {
            return Err(source.object_error(&format!(
                "expected an integrator inside it that follows light through any number of bounces ({}), found {}",
                GATHERERS.join(", "),
                quoted(child.name())
            )));
        }
        let quality_adjustment = source.positive("quality_adjustment", default.quality_adjustment)?;
        if quality_adjustment > 1.0 {
            return Err(source.refusal("quality_adjustment", "expected at most 1"));
        }
        Ok(IrrcacheSettings {
            resolution: source.count("resolution", 2..=256, default.resolution)?,
            quality: source.positive("quality", default.quality)?,
            gradients: source.boolean("gradients", default.gradients)?,
            clamp_neighbor: source.boolean("clamp_neighbor", default.clamp_neighbor)?,
            clamp_screen: source.boolean("clamp_screen", default.clamp_screen)?,
            overture: source.boolean("overture", default.overture)?,
            quality_adjustment,
            indirect_only: source.boolean("indirect_only", default.indirect_only)?,
            debug: source.boolean("debug", default.debug)?,
            child,
        })
    }

    fn with_limits(limits: PathLimits) -> IrrcacheSettings {
        IrrcacheSettings { child: Box::new(Settings::Path(limits.into())), ..IrrcacheSettings::default() }
    }

    fn limits(settings: &IrrcacheSettings) -> PathLimits {
        match settings.child.as_ref() {
            Settings::Path(path) => path.limits,
            _ => PathLimits::default(),
        }
    }

    fn create(settings: &IrrcacheSettings) -> Box<dyn Integrator> {
        Box::new(IrradianceCache::new(settings))
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
        reject_motion("irrcache", "records", scene)
    }

    fn prepare(&mut self, preparation: &Preparation<'_>) -> Result<()> {
        self.check(preparation.scene)?;
        // The cache file stores only the records.
        self.child.prepare(&Preparation { cache: None, ..*preparation })?;
        self.fine.caustics = self.child.caustics();
        let (camera, film) = (preparation.camera, preparation.camera.film);
        let centre = DVec2::new(film.width.into(), film.height.into()) * 0.5;
        let [a, b] = [centre, centre + DVec2::X].map(|p| camera.ray(p, Vec2::splat(0.5), 0.0));
        self.pixel = [(b.o - a.o).length(), (b.d - a.d).length()];
        let mut contents = self.contents(preparation)?;
        let view = preparation.cache.as_ref().map_or(0, |file| file.view);
        let of_child = self.child.statistics();
        let mut rays = Statistic::rays(&of_child);
        if self.settings.overture && !contents.views.contains(&view) {
            self.extend(&mut contents, preparation, &mut rays);
            contents.views.push(view);
            if let Some(file) = preparation.cache.as_ref().filter(|_| !preparation.interrupt.is_raised()) {
                file::save(&file.path, &contents)?;
            }
        }
        let coarse_count = contents.coarse.iter().map(Vec::len).sum::<usize>();
        self.records = contents.fine;
        self.records.resize(preparation.sampler.replicates() as usize, Vec::new());
        let bounds = preparation.scene.bounds;
        let cache = |records: &Vec<Record>| Interpolation::new(&self.widened(records, bounds), bounds);
        self.fine.caches = self.records.iter().map(cache).collect();
        let count = self.records.iter().map(Vec::len).sum::<usize>();
        let bytes = self.fine.caches.iter().map(Interpolation::memory_bytes).sum::<usize>();
        self.statistics = vec![
            Statistic { name: "irradiance_records", value: count as f64 },
            Statistic { name: "irradiance_records_coarse", value: coarse_count as f64 },
            Statistic { name: "irradiance_cache_bytes", value: bytes as f64 },
        ];
        self.statistics.extend(Statistic::of_rays(&rays));
        self.statistics.extend(of_child.into_iter().filter(|of_child| !of_child.is_rays()));
        Ok(())
    }

    fn statistics(&self) -> Vec<Statistic> {
        self.statistics.clone()
    }

    fn supports_cache_file(&self) -> bool {
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
/// Colour of a record's dot: the traditional yellow.
const DOT_COLOUR: Rgb = Rgb::new(1.0, 0.9, 0.0);
/// The quality of the coarse caches relative to that of the fine ones. Their error is averaged over hemispheres.
const COARSE: f32 = 0.7;

/// Returns the settings of paths that begin the given number of surfaces after the camera's.
fn from_surface(path: &PathLimits, surfaces: u32) -> PathLimits {
    let max_depth = path.max_depth.map(|depth| depth.saturating_sub(surfaces));
    PathLimits { max_depth, hide_emitters: false, ..*path }
}

fn empty() -> Vec<Interpolation> {
    let nowhere = Bounds { min: Vec3::ZERO, max: Vec3::ONE };
    vec![Interpolation::new(&[], nowhere)]
}
