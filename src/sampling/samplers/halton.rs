//! The first two dimensions of the Halton sequence (bases 2 and 3), shuffled and Owen-scrambled independently for
//! every dimension and pixel. [Halton 1960; Owen 1995]
//!
//! Any 6^k consecutive points, starting at a multiple of 6^k, are distributed evenly over boxes of 2^−a by 3^−b for
//! a, b ≤ k. Sampling may stop at any number of points. The best numbers are those for which each half has 6^k points
//! or a small multiple of that (12, 72, 144, 432 samples per pixel). After 6^6 points of a half, a new, independently
//! scrambled sequence starts. Single numbers use base 2.
//!
//! Every pair uses the bases 2 and 3, as [`sobol`](super::sobol) uses the same two dimensions for every pair.
//! Different bases for every dimension (5 and 7 for the next pair, and so on) have up to 23 % more relMSE up to 72
//! samples per pixel, and about the same at 256 (docs/samplers.md), because large bases need many points.

use super::SampleKey;
use super::sobol;
use super::strata::{KeyLanes, LANES, in_cell};
use crate::sampling::hash::{pcg3d, to_unit};

pub fn fill_1d(d: u32, keys: &[SampleKey], out: &mut [f32]) {
    sobol::fill_1d(d, keys, out);
}

pub fn fill_2d(d: u32, keys: &[SampleKey], x: &mut [f32], y: &mut [f32]) {
    for ((keys, x), y) in keys.chunks(LANES).zip(x.chunks_mut(LANES)).zip(y.chunks_mut(LANES)) {
        let (mut index, mut seeds) = ([0; LANES], [[0; LANES]; 3]);
        for (i, key) in keys.iter().enumerate() {
            index[i] = key.index % BLOCK;
            [seeds[0][i], seeds[1][i], seeds[2][i]] = pcg3d(key.scramble ^ d, key.index / BLOCK, 0x3c6e_f372);
        }
        shuffle(&mut index, seeds[0]);
        let ternary = ternary(index, seeds[2]);
        for (i, (x, y)) in x.iter_mut().zip(y).enumerate() {
            *x = to_unit(sobol::number(index[i], seeds[1][i]));
            *y = ternary[i];
        }
    }
}

/// The number of base-6 digits of a point's index.
const DIGITS: u32 = 6;
/// The number of points in a sequence: 46 656.
const BLOCK: u32 = 6u32.pow(DIGITS);
/// The number of base-3 digits that distinguish these points.
const TERNARY_DIGITS: u32 = 10;

/// Combines a digit with the hash of the preceding digits.
#[inline(always)]
fn descend(h: u32, digit: u32) -> u32 {
    let h = (h ^ digit.wrapping_mul(0x9e37_79b9)).wrapping_mul(0x21f0_aaad);
    h ^ (h >> 15)
}

/// Permutes `digit` by one of the permutations of 0..3, which are the affine maps modulo 3.
#[inline(always)]
fn permute3(digit: u32, random: u32) -> u32 {
    let shift = ((random >> 16) * 3) >> 16;
    let t = digit + (digit & (random >> 15 & 1).wrapping_neg()) + shift;
    // t mod 3 for t ≤ 6.
    t - 3 * ((t * 11) >> 5)
}

/// Nested uniform shuffling of indices below [`BLOCK`]. Each base-6 digit consists of a base-2 and a base-3 digit,
/// which are permuted at random depending on all preceding digits. Blocks of 6^k consecutive indices are preserved.
#[inline(always)]
fn shuffle(index: &mut KeyLanes, mut h: KeyLanes) {
    let (mut rest, mut power) = (*index, BLOCK);
    *index = [0; LANES];
    for _ in 0..DIGITS {
        let half = power / 2;
        power /= 6;
        for i in 0..LANES {
            let digit = u32::from(rest[i] >= half);
            rest[i] -= digit * half;
            let shuffled = index[i] * 2 + (digit ^ (h[i] >> 31));
            h[i] = descend(h[i], digit + 1);
            let digit = u32::from(rest[i] >= power) + u32::from(rest[i] >= 2 * power);
            rest[i] -= digit * power;
            index[i] = shuffled * 3 + permute3(digit, h[i]);
            h[i] = descend(h[i], digit + 1);
        }
    }
}

/// Returns the Owen-scrambled radical inverse in base 3; digits beyond those of the index are random.
#[inline(always)]
fn ternary(mut rest: KeyLanes, mut h: KeyLanes) -> [f32; LANES] {
    let mut value = [0; LANES];
    for _ in 0..TERNARY_DIGITS {
        for i in 0..LANES {
            // rest / 3 for rest < 2^16.
            let next = (rest[i] * 0xaaab) >> 17;
            let digit = rest[i] - 3 * next;
            rest[i] = next;
            value[i] = value[i] * 3 + permute3(digit, h[i]);
            h[i] = descend(h[i], digit + 1);
        }
    }
    std::array::from_fn(|i| in_cell(value[i], h[i], 3u32.pow(TERNARY_DIGITS)))
}
