//! The same Sobol points in every pixel.
//!
//! No pixel is worse than with [`sobol`](super::sobol), but neighbours err alike, so the error shows as structure instead of
//! noise. The two halves are scrambled independently as ever, so each pixel's estimate of its error is right on average
//! over seeds; but where all pixels err alike, so do their estimates, and averaging them over the image gains nothing.

use super::SampleKey;

/// The key of a sample, whatever the pixel.
pub fn key(seed: u64, sample: u64) -> SampleKey {
    SampleKey::new(seed, 0, 0, sample)
}
