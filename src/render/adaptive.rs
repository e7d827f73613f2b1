//! Adaptive sampling: more samples where the relative error is larger, without bias.
//!
//! A pilot estimates the noise of the cells of the image, and each cell gets a rate: the samples of its pixels for each
//! sample that the user asks for, after the first eight. The samples of the pilot are not part of the image, so the
//! rates are independent of all samples in it, and the means of pixels remain unbiased. The rates depend on nothing but
//! the view and the seed. A crop, a range of samples, or a continued render therefore takes the same samples as the
//! whole.

use crate::estimate::metrics::RELATIVE_FLOOR;
use crate::integrator::path::groups::{CellSide, PixelGroups};
use crate::integrator::pilot::PilotRays;
use crate::integrator::preparation::Workers;
use crate::integrator::settings::WhenPays;
use crate::integrator::{Integrator, Preparation, Radiance, Worker};
use rayon::prelude::*;
use std::ops::Range;

/// The side of a cell in pixels: that of the larger cells in which paths are reused.
const SIDE: u32 = CellSide::Eight as u32;
/// The number of samples of a pixel of the pilot. One group of pixels of each cell takes part in it.
const SAMPLES: usize = 8;
/// The random numbers of the pilot are others than those of the image.
const STREAM: u64 = 0x6164_6170_7469_7665;
/// The range of rates. They are multiples of a quarter of a power of two, so that cells which are equally noisy have
/// exactly the rate 1.
const LEAST: f64 = 0.25;
const MOST: f64 = 8.0;
/// Up to this number, all pixels have all samples; rates apply to those after it. A cell whose noise the pilot has
/// missed has at least these.
const EQUAL: u64 = 8;
/// The half widths, in cells, of the neighbourhoods from which a cell's noise is estimated, from the widest.
const RADII: [usize; 4] = [4, 2, 1, 0];
/// A neighbourhood with this effective number of pixels determines a half of the estimate.
const TRUSTED: f64 = 8.0;
/// One of at least this number of cells, and at most this number in all, decide whether rates pay: if the efficiency
/// would be at least [`LEAST_GAIN`], or [`LEAST_GAIN_OF_SPLIT`] if paths share camera rays, whose pilots promise less.
const LEAST_PART: usize = 4;
const MOST_DECIDE: usize = 4096;
const LEAST_GAIN: f64 = 1.6;
const LEAST_GAIN_OF_SPLIT: f64 = 1.3;
/// The cost of a sample without its rays, in nearest-hit queries.
const SAMPLE_COST: f64 = 4.0;
/// The weight of the mean over the cells in the estimate from a half of a cell.
const PRIOR: f64 = 0.2;

/// The rates of the cells of an image.
#[derive(Clone, Debug)]
pub struct Rates {
    columns: usize,
    rates: Vec<f32>,
}

