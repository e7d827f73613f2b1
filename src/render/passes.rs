//! The execution of a render: a sequence of passes and their accumulated result.

use super::edges::EmitterEdges;
use super::job::{Job, Rendered};
use super::state::{self, CheckpointSink, PreviewSink, RenderState, Sinks};
use super::stop::{StopReason, StopRules};
use super::tracing::CameraWorker;
use super::{progressive, splats};
use crate::error::Result;
use crate::estimate::replicates::ErrorEstimate;
use crate::integrator::{Counters, Worker};
use rayon::prelude::*;
use std::ops::Range;
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

/// The side of a tile in pixels. Renders of regions whose edges are at its multiples do no work twice.
pub const TILE: u32 = 16;
/// The fraction of the time for error estimates that are only displayed.
const ESTIMATES_SHARE: f64 = 0.01;
/// The longest part of a pass, so that states are complete often: an interruption may discard an incomplete part, and
/// a preview has to wait for its end.
const LONGEST_PART: Duration = Duration::from_secs(5);

/// A render in progress.
pub(super) struct Passes<'j, 'a> {
    job: &'j Job<'a>,
    stop: StopRules,
    pool: rayon::ThreadPool,
    now: RenderState,
    /// The state after the last complete part of a pass, for renders that discard incomplete parts.
    whole: Option<RenderState>,
    workers: Vec<Mutex<CameraWorker>>,
    edges: Option<EmitterEdges>,
    started: Instant,
    /// The sampling time before this render continued.
    before: Duration,
    /// The counters before this render continued, and those that belong to no worker.
    counters: Counters,
    error: Option<ErrorEstimate>,
    estimating: Duration,
    checkpoint_status: Option<CheckpointStatus>,
    last_preview: Instant,
}

/// The status of checkpoints.
struct CheckpointStatus {
    last: Instant,
    outcome: Result<()>,
}

impl<'j, 'a> Passes<'j, 'a> {
    /// Prepares the render and starts the clock.
    pub fn new(job: &'j Job<'a>, pool: rayon::ThreadPool) -> Self {
        let mut now = job.resumed.clone().unwrap_or_else(|| {
            RenderState::new(
                job.camera.film.rect(),
                job.channels(),
                job.settings.sampler.replicates() as usize,
                job.first,
            )
        });
        // The pass that was interrupted may have been one of a longer render.
        now.pass_end = now.pass_end.min(job.settings.stop.samples.map_or(u64::MAX, |end| end.max(now.next)));
        let mut workers: Vec<_> = (0..pool.current_num_threads())
            .map(|_| {
                let worker = Worker::new(job.settings.sampler).with_interrupt(job.progress.interrupt_flag());
                Mutex::new(CameraWorker::new(worker))
            })
            .collect();
        let samples = job.settings.stop.samples.map(|end| end.saturating_sub(job.first));
        let started = Instant::now();
        job.progress.begin();
        let worker = workers[0].get_mut().unwrap_or_else(PoisonError::into_inner);
        let edges = EmitterEdges::new(job, now.tiles.len(), worker);
        job.progress.add_samples((now.next - job.first).saturating_mul(job.camera.film.rect().area()));
        Passes {
            job,
            stop: StopRules { samples, ..job.settings.stop },
            pool,
            whole: job.needs_whole_passes().then(|| now.clone()),
            workers,
            edges,
            started,
            before: now.elapsed,
            counters: now.counters,
            now,
            error: None,
            estimating: Duration::ZERO,
            last_preview: started,
            checkpoint_status: job
                .sinks
                .checkpoints
                .map(|_| CheckpointStatus { last: started, outcome: Ok(()) }),
        }
    }

    /// Executes passes until a stop rule applies.
    pub fn run(mut self) -> Rendered {
        if self.done() > 0 {
            self.estimate();
            self.report();
        }
        let reason = loop {
            if self.job.progress.is_interrupted() {
                break StopReason::Interrupted;
            }
            let is_whole = self.now.next >= self.now.pass_end;
            if is_whole && let Some(reason) = self.stop.reached(self.done(), self.elapsed(), self.error) {
                break reason;
            }
            if self.is_enough() {
                break StopReason::Enough;
            }
            if is_whole {
                self.plan_pass();
            }
            let part = self.part();
            self.take(part.clone());
            if !self.job.progress.is_interrupted() {
                self.finish_part(part.end);
            }
        };
        self.finish(reason)
    }

    /// Returns the number of samples per pixel taken so far, on average.
    fn done(&self) -> u64 {
        self.now.next - self.job.first
    }

    /// Returns whether the user has said that the samples so far are enough, if there are any.
    fn is_enough(&self) -> bool {
        self.done() > 0 && self.job.sinks.previews.is_some() && self.job.progress.take_end_request()
    }

    fn elapsed(&self) -> Duration {
        self.before + self.started.elapsed()
    }

    /// Determines the end of the next pass.
    fn plan_pass(&mut self) {
        let done = self.done();
        self.now.pass_end = self.now.next + self.stop.next_pass(done, self.elapsed(), self.error);
    }

    /// Returns the next range of samples: the current pass, or a part of it with limited duration.
    fn part(&self) -> Range<u64> {
        let RenderState { next, pass_end, .. } = self.now;
        if self.done() == 0 {
            return next..pass_end;
        }
        let longest = self.intervals().fold(LONGEST_PART, Duration::min);
        let per_sample = self.elapsed().as_secs_f64().max(1e-9) / self.done() as f64;
        // An even number keeps the halves equal.
        let part = ((longest.as_secs_f64() / per_sample) as u64 & !1).max(2);
        next..pass_end.min(next.saturating_add(part))
    }

