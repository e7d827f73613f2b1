//! A render under way: passes, one after the other, and what they have brought so far.

use super::adaptive::{self, Allocation};
use super::job::{Job, Rendered, SampleCounts};
use super::stop::StopReason;
use super::tracing::CameraWorker;
use super::{progressive, splats};
use crate::estimate::replicates::{ErrorEstimate, ErrorSums};
use crate::film::{PixelRect, Tile};
use crate::integrator::{Counters, Worker};
use rayon::prelude::*;
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

/// Side of a tile in pixels.
pub(super) const TILE: u32 = 16;
/// The share of the time that may go into error estimates which nothing but the progress asks for.
const ESTIMATES_SHARE: f64 = 0.01;

/// What a render has so far.
pub(super) struct Passes<'j, 'a> {
    job: &'j Job<'a>,
    pool: rayon::ThreadPool,
    tiles: Vec<Tile>,
    workers: Vec<Mutex<CameraWorker>>,
    started: Instant,
    /// Samples per pixel of the passes that are done, on average.
    done: u64,
    /// The pilot of adaptive sampling, if there is to be any.
    pilot: Option<u64>,
    allocation: Option<Allocation>,
    error: Option<ErrorEstimate>,
    estimating: Duration,
    invalid_light: u64,
    /// Counts beside those of the workers.
    counters: Counters,
}

impl<'j, 'a> Passes<'j, 'a> {
    /// Starts the clock.
    pub fn new(job: &'j Job<'a>, pool: rayon::ThreadPool) -> Self {
        let layers = job.sampled_layers().map(|aov| aov.channels().len()).sum::<usize>();
        let channels = 3 + usize::from(job.alpha) + layers;
        let rect = job.camera.film.rect();
        let workers = (0..pool.current_num_threads())
            .map(|_| Mutex::new(CameraWorker::new(Worker::new(job.settings.sampler))))
            .collect();
        Passes {
            job,
            pool,
            tiles: tiles_of(rect).map(|rect| Tile::new(rect, channels)).collect(),
            workers,
            started: Instant::now(),
            done: 0,
            pilot: if job.adaptive { adaptive::pilot(job.settings.stop.samples) } else { None },
            allocation: None,
            error: None,
            estimating: Duration::ZERO,
            invalid_light: 0,
            counters: Counters::default(),
        }
    }

    /// Takes passes until a rule says why to stop.
    pub fn run(mut self) -> Rendered {
        let stop = self.job.settings.stop;
        let reason = loop {
            if self.job.progress.is_interrupted() {
                break StopReason::Interrupted;
            }
            if let Some(reason) = stop.reached(self.done, self.started.elapsed(), self.error) {
                break reason;
            }
            let mut pass = stop.next_pass(self.done, self.started.elapsed(), self.error);
            if let Some(pilot) = self.pilot.filter(|_| self.allocation.is_none()) {
                if self.done < pilot {
                    pass = pass.min(pilot - self.done);
                } else {
                    let rect = self.job.camera.film.rect();
                    self.allocation = Some(Allocation::new(&self.tiles, rect, pilot));
                }
            }
            self.pass(pass);
            if !self.job.progress.is_interrupted() {
                self.done += pass;
                let spent = self.estimating.as_secs_f64();
                if stop.error.is_some() || spent <= ESTIMATES_SHARE * self.started.elapsed().as_secs_f64() {
                    self.estimate();
                }
                self.job.progress.finish_pass(self.done, self.error);
            }
        };
        self.finish(reason)
    }

    /// Takes so many samples more per pixel, on average.
    fn pass(&mut self, pass: u64) {
        let Passes { job, pool, tiles, workers, done, .. } = self;
        let samples = *done..*done + pass;
        if let Some(allocation) = &mut self.allocation {
            allocation.advance(samples.end);
        }
        let allocation = self.allocation.as_ref();
        if let Some(progressive) = job.integrator.progressive() {
            let begun = progressive::render(job, progressive, pool, workers, tiles, samples);
            self.counters.merge(&begun.counters);
            self.invalid_light += begun.invalid;
            return;
        }
        pool.install(|| {
            tiles.par_iter_mut().for_each(|tile| {
                let thread = rayon::current_thread_index().unwrap_or(0);
                let mut worker = workers[thread].lock().unwrap_or_else(PoisonError::into_inner);
                match allocation {
                    None => worker.render_tile(job, tile, samples.clone()),
                    Some(allocation) => worker.render_allocated(job, tile, |p| allocation.samples(p)),
                }
            });
        });
        if let Some(ptracer) = job.integrator.light_tracer() {
            self.invalid_light += pool.install(|| splats::trace(job, ptracer, workers, tiles, samples));
        }
    }

    /// Estimates the error, summed in the order of the tiles.
    fn estimate(&mut self) {
        let begun = Instant::now();
        let tiles = &self.tiles;
        let parts: Vec<ErrorSums> = self.pool.install(|| tiles.par_iter().map(Tile::error_sums).collect());
        let mut sums = ErrorSums::default();
        parts.iter().for_each(|part| sums.merge(part));
        self.error = if self.tiles.iter().any(Tile::has_replicates) { sums.estimate() } else { None };
        self.estimating += begun.elapsed();
    }

    fn finish(mut self, stop_reason: StopReason) -> Rendered {
        let elapsed = self.started.elapsed();
        self.estimate();
        let counts = SampleCounts::of(&self.tiles);
        let mut rendered = Rendered {
            rect: self.job.camera.film.rect(),
            alpha: self.job.alpha,
            layers: self.job.settings.layers.clone(),
            samples_per_pixel: if self.allocation.is_some() { counts.mean.round() as u64 } else { self.done },
            counts,
            tiles: self.tiles,
            stop_reason,
            relmse: self.error.map(|e| e.relmse),
            relmse_interval: self.error.map(|e| e.interval),
            prepared: Duration::ZERO,
            facts: Vec::new(),
            elapsed,
            counters: self.counters,
            invalid: Vec::new(),
            invalid_count: self.invalid_light,
        };
        for worker in self.workers {
            let worker = worker.into_inner().unwrap_or_else(PoisonError::into_inner);
            rendered.counters.merge(&worker.worker.counters);
            rendered.invalid_count += worker.invalid_count;
            rendered.invalid.extend(worker.invalid);
        }
        rendered.invalid.sort_by_key(|s| (s.y, s.x, s.sample));
        rendered
    }
}

fn tiles_of(rect: PixelRect) -> impl Iterator<Item = PixelRect> {
    let (columns, rows) = (rect.width.div_ceil(TILE), rect.height.div_ceil(TILE));
    (0..u64::from(columns) * u64::from(rows)).map(move |i| {
        let (column, row) = ((i % u64::from(columns)) as u32, (i / u64::from(columns)) as u32);
        let (x, y) = (column * TILE, row * TILE);
        PixelRect {
            x: rect.x + x,
            y: rect.y + y,
            width: TILE.min(rect.width - x),
            height: TILE.min(rect.height - y),
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tiles_cover_the_rectangle_once() {
        for (x, y, width, height) in [(0, 0, 1, 1), (5, 7, 33, 16), (0, 0, 16_384, 1)] {
            let rect = PixelRect { x, y, width, height };
            let area: u64 = tiles_of(rect).map(|t| t.area()).sum();
            assert_eq!(area, rect.area());
            assert!(tiles_of(rect).all(|t| {
                t.x >= x && t.y >= y && t.x + t.width <= x + width && t.y + t.height <= y + height
            }));
        }
    }
}
