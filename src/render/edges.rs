//! More paths for pixels at the edges of emitters.
//!
//! A pixel that is partly covered by an emitter is far from its expected value until many camera rays have found how
//! much of it is covered, and no sampling of light paths helps. A sample of such a pixel is the mean of several paths,
//! each through a point of its own. The edges are found by rays through the centres of pixels, which no path depends
//! on, so the mean is unbiased.

use super::job::Job;
use super::tracing::CameraWorker;
use crate::film::PixelRect;
use crate::sampling::hash::{pcg3d, to_unit};
use std::sync::OnceLock;

/// The paths in addition to the first one of a sample.
const MORE: u32 = 8;
/// The greatest expected number of additional paths, as a fraction of the samples of the full image.
const MOST: f64 = 0.125;
/// The number of pixels, along each side of the full image, at which the fraction of edges is estimated.
const PROBES: u32 = 24;
/// Selects the random numbers of their positions.
const STREAM: u32 = 0x6564;
/// The least difference of radiance at an edge, relative to the brightest emitter that is found at those pixels.
const LEAST: f32 = 1.0 / 64.0;

/// The pixels at edges of emitters.
pub struct EmitterEdges {
    /// The paths in addition to the first one of each sample at an edge.
    more: u32,
    /// The least difference of radiance at an edge.
    least: f32,
    /// For each tile, whether its pixels are at an edge; empty if none is.
    tiles: Vec<OnceLock<Vec<bool>>>,
}

/// The pixels of a tile at edges of emitters.
#[derive(Clone, Copy, Default)]
pub struct TileEdges<'a> {
    more: u32,
    pixels: &'a [bool],
}

impl TileEdges<'_> {
    /// Returns the number of paths in addition to the first one of each sample of a pixel of the tile.
    pub fn more(&self, pixel: usize) -> u32 {
        if self.pixels.get(pixel) == Some(&true) { self.more } else { 0 }
    }
}

impl EmitterEdges {
    /// Estimates how many edges the image has, which limits the number of additional paths; `None` if there are none of
    /// these.
    pub fn new(job: &Job<'_>, tiles: usize, worker: &mut CameraWorker) -> Option<Self> {
        let has_shapes = job.scene.shapes.iter().any(|shape| shape.emitter.is_some());
        if !(has_shapes && job.integrator.shows_emitters() && !job.filter.has_weights()) {
            return None;
        }
        // Those of the full image, so that a crop has the same pixels.
        let [width, height] = [job.camera.film.width, job.camera.film.height];
        let reach = reach(job);
        let mut probes = Vec::new();
        for k in 0..PROBES * PROBES {
            let (column, row) = (k % PROBES, k / PROBES);
            let [u, v, _] = pcg3d(column, row, STREAM);
            let at = |k: u32, u: u32, length: u32| {
                (((k as f32 + to_unit(u)) / PROBES as f32 * length as f32) as u32).min(length - 1)
            };
            let (x, y) = (at(column, u, width), at(row, v, height));
            let (left, right) = (x.saturating_sub(reach), (x + reach).min(width - 1));
            let (top, bottom) = (y.saturating_sub(reach), (y + reach).min(height - 1));
            probes.extend([(x, y), (left, top), (right, top), (left, bottom), (right, bottom)]);
        }
        let radiance = worker.emitted(job, probes.into_iter());
        let least = LEAST * radiance.iter().copied().fold(0.0, f32::max);
        let edges = radiance.chunks_exact(5).filter(|probe| is_edge(probe.iter().copied(), least)).count();
        let fraction = edges as f64 / f64::from(PROBES * PROBES);
        let more = (0..=MORE.ilog2()).map(|k| MORE >> k).find(|more| f64::from(*more) * fraction <= MOST)?;
        Some(EmitterEdges { more, least, tiles: (0..tiles).map(|_| OnceLock::new()).collect() })
    }

    /// Returns the edges in a tile of the image.
    pub fn of_tile(
        &self,
        job: &Job<'_>,
        tile: usize,
        rect: PixelRect,
        worker: &mut CameraWorker,
    ) -> TileEdges<'_> {
        let pixels = self.tiles[tile].get_or_init(|| at_edges(job, rect, self.least, worker));
        TileEdges { more: self.more, pixels }
    }
}

/// Returns the greatest distance in pixels, along an axis, of the centres that count for a pixel.
fn reach(job: &Job<'_>) -> u32 {
    job.filter.radius().ceil() as u32
}

/// Returns whether radiances differ by more than `least`.
fn is_edge(radiance: impl Iterator<Item = f32>, least: f32) -> bool {
    let (low, high) = radiance.fold((f32::INFINITY, 0.0f32), |(low, high), r| (low.min(r), high.max(r)));
    high - low > least
}

/// Returns for each pixel of a region whether the emitted radiance differs at its centre and at those of the pixels
/// around it, up to the radius of the filter or at least one; nothing if that is so for no pixel.
fn at_edges(job: &Job<'_>, rect: PixelRect, least: f32, worker: &mut CameraWorker) -> Vec<bool> {
    let film = &job.camera.film;
    let reach = reach(job);
    let around = |first: u32, end: u32, length: u32| first.saturating_sub(reach)..(end + reach).min(length);
    let columns = around(rect.x, rect.x + rect.width, film.width);
    let rows = around(rect.y, rect.y + rect.height, film.height);
    let radiance = worker.emitted(job, rows.clone().flat_map(|y| columns.clone().map(move |x| (x, y))));
    if !is_edge(radiance.iter().copied(), least) {
        return Vec::new();
    }
    let index =
        |x: u32, y: u32| ((y - rows.start) * (columns.end - columns.start) + x - columns.start) as usize;
    let near = |x: u32, y: u32| {
        let columns = around(x, x + 1, film.width);
        around(y, y + 1, film.height).flat_map(move |y| columns.clone().map(move |x| (x, y)))
    };
    let pixels =
        (rect.y..rect.y + rect.height).flat_map(|y| (rect.x..rect.x + rect.width).map(move |x| (x, y)));
    pixels.map(|(x, y)| is_edge(near(x, y).map(|(x, y)| radiance[index(x, y)]), least)).collect()
}
