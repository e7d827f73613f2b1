//! The choice among independent paths, split paths, and reuse in cells of either size, by a pilot.
//!
//! Reuse multiplies the cost of a path by about 2. It divides the variance of indirect light by up to 16, but it does
//! not reduce the noise of emitter samples at the first surface, of edges, and of specular paths. Splitting divides the
//! noise of one part of the path at the cost of that part. The pilot traces some cells of the image in several ways and
//! compares error × cost. Its samples are not part of the image. Costs are numbers of rays, so the choice is the same
//! on every machine.

use super::PathIntegrator;
use super::caustics::CameraPathPilot;
use super::groups::{CellSide, PixelGroups};
use super::splitting::Splitting;
use crate::estimate::metrics::RELATIVE_FLOOR;
use crate::integrator::pilot::PilotRays;
use crate::integrator::preparation::{Preparation, Workers};
use crate::integrator::settings::WhenPays;
use crate::integrator::{Integrator, Radiance, RadianceQuery, Wave, Worker};
use crate::sampling::hash::combine;
use crate::scene::Scene;
use rayon::prelude::*;
use std::ops::Range;

/// The number of cells of a round, of each of which one group of pixels is traced, and their side in pixels.
const CELLS: u64 = 48;
const CELL: u32 = CellSide::Eight as u32;
/// The number of samples of a pixel, of which the halves of a pixel have every other one. With one sample in each half,
/// the direct light of emitters would be noisier beside indirect light than in an image, because samples of few
/// dimensions become exact sooner.
const SAMPLES: usize = 16;
/// Another round of cells is traced, up to [`ROUNDS`], if the effort of reuse relative to that of paths without reuse
/// is in this range.
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
/// The least efficiency of reuse relative to paths without reuse. Errors of pixels that share paths are correlated, so
/// they are worth a little less; and the pilot, with few samples, is too favourable to reuse.
const LEAST_GAIN: f64 = 1.3;

/// The number of samples of the part of a path that is split in the pilot, and the numbers that may be chosen.
const SPLIT: u32 = 4;
const COUNTS: [u32; 3] = [1, 2, 4];
/// The least efficiency of split paths relative to others.
pub(super) const LEAST_GAIN_OF_SPLITTING: f64 = 1.1;
/// The cost of another emitter sample without its ray, in nearest-hit queries, and what a level of the tree of emitters
/// adds.
const EMITTER_SAMPLE_COST: [f64; 2] = [0.3, 0.1];

/// A way to trace the paths of a cell.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
struct Way {
    cells: Option<CellSide>,
    splitting: Splitting,
}

impl Way {
    const INDEPENDENT: Way = Way { cells: None, splitting: Splitting::NONE };
    const SPLIT_EMITTERS: Way = Way::split(SPLIT, 1);
    const SPLIT_DIRECTIONS: Way = Way::split(1, SPLIT);
    const LARGE_CELLS: Way = Way { cells: Some(CellSide::Eight), splitting: Splitting::NONE };
    const SMALL_CELLS: Way = Way { cells: Some(CellSide::Four), splitting: Splitting::NONE };

    const fn split(emitters: u32, directions: u32) -> Way {
        Way { cells: None, splitting: Splitting { emitters, directions } }
    }
}

/// The errors and the cost of a cell in one of the ways.
#[derive(Default)]
struct Trial {
    /// The squared relative error of each pixel, times a constant.
    squares: Vec<f64>,
    cost: f64,
    /// The sum of all samples and channels.
    sum: f64,
}

/// What the pilot has found about a way.
#[derive(Clone, Copy)]
struct Found {
    /// The error of a sample, for comparisons, in arbitrary units.
    error: f64,
    paths: CameraPathPilot,
}

impl Found {
    /// Returns the cost of an error, in arbitrary units.
    fn effort(&self) -> f64 {
        self.error * self.paths.cost
    }
}

