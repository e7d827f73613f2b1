//! More paths for pixels at the edges of emitters.
//!
//! A pixel that is partly covered by a lamp is far from its expected value until many camera rays have found how much
//! of it is covered, and no sampling of light paths helps. A sample of such a pixel is the mean of several paths, each
//! through a point of its own. Rays through the centres of the pixels find the edges, so the paths do not depend on
//! them, and the mean stays unbiased.

use super::job::Job;
use super::tracing::CameraWorker;
use crate::film::PixelRect;
use std::sync::OnceLock;

/// The paths in addition to the first one of a sample.
const MORE: u32 = 8;
/// The greatest number of additional paths, as a fraction of the paths of the image.
const MOST: f64 = 0.125;
/// The greatest number of pixels, along each side of the image, at which the fraction of edges is estimated.
const PROBES: u32 = 24;

/// The pixels at edges of emitters.
pub struct EmitterEdges {
    /// The paths in addition to the first one of each sample at an edge.
    more: u32,
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
        let [columns, rows] = [width.min(PROBES), height.min(PROBES)];
        let mut edges = 0;
        for row in 0..rows {
            for column in 0..columns {
                let at = |k: u32, of: u32, length: u32| {
                    ((2 * k + 1) as u64 * length as u64 / (2 * of) as u64) as u32
                };
                let pixel = PixelRect {
                    x: at(column, columns, width),
                    y: at(row, rows, height),
                    width: 1,
                    height: 1,
                };
                edges += u32::from(at_edges(job, pixel, worker).contains(&true));
            }
        }
        let fraction = f64::from(edges) / (f64::from(columns) * f64::from(rows));
        let more = (0..=MORE.ilog2()).map(|k| MORE >> k).find(|more| f64::from(*more) * fraction <= MOST)?;
        Some(EmitterEdges { more, tiles: (0..tiles).map(|_| OnceLock::new()).collect() })
    }

    /// Returns the edges in a tile of the image.
    pub fn of_tile(
        &self,
        job: &Job<'_>,
        tile: usize,
        rect: PixelRect,
        worker: &mut CameraWorker,
    ) -> TileEdges<'_> {
        TileEdges { more: self.more, pixels: self.tiles[tile].get_or_init(|| at_edges(job, rect, worker)) }
    }
}

/// Returns for each pixel of a region whether the centres of the pixels from which its filter takes light differ in
/// whether they show an emitter; nothing if that is so for no pixel.
fn at_edges(job: &Job<'_>, rect: PixelRect, worker: &mut CameraWorker) -> Vec<bool> {
    let film = &job.camera.film;
    let reach = job.filter.radius().ceil() as u32;
    let around = |first: u32, end: u32, length: u32| first.saturating_sub(reach)..(end + reach).min(length);
    let columns = around(rect.x, rect.x + rect.width, film.width);
    let rows = around(rect.y, rect.y + rect.height, film.height);
    let emits = worker.see_emitters(job, rows.clone().flat_map(|y| columns.clone().map(move |x| (x, y))));
    if !emits.contains(&true) || !emits.contains(&false) {
        return Vec::new();
    }
    let is_edge = |x: u32, y: u32| {
        let index =
            |x: u32, y: u32| ((y - rows.start) * (columns.end - columns.start) + x - columns.start) as usize;
        let first = emits[index(x, y)];
        around(y, y + 1, film.height)
            .any(|y| around(x, x + 1, film.width).any(|x| emits[index(x, y)] != first))
    };
    let pixels =
        (rect.y..rect.y + rect.height).flat_map(|y| (rect.x..rect.x + rect.width).map(move |x| (x, y)));
    pixels.map(|(x, y)| is_edge(x, y)).collect()
}
