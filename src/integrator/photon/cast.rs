//! Many light paths on many threads, and what they leave in an order that does not depend on threads.

use super::EmissionGuide;
use super::tracing::{Deposit, PhotonPaths};
use crate::integrator::preparation::Workers;
use crate::integrator::{Counters, Interrupt};
use crate::sampling::{SampleKey, Sampler};
use crate::scene::Scene;
use rayon::prelude::*;

/// Light paths of a batch.
const BATCH: u64 = 2048;
/// Batches that are traced before they are looked at, at most: enough work for many threads, little memory.
const AT_ONCE: u64 = 256;
/// A caller that asks for deposits gets none if so many paths have left none.
const GIVE_UP: u64 = 1 << 20;

/// Where light paths take their random numbers from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PathSequence {
    /// The render's seed.
    pub seed: u64,
    /// Sequences of different streams have nothing in common: a pilot is a stream of its own.
    pub stream: u32,
    /// Which of the independent sequences of the stream: that of a half of the samples, or of a replicate.
    pub number: u32,
    /// The index of the first path in the sequence.
    pub first: u64,
}

impl PathSequence {
    /// The key of the `i`-th path.
    pub fn key(&self, i: u64) -> SampleKey {
        // No camera path has these pixels.
        SampleKey::of(self.seed, u32::MAX, u32::MAX - self.stream, self.number, self.first + i)
    }
}

/// When there are enough light paths.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Until {
    /// The most paths.
    pub paths: u64,
    /// Enough of what they leave: no batch of paths begins after that, so there may be a little more.
    pub kept: Option<u64>,
}

/// What light paths have left.
#[derive(Clone, Debug)]
pub struct Cast<T> {
    /// What they left, in the order of the paths' batches.
    pub kept: Vec<T>,
    /// How many paths were emitted: the number to divide powers by.
    pub emitted: u64,
    /// How many deposits were dropped because they were not finite.
    pub invalid: u64,
    /// Rays, and the time for them.
    pub counters: Counters,
}

/// What is needed to trace light paths.
pub struct Caster<'a> {
    /// The scene.
    pub scene: &'a Scene,
    /// The sampler.
    pub sampler: Sampler,
    /// Where paths should begin; in proportion to the emitters' light without.
    pub guide: Option<&'a EmissionGuide>,
    /// The threads to work with.
    pub pool: &'a rayon::ThreadPool,
    /// Whether to stop early, with what there is.
    pub interrupt: &'a Interrupt,
    /// The time of all paths, if they share it.
    pub time: Option<f32>,
}

impl Caster<'_> {
    /// Traces the paths of a sequence until there are enough of them, and keeps what `keep` makes of their
    /// deposits and the indices of their paths, from 0. Where it is asked for deposits, it ends early if a million
    /// paths leave none. `emitted` says how many paths it took.
    pub fn cast<T: Send>(
        &self,
        paths: &PhotonPaths,
        sequence: PathSequence,
        until: Until,
        keep: impl Fn(&Deposit, u64) -> Option<T> + Sync,
    ) -> Cast<T> {
        let workers = Workers::new(self.pool, self.sampler, self.interrupt).at_time(self.time);
        let mut cast = Cast { kept: Vec::new(), emitted: 0, invalid: 0, counters: Counters::default() };
        let enough = |cast: &Cast<T>| {
            cast.emitted >= until.paths
                || until.kept.is_some_and(|n| cast.kept.len() as u64 >= n)
                // Only where deposits are asked for: a mean over a number of paths needs all of them.
                || (until.kept.is_some() && cast.emitted >= GIVE_UP && cast.kept.is_empty())
        };
        let mut round = 8;
        while !enough(&cast) && !self.interrupt.is_raised() {
            let ends = (1..=round).map(|b| (cast.emitted + b * BATCH).min(until.paths));
            let mut start = cast.emitted;
            let batches: Vec<_> = ends.map(|end| std::mem::replace(&mut start, end)..end).collect();
            let traced: Vec<(Vec<T>, u64)> = self.pool.install(|| {
                let trace = |batch: &std::ops::Range<u64>| {
                    if self.interrupt.is_raised() {
                        return (Vec::new(), 0);
                    }
                    let keys: Vec<SampleKey> = batch.clone().map(|i| sequence.key(i)).collect();
                    let mut deposits = Vec::new();
                    workers.with(|worker| paths.trace(self.scene, &keys, self.guide, worker, &mut deposits));
                    let all = deposits.len();
                    deposits.retain(|d| d.p.is_finite() && d.shading_power().is_valid());
                    let kept = deposits.iter().filter_map(|d| keep(d, batch.start + u64::from(d.path)));
                    (kept.collect(), (all - deposits.len()) as u64)
                };
                batches.par_iter().map(trace).collect()
            });
            // Batches may have been left unfinished.
            if self.interrupt.is_raised() {
                break;
            }
            for (batch, (kept, invalid)) in batches.iter().zip(traced) {
                if enough(&cast) {
                    break;
                }
                cast.kept.extend(kept);
                cast.invalid += invalid;
                cast.emitted = batch.end;
            }
            round = (2 * round).min(AT_ONCE);
        }
        cast.counters = workers.counters();
        cast
    }
}
