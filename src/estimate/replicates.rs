//! The relative squared error of an image, estimated from two independent halves of its samples.
//!
//! Let a and b be the errors of a pixel's halves: independent, of mean zero, of equal variance. The image is their
//! mean, its error (a + b) / 2, and of that d = (a − b) / 2 is known. The squared error differs from d² by a·b:
//!
//! - d² estimates the squared error without bias, for any sampler and any distribution of the noise;
//! - how far it is off follows from Var(a)·Var(b), which the differences of *two* pixels estimate: fourth moments, which
//!   a single firefly decides, are not needed. A firefly in one half is in the error and in d² alike.
//!
//! The error is relative to the true picture r, which is not known. Dividing by the image's own values would make
//! bright errors look small: a firefly would be compared with itself. So r is taken from the pixels around, each with
//! the less weight the more its halves disagree; a pixel's own value counts as far as it leaves its surroundings by more
//! than its own noise, as edges and lamps do. What remains uncertain about r is part of the interval.

use super::metrics::RELATIVE_FLOOR;
use statrs::distribution::{ContinuousCDF, FisherSnedecor};

/// Side of the largest block.
pub const BLOCK: usize = 16;
/// Pixels of the largest block.
const AREA: usize = BLOCK * BLOCK;
/// Pixels up to this far away, along either axis, tell how bright a pixel is.
const RADIUS: usize = 2;
/// A pixel that leaves its surroundings by less than this many squared differences of its halves is taken for noise.
const OWN_NOISE: f32 = 4.0;
/// A pixel whose halves differ by more than so many times the mean difference counts little for its neighbours.
const OUTLIER: f32 = 4.0;
/// The share of the correction of the weights, as a logarithm, that the interval allows for: an allowance that
/// `cargo run --release --example calibration` has shown to suffice, not a derived one.
const ALLOWANCE: f64 = 0.15;
/// 97.5 % of a normal distribution are below so many standard deviations.
const NORMAL_QUANTILE: f64 = 1.959_963_984_540_054;
/// The neighbours whose products are looked at, to the right and below.
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
    /// Estimate of the variance of what separates `errors` from the error.
    variance: f64,
}

/// The estimated relMSE of an image.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ErrorEstimate {
    /// The estimate.
    pub relmse: f64,
    /// The interval that holds the error of this very image in 95 of 100 renders.
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

    /// Sets a pixel: the mean of its halves, and half their signed difference (so scaled that its square estimates
    /// the variance of the mean, if one half has more samples).
    #[inline]
    pub fn set(&mut self, x: usize, y: usize, channel: usize, [mean, difference]: [f64; 2]) {
        let i = y * BLOCK + x;
        self.mean[channel][i] = mean as f32;
        self.difference[channel][i] = difference as f32;
    }

    /// The sums of the block.
    pub fn sums(&self) -> ErrorSums {
        let Surroundings { mean, spread } = self.surroundings();
        let mut sums = ErrorSums { pixels: (self.width * self.height) as u64, ..ErrorSums::default() };
        let mut relative = [[0.0f32; AREA]; 3];
        let floor = RELATIVE_FLOOR as f32;
        for y in 0..self.height {
            for i in y * BLOCK..y * BLOCK + self.width {
                let offset = [0, 1, 2].map(|c| self.mean[c][i] - mean[c][i]);
                let own_noise = norm_squared([0, 1, 2].map(|c| self.difference[c][i]));
                let kept = (1.0 - OWN_NOISE * own_noise / norm_squared(offset).max(f32::MIN_POSITIVE)).max(0.0);
                let (mut error, mut own, mut doubt) = (0.0, 0.0, 0.0);
                for c in 0..3 {
                    let r = mean[c][i] + kept * offset[c];
                    let d = self.difference[c][i];
                    let weight = 1.0 / (r * r + floor);
                    relative[c][i] = weight.sqrt() * d;
                    let e = weight * d * d;
                    error += e;
                    own += d * d / (self.mean[c][i] * self.mean[c][i] + floor);
                    // Half the range of the weights over r ± s, relative to their middle.
                    let s = (1.0 - kept) * spread[c][i];
                    doubt += e * 2.0 * r.abs() * s / (r * r + s * s + floor);
                }
                sums.errors += f64::from(error) / 3.0;
                sums.own += f64::from(own) / 3.0;
                sums.variance += (f64::from(doubt) / 3.0).powi(2);
            }
        }
        sums.variance += self.products(&relative);
        sums
    }

    /// What the neighbours of each pixel say of it.
    fn surroundings(&self) -> Surroundings {
        let noise = self.each(|i| norm_squared([0, 1, 2].map(|c| self.difference[c][i])).sqrt());
        let typical = noise.iter().sum::<f32>() / (self.width * self.height) as f32;
        let scale = 1.0 / (OUTLIER * typical).max(f32::MIN_POSITIVE);
        let weight = self.each(|i| {
            let t = (noise[i] * scale) * (noise[i] * scale);
            1.0 / (1.0 + t * t)
        });
        let total = around(&weight);
        let mut result = Surroundings { mean: self.mean, spread: [[0.0; AREA]; 3] };
        for c in 0..3 {
            let x = &self.mean[c];
            let first = around(&self.each(|i| weight[i] * x[i]));
            let second = around(&self.each(|i| weight[i] * x[i] * x[i]));
            for i in 0..AREA {
                // Without neighbours a pixel stands for itself.
                if total[i] > 0.0 {
                    let mean = first[i] / total[i];
                    result.mean[c][i] = mean;
                    result.spread[c][i] = (second[i] / total[i] - mean * mean).max(0.0).sqrt();
                }
            }
        }
        result
    }

    /// A plane of values of the block's pixels, zero outside.
    fn each(&self, value: impl Fn(usize) -> f32) -> Plane {
        let mut plane = [0.0; AREA];
        for y in 0..self.height {
            for i in y * BLOCK..y * BLOCK + self.width {
                plane[i] = value(i);
            }
        }
        plane
    }

    /// The sum over the pixels of the variance of the mean over channels of a·b, relative to the picture.
    ///
    /// It is 4 Σ Σ' Cov(d_c, d_c')² / 9, and the product of the covariances is estimated from neighbours as
    /// (d · d')². Along an edge only the neighbours along it are as noisy: the direction of the largest products counts.
    fn products(&self, d: &[Plane; 3]) -> f64 {
        let (w, h) = (self.width, self.height);
        let dot = |i: usize, j: usize| {
            let dot = d[0][i] * d[0][j] + d[1][i] * d[1][j] + d[2][i] * d[2][j];
            f64::from(dot * dot)
        };
        let mut largest = None::<f64>;
        for (dx, dy, mirrored) in DIRECTIONS {
            if dx >= w || dy >= h {
                continue;
            }
            let mut sum = 0.0;
            for y in 0..h - dy {
                let (from, to) = (y * BLOCK, (y + dy) * BLOCK);
                for x in 0..w - dx {
                    sum += if mirrored { dot(from + x + dx, to + x) } else { dot(from + x, to + x + dx) };
                }
            }
            let mean = sum / ((w - dx) * (h - dy)) as f64;
            largest = Some(largest.map_or(mean, |l| l.max(mean)));
        }
        4.0 / 9.0 * (w * h) as f64 * largest.unwrap_or_else(|| dot(0, 0))
    }
}

