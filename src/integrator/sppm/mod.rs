//! Stochastic progressive photon mapping, as passes that know nothing of each other.
//! [Hachisuka and Jensen 2009; Knaus and Zwicker 2011]
//!
//! Every sample of a pixel is a pass with photons, a radius and a time of its own. A camera path goes on through
//! Dirac deltas to the first surface with a finite lobe. There emitters are sampled and photons gathered that have
//! been scattered at least once; the mean over the passes goes to the right answer, because the radius shrinks slowly
//! enough for the noise to vanish and fast enough for the blur to.
//!
//! The light at a surface point is split by where it comes from, so that nothing is counted twice:
//!
//! - from an emitter without a surface between: emitter samples and BSDF samples, weighted against each other;
//! - from an emitter by way of Dirac deltas alone (a caustic): photons;
//! - all other light: photons where the surface has a diffuse lobe. Where all finite lobes are glossy, few photons
//!   would lie within them, and the path goes on to the next surface, as a path tracer's does.

mod camera_path;
mod gather;
mod radius;
mod view;

use super::photon::{
    Caster, Deposit, EmissionGuide, GridPhoton, PathSequence, PhotonGrid, PhotonPaths, Until,
};
use super::progressive::{Begun, Progressive, SamplePass};
use super::settings::SppmSettings;
use super::{Fact, Integrator, Preparation, Radiance, RadianceQuery, Wave, Worker};
use crate::error::{Error, Result, counted};
use crate::memory::Reservation;
use crate::sampling::{Dimension, SampleKey, Sampler, SamplerKind};
use crate::scene::Scene;
use camera_path::CameraPaths;
use gather::Gather;
use std::sync::{Arc, PoisonError, RwLock};
use view::View;

/// How many photons a light path leaves, as far as memory is planned: that depends on the scene.
const PHOTONS_PER_PATH: u64 = 2;
/// Bytes of a photon: as it is cast, as it is sorted, in the grid of this pass and in that of the last.
const BYTES_PER_PHOTON: u64 = 150;

/// The integrator. Its passes need [`Progressive::begin_sample`].
pub struct Sppm {
    settings: SppmSettings,
    /// The radius of the first pass, in scene units.
    first_radius: f32,
    guide: Option<EmissionGuide>,
    pass: RwLock<Arc<Pass>>,
    /// Of a pass's photons.
    reserved: Option<Reservation>,
}

/// The photons of one sample of the pixels.
#[derive(Default)]
struct Pass {
    grid: PhotonGrid,
    emitted: u64,
}

impl Sppm {
    /// The integrator with its settings.
    pub fn new(settings: SppmSettings) -> Self {
        Sppm {
            settings,
            first_radius: settings.initial_radius,
            guide: None,
            pass: RwLock::default(),
            reserved: None,
        }
    }

    /// The longest path of a photon that a camera path can be added to.
    fn photon_paths(&self) -> PhotonPaths {
        PhotonPaths {
            max_edges: self.settings.max_depth.map(|max| max.saturating_sub(1)),
            rr_depth: self.settings.rr_depth,
            direct: false,
            indirect: true,
        }
    }

    /// Reserves what the photons of a pass take.
    fn reserve(&self, preparation: &Preparation<'_>) -> Result<Reservation> {
        let paths = self.paths_of_a_pass(preparation);
        let needed = paths.saturating_mul(PHOTONS_PER_PATH * BYTES_PER_PHOTON);
        preparation.memory.reserve(needed).map_err(|refusal| {
            let what = format!("the photons of {}", counted(paths, "light path", "light paths"));
            Error::scene(refusal.sentence(&what, "set photon_count to fewer")).about("sppm")
        })
    }

    /// Light paths of a pass: as many as are asked for, else one for each pixel of the full image.
    fn paths_of_a_pass(&self, preparation: &Preparation<'_>) -> u64 {
        let film = &preparation.camera.film;
        match self.settings.photon_count {
            0 => u64::from(film.width) * u64::from(film.height),
            count => u64::from(count),
        }
    }

    fn pass(&self) -> Arc<Pass> {
        self.pass.read().unwrap_or_else(PoisonError::into_inner).clone()
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
        !self.settings.hide_emitters
    }

    fn prepares(&self) -> bool {
        true
    }

    fn prepare(&mut self, preparation: &Preparation<'_>) -> Result<()> {
        self.reserved = Some(self.reserve(preparation)?);
        let view = View::of(preparation);
        if self.settings.initial_radius == 0.0 {
            self.first_radius = view.radius(preparation.scene);
        }
        if self.settings.guided {
            let Preparation { scene, sampler, seed, pool, interrupt, .. } = *preparation;
            let caster = Caster { scene, sampler, guide: None, pool, interrupt, time: None };
            let seen = |deposit: &Deposit| view.contains(deposit.p);
            self.guide = EmissionGuide::learn(&caster, &self.photon_paths(), seed, seen);
        }
        Ok(())
    }

    fn facts(&self) -> Vec<Fact> {
        let pass = self.pass();
        vec![
            Fact { name: "guided", value: f64::from(u8::from(self.guide.is_some())) },
            Fact { name: "first_radius", value: self.first_radius.into() },
            Fact { name: "last_radius", value: pass.grid.radius().into() },
            Fact { name: "light_paths_of_a_pass", value: pass.emitted as f64 },
            Fact { name: "photons_of_the_last_pass", value: pass.grid.len() as f64 },
            Fact { name: "photon_memory_bytes", value: pass.grid.memory_bytes() as f64 },
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
        let gather = Gather::new(&pass.grid, pass.emitted);
        CameraPaths { scene, settings: &self.settings, query, gather: &gather }.trace(wave, worker, out);
    }
}

impl Progressive for Sppm {
    fn begin_sample(&self, pass: &SamplePass<'_>) -> Begun {
        let Preparation { scene, sampler, seed, pool, interrupt, .. } = *pass.preparation;
        // Each half of the samples is an independent sequence of passes.
        let (half, index) = ((pass.sample & 1) as u32, pass.sample >> 1);
        let paths = self.paths_of_a_pass(pass.preparation);
        let sequence = PathSequence { seed, stream: 0, number: half, first: index * paths };
        let time = scene.needs.time.then(|| time_of_pass(seed, pass.sample));
        let caster = Caster { scene, sampler, guide: self.guide.as_ref(), pool, interrupt, time };
        let until = Until { paths, kept: None };
        let cast = caster.cast(&self.photon_paths(), sequence, until, |d, _| Some(GridPhoton::new(d)));
        let first = match self.first_radius {
            0.0 => View::of(pass.preparation).radius(scene),
            radius => radius,
        };
        // One radius for a pass of every replicate: that of the first of them.
        let each = u64::from(sampler.replicates() / 2);
        let radius = radius::of_pass(first, self.settings.alpha, index / each * each);
        let grid = pool.install(|| PhotonGrid::new(&cast.kept, radius));
        let pass = Pass { grid, emitted: cast.emitted };
        *self.pass.write().unwrap_or_else(PoisonError::into_inner) = Arc::new(pass);
        Begun { counters: cast.counters, invalid: cast.invalid, time }
    }
}

/// The time of a pass, in [0, 1) over the shutter interval: light that has landed on something that moves is looked
/// up where it is then. Times are stratified over the passes of each half.
fn time_of_pass(seed: u64, sample: u64) -> f32 {
    // No path has this pixel.
    let key = SampleKey::new(seed, u32::MAX, 0, sample);
    let mut time = [0.0];
    Sampler::new(SamplerKind::Sobol, None).fill_1d(Dimension::TIME, &[key], &mut time);
    time[0]
}