/// The choice of the pilot.
pub(super) struct Choice {
    /// The cells in which paths are reused.
    pub cells: Option<CellSide>,
    /// The samples at the first surface.
    pub splitting: Splitting,
    /// What is known of the paths, also with other numbers of samples, for a choice that knows more. The first has the
    /// fewest samples.
    pub known: Vec<(Splitting, CameraPathPilot)>,
}

/// The paths of an integrator with another splitting.
struct WithSplitting<'a>(&'a PathIntegrator, Splitting);

impl Integrator for WithSplitting<'_> {
    fn name(&self) -> &'static str {
        self.0.name()
    }

    fn li(
        &self,
        scene: &Scene,
        wave: Wave<'_>,
        query: RadianceQuery,
        worker: &mut Worker,
        out: &mut [Radiance],
    ) {
        match wave.groups {
            [] => self.0.trace_split(scene, wave, (query, self.1), worker, out),
            _ => self.0.li(scene, wave, query, worker, out),
        }
    }
}

/// The pilot: cells that have been traced in some ways.
struct Pilot<'a> {
    integrator: &'a PathIntegrator,
    preparation: &'a Preparation<'a>,
    workers: Workers,
    /// Whether paths are split even if it does not pay.
    must_split: bool,
    ways: Vec<Way>,
    /// For each way, one trial for each cell.
    trials: Vec<Vec<Trial>>,
    rounds: u64,
}

/// Runs the pilot. `reuse` and `split` tell whether paths are reused, and whether others are split.
pub(super) fn run(
    integrator: &PathIntegrator,
    [reuse, split]: [WhenPays; 2],
    preparation: &Preparation<'_>,
) -> Choice {
    let mut ways = vec![Way::INDEPENDENT];
    if split != WhenPays::Never {
        ways.extend([Way::SPLIT_EMITTERS, Way::SPLIT_DIRECTIONS]);
    }
    if reuse != WhenPays::Never {
        ways.push(Way::LARGE_CELLS);
    }
    let workers = Workers::new(preparation.pool, preparation.sampler, preparation.interrupt);
    let trials = ways.iter().map(|_| Vec::new()).collect();
    let must_split = split == WhenPays::Always;
    let mut pilot = Pilot { integrator, preparation, workers, must_split, ways, trials, rounds: 0 };
    pilot.trace();
    while reuse == WhenPays::Auto && pilot.is_unclear() {
        pilot.trace();
    }
    let (splitting, split) = pilot.best_splitting();
    let known = pilot.splittings().into_iter().map(|(splitting, found)| (splitting, found.paths)).collect();
    let without = Choice { cells: None, splitting, known };
    if reuse == WhenPays::Never {
        return without;
    }
    let large = pilot.found(Way::LARGE_CELLS);
    if reuse == WhenPays::Auto && LEAST_GAIN * large.effort() >= split.effort() {
        return without;
    }
    pilot.trace_way(Way::SMALL_CELLS);
    let small = pilot.found(Way::SMALL_CELLS);
    let (cells, found) = match small.effort() < SMALL_CELLS * large.effort() {
        true => (CellSide::Four, small),
        false => (CellSide::Eight, large),
    };
    let known = vec![(Splitting::NONE, found.paths)];
    Choice { cells: Some(cells), splitting: Splitting::NONE, known }
}

