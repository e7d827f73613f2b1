//! Samplers: point sets keyed by (seed, pixel, sample, dimension) and by nothing else.
//!
//! Every number is computed from a [`SampleKey`] and a [`Dimension`]; there is no state. Dimensions are drawn
//! for a whole wave at a time, in loops over plain integers that the compiler turns into SIMD.
//!
//! The samples of a pixel form two halves: sample `i` is point `i div 2` of half `i mod 2`, and the halves are
//! scrambled independently, so that their difference estimates the error of any sampler.

mod halton;
mod independent;
mod key;
mod kind;
mod multijitter;
mod sobol;
mod strata;
mod stratified;
#[cfg(test)]
mod tests;
mod zsobol;

pub use key::{SHARED_REPLICATES, SampleKey};
pub use kind::SamplerKind;

use super::hash::combine;
use super::{Dimension, DomainSet};
use strata::Grid;

/// The samples of a pixel that a sampler is laid out for where nothing says how many there will be.
const PLANNED: u64 = 128;

/// A sampler with its parameters.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
pub struct Sampler {
    points: Points,
    /// Domains whose dimensions all have the value 1/2.
    held: DomainSet,
    /// How many replicates there are.
    replicates: u32,
}

/// The point sets; each has a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
enum Points {
    Independent,
    Stratified(Grid),
    Multijitter(Grid),
    Halton,
    Sobol,
    Zsobol {
        log2_count: u32,
    },
    /// The same Sobol points in every pixel. No pixel is worse than with Sobol points of its own, but neighbours err
    /// alike, so the error shows as structure instead of noise.
    Fixed,
}

impl Sampler {
    /// The sampler of a kind for about `samples_per_pixel` samples. Only strata and the Z-curve depend on that number;
    /// `None` takes 128. More or fewer may be drawn: [`SamplerKind::advice`] says what that means.
    pub fn new(kind: SamplerKind, samples_per_pixel: Option<u64>) -> Self {
        Sampler::with_replicates(kind, samples_per_pixel, 2)
    }

    /// As [`new`](Self::new), with so many replicates, a power of two, of what pixels share, instead of one for each
    /// half: sample `i` belongs to replicate `i mod n`.
    pub fn with_replicates(kind: SamplerKind, samples_per_pixel: Option<u64>, replicates: u32) -> Self {
        let per_half = samples_per_pixel.unwrap_or(PLANNED).div_ceil(2);
        let points = match kind {
            SamplerKind::Independent => Points::Independent,
            SamplerKind::Stratified => Points::Stratified(Grid::new(per_half)),
            SamplerKind::Multijitter => Points::Multijitter(Grid::new(per_half)),
            SamplerKind::Halton => Points::Halton,
            SamplerKind::Sobol => Points::Sobol,
            SamplerKind::Zsobol => {
                let most = 1 << zsobol::MOST_LOG2;
                Points::Zsobol { log2_count: per_half.clamp(1, most).next_power_of_two().ilog2() }
            }
            SamplerKind::Fixed => Points::Fixed,
        };
        Sampler { points, held: DomainSet::EMPTY, replicates }
    }

    /// The same sampler with all dimensions of these domains held at 1/2, so that the others alone vary.
    ///
    /// The picture is then another integral: a pinhole for the lens, the middle of the light for the emitters. With
    /// Russian roulette held, it is none at all.
    #[must_use]
    pub fn holding(self, held: DomainSet) -> Self {
        Sampler { held, ..self }
    }

    /// Its kind.
    pub fn kind(self) -> SamplerKind {
        match self.points {
            Points::Independent => SamplerKind::Independent,
            Points::Stratified(_) => SamplerKind::Stratified,
            Points::Multijitter(_) => SamplerKind::Multijitter,
            Points::Halton => SamplerKind::Halton,
            Points::Sobol => SamplerKind::Sobol,
            Points::Zsobol { .. } => SamplerKind::Zsobol,
            Points::Fixed => SamplerKind::Fixed,
        }
    }

    /// How many replicates there are of what pixels share: a power of two.
    #[inline]
    pub fn replicates(self) -> u32 {
        self.replicates
    }

    /// The replicate that a sample belongs to.
    #[inline]
    pub fn replicate(self, sample: u64) -> u32 {
        (sample % u64::from(self.replicates)) as u32
    }

    /// The key of sample `sample` of pixel (x, y), counted over the full image.
    #[inline]
    pub fn key(self, seed: u64, x: u32, y: u32, sample: u64) -> SampleKey {
        let key = match self.points {
            Points::Zsobol { log2_count } => zsobol::key(log2_count, seed, x, y, sample),
            // The same points in every pixel.
            Points::Fixed => SampleKey::new(seed, 0, 0, sample),
            _ => SampleKey::new(seed, x, y, sample),
        };
        key.in_replicate(self.replicate(sample))
    }

    /// Whether the dimension is held at 1/2.
    #[inline]
    fn holds(self, dimension: Dimension) -> bool {
        !self.held.is_empty() && self.held.contains(dimension.domain())
    }

    /// One number in [0, 1) for each key.
    ///
    /// # Panics
    /// If the slices differ in length.
    pub fn fill_1d(self, dimension: Dimension, keys: &[SampleKey], out: &mut [f32]) {
        assert_eq!(keys.len(), out.len());
        if self.holds(dimension) {
            return out.fill(0.5);
        }
        let d = combine(0x1d, dimension.word());
        match self.points {
            Points::Independent => independent::fill_1d(d, keys, out),
            Points::Stratified(grid) => stratified::fill_1d(grid, d, keys, out),
            Points::Multijitter(grid) => multijitter::fill_1d(grid, d, keys, out),
            Points::Halton => halton::fill_1d(d, keys, out),
            Points::Sobol | Points::Fixed => sobol::fill_1d(d, keys, out),
            Points::Zsobol { log2_count } => zsobol::fill_1d(log2_count, d, keys, out),
        }
    }

    /// A pair of numbers in [0, 1) for each key.
    ///
    /// # Panics
    /// If the slices differ in length.
    pub fn fill_2d(self, dimension: Dimension, keys: &[SampleKey], x: &mut [f32], y: &mut [f32]) {
        assert!(keys.len() == x.len() && keys.len() == y.len());
        if self.holds(dimension) {
            x.fill(0.5);
            return y.fill(0.5);
        }
        let d = combine(0x2d, dimension.word());
        match self.points {
            Points::Independent => independent::fill_2d(d, keys, x, y),
            Points::Stratified(grid) => stratified::fill_2d(grid, d, keys, x, y),
            Points::Multijitter(grid) => multijitter::fill_2d(grid, d, keys, x, y),
            Points::Halton => halton::fill_2d(d, keys, x, y),
            Points::Sobol | Points::Fixed => sobol::fill_2d(d, keys, x, y),
            Points::Zsobol { log2_count } => zsobol::fill_2d(log2_count, d, keys, x, y),
        }
    }
}
