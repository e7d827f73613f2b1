//! The render job: one mechanism for sample counts, time limits, error targets and interruption.

use super::progress::Progress;
use super::splats;
use super::stop::{StopReason, StopRules};
use super::tracing::{CameraWorker, InvalidSample};
use crate::error::{Error, Result};
use crate::film::{FilterSampler, PixelRect, Tile};
use crate::integrator::settings::{Aov, Layer};
use crate::integrator::{Counters, Integrator, Worker};
use crate::sampling::Sampler;
use crate::scene::Scene;
use crate::sensor::Camera;
use rayon::prelude::*;
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

/// Side of a tile in pixels.
pub(super) const TILE: u32 = 16;

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
    /// Samples per pixel of the completed passes; the least of any pixel.
    pub samples_per_pixel: u64,
    /// Why it stopped.
    pub stop_reason: StopReason,
    /// Estimated relMSE, from the two halves.
    pub relmse: Option<f64>,
    /// Wall time of sampling.
    pub elapsed: Duration,
    /// Counts of all threads.
    pub counters: Counters,
    /// The first dropped samples, in the order of the image.
    pub invalid: Vec<InvalidSample>,
    /// How many samples were dropped.
    pub invalid_count: u64,
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

    /// Renders until a stop rule fires or the progress is interrupted.
    ///
    /// # Errors
    /// If the threads cannot be started.
    pub fn run(&self) -> Result<Rendered> {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(self.settings.threads)
            .build()
            .map_err(|e| Error::internal(format!("cannot start {} threads: {e}", self.settings.threads)))?;
        let channels = 3
            + usize::from(self.alpha)
            + self.sampled_layers().map(|aov| aov.channels().len()).sum::<usize>();
        let rect = self.camera.film.rect();
        let mut tiles: Vec<Tile> = tiles_of(rect).map(|rect| Tile::new(rect, channels)).collect();
        let workers: Vec<Mutex<CameraWorker>> = (0..pool.current_num_threads())
            .map(|_| Mutex::new(CameraWorker::new(Worker::new(self.settings.sampler))))
            .collect();
        let started = Instant::now();
        let mut done = 0;
        let mut relmse = None;
        let mut invalid_splats = 0;
        let stop_reason = loop {
            if self.progress.is_interrupted() {
                break StopReason::Interrupted;
            }
            if let Some(reason) = self.settings.stop.reached(done, started.elapsed(), relmse) {
                break reason;
            }
            let pass = self.settings.stop.next_pass(done, started.elapsed());
            pool.install(|| {
                tiles.par_iter_mut().for_each(|tile| {
                    let thread = rayon::current_thread_index().unwrap_or(0);
                    let mut worker = workers[thread].lock().unwrap_or_else(PoisonError::into_inner);
                    worker.render_tile(self, tile, done..done + pass);
                });
            });
            if let Some(ptracer) = self.integrator.light_tracer() {
                let samples = done..done + pass;
                invalid_splats +=
                    pool.install(|| splats::trace(self, ptracer, &workers, &mut tiles, samples));
            }
            relmse = estimated_relmse(&tiles);
            if !self.progress.is_interrupted() {
                done += pass;
                self.progress.finish_pass(done, relmse);
            }
        };
        let elapsed = started.elapsed();
        let mut rendered = Rendered {
            tiles,
            rect,
            alpha: self.alpha,
            layers: self.settings.layers.clone(),
            samples_per_pixel: done,
            stop_reason,
            relmse,
            elapsed,
            counters: Counters::default(),
            invalid: Vec::new(),
            invalid_count: invalid_splats,
        };
        for worker in workers {
            let worker = worker.into_inner().unwrap_or_else(PoisonError::into_inner);
            rendered.counters.merge(&worker.worker.counters);
            rendered.invalid_count += worker.invalid_count;
            rendered.invalid.extend(worker.invalid);
        }
        rendered.invalid.sort_by_key(|s| (s.y, s.x, s.sample));
        Ok(rendered)
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

/// The estimated relMSE of the image: the mean over pixels and channels of the variance of the mean, over the
/// squared mean plus 0.01. Summed in the order of the tiles.
fn estimated_relmse(tiles: &[Tile]) -> Option<f64> {
    let parts: Vec<(f64, u64)> = tiles.par_iter().map(|t| {
        let mut total = (0.0, 0);
        for i in 0..t.pixel_count() { for c in 0..3 { let e = t.estimate(i, c); if let Some(v) = e.variance { total.0 += v / (e.mean * e.mean + 0.01); total.1 += 1; } } }
        total
    }).collect();
    let (sum, n) = parts.into_iter().fold((0.0, 0), |a, b| (a.0 + b.0, a.1 + b.1));
    (n > 0).then(|| sum / n as f64)
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
