//! The relative squared error of an image, estimated from two independent halves of its samples.
//!
//! Let a and b be the errors of a pixel's halves: independent, with mean zero. The image is their mean, and its error
//! is (a + b) / 2. Known is d = (a − b) / 2. The squared error differs from d² by a·b:
//!
//! - d² is an unbiased estimate of the squared error, for any sampler and any distribution of the noise.
//! - The variance of the estimate follows from the variance of Σ a·b over the pixels, tr C² = Σᵢⱼ Cov(aᵢ, aⱼ)².
//!   Fourth moments, which a single firefly dominates, are not needed. A firefly in one half contributes equally to
//!   the error and to d².
//!
//! If the errors of pixels are independent, tr C² is a sum over pixels, which the differences of *two* neighbours
//! estimate. Pixels that reuse the paths of their group have correlated errors. Their mean correlation ρ follows from
//! the sums of d over blocks: the mean of (Σ d)² relative to Σ d² is 1 + (G − 1)·ρ for groups of G pixels, and tr C²
//! is larger by the factor 1 + (G − 1)·ρ². If pixels share noise (photons, caches, light paths), the samples are
//! divided among eight replicates, four in each half, each with its own photons and caches. For two replicates of
//! either half, the products of differences, ⟨r₀ − r₂, r₁ − r₃⟩²/4, estimate tr C² of the replicates with all
//! correlations between pixels. The difference between the estimate for blocks of pixels and that for single pixels
//! is due to noise shared by neighbours. The difference between the whole image and its blocks is due to noise shared
//! by all pixels.
//!
//! The error is relative to the true image r, which is unknown. Dividing by the image's own values would
//! underestimate large errors, because a firefly would be compared with itself. Therefore r is estimated from those
//! surrounding pixels that are equal within the pixel's own noise, with a smaller weight for pixels whose halves
//! disagree. A pixel's own value has weight if both of its halves differ from the surroundings in the same direction,
//! as at edges and emitters, or if two neighbours are certainly brighter than the surroundings and at least as bright
//! as the pixel: then it is the noisy edge of an emitter. The remaining uncertainty of r is part of the interval.

use super::metrics::RELATIVE_FLOOR;
use statrs::distribution::{ContinuousCDF, FisherSnedecor};
use std::ops::Range;

/// The side of the largest block, in pixels.
pub const BLOCK: usize = 16;
/// The number of pixels in a group that reuses paths.
const GROUP: f64 = 16.0;
/// The greatest number of replicates.
pub const MAX_REPLICATES: usize = 8;
/// The number of pixels in the largest block.
const AREA: usize = BLOCK * BLOCK;
/// The half width of the neighbourhood from which a pixel's true value is estimated.
const RADIUS: usize = 2;
/// The distance between pixels of the neighbourhood if neighbouring pixels share noise.
const SHARED_STRIDE: usize = 3;
/// The greatest distance of a pixel in the neighbourhood.
const MARGIN: usize = RADIUS * SHARED_STRIDE;
/// The side of a block with a margin on every side.
const PADDED_SIDE: usize = BLOCK + 2 * MARGIN;
/// The greatest difference of a similar pixel, in standard deviations of the pixel.
const MAX_DEVIATIONS: f32 = 4.0;
/// The fraction of a pixel's offset from its surroundings that is not noise, below which it may be a noisy edge.
const EDGE: f32 = 0.98;
/// The least offset of a neighbour that is certainly bright, in its standard deviations.
const CERTAIN: f32 = 8.0;
/// The ratio between a pixel's difference of halves and the mean difference, above which the pixel has little weight
/// for its neighbours.
const OUTLIER_RATIO: f32 = 16.0;
/// The fraction of the correction of the weights, as a logarithm, by which the interval is widened. It is an
/// empirical value: `cargo run --release --example calibration` shows its effect.
const ALLOWANCE: f64 = 0.15;
/// The same fraction if pixels share noise, so that the errors of neighbours are similar.
const SHARED_ALLOWANCE: f64 = 0.35;
/// The ratio between the estimates of the whole image and of its blocks that may occur by chance.
const CHANCE_RATIO: f64 = 2.0;
/// The largest value whose square is in the range of `f32`.
const MAX_VALUE: f64 = 1e15;
/// The 97.5 % quantile of the standard normal distribution.
const NORMAL_QUANTILE: f64 = 1.959_963_984_540_054;
/// The offsets to the neighbours for products of differences; the last one is mirrored.
const DIRECTIONS: [(usize, usize, bool); 4] = [(1, 0, false), (0, 1, false), (1, 1, false), (1, 1, true)];

