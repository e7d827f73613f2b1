//! The render job: one mechanism for sample counts, time limits, error targets and interruption.

use super::passes::Passes;
use super::progress::Progress;
use super::state::{Keeper, State};
use super::stop::{StopReason, StopRules};
use super::tracing::InvalidSample;
use crate::error::{Error, Result};
use crate::film::{FilterSampler, PixelRect, Tile};
use crate::integrator::settings::{Aov, Layer};
use crate::integrator::{Counters, Integrator, Statistic};
use crate::sampling::Sampler;
use crate::scene::Scene;
use crate::sensor::Camera;
use std::time::Duration;

/// What decides the pixels and when to stop.
#[derive(Clone, Debug)]
pub struct JobSettings {
    /// The sampler.
    pub sampler: Sampler,
    /// The seed.
    pub seed: u64,
    /// Threads; they change the speed, never the pixels.
    pub threads: usize,
    /// Stop rules.
    pub stop: StopRules,
    /// Layers beside the image.
    pub layers: Vec<Layer>,
}

/// A render about to happen.
pub struct Job<'a> {
    /// What to render.
    pub scene: &'a Scene,
    /// How.
    pub integrator: &'a dyn Integrator,
    /// From where, and onto which film.
    pub camera: &'a Camera,
    /// Settings.
    pub settings: JobSettings,
    /// Where progress is shown and interruption asked for.
    pub progress: &'a Progress,
    /// Whether noisier parts of the image get more samples; not for integrators that trace light paths.
    pub adaptive: bool,
    /// The index of the first sample.
    pub first: u64,
    /// What an earlier render has brought.
    pub begin: Option<State>,
    /// Who keeps what this one brings, if anybody does.
    pub keeper: Option<Keeper<'a>>,
    /// Whether alpha is summed.
    pub(super) alpha: bool,
    /// Whether a ray that meets nothing counts as opaque, because it sees the environment.
    pub(super) opaque_environment: bool,
    pub(super) filter: FilterSampler,
}

/// A finished render.
pub struct Rendered {
    /// The sums, tile by tile.
    pub tiles: Vec<Tile>,
    /// The part of the image that was rendered.
    pub rect: PixelRect,
    /// Whether the fourth channel is alpha.
    pub alpha: bool,
    /// The layers, in the order of their channels.
    pub layers: Vec<Layer>,
    /// Samples per pixel of the completed passes; with adaptive sampling the mean over the pixels.
    pub samples_per_pixel: u64,
    /// How many samples the pixels have.
    pub counts: SampleCounts,
    /// Why it stopped.
    pub stop_reason: StopReason,
    /// Estimated relMSE, from the two halves.
    pub relmse: Option<f64>,
    /// Lower and upper end of what holds the relMSE of this very image in 95 of 100 renders.
    pub relmse_interval: Option<[f64; 2]>,
    /// Wall time of what the integrator computed before.
    pub prepared: Duration,
    /// What there is to say about it.
    pub statistics: Vec<Statistic>,
    /// Wall time of sampling.
    pub elapsed: Duration,
    /// Counts of all threads.
    pub counters: Counters,
    /// The first dropped samples, in the order of the image.
    pub invalid: Vec<InvalidSample>,
    /// How many samples were dropped.
    pub invalid_count: u64,
    /// Whether the last state could be kept, if it was to be.
    pub kept: Result<()>,
}

/// Numbers of valid samples over the pixels of an image.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SampleCounts {
    /// The fewest of any pixel.
    pub least: u64,
    /// The most of any pixel.
    pub most: u64,
    /// The mean over the pixels.
    pub mean: f64,
}

/// Threads to render with.
///
/// # Errors
/// If they cannot be started.
pub fn thread_pool(threads: usize) -> Result<rayon::ThreadPool> {
    rayon::ThreadPoolBuilder::new()
        .num_threads(threads)
        .build()
        .map_err(|e| Error::internal(format!("cannot start {threads} threads: {e}")))
}

