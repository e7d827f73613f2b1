//! The choice between independent paths and reuse, by a pilot.
//!
//! Reuse multiplies the cost of a path by about 2. It divides the variance of indirect light by up to 16, but it does
//! not reduce the noise of emitter samples at the first surface, of edges, and of specular paths. The pilot traces
//! some cells of the image both ways and compares error × cost. Its samples are not part of the image. Costs are
//! numbers of rays, so the choice is the same on every machine.

use super::PathIntegrator;
use super::groups::{CELL, PixelGroups};
use crate::accel::Coherence;
use crate::estimate::metrics::RELATIVE_FLOOR;
use crate::film::PixelRect;
use crate::integrator::preparation::{Preparation, Workers};
use crate::integrator::worker::draw_2d;
use crate::integrator::{Group, Integrator, Radiance, RadianceQuery, Wave, Worker};
use crate::math::{DVec2, Ray, Vec2};
use crate::sampling::hash::combine;
use crate::sampling::{Dimension, SampleKey};
use rayon::prelude::*;

/// The number of cells of the pilot.
const CELLS: u64 = 32;
/// The cost of an occlusion query relative to that of a nearest-hit query.
const OCCLUSION_COST: f64 = 0.4;
/// The seed of the pilot's samples is another than that of the image.
const SEED: u64 = 0x7069_6c6f_7470_6174;

/// The errors and costs of a cell with independent paths and with reuse.
#[derive(Clone, Copy, Default)]
struct Trial {
    /// Fourth roots of the mean squared relative errors. Their sums are compared, because a few fireflies would
    /// dominate sums of squares.
    errors: [f64; 2],
    costs: [f64; 2],
}

/// Returns whether reuse is expected to reach a given error at less cost than independent paths.
pub fn reuse_pays(integrator: &PathIntegrator, preparation: &Preparation<'_>) -> bool {
    let film = &preparation.camera.film;
    let (columns, rows) = (film.width.div_ceil(CELL), film.height.div_ceil(CELL));
    let cells = u64::from(columns) * u64::from(rows);
    let trials = cells.min(CELLS);
    let workers = Workers::new(preparation.pool, preparation.sampler, preparation.interrupt);
    let trials: Vec<Trial> = preparation.pool.install(|| {
        let trial = |i: u64| {
            // One cell in each of as many stretches of the image.
            let (first, end) = (i * cells / trials, (i + 1) * cells / trials);
            let random = u64::from(combine(preparation.seed as u32, i as u32));
            let cell = first + ((random * (end - first)) >> 32);
            let (x, y) =
                ((cell % u64::from(columns)) as u32 * CELL, (cell / u64::from(columns)) as u32 * CELL);
            let (width, height) = (CELL.min(film.width - x), CELL.min(film.height - y));
            workers
                .with(|worker| try_cell(integrator, preparation, PixelRect { x, y, width, height }, worker))
        };
        (0..trials).into_par_iter().map(trial).collect()
    });
    let sum =
        |of: fn(&Trial) -> [f64; 2], mode: usize| trials.iter().map(|trial| of(trial)[mode]).sum::<f64>();
    let effort = |mode| sum(|trial| trial.errors, mode).powi(4) * sum(|trial| trial.costs, mode);
    effort(1) < effort(0)
}

/// Traces a sample of either half in each pixel of a cell, with independent paths and with reuse.
fn try_cell(
    integrator: &PathIntegrator,
    preparation: &Preparation<'_>,
    cell: PixelRect,
    worker: &mut Worker,
) -> Trial {
    let Preparation { scene, camera, sampler, seed, .. } = preparation;
    let pixels =
        || (cell.y..cell.y + cell.height).flat_map(|y| (cell.x..cell.x + cell.width).map(move |x| (x, y)));
    let key = |(x, y), sample| sampler.key(seed ^ SEED, x, y, sample);
    let keys: Vec<SampleKey> = pixels().flat_map(|p| [key(p, 0), key(p, 1)]).collect();
    let mut numbers = [(); 2].map(|()| [Vec::new(), Vec::new()]);
    draw_2d(*sampler, Dimension::PIXEL, &keys, &mut numbers[0]);
    draw_2d(*sampler, Dimension::LENS, &keys, &mut numbers[1]);
    let pair = |of: usize, i: usize| Vec2::new(numbers[of][0][i], numbers[of][1][i]);
    let ray = |(i, (x, y)): (usize, (u32, u32))| {
        let film = DVec2::new(f64::from(x), f64::from(y)) + pair(0, i).as_dvec2();
        camera.ray(film, pair(1, i), 0.0)
    };
    let rays: Vec<Ray> = pixels().flat_map(|p| [p, p]).enumerate().map(ray).collect();
    let mut groups: Vec<Group> = Vec::new();
    PixelGroups::new(*seed, [camera.film.width, camera.film.height], cell).of_wave(2, &mut groups);
    let mut trial = Trial::default();
    let mut radiance = [(); 2].map(|()| vec![Radiance::NONE; rays.len()]);
    for (mode, groups) in [&[][..], &groups].into_iter().enumerate() {
        let before = worker.counters;
        let wave = Wave { rays: &rays, keys: &keys, coherence: Coherence::Coherent, groups };
        integrator.li(scene, wave, RadianceQuery::ALL, worker, &mut radiance[mode]);
        let nearest = worker.counters.closest_rays - before.closest_rays;
        let occlusion = worker.counters.occlusion_rays - before.occlusion_rays;
        trial.costs[mode] = nearest as f64 + OCCLUSION_COST * occlusion as f64;
    }
    // The mean of the cell stands for the true image, because a pixel's own mean is as noisy as its error.
    let values = |mode: usize| radiance[mode].iter().map(|radiance| radiance.value.to_array().map(f64::from));
    let mean = [0, 1, 2].map(|c| values(1).map(|value| value[c]).sum::<f64>() / rays.len() as f64);
    let mut squares = [0.0; 2];
    for (mode, square) in squares.iter_mut().enumerate() {
        let values: Vec<[f64; 3]> = values(mode).collect();
        for [a, b] in values.as_chunks::<2>().0 {
            for c in 0..3 {
                *square += (a[c] - b[c]).powi(2) / (mean[c] * mean[c] + RELATIVE_FLOOR);
            }
        }
    }
    trial.errors = squares.map(|square| square.sqrt().sqrt());
    trial
}