type Plane = [f32; AREA];

/// A block of pixels with three channels, at most [`BLOCK`] wide and high.
#[derive(Clone)]
pub struct PixelBlock {
    width: usize,
    height: usize,
    /// For each channel and pixel, in rows of [`BLOCK`]; zero outside the block.
    mean: [Plane; 3],
    /// The standard error; with two replicates, it has the sign of their difference.
    difference: [Plane; 3],
    /// With more than two replicates, the deviation of each from the mean.
    deviations: Vec<[Plane; 3]>,
}

/// Inner products of the replicates' deviations.
type Gram = [[f64; MAX_REPLICATES]; MAX_REPLICATES];

/// Sums over blocks of pixels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ErrorSums {
    replicates: usize,
    pixels: u64,
    /// The sum of the relative squared differences, averaged over the channels.
    errors: f64,
    /// The sum over blocks and channels of the squares of their sums of relative differences, averaged over the
    /// channels. It is as large as `errors` if the errors of pixels are independent.
    of_sums: f64,
    /// The same sum relative to the image itself.
    own: f64,
    /// The decrease of `errors` if outliers were part of the true image.
    outliers: f64,
    /// An estimate of the variance of the difference between `errors` and the squared error, from single blocks.
    variance: f64,
    /// If pixels share noise, the same variance for the mean of replicates, from single pixels.
    of_pixels: f64,
    /// If pixels share noise, the same variance for the mean of replicates, from blocks.
    of_blocks: f64,
    /// The variance due to the uncertainty of the true image.
    uncertainty: f64,
    /// With more than two replicates, the inner products over all pixels and channels, relative to the true image.
    gram: Gram,
}

/// The estimated relMSE of an image.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ErrorEstimate {
    /// The estimate.
    pub relmse: f64,
    /// The 95 % confidence interval for the error of this image.
    pub interval: [f64; 2],
}

impl ErrorEstimate {
    /// Adds the squared bias of the expected image, which may be smaller: the lower end of the interval stays.
    pub fn with_bias(self, squared_bias: f64) -> Self {
        let ErrorEstimate { relmse, interval: [low, high] } = self;
        ErrorEstimate { relmse: relmse + squared_bias, interval: [low, high + squared_bias] }
    }
}

impl PixelBlock {
    /// Creates a black block without errors, of an image with the given number of replicates.
    ///
    /// # Panics
    /// If a side is 0 or larger than [`BLOCK`], or there are more than [`MAX_REPLICATES`] replicates.
    pub fn new(width: usize, height: usize, replicates: usize) -> Self {
        assert!((1..=BLOCK).contains(&width) && (1..=BLOCK).contains(&height), "{width}x{height}");
        assert!(replicates <= MAX_REPLICATES, "{replicates} replicates");
        let deviations = if replicates > 2 { vec![[[0.0; AREA]; 3]; replicates] } else { Vec::new() };
        PixelBlock { width, height, mean: [[0.0; AREA]; 3], difference: [[0.0; AREA]; 3], deviations }
    }