impl Rates {
    /// Runs the pilot for a render of at most `samples` samples per pixel, if `adaptive` is not `Never`. Returns the
    /// rates, unless the samples are too few, or `adaptive` is `Auto` and a part of the cells shows that they would not
    /// pay.
    pub fn measure(
        integrator: &dyn Integrator,
        preparation: &Preparation<'_>,
        adaptive: WhenPays,
        samples: Option<u64>,
    ) -> Option<Self> {
        // Light paths contribute to all pixels alike.
        let alike = integrator.light_tracer().is_some();
        if adaptive == WhenPays::Never || alike || samples.is_some_and(|samples| samples <= EQUAL) {
            return None;
        }
        let film = &preparation.camera.film;
        let columns = film.width.div_ceil(SIDE) as usize;
        let count = columns * film.height.div_ceil(SIDE) as usize;
        let first = |i: usize| ((i % columns) as u32 * SIDE, (i / columns) as u32 * SIDE);
        let area = |(x, y): (u32, u32)| SIDE.min(film.width - x) * SIDE.min(film.height - y);
        let workers = Workers::new(preparation.pool, preparation.sampler, preparation.interrupt);
        let measure =
            |i: usize| workers.with(|worker| (i, measure_cell(integrator, preparation, first(i), worker)));
        let part = LEAST_PART.max(count.div_ceil(MOST_DECIDE));
        let decides = |i: &usize| (i % columns + part / 2 * (i / columns)).is_multiple_of(part);
        let measure_all = |decide: bool| -> Vec<(usize, Noise)> {
            let cells: Vec<usize> = (0..count).filter(|i| decides(i) == decide).collect();
            preparation.pool.install(|| cells.into_par_iter().map(measure).collect())
        };
        let mut noise = measure_all(true);
        let least = if integrator.paths_per_ray() > 1 { LEAST_GAIN_OF_SPLIT } else { LEAST_GAIN };
        if adaptive == WhenPays::Auto && gain(&noise) < least {
            return None;
        }
        noise.extend(measure_all(false));
        noise.sort_by_key(|(cell, _)| *cell);
        let noise: Vec<Noise> = noise.into_iter().map(|(_, noise)| noise).collect();
        let pixels: Vec<f64> = (0..count).map(|i| f64::from(area(first(i)))).collect();
        let error = |(square, noise): (f64, &Noise)| (square / noise.cost_of_pixel()).sqrt();
        let errors: Vec<f64> = estimates(&noise, columns).into_iter().zip(&noise).map(error).collect();
        Some(Rates { columns, rates: rates(&errors, &pixels) })
    }

    /// Returns the range of samples of the pixel (x, y) of the full image, for a range of the samples that the user
    /// asks for.
    #[inline]
    pub fn samples(&self, (x, y): (u32, u32), asked: &Range<u64>) -> Range<u64> {
        let rate = f64::from(self.rates[(y / SIDE) as usize * self.columns + (x / SIDE) as usize]);
        let count = |asked: u64| match asked.checked_sub(EQUAL) {
            None => asked,
            // Even numbers keep the halves equal.
            Some(rest) => EQUAL.saturating_add(((rate * rest as f64 / 2.0) as u64).saturating_mul(2)),
        };
        count(asked.start)..count(asked.end)
    }
}

/// Returns the efficiency with rates relative to that without, from the noise of some cells. Rates come from a half of
/// the pixels of each cell, and the errors to which they lead from the other half.
fn gain(cells: &[(usize, Noise)]) -> f64 {
    let (mut with, mut without) = ([0.0; 2], [0.0; 2]);
    for half in [0, 1] {
        let squares = || cells.iter().map(|(_, cell)| cell.of_halves[half]);
        let mean = squares().sum::<f64>() / cells.len() as f64;
        let error = |(square, (_, cell)): (f64, &(usize, Noise))| {
            ((square + PRIOR * mean) / (1.0 + PRIOR) / cell.cost_of_pixel()).sqrt()
        };
        let errors: Vec<f64> = squares().zip(cells).map(error).collect();
        for (rate, (_, cell)) in rates(&errors, &vec![1.0; cells.len()]).into_iter().zip(cells) {
            let (rate, square, cost) = (f64::from(rate), cell.of_halves[1 - half], cell.cost_of_pixel());
            with = [with[0] + square / rate, with[1] + cost * rate];
            without = [without[0] + square, without[1] + cost];
        }
    }
    if with[0] > 0.0 { without[0] * without[1] / (with[0] * with[1]) } else { 1.0 }
}

impl Noise {
    fn cost_of_pixel(&self) -> f64 {
        self.cost / self.pixels
    }
}

/// Sums over the pixels of a cell in the pilot, of which d is the relative error of a pixel.
#[derive(Clone, Copy, Debug, Default)]
struct Noise {
    pixels: f64,
    /// The sum of d².
    squares: f64,
    /// The sums of d² over every other pixel.
    of_halves: [f64; 2],
    /// The sum of d⁴.
    fourths: f64,
    /// The cost of the samples, in nearest-hit queries.
    cost: f64,
}

