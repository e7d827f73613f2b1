//! Vertex connection and merging: bidirectional path tracing and progressive photon mapping in one estimator.
//! [Georgiev et al. 2012; Hachisuka et al. 2012]
//!
//! Every sample of a pixel is a pass with its own light paths, one for each pixel of the full image. Their vertices are
//! connected to the camera, and camera paths are merged with those that end nearby. All other techniques are those of
//! [`bdpt`](super::bdpt), with light paths of their own. Multiple importance sampling combines all of them. The radius
//! of a pass shrinks as that of [`sppm`](super::sppm), so the blur vanishes.

use super::bdpt::merging::{LightPass, Merging};
use super::bdpt::technique::Techniques;
use super::bdpt::{LightPathSettings, trace_both};
use super::photon::{EmissionGuide, PathSequence, VisibleSurfaces};
use super::progressive::{PreparedPass, Progressive, SamplePass};
use super::settings::{PathLimits, Plugin, Source, SppmSettings};
use super::sppm::read_radius;
use super::{Bdpt, Integrator, Preparation, Radiance, RadianceQuery, Splat, Sppm, Statistic, Wave, Worker};
use crate::error::{Error, Result, counted};
use crate::memory::Reservation;
use crate::scene::Scene;
use crate::sensor::Camera;
use std::sync::{Arc, PoisonError, RwLock};

/// The light paths that are traced for the memory plan: how many vertices a path has depends on the scene.
const PILOT: u64 = 4096;
/// The stream of their random numbers.
const PILOT_STREAM: u32 = 7;
/// The bytes of a vertex with which camera paths may be merged: when traced, when sorted, in the grid of this pass and
/// in that of the previous one.
const BYTES_PER_END: u64 = 320;

/// Vertex connection and merging. [Georgiev et al. 2012; Hachisuka et al. 2012]
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct VcmSettings {
    /// The paths from the camera and from emitters.
    pub limits: PathLimits,
    /// Radius of the first pass in scene units; 0 selects three pixel widths.
    pub initial_radius: f32,
    /// Parameter of the radius reduction, in (0, 1]; 1 keeps the radius, and its blur, constant.
    pub alpha: f32,
    /// Whether vertices are connected and merged. Connections without merging are [`bdpt`](super::bdpt). Merging
    /// without connections is progressive photon mapping: [`sppm`](super::sppm).
    pub combined: Combined,
}

/// What is combined with the samples of emitters and of BSDFs.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub enum Combined {
    /// Connections and merging.
    #[default]
    Both,
    /// Connections.
    Connections,
    /// Merging.
    Merging,
}

impl Default for VcmSettings {
    fn default() -> Self {
        VcmSettings {
            limits: PathLimits::default(),
            initial_radius: 0.0,
            alpha: 0.75,
            combined: Combined::Both,
        }
    }
}

/// The integrator. Its passes need [`Progressive::begin_sample`].
pub struct Vcm {
    settings: VcmSettings,
    /// The radius of the first pass in scene units.
    first_radius: f32,
    /// The width of a pixel on the surfaces seen, in scene units.
    pixel: f32,
    camera: Option<Camera>,
    guide: Option<EmissionGuide>,
    pass: RwLock<Arc<Merging>>,
    /// The reserved memory for the light paths of a pass.
    reserved: Option<Reservation>,
}

impl Vcm {
    fn pass(&self) -> Arc<Merging> {
        self.pass.read().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// Returns a pass with one light path for each pixel. Each path has its own time, and the film has no margin.
    fn light_pass(
        &self,
        preparation: &Preparation<'_>,
        sequence: PathSequence,
        radius: f32,
    ) -> LightPass<'_> {
        let (limits, pixel) = (self.settings.limits, self.pixel);
        let paths = preparation.camera.film.full_area();
        LightPass {
            guide: self.guide.as_ref(),
            limits,
            sequence,
            paths,
            radius,
            pixel,
            time: None,
            margin: 0.0,
        }
    }
}

impl Plugin for Vcm {
    const NAME: &'static str = "vcm";
    type Settings = VcmSettings;

    fn read(source: &mut dyn Source) -> Result<VcmSettings> {
        let default = VcmSettings::default();
        let (initial_radius, alpha) = read_radius(source, default.initial_radius, default.alpha)?;
        let connections = source.boolean("connections", true)?;
        let combined = match (connections, source.boolean("merging", true)?) {
            (true, true) => Combined::Both,
            (true, false) => Combined::Connections,
            (false, true) => Combined::Merging,
            (false, false) => {
                return Err(
                    source.error("merging", "without it and connections, no light path counts: use path")
                );
            }
        };
        Ok(VcmSettings { limits: PathLimits::read(source)?, initial_radius, alpha, combined })
    }

