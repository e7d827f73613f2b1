//! Adaptive sampling: more samples where the relative error is larger, without bias.
//!
//! A pilot takes the same number of samples in every pixel. Afterwards, the number of samples of a pixel depends on
//! the pilot's result in the pixels *around* it, but not on its own. With samplers that scramble every pixel
//! independently, a pixel's mean is therefore independent of its number of samples and remains unbiased. If pixels
//! reuse the paths of a cell, the whole cell has one number, which depends on the cells around it. The only other
//! dependence is through a factor common to all pixels, which makes the total meet the budget. One of N pixels
//! contributes 1/N to this factor.

use crate::estimate::metrics::RELATIVE_FLOOR;
use crate::film::{PixelRect, Tile};
use crate::integrator::path::groups::CellSide;

/// The greatest number of samples per pixel of a pilot.
const LONGEST_PILOT: u64 = 64;
/// The number for an unlimited total. It is small, because such a render may end early.
const UNLIMITED_PILOT: u64 = 16;
/// The least number of samples per pixel with which a pilot can estimate the noise.
const SHORTEST_PILOT: u64 = 4;
/// The reciprocal of the fraction of samples used by the pilot.
const PILOT_SHARE: u64 = 4;
/// The reciprocal of the least number of samples of a pixel relative to the average.
const LEAST_SHARE: u64 = 4;
/// The greatest number of samples of a pixel relative to the average.
const MOST_TIMES: u64 = 16;
/// The half width of the neighbourhood of a pixel in pixels, and of a cell in cells.
const RADIUS: usize = 4;
const CELL_RADIUS: usize = 1;
/// The number of noise levels for each factor of two.
const PER_OCTAVE: f64 = 64.0;
/// The number of noise levels, from 2^-32 to 2^32.
const LEVELS: usize = 4096;

/// The distribution of samples over the pixels.
#[derive(Clone, Debug)]
pub struct Allocation {
    rect: PixelRect,
    pilot: u64,
    /// For each pixel, the logarithm of the relative standard error of the surrounding pixels.
    levels: Vec<u16>,
    /// The number of pixels of each level.
    histogram: Vec<u64>,
    /// The number of samples of pixels of each level, before and after the current pass.
    counts: [Vec<u64>; 2],
}

/// Returns the samples per pixel of the pilot for the given total; `None` if the total is too small for a pilot.
pub fn pilot(samples: Option<u64>) -> Option<u64> {
    let pilot =
        samples.map_or(UNLIMITED_PILOT, |n| ((n / PILOT_SHARE) & !1).clamp(SHORTEST_PILOT, LONGEST_PILOT));
    samples.is_none_or(|n| n >= 2 * pilot).then_some(pilot)
}

impl Allocation {
    /// Creates the allocation from the sums of a pilot with the given number of samples per pixel. If paths are reused
    /// in cells, the pixels of a cell have the same number of samples.
    pub fn new(tiles: &[Tile], rect: PixelRect, pilot: u64, cells: Option<CellSide>) -> Self {
        let mut noise = Units::new(rect, cells.map_or(1, |side| side as u32));
        for tile in tiles {
            (0..tile.pixel_count()).for_each(|i| noise.add(tile.position(i), relative_square(tile, i)));
        }
        let around = noise.around(if cells.is_some() { CELL_RADIUS } else { RADIUS });
        let of_units: Vec<u16> = around.into_iter().map(level).collect();
        let positions = (0..rect.height).flat_map(|y| (0..rect.width).map(move |x| (rect.x + x, rect.y + y)));
        let levels: Vec<u16> = positions.map(|position| of_units[noise.index(position)]).collect();
        let histogram = histogram(&levels);
        Allocation { rect, pilot, levels, histogram, counts: [vec![pilot; LEVELS], vec![pilot; LEVELS]] }
    }

