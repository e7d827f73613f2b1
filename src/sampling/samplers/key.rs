//! What a sample is drawn by.

use crate::sampling::hash::combine;

/// How many replicates a render has whose pixels share noise: enough to tell how much they share.
pub const SHARED_REPLICATES: u32 = 8;

/// One sample of one pixel: the hash of (seed, pixel, half) and the index within the half.
///
/// The samples of a pixel are two halves: sample `i` is point `i div 2` of the sequence of half `i mod 2`, and the
/// halves are scrambled independently. What pixels share (caches, photons) there is once for each of several
/// replicates.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SampleKey {
    /// Hash of seed, pixel and half.
    pub scramble: u32,
    /// Index of the point within its half.
    pub index: u32,
    /// The replicate that the sample belongs to.
    pub replicate: u32,
}

impl SampleKey {
    /// The key of sample `sample` of pixel (x, y), counted over the full image, where the halves are the replicates.
    #[inline]
    pub fn new(seed: u64, x: u32, y: u32, sample: u64) -> Self {
        SampleKey::of(seed, x, y, (sample & 1) as u32, sample >> 1)
    }

    /// The key of point `index` of an independent sequence of pixel (x, y): of a half of its samples, or of a
    /// replicate.
    #[inline]
    pub fn of(seed: u64, x: u32, y: u32, sequence: u32, index: u64) -> Self {
        let h = combine(combine(seed as u32, (seed >> 32) as u32), x);
        // Indices past 2^32 begin a new, independently scrambled sequence.
        let beyond = ((index >> 32) as u32).wrapping_mul(SHARED_REPLICATES);
        let scramble = combine(combine(h, y), sequence.wrapping_add(beyond));
        SampleKey { scramble, index: index as u32, replicate: sequence }
    }

    /// The same key, as one of a replicate.
    #[inline]
    #[must_use]
    pub fn in_replicate(self, replicate: u32) -> Self {
        SampleKey { replicate, ..self }
    }
}