    fn with_limits(limits: PathLimits) -> VcmSettings {
        VcmSettings { limits, ..VcmSettings::default() }
    }

    fn limits(settings: &VcmSettings) -> PathLimits {
        settings.limits
    }

    fn create(settings: &VcmSettings) -> Box<dyn Integrator> {
        let VcmSettings { limits, initial_radius, alpha, combined } = *settings;
        match combined {
            Combined::Both => {}
            Combined::Connections => return Bdpt::create(&Bdpt::with_limits(limits)),
            Combined::Merging => {
                return Sppm::create(&SppmSettings { initial_radius, alpha, ..Sppm::with_limits(limits) });
            }
        }
        Box::new(Vcm {
            settings: *settings,
            first_radius: initial_radius,
            pixel: 0.0,
            camera: None,
            guide: None,
            pass: RwLock::default(),
            reserved: None,
        })
    }
}

impl Integrator for Vcm {
    fn name(&self) -> &'static str {
        Self::NAME
    }

    fn shares_noise(&self) -> bool {
        true
    }

    fn shows_environment(&self) -> bool {
        !self.settings.limits.hide_emitters
    }

    fn traces_light_paths(&self) -> bool {
        true
    }

    fn prepares(&self) -> bool {
        true
    }

    fn prepare(&mut self, preparation: &Preparation<'_>) -> Result<()> {
        let visible_surfaces = VisibleSurfaces::of(preparation);
        self.pixel = visible_surfaces.pixel(preparation.scene);
        if self.settings.initial_radius == 0.0 {
            self.first_radius = visible_surfaces.radius(preparation.scene);
        }
        self.guide = EmissionGuide::towards(&visible_surfaces, preparation, self.settings.limits);
        let paths = preparation.camera.film.full_area();
        let sequence = PathSequence { seed: preparation.seed, stream: PILOT_STREAM, number: 0, first: 0 };
        let pilot = LightPass {
            paths: paths.min(PILOT),
            ..self.light_pass(preparation, sequence, self.first_radius)
        };
        let traced = pilot.trace(preparation);
        let splats: usize = traced.splats.iter().map(Vec::len).sum();
        let bytes = traced.merging.len() as u64 * BYTES_PER_END + splats as u64 * Splat::BYTES_IN_A_PASS;
        let needed = (bytes as f64 / pilot.paths as f64 * paths as f64) as u64;
        self.reserved = Some(preparation.memory.reserve(needed).map_err(|refusal| {
            let what = format!("the vertices of {}", counted(paths, "light path", "light paths"));
            Error::scene(refusal.sentence(&what, "render a smaller image")).about(Self::NAME)
        })?);
        self.camera = Some(preparation.camera.clone());
        Ok(())
    }

    fn statistics(&self) -> Vec<Statistic> {
        let pass = self.pass();
        vec![
            Statistic { name: "first_radius", value: self.first_radius.into() },
            Statistic { name: "last_radius", value: pass.radius().into() },
            Statistic { name: "light_vertices_of_the_last_pass", value: pass.len() as f64 },
            Statistic { name: "light_vertex_memory_bytes", value: pass.memory_bytes() as f64 },
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
        let camera = self.camera.as_ref().expect("prepare comes first");
        let pass = self.pass();
        let light = LightPathSettings {
            limits: self.settings.limits,
            guide: self.guide.as_ref(),
            techniques: Techniques::All,
            beyond: 2,
            merged: pass.merged(),
            media: None,
            caustics: None,
        };
        trace_both(scene, camera, light, Some(&pass), wave, query, worker, out);
    }
}

impl Progressive for Vcm {
    fn begin_sample(&self, pass: &SamplePass<'_>) -> PreparedPass {
        let sequence = pass.light_paths(pass.preparation.camera.film.full_area());
        let radius = pass.radius(self.first_radius, self.settings.alpha);
        let light = LightPass {
            time: pass.time(),
            margin: pass.margin,
            ..self.light_pass(pass.preparation, sequence, radius)
        };
        let traced = light.trace(pass.preparation);
        *self.pass.write().unwrap_or_else(PoisonError::into_inner) = Arc::new(traced.merging);
        let (counters, splats, invalid) = (traced.counters, traced.splats, traced.invalid);
        PreparedPass { counters, splats, invalid, time: light.time }
    }
}