    /// Distributes the samples of a pass that increases the average to at most `average` samples per pixel.
    pub fn advance(&mut self, average: u64) {
        let budget = average.saturating_mul(self.levels.len() as u64);
        let [_, before] = std::mem::take(&mut self.counts);
        let count = |level: usize, shift: f64| self.count(level, shift, average).max(before[level]);
        let cost = |shift: f64| {
            let used = self.histogram.iter().enumerate().filter(|(_, pixels)| **pixels > 0);
            used.fold(0u64, |sum, (level, &pixels)| {
                sum.saturating_add(pixels.saturating_mul(count(level, shift)))
            })
        };
        // Bisection for the logarithm of the common factor; the cost is a non-decreasing function of it.
        let (mut low, mut high) = (-128.0, 128.0);
        for _ in 0..64 {
            let middle = 0.5 * (low + high);
            if cost(middle) <= budget { low = middle } else { high = middle }
        }
        let after = (0..LEVELS).map(|level| count(level, low)).collect();
        self.counts = [before, after];
    }

    /// Returns the number of samples of the pixels of a level for a common factor of 2^shift.
    fn count(&self, level: usize, shift: f64, average: u64) -> u64 {
        let wanted = ((level as f64 - LEVELS as f64 / 2.0) / PER_OCTAVE + shift).exp2();
        let least = self.pilot.max(average / LEAST_SHARE);
        in_steps((wanted as u64).clamp(least, least.max(average.saturating_mul(MOST_TIMES))))
    }

    /// Returns the samples per pixel of the pilot.
    pub fn pilot(&self) -> u64 {
        self.pilot
    }

    /// Returns the content for a file; see [`from_bytes`](Self::from_bytes).
    pub fn to_bytes(&self) -> Vec<u8> {
        let counts = self.counts[1].iter().flat_map(|n| n.to_le_bytes());
        counts.chain(self.levels.iter().flat_map(|n| n.to_le_bytes())).collect()
    }

    /// Returns the length of the result of [`to_bytes`](Self::to_bytes) for the given number of pixels.
    pub fn byte_count(pixels: u64) -> u64 {
        8 * LEVELS as u64 + 2 * pixels
    }

    /// Creates the allocation for a region of the image from the result of [`to_bytes`](Self::to_bytes), with the
    /// given samples per pixel of the pilot; `None` if the bytes are invalid.
    pub fn from_bytes(bytes: &[u8], rect: PixelRect, pilot: u64) -> Option<Self> {
        let (counts, levels) = bytes.split_at_checked(8 * LEVELS)?;
        let (counts, _) = counts.as_chunks::<8>();
        let (levels, rest) = levels.as_chunks::<2>();
        let counts: Vec<u64> = counts.iter().map(|n| u64::from_le_bytes(*n)).collect();
        let levels: Vec<u16> = levels.iter().map(|n| u16::from_le_bytes(*n)).collect();
        let of_the_part = rest.is_empty() && levels.len() as u64 == rect.area();
        let known = levels.iter().all(|&level| usize::from(level) < LEVELS);
        (of_the_part && known).then(|| Allocation {
            histogram: histogram(&levels),
            rect,
            pilot,
            levels,
            counts: [counts.clone(), counts],
        })
    }

    /// Returns the range of samples that the current pass takes in pixel (x, y) of the full image.
    #[inline]
    pub fn samples(&self, (x, y): (u32, u32)) -> std::ops::Range<u64> {
        let i = (y - self.rect.y) as usize * self.rect.width as usize + (x - self.rect.x) as usize;
        let level = usize::from(self.levels[i]);
        self.counts[0][level]..self.counts[1][level]
    }
}

/// Returns the number of pixels of each level.
fn histogram(levels: &[u16]) -> Vec<u64> {
    let mut histogram = vec![0; LEVELS];
    levels.iter().for_each(|&level| histogram[usize::from(level)] += 1);
    histogram
}

/// Returns the squared standard error of a pixel relative to its value.
fn relative_square(tile: &Tile, i: usize) -> f64 {
    let of_channel = |c| {
        let [mean, difference] = tile.halves(i, c);
        difference * difference / (mean * mean + RELATIVE_FLOOR)
    };
    (0..3).map(of_channel).sum()
}