impl SampleCounts {
    /// The counts of an image's tiles.
    pub fn of(tiles: &[Tile]) -> Self {
        let counts = tiles.iter().flat_map(|tile| (0..tile.pixel_count()).map(|i| tile.count(i)));
        let none = (u64::MAX, 0, 0u64, 0u64);
        let (least, most, sum, pixels) = counts
            .fold(none, |(least, most, sum, pixels), n| (least.min(n), most.max(n), sum + n, pixels + 1));
        SampleCounts { least: least.min(most), most, mean: sum as f64 / pixels.max(1) as f64 }
    }
}

impl Rendered {
    /// A render that has come to a state: all samples taken, without an error estimate.
    pub fn new(state: State, rect: PixelRect, layers: Vec<Layer>, alpha: bool) -> Self {
        let counts = SampleCounts::of(&state.tiles);
        Rendered {
            tiles: state.tiles,
            rect,
            alpha,
            layers,
            samples_per_pixel: counts.mean.round() as u64,
            counts,
            stop_reason: StopReason::Samples,
            relmse: None,
            relmse_interval: None,
            prepared: Duration::ZERO,
            statistics: Vec::new(),
            elapsed: state.elapsed,
            counters: state.counters,
            invalid: state.invalid,
            invalid_count: state.invalid_count,
            kept: Ok(()),
        }
    }
}

impl<'a> Job<'a> {
    /// A job.
    pub fn new(
        scene: &'a Scene,
        integrator: &'a dyn Integrator,
        camera: &'a Camera,
        settings: JobSettings,
        progress: &'a Progress,
    ) -> Self {
        Job {
            scene,
            integrator,
            camera,
            settings,
            progress,
            adaptive: false,
            first: 0,
            begin: None,
            keeper: None,
            alpha: camera.film.pixel_format.has_alpha(),
            opaque_environment: scene.environment.is_some() && integrator.shows_environment(),
            filter: FilterSampler::new(camera.film.filter),
        }
    }

    pub(super) fn sampled_layers(&self) -> impl Iterator<Item = Aov> {
        self.settings.layers.iter().map(|layer| layer.aov).filter(|aov| aov.is_sampled())
    }

    pub(super) fn has_sampled_layers(&self) -> bool {
        self.sampled_layers().next().is_some()
    }

    /// Channels that are summed: colour, alpha if the film has it, and the layers that are sampled.
    pub fn channels(&self) -> usize {
        let layers = self.sampled_layers().map(|aov| aov.channels().len()).sum::<usize>();
        3 + usize::from(self.alpha) + layers
    }

    /// Whether a broken pass is of no use: light paths that were not traced would be missing in all pixels, and a state
    /// that is kept has to be one from which the very samples can be gone on with.
    pub(super) fn needs_whole_passes(&self) -> bool {
        self.keeper.is_some() || self.integrator.light_tracer().is_some()
    }

    /// The same job from another sample on than the first.
    pub fn with_first(mut self, first: u64) -> Self {
        self.first = first;
        self
    }

    /// The same job, going on from what an earlier one has brought.
    pub fn with_begin(mut self, begin: Option<State>) -> Self {
        self.begin = begin;
        self
    }

    /// The same job with somebody who keeps its states.
    pub fn with_keeper(mut self, keeper: Option<Keeper<'a>>) -> Self {
        self.keeper = keeper;
        self
    }

    /// The same job with adaptive sampling, or without.
    pub fn with_adaptive(mut self, adaptive: bool) -> Self {
        self.adaptive = adaptive;
        self
    }

    /// Renders until a stop rule fires or the progress is interrupted.
    ///
    /// # Errors
    /// If the threads cannot be started.
    pub fn run(&self) -> Result<Rendered> {
        Ok(self.run_with(thread_pool(self.settings.threads)?))
    }

    /// As [`run`](Self::run), with threads that are there already.
    pub fn run_with(&self, pool: rayon::ThreadPool) -> Rendered {
        Passes::new(self, pool).run()
    }
}
