//! The sums of a region of the film, for each replicate.

use super::PixelRect;
use crate::estimate::replicates::{BLOCK, ErrorSums, PixelBlock};
use crate::math::Sum;
use std::ops::Range;

/// Sums of the samples in a rectangle of pixels.
///
/// Sample `i` of a pixel belongs to replicate `i mod n` of n, which is even: the even replicates are one half of the
/// samples, the odd ones the other half. Sums are compensated ([`Sum`]). The result is bit-identical for any order of
/// the samples and any division into passes, ranges and merged parts.
#[derive(Clone, Debug)]
pub struct Tile {
    /// The region in the full image.
    pub rect: PixelRect,
    channels: usize,
    replicates: usize,
    /// For each pixel, replicate and channel.
    sums: Vec<Sum>,
    /// For each pixel and replicate.
    counts: Vec<u64>,
}

/// The mean of a channel over all samples, and its variance from the difference of the two halves.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Estimate {
    /// The mean over all samples.
    pub mean: f64,
    /// An unbiased estimate of the variance of the mean; `None` unless both halves have samples.
    pub variance: Option<f64>,
}

impl Tile {
    /// Creates an empty tile.
    pub fn new(rect: PixelRect, channels: usize, replicates: usize) -> Self {
        let pixels = rect.width as usize * rect.height as usize;
        Tile {
            rect,
            channels,
            replicates,
            sums: vec![Sum::default(); pixels * replicates * channels],
            counts: vec![0; pixels * replicates],
        }
    }

    /// Returns the pixels in the full image.
    #[inline]
    pub fn rect(&self) -> PixelRect {
        self.rect
    }

    /// Returns the number of replicates.
    pub fn replicates(&self) -> usize {
        self.replicates
    }

    /// Returns the number of pixels.
    pub fn pixel_count(&self) -> usize {
        self.rect.width as usize * self.rect.height as usize
    }

    /// Returns the position of pixel `i` in the full image.
    #[inline]
    pub fn position(&self, i: usize) -> (u32, u32) {
        let (x, y) = (i as u32 % self.rect.width, i as u32 / self.rect.width);
        (self.rect.x + x, self.rect.y + y)
    }

    /// Adds the next sample of a replicate to pixel `i`.
    #[inline]
    pub fn add(&mut self, i: usize, replicate: usize, values: &[f32]) {
        let start = (self.replicates * i + replicate) * self.channels;
        let sums = &mut self.sums[start..start + self.channels];
        for (sum, v) in sums.iter_mut().zip(values) {
            sum.add(f64::from(*v));
        }
        self.counts[self.replicates * i + replicate] += 1;
    }

    /// Adds to the sums of a replicate of pixel `i` without increasing its sample count.
    pub fn splat(&mut self, i: usize, replicate: usize, values: [f64; 3]) {
        let start = (self.replicates * i + replicate) * self.channels;
        for (sum, v) in self.sums[start..start + 3].iter_mut().zip(values) {
            sum.add(v);
        }
    }

    /// Adds the samples of another tile, whose region is a part of this one's.
    ///
    /// # Panics
    /// If its region is not inside, or the channels or the replicates differ.
    pub fn merge(&mut self, other: &Tile) {
        assert_eq!((self.channels, self.replicates), (other.channels, other.replicates));
        assert_eq!(self.rect.union(other.rect), self.rect);
        let width = other.rect.width as usize;
        for y in 0..other.rect.height {
            let row = (other.rect.y + y - self.rect.y) * self.rect.width + other.rect.x - self.rect.x;
            let rows = [row, y * other.rect.width].map(|start| start as usize..start as usize + width);
            let [own, others] = rows.clone().map(|row| scaled(row, self.replicates * self.channels));
            self.sums[own].iter_mut().zip(&other.sums[others]).for_each(|(sum, other)| sum.merge(*other));
            let [own, others] = rows.map(|row| scaled(row, self.replicates));
            self.counts[own].iter_mut().zip(&other.counts[others]).for_each(|(count, other)| *count += other);
        }
    }

    /// Returns the content for a file: the two components of every sum, then every count.
    pub fn to_bytes(&self) -> Vec<u8> {
        let sums = self.sums.iter().flat_map(|sum| sum.parts()).flat_map(f64::to_le_bytes);
        sums.chain(self.counts.iter().flat_map(|count| count.to_le_bytes())).collect()
    }

