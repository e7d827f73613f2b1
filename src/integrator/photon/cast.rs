//! Parallel photon tracing with results in an order that does not depend on threads.

use super::EmissionGuide;
use super::tracing::{Deposit, PhotonPaths};
use crate::integrator::preparation::Workers;
use crate::integrator::{Counters, Interrupt};
use crate::sampling::{SampleKey, Sampler};
use crate::scene::Scene;
use rayon::prelude::*;

/// The number of light paths in a batch.
const BATCH: u64 = 2048;
/// The greatest number of batches between two checks for completion. It gives enough work to many threads and limits
/// memory.
const AT_ONCE: u64 = 256;
/// If the caller limits the number of deposits, tracing stops after this number of paths without any.
const GIVE_UP: u64 = 1 << 20;

/// The sequence of random numbers of light paths.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PathSequence {
    /// The render's seed.
    pub seed: u64,
    /// Different streams are independent. A pilot has its own stream.
    pub stream: u32,
    /// The index of the independent sequence in the stream: that of a half of the samples, or of a replicate.
    pub number: u32,
    /// The index of the first path in the sequence.
    pub first: u64,
}

impl PathSequence {
    /// Returns the key of path `i`.
    pub fn key(&self, i: u64) -> SampleKey {
        // Camera paths never have these pixel coordinates.
        SampleKey::of(self.seed, u32::MAX, u32::MAX - self.stream, self.number, self.first + i)
    }
}

/// The termination criterion.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PathLimit {
    /// The greatest number of paths.
    pub paths: u64,
    /// The number of deposits after which no further batch starts. The result may have a few more.
    pub kept: Option<u64>,
}

/// The result of tracing light paths.
#[derive(Clone, Debug)]
pub struct TracedPaths<T> {
    /// The deposits kept, in the order of the paths' batches.
    pub kept: Vec<T>,
    /// The number of emitted paths, by which powers are to be divided.
    pub emitted: u64,
    /// The number of deposits dropped because they were not finite.
    pub invalid: u64,
    /// The counts of rays and their times.
    pub counters: Counters,
}

/// The input of photon tracing.
pub struct LightPathTracer<'a> {
    /// The scene.
    pub scene: &'a Scene,
    /// The sampler.
    pub sampler: Sampler,
    /// The density for starting paths; without one, it is proportional to the emitters' power.
    pub guide: Option<&'a EmissionGuide>,
    /// The threads to use.
    pub pool: &'a rayon::ThreadPool,
    /// A request to stop early, with a partial result.
    pub interrupt: &'a Interrupt,
    /// The time of all paths, if it is shared.
    pub time: Option<f32>,
}

impl LightPathTracer<'_> {
    /// Traces the paths of a sequence until the termination criterion holds. `keep` converts a deposit and the index
    /// of its path, counted from 0, to a result. If the number of deposits is limited, tracing ends early after about
    /// a million paths without any. The result's `emitted` is the number of paths traced.
    pub fn cast<T: Send>(
        &self,
        paths: &PhotonPaths,
        sequence: PathSequence,
        until: PathLimit,
        keep: impl Fn(&Deposit, u64) -> Option<T> + Sync,
    ) -> TracedPaths<T> {
        let workers = Workers::new(self.pool, self.sampler, self.interrupt).at_time(self.time);
        let mut cast =
            TracedPaths { kept: Vec::new(), emitted: 0, invalid: 0, counters: Counters::default() };
        let enough = |cast: &TracedPaths<T>| {
            cast.emitted >= until.paths
                || until.kept.is_some_and(|n| cast.kept.len() as u64 >= n)
                // Only if deposits are limited: a mean over a given number of paths needs all of them.
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
            // Some batches may be incomplete.
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