impl Pilot<'_> {
    /// Traces another round of cells in all ways.
    fn trace(&mut self) {
        let round = self.round(&self.ways, self.rounds);
        self.trials.iter_mut().zip(round).for_each(|(trials, new)| trials.extend(new));
        self.rounds += 1;
    }

    /// Traces the same cells in another way.
    fn trace_way(&mut self, way: Way) {
        let trials = (0..self.rounds).flat_map(|round| self.round(&[way], round)).flatten().collect();
        self.ways.push(way);
        self.trials.push(trials);
    }

    /// Traces the cells of a round. Returns the trials of each way.
    fn round(&self, ways: &[Way], round: u64) -> Vec<Vec<Trial>> {
        let film = &self.preparation.camera.film;
        let columns = u64::from(film.width.div_ceil(CELL));
        let (cells, count) = (self.cells(), self.cells().min(CELLS));
        let trial = |i: u64| {
            // One cell in each of as many stretches of the image.
            let (first, end) = (i * cells / count, (i + 1) * cells / count);
            let random = u64::from(combine(self.preparation.seed as u32, (round * CELLS + i) as u32));
            let cell = first + ((random * (end - first)) >> 32);
            let place = ((cell % columns) as u32 * CELL, (cell / columns) as u32 * CELL);
            self.workers.with(|worker| self.try_cell(ways, place, random, worker))
        };
        let pool = self.preparation.pool;
        let cells: Vec<Vec<Trial>> = pool.install(|| (0..count).into_par_iter().map(trial).collect());
        let mut of_ways: Vec<Vec<Trial>> = ways.iter().map(|_| Vec::new()).collect();
        for trials in cells {
            of_ways.iter_mut().zip(trials).for_each(|(of_way, trial)| of_way.push(trial));
        }
        of_ways
    }

    /// Returns the number of cells of the image.
    fn cells(&self) -> u64 {
        let film = &self.preparation.camera.film;
        u64::from(film.width.div_ceil(CELL)) * u64::from(film.height.div_ceil(CELL))
    }

    /// Returns whether another round of cells may change the choice whether paths are reused. In a small image, it
    /// would trace the same cells.
    fn is_unclear(&self) -> bool {
        let relative = self.found(Way::LARGE_CELLS).effort() / self.best_splitting().1.effort();
        self.rounds < ROUNDS && self.cells() > CELLS && UNCLEAR.contains(&relative)
    }

    /// Returns what is known of a way that was traced.
    fn found(&self, way: Way) -> Found {
        let trials =
            &self.trials[self.ways.iter().position(|other| *other == way).expect("a way that was traced")];
        let sum = |of: &dyn Fn(&Trial) -> f64| trials.iter().map(of).sum::<f64>();
        let squares = trials.iter().map(|trial| &trial.squares[..]);
        // The number of camera paths.
        let paths = SAMPLES as f64 * sum(&|trial| trial.squares.len() as f64);
        Found {
            error: error(squares.clone()) / paths,
            paths: CameraPathPilot {
                error: without_fireflies(squares) / (3.0 * paths),
                cost: sum(&|trial| trial.cost) / paths,
                mean: sum(&|trial| trial.sum) / (3.0 * paths),
            },
        }
    }

    /// Returns what is expected of each splitting that may be chosen. The first is that which splits nothing, unless
    /// paths must be split.
    fn splittings(&self) -> Vec<(Splitting, Found)> {
        let none = self.found(Way::INDEPENDENT);
        if !self.ways.contains(&Way::SPLIT_EMITTERS) {
            return vec![(Splitting::NONE, none)];
        }
        // The variance of a part is in inverse proportion to its samples, and its cost in proportion.
        let most = f64::from(SPLIT);
        let mut parts = [Way::SPLIT_EMITTERS, Way::SPLIT_DIRECTIONS].map(|way| {
            let part = self.found(way);
            // The mean of two ratios: with the worst pixels it is uncertain, without them it leaves out fireflies.
            let left = (part.error / none.error * part.paths.error / none.paths.error).sqrt();
            // Also if there is no error at all.
            let gone = if left < 1.0 { (1.0 - left) * most / (most - 1.0) } else { 0.0 };
            (gone, (part.paths.cost - none.paths.cost) / (most - 1.0))
        });
        // Together they are at most the whole variance, though each is found with an error.
        let sum = parts[0].0 + parts[1].0;
        parts.iter_mut().for_each(|(gone, _)| *gone /= f64::max(sum, 1.0));
        let levels = (self.preparation.scene.lights.len().max(1) as f64).log2();
        let emitter_sample = EMITTER_SAMPLE_COST[0] + EMITTER_SAMPLE_COST[1] * levels;
        let expected = |splitting: Splitting| {
            let (mut left, mut cost) = (1.0, none.paths.cost);
            for ((gone, added), count) in parts.into_iter().zip([splitting.emitters, splitting.directions]) {
                left -= gone * (1.0 - 1.0 / f64::from(count));
                cost += added * f64::from(count - 1);
            }
            cost += emitter_sample * f64::from(splitting.emitters - 1);
            let paths = CameraPathPilot { error: left * none.paths.error, cost, ..none.paths };
            (splitting, Found { error: left * none.error, paths })
        };
        COUNTS
            .iter()
            .flat_map(|&emitters| COUNTS.map(|directions| expected(Splitting { emitters, directions })))
            .filter(|(splitting, _)| !self.must_split || *splitting != Splitting::NONE)
            .collect()
    }

    /// Returns the best numbers of samples at the first surface, and what is expected of them.
    fn best_splitting(&self) -> (Splitting, Found) {
        let splittings = self.splittings().into_iter();
        splittings.min_by(|a, b| self.effort(a).total_cmp(&self.effort(b))).expect("some")
    }

    /// Returns the effort of a splitting, for comparisons with others.
    fn effort(&self, (splitting, found): &(Splitting, Found)) -> f64 {
        let cost = found.paths.cost + self.preparation.scene.camera_path_cost;
        found.error * cost * handicap(*splitting, LEAST_GAIN_OF_SPLITTING)
    }

    /// Traces the [`SAMPLES`] of each pixel of one group in each of the ways. The pixels are in the cell whose first
    /// pixel is `first`.
    fn try_cell(&self, ways: &[Way], first: (u32, u32), number: u64, worker: &mut Worker) -> Vec<Trial> {
        let Preparation { scene, camera, seed, .. } = *self.preparation;
        let size = [camera.film.width, camera.film.height];
        let trace = |way: &Way| {
            let cells = way.cells.unwrap_or(CellSide::Eight);
            let pixels = PixelGroups::one_of(cells, seed, size, first, number);
            let rays = PilotRays::new(self.preparation, pixels.into_iter(), SAMPLES, STREAM);
            let integrator = WithSplitting(self.integrator, way.splitting);
            let (radiance, cost) = rays.trace(scene, &integrator, SAMPLES, way.cells.is_some(), worker);
            // Invalid samples are black, as in the image.
            let value = |Radiance { value, .. }: &Radiance| {
                if value.is_valid() { value.to_array().map(f64::from) } else { [0.0; 3] }
            };
            let values: Vec<[f64; 3]> = radiance.iter().map(value).collect();
            (values, cost)
        };
        let traced: Vec<_> = ways.iter().map(trace).collect();
        // The mean of the group stands for the true image, because a pixel's own mean is as noisy as its error. The
        // way that comes last, with reuse or four directions, is the least noisy.
        let (least_noisy, _) = traced.last().expect("some ways");
        let mean = [0, 1, 2]
            .map(|c| least_noisy.iter().map(|value| value[c]).sum::<f64>() / least_noisy.len() as f64);
        let trial = |(values, cost): (Vec<[f64; 3]>, f64)| Trial {
            squares: values
                .chunks(SAMPLES)
                .map(|samples| {
                    let square = |c: usize| {
                        let difference =
                            samples.as_chunks::<2>().0.iter().map(|[a, b]| a[c] - b[c]).sum::<f64>();
                        difference.powi(2) / (mean[c] * mean[c] + RELATIVE_FLOOR)
                    };
                    square(0) + square(1) + square(2)
                })
                .collect(),
            sum: values.iter().flatten().sum(),
            cost,
        };
        traced.into_iter().map(trial).collect()
    }
}

/// Returns the factor of the effort of a splitting in comparisons, so that gains below `least` do not count.
pub(super) fn handicap(splitting: Splitting, least: f64) -> f64 {
    if splitting == Splitting::NONE { 1.0 / least } else { 1.0 }
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
