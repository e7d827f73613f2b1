//! The relative squared error of an image, estimated from two independent halves of its samples.
//!
//! Let a and b be the errors of a pixel's halves: independent, of mean zero. The image is their mean, its error is
//! (a + b) / 2, and of that d = (a − b) / 2 is known. The squared error differs from d² by a·b:
//!
//! - d² estimates the squared error without bias, for any sampler and any distribution of the noise;
//! - how far it is off follows from Var(a)·Var(b), which the differences of *two* pixels estimate: fourth moments, which
//!   a single firefly decides, are not needed. A firefly in one half is in the error and in d² alike.
//!
//! The error is relative to the true picture r, which is not known. Dividing by the image's own values would make
//! bright errors look small: a firefly would be compared with itself. So r is taken from the pixels around that are alike
//! within the pixel's own noise, each with the less weight the more its halves disagree; a pixel's own value counts as
//! far as both of its halves leave the surroundings to the same side, as edges and lamps do. What remains uncertain
//! about r is part of the interval.
//!
//! The interval takes the errors of different pixels for independent, as they are for samplers that scramble
//! each pixel on its own.

use super::metrics::RELATIVE_FLOOR;
use statrs::distribution::{ContinuousCDF, FisherSnedecor};

/// Side of the largest block.
pub const BLOCK: usize = 16;
/// Pixels of the largest block.
const AREA: usize = BLOCK * BLOCK;
/// Pixels up to this far away, along either axis, tell how bright a pixel is.
const RADIUS: usize = 2;
/// A block with a margin on every side.
const WIDE: usize = BLOCK + 2 * RADIUS;
/// Neighbours are alike if they are no farther than this many standard deviations of the pixel.
const ALIKE: f32 = 4.0;
/// A pixel whose halves differ by more than so many times the mean difference counts little for its neighbours.
const OUTLIER: f32 = 16.0;
/// The share of the correction of the weights, as a logarithm, that the interval allows for. It is not derived:
/// `cargo run --release --example calibration` shows what it brings.
const ALLOWANCE: f64 = 0.15;
/// Squares of larger values would leave the range of `f32`.
const LARGEST: f64 = 1e15;
/// 97.5 % of a normal distribution are below so many standard deviations.
const NORMAL_QUANTILE: f64 = 1.959_963_984_540_054;
/// Where the neighbours are whose products are looked at; the last one is mirrored.
const DIRECTIONS: [(usize, usize, bool); 4] = [(1, 0, false), (0, 1, false), (1, 1, false), (1, 1, true)];

type Plane = [f32; AREA];

/// A block of pixels of three channels, at most [`BLOCK`] wide and high.
#[derive(Clone)]
pub struct Block {
    width: usize,
    height: usize,
    /// By channel and pixel, in rows of [`BLOCK`]; zero outside the block.
    mean: [Plane; 3],
    difference: [Plane; 3],
}

/// Sums over blocks.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ErrorSums {
    pixels: u64,
    /// Of the relative squared differences, mean over the channels.
    errors: f64,
    /// The same, relative to the image itself.
    own: f64,
    /// What the errors would lose if outliers were true.
    outliers: f64,
    /// Estimate of the variance of what separates `errors` from the error.
    variance: f64,
}

/// The estimated relMSE of an image.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ErrorEstimate {
    /// The estimate.
    pub relmse: f64,
    /// Lower and upper end of what holds the error of this very image in 95 of 100 renders.
    pub interval: [f64; 2],
}

impl Block {
    /// A block of black pixels without differences.
    ///
    /// # Panics
    /// If a side is 0 or larger than [`BLOCK`].
    pub fn new(width: usize, height: usize) -> Self {
        assert!((1..=BLOCK).contains(&width) && (1..=BLOCK).contains(&height), "{width}x{height}");
        Block { width, height, mean: [[0.0; AREA]; 3], difference: [[0.0; AREA]; 3] }
    }

    /// Sets a channel of a pixel: the mean of its halves, and half their signed difference (so scaled that its square
    /// estimates the variance of the mean, if one half has more samples). Values beyond ±10^15 count as that.
    #[inline]
    pub fn set(&mut self, x: usize, y: usize, channel: usize, [mean, difference]: [f64; 2]) {
        let i = y * BLOCK + x;
        self.mean[channel][i] = mean.clamp(-LARGEST, LARGEST) as f32;
        self.difference[channel][i] = difference.clamp(-LARGEST, LARGEST) as f32;
    }

