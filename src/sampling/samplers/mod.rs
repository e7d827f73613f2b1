//! Samplers: point sets keyed by (seed, pixel, sample, dimension) and by nothing else.
//!
//! Every number is computed from a [`SampleKey`] and a [`Dimension`]; there is no state. Dimensions are drawn
//! for a whole wave at a time, in loops over plain integers that the compiler turns into SIMD.
//!
//! The samples of a pixel form two halves: sample `i` is point `i div 2` of half `i mod 2`, and the halves are
//! scrambled independently, so that their difference estimates the error of any sampler.

mod independent;
mod key;
mod kind;
mod sobol;
mod strata;
mod stratified;
#[cfg(test)]
mod tests;

pub use key::SampleKey;
pub use kind::SamplerKind;

use super::hash::combine;
use super::{Dimension, DomainSet};

/// A sampler with its parameters.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sampler {
    points: Points,
    /// Domains whose dimensions all have the value 1/2.
    held: DomainSet,
}

/// The point sets.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Points {
    Independent,
    Stratified { side: u32 },
    Sobol,
}

impl Sampler {
    /// The sampler of a kind for about `samples_per_pixel` samples (only strata depend on that number;
    /// `None` takes 8 × 8).
    pub fn new(kind: SamplerKind, samples_per_pixel: Option<u64>) -> Self {
        let points = match kind {
            SamplerKind::Independent => Points::Independent,
            SamplerKind::Sobol => Points::Sobol,
            SamplerKind::Stratified => {
                let per_half = samples_per_pixel.map_or(64, |n| n.div_ceil(2)).min(1 << 20);
                Points::Stratified { side: (per_half as f64).sqrt().floor().max(1.0) as u32 }
            }
        };
        Sampler { points, held: DomainSet::EMPTY }
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
            Points::Stratified { .. } => SamplerKind::Stratified,
            Points::Sobol => SamplerKind::Sobol,
        }
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
            Points::Stratified { side } => stratified::fill_1d(side, d, keys, out),
            Points::Sobol => sobol::fill_1d(d, keys, out),
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
            Points::Stratified { side } => stratified::fill_2d(side, d, keys, x, y),
            Points::Sobol => sobol::fill_2d(d, keys, x, y),
        }
    }
}
