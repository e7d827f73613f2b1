//! Strata: grids of cells, random orders of them, and points in them.

use crate::sampling::hash::{mix, to_unit};

/// Cells of the unit square: `columns` along x, `rows` along y.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
pub struct Grid {
    pub columns: u32,
    pub rows: u32,
}

impl Grid {
    /// The largest number of points that a grid is made for.
    pub const MOST: u64 = 1 << 20;

    /// The grid for `count` points (1 to [`Grid::MOST`]): with exactly as many cells, if there is one that is at most twice
    /// as wide as high, else the nearly square one with the fewest cells too many.
    pub fn new(count: u64) -> Self {
        let count = count.clamp(1, Grid::MOST) as u32;
        let root = count.isqrt();
        let exact = (1..=root).rev().find(|rows| count.is_multiple_of(*rows) && count / rows <= 2 * rows);
        let rows = exact.unwrap_or(root);
        Grid { columns: count.div_ceil(rows), rows }
    }

    /// How many cells it has.
    pub fn cells(self) -> u32 {
        self.columns * self.rows
    }
}

/// Numbers that are computed at a time.
pub const LANES: usize = 16;
/// One number for each of some keys.
pub type Lanes = [u32; LANES];

/// The images of `i` under pseudo-random permutations of `0..n`, one for each seed. [Kensler 2013, listing 2]
#[inline(always)]
pub fn permute(i: &mut Lanes, n: u32, seeds: &Lanes) {
    let w = n.next_power_of_two() - 1;
    for (i, seed) in i.iter_mut().zip(seeds) {
        *i = permute_bits(*i, w, *seed);
    }
    // Walks along the cycle until it is back in the range.
    while i.iter().any(|&i| i >= n) {
        for (i, seed) in i.iter_mut().zip(seeds) {
            let next = permute_bits(*i, w, *seed);
            *i = if *i < n { *i } else { next };
        }
    }
    for (i, seed) in i.iter_mut().zip(seeds) {
        // Makes every image equally likely, however few the bits of `n` are.
        let turned = *i + ((u64::from(mix(*seed)) * u64::from(n)) >> 32) as u32;
        *i = if turned < n { turned } else { turned - n };
    }
}

/// A permutation of 0 to `w`, all of whose bits are ones.
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

/// `(cell + jitter) / cells` for fewer than 2^24 cells; rounding leaves it in its cell, and below 1.
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
