//! Jittered sampling: one point at a random place in each cell of a grid (pairs), or in each of as many intervals (single
//! numbers), in random order. [Cook 1986]
//!
//! A half whose count is that of the cells fills each once. Past its count it goes on with a new, independently
//! jittered block.

use super::SampleKey;
use super::strata::{Grid, LANES, Lanes, in_cell, permute};
use crate::sampling::hash::{combine, pcg3d};

pub fn fill_1d(grid: Grid, d: u32, keys: &[SampleKey], out: &mut [f32]) {
    let n = grid.cells();
    for (keys, out) in keys.chunks(LANES).zip(out.chunks_mut(LANES)) {
        let (mut cells, blocks) = places(n, d, keys);
        permute(&mut cells, n, &blocks);
        for (i, (key, u)) in keys.iter().zip(out).enumerate() {
            *u = in_cell(cells[i], pcg3d(key.scramble, key.index, d)[0], n);
        }
    }
}

pub fn fill_2d(grid: Grid, d: u32, keys: &[SampleKey], x: &mut [f32], y: &mut [f32]) {
    let Grid { columns, rows } = grid;
    let n = grid.cells();
    for ((keys, x), y) in keys.chunks(LANES).zip(x.chunks_mut(LANES)).zip(y.chunks_mut(LANES)) {
        let (mut cells, blocks) = places(n, d, keys);
        permute(&mut cells, n, &blocks);
        for (i, ((key, x), y)) in keys.iter().zip(x).zip(y).enumerate() {
            let jitter = pcg3d(key.scramble, key.index, d);
            *x = in_cell(cells[i] % columns, jitter[0], columns);
            *y = in_cell(cells[i] / columns, jitter[1], rows);
        }
    }
}

/// The places of up to [`LANES`] keys in their blocks of `n` points, and the blocks' hashes.
#[inline(always)]
pub fn places(n: u32, d: u32, keys: &[SampleKey]) -> (Lanes, Lanes) {
    let (mut places, mut blocks) = ([0; LANES], [0; LANES]);
    for (i, key) in keys.iter().enumerate() {
        places[i] = key.index % n;
        blocks[i] = combine(key.scramble ^ d, key.index / n);
    }
    (places, blocks)
}
