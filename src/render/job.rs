//! The render job: sample counts, time limits, error targets and interruption.

use super::adaptive::Rates;
use super::passes::Passes;
use super::progress::Progress;
use super::state::{RenderState, Sinks};
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

/// The settings that determine the pixels and the end of a render.
#[derive(Clone, Debug)]
pub struct JobSettings {
    /// The sampler.
    pub sampler: Sampler,
    /// The seed.
    pub seed: u64,
    /// The number of threads; it affects the speed but not the pixels.
    pub threads: usize,
    /// The stop rules.
    pub stop: StopRules,
    /// The layers in addition to the image.
    pub layers: Vec<Layer>,
    /// The mean squared relative bias of the integrator, if it is known. It is part of the estimated error.
    pub squared_bias: Option<f64>,
}

/// A render before it starts.
pub struct Job<'a> {
    /// The scene.
    pub scene: &'a Scene,
    /// The integrator.
    pub integrator: &'a dyn Integrator,
    /// The camera with its film.
    pub camera: &'a Camera,
    /// The settings.
    pub settings: JobSettings,
    /// The display of progress and the request to stop.
    pub progress: &'a Progress,
    /// The rates of adaptive sampling. Integrators that trace light paths do not support it.
    pub rates: Option<Rates>,
    /// The index of the first sample.
    pub first: u64,
    /// The state of an earlier render to continue.
    pub resumed: Option<RenderState>,
    /// The receivers of states.
    pub sinks: Sinks<'a>,
    /// The time that the integrator's preparation took.
    pub prepared: Duration,
    /// Whether alpha is summed.
    pub(super) alpha: bool,
    /// Whether a ray that hits nothing counts as opaque, because it sees the environment.
    pub(super) opaque_environment: bool,
    pub(super) filter: FilterSampler,
}

/// A finished render.
pub struct Rendered {
    /// The sums of all tiles.
    pub tiles: Vec<Tile>,
    /// The region of the image.
    pub rect: PixelRect,
    /// Whether the fourth channel is alpha.
    pub alpha: bool,
    /// The layers, in the order of their channels.
    pub layers: Vec<Layer>,
    /// Samples per pixel of the completed passes; with adaptive sampling, the mean over the pixels.
    pub samples_per_pixel: u64,
    /// The numbers of samples of the pixels.
    pub counts: SampleCounts,
    /// The reason why the render stopped.
    pub stop_reason: StopReason,
    /// Whether noisier cells of the image had more samples.
    pub adaptive: bool,
    /// Whether groups of pixels reused their paths, so that their errors are correlated.
    pub reuses_paths: bool,
    /// Estimated relMSE, from the two halves.
    pub relmse: Option<f64>,
    /// The 95 % confidence interval for the relMSE of this image.
    pub relmse_interval: Option<[f64; 2]>,
    /// Wall-clock time of the integrator's preparation.
    pub prepared: Duration,
    /// Statistics of the preparation.
    pub statistics: Vec<Statistic>,
    /// Wall-clock time of sampling.
    pub elapsed: Duration,
    /// The sum of the counters of all threads.
    pub counters: Counters,
    /// The first dropped samples, in image order.
    pub invalid: Vec<InvalidSample>,
    /// The number of dropped samples.
    pub invalid_count: u64,
    /// Whether the last checkpoint was saved, if one was requested.
    pub checkpoint_status: Result<()>,
}

/// The numbers of valid samples over the pixels of an image.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SampleCounts {
    /// The least number of a pixel.
    pub least: u64,
    /// The greatest number of a pixel.
    pub most: u64,
    /// The mean over the pixels.
    pub mean: f64,
}

/// Creates the threads of a render.
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
    /// Computes the numbers from an image's tiles.
    pub fn of(tiles: &[Tile]) -> Self {
        let counts = tiles.iter().flat_map(|tile| (0..tile.pixel_count()).map(|i| tile.count(i)));
        let none = (u64::MAX, 0, 0u64, 0u64);
        let (least, most, sum, pixels) = counts
            .fold(none, |(least, most, sum, pixels), n| (least.min(n), most.max(n), sum + n, pixels + 1));
        SampleCounts { least: least.min(most), most, mean: sum as f64 / pixels.max(1) as f64 }
    }
}

impl Rendered {
    /// Creates the result of a render from a state with all samples, without an error estimate.
    pub fn new(state: RenderState, rect: PixelRect, layers: Vec<Layer>, alpha: bool) -> Self {
        let counts = SampleCounts::of(&state.tiles);
        Rendered {
            tiles: state.tiles,
            rect,
            alpha,
            layers,
            samples_per_pixel: counts.mean.round() as u64,
            counts,
            stop_reason: StopReason::Samples,
            adaptive: false,
            reuses_paths: false,
            relmse: None,
            relmse_interval: None,
            prepared: Duration::ZERO,
            statistics: Vec::new(),
            elapsed: state.elapsed,
            counters: state.counters,
            invalid: state.invalid,
            invalid_count: state.invalid_count,
            checkpoint_status: Ok(()),
        }
    }
}

impl<'a> Job<'a> {
    /// Creates a job.
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
            rates: None,
            first: 0,
            resumed: None,
            sinks: Sinks::default(),
            prepared: Duration::ZERO,
            alpha: camera.film.pixel_format.has_alpha(),
            opaque_environment: scene.needs.environment && integrator.shows_environment(),
            filter: FilterSampler::new(camera.film.filter),
        }
    }

    pub(super) fn sampled_layers(&self) -> impl Iterator<Item = Aov> {
        self.settings.layers.iter().map(|layer| layer.aov).filter(|aov| aov.is_sampled())
    }

    pub(super) fn has_sampled_layers(&self) -> bool {
        self.sampled_layers().next().is_some()
    }

    /// Returns the number of channels that are summed: colour, alpha if the film has it, and the sampled layers.
    pub fn channels(&self) -> usize {
        let layers = self.sampled_layers().map(|aov| aov.channels().len()).sum::<usize>();
        3 + usize::from(self.alpha) + layers
    }

    /// Returns whether an incomplete pass must be discarded. Missing light paths would affect all pixels, and a
    /// checkpoint must allow the render to continue with exactly the same samples.
    pub(super) fn needs_whole_passes(&self) -> bool {
        self.sinks.checkpoints.is_some() || self.integrator.traces_light_paths()
    }

    /// Returns the job with another first sample.
    pub fn with_first(mut self, first: u64) -> Self {
        self.first = first;
        self
    }

    /// Returns the job as the continuation of an earlier state.
    pub fn resumed_from(mut self, resumed: Option<RenderState>) -> Self {
        self.resumed = resumed;
        self
    }

    /// Returns the job with receivers of its states.
    pub fn with_sinks(mut self, sinks: Sinks<'a>) -> Self {
        self.sinks = sinks;
        self
    }

    /// Returns the job with the time that the integrator's preparation took.
    pub fn prepared_in(mut self, prepared: Duration) -> Self {
        self.prepared = prepared;
        self
    }

    /// Returns the job with the rates of adaptive sampling.
    pub fn with_rates(mut self, rates: Option<Rates>) -> Self {
        self.rates = rates;
        self
    }

    /// Renders until a stop rule applies or the progress is interrupted.
    ///
    /// # Errors
    /// If the threads cannot be started.
    pub fn run(&self) -> Result<Rendered> {
        Ok(self.run_with(thread_pool(self.settings.threads)?))
    }

    /// Computes [`run`](Self::run) with existing threads.
    pub fn run_with(&self, pool: rayon::ThreadPool) -> Rendered {
        Passes::new(self, pool).run()
    }
}