    /// The sums of the block.
    pub fn sums(&self) -> ErrorSums {
        let Surroundings { mean, spread, trust } = self.surroundings();
        let mut sums = ErrorSums { pixels: (self.width * self.height) as u64, ..ErrorSums::default() };
        let mut relative = [[0.0f32; AREA]; 3];
        let floor = RELATIVE_FLOOR as f32;
        for i in self.indices() {
            let offset = [0, 1, 2].map(|c| self.mean[c][i] - mean[c][i]);
            // (A − m)(B − m) / (x − m)², m the surroundings: what both halves say of the offset.
            let common = 1.0 - self.noise(i) / norm_squared(offset).max(f32::MIN_POSITIVE);
            let common = common.max(0.0);
            let (mut error, mut own, mut doubt) = (0.0, 0.0, 0.0);
            for c in 0..3 {
                let r = mean[c][i] + common * offset[c];
                let d = self.difference[c][i];
                let weight = 1.0 / (r * r + floor);
                relative[c][i] = weight.sqrt() * d;
                error += weight * d * d;
                own += d * d / (self.mean[c][i] * self.mean[c][i] + floor);
                // Half the range of the weights over r ± s, relative to their middle.
                let s = (1.0 - common) * spread[c][i];
                doubt += weight * d * d * (2.0 * r.abs() * s / (r * r + s * s + floor));
            }
            sums.errors += f64::from(error) / 3.0;
            sums.own += f64::from(own) / 3.0;
            sums.outliers += f64::from((1.0 - trust[i]) * (error - own).max(0.0)) / 3.0;
            sums.variance += (f64::from(doubt) / 3.0).powi(2);
        }
        sums.variance += self.products(&relative);
        sums
    }

    /// What the neighbours of each pixel say of it.
    fn surroundings(&self) -> Surroundings {
        let typical = self.indices().map(|i| self.noise(i).sqrt()).sum::<f32>();
        let pixels = (self.width * self.height) as f32;
        let scale = if typical > 0.0 { pixels / (OUTLIER * typical) } else { 0.0 };
        let mut trust = [0.0; AREA];
        for i in self.indices() {
            let t = (self.noise(i).sqrt() * scale).powi(2);
            trust[i] = 1.0 / (1.0 + t * t);
        }
        let padded_trust = padded(&trust);
        let x = [0, 1, 2].map(|c| padded(&self.mean[c]));
        let mut result = Surroundings { mean: self.mean, spread: [[0.0; AREA]; 3], trust };
        for y in 0..self.height {
            let row = self.neighbours(y, &padded_trust, &x);
            for (k, total) in row.total.iter().enumerate().take(self.width) {
                // Without neighbours a pixel stands for itself.
                if *total > 0.0 {
                    for c in 0..3 {
                        let mean = row.first[c][k] / total;
                        let variance = row.second[c][k] / total - mean * mean;
                        result.mean[c][y * BLOCK + k] = mean;
                        result.spread[c][y * BLOCK + k] = variance.max(0.0).sqrt();
                    }
                }
            }
        }
        result
    }

    /// Weighted sums over the neighbours of row `y`, in loops over the row that become SIMD.
    fn neighbours(&self, y: usize, trust: &[f32; WIDE * WIDE], x: &[[f32; WIDE * WIDE]; 3]) -> RowSums {
        let own = y * BLOCK;
        let mut scale = [0.0f32; BLOCK];
        for (k, scale) in scale.iter_mut().enumerate() {
            *scale = 1.0 / (ALIKE * ALIKE * self.noise(own + k)).max(f32::MIN_POSITIVE);
        }
        let mut sums = RowSums::default();
        for dy in 0..=2 * RADIUS {
            for dx in 0..=2 * RADIUS {
                if (dx, dy) == (RADIUS, RADIUS) {
                    continue;
                }
                let start = (y + dy) * WIDE + dx;
                for k in 0..BLOCK {
                    let v = [0, 1, 2].map(|c| x[c][start + k]);
                    let distance = norm_squared([0, 1, 2].map(|c| v[c] - self.mean[c][own + k]));
                    let q = (distance * scale[k]).min(1e15);
                    let weight = trust[start + k] / (1.0 + q * q);
                    sums.total[k] += weight;
                    for (c, v) in v.into_iter().enumerate() {
                        sums.first[c][k] += weight * v;
                        sums.second[c][k] += weight * v * v;
                    }
                }
            }
        }
        sums
    }

