//! The choice between independent paths and reuse in cells of either size, by a pilot.
//!
//! Reuse multiplies the cost of a path by about 2. It divides the variance of indirect light by up to 16, but it does
//! not reduce the noise of emitter samples at the first surface, of edges, and of specular paths. The pilot traces
//! some cells of the image in each way and compares error × cost. Its samples are not part of the image. Costs are
//! numbers of rays, so the choice is the same on every machine.

use super::PathIntegrator;
use super::caustics::CameraPathPilot;
use super::groups::{CellSide, PixelGroups};
use crate::estimate::metrics::RELATIVE_FLOOR;
use crate::integrator::Worker;
use crate::integrator::pilot::PilotRays;
use crate::integrator::preparation::{Preparation, Workers};
use crate::sampling::hash::combine;
use rayon::prelude::*;
use std::ops::Range;

/// The number of cells of a round, of each of which one group of pixels is traced, and their side in pixels.
const CELLS: u64 = 48;
const CELL: u32 = CellSide::Eight as u32;
/// The number of samples of a pixel, of which the halves of a pixel have every other one. With one sample in each half,
/// the direct light of emitters would be noisier beside indirect light than in an image, because samples of few
/// dimensions become exact sooner.
const SAMPLES: usize = 16;
/// The ways in which each cell is traced; `None`: with independent paths.
const MODES: [Option<CellSide>; 3] = [None, Some(CellSide::Eight), Some(CellSide::Four)];
/// Another round of cells is traced, up to [`ROUNDS`], if the effort of reuse relative to that of independent paths is
/// in this range.
const UNCLEAR: Range<f64> = 0.7..1.4;
const ROUNDS: u64 = 3;
/// The noise of small cells is blocks of 4 × 4 pixels. They are chosen if their effort, relative to that of large
/// cells, is below this.
const SMALL_CELLS: f64 = 0.85;
/// The random numbers of the pilot are others than those of the image.
const STREAM: u64 = 0x7069_6c6f_7470_6174;

/// The exponent of the mean over cells that is compared. The smaller it is, the less fireflies count, but the more
/// smooth cells do, whose noise reuse divides by more than that of others.
const EXPONENT: f64 = 0.7;
/// The share of the pixels that count as fireflies, if they have the largest errors, where caustics are compared.
const FIREFLIES: f64 = 0.01;
/// The least efficiency of reuse relative to independent paths. Errors of pixels that share paths are correlated, so
/// they are worth a little less; and the pilot, with few samples, is too favourable to reuse.
const LEAST_GAIN: f64 = 1.3;

/// The errors and the cost of a cell in one of the [`MODES`].
#[derive(Default)]
struct Trial {
    /// The squared relative error of each pixel, times a constant.
    squares: Vec<f64>,
    cost: f64,
    /// The sum of all samples and channels.
    sum: f64,
}

/// The result of the pilot.
pub struct Efforts {
    /// The cost at which each of the [`MODES`] is expected to reach a given error, in arbitrary units.
    efforts: [f64; MODES.len()],
    of_paths: [CameraPathPilot; MODES.len()],
}

impl Efforts {
    /// Returns what is known of the paths that are reused in the given cells.
    pub(super) fn of_paths(&self, cells: Option<CellSide>) -> CameraPathPilot {
        self.of_paths[MODES.iter().position(|mode| *mode == cells).expect("one of the modes")]
    }

    /// Returns the better cells for reuse.
    pub fn cells(&self) -> CellSide {
        let [_, large, small] = self.efforts;
        if small < SMALL_CELLS * large { CellSide::Four } else { CellSide::Eight }
    }

    /// Returns the effort of reuse in large cells relative to that of independent paths. The same pixels tell both, so
    /// much of the noise of the pilot cancels.
    fn relative(&self) -> f64 {
        let [independent, large, _] = self.efforts;
        large / independent
    }

    /// Returns the better cells, if reuse pays.
    pub fn cells_that_pay(&self) -> Option<CellSide> {
        (LEAST_GAIN * self.relative() < 1.0).then(|| self.cells())
    }
}