/// Takes the samples of the pilot in the cell whose first pixel is `first`.
fn measure_cell(
    integrator: &dyn Integrator,
    preparation: &Preparation<'_>,
    first: (u32, u32),
    worker: &mut Worker,
) -> Noise {
    let film = &preparation.camera.film;
    let reused = integrator.reuse_cells();
    let (side, size) = (reused.unwrap_or(CellSide::Eight), [film.width, film.height]);
    let pixels = PixelGroups::one_of(side, preparation.seed, size, first, preparation.seed ^ STREAM);
    let rays = PilotRays::new(preparation, pixels.into_iter(), SAMPLES, STREAM);
    let (radiance, cost) = rays.trace(preparation.scene, integrator, SAMPLES, reused.is_some(), worker);
    let cost = cost + SAMPLE_COST * radiance.len() as f64;
    let mut noise = Noise { cost, ..Noise::default() };
    for (i, square) in radiance.as_chunks::<SAMPLES>().0.iter().map(relative_square).enumerate() {
        noise.pixels += 1.0;
        noise.squares += square;
        noise.fourths += square * square;
        noise.of_halves[i % 2] += square;
    }
    noise
}

/// Returns the squared difference between the halves of a pixel's samples relative to their mean.
fn relative_square(samples: &[Radiance; SAMPLES]) -> f64 {
    let (mut sums, mut differences) = ([0.0; 3], [0.0; 3]);
    for (i, sample) in samples.iter().filter(|sample| sample.value.is_valid()).enumerate() {
        for (c, value) in sample.value.to_array().into_iter().enumerate() {
            sums[c] += f64::from(value);
            differences[c] += if i % 2 == 0 { f64::from(value) } else { -f64::from(value) };
        }
    }
    let relative = |c: usize| {
        let mean = sums[c] / SAMPLES as f64;
        (differences[c] / SAMPLES as f64).powi(2) / (mean * mean + RELATIVE_FLOOR)
    };
    relative(0) + relative(1) + relative(2)
}

/// Returns the mean square of the relative error in each cell. That of a neighbourhood counts the more, the larger its
/// effective number of pixels (Σ d²)² / Σ d⁴ is; the rest of the estimate comes from the next wider one. A cell with a
/// single firefly is therefore as noisy as its neighbours.
fn estimates(noise: &[Noise], columns: usize) -> Vec<f64> {
    let rows = noise.len() / columns;
    let sum = |x: Range<usize>, y: Range<usize>| {
        y.flat_map(|y| &noise[y * columns + x.start..y * columns + x.end]).fold(Noise::default(), |a, b| {
            let (pixels, squares) = (a.pixels + b.pixels, a.squares + b.squares);
            Noise { pixels, squares, fourths: a.fourths + b.fourths, ..a }
        })
    };
    let of_image = sum(0..columns, 0..rows);
    let estimate = |cell: usize| {
        let (x, y) = (cell % columns, cell / columns);
        RADII.iter().fold(of_image.squares / of_image.pixels, |wider, radius| {
            let around = |i: usize, end: usize| i.saturating_sub(*radius)..(i + radius + 1).min(end);
            let Noise { pixels, squares, fourths, .. } = sum(around(x, columns), around(y, rows));
            let effective = if fourths > 0.0 { squares * squares / fourths } else { pixels };
            let trust = effective / (effective + TRUSTED);
            trust * squares / pixels + (1.0 - trust) * wider
        })
    };
    (0..noise.len()).map(estimate).collect()
}

