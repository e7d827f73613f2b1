//! The first two dimensions of the Sobol sequence, shuffled and Owen-scrambled independently for every dimension and
//! pixel. [Burley 2020]
//!
//! Any 2^m consecutive points, starting at a multiple of 2^m, are a (0, m, 2)-net: every elementary interval of area
//! 2^−m has one point. Sampling may stop at any number of points; powers of two are best.

use super::SampleKey;
use crate::sampling::hash::{pcg3d, to_unit};

pub fn fill_1d(d: u32, keys: &[SampleKey], out: &mut [f32]) {
    for (key, u) in keys.iter().zip(out) {
        let seeds = seeds_1d(key.scramble ^ d);
        *u = to_unit(number(shuffle(key.index, seeds[0]), seeds[1]));
    }
}

pub fn fill_2d(d: u32, keys: &[SampleKey], x: &mut [f32], y: &mut [f32]) {
    for ((key, x), y) in keys.iter().zip(x).zip(y) {
        let seeds = seeds_2d(key.scramble ^ d);
        let h = pair(shuffle(key.index, seeds[0]), [seeds[1], seeds[2]]);
        (*x, *y) = (to_unit(h[0]), to_unit(h[1]));
    }
}

/// Returns the seeds of the shuffle and of the number.
#[inline(always)]
pub fn seeds_1d(seed: u32) -> [u32; 3] {
    pcg3d(seed, 0x68bc_21eb, 0x02e5_be93)
}

/// Returns the seeds of the shuffle and of the two numbers.
#[inline(always)]
pub fn seeds_2d(seed: u32) -> [u32; 3] {
    pcg3d(seed, 0x967a_889b, 0x368c_c8b7)
}

/// Returns point `index` of the first dimension, Owen-scrambled.
#[inline(always)]
pub fn number(index: u32, seed: u32) -> u32 {
    owen_reversed(index, seed).reverse_bits()
}

/// Returns point `index` of the first two dimensions, Owen-scrambled.
#[inline(always)]
pub fn pair(index: u32, seeds: [u32; 2]) -> [u32; 2] {
    [number(index, seeds[0]), number(pascal_reversed(index), seeds[1])]
}

/// Owen-scrambles `x` with its bits reversed: bit i of the result depends only on bits 0..=i of `x`. [Laine and
/// Karras 2011; constants of Vegdahl 2021]
#[inline(always)]
pub fn owen_reversed(mut x: u32, seed: u32) -> u32 {
    x ^= x.wrapping_mul(0x3d20_adea);
    x = x.wrapping_add(seed);
    x = x.wrapping_mul((seed >> 16) | 1);
    x ^= x.wrapping_mul(0x0552_6c56);
    x ^ x.wrapping_mul(0x53a2_2864)
}

/// Returns the second Sobol dimension of `index` with its bits reversed: the Pascal matrix modulo 2, applied in five
/// steps of the fast zeta transform.
#[inline(always)]
fn pascal_reversed(mut index: u32) -> u32 {
    index ^= (index & 0xaaaa_aaaa) >> 1;
    index ^= (index & 0xcccc_cccc) >> 2;
    index ^= (index & 0xf0f0_f0f0) >> 4;
    index ^= (index & 0xff00_ff00) >> 8;
    index ^ (index >> 16)
}

/// Permutes the points by nested uniform shuffling of the index. [Burley 2020, section 3.2]
#[inline(always)]
pub fn shuffle(index: u32, seed: u32) -> u32 {
    owen_reversed(index.reverse_bits(), seed).reverse_bits()
}