    /// Sets the mean of a channel of a pixel and its standard error, which has the sign of the difference if there
    /// are two replicates. Values are clamped to ±10^15.
    #[inline]
    pub fn set(&mut self, x: usize, y: usize, channel: usize, [mean, error]: [f64; 2]) {
        let i = y * BLOCK + x;
        self.mean[channel][i] = mean.clamp(-MAX_VALUE, MAX_VALUE) as f32;
        self.difference[channel][i] = error.clamp(-MAX_VALUE, MAX_VALUE) as f32;
    }

    /// Sets the deviation of a replicate from the mean in a channel of a pixel.
    #[inline]
    pub fn set_deviation(&mut self, x: usize, y: usize, channel: usize, replicate: usize, deviation: f64) {
        self.deviations[replicate][channel][y * BLOCK + x] = deviation.clamp(-MAX_VALUE, MAX_VALUE) as f32;
    }

    /// Returns the sums of the block.
    pub fn sums(&self) -> ErrorSums {
        let replicates = self.deviations.len().max(2);
        let mut sums = ErrorSums { pixels: (self.width * self.height) as u64, ..ErrorSums::new(replicates) };
        let truth = self.truth();
        self.add_errors(&mut sums, &truth);
        let scales = truth.weights.map(|plane| plane.map(f32::sqrt));
        let relative = multiplied(&self.difference, &scales);
        sums.variance = self.product_sum(&relative);
        let total = |plane: &Plane| self.indices().map(|i| f64::from(plane[i])).sum::<f64>();
        sums.of_sums = relative.iter().map(|plane| total(plane).powi(2)).sum::<f64>() / 3.0;
        if replicates > 2 {
            self.add_shared(&mut sums, &scales);
        }
        sums
    }

    /// Adds the estimates of shared noise from replicates. Each channel and pixel is multiplied by its scale.
    fn add_shared(&self, sums: &mut ErrorSums, scales: &[Plane; 3]) {
        let scaled: Vec<[Plane; 3]> = self.deviations.iter().map(|d| multiplied(d, scales)).collect();
        sums.gram = gram(&scaled, 0..AREA);
        sums.of_blocks = variance_by_pairs(&sums.gram, scaled.len());
        let single = |i: usize| variance_by_pairs(&gram(&scaled, i..i + 1), scaled.len());
        sums.of_pixels = self.indices().map(single).sum();
    }

    /// Adds the errors relative to an estimate of the true image.
    fn add_errors(&self, sums: &mut ErrorSums, truth: &TrueImage) {
        let trust = self.trust();
        let floor = RELATIVE_FLOOR as f32;
        for i in self.indices() {
            let (mut error, mut own, mut uncertainty) = (0.0, 0.0, 0.0);
            for c in 0..3 {
                let squared = self.difference[c][i] * self.difference[c][i];
                error += truth.weights[c][i] * squared;
                own += squared / (self.mean[c][i] * self.mean[c][i] + floor);
                uncertainty += truth.uncertainties[c][i] * squared;
            }
            sums.errors += f64::from(error) / 3.0;
            sums.own += f64::from(own) / 3.0;
            sums.outliers += f64::from((1.0 - trust[i]) * (error - own).max(0.0)) / 3.0;
            sums.uncertainty += (f64::from(uncertainty) / 3.0).powi(2);
        }
    }

    /// Estimates the true image and its uncertainty.
    fn truth(&self) -> TrueImage {
        let Neighbourhood { mean, spread } = self.neighbourhood();
        let mut truth = TrueImage { weights: [[0.0; AREA]; 3], uncertainties: [[0.0; AREA]; 3] };
        let floor = RELATIVE_FLOOR as f32;
        for i in self.indices() {
            let offset = [0, 1, 2].map(|c| self.mean[c][i] - mean[c][i]);
            // 1 − σ²/(x − m)², where m is the mean of the surroundings: the fraction of the offset that is not noise.
            let common = 1.0 - self.noise(i) / norm_squared(offset).max(f32::MIN_POSITIVE);
            let edge = common < EDGE && self.is_edge(i, [0, 1, 2].map(|c| mean[c][i]));
            let common = if edge { 1.0 } else { common.max(0.0) };
            for c in 0..3 {
                let r = mean[c][i] + common * offset[c];
                let weight = 1.0 / (r * r + floor);
                // Half the range of the weights over r ± s, relative to their mean.
                let s = (1.0 - common) * spread[c][i];
                truth.weights[c][i] = weight;
                let uncertainty = 2.0 * r.abs() * s / (r * r + s * s + floor);
                // Neighbours do not tell the noise of an edge, so its own squared error is uncertain.
                truth.uncertainties[c][i] = weight * if edge { 1.0 } else { uncertainty };
            }
        }
        truth
    }