/// Returns the rates of cells with the given errors and numbers of pixels: in proportion to the error, between
/// [`LEAST`] and [`MOST`], and at most 1 on average over the pixels.
fn rates(errors: &[f64], pixels: &[f64]) -> Vec<f32> {
    if errors.iter().all(|error| *error == 0.0) {
        return vec![1.0; errors.len()];
    }
    let total: f64 = pixels.iter().sum();
    let rate = |error: f64, factor: f64| {
        let rate = (factor * error).clamp(LEAST, MOST);
        let octave = rate.log2().floor().exp2();
        octave * (4.0 * rate / octave).floor() / 4.0
    };
    let mean = |factor: f64| {
        errors.iter().zip(pixels).map(|(error, pixels)| rate(*error, factor) * pixels).sum::<f64>() / total
    };
    // Bisection for the logarithm of the factor; the mean is a non-decreasing function of it.
    let (mut low, mut high) = (-128.0, 128.0);
    for _ in 0..64 {
        let middle: f64 = 0.5 * (low + high);
        if mean(middle.exp2()) <= 1.0 { low = middle } else { high = middle }
    }
    errors.iter().map(|error| rate(*error, low.exp2()) as f32).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const COLUMNS: usize = 20;

    /// Returns the noise of cells of sixteen equal pixels.
    fn noise(square: impl Fn(usize, usize) -> f64) -> Vec<Noise> {
        let cell = |i: usize| {
            let square = square(i % COLUMNS, i / COLUMNS);
            Noise {
                pixels: 16.0,
                squares: 16.0 * square,
                fourths: 16.0 * square * square,
                cost: 1.0,
                ..Noise::default()
            }
        };
        (0..COLUMNS * 10).map(cell).collect()
    }

    #[test]
    fn rates_follow_the_noise_and_meet_the_budget() {
        let squares = estimates(&noise(|x, _| if x < 10 { 1e-4 } else { 9e-4 }), COLUMNS);
        let errors: Vec<f64> = squares.iter().map(|square| square.sqrt()).collect();
        let rates = rates(&errors, &[64.0; 200]);
        let mean = rates.iter().map(|rate| f64::from(*rate)).sum::<f64>() / 200.0;
        assert!((0.9..=1.0).contains(&mean), "{mean}");
        let ratio = rates[19] / rates[0];
        assert!((2.0..=3.5).contains(&ratio), "{ratio}");
        assert!(rates.iter().all(|rate| f64::from(*rate) >= LEAST && f64::from(*rate) <= MOST));
    }

    #[test]
    fn one_firefly_does_not_make_a_cell_noisy() {
        let mut cells = noise(|_, _| 1e-4);
        let quiet = estimates(&cells, COLUMNS)[105];
        cells[105].squares += 1.0;
        cells[105].fourths += 1.0;
        let firefly = estimates(&cells, COLUMNS)[105];
        cells[105] = Noise { pixels: 16.0, squares: 1.0, fourths: 1.0 / 16.0, cost: 1.0, ..Noise::default() };
        let noisy = estimates(&cells, COLUMNS)[105];
        assert!(firefly < 0.5 * noisy && firefly < 300.0 * quiet, "{quiet} {firefly} {noisy}");
    }

    #[test]
    fn ranges_add_up_and_the_first_samples_are_taken_everywhere() {
        let rates = Rates { columns: 3, rates: vec![0.25, 1.0, 7.0] };
        for (pixel, counts) in
            [((3, 7), [4, 10, 22, 70]), ((8, 0), [4, 16, 64, 256]), ((16, 0), [4, 64, 400, 1744])]
        {
            let ends = [4, 16, 64, 256].map(|end| rates.samples(pixel, &(0..end)).end);
            assert_eq!(ends, counts);
            for parts in [0, 1, 2, 3, 5, 16, 17, 33, 64].windows(2) {
                let before = rates.samples(pixel, &(0..parts[0]));
                let range = rates.samples(pixel, &(parts[0]..parts[1]));
                assert_eq!(before.end, range.start);
                assert!(range.end >= range.start);
            }
            assert_eq!(rates.samples(pixel, &(0..3)), 0..3);
        }
    }

    #[test]
    fn no_noise_at_all_is_spread_evenly() {
        assert_eq!(rates(&estimates(&noise(|_, _| 0.0), COLUMNS), &[64.0; 200]), [1.0; 200]);
        assert_eq!(rates(&estimates(&noise(|_, _| 0.3), COLUMNS), &[64.0; 200]), [1.0; 200]);
    }
}
