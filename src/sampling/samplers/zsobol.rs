//! One Sobol sequence over the whole image, along a shuffled Z-curve, which distributes the error as blue noise.
//! [Ahmed and Wonka 2020]
//!
//! A pixel owns 2^m consecutive points of the sequence. A square of four pixels owns 4·2^m, a square of sixteen
//! 16·2^m, and so on. These are stratified together, so their errors cancel: the error of a pixel is as large as with
//! [`sobol`](super::sobol), but that of an average over neighbours is smaller than for independent pixels.
//!
//! The sampler needs 2^m samples for each half, so a power of two in total. With fewer samples, the cancellation is
//! partly lost. After that number each pixel continues with a new, independently scrambled sequence, which has blue
//! noise too.
//!
//! The halves are independent, so the error estimate of each pixel is valid. The errors of neighbours are correlated,
//! so the error of an average over pixels is smaller than the estimates of the pixels suggest.

use super::SampleKey;
use super::sobol;
use crate::sampling::hash::{combine, pcg3d, to_unit};

/// The greatest number of samples of a pixel in one sequence, as a power of two.
pub const MAX_LOG2: u32 = 16;

/// Returns the key of a sample of pixel (x, y): the index of the pixel on the Z-curve, followed by the index of the
/// sample in the pixel.
///
/// Bits beyond 32 select an independently scrambled sequence, for samples beyond 2^`log2_count` and for parts of an
/// image with more than 2^(32 − `log2_count`) pixels.
#[inline]
pub fn key(log2_count: u32, seed: u64, x: u32, y: u32, sample: u64) -> SampleKey {
    let half = (sample & 1) as u32;
    let index = sample >> 1;
    let z = spread_bits(x) | spread_bits(y) << 1;
    let within = index as u32 & ((1 << log2_count) - 1);
    let (block, part) = (index >> log2_count, z >> pixel_bits(log2_count));
    let mut h = combine(seed as u32, (seed >> 32) as u32);
    for word in [half, block as u32, (block >> 32) as u32, part as u32, (part >> 32) as u32] {
        h = combine(h, word);
    }
    // An odd highest bit is unused.
    let pixel = z & ((1 << pixel_bits(log2_count)) - 1);
    SampleKey { scramble: h, index: (pixel << log2_count) as u32 | within, replicate: half }
}

/// Returns the number of an index's bits for the pixel: the greatest even number that fits.
#[inline(always)]
fn pixel_bits(log2_count: u32) -> u32 {
    (32 - log2_count) & !1
}

/// Moves the bits of `v` to the even positions.
#[inline(always)]
fn spread_bits(v: u32) -> u64 {
    let mut v = u64::from(v);
    v = (v | v << 16) & 0x0000_ffff_0000_ffff;
    v = (v | v << 8) & 0x00ff_00ff_00ff_00ff;
    v = (v | v << 4) & 0x0f0f_0f0f_0f0f_0f0f;
    v = (v | v << 2) & 0x3333_3333_3333_3333;
    (v | v << 1) & 0x5555_5555_5555_5555
}

pub fn fill_1d(log2_count: u32, d: u32, keys: &[SampleKey], out: &mut [f32]) {
    let quarter_bits = quarter_bits(log2_count);
    for (key, u) in keys.iter().zip(out) {
        let seeds = sobol::seeds_1d(key.scramble ^ d);
        *u = to_unit(sobol::number(shuffle(quarter_bits, key.index, seeds[0]), seeds[1]));
    }
}

pub fn fill_2d(log2_count: u32, d: u32, keys: &[SampleKey], x: &mut [f32], y: &mut [f32]) {
    let quarter_bits = quarter_bits(log2_count);
    for ((key, x), y) in keys.iter().zip(x).zip(y) {
        let seeds = sobol::seeds_2d(key.scramble ^ d);
        let h = sobol::pair(shuffle(quarter_bits, key.index, seeds[0]), [seeds[1], seeds[2]]);
        (*x, *y) = (to_unit(h[0]), to_unit(h[1]));
    }
}

/// Returns a mask of the higher bit of each base-4 digit that selects a quarter of a square of pixels, in an index
/// with reversed bits; the lower bit is the next one.
fn quarter_bits(log2_count: u32) -> u32 {
    (0x5555_5555 << (log2_count & 1)) & (u32::MAX >> log2_count)
}

/// Nested uniform shuffling of the index: in base 4 along the curve, so that the four quarters of a square have one
/// of their 24 orders, and in base 2 within the pixel.
///
/// A permutation of 0..4 is an affine map of pairs of bits. Flips and the shear of the lower bit result from
/// shuffling in base 2. The other shears are applied here, with random bits that depend on the preceding digits.
#[inline(always)]
fn shuffle(quarter_bits: u32, index: u32, seed: u32) -> u32 {
    let seeds = pcg3d(seed, 0x4f1b_bcdc, 0xbfa5_3e0a);
    let i = sobol::owen_reversed(index.reverse_bits(), seeds[0]);
    let random = [seeds[1], seeds[2]].map(|seed| (sobol::owen_reversed(i, seed) ^ i) & quarter_bits);
    let i = i ^ ((i >> 1) & random[0]);
    let i = i ^ ((i & random[1]) << 1);
    i.reverse_bits()
}