    /// Returns the times after which checkpoints and previews are due.
    fn intervals(&self) -> impl Iterator<Item = Duration> {
        let Sinks { checkpoints, previews } = self.job.sinks;
        let previews = previews.and_then(|previews| previews.every);
        checkpoints.map(|checkpoints| checkpoints.every).into_iter().chain(previews)
    }

    /// Takes samples of every pixel; with adaptive sampling, the range applies to a pixel with the rate 1.
    fn take(&mut self, samples: Range<u64>) {
        let Passes { job, pool, now, workers, edges, .. } = self;
        let tiles = &mut now.tiles;
        if let Some(progressive) = job.integrator.progressive() {
            let prepared = progressive::render(job, progressive, pool, workers, tiles, samples);
            self.counters.merge(&prepared.counters);
            now.invalid_count += prepared.invalid;
            return;
        }
        pool.install(|| {
            tiles.par_iter_mut().enumerate().for_each(|(i, tile)| {
                let thread = rayon::current_thread_index().unwrap_or(0);
                let mut worker = workers[thread].lock().unwrap_or_else(PoisonError::into_inner);
                let at_edges = edges.as_ref().map(|edges| edges.of_tile(job, i, tile.rect(), &mut worker));
                let at_edges = at_edges.unwrap_or_default();
                match &job.rates {
                    None => worker.render_tile(job, tile, at_edges, samples.clone()),
                    Some(rates) => {
                        worker.render_allocated(job, tile, at_edges, |p| rates.samples(p, &samples));
                    }
                }
            });
        });
        if let Some(tracer) = job.integrator.light_tracer() {
            now.invalid_count += pool.install(|| splats::trace(job, tracer, workers, tiles, samples));
        }
    }

    /// Updates the state after a part of a pass, and saves a checkpoint if one is due.
    fn finish_part(&mut self, end: u64) {
        self.now.next = end;
        let spent = self.estimating.as_secs_f64();
        let pass_is_whole = end >= self.now.pass_end;
        if pass_is_whole
            && (self.stop.error.is_some() || spent <= ESTIMATES_SHARE * self.started.elapsed().as_secs_f64())
        {
            self.estimate();
        }
        self.report();
        if self.whole.is_some() {
            self.collect();
            // Without the old copy, so that there are never three films.
            self.whole = None;
            self.whole = Some(self.now.clone());
        }
        if let (Some(CheckpointSink { every, .. }), Some(checkpoint_status)) =
            (self.job.sinks.checkpoints, &self.checkpoint_status)
            && checkpoint_status.last.elapsed() >= every
        {
            self.keep();
        }
        self.preview();
    }

    /// Shows the image so far, if that is due or was requested.
    fn preview(&mut self) {
        let Some(PreviewSink { every, show }) = self.job.sinks.previews else { return };
        let requested = self.job.progress.take_preview_request();
        if !requested && every.is_none_or(|every| self.last_preview.elapsed() < every) {
            return;
        }
        self.collect();
        self.estimate();
        let rendered = self.rendered(StopReason::Interrupted);
        show(&rendered, requested);
        self.now.tiles = rendered.tiles;
        self.last_preview = Instant::now();
    }

    fn report(&self) {
        self.job.progress.finish_pass(self.done(), self.error);
    }

    /// Adds the workers' counters and dropped samples to the state.
    fn collect(&mut self) {
        self.now.elapsed = self.elapsed();
        self.now.counters = self.counters;
        for worker in &self.workers {
            let mut worker = worker.lock().unwrap_or_else(PoisonError::into_inner);
            self.now.counters.merge(&worker.worker.counters);
            self.now.invalid_count += std::mem::take(&mut worker.invalid_count);
            self.now.invalid.append(&mut worker.invalid);
        }
        self.now.invalid.sort_by_key(|s| (s.y, s.x, s.sample));
    }

    /// Saves a checkpoint of the last complete part of a pass.
    fn keep(&mut self) {
        if let (Some(checkpoints), Some(checkpoint_status), Some(state)) =
            (self.job.sinks.checkpoints, &mut self.checkpoint_status, &self.whole)
        {
            checkpoint_status.outcome = (checkpoints.keep)(state);
            checkpoint_status.last = Instant::now();
        }
    }

    fn estimate(&mut self) {
        let prepared = Instant::now();
        self.error = state::estimate(&self.now.tiles, &self.pool, self.job.settings.squared_bias);
        self.estimating += prepared.elapsed();
    }

    fn finish(mut self, stop_reason: StopReason) -> Rendered {
        self.collect();
        self.keep();
        // With only a part of the light paths, the image would be too dark.
        if stop_reason == StopReason::Interrupted
            && self.job.integrator.traces_light_paths()
            && let Some(whole) = self.whole.take()
        {
            self.now = whole;
        }
        self.estimate();
        let checkpoint_status =
            self.checkpoint_status.take().map_or(Ok(()), |checkpoint_status| checkpoint_status.outcome);
        Rendered { checkpoint_status, ..self.rendered(stop_reason) }
    }

    /// Returns the result so far. It has the tiles of the state.
    fn rendered(&mut self, stop_reason: StopReason) -> Rendered {
        let (done, error) = (self.done(), self.error);
        let tiles = std::mem::take(&mut self.now.tiles);
        let state = RenderState { tiles, ..self.now.clone() };
        let rect = self.job.camera.film.rect();
        let mut rendered = Rendered::new(state, rect, self.job.settings.layers.clone(), self.job.alpha);
        if self.job.rates.is_none() {
            rendered.samples_per_pixel = done;
        }
        Rendered {
            stop_reason,
            adaptive: self.job.rates.is_some(),
            reuses_paths: self.job.integrator.reuse_cells().is_some(),
            prepared: self.job.prepared,
            relmse: error.map(|e| e.relmse),
            relmse_interval: error.map(|e| e.interval),
            ..rendered
        }
    }
}
