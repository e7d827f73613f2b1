//! Jittered sampling: blocks of `side`² points, one at a random place in each cell of a `side` × `side` grid (pairs) or in
//! each of `side`² intervals (single numbers), in random order.

use super::SampleKey;
use super::strata::{in_cell, permute};
use crate::sampling::hash::{combine, pcg3d};

pub fn fill_1d(side: u32, d: u32, keys: &[SampleKey], out: &mut [f32]) {
    for (key, u) in keys.iter().zip(out) {
        *u = number(*key, d, side);
    }
}

pub fn fill_2d(side: u32, d: u32, keys: &[SampleKey], x: &mut [f32], y: &mut [f32]) {
    for ((key, x), y) in keys.iter().zip(x).zip(y) {
        [*x, *y] = pair(*key, d, side);
    }
}

fn number(key: SampleKey, d: u32, side: u32) -> f32 {
    let n = side * side;
    let block = combine(key.scramble ^ d, key.index / n);
    in_cell(permute(key.index % n, n, block), pcg3d(key.scramble, key.index, d)[0], n)
}

fn pair(key: SampleKey, d: u32, side: u32) -> [f32; 2] {
    let n = side * side;
    let block = combine(key.scramble ^ d, key.index / n);
    let cell = permute(key.index % n, n, block);
    let jitter = pcg3d(key.scramble, key.index, d);
    [in_cell(cell % side, jitter[0], side), in_cell(cell / side, jitter[1], side)]
}