    /// Sets the content from the result of [`to_bytes`](Self::to_bytes). Returns false, without any change, if the
    /// length is wrong or a number is not finite.
    #[must_use]
    pub fn set_bytes(&mut self, bytes: &[u8]) -> bool {
        let (words, rest) = bytes.as_chunks::<8>();
        if !rest.is_empty() || words.len() != 2 * self.sums.len() + self.counts.len() {
            return false;
        }
        let (sums, counts) = words.split_at(2 * self.sums.len());
        let (sums, _) = sums.as_chunks::<2>();
        let sums: Vec<Sum> = sums.iter().map(|pair| Sum::from_parts(pair.map(f64::from_le_bytes))).collect();
        if !sums.iter().all(|sum| sum.parts().iter().all(|part| part.is_finite())) {
            return false;
        }
        self.sums = sums;
        self.counts = counts.iter().map(|count| u64::from_le_bytes(*count)).collect();
        true
    }

    /// Returns the number of samples of pixel `i`.
    pub fn count(&self, i: usize) -> u64 {
        self.counts_of(i).iter().sum()
    }

    /// Returns the number of samples of each replicate of pixel `i`.
    fn counts_of(&self, i: usize) -> &[u64] {
        &self.counts[self.replicates * i..][..self.replicates]
    }

    /// Returns the sum of a replicate of channel `c` of pixel `i`.
    fn sum(&self, i: usize, replicate: usize, c: usize) -> f64 {
        self.sums[(self.replicates * i + replicate) * self.channels + c].value()
    }

    /// Returns the mean of a replicate of channel `c` of pixel `i`; `None` without samples.
    pub fn replicate_mean(&self, i: usize, replicate: usize, c: usize) -> Option<f64> {
        let n = self.counts_of(i)[replicate];
        (n > 0).then(|| self.sum(i, replicate, c) / n as f64)
    }

    /// Returns the number of samples and the sum of a half of channel `c` of pixel `i`.
    fn half(&self, i: usize, half: usize, c: usize) -> (u64, f64) {
        let replicates = (half..self.replicates).step_by(2);
        let counts = self.counts_of(i);
        replicates.fold((0, 0.0), |(n, sum), r| (n + counts[r], sum + self.sum(i, r, c)))
    }

    /// Returns the mean and variance of channel `c` of pixel `i`; zero without samples.
    pub fn estimate(&self, i: usize, c: usize) -> Estimate {
        let [(n_a, a), (n_b, b)] = [0, 1].map(|half| self.half(i, half, c));
        let n = n_a + n_b;
        if n == 0 {
            return Estimate { mean: 0.0, variance: None };
        }
        let mean = (a + b) / n as f64;
        // The mean is w·A + (1 − w)·B. If variances are proportional to 1/n, the expected value of w(1 − w)(A − B)²
        // is its variance.
        let variance = (n_a > 0 && n_b > 0).then(|| {
            let w = n_a as f64 / n as f64;
            let difference = a / n_a as f64 - b / n_b as f64;
            w * (1.0 - w) * difference * difference
        });
        Estimate { mean, variance }
    }

    /// Returns whether both halves of a pixel have samples.
    pub fn has_replicates(&self) -> bool {
        (0..self.pixel_count()).any(|i| self.estimate(i, 0).variance.is_some())
    }

    /// Returns the mean and difference of the halves of channel `c` of pixel `i`; zero unless both halves have
    /// samples.
    ///
    /// The square of the difference is the variance of [`estimate`](Self::estimate); its sign shows which half is
    /// brighter.
    #[inline]
    pub fn halves(&self, i: usize, c: usize) -> [f64; 2] {
        let [(n_a, a), (n_b, b)] = [0, 1].map(|half| self.half(i, half, c));
        let [n_a, n_b] = [n_a as f64, n_b as f64];
        if n_a == 0.0 || n_b == 0.0 {
            return [0.0; 2];
        }
        let n = n_a + n_b;
        // √(w (1 − w)) with w = n_a / n.
        [(a + b) / n, (n_a * n_b).sqrt() / n * (a / n_a - b / n_b)]
    }

    /// Returns the error sums of the first three channels, from the replicates.
    pub fn error_sums(&self) -> ErrorSums {
        let (width, height) = (self.rect.width as usize, self.rect.height as usize);
        let mut sums = ErrorSums::new(self.replicates);
        for top in (0..height).step_by(BLOCK) {
            for left in (0..width).step_by(BLOCK) {
                let size = [BLOCK.min(width - left), BLOCK.min(height - top)];
                let mut block = PixelBlock::new(size[0], size[1], self.replicates);
                for y in top..top + size[1] {
                    for x in left..left + size[0] {
                        for c in 0..3 {
                            self.set_pixel(&mut block, y * width + x, [x - left, y - top], c);
                        }
                    }
                }
                sums.merge(&block.sums());
            }
        }
        sums
    }

    fn set_pixel(&self, block: &mut PixelBlock, i: usize, [x, y]: [usize; 2], c: usize) {
        let [mean, difference] = self.halves(i, c);
        block.set(x, y, c, [mean, difference]);
        if self.replicates > 2 {
            let each = self.count(i) as f64 / self.replicates as f64;
            for (r, &n) in self.counts_of(i).iter().enumerate() {
                let deviation = self.replicate_mean(i, r, c).map_or(0.0, |value| value - mean);
                block.set_deviation(x, y, c, r, (n as f64 / each).sqrt() * deviation);
            }
        }
    }