/// The noise of the pixels of a region of the image, or of its cells of pixels.
struct Units {
    /// The side of a unit in pixels.
    side: u32,
    /// The first column and row of units.
    first: [u32; 2],
    columns: usize,
    rows: usize,
    /// For each unit, by rows, the sum of the squared relative errors of its pixels, and the number of pixels.
    sums: Vec<[f64; 2]>,
}

impl Units {
    fn new(rect: PixelRect, side: u32) -> Self {
        let first = [rect.x / side, rect.y / side];
        let columns = ((rect.x + rect.width).div_ceil(side) - first[0]) as usize;
        let rows = ((rect.y + rect.height).div_ceil(side) - first[1]) as usize;
        Units { side, first, columns, rows, sums: vec![[0.0; 2]; columns * rows] }
    }

    /// Returns the index of the unit that contains a pixel.
    fn index(&self, (x, y): (u32, u32)) -> usize {
        let [column, row] = [x / self.side - self.first[0], y / self.side - self.first[1]];
        row as usize * self.columns + column as usize
    }

    fn add(&mut self, position: (u32, u32), square: f64) {
        let index = self.index(position);
        let [squares, pixels] = &mut self.sums[index];
        *squares += square;
        *pixels += 1.0;
    }

    /// Returns for each unit the mean square over the pixels of the surrounding units, without the unit itself.
    fn around(&self, radius: usize) -> Vec<f64> {
        let Units { columns, rows, sums, .. } = self;
        let stride = columns + 1;
        // Summed-area tables.
        let mut table = vec![[0.0; 2]; stride * (rows + 1)];
        for y in 0..*rows {
            let mut row = [0.0; 2];
            for x in 0..*columns {
                let above = table[y * stride + x + 1];
                let here = &mut table[(y + 1) * stride + x + 1];
                for k in 0..2 {
                    row[k] += sums[y * columns + x][k];
                    here[k] = above[k] + row[k];
                }
            }
        }
        let mean = |(x, y): (usize, usize)| {
            let (top, bottom) = (y.saturating_sub(radius), (y + radius + 1).min(*rows));
            let (left, right) = (x.saturating_sub(radius), (x + radius + 1).min(*columns));
            let [squares, pixels] = [0, 1].map(|k| {
                let at = |y: usize, x: usize| table[y * stride + x][k];
                at(bottom, right) - at(bottom, left) - at(top, right) + at(top, left)
                    - sums[y * columns + x][k]
            });
            squares.max(0.0) / pixels.max(1.0)
        };
        (0..*rows).flat_map(|y| (0..*columns).map(move |x| (x, y))).map(mean).collect()
    }
}

/// Returns the level of a squared relative error.
fn level(square: f64) -> u16 {
    (0.5 * square.log2() * PER_OCTAVE + LEVELS as f64 / 2.0).clamp(0.0, LEVELS as f64 - 1.0) as u16
}

/// Returns the largest even number up to `n` whose half has at most three significant bits. Low-discrepancy sequences
/// are well distributed for such numbers.
fn in_steps(n: u64) -> u64 {
    let half = n / 2;
    let dropped = (u64::BITS - half.leading_zeros()).saturating_sub(3);
    2 * (half >> dropped << dropped)
}

#[cfg(test)]
mod tests {
    use super::*;

    const RECT: PixelRect = PixelRect { x: 5, y: 3, width: 40, height: 24 };

    /// Creates an allocation after a pilot whose halves differ by `noise` on a grey image.
    fn allocation(noise: impl Fn(u32, u32) -> f32) -> Allocation {
        let mut tile = Tile::new(RECT, 3, 2);
        for i in 0..tile.pixel_count() {
            let (x, y) = tile.position(i);
            for half in 0..2 {
                let sign = if half == 0 { 1.0 } else { -1.0 };
                (0..8).for_each(|_| tile.add(i, half, &[1.0 + sign * noise(x, y); 3]));
            }
        }
        Allocation::new(&[tile], RECT, 16, None)
    }

    fn counts(allocation: &Allocation) -> Vec<u64> {
        let pixels = (0..RECT.height).flat_map(|y| (0..RECT.width).map(move |x| (RECT.x + x, RECT.y + y)));
        pixels.map(|p| allocation.samples(p).end).collect()
    }

