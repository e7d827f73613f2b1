//! What a render has at a moment from which it can go on.

use super::adaptive::Allocation;
use super::passes::tiles_of;
use super::tracing::InvalidSample;
use crate::error::Result;
use crate::estimate::replicates::{ErrorEstimate, ErrorSums};
use crate::film::{PixelRect, Tile};
use crate::integrator::Counters;
use rayon::prelude::*;
use std::time::Duration;

/// A render that has taken the same samples of every pixel, or those that adaptive sampling gives it.
#[derive(Clone, Debug)]
pub struct State {
    /// The sums.
    pub tiles: Vec<Tile>,
    /// The index of the sample that comes next.
    pub next: u64,
    /// Where the pass in hand ends: stop rules are looked at there.
    pub pass_end: u64,
    /// Wall time of sampling so far.
    pub elapsed: Duration,
    /// Counts so far.
    pub counters: Counters,
    /// Dropped samples that are remembered.
    pub invalid: Vec<InvalidSample>,
    /// How many samples were dropped.
    pub invalid_count: u64,
    /// How adaptive sampling spreads the samples, once it does.
    pub allocation: Option<Allocation>,
}

/// Who is given the states of a render, to keep them.
#[derive(Clone, Copy)]
pub struct Keeper<'a> {
    /// How much time may be lost.
    pub every: Duration,
    /// Takes a state; of one that could not be kept, the render tries again after the same time.
    pub keep: &'a (dyn Fn(&State) -> Result<()> + Sync),
}

impl State {
    /// Before the first sample, whose index is given, of a part of the image with so many channels and replicates.
    pub fn new(rect: PixelRect, channels: usize, replicates: usize, first: u64) -> Self {
        State {
            tiles: tiles_of(rect).map(|rect| Tile::new(rect, channels, replicates)).collect(),
            next: first,
            pass_end: first,
            elapsed: Duration::ZERO,
            counters: Counters::default(),
            invalid: Vec::new(),
            invalid_count: 0,
            allocation: None,
        }
    }
}

/// Estimates the error of an image, summed in the order of the tiles; `None` without samples in two replicates.
pub fn estimate(tiles: &[Tile], pool: &rayon::ThreadPool) -> Option<ErrorEstimate> {
    if !tiles.iter().any(Tile::has_replicates) {
        return None;
    }
    let parts: Vec<ErrorSums> = pool.install(|| tiles.par_iter().map(Tile::error_sums).collect());
    let mut sums = ErrorSums::new(tiles[0].replicates());
    parts.iter().for_each(|part| sums.merge(part));
    let filled = |r: &usize| tiles.iter().any(|tile| tile.replicate_mean(0, *r, 0).is_some());
    sums.estimate((0..tiles[0].replicates()).filter(filled).count())
}
