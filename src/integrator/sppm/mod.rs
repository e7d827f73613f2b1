//! Stochastic progressive photon mapping with independent passes. [Hachisuka and Jensen 2009; Knaus and Zwicker 2011]
//!
//! Every sample of a pixel is a pass with its own photons, radius and time. A camera path continues through Dirac
//! deltas to the first surface with a finite lobe. There, emitters are sampled and photons that were scattered at
//! least once are gathered. The mean over the passes converges to the correct result: the radius decreases slowly
//! enough for the noise to vanish and fast enough for the blur to vanish.
//!
//! The incident light at a surface point is partitioned by its path, so that nothing is counted twice:
//!
//! - light from an emitter without a surface in between: emitter samples and BSDF samples, combined by multiple
//!   importance sampling;
//! - light from an emitter through Dirac deltas only (a caustic): photons;
//! - all other light: photons, if the surface has a diffuse lobe. If all finite lobes are glossy, few photons would
//!   be within them, and the path continues to the next surface as in path tracing.

mod camera_path;
mod gather;

use super::photon::{
    EmissionGuide, GridPhoton, LightPathTracer, PathLimit, PathSequence, PhotonGrid, PhotonPaths,
    VisibleSurfaces,
};
use super::progressive::{PreparedPass, Progressive, SamplePass};
use super::settings::{MAX_PHOTONS, PathLimits, Plugin, Read, Source};
use super::{Integrator, Preparation, Radiance, RadianceQuery, Statistic, Wave, Worker};
use crate::error::{Error, Result, counted};
use crate::memory::Reservation;
use crate::scene::Scene;
use camera_path::CameraPaths;
use gather::PhotonGather;
use std::sync::{Arc, PoisonError, RwLock};

/// The light paths that are traced for the memory plan: how many photons a path leaves depends on the scene.
const PILOT: u64 = 4096;
/// The stream of their random numbers.
const PILOT_STREAM: u32 = 7;
/// The least number of photons for each light path in the memory plan.
const PHOTONS_PER_PATH: u64 = 2;
/// The bytes of a photon: when traced, when sorted, in the grid of this pass and in that of the previous one.
const BYTES_PER_PHOTON: u64 = 150;

/// Stochastic progressive photon mapping. [Hachisuka and Jensen 2009; Knaus and Zwicker 2011]
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct SppmSettings {
    /// The paths from the camera and from emitters.
    pub limits: PathLimits,
    /// Light paths in each pass, with one pass for each sample of the pixels; 0 selects one for each pixel of the
    /// full image.
    pub photon_count: u32,
    /// Radius of the first pass in scene units; 0 selects three pixel widths.
    pub initial_radius: f32,
    /// Whether a pilot pass learns how to emit light paths whose photons are visible.
    pub guided: bool,
    /// Parameter of the radius reduction, in (0, 1]; 1 keeps the radius, and its blur, constant.
    pub alpha: f32,
}

impl Default for SppmSettings {
    fn default() -> Self {
        SppmSettings {
            limits: PathLimits::default(),
            photon_count: 0,
            initial_radius: 0.0,
            guided: true,
            alpha: 0.7,
        }
    }
}

/// The integrator. Its passes need [`Progressive::begin_sample`].
pub struct Sppm {
    settings: SppmSettings,
    /// The radius of the first pass in scene units.
    first_radius: f32,
    guide: Option<EmissionGuide>,
    pass: RwLock<Arc<PhotonPass>>,
    /// The reserved memory for the photons of a pass.
    reserved: Option<Reservation>,
}

/// The photons of one pass.
#[derive(Default)]
struct PhotonPass {
    grid: PhotonGrid,
    emitted: u64,
}

impl Sppm {
    /// Creates the integrator.
    pub fn new(settings: SppmSettings) -> Self {
        Sppm {
            settings,
            first_radius: settings.initial_radius,
            guide: None,
            pass: RwLock::default(),
            reserved: None,
        }
    }

    /// Returns the parameters of light paths.
    fn photon_paths(&self) -> PhotonPaths {
        PhotonPaths::scattered(self.settings.limits)
    }

    /// Reserves the memory for the photons of a pass.
    fn reserve(&self, preparation: &Preparation<'_>) -> Result<Reservation> {
        let Preparation { scene, sampler, seed, pool, interrupt, .. } = *preparation;
        let paths = self.paths_of_a_pass(preparation);
        let pilot = paths.min(PILOT);
        let sequence = PathSequence { seed, stream: PILOT_STREAM, number: 0, first: 0 };
        let tracer =
            LightPathTracer { scene, sampler, guide: self.guide.as_ref(), pool, interrupt, time: None };
        let until = PathLimit { paths: pilot, kept: None };
        let photons = tracer.cast(&self.photon_paths(), sequence, until, |_, _| Some(())).kept.len() as u64;
        let each = (photons as f64 / pilot as f64).max(PHOTONS_PER_PATH as f64);
        let needed = (paths as f64 * each * BYTES_PER_PHOTON as f64) as u64;
        preparation.memory.reserve(needed).map_err(|refusal| {
            let what = format!("the photons of {}", counted(paths, "light path", "light paths"));
            Error::scene(refusal.sentence(&what, "set photon_count to fewer")).about("sppm")
        })
    }

