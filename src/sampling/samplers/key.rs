//! What a sample is drawn by.

use crate::sampling::hash::combine;

/// One sample of one pixel: the hash of (seed, pixel, half) and the index within the half.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SampleKey {
    /// Hash of seed, pixel and half; its lowest bit is the half.
    pub scramble: u32,
    /// Index of the point within its half.
    pub index: u32,
}

impl SampleKey {
    /// The key of sample `sample` of pixel (x, y), counted over the full image.
    #[inline]
    pub fn new(seed: u64, x: u32, y: u32, sample: u64) -> Self {
        let half = (sample & 1) as u32;
        let index = sample >> 1;
        let h = combine(combine(seed as u32, (seed >> 32) as u32), x);
        // Indices past 2^32 begin a new, independently scrambled sequence.
        let h = combine(combine(h, y), half.wrapping_add(((index >> 32) as u32) << 1));
        SampleKey { scramble: h, index: index as u32 }.in_half(half)
    }

    /// The same key, marked as one of a half: 0 or 1.
    #[inline]
    #[must_use]
    pub fn in_half(self, half: u32) -> Self {
        SampleKey { scramble: self.scramble & !1 | half, ..self }
    }

    /// The half that the sample belongs to, 0 or 1: what estimates the error must not share anything between the two.
    #[inline]
    pub fn half(self) -> usize {
        (self.scramble & 1) as usize
    }
}
