//! Jittered sampling: one random point in each cell of a grid (pairs), or in each of as many intervals (single
//! numbers), in random order. [Cook 1986]
//!
//! A half with as many samples as cells has one in each. Further samples use a new, independently jittered block.

use super::SampleKey;
use super::strata::{Grid, KeyLanes, LANES, in_cell, permute};
use crate::sampling::hash::{combine, pcg3d};

pub fn fill_1d(grid: Grid, d: u32, keys: &[SampleKey], out: &mut [f32]) {
    let n = grid.cells();
    for (keys, out) in keys.chunks(LANES).zip(out.chunks_mut(LANES)) {
        let (mut cells, blocks) = block_indices(n, d, keys);
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
        let (mut cells, blocks) = block_indices(n, d, keys);
        permute(&mut cells, n, &blocks);
        for (i, ((key, x), y)) in keys.iter().zip(x).zip(y).enumerate() {
            let jitter = pcg3d(key.scramble, key.index, d);
            *x = in_cell(cells[i] % columns, jitter[0], columns);
            *y = in_cell(cells[i] / columns, jitter[1], rows);
        }
    }
}

/// Returns the indices of up to [`LANES`] keys in their blocks of `n` points, and the hashes of the blocks.
#[inline(always)]
pub fn block_indices(n: u32, d: u32, keys: &[SampleKey]) -> (KeyLanes, KeyLanes) {
    let (mut block_indices, mut blocks) = ([0; LANES], [0; LANES]);
    for (i, key) in keys.iter().enumerate() {
        block_indices[i] = key.index % n;
        blocks[i] = combine(key.scramble ^ d, key.index / n);
    }
    (block_indices, blocks)
}