    /// Returns whether a pixel is brighter than its surroundings because it is at the edge of something brighter still.
    /// At least two neighbours are then as bright, and certainly brighter than the mean of the surroundings.
    fn is_edge(&self, i: usize, surroundings: [f32; 3]) -> bool {
        let brightness = |j: usize| self.mean[0][j] + self.mean[1][j] + self.mean[2][j];
        let own = brightness(i);
        if own <= surroundings.iter().sum() {
            return false;
        }
        let (x, y) = (i % BLOCK, i / BLOCK);
        let around = |k: usize, length: usize| k.saturating_sub(RADIUS)..(k + RADIUS + 1).min(length);
        let bright = around(y, self.height)
            .flat_map(|y| around(x, self.width).map(move |x| y * BLOCK + x))
            .filter(|&j| {
                let offset = norm_squared([0, 1, 2].map(|c| self.mean[c][j] - surroundings[c]));
                j != i && brightness(j) >= own && CERTAIN * CERTAIN * self.noise(j) < offset
            });
        bright.take(2).count() == 2
    }

    /// Returns the weight of each pixel for its neighbours.
    fn trust(&self) -> Plane {
        let typical = self.indices().map(|i| self.noise(i).sqrt()).sum::<f32>();
        let pixels = (self.width * self.height) as f32;
        let scale = if typical > 0.0 { pixels / (OUTLIER_RATIO * typical) } else { 0.0 };
        let mut trust = [0.0; AREA];
        for i in self.indices() {
            let t = (self.noise(i).sqrt() * scale).powi(2);
            trust[i] = 1.0 / (1.0 + t * t);
        }
        trust
    }

