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
const AT_ONCE: usize = 256;

/// Traces one light path for each pixel of the full image and each sample of the range, and adds the splats. The sums
/// do not depend on threads, because batches are added in order.
pub fn trace(
    job: &Job<'_>,
    tracer: &dyn LightTracer,
    workers: &[Mutex<CameraWorker>],
    tiles: &mut [Tile],
    samples: Range<u64>,
) -> u64 {
    let pixels = job.camera.film.full_area();
    let per_sample = pixels.div_ceil(BATCH);
    let batches: Vec<(u64, u64)> = samples.flat_map(|s| (0..per_sample).map(move |b| (s, b))).collect();
    let margin = job.filter.radius();
    let mut dropped = 0;
    for chunk in batches.chunks(AT_ONCE) {
        if job.progress.is_interrupted() {
            break;
        }
        let splats: Vec<Vec<Splat>> = chunk
            .par_iter()
            .map(|&(sample, batch)| {
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
            })
            .collect();
        let replicate = |&(sample, _): &(u64, u64)| job.settings.sampler.replicate(sample) as usize;
        let batches: Vec<(usize, Vec<Splat>)> = chunk.iter().map(replicate).zip(splats).collect();
        dropped += add(job, tiles, &batches);
    }
    dropped
}

/// Adds the splats of batches to the pixels within the filter's radius, in their order; returns the number of those
/// with invalid values. Each batch has a replicate. Rows of tiles are independent, so they are done in parallel.
pub fn add(job: &Job<'_>, tiles: &mut [Tile], batches: &[(usize, Vec<Splat>)]) -> u64 {
    let rect = job.camera.film.rect();
    let along = |start: u32, length: u32| (start + length).div_ceil(TILE) - start / TILE;
    let (columns, rows) = (along(rect.x, rect.width), along(rect.y, rect.height));
    let mut by_row: Vec<Vec<(usize, &Splat)>> = vec![Vec::new(); rows as usize];
    let mut dropped = 0;
    for (replicate, splats) in batches {
        for splat in splats {
            if !splat.value.is_valid() {
                dropped += 1;
                continue;
            }
            let pixels = within(job, splat.film.y, rect.y, rect.height);
            if let Some(last) = pixels.clone().last() {
                for row in pixels.start / TILE..=last / TILE {
                    by_row[(row - rect.y / TILE) as usize].push((*replicate, splat));
                }
            }
        }
    }
    tiles.par_chunks_mut(columns as usize).zip(by_row).for_each(|(tiles, splats)| {
        let mut across = Vec::new();
        for (replicate, splat) in splats {
            add_to_row(job, tiles, replicate, splat, &mut across);
        }
    });
    dropped
}

/// Returns the pixels along one axis for which the position `x` is within [−radius, radius) of the centre, as for
/// camera samples.
fn within(job: &Job<'_>, x: f64, start: u32, length: u32) -> Range<u32> {
    let radius = job.filter.radius();
    let low = ((x - radius - 0.5).floor() + 1.0).max(start.into()) as u32;
    let high = (x + radius - 0.5).floor().min(f64::from(start + length) - 1.0);
    if high < f64::from(low) { low..low } else { low..high as u32 + 1 }
}

/// Adds a splat to the pixels of a row of tiles. `across` is a buffer.
fn add_to_row(job: &Job<'_>, tiles: &mut [Tile], replicate: usize, splat: &Splat, across: &mut Vec<f64>) {
    let rect = job.camera.film.rect();
    let along = |x: f64, pixel: u32| job.filter.along(x - (f64::from(pixel) + 0.5));
    let columns = within(job, splat.film.x, rect.x, rect.width);
    across.clear();
    across.extend(columns.clone().map(|x| along(splat.film.x, x)));
    let PixelRect { y: top, height, .. } = tiles[0].rect();
    for y in within(job, splat.film.y, top, height) {
        let down = along(splat.film.y, y);
        for (x, across) in columns.clone().zip(&*across) {
            let tile = &mut tiles[(x / TILE - rect.x / TILE) as usize];
            let PixelRect { x: left, width, .. } = tile.rect();
            let pixel = ((y - top) * width + x - left) as usize;
            debug_assert_eq!(tile.position(pixel), (x, y));
            tile.splat(pixel, replicate, (splat.value * (across * down) as f32).to_array());
        }
    }
}

/// Returns the key of the light path for a pixel and a sample. All light paths of a half are one sequence.
fn key(job: &Job<'_>, pixels: u64, sample: u64, pixel: u64) -> SampleKey {
    SampleKey::of(job.settings.seed, 0, 0, (sample & 1) as u32, (sample >> 1) * pixels + pixel)
}
