//! Correlated multi-jittered sampling. [Kensler 2013]
//!
//! As in [`stratified`](super::stratified), each cell has one of the n points of a block. In addition, each of the n
//! intervals of x, and of y, has one point: the positions within the cells of a column are shuffled in the same way
//! for all columns, and likewise for rows.

use super::SampleKey;
use super::strata::{Grid, LANES, in_cell, permute};
use super::stratified::{self, block_indices};
use crate::sampling::hash::pcg3d;

pub fn fill_1d(grid: Grid, d: u32, keys: &[SampleKey], out: &mut [f32]) {
    stratified::fill_1d(grid, d, keys, out);
}

pub fn fill_2d(grid: Grid, d: u32, keys: &[SampleKey], x: &mut [f32], y: &mut [f32]) {
    let Grid { columns, rows } = grid;
    let n = grid.cells();
    for ((keys, x), y) in keys.chunks(LANES).zip(x.chunks_mut(LANES)).zip(y.chunks_mut(LANES)) {
        let (mut cells, blocks) = block_indices(n, d, keys);
        let mut seeds = [[0; LANES]; 3];
        for (i, block) in blocks.iter().enumerate() {
            [seeds[0][i], seeds[1][i], seeds[2][i]] = pcg3d(*block, 0x51a3_9c07, 0x8d2f_64e5);
        }
        permute(&mut cells, n, &seeds[0]);
        let (column, row) = (cells.map(|cell| cell % columns), cells.map(|cell| cell / columns));
        // [Kensler 2013, listing 4]
        let (mut within_x, mut within_y) = (row, column);
        permute(&mut within_x, rows, &seeds[1]);
        permute(&mut within_y, columns, &seeds[2]);
        for (i, ((key, x), y)) in keys.iter().zip(x).zip(y).enumerate() {
            let jitter = pcg3d(key.scramble, key.index, d);
            *x = in_cell(column[i] * rows + within_x[i], jitter[0], n);
            *y = in_cell(row[i] * columns + within_y[i], jitter[1], n);
        }
    }
}
