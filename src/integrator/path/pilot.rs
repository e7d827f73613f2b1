//! The choice between independent paths and reuse in cells of either size, by a pilot.
//!
//! Reuse multiplies the cost of a path by about 2. It divides the variance of indirect light by up to 16, but it does
//! not reduce the noise of emitter samples at the first surface, of edges, and of specular paths. The pilot traces
//! some cells of the image in each way and compares error × cost. Its samples are not part of the image. Costs are
//! numbers of rays, so the choice is the same on every machine.

use super::PathIntegrator;
use super::caustics::CameraPathPilot;
use super::groups::{CellSide, PixelGroups};
use crate::accel::Coherence;
use crate::estimate::metrics::RELATIVE_FLOOR;
use crate::film::PixelRect;
use crate::integrator::pilot::PilotRays;
use crate::integrator::preparation::{Preparation, Workers};
use crate::integrator::{Group, Integrator, Radiance, RadianceQuery, Wave, Worker};
use crate::sampling::hash::combine;
use rayon::prelude::*;
use std::ops::Range;

/// The number of cells of a round, and their side in pixels.
const CELLS: u64 = 24;
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

/// The share of the pixels that count as fireflies, if they have the largest errors.
const FIREFLIES: f64 = 0.01;

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

    /// Returns the effort of reuse in the better cells relative to that of independent paths.
    fn relative(&self) -> f64 {
        let [independent, large, small] = self.efforts;
        (if self.cells() == CellSide::Four { small } else { large }) / independent
    }

    /// Returns the better cells, if reuse in them has less effort than independent paths.
    pub fn cells_that_pay(&self) -> Option<CellSide> {
        (self.relative() < 1.0).then(|| self.cells())
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
            let (width, height) = (CELL.min(film.width - x), CELL.min(film.height - y));
            workers
                .with(|worker| try_cell(integrator, preparation, PixelRect { x, y, width, height }, worker))
        };
        trials.extend(preparation.pool.install(|| (0..count).into_par_iter().map(trial).collect::<Vec<_>>()));
        let [all, kept] = [0, 1].map(|i| {
            std::array::from_fn::<f64, { MODES.len() }, _>(|mode| {
                errors(trials.iter().map(|trial| &trial[mode].squares[..]))[i]
            })
        });
        let pixels = trials.iter().map(|trial| trial[0].squares.len()).sum::<usize>() as f64;
        let sum = |of: &dyn Fn(&Trial) -> f64, mode: usize| {
            trials.iter().map(|trial| of(&trial[mode])).sum::<f64>() / (pixels * SAMPLES as f64)
        };
        let of_paths = std::array::from_fn(|mode| CameraPathPilot {
            error: kept[mode] / (pixels * 3.0 * SAMPLES as f64),
            cost: sum(&|trial| trial.cost, mode),
            mean: sum(&|trial| trial.sum, mode) / 3.0,
        });
        let efforts = std::array::from_fn(|mode| (all[mode] * kept[mode]).sqrt() * of_paths[mode].cost);
        let efforts = Efforts { efforts, of_paths };
        round += 1;
        // In a small image, another round would trace the same cells.
        if round == ROUNDS || cells <= CELLS || !UNCLEAR.contains(&efforts.relative()) {
            return efforts;
        }
    }
}

/// Returns two errors from the squared errors of the pixels of cells. Their geometric mean counts, because an image may
/// be judged with its fireflies or without them. One is of all pixels; it is the sum of fourth roots of the cells'
/// sums, to the fourth power, because a few fireflies would dominate a sum of squares. The other is the sum of squares
/// without the [`FIREFLIES`].
fn errors<'a>(cells: impl Iterator<Item = &'a [f64]> + Clone) -> [f64; 2] {
    let all = cells.clone().map(|squares| squares.iter().sum::<f64>().powf(0.25)).sum::<f64>().powi(4);
    let mut squares: Vec<f64> = cells.flatten().copied().collect();
    squares.sort_by(f64::total_cmp);
    let kept = squares.len() - (FIREFLIES * squares.len() as f64) as usize;
    [all, squares[..kept].iter().sum::<f64>()]
}

/// Traces the [`SAMPLES`] of each pixel of a cell in each of the [`MODES`].
fn try_cell(
    integrator: &PathIntegrator,
    preparation: &Preparation<'_>,
    cell: PixelRect,
    worker: &mut Worker,
) -> [Trial; MODES.len()] {
    let Preparation { scene, camera, seed, .. } = preparation;
    let pixels =
        (cell.y..cell.y + cell.height).flat_map(|y| (cell.x..cell.x + cell.width).map(move |x| (x, y)));
    let PilotRays { rays, keys } = PilotRays::new(preparation, pixels, SAMPLES, STREAM);
    let mut groups: Vec<Group> = Vec::new();
    let mut trials = MODES.map(|_| Trial::default());
    let mut radiance = MODES.map(|_| vec![Radiance::NONE; rays.len()]);
    for (mode, side) in MODES.into_iter().enumerate() {
        groups.clear();
        if let Some(side) = side {
            let size = [camera.film.width, camera.film.height];
            PixelGroups::new(side, *seed, size, cell).of_wave(SAMPLES as u32, &mut groups);
        }
        let before = worker.counters;
        let wave = Wave { rays: &rays, keys: &keys, coherence: Coherence::Coherent, groups: &groups };
        integrator.li(scene, wave, RadianceQuery::ALL, worker, &mut radiance[mode]);
        trials[mode].cost = worker.counters.cost() - before.cost();
    }
    // The mean of the cell stands for the true image, because a pixel's own mean is as noisy as its error.
    let values = |mode: usize| radiance[mode].iter().map(|radiance| radiance.value.to_array().map(f64::from));
    let mean = [0, 1, 2].map(|c| values(1).map(|value| value[c]).sum::<f64>() / rays.len() as f64);
    for (mode, trial) in trials.iter_mut().enumerate() {
        let values: Vec<[f64; 3]> = values(mode).collect();
        trial.sum = values.iter().flatten().sum();
        trial.squares.extend(values.chunks(SAMPLES).map(|samples| {
            let square = |c: usize| {
                let difference = samples.as_chunks::<2>().0.iter().map(|[a, b]| a[c] - b[c]).sum::<f64>();
                difference.powi(2) / (mean[c] * mean[c] + RELATIVE_FLOOR)
            };
            square(0) + square(1) + square(2)
        }));
    }
    trials
}
