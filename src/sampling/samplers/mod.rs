//! Samplers: point sets that depend only on (seed, pixel, sample, dimension).
//!
//! Every number is computed from a [`SampleKey`] and a [`Dimension`], without state. The numbers of a dimension are
//! drawn for a whole wave at a time, in integer loops that the compiler vectorises.
//!
//! The samples of a pixel form two halves: sample `i` is point `i div 2` of half `i mod 2`. The halves are scrambled
//! independently, so their difference estimates the error of any sampler.

mod halton;
mod independent;
mod key;
mod kind;
mod multijitter;
mod mutated;
mod sobol;
mod strata;
mod stratified;
#[cfg(test)]
mod tests;
mod zsobol;

pub use key::{SHARED_REPLICATES, SampleKey};
pub use kind::SamplerKind;
pub use mutated::STEPS as CHAIN_STEPS;

use super::hash::combine;
use super::{Dimension, DomainSet};
use strata::Grid;

/// The assumed number of samples per pixel if it is unknown.
const DEFAULT_COUNT: u64 = 128;

/// A sampler with its parameters.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
pub struct Sampler {
    points: PointSet,
    /// Domains whose dimensions all have the value 1/2.
    held: DomainSet,
    /// The number of replicates.
    replicates: u32,
}

/// The point sets; each has its own file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
enum PointSet {
    Independent,
    Stratified(Grid),
    Multijitter(Grid),
    Halton,
    Sobol,
    Zsobol {
        log2_count: u32,
    },
    /// The same Sobol points in every pixel. The error of a single pixel is not larger than with independent Sobol
    /// points, but the errors of neighbours are correlated, so they appear as structure instead of noise.
    Fixed,
    /// The states of Markov chains, for keys that name them.
    Mutated,
}

impl Sampler {
    /// Creates a sampler for about `samples_per_pixel` samples. Only strata and the Z-curve depend on that number;
    /// `None` selects 128. More or fewer samples may be drawn: [`SamplerKind::advice`] describes the effect.
    pub fn new(kind: SamplerKind, samples_per_pixel: Option<u64>) -> Self {
        Sampler::with_replicates(kind, samples_per_pixel, 2)
    }

    /// Creates a sampler as [`new`](Self::new) does, with the given number of replicates (a power of two) of shared
    /// data instead of one for each half. Sample `i` belongs to replicate `i mod n`.
    pub fn with_replicates(kind: SamplerKind, samples_per_pixel: Option<u64>, replicates: u32) -> Self {
        let per_half = samples_per_pixel.unwrap_or(DEFAULT_COUNT).div_ceil(2);
        let points = match kind {
            SamplerKind::Independent => PointSet::Independent,
            SamplerKind::Stratified => PointSet::Stratified(Grid::new(per_half)),
            SamplerKind::Multijitter => PointSet::Multijitter(Grid::new(per_half)),
            SamplerKind::Halton => PointSet::Halton,
            SamplerKind::Sobol => PointSet::Sobol,
            SamplerKind::Zsobol => {
                let most = 1 << zsobol::MAX_LOG2;
                PointSet::Zsobol { log2_count: per_half.clamp(1, most).next_power_of_two().ilog2() }
            }
            SamplerKind::Fixed => PointSet::Fixed,
        };
        Sampler { points, held: DomainSet::EMPTY, replicates }
    }

    /// Returns the sampler with all dimensions of the given domains fixed at 1/2, so that only the others vary.
    ///
    /// The image is then a different integral: for the lens that of a pinhole, for the emitters that of a centre
    /// point. With Russian roulette fixed, it is not a valid estimate.
    #[must_use]
    pub fn with_fixed(self, held: DomainSet) -> Self {
        Sampler { held, ..self }
    }

    /// Returns a sampler of the states of Markov chains. A key's index is the set of accepted steps, its scramble gives
    /// the start, and its replicate the chain.
    #[must_use]
    pub fn mutated(self) -> Self {
        Sampler { points: PointSet::Mutated, ..self }
    }