    /// Returns the weighted statistics of each pixel's neighbourhood.
    fn neighbourhood(&self) -> Neighbourhood {
        let trust = self.trust();
        let padded_trust = padded(&trust);
        let x = [0, 1, 2].map(|c| padded(&self.mean[c]));
        let mut result = Neighbourhood { mean: self.mean, spread: [[0.0; AREA]; 3] };
        for y in 0..self.height {
            let row = self.neighbours(y, &padded_trust, &x);
            for (k, total) in row.total.iter().enumerate().take(self.width) {
                // A pixel without similar neighbours uses its own value.
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

    /// Returns weighted sums over the neighbours of row `y`. The loops over the row are vectorised.
    fn neighbours(
        &self,
        y: usize,
        trust: &[f32; PADDED_SIDE * PADDED_SIDE],
        x: &[[f32; PADDED_SIDE * PADDED_SIDE]; 3],
    ) -> RowSums {
        let own = y * BLOCK;
        let mut scale = [0.0f32; BLOCK];
        for (k, scale) in scale.iter_mut().enumerate() {
            *scale = 1.0 / (MAX_DEVIATIONS * MAX_DEVIATIONS * self.noise(own + k)).max(f32::MIN_POSITIVE);
        }
        let stride = if self.deviations.is_empty() { 1 } else { SHARED_STRIDE };
        let corner = MARGIN - RADIUS * stride;
        let mut sums = RowSums::default();
        for dy in 0..=2 * RADIUS {
            for dx in 0..=2 * RADIUS {
                if (dx, dy) == (RADIUS, RADIUS) {
                    continue;
                }
                let start = (y + corner + dy * stride) * PADDED_SIDE + corner + dx * stride;
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

    /// Returns the sum over the pixels of the variance of a·b averaged over the channels, relative to the true image.
    ///
    /// For one pixel it is 4/9 Σ Σ' Cov(d_c, d_c')². The square of the covariance is estimated from two neighbours as
    /// (d · d')². At an edge, only neighbours along the edge have similar noise, so the direction with the largest
    /// products is used.
    fn product_sum(&self, d: &[Plane; 3]) -> f64 {
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

    /// Returns the sum over channels of the squared difference.
    #[inline]
    fn noise(&self, i: usize) -> f32 {
        norm_squared([0, 1, 2].map(|c| self.difference[c][i]))
    }
}

/// Sums for a row of pixels, for each channel.
#[derive(Default)]
struct RowSums {
    total: [f32; BLOCK],
    first: [[f32; BLOCK]; 3],
    second: [[f32; BLOCK]; 3],
}

struct Neighbourhood {
    /// The weighted mean of the neighbours.
    mean: [Plane; 3],
    /// The weighted standard deviation of the neighbours.
    spread: [Plane; 3],
}

/// The factors that make squared errors relative.
struct TrueImage {
    weights: [Plane; 3],
    /// The uncertainty of the weights.
    uncertainties: [Plane; 3],
}

fn multiplied(planes: &[Plane; 3], by: &[Plane; 3]) -> [Plane; 3] {
    std::array::from_fn(|c| std::array::from_fn(|i| planes[c][i] * by[c][i]))
}

/// Returns inner products of the replicates' planes over a range of pixels, averaged over the channels.
fn gram(planes: &[[Plane; 3]], pixels: Range<usize>) -> Gram {
    let mut gram = [[0.0; MAX_REPLICATES]; MAX_REPLICATES];
    for (r, a) in planes.iter().enumerate() {
        for (s, b) in planes.iter().enumerate().take(r + 1) {
            let dot = |c: usize| {
                let product_sum = a[c][pixels.clone()].iter().zip(&b[c][pixels.clone()]);
                product_sum.map(|(a, b)| f64::from(*a) * f64::from(*b)).sum::<f64>()
            };
            let sum = (dot(0) + dot(1) + dot(2)) / 3.0;
            (gram[r][s], gram[s][r]) = (sum, sum);
        }
    }
    gram
}

/// Returns the variance of the difference between the squared error of the mean of replicates and its estimate, 2·tr
/// C²/(R(R − 1)). tr C² is the mean of ⟨a − b, c − d⟩²/4 with a and b from the even replicates, c and d from the odd
/// ones. Replicates of the same half may be parts of one low-discrepancy sequence and are therefore not independent.
fn variance_by_pairs(gram: &Gram, replicates: usize) -> f64 {
    let (mut sum, mut count) = (0.0, 0.0);
    for a in (0..replicates).step_by(2) {
        for b in (0..a).step_by(2) {
            for c in (1..replicates).step_by(2) {
                for d in (1..c).step_by(2) {
                    sum += 0.25 * (gram[a][c] - gram[a][d] - gram[b][c] + gram[b][d]).powi(2);
                    count += 1.0;
                }
            }
        }
    }
    2.0 * sum / (count * (replicates * (replicates - 1)) as f64)
}

#[inline]
fn norm_squared(v: [f32; 3]) -> f32 {
    v[0] * v[0] + v[1] * v[1] + v[2] * v[2]
}

/// Adds a margin of zeros to a plane.
fn padded(plane: &Plane) -> [f32; PADDED_SIDE * PADDED_SIDE] {
    let mut wide = [0.0; PADDED_SIDE * PADDED_SIDE];
    for y in 0..BLOCK {
        let start = (y + MARGIN) * PADDED_SIDE + MARGIN;
        wide[start..start + BLOCK].copy_from_slice(&plane[y * BLOCK..(y + 1) * BLOCK]);
    }
    wide
}

impl ErrorSums {
    /// Creates sums over no pixels, of an image with the given number of replicates.
    pub fn new(replicates: usize) -> Self {
        ErrorSums {
            replicates,
            pixels: 0,
            errors: 0.0,
            of_sums: 0.0,
            own: 0.0,
            of_pixels: 0.0,
            of_blocks: 0.0,
            outliers: 0.0,
            variance: 0.0,
            uncertainty: 0.0,
            gram: [[0.0; MAX_REPLICATES]; MAX_REPLICATES],
        }
    }

    /// Adds the sums of another region of the image.
    pub fn merge(&mut self, other: &ErrorSums) {
        self.pixels += other.pixels;
        self.errors += other.errors;
        self.of_sums += other.of_sums;
        self.own += other.own;
        self.of_pixels += other.of_pixels;
        self.of_blocks += other.of_blocks;
        self.outliers += other.outliers;
        self.variance += other.variance;
        self.uncertainty += other.uncertainty;
        for (sum, other) in self.gram.as_flattened_mut().iter_mut().zip(other.gram.as_flattened()) {
            *sum += other;
        }
    }

    /// Returns the estimate, given the number of replicates with samples; `None` without pixels, or with fewer than
    /// two such replicates.
    pub fn estimate(&self, filled: usize) -> Option<ErrorEstimate> {
        if self.pixels == 0 || filled < 2 {
            return None;
        }
        if self.errors == 0.0 {
            return Some(ErrorEstimate::default());
        }
        let shared = match self.replicates {
            2 => {
                // (G − 1)·ρ, at most for noise that is common to the group.
                let excess = (self.of_sums / self.errors - 1.0).clamp(0.0, GROUP - 1.0);
                self.variance * excess * excess / (GROUP - 1.0)
            }
            replicates if filled == replicates => {
                let near = (self.of_blocks - self.of_pixels).max(0.0);
                // Long-range correlation is estimated by a single value, which is used only if it clearly exceeds
                // chance.
                let far = (variance_by_pairs(&self.gram, filled) - CHANCE_RATIO * self.of_blocks).max(0.0);
                // Converts from the mean of replicates to the difference of two halves of them.
                2.0 * (filled - 1) as f64 / filled as f64 * (near + far)
            }
            // The shared noise is unknown, so the interval is unbounded.
            _ => f64::INFINITY,
        };
        let relmse = self.errors / self.pixels as f64;
        let [low, high] = factors((self.variance + shared + self.uncertainty).sqrt() / self.errors);
        let allowance = if self.replicates > 2 { SHARED_ALLOWANCE } else { ALLOWANCE };
        let weights = (allowance * (self.errors / self.own).ln().abs()).exp();
        let without_outliers = (1.0 - self.outliers / self.errors).clamp(0.0, 1.0);
        Some(ErrorEstimate {
            relmse,
            interval: [relmse * without_outliers * low / weights, relmse * high * weights],
        })
    }
}

/// Returns factors such that the ratio between the error and its estimate is below or above them with 2.5 %
/// probability each, if their difference has the given relative standard deviation. Both are modelled as χ² with the
/// number of degrees of freedom that gives this deviation.
fn factors(relative: f64) -> [f64; 2] {
    let freedom = (4.0 / (relative * relative)).max(1.0);
    let factor = if freedom < 100.0 {
        FisherSnedecor::new(freedom, freedom).map_or(f64::INFINITY, |f| f.inverse_cdf(0.975))
    } else {
        (NORMAL_QUANTILE * relative).exp()
    };
    [1.0 / factor, factor]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns the sums of a block with the same value in all channels.
    fn sums(width: usize, height: usize, value: impl Fn(usize, usize) -> [f64; 2]) -> ErrorSums {
        let mut block = PixelBlock::new(width, height, 2);
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
        let estimate = sums.estimate(2).expect("pixels");
        assert!((estimate.relmse - 0.01 / 1.01).abs() < 1e-8, "{estimate:?}");
        // Var(a b) = 4 σ⁴ for each of 256 pixels, which is a relative standard deviation of 2/16.
        let expected = (NORMAL_QUANTILE * 2.0 / 16.0).exp();
        let [low, high] = estimate.interval.map(|e| e / estimate.relmse);
        assert!((high / expected - 1.0).abs() < 1e-3 && (low * expected - 1.0).abs() < 1e-3, "{estimate:?}");
    }

    #[test]
    fn a_firefly_is_compared_with_its_surroundings() {
        let firefly = |x, y| if (x, y) == (7, 9) { [101.0, 100.0] } else { [1.0, 0.01] };
        let estimate = sums(16, 16, firefly).estimate(2).expect("pixels");
        let expected = 100.0 * 100.0 / 1.01 / 256.0;
        assert!((estimate.relmse / expected - 1.0).abs() < 1e-3, "{estimate:?}, {expected}");
        // The outlier may be part of the true image, so the lower bound is small.
        assert!(estimate.interval[0] < 0.01 && estimate.interval[1] > expected, "{estimate:?}");
    }

    #[test]
    fn a_lamp_is_compared_with_itself_and_an_edge_with_its_side() {
        let emitter = |x, y| if (x, y) == (7, 9) { [100.0, 1.0] } else { [0.1, 0.0] };
        let estimate = sums(16, 16, emitter).estimate(2).expect("pixels");
        assert!((estimate.relmse * 256.0 / 1e-4 - 1.0).abs() < 0.01, "{estimate:?}");
        let edge = |x, _| if x < 8 { [0.0, 0.001] } else { [10.0, 0.0] };
        let estimate = sums(16, 16, edge).estimate(2).expect("pixels");
        assert!((estimate.relmse / (0.5 * 1e-4) - 1.0).abs() < 0.01, "{estimate:?}");
    }

    /// By chance, all light of the pixel at the corner of an emitter is in one half of the samples.
    #[test]
    fn a_noisy_edge_of_an_emitter_is_no_firefly() {
        let emitter = |x, y| match (x, y) {
            (8.., 8..) => [100.0, 0.0],
            (7, 7) => [20.0, 20.0],
            _ => [0.1, 0.0],
        };
        let estimate = sums(16, 16, emitter).estimate(2).expect("pixels");
        assert!((estimate.relmse * 256.0 - 1.0).abs() < 0.02, "{estimate:?}");
        assert!(estimate.interval[1] > 2.0 * estimate.relmse, "{estimate:?}");
    }

    #[test]
    fn the_smallest_images_have_wide_intervals_and_no_error_is_none() {
        let estimate = sums(1, 1, |_, _| [1.0, 0.1]).estimate(2).expect("a pixel");
        // One degree of freedom for each half.
        assert!((estimate.interval[1] / estimate.relmse - 647.8).abs() < 1.0, "{estimate:?}");
        assert_eq!(sums(3, 1, |_, _| [1.0, 0.0]).estimate(2), Some(ErrorEstimate::default()));
        assert_eq!(ErrorSums::new(2).estimate(2), None);
    }

    #[test]
    fn extreme_values_stay_finite() {
        let quiet = sums(16, 16, |_, _| [1.0, 0.0]);
        for value in [[1e15, 1e15], [1e30, -1e30], [1e-30, 1e-30], [-1.0, 2.0], [0.0, 1e18], [1.0, 1e-15]] {
            let mut sums = sums(5, 4, |x, _| if x == 2 { value } else { [0.0; 2] });
            sums.merge(&quiet);
            let ErrorEstimate { relmse, interval: [low, high] } = sums.estimate(2).expect("pixels");
            assert!(
                (0.0..=relmse).contains(&low) && relmse <= high && high.is_finite(),
                "{low} {relmse} {high}"
            );
        }
    }
}
