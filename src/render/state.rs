//! The state of a render from which it can continue.

use super::job::Rendered;
use super::passes::TILE;
use super::tracing::InvalidSample;
use crate::error::Result;
use crate::estimate::replicates::{ErrorEstimate, ErrorSums};
use crate::film::{PixelRect, Tile};
use crate::integrator::Counters;
use rayon::prelude::*;
use std::time::Duration;

/// A render that has taken the same samples in every pixel, or those determined by the rates of adaptive sampling.
#[derive(Clone, Debug)]
pub struct RenderState {
    /// The sums.
    pub tiles: Vec<Tile>,
    /// The index of the next sample.
    pub next: u64,
    /// The end of the current pass, at which stop rules are evaluated.
    pub pass_end: u64,
    /// Wall-clock time of sampling so far.
    pub elapsed: Duration,
    /// The counters so far.
    pub counters: Counters,
    /// The recorded dropped samples.
    pub invalid: Vec<InvalidSample>,
    /// The number of dropped samples.
    pub invalid_count: u64,
}

/// The receiver of a render's checkpoints.
#[derive(Clone, Copy)]
pub struct CheckpointSink<'a> {
    /// The time between two checkpoints.
    pub every: Duration,
    /// Saves a state. If it fails, the render tries again after the same time.
    pub keep: &'a (dyn Fn(&RenderState) -> Result<()> + Sync),
}

/// The receiver of the image so far.
#[derive(Clone, Copy)]
pub struct PreviewSink<'a> {
    /// The time between two images; `None`: only if one is requested ([`Progress::request_preview`]).
    ///
    /// [`Progress::request_preview`]: super::Progress::request_preview
    pub every: Option<Duration>,
    /// Takes the image, and whether it was requested. Sampling goes on when it returns.
    pub show: &'a (dyn Fn(&Rendered, bool) + Sync),
}

/// The receivers of a render's states.
#[derive(Clone, Copy, Default)]
pub struct Sinks<'a> {
    /// The receiver of checkpoints.
    pub checkpoints: Option<CheckpointSink<'a>>,
    /// The receiver of the image so far.
    pub previews: Option<PreviewSink<'a>>,
}

impl RenderState {
    /// Creates the state before the first sample, which has the given index.
    pub fn new(rect: PixelRect, channels: usize, replicates: usize, first: u64) -> Self {
        RenderState {
            tiles: rect.cells(TILE).map(|rect| Tile::new(rect, channels, replicates)).collect(),
            next: first,
            pass_end: first,
            elapsed: Duration::ZERO,
            counters: Counters::default(),
            invalid: Vec::new(),
            invalid_count: 0,
        }
    }

    /// Adds the samples of another part of the render: a range of them, a region of the image, or both.
    ///
    /// # Panics
    /// If the region is not inside, or the channels or the replicates differ.
    pub fn add(&mut self, part: RenderState) {
        // Both lists are in the order of the image, and a tile of the part is inside of one.
        let mut tiles = self.tiles.iter_mut().peekable();
        for other in &part.tiles {
            while tiles.next_if(|tile| !tile.rect.overlaps(other.rect)).is_some() {}
            tiles.peek_mut().expect("the region is inside").merge(other);
        }
        self.elapsed = self.elapsed.saturating_add(part.elapsed);
        self.counters.merge(&part.counters);
        self.invalid.extend(part.invalid);
        self.invalid.sort_by_key(|s| (s.y, s.x, s.sample));
        self.invalid_count = self.invalid_count.saturating_add(part.invalid_count);
    }
}

/// Estimates the error of an image. Sums are computed in the order of the tiles; `None` without samples in two
/// replicates. A bias that is known is part of the error.
pub fn estimate(
    tiles: &[Tile],
    pool: &rayon::ThreadPool,
    squared_bias: Option<f64>,
) -> Option<ErrorEstimate> {
    if !tiles.iter().any(Tile::has_replicates) {
        return None;
    }
    let parts: Vec<ErrorSums> = pool.install(|| tiles.par_iter().map(Tile::error_sums).collect());
    let mut sums = ErrorSums::new(tiles[0].replicates());
    parts.iter().for_each(|part| sums.merge(part));
    let filled = |r: &usize| tiles.iter().any(|tile| tile.replicate_mean(0, *r, 0).is_some());
    let estimate = sums.estimate((0..tiles[0].replicates()).filter(filled).count())?;
    Some(estimate.with_bias(squared_bias.unwrap_or(0.0)))
}
