//! The sums of a part of the film, kept in two halves.

use super::PixelRect;
use crate::estimate::replicates::{BLOCK, Block, ErrorSums};
use crate::math::Sum;

/// Sums of the samples of a rectangle of pixels.
///
/// Sample `i` of a pixel belongs to half `i mod 2`. Sums are compensated ([`Sum`]): neither the order of the samples nor
/// their division into passes, ranges and parts that are merged changes a bit.
#[derive(Clone, Debug)]
pub struct Tile {
    /// Its place in the full image.
    pub rect: PixelRect,
    channels: usize,
    /// By pixel, half and channel.
    sums: Vec<Sum>,
    /// By pixel and half.
    counts: Vec<u64>,
}

/// The mean of a channel over both halves, and what their difference says about its error.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Estimate {
    /// The mean over all samples.
    pub mean: f64,
    /// An unbiased estimate of the variance of the mean; `None` without samples in both halves.
    pub variance: Option<f64>,
}

impl Tile {
    /// An empty tile with so many channels.
    pub fn new(rect: PixelRect, channels: usize) -> Self {
        let pixels = rect.width as usize * rect.height as usize;
        Tile {
            rect,
            channels,
            sums: vec![Sum::default(); pixels * 2 * channels],
            counts: vec![0; pixels * 2],
        }
    }

    /// Pixels of the tile.
    pub fn pixel_count(&self) -> usize {
        self.rect.width as usize * self.rect.height as usize
    }

    /// The place in the full image of pixel `i` of the tile.
    #[inline]
    pub fn position(&self, i: usize) -> (u32, u32) {
        let (x, y) = (i as u32 % self.rect.width, i as u32 / self.rect.width);
        (self.rect.x + x, self.rect.y + y)
    }

    /// Adds the next sample of a half to pixel `i`.
    #[inline]
    pub fn add(&mut self, i: usize, half: usize, values: &[f32]) {
        let start = (2 * i + half) * self.channels;
        let sums = &mut self.sums[start..start + self.channels];
        for (sum, v) in sums.iter_mut().zip(values) {
            sum.add(f64::from(*v));
        }
        self.counts[2 * i + half] += 1;
    }

    /// Adds to the sums of a half of pixel `i` without counting a sample.
    pub fn splat(&mut self, i: usize, half: usize, values: [f32; 3]) {
        let start = (2 * i + half) * self.channels;
        for (sum, v) in self.sums[start..start + 3].iter_mut().zip(values) {
            sum.add(f64::from(v));
        }
    }

    /// Adds the samples of another tile of the same place and channels.
    ///
    /// # Panics
    /// If it is another place, or if it has other channels.
    pub fn merge(&mut self, other: &Tile) {
        assert!(
            (self.rect, self.channels) == (other.rect, other.channels),
            "{:?}, {:?}",
            self.rect,
            other.rect
        );
        self.sums.iter_mut().zip(&other.sums).for_each(|(sum, other)| sum.merge(*other));
        self.counts.iter_mut().zip(&other.counts).for_each(|(count, other)| *count += other);
    }

    /// Its numbers, for a file: the two parts of every sum and then every count.
    pub fn to_bytes(&self) -> Vec<u8> {
        let sums = self.sums.iter().flat_map(|sum| sum.parts()).flat_map(f64::to_le_bytes);
        sums.chain(self.counts.iter().flat_map(|count| count.to_le_bytes())).collect()
    }

    /// Takes the numbers that [`to_bytes`](Self::to_bytes) gave; false, and nothing changed, if there are not as many as
    /// this tile has, or if one is not finite.
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

    /// Samples of pixel `i`.
    pub fn count(&self, i: usize) -> u64 {
        self.counts[2 * i] + self.counts[2 * i + 1]
    }

    /// Mean and variance of channel `c` of pixel `i`; zero without samples.
    pub fn estimate(&self, i: usize, c: usize) -> Estimate {
        let [n_a, n_b] = [self.counts[2 * i], self.counts[2 * i + 1]];
        let [a, b] = [0, 1].map(|half| self.sums[(2 * i + half) * self.channels + c].value());
        let n = n_a + n_b;
        if n == 0 {
            return Estimate { mean: 0.0, variance: None };
        }
        let mean = (a + b) / n as f64;
        // With weights w and 1 − w the mean is w·A + (1 − w)·B. If variances fall as 1/n, its variance is
        // w(1 − w)(A − B)² in expectation.
        let variance = (n_a > 0 && n_b > 0).then(|| {
            let w = n_a as f64 / n as f64;
            let difference = a / n_a as f64 - b / n_b as f64;
            w * (1.0 - w) * difference * difference
        });
        Estimate { mean, variance }
    }

    /// Whether both halves of a pixel have samples.
    pub fn has_replicates(&self) -> bool {
        self.counts.chunks_exact(2).any(|halves| halves[0] > 0 && halves[1] > 0)
    }

    /// Mean and difference of the halves of channel `c` of pixel `i`; zero without samples in both halves.
    ///
    /// The square of the difference is the variance of [`estimate`](Self::estimate); its sign tells which half
    /// is the brighter one.
    #[inline]
    pub fn replicates(&self, i: usize, c: usize) -> [f64; 2] {
        let [n_a, n_b] = [self.counts[2 * i] as f64, self.counts[2 * i + 1] as f64];
        if n_a == 0.0 || n_b == 0.0 {
            return [0.0; 2];
        }
        let [a, b] = [0, 1].map(|half| self.sums[(2 * i + half) * self.channels + c].value());
        let n = n_a + n_b;
        // √(w (1 − w)) with w = n_a / n.
        [(a + b) / n, (n_a * n_b).sqrt() / n * (a / n_a - b / n_b)]
    }

    /// What the halves of the first three channels say about the error of the image.
    pub fn error_sums(&self) -> ErrorSums {
        let (width, height) = (self.rect.width as usize, self.rect.height as usize);
        let mut sums = ErrorSums::default();
        for top in (0..height).step_by(BLOCK) {
            for left in (0..width).step_by(BLOCK) {
                let mut block = Block::new(BLOCK.min(width - left), BLOCK.min(height - top));
                for y in top..(top + BLOCK).min(height) {
                    for x in left..(left + BLOCK).min(width) {
                        for c in 0..3 {
                            block.set(x - left, y - top, c, self.replicates(y * width + x, c));
                        }
                    }
                }
                sums.merge(&block.sums());
            }
        }
        sums
    }

    /// Bytes of the sums of a pixel with so many channels.
    pub fn bytes_per_pixel(channels: usize) -> usize {
        2 * (channels * size_of::<Sum>() + size_of::<u64>())
    }

    /// Bytes of its sums.
    pub fn memory_bytes(&self) -> usize {
        size_of_val(self.sums.as_slice()) + size_of_val(self.counts.as_slice())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pixel() -> Tile {
        Tile::new(PixelRect { x: 0, y: 0, width: 1, height: 1 }, 3)
    }

    #[test]
    fn a_tile_takes_what_was_planned() {
        let tile = Tile::new(PixelRect { x: 3, y: 4, width: 16, height: 5 }, 7);
        assert_eq!(tile.memory_bytes(), 80 * Tile::bytes_per_pixel(7));
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
        assert_eq!(tile.replicates(0, 0), [2.0, -1.0]);
        let estimate = tile.error_sums().estimate().expect("a pixel");
        assert!((estimate.relmse - 1.0 / 4.01).abs() < 1e-7, "{estimate:?}");
    }
}