    /// The sum over the pixels of the variance of the mean over channels of a·b, relative to the picture.
    ///
    /// For one pixel it is 4/9 Σ Σ' Cov(d_c, d_c')², and the product of covariances is estimated by two neighbours as
    /// (d · d')². Along an edge only the neighbours along it are as noisy: the direction of the largest products counts.
    fn products(&self, d: &[Plane; 3]) -> f64 {
        let (w, h) = (self.width, self.height);
        let square = |i: usize, j: usize| {
            let dot = d[0][i] * d[0][j] + d[1][i] * d[1][j] + d[2][i] * d[2][j];
            f64::from(dot) * f64::from(dot)
        };
        let mut largest = None::<f64>;
        for (dx, dy, mirrored) in DIRECTIONS.into_iter().filter(|&(dx, dy, _)| dx < w && dy < h) {
            let mut sum = 0.0;
            for y in 0..h - dy {
                let (from, to) = (y * BLOCK, (y + dy) * BLOCK);
                for x in 0..w - dx {
                    sum +=
                        if mirrored { square(from + x + dx, to + x) } else { square(from + x, to + x + dx) };
                }
            }
            let mean = sum / ((w - dx) * (h - dy)) as f64;
            largest = Some(largest.map_or(mean, |l| l.max(mean)));
        }
        4.0 / 9.0 * (w * h) as f64 * largest.unwrap_or_else(|| square(0, 0))
    }

    fn indices(&self) -> impl Iterator<Item = usize> + use<> {
        let width = self.width;
        (0..self.height).flat_map(move |y| y * BLOCK..y * BLOCK + width)
    }

    /// The sum over channels of the squared difference.
    #[inline]
    fn noise(&self, i: usize) -> f32 {
        norm_squared([0, 1, 2].map(|c| self.difference[c][i]))
    }
}

/// Sums for a row of pixels, by channel.
#[derive(Default)]
struct RowSums {
    total: [f32; BLOCK],
    first: [[f32; BLOCK]; 3],
    second: [[f32; BLOCK]; 3],
}

struct Surroundings {
    /// Weighted mean of the neighbours.
    mean: [Plane; 3],
    /// Weighted standard deviation of the neighbours.
    spread: [Plane; 3],
    /// How far the pixel itself is trusted by others.
    trust: Plane,
}

#[inline]
fn norm_squared(v: [f32; 3]) -> f32 {
    v[0] * v[0] + v[1] * v[1] + v[2] * v[2]
}

/// A plane with a margin of zeros.
fn padded(plane: &Plane) -> [f32; WIDE * WIDE] {
    let mut wide = [0.0; WIDE * WIDE];
    for y in 0..BLOCK {
        let start = (y + RADIUS) * WIDE + RADIUS;
        wide[start..start + BLOCK].copy_from_slice(&plane[y * BLOCK..(y + 1) * BLOCK]);
    }
    wide
}

impl ErrorSums {
    /// Adds the sums of another part of the image.
    pub fn merge(&mut self, other: &ErrorSums) {
        self.pixels += other.pixels;
        self.errors += other.errors;
        self.own += other.own;
        self.outliers += other.outliers;
        self.variance += other.variance;
    }

    /// The estimate; `None` without pixels.
    pub fn estimate(&self) -> Option<ErrorEstimate> {
        if self.pixels == 0 {
            return None;
        }
        let relmse = self.errors / self.pixels as f64;
        if relmse == 0.0 {
            return Some(ErrorEstimate::default());
        }
        let factor = factor(self.variance.sqrt() / self.errors)
            * (ALLOWANCE * (self.errors / self.own).ln().abs()).exp();
        let without_outliers = (1.0 - self.outliers / self.errors).clamp(0.0, 1.0);
        Some(ErrorEstimate { relmse, interval: [relmse * without_outliers / factor, relmse * factor] })
    }
}

