//! The light paths of a pass: traced in batches, and added to the film in the order of the batches.

use super::job::Job;
use super::passes::TILE;
use super::tracing::CameraWorker;
use crate::film::{PixelRect, Tile};
use crate::integrator::{LightTracer, Splat};
use crate::sampling::SampleKey;
use rayon::prelude::*;
use std::ops::Range;
use std::sync::{Mutex, PoisonError};

/// The number of light paths in a batch.
const BATCH: u64 = 2048;
/// The number of batches traced before their splats are added. It gives enough work to many threads and limits
/// memory.
const AT_ONCE: u64 = 256;

/// Traces one light path for each pixel of the full image and each sample of the range, and adds the splats. The sums
/// do not depend on threads, because batches are added in order. They do not depend on the range either, because
/// batches of different samples are not added together.
pub fn trace(
    job: &Job<'_>,
    tracer: &dyn LightTracer,
    workers: &[Mutex<CameraWorker>],
    tiles: &mut [Tile],
    samples: Range<u64>,
) -> u64 {
    let pixels = job.camera.film.full_area();
    let per_sample = pixels.div_ceil(BATCH);
    let margin = job.filter.radius();
    let trace_batch = |(sample, batch): (u64, u64)| {
        let mut out = Vec::new();
        if job.progress.is_interrupted() {
            return out;
        }
        let thread = rayon::current_thread_index().unwrap_or(0);
        let mut worker = workers[thread].lock().unwrap_or_else(PoisonError::into_inner);
        let first = batch * BATCH;
        let keys = (first..(first + BATCH).min(pixels)).map(|p| key(job, pixels, sample, p));
        let keys: Vec<SampleKey> = keys.collect();
        tracer.trace(job.scene, job.camera, margin, &keys, &mut worker.worker, &mut out);
        out
    };
    // Parts of the light paths of a sample: the splats of a part are added together.
    let parts = |sample: u64| {
        let first = (0..per_sample).step_by(AT_ONCE as usize);
        first.map(move |first| (sample, first..(first + AT_ONCE).min(per_sample)))
    };
    let parts: Vec<(u64, Range<u64>)> = samples.flat_map(parts).collect();
    let mut dropped = 0;
    for parts in parts.chunks((AT_ONCE / per_sample).max(1) as usize) {
        if job.progress.is_interrupted() {
            break;
        }
        let batches: Vec<(u64, u64)> =
            parts.iter().flat_map(|(s, part)| part.clone().map(|b| (*s, b))).collect();
        let mut splats: Vec<Vec<Splat>> = batches.into_par_iter().map(trace_batch).collect();
        for (sample, part) in parts {
            let rest = splats.split_off((part.end - part.start) as usize);
            dropped += add(job, tiles, job.settings.sampler.replicate(*sample) as usize, splats);
            splats = rest;
        }
    }
    dropped
}

/// Adds the splats of batches to the pixels within the filter's radius, in their order; returns the number of those
/// with invalid values. Rows of tiles are independent, so they are done in parallel.
pub fn add(job: &Job<'_>, tiles: &mut [Tile], replicate: usize, batches: Vec<Vec<Splat>>) -> u64 {
    let rect = job.camera.film.rect();
    let along = |start: u32, length: u32| (start + length).div_ceil(TILE) - start / TILE;
    let (columns, rows) = (along(rect.x, rect.width), along(rect.y, rect.height));
    let by_row = |splats: Vec<Splat>| {
        let mut by_row: Vec<Vec<Splat>> = vec![Vec::new(); rows as usize];
        let mut dropped = 0;
        for splat in splats {
            if !splat.value.is_valid() {
                dropped += 1;
                continue;
            }
            let pixels = within(job, splat.film.y, rect.y, rect.height);
            if let Some(last) = pixels.clone().last() {
                for row in pixels.start / TILE..=last / TILE {
                    by_row[(row - rect.y / TILE) as usize].push(splat);
                }
            }
        }
        (by_row, dropped)
    };
    let (batches, dropped): (Vec<Vec<Vec<Splat>>>, Vec<u64>) = batches.into_par_iter().map(by_row).unzip();
    tiles.par_chunks_mut(columns as usize).enumerate().for_each(|(row, tiles)| {
        let mut sums = RowSums::new(job, tiles);
        batches.iter().flat_map(|by_row| &by_row[row]).for_each(|splat| sums.add(splat));
        sums.finish(tiles, replicate);
    });
    dropped.into_iter().sum()
}

/// Returns the pixels along one axis for which the position `x` is within [−radius, radius) of the centre, as for
/// camera samples.
fn within(job: &Job<'_>, x: f64, start: u32, length: u32) -> Range<u32> {
    let radius = job.filter.radius();
    let low = ((x - radius - 0.5).floor() + 1.0).max(start.into()) as u32;
    let high = (x + radius - 0.5).floor().min(f64::from(start + length) - 1.0);
    if high < f64::from(low) { low..low } else { low..high as u32 + 1 }
}

/// The sums of splats in a row of tiles.
struct RowSums<'a> {
    job: &'a Job<'a>,
    top: u32,
    height: u32,
    /// For each pixel, row by row.
    sums: Vec<[f64; 3]>,
    /// The filter at the columns around a splat.
    across: Vec<f64>,
}

impl<'a> RowSums<'a> {
    fn new(job: &'a Job<'_>, tiles: &[Tile]) -> Self {
        let PixelRect { y: top, height, .. } = tiles[0].rect();
        let pixels = job.camera.film.rect().width as usize * height as usize;
        RowSums { job, top, height, sums: vec![[0.0; 3]; pixels], across: Vec::new() }
    }

    fn add(&mut self, splat: &Splat) {
        let RowSums { job, top, height, sums, across } = self;
        let rect = job.camera.film.rect();
        let along = |x: f64, pixel: u32| job.filter.along(x - (f64::from(pixel) + 0.5));
        let columns = within(job, splat.film.x, rect.x, rect.width);
        if columns.is_empty() {
            return;
        }
        across.clear();
        across.extend(columns.clone().map(|x| along(splat.film.x, x)));
        let value = splat.value.to_array().map(f64::from);
        for y in within(job, splat.film.y, *top, *height) {
            let down = along(splat.film.y, y);
            let first = (y - *top) as usize * rect.width as usize + (columns.start - rect.x) as usize;
            for (sums, across) in sums[first..].iter_mut().zip(&*across) {
                let factor = across * down;
                sums.iter_mut().zip(value).for_each(|(sum, value)| *sum += value * factor);
            }
        }
    }

    /// Adds the sums to the tiles.
    fn finish(&self, tiles: &mut [Tile], replicate: usize) {
        let rect = self.job.camera.film.rect();
        for tile in tiles {
            for i in 0..tile.pixel_count() {
                let (x, y) = tile.position(i);
                let sum = self.sums[(y - self.top) as usize * rect.width as usize + (x - rect.x) as usize];
                if sum != [0.0; 3] {
                    tile.splat(i, replicate, sum);
                }
            }
        }
    }
}

/// Returns the key of the light path for a pixel and a sample. All light paths of a half are one sequence.
fn key(job: &Job<'_>, pixels: u64, sample: u64, pixel: u64) -> SampleKey {
    SampleKey::of(job.settings.seed, 0, 0, (sample & 1) as u32, (sample >> 1) * pixels + pixel)
}