    /// Returns the sums of each replicate's mean over the pixels in a region of the tile, for the first three
    /// channels. Columns and rows are counted from the tile's corner. `None` if a pixel has no samples of the
    /// replicate.
    pub fn replicate_sums(&self, columns: Range<usize>, rows: Range<usize>) -> Vec<Option<[f64; 3]>> {
        let width = self.rect.width as usize;
        let pixels = || rows.clone().flat_map(|y| columns.clone().map(move |x| y * width + x));
        let sum = |r: usize| {
            let mut sum = [0.0; 3];
            for i in pixels() {
                for (c, sum) in sum.iter_mut().enumerate() {
                    *sum += self.replicate_mean(i, r, c)?;
                }
            }
            Some(sum)
        };
        (0..self.replicates).map(sum).collect()
    }

    /// Returns the bytes of the sums of one pixel.
    pub fn bytes_per_pixel(channels: usize, replicates: usize) -> usize {
        replicates * (channels * size_of::<Sum>() + size_of::<u64>())
    }

    /// Returns the bytes of the sums.
    pub fn memory_bytes(&self) -> usize {
        size_of_val(self.sums.as_slice()) + size_of_val(self.counts.as_slice())
    }
}

/// Returns the range of the elements of a range of pixels that have `each`.
fn scaled(pixels: Range<usize>, each: usize) -> Range<usize> {
    pixels.start * each..pixels.end * each
}

/// Returns an unbiased estimate of the variance of a mean of independent replicates; `None` for fewer than two.
pub fn variance_of_mean(replicates: impl Iterator<Item = f64> + Clone) -> Option<f64> {
    let k = replicates.clone().count() as f64;
    let mean = replicates.clone().sum::<f64>() / k;
    let squares = replicates.map(|value| (value - mean).powi(2)).sum::<f64>();
    (k > 1.0).then(|| squares / (k * (k - 1.0)))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pixel() -> Tile {
        Tile::new(PixelRect { x: 0, y: 0, width: 1, height: 1 }, 3, 2)
    }

    #[test]
    fn a_tile_takes_what_was_planned() {
        let tile = Tile::new(PixelRect { x: 3, y: 4, width: 16, height: 5 }, 7, 8);
        assert_eq!(tile.memory_bytes(), 80 * Tile::bytes_per_pixel(7, 8));
    }

    #[test]
    fn two_to_the_24_samples_do_not_stall() {
        let mut tile = pixel();
        for i in 0..(1usize << 24) + 1000 {
            tile.add(0, i & 1, &[1.1, 1.0, 1e-9]);
        }
        let mean = |c| tile.estimate(0, c).mean as f32;
        assert_eq!((mean(0), mean(1), mean(2)), (1.1, 1.0, 1e-9));
    }

    #[test]
    fn the_halves_difference_estimates_the_variance() {
        let mut tile = pixel();
        tile.add(0, 0, &[1.0; 3]);
        assert_eq!(tile.estimate(0, 0).variance, None);
        tile.add(0, 1, &[3.0; 3]);
        assert_eq!(tile.estimate(0, 0), Estimate { mean: 2.0, variance: Some(1.0) });
        assert_eq!(tile.halves(0, 0), [2.0, -1.0]);
        let estimate = tile.error_sums().estimate(2).expect("a pixel");
        assert!((estimate.relmse - 1.0 / 4.01).abs() < 1e-7, "{estimate:?}");
    }

    #[test]
    fn eight_replicates_estimate_the_variance_of_any_mean() {
        let rect = PixelRect { x: 0, y: 0, width: 2, height: 1 };
        let mut tile = Tile::new(rect, 3, 8);
        let values = [3.0, 1.0, 4.0, 1.0, 5.0, 9.0, 2.0, 6.0];
        for (r, v) in values.into_iter().enumerate() {
            tile.add(0, r, &[v; 3]);
            tile.add(1, r, &[2.0 * v; 3]);
        }
        let expected = variance_of_mean(values.into_iter().map(f64::from)).expect("eight of them");
        // Even replicates against odd ones.
        let Estimate { mean, variance } = tile.estimate(0, 1);
        assert!(
            (mean - 3.875).abs() < 1e-12
                && (variance.unwrap() - (0.5f64 * (3.5 - 4.25)).powi(2)).abs() < 1e-12
        );
        // The errors of both pixels are equal except for a factor, so the sum is three times the first.
        let sums = tile.replicate_sums(0..2, 0..1);
        let of_sum = variance_of_mean(sums.iter().flatten().map(|sum| sum[0])).expect("eight of them");
        assert!((of_sum - 9.0 * expected).abs() < 1e-9);
    }
}