/// The factor that leaves 2.5 % on either side of the ratio of the error and its estimate, whose difference has the
/// given relative standard deviation: both behave as χ² with as many degrees of freedom as give that deviation.
fn factor(relative: f64) -> f64 {
    let freedom = (4.0 / (relative * relative)).max(1.0);
    if freedom < 100.0 {
        FisherSnedecor::new(freedom, freedom).map_or(f64::INFINITY, |f| f.inverse_cdf(0.975))
    } else {
        (NORMAL_QUANTILE * relative).exp()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Sums of a block with one value in all channels.
    fn sums(width: usize, height: usize, value: impl Fn(usize, usize) -> [f64; 2]) -> ErrorSums {
        let mut block = Block::new(width, height);
        for y in 0..height {
            for x in 0..width {
                (0..3).for_each(|c| block.set(x, y, c, value(x, y)));
            }
        }
        block.sums()
    }

    #[test]
    fn a_grey_plane_is_as_wrong_as_its_halves_differ() {
        let sums = sums(16, 16, |x, y| [1.0, if (x ^ y) & 1 == 0 { 0.1 } else { -0.1 }]);
        let estimate = sums.estimate().expect("pixels");
        assert!((estimate.relmse - 0.01 / 1.01).abs() < 1e-8, "{estimate:?}");
        // Var(a b) = 4 σ⁴ for each of 256 pixels: a relative deviation of 2/16.
        let expected = (NORMAL_QUANTILE * 2.0 / 16.0).exp();
        let [low, high] = estimate.interval.map(|e| e / estimate.relmse);
        assert!((high / expected - 1.0).abs() < 1e-3 && (low * expected - 1.0).abs() < 1e-3, "{estimate:?}");
    }

    #[test]
    fn a_firefly_is_compared_with_its_surroundings() {
        let firefly = |x, y| if (x, y) == (7, 9) { [101.0, 100.0] } else { [1.0, 0.01] };
        let estimate = sums(16, 16, firefly).estimate().expect("pixels");
        let expected = 100.0 * 100.0 / 1.01 / 256.0;
        assert!((estimate.relmse / expected - 1.0).abs() < 1e-3, "{estimate:?}, {expected}");
        // That it is the picture, and not an error, remains possible.
        assert!(estimate.interval[0] < 0.01 && estimate.interval[1] > expected, "{estimate:?}");
    }

    #[test]
    fn a_lamp_is_compared_with_itself_and_an_edge_with_its_side() {
        let lamp = |x, y| if (x, y) == (7, 9) { [100.0, 1.0] } else { [0.1, 0.0] };
        let estimate = sums(16, 16, lamp).estimate().expect("pixels");
        assert!((estimate.relmse * 256.0 / 1e-4 - 1.0).abs() < 0.01, "{estimate:?}");
        let edge = |x, _| if x < 8 { [0.0, 0.001] } else { [10.0, 0.0] };
        let estimate = sums(16, 16, edge).estimate().expect("pixels");
        assert!((estimate.relmse / (0.5 * 1e-4) - 1.0).abs() < 0.01, "{estimate:?}");
    }

    #[test]
    fn the_smallest_images_have_wide_intervals_and_no_error_is_none() {
        let estimate = sums(1, 1, |_, _| [1.0, 0.1]).estimate().expect("a pixel");
        // One degree of freedom on either side.
        assert!((estimate.interval[1] / estimate.relmse - 647.8).abs() < 1.0, "{estimate:?}");
        assert_eq!(sums(3, 1, |_, _| [1.0, 0.0]).estimate(), Some(ErrorEstimate::default()));
        assert_eq!(ErrorSums::default().estimate(), None);
    }

    #[test]
    fn extreme_values_stay_finite() {
        let quiet = sums(16, 16, |_, _| [1.0, 0.0]);
        for value in [[1e15, 1e15], [1e30, -1e30], [1e-30, 1e-30], [-1.0, 2.0], [0.0, 1e18], [1.0, 1e-15]] {
            let mut sums = sums(5, 4, |x, _| if x == 2 { value } else { [0.0; 2] });
            sums.merge(&quiet);
            let ErrorEstimate { relmse, interval: [low, high] } = sums.estimate().expect("pixels");
            assert!(
                (0.0..=relmse).contains(&low) && relmse <= high && high.is_finite(),
                "{low} {relmse} {high}"
            );
        }
    }
}