struct Surroundings {
    /// Weighted mean of the neighbours.
    mean: [Plane; 3],
    /// Weighted standard deviation of the neighbours.
    spread: [Plane; 3],
}

fn norm_squared(v: [f32; 3]) -> f32 {
    v[0] * v[0] + v[1] * v[1] + v[2] * v[2]
}

/// The sums over the neighbours of each pixel without itself.
fn around(values: &Plane) -> Plane {
    const WIDE: usize = BLOCK + 2 * RADIUS;
    let mut rows = [0.0f32; WIDE * BLOCK];
    for y in 0..BLOCK {
        let mut padded = [0.0f32; WIDE];
        padded[RADIUS..RADIUS + BLOCK].copy_from_slice(&values[y * BLOCK..(y + 1) * BLOCK]);
        for x in 0..BLOCK {
            rows[(y + RADIUS) * BLOCK + x] = (0..=2 * RADIUS).map(|k| padded[x + k]).sum();
        }
    }
    let mut sums = [0.0; AREA];
    for i in 0..AREA {
        sums[i] = (0..=2 * RADIUS).map(|k| rows[i + k * BLOCK]).sum::<f32>() - values[i];
    }
    sums
}

impl ErrorSums {
    /// Adds the sums of another part of the image.
    pub fn merge(&mut self, other: &ErrorSums) {
        self.pixels += other.pixels;
        self.errors += other.errors;
        self.own += other.own;
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
        let relative = self.variance.sqrt() / self.errors;
        let factor = factor(relative) * (self.errors / self.own).ln().abs().mul_add(ALLOWANCE, 0.0).exp();
        Some(ErrorEstimate { relmse, interval: [relmse / factor, relmse * factor] })
    }
}

/// The factor that leaves 2.5 % on either side of the ratio of the error and its estimate, whose relative standard
/// deviation is given: both behave as χ² with as many degrees of freedom as give that deviation.
fn factor(relative: f64) -> f64 {
    let freedom = (4.0 / (relative * relative)).max(1.0);
    if freedom < 100.0 {
        FisherSnedecor::new(freedom, freedom).map_or(f64::INFINITY, |f| f.inverse_cdf(0.975))
    } else {
        (NORMAL_QUANTILE * relative).exp()
    }
}