    /// Returns the number of light paths in a pass: the setting, or one for each pixel of the full image.
    fn paths_of_a_pass(&self, preparation: &Preparation<'_>) -> u64 {
        match self.settings.photon_count {
            0 => preparation.camera.film.full_area(),
            count => u64::from(count),
        }
    }

    fn pass(&self) -> Arc<PhotonPass> {
        self.pass.read().unwrap_or_else(PoisonError::into_inner).clone()
    }
}

/// Reads the radius of the first pass, in scene units, and the parameter of its reduction.
pub(super) fn read_radius(source: &mut dyn Source, radius: f32, alpha: f32) -> Result<(f32, f32)> {
    let radius = source.float("initial_radius")?.map_or(radius, |r| r as f32);
    if !(radius == 0.0 || (1e-18..=1e18).contains(&radius)) {
        let expected =
            "expected a radius of at least 1e-18 and at most 1e18, or 0 for three widths of a pixel";
        return Err(source.refusal("initial_radius", expected));
    }
    let alpha = source.float("alpha")?.map_or(alpha, |a| a as f32);
    if !(alpha > 0.0 && alpha <= 1.0) {
        return Err(source.refusal("alpha", "expected a number above 0 and at most 1"));
    }
    Ok((radius, alpha))
}

impl Plugin for Sppm {
    const NAME: &'static str = "sppm";
    type Settings = SppmSettings;

    fn read(source: &mut dyn Source) -> Result<SppmSettings> {
        source.ignore(&["granularity", "max_passes"], "the render job decides");
        let default = SppmSettings::default();
        let (initial_radius, alpha) = read_radius(source, default.initial_radius, default.alpha)?;
        Ok(SppmSettings {
            limits: PathLimits::read(source)?,
            photon_count: source.count("photon_count", 0..=MAX_PHOTONS, default.photon_count)?,
            initial_radius,
            guided: source.boolean("guided", default.guided)?,
            alpha,
        })
    }

    fn with_limits(limits: PathLimits) -> SppmSettings {
        SppmSettings { limits, ..SppmSettings::default() }
    }

    fn limits(settings: &SppmSettings) -> PathLimits {
        settings.limits
    }

    fn create(settings: &SppmSettings) -> Box<dyn Integrator> {
        Box::new(Sppm::new(*settings))
    }
}

impl Integrator for Sppm {
    fn name(&self) -> &'static str {
        "sppm"
    }

    fn shares_noise(&self) -> bool {
        true
    }

    fn shows_environment(&self) -> bool {
        !self.settings.limits.hide_emitters
    }

    fn prepares(&self) -> bool {
        true
    }

    fn prepare(&mut self, preparation: &Preparation<'_>) -> Result<()> {
        let visible_surfaces = VisibleSurfaces::of(preparation);
        if self.settings.initial_radius == 0.0 {
            self.first_radius = visible_surfaces.radius(preparation.scene);
        }
        if self.settings.guided {
            self.guide = EmissionGuide::towards(&visible_surfaces, preparation, self.settings.limits);
        }
        self.reserved = Some(self.reserve(preparation)?);
        Ok(())
    }

    fn statistics(&self) -> Vec<Statistic> {
        let pass = self.pass();
        vec![
            Statistic { name: "guided", value: f64::from(u8::from(self.guide.is_some())) },
            Statistic { name: "first_radius", value: self.first_radius.into() },
            Statistic { name: "last_radius", value: pass.grid.radius().into() },
            Statistic { name: "light_paths_of_a_pass", value: pass.emitted as f64 },
            Statistic { name: "photons_of_the_last_pass", value: pass.grid.len() as f64 },
            Statistic { name: "photon_memory_bytes", value: pass.grid.memory_bytes() as f64 },
        ]
    }

    fn progressive(&self) -> Option<&dyn Progressive> {
        Some(self)
    }

    fn li(
        &self,
        scene: &Scene,
        wave: Wave<'_>,
        query: RadianceQuery,
        worker: &mut Worker,
        out: &mut [Radiance],
    ) {
        let pass = self.pass();
        let gather = PhotonGather::new(scene, &pass.grid, pass.emitted);
        CameraPaths { scene, settings: &self.settings, query, gather: &gather }.trace(wave, worker, out);
    }
}

impl Progressive for Sppm {
    fn begin_sample(&self, pass: &SamplePass<'_>) -> PreparedPass {
        let Preparation { scene, sampler, pool, interrupt, .. } = *pass.preparation;
        let paths = self.paths_of_a_pass(pass.preparation);
        let sequence = pass.light_paths(paths);
        let time = pass.time();
        let tracer = LightPathTracer { scene, sampler, guide: self.guide.as_ref(), pool, interrupt, time };
        let until = PathLimit { paths, kept: None };
        let cast = tracer.cast(&self.photon_paths(), sequence, until, |d, _| Some(GridPhoton::new(d)));
        let first = match self.first_radius {
            0.0 => VisibleSurfaces::of(pass.preparation).radius(scene),
            radius => radius,
        };
        let radius = pass.radius(first, self.settings.alpha);
        let grid = pool.install(|| PhotonGrid::new(&cast.kept, radius));
        let pass = PhotonPass { grid, emitted: cast.emitted };
        *self.pass.write().unwrap_or_else(PoisonError::into_inner) = Arc::new(pass);
        PreparedPass { counters: cast.counters, invalid: cast.invalid, time, ..PreparedPass::default() }
    }
}
