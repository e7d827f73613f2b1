//! The light paths of a pass: traced in batches, and added to the film in the order of the batches.

use super::job::Job;
use super::passes::TILE;
use super::tracing::CameraWorker;
use crate::film::{PixelRect, Tile};
use crate::integrator::{Ptracer, Splat};
use crate::math::DVec2;
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
    ptracer: &Ptracer,
    workers: &[Mutex<CameraWorker>],
    tiles: &mut [Tile],
    samples: Range<u64>,
) -> u64 {
    let film = &job.camera.film;
    let pixels = u64::from(film.width) * u64::from(film.height);
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
                ptracer.trace(job.scene, job.camera, margin, &keys, &mut worker.worker, &mut out);
                out
            })
            .collect();
        for (&(sample, _), splats) in chunk.iter().zip(&splats) {
            let replicate = job.settings.sampler.replicate(sample) as usize;
            for splat in splats {
                dropped += u64::from(!add(job, tiles, replicate, splat));
            }
        }
    }
    dropped
}

/// Returns the key of the light path for a pixel and a sample. All light paths of a half are one sequence.
fn key(job: &Job<'_>, pixels: u64, sample: u64, pixel: u64) -> SampleKey {
    SampleKey::of(job.settings.seed, 0, 0, (sample & 1) as u32, (sample >> 1) * pixels + pixel)
}

/// Adds a splat to the pixels within the filter's radius; returns false if its value is invalid.
fn add(job: &Job<'_>, tiles: &mut [Tile], replicate: usize, splat: &Splat) -> bool {
    if !splat.value.is_valid() {
        return false;
    }
    let rect = job.camera.film.rect();
    let radius = job.filter.radius();
    // The pixels for which the position is within [−radius, radius) of the centre, as for camera samples.
    let range = |x: f64, start: u32, length: u32| {
        let low = ((x - radius - 0.5).floor() + 1.0).max(start.into()) as u32;
        let high = (x + radius - 0.5).floor().min(f64::from(start + length) - 1.0);
        if high < f64::from(low) { low..low } else { low..high as u32 + 1 }
    };
    for y in range(splat.film.y, rect.y, rect.height) {
        for x in range(splat.film.x, rect.x, rect.width) {
            let offset = splat.film - DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5);
            let weight = job.filter.eval(offset);
            let (tile, pixel) = place(rect, x, y);
            let tile = &mut tiles[tile];
            debug_assert_eq!(tile.position(pixel), (x, y));
            tile.splat(pixel, replicate, (splat.value * weight).to_array());
        }
    }
    true
}

/// Returns the index of the tile that contains a pixel of the image, and of the pixel in it.
fn place(rect: PixelRect, x: u32, y: u32) -> (usize, usize) {
    let (x, y) = (x - rect.x, y - rect.y);
    let (column, row) = (x / TILE, y / TILE);
    let width = TILE.min(rect.width - column * TILE);
    let tile = row as usize * rect.width.div_ceil(TILE) as usize + column as usize;
    (tile, ((y % TILE) * width + x % TILE) as usize)
}