    #[test]
    fn counts_follow_the_noise_and_meet_the_budget() {
        let mut allocation = allocation(|x, y| if x < 20 { 0.02 } else { 0.1 } * (1.0 + 0.01 * y as f32));
        let mut last = vec![16; (RECT.width * RECT.height) as usize];
        for average in [32, 64, 128, 190, 1000] {
            allocation.advance(average);
            let now = counts(&allocation);
            let mean = now.iter().sum::<u64>() as f64 / now.len() as f64;
            assert!(mean <= average as f64 && mean > 0.9 * average as f64, "{mean} of {average}");
            assert!(now.iter().zip(&last).all(|(now, last)| now >= last));
            assert!(now.iter().all(|n| n % 2 == 0 && *n >= average / 4 / 5 * 4));
            last = now;
        }
        // Far from the border between both regions, five times the noise gives five times the samples.
        let ratio = last[30] as f64 / last[3] as f64;
        assert!((3.8..6.0).contains(&ratio), "{ratio}");
    }

    #[test]
    fn a_pixel_has_no_say_in_its_own_count() {
        let quiet = |x: u32, y: u32| 0.05 + 0.001 * ((x * 7 + y * 3) % 5) as f32;
        let mut first = allocation(quiet);
        let mut second = allocation(|x, y| if (x, y) == (25, 13) { 50.0 } else { quiet(x, y) });
        assert_eq!(first.levels[10 * 40 + 20], second.levels[10 * 40 + 20]);
        assert_ne!(first.levels[10 * 40 + 21], second.levels[10 * 40 + 21]);
        for allocation in [&mut first, &mut second] {
            allocation.advance(64);
        }
        assert!(second.samples((26, 13)).end > first.samples((26, 13)).end);
    }

    #[test]
    fn a_cell_has_one_count_and_no_say_in_it() {
        let levels = |noise: fn(u32, u32) -> f32, side| {
            let mut tile = Tile::new(RECT, 3, 2);
            for i in 0..tile.pixel_count() {
                let (x, y) = tile.position(i);
                (0..2).for_each(|half| tile.add(i, half, &[1.0 + half as f32 * noise(x, y); 3]));
            }
            Allocation::new(&[tile], RECT, 2, Some(side)).levels
        };
        for side in [CellSide::Four, CellSide::Eight] {
            // Cells are counted from the corner of the image, and the region begins inside of one.
            let cell =
                |i: usize| (i as u32 % 40 + 5) / side as u32 + 100 * ((i as u32 / 40 + 3) / side as u32);
            let quiet = levels(|x, y| 0.1 + 0.01 * (x + y) as f32, side);
            let loud =
                levels(|x, y| if (x, y) == (25, 13) { 9.0 } else { 0.1 + 0.01 * (x + y) as f32 }, side);
            let own = cell(10 * 40 + 20);
            for i in 0..quiet.len() {
                assert!((0..i).all(|j| cell(i) != cell(j) || quiet[i] == quiet[j]), "{side:?}, pixel {i}");
                assert!(cell(i) != own || quiet[i] == loud[i], "{side:?}, pixel {i}");
            }
            assert_ne!(quiet, loud);
        }
    }

    #[test]
    fn pilots_are_a_quarter_at_most() {
        assert_eq!(
            [4, 7, 8, 20, 64, 1000].map(|n| pilot(Some(n))),
            [None, None, Some(4), Some(4), Some(16), Some(64)]
        );
        assert_eq!(pilot(None), Some(16));
    }

    #[test]
    fn steps_are_even_with_few_significant_bits() {
        assert_eq!(
            [0, 1, 2, 15, 16, 17, 19, 63, 64, 100].map(in_steps),
            [0, 0, 2, 14, 16, 16, 16, 56, 64, 96]
        );
        assert!(in_steps(u64::MAX) > u64::MAX / 2);
    }

    #[test]
    fn no_noise_at_all_is_spread_evenly() {
        let mut allocation = allocation(|_, _| 0.0);
        allocation.advance(64);
        assert!(counts(&allocation).iter().all(|n| *n == 64));
    }
}
