//! One Sobol sequence over the whole screen, along a Z-curve whose order is shuffled: the error becomes blue noise.
//! [Ahmed and Wonka 2020]
//!
//! A pixel owns 2^m neighbours of the sequence; so do a square of four pixels, of sixteen, and so on, own four and sixteen
//! times as many. As these are stratified together, their errors cancel: the error of a pixel is as large as with
//! [`sobol`](super::sobol), but that of an average over neighbours is smaller than independent pixels would have.
//!
//! It needs 2^m samples for each half, so a power of two for both. Fewer are a part of them, the cancellation is then
//! partly lost; past its count each pixel goes on with a new, independently scrambled sequence, also of blue noise.
//!
//! The halves are independent, so every pixel's estimate of its error holds. As errors of neighbours are not independent, the
//! error of an average over pixels is smaller than those of the pixels suggest.

use super::SampleKey;
use super::sobol;
use crate::sampling::hash::{combine, pcg3d, to_unit};

/// The most samples of a pixel that belong to one sequence, as a power of two.
pub const MOST_LOG2: u32 = 16;

/// The key of a sample of pixel (x, y): the pixel's place on the Z-curve, followed by the sample's place in the pixel.
///
/// What does not fit into 32 bits chooses an independently scrambled sequence: the samples past 2^`log2_count`, and parts of
/// the screen of more than 2^(32 − `log2_count`) pixels.
#[inline]
pub fn key(log2_count: u32, seed: u64, x: u32, y: u32, sample: u64) -> SampleKey {
    let half = (sample & 1) as u32;
    let index = sample >> 1;
    let z = spread(x) | spread(y) << 1;
    let within = index as u32 & ((1 << log2_count) - 1);
    let (block, part) = (index >> log2_count, z >> pixel_bits(log2_count));
    let mut h = combine(seed as u32, (seed >> 32) as u32);
    for word in [half, block as u32, (block >> 32) as u32, part as u32, (part >> 32) as u32] {
        h = combine(h, word);
    }
    // An odd bit at the top is not used.
    let pixel = z & ((1 << pixel_bits(log2_count)) - 1);
    SampleKey { scramble: h, index: (pixel << log2_count) as u32 | within, replicate: half }
}

/// How many bits of an index are the pixel's: an even number, as many as there is room for.
#[inline(always)]
fn pixel_bits(log2_count: u32) -> u32 {
    (32 - log2_count) & !1
}

/// The bits of `v` at the even places.
#[inline(always)]
fn spread(v: u32) -> u64 {
    let mut v = u64::from(v);
    v = (v | v << 16) & 0x0000_ffff_0000_ffff;
    v = (v | v << 8) & 0x00ff_00ff_00ff_00ff;
    v = (v | v << 4) & 0x0f0f_0f0f_0f0f_0f0f;
    v = (v | v << 2) & 0x3333_3333_3333_3333;
    (v | v << 1) & 0x5555_5555_5555_5555
}

pub fn fill_1d(log2_count: u32, d: u32, keys: &[SampleKey], out: &mut [f32]) {
    let squares = squares(log2_count);
    for (key, u) in keys.iter().zip(out) {
        let seeds = sobol::seeds_1d(key.scramble ^ d);
        *u = to_unit(sobol::number(shuffle(squares, key.index, seeds[0]), seeds[1]));
    }
}

pub fn fill_2d(log2_count: u32, d: u32, keys: &[SampleKey], x: &mut [f32], y: &mut [f32]) {
    let squares = squares(log2_count);
    for ((key, x), y) in keys.iter().zip(x).zip(y) {
        let seeds = sobol::seeds_2d(key.scramble ^ d);
        let h = sobol::pair(shuffle(squares, key.index, seeds[0]), [seeds[1], seeds[2]]);
        (*x, *y) = (to_unit(h[0]), to_unit(h[1]));
    }
}

/// The higher bit of each digit in base 4 that chooses a quarter of a square of pixels, in an index whose bits are
/// reversed; its lower bit is the next.
fn squares(log2_count: u32) -> u32 {
    (0x5555_5555 << (log2_count & 1)) & (u32::MAX >> log2_count)
}

/// Nested uniform shuffling of the index: in base 4 along the curve, so that the four quarters of a square come in any of
/// their 24 orders, and in base 2 within the pixel.
///
/// A permutation of 0..4 is an affine map of pairs of bits. Flips and the shear of the lower bit come from shuffling in
/// base 2, the other shears here, from random bits that depend on the digits before them.
#[inline(always)]
fn shuffle(squares: u32, index: u32, seed: u32) -> u32 {
    let seeds = pcg3d(seed, 0x4f1b_bcdc, 0xbfa5_3e0a);
    let i = sobol::owen_reversed(index.reverse_bits(), seeds[0]);
    let random = [seeds[1], seeds[2]].map(|seed| (sobol::owen_reversed(i, seed) ^ i) & squares);
    let i = i ^ ((i >> 1) & random[0]);
    let i = i ^ ((i & random[1]) << 1);
    i.reverse_bits()
}
