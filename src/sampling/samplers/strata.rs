//! Strata: grids of cells, random permutations of them, and points in them.

use crate::sampling::hash::{mix, to_unit};

/// A grid of cells on the unit square: `columns` along x, `rows` along y.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
pub struct Grid {
    pub columns: u32,
    pub rows: u32,
}

impl Grid {
    /// The greatest number of points of a grid.
    pub const MAX_POINTS: u64 = 1 << 20;

    /// Creates the grid for `count` points (1 to [`Grid::MAX_POINTS`]). It has exactly `count` cells if there is such
    /// a grid that is at most twice as wide as high; otherwise it is the nearly square grid with the fewest
    /// additional cells.
    pub fn new(count: u64) -> Self {
        let count = count.clamp(1, Grid::MAX_POINTS) as u32;
        let root = count.isqrt();
        let exact = (1..=root).rev().find(|rows| count.is_multiple_of(*rows) && count / rows <= 2 * rows);
        let rows = exact.unwrap_or(root);
        Grid { columns: count.div_ceil(rows), rows }
    }

    /// Returns the number of cells.
    pub fn cells(self) -> u32 {
        self.columns * self.rows
    }
}

/// The number of values that are computed together.
pub const LANES: usize = 16;
/// One value for each of several keys.
pub type KeyLanes = [u32; LANES];

/// Permutes each `i` by a pseudo-random permutation of `0..n`, one for each seed. [Kensler 2013, listing 2]
#[inline(always)]
pub fn permute(i: &mut KeyLanes, n: u32, seeds: &KeyLanes) {
    let w = n.next_power_of_two() - 1;
    for (i, seed) in i.iter_mut().zip(seeds) {
        *i = permute_bits(*i, w, *seed);
    }
    // Follows the cycle until the value is in the range.
    while i.iter().any(|&i| i >= n) {
        for (i, seed) in i.iter_mut().zip(seeds) {
            let next = permute_bits(*i, w, *seed);
            *i = if *i < n { *i } else { next };
        }
    }
    for (i, seed) in i.iter_mut().zip(seeds) {
        // Makes all images equally likely, also if `n` has few bits.
        let turned = *i + ((u64::from(mix(*seed)) * u64::from(n)) >> 32) as u32;
        *i = if turned < n { turned } else { turned - n };
    }
}

/// Permutes 0 to `w`, where all bits of `w` are ones.
#[inline(always)]
fn permute_bits(mut i: u32, w: u32, seed: u32) -> u32 {
    i ^= seed;
    i = i.wrapping_mul(0xe170_893d);
    i ^= seed >> 16;
    i ^= (i & w) >> 4;
    i ^= seed >> 8;
    i = i.wrapping_mul(0x0929_eb3f);
    i ^= seed >> 23;
    i ^= (i & w) >> 1;
    i = i.wrapping_mul(1 | (seed >> 27));
    i = i.wrapping_mul(0x6935_fa69);
    i ^= (i & w) >> 11;
    i = i.wrapping_mul(0x74dc_b303);
    i ^= (i & w) >> 2;
    i = i.wrapping_mul(0x9e50_1cc3);
    i ^= (i & w) >> 2;
    i = i.wrapping_mul(0xc860_a3df);
    i &= w;
    i ^ (i >> 5)
}

/// Returns `(cell + jitter) / cells` for fewer than 2^24 cells. Rounding keeps the result in its cell and below 1.
#[inline(always)]
pub fn in_cell(cell: u32, jitter: u32, cells: u32) -> f32 {
    let below_next = f32::from_bits(((cell + 1) as f32).to_bits() - 1);
    let value = (cell as f32 + to_unit(jitter)).min(below_next) / cells as f32;
    value.min(1.0f32.next_down())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn grids_fit_their_count_where_one_can() {
        let grid = |count| {
            let Grid { columns, rows } = Grid::new(count);
            (columns, rows)
        };
        assert_eq!([1, 2, 3, 4, 5, 6].map(grid), [(1, 1), (2, 1), (3, 1), (2, 2), (3, 2), (3, 2)]);
        assert_eq!([8, 32, 35, 36, 50, 128].map(grid), [(4, 2), (8, 4), (7, 5), (6, 6), (10, 5), (16, 8)]);
        assert_eq!(
            [0, 31, 37, 1 << 20, 1 << 40].map(grid),
            [(1, 1), (7, 5), (7, 6), (1024, 1024), (1024, 1024)]
        );
        for count in 1..3000 {
            let grid = Grid::new(count);
            let excess = u64::from(grid.cells()) - count;
            assert!(excess <= u64::from(grid.rows) && grid.columns <= 3 * grid.rows, "{count}: {grid:?}");
        }
    }

    #[test]
    fn permutations_reach_every_number_once() {
        for n in [1, 2, 3, 7, 32, 1000] {
            for seed in [0, 1, 0xdead_beef, u32::MAX] {
                let starts = (0..n).step_by(LANES);
                let mut image: Vec<u32> = starts
                    .flat_map(|start| {
                        let mut lanes = std::array::from_fn(|k| (start + k as u32).min(n - 1));
                        permute(&mut lanes, n, &[seed; LANES]);
                        lanes.into_iter().take((n - start) as usize)
                    })
                    .collect();
                image.sort_unstable();
                assert!(image.into_iter().eq(0..n), "{n} {seed}");
            }
        }
    }
}
