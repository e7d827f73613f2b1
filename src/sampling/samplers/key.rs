//! The key of a sample, which determines its random numbers.

use crate::sampling::hash::combine;

/// The number of replicates of a render whose pixels share noise; it is large enough to estimate the shared noise.
pub const SHARED_REPLICATES: u32 = 8;

/// The key of one sample of one pixel: the hash of (seed, pixel, half) and the index within the half.
///
/// The samples of a pixel form two halves: sample `i` is point `i div 2` of the sequence of half `i mod 2`. The
/// halves are scrambled independently. Data that pixels share (caches, photons) exists once for each replicate.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct SampleKey {
    /// Hash of seed, pixel and half.
    pub scramble: u32,
    /// Index of the point within its half.
    pub index: u32,
    /// The replicate of the sample.
    pub replicate: u32,
}

/// Selects the random numbers of the other sequence of a pixel.
const BESIDE: u32 = 0xed6e;

impl SampleKey {
    /// Returns the key of sample `sample` of pixel (x, y) in the full image, with the halves as replicates.
    #[inline]
    pub fn new(seed: u64, x: u32, y: u32, sample: u64) -> Self {
        SampleKey::of(seed, x, y, (sample & 1) as u32, sample >> 1)
    }

    /// Returns the key of point `index` of an independent sequence of pixel (x, y), which belongs to a half of its
    /// samples or to a replicate.
    #[inline]
    pub fn of(seed: u64, x: u32, y: u32, sequence: u32, index: u64) -> Self {
        let h = combine(combine(seed as u32, (seed >> 32) as u32), x);
        // Each range of 2^32 indices has a new, independently scrambled sequence.
        let beyond = ((index >> 32) as u32).wrapping_mul(SHARED_REPLICATES);
        let scramble = combine(combine(h, y), sequence.wrapping_add(beyond));
        SampleKey { scramble, index: index as u32, replicate: sequence }
    }

    /// Returns the same key in another replicate.
    #[inline]
    #[must_use]
    pub fn in_replicate(self, replicate: u32) -> Self {
        SampleKey { replicate, ..self }
    }

    /// Returns the key of the same point of another sequence of the same pixel and replicate. It is independent.
    #[inline]
    #[must_use]
    pub fn beside(self) -> Self {
        SampleKey { scramble: combine(self.scramble, BESIDE), ..self }
    }
}