    /// Returns the kind.
    pub fn kind(self) -> SamplerKind {
        match self.points {
            PointSet::Independent | PointSet::Mutated => SamplerKind::Independent,
            PointSet::Stratified(_) => SamplerKind::Stratified,
            PointSet::Multijitter(_) => SamplerKind::Multijitter,
            PointSet::Halton => SamplerKind::Halton,
            PointSet::Sobol => SamplerKind::Sobol,
            PointSet::Zsobol { .. } => SamplerKind::Zsobol,
            PointSet::Fixed => SamplerKind::Fixed,
        }
    }

    /// Returns the number of replicates of shared data, a power of two.
    #[inline]
    pub fn replicates(self) -> u32 {
        self.replicates
    }

    /// Returns the replicate of a sample.
    #[inline]
    pub fn replicate(self, sample: u64) -> u32 {
        (sample % u64::from(self.replicates)) as u32
    }

    /// Returns the key of sample `sample` of pixel (x, y) in the full image.
    #[inline]
    pub fn key(self, seed: u64, x: u32, y: u32, sample: u64) -> SampleKey {
        let key = match self.points {
            PointSet::Zsobol { log2_count } => zsobol::key(log2_count, seed, x, y, sample),
            // The same points in every pixel.
            PointSet::Fixed => SampleKey::new(seed, 0, 0, sample),
            _ => SampleKey::new(seed, x, y, sample),
        };
        key.in_replicate(self.replicate(sample))
    }

    /// Returns the key of one of `count` samples into which a sample is split for all that follows. The split samples
    /// of a pixel are stratified together, except with `zsobol`, where they are independent. With more than
    /// 2^32 / `count` points in a half, the same numbers return.
    #[inline]
    pub fn split(self, key: SampleKey, count: u32, number: u32) -> SampleKey {
        match self.points {
            PointSet::Zsobol { .. } if number > 0 => {
                SampleKey { scramble: combine(combine(key.scramble, count), number), ..key }
            }
            PointSet::Zsobol { .. } => key,
            _ => SampleKey { index: key.index.wrapping_mul(count).wrapping_add(number), ..key },
        }
    }

    /// Returns whether the dimension is held at 1/2.
    #[inline]
    fn is_fixed(self, dimension: Dimension) -> bool {
        !self.held.is_empty() && self.held.contains(dimension.domain())
    }

    /// Draws one number in [0, 1) for each key.
    ///
    /// # Panics
    /// If the slices differ in length.
    pub fn fill_1d(self, dimension: Dimension, keys: &[SampleKey], out: &mut [f32]) {
        assert_eq!(keys.len(), out.len());
        if self.is_fixed(dimension) {
            return out.fill(0.5);
        }
        let d = combine(0x1d, dimension.word());
        match self.points {
            PointSet::Independent => independent::fill_1d(d, keys, out),
            PointSet::Stratified(grid) => stratified::fill_1d(grid, d, keys, out),
            PointSet::Multijitter(grid) => multijitter::fill_1d(grid, d, keys, out),
            PointSet::Halton => halton::fill_1d(d, keys, out),
            PointSet::Sobol | PointSet::Fixed => sobol::fill_1d(d, keys, out),
            PointSet::Zsobol { log2_count } => zsobol::fill_1d(log2_count, d, keys, out),
            PointSet::Mutated => mutated::fill_1d(d, keys, out),
        }
    }

    /// Draws a pair of numbers in [0, 1) for each key.
    ///
    /// # Panics
    /// If the slices differ in length.
    pub fn fill_2d(self, dimension: Dimension, keys: &[SampleKey], x: &mut [f32], y: &mut [f32]) {
        assert!(keys.len() == x.len() && keys.len() == y.len());
        if self.is_fixed(dimension) {
            x.fill(0.5);
            return y.fill(0.5);
        }
        let d = combine(0x2d, dimension.word());
        match self.points {
            PointSet::Independent => independent::fill_2d(d, keys, x, y),
            PointSet::Stratified(grid) => stratified::fill_2d(grid, d, keys, x, y),
            PointSet::Multijitter(grid) => multijitter::fill_2d(grid, d, keys, x, y),
            PointSet::Halton => halton::fill_2d(d, keys, x, y),
            PointSet::Sobol | PointSet::Fixed => sobol::fill_2d(d, keys, x, y),
            PointSet::Zsobol { log2_count } => zsobol::fill_2d(log2_count, d, keys, x, y),
            PointSet::Mutated => mutated::fill_2d(d, keys, x, y),
        }
    }
}