/// Runs the pilot.
pub fn run(integrator: &PathIntegrator, preparation: &Preparation<'_>) -> Efforts {
    let film = &preparation.camera.film;
    let (columns, rows) = (film.width.div_ceil(CELL), film.height.div_ceil(CELL));
    let cells = u64::from(columns) * u64::from(rows);
    let count = cells.min(CELLS);
    let workers = Workers::new(preparation.pool, preparation.sampler, preparation.interrupt);
    let mut trials: Vec<[Trial; MODES.len()]> = Vec::new();
    let mut round = 0;
    loop {
        let trial = |i: u64| {
            // One cell in each of as many stretches of the image.
            let (first, end) = (i * cells / count, (i + 1) * cells / count);
            let random = u64::from(combine(preparation.seed as u32, (round * CELLS + i) as u32));
            let cell = first + ((random * (end - first)) >> 32);
            let (x, y) =
                ((cell % u64::from(columns)) as u32 * CELL, (cell / u64::from(columns)) as u32 * CELL);
            workers.with(|worker| try_cell(integrator, preparation, (x, y), random, worker))
        };
        trials.extend(preparation.pool.install(|| (0..count).into_par_iter().map(trial).collect::<Vec<_>>()));
        let squares = |mode: usize| trials.iter().map(move |trial| &trial[mode].squares[..]);
        let sum = |of: &dyn Fn(&Trial) -> f64, mode: usize| {
            trials.iter().map(|trial| of(&trial[mode])).sum::<f64>()
        };
        // The number of camera paths in each way.
        let paths: [f64; MODES.len()] =
            std::array::from_fn(|mode| SAMPLES as f64 * sum(&|trial| trial.squares.len() as f64, mode));
        let of_paths = std::array::from_fn(|mode| CameraPathPilot {
            error: without_fireflies(squares(mode)) / (3.0 * paths[mode]),
            cost: sum(&|trial| trial.cost, mode) / paths[mode],
            mean: sum(&|trial| trial.sum, mode) / (3.0 * paths[mode]),
        });
        let efforts = std::array::from_fn(|mode| error(squares(mode)) / paths[mode] * of_paths[mode].cost);
        let efforts = Efforts { efforts, of_paths };
        round += 1;
        // In a small image, another round would trace the same cells.
        if round == ROUNDS || cells <= CELLS || !UNCLEAR.contains(&efforts.relative()) {
            return efforts;
        }
    }
}

/// Returns an error from the squared errors of the pixels of each cell: a power mean, so that it is about the mean, but
/// a firefly does not decide alone.
fn error<'a>(cells: impl Iterator<Item = &'a [f64]>) -> f64 {
    let sum = cells.map(|squares| squares.iter().sum::<f64>().powf(EXPONENT)).sum::<f64>();
    sum.powf(1.0 / EXPONENT)
}

/// Returns the sum of the squared errors without those of the [`FIREFLIES`].
fn without_fireflies<'a>(cells: impl Iterator<Item = &'a [f64]>) -> f64 {
    let mut squares: Vec<f64> = cells.flatten().copied().collect();
    squares.sort_by(f64::total_cmp);
    let kept = squares.len() - (FIREFLIES * squares.len() as f64) as usize;
    squares[..kept].iter().sum()
}

/// Traces the [`SAMPLES`] of each pixel of one group in each of the [`MODES`]. The pixels are in the cell whose first
/// pixel is `first`.
fn try_cell(
    integrator: &PathIntegrator,
    preparation: &Preparation<'_>,
    first: (u32, u32),
    number: u64,
    worker: &mut Worker,
) -> [Trial; MODES.len()] {
    let Preparation { scene, camera, seed, .. } = *preparation;
    let size = [camera.film.width, camera.film.height];
    let values = MODES.map(|mode| {
        let pixels = PixelGroups::one_of(mode.unwrap_or(CellSide::Eight), seed, size, first, number);
        let rays = PilotRays::new(preparation, pixels.into_iter(), SAMPLES, STREAM);
        let (radiance, cost) = rays.trace(scene, integrator, SAMPLES, mode.is_some(), worker);
        (radiance.iter().map(|radiance| radiance.value.to_array().map(f64::from)).collect::<Vec<_>>(), cost)
    });
    let mut trials = MODES.map(|_| Trial::default());
    for (mode, trial) in trials.iter_mut().enumerate() {
        let (own, cost) = &values[mode];
        // The mean of a group that reuses its paths stands for the true image, because a pixel's own mean is as noisy
        // as its error.
        let shared = &values[mode.max(1)].0;
        let mean = [0, 1, 2].map(|c| shared.iter().map(|value| value[c]).sum::<f64>() / shared.len() as f64);
        trial.cost = *cost;
        trial.sum = own.iter().flatten().sum();
        trial.squares.extend(own.chunks(SAMPLES).map(|samples| {
            let square = |c: usize| {
                let difference = samples.as_chunks::<2>().0.iter().map(|[a, b]| a[c] - b[c]).sum::<f64>();
                difference.powi(2) / (mean[c] * mean[c] + RELATIVE_FLOOR)
            };
            square(0) + square(1) + square(2)
        }));
    }
    trials
}
