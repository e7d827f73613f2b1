//! The relative squared error of an image, estimated from two independent halves of its samples.
//!
//! Let a and b be the errors of a pixel's halves: independent, of mean zero. The image is their mean, its error is
//! (a + b) / 2, and of that d = (a − b) / 2 is known. The squared error differs from d² by a·b:
//!
//! - d² estimates the squared error without bias, for any sampler and any distribution of the noise;
//! - how far it is off follows from the variance of Σ a·b over the pixels, tr C² = Σᵢⱼ Cov(aᵢ, aⱼ)²: fourth moments,
//!   which a single firefly decides, are not needed. A firefly in one half is in the error and in d² alike.
//!
//! Where pixels are independent, tr C² is a sum over pixels, which the differences of *two* neighbours estimate.
//! Where pixels share noise (photons, caches, light paths), the samples are divided among eight replicates, four in
//! each half, each with photons and caches of its own. The products of differences of two of either half, ⟨r₀ − r₂,
//! r₁ − r₃⟩²/4, estimate tr C² of replicates, whatever their pixels share. What blocks of an image show beyond their
//! single pixels is what neighbours share; what the whole image shows beyond its blocks is shared by all.
//!
//! The error is relative to the true picture r, which is not known. Dividing by the image's own values would make
//! bright errors look small: a firefly would be compared with itself. So r is taken from the pixels around that are alike
//! within the pixel's own noise, each with the less weight the more its halves disagree; a pixel's own value counts as
//! far as both of its halves leave the surroundings to the same side, as edges and lamps do. What remains uncertain
//! about r is part of the interval.

use super::metrics::RELATIVE_FLOOR;
use statrs::distribution::{ContinuousCDF, FisherSnedecor};
use std::ops::Range;

/// Side of the largest block.
pub const BLOCK: usize = 16;
/// The most replicates there are.
pub const MOST_REPLICATES: usize = 8;
/// Pixels of the largest block.
const AREA: usize = BLOCK * BLOCK;
/// Pixels up to this far away, along either axis, tell how bright a pixel is.
const RADIUS: usize = 2;
/// How far apart they are where pixels share noise with their neighbours.
const SHARED_STRIDE: usize = 3;
/// How far away they are at most.
const MARGIN: usize = RADIUS * SHARED_STRIDE;
/// A block with a margin on every side.
const WIDE: usize = BLOCK + 2 * MARGIN;
/// Neighbours are alike if they are no farther than this many standard deviations of the pixel.
const ALIKE: f32 = 4.0;
/// A pixel whose halves differ by more than so many times the mean difference counts little for its neighbours.
const OUTLIER: f32 = 16.0;
/// The share of the correction of the weights, as a logarithm, that the interval allows for. It is not derived:
/// `cargo run --release --example calibration` shows what it brings.
const ALLOWANCE: f64 = 0.15;
/// The same where pixels share noise, and their neighbours err as they do.
const SHARED_ALLOWANCE: f64 = 0.35;
/// How many times what blocks show the whole image shows by chance.
const CHANCE: f64 = 2.0;
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
    /// The standard error; of two replicates with the sign of their difference.
    difference: [Plane; 3],
    /// Of more than two replicates, the deviation of each from the mean.
    deviations: Vec<[Plane; 3]>,
}

/// Inner products of the replicates' deviations.
type Gram = [[f64; MOST_REPLICATES]; MOST_REPLICATES];

/// Sums over blocks.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ErrorSums {
    replicates: usize,
    pixels: u64,
    /// Of the relative squared differences, mean over the channels.
    errors: f64,
    /// The same, relative to the image itself.
    own: f64,
    /// What the errors would lose if outliers were true.
    outliers: f64,
    /// Estimate of the variance of what separates `errors` from the error, by what is known of single blocks.
    variance: f64,
    /// Where pixels share noise, the same of the mean of replicates, by what single pixels show.
    of_pixels: f64,
    /// The same by what blocks show.
    of_blocks: f64,
    /// The variance that comes of doubt about the picture.
    doubt: f64,
    /// Of more than two replicates, over all pixels and channels, relative to the picture.
    gram: Gram,
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
    /// A block of black pixels without errors, of an image of so many replicates.
    ///
    /// # Panics
    /// If a side is 0 or larger than [`BLOCK`], or if there are more replicates than [`MOST_REPLICATES`].
    pub fn new(width: usize, height: usize, replicates: usize) -> Self {
        assert!((1..=BLOCK).contains(&width) && (1..=BLOCK).contains(&height), "{width}x{height}");
        assert!(replicates <= MOST_REPLICATES, "{replicates} replicates");
        let deviations = if replicates > 2 { vec![[[0.0; AREA]; 3]; replicates] } else { Vec::new() };
        Block { width, height, mean: [[0.0; AREA]; 3], difference: [[0.0; AREA]; 3], deviations }
    }

    /// Sets a channel of a pixel: the mean of its replicates and the standard error, which of two replicates has the
    /// sign of their difference. Values beyond ±10^15 count as that.
    #[inline]
    pub fn set(&mut self, x: usize, y: usize, channel: usize, [mean, error]: [f64; 2]) {
        let i = y * BLOCK + x;
        self.mean[channel][i] = mean.clamp(-LARGEST, LARGEST) as f32;
        self.difference[channel][i] = error.clamp(-LARGEST, LARGEST) as f32;
    }

    /// Sets how far a replicate is from the mean in a channel of a pixel.
    #[inline]
    pub fn set_deviation(&mut self, x: usize, y: usize, channel: usize, replicate: usize, deviation: f64) {
        self.deviations[replicate][channel][y * BLOCK + x] = deviation.clamp(-LARGEST, LARGEST) as f32;
    }

    /// The sums of the block.
    pub fn sums(&self) -> ErrorSums {
        let replicates = self.deviations.len().max(2);
        let mut sums = ErrorSums { pixels: (self.width * self.height) as u64, ..ErrorSums::new(replicates) };
        let picture = self.picture();
        self.add_errors(&mut sums, &picture);
        let scales = picture.weights.map(|plane| plane.map(f32::sqrt));
        sums.variance = self.products(&multiplied(&self.difference, &scales));
        if replicates > 2 {
            self.add_shared(&mut sums, &scales);
        }
        sums
    }

    /// Adds what replicates say of the noise that pixels share, each channel and pixel multiplied by its scale.
    fn add_shared(&self, sums: &mut ErrorSums, scales: &[Plane; 3]) {
        let scaled: Vec<[Plane; 3]> = self.deviations.iter().map(|d| multiplied(d, scales)).collect();
        sums.gram = gram(&scaled, 0..AREA);
        sums.of_blocks = variance_by_pairs(&sums.gram, scaled.len());
        let single = |i: usize| variance_by_pairs(&gram(&scaled, i..i + 1), scaled.len());
        sums.of_pixels = self.indices().map(single).sum();
    }

    /// Adds errors relative to a picture.
    fn add_errors(&self, sums: &mut ErrorSums, picture: &Picture) {
        let trust = self.trust();
        let floor = RELATIVE_FLOOR as f32;
        for i in self.indices() {
            let (mut error, mut own, mut doubt) = (0.0, 0.0, 0.0);
            for c in 0..3 {
                let squared = self.difference[c][i] * self.difference[c][i];
                error += picture.weights[c][i] * squared;
                own += squared / (self.mean[c][i] * self.mean[c][i] + floor);
                doubt += picture.doubts[c][i] * squared;
            }
            sums.errors += f64::from(error) / 3.0;
            sums.own += f64::from(own) / 3.0;
            sums.outliers += f64::from((1.0 - trust[i]) * (error - own).max(0.0)) / 3.0;
            sums.doubt += (f64::from(doubt) / 3.0).powi(2);
        }
    }

    /// The picture that errors are relative to, as far as it is known.
    fn picture(&self) -> Picture {
        let Surroundings { mean, spread } = self.surroundings();
        let mut picture = Picture { weights: [[0.0; AREA]; 3], doubts: [[0.0; AREA]; 3] };
        let floor = RELATIVE_FLOOR as f32;
        for i in self.indices() {
            let offset = [0, 1, 2].map(|c| self.mean[c][i] - mean[c][i]);
            // 1 − σ²/(x − m)², m the surroundings: the share of the offset that is not noise.
            let common = 1.0 - self.noise(i) / norm_squared(offset).max(f32::MIN_POSITIVE);
            let common = common.max(0.0);
            for c in 0..3 {
                let r = mean[c][i] + common * offset[c];
                let weight = 1.0 / (r * r + floor);
                // Half the range of the weights over r ± s, relative to their middle.
                let s = (1.0 - common) * spread[c][i];
                picture.weights[c][i] = weight;
                picture.doubts[c][i] = weight * (2.0 * r.abs() * s / (r * r + s * s + floor));
            }
        }
        picture
    }

    /// How far each pixel is trusted by others.
    fn trust(&self) -> Plane {
        let typical = self.indices().map(|i| self.noise(i).sqrt()).sum::<f32>();
        let pixels = (self.width * self.height) as f32;
        let scale = if typical > 0.0 { pixels / (OUTLIER * typical) } else { 0.0 };
        let mut trust = [0.0; AREA];
        for i in self.indices() {
            let t = (self.noise(i).sqrt() * scale).powi(2);
            trust[i] = 1.0 / (1.0 + t * t);
        }
        trust
    }

    /// What the neighbours of each pixel say of it.
    fn surroundings(&self) -> Surroundings {
        let trust = self.trust();
        let padded_trust = padded(&trust);
        let x = [0, 1, 2].map(|c| padded(&self.mean[c]));
        let mut result = Surroundings { mean: self.mean, spread: [[0.0; AREA]; 3] };
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
        let stride = if self.deviations.is_empty() { 1 } else { SHARED_STRIDE };
        let corner = MARGIN - RADIUS * stride;
        let mut sums = RowSums::default();
        for dy in 0..=2 * RADIUS {
            for dx in 0..=2 * RADIUS {
                if (dx, dy) == (RADIUS, RADIUS) {
                    continue;
                }
                let start = (y + corner + dy * stride) * WIDE + corner + dx * stride;
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
}

/// What squared errors are multiplied by to be relative.
struct Picture {
    weights: [Plane; 3],
    /// How uncertain the weights are.
    doubts: [Plane; 3],
}

fn multiplied(planes: &[Plane; 3], by: &[Plane; 3]) -> [Plane; 3] {
    std::array::from_fn(|c| std::array::from_fn(|i| planes[c][i] * by[c][i]))
}

/// Inner products of the planes of replicates over some of the pixels, the mean over the channels.
fn gram(planes: &[[Plane; 3]], pixels: Range<usize>) -> Gram {
    let mut gram = [[0.0; MOST_REPLICATES]; MOST_REPLICATES];
    for (r, a) in planes.iter().enumerate() {
        for (s, b) in planes.iter().enumerate().take(r + 1) {
            let dot = |c: usize| {
                let products = a[c][pixels.clone()].iter().zip(&b[c][pixels.clone()]);
                products.map(|(a, b)| f64::from(*a) * f64::from(*b)).sum::<f64>()
            };
            let sum = (dot(0) + dot(1) + dot(2)) / 3.0;
            (gram[r][s], gram[s][r]) = (sum, sum);
        }
    }
    gram
}

/// The variance of what separates the squared error of the mean of replicates from its estimate, 2·tr C²/(R(R − 1)),
/// with the mean of ⟨a − b, c − d⟩²/4 for tr C², a and b of the even replicates, c and d of the odd ones: those of
/// one half of the samples may be parts of one low-discrepancy sequence, and are not independent.
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

/// A plane with a margin of zeros.
fn padded(plane: &Plane) -> [f32; WIDE * WIDE] {
    let mut wide = [0.0; WIDE * WIDE];
    for y in 0..BLOCK {
        let start = (y + MARGIN) * WIDE + MARGIN;
        wide[start..start + BLOCK].copy_from_slice(&plane[y * BLOCK..(y + 1) * BLOCK]);
    }
    wide
}

impl ErrorSums {
    /// Sums over no pixels of an image of so many replicates.
    pub fn new(replicates: usize) -> Self {
        ErrorSums {
            replicates,
            pixels: 0,
            errors: 0.0,
            own: 0.0,
            of_pixels: 0.0,
            of_blocks: 0.0,
            outliers: 0.0,
            variance: 0.0,
            doubt: 0.0,
            gram: [[0.0; MOST_REPLICATES]; MOST_REPLICATES],
        }
    }

    /// Adds the sums of another part of the image.
    pub fn merge(&mut self, other: &ErrorSums) {
        self.pixels += other.pixels;
        self.errors += other.errors;
        self.own += other.own;
        self.of_pixels += other.of_pixels;
        self.of_blocks += other.of_blocks;
        self.outliers += other.outliers;
        self.variance += other.variance;
        self.doubt += other.doubt;
        for (sum, other) in self.gram.as_flattened_mut().iter_mut().zip(other.gram.as_flattened()) {
            *sum += other;
        }
    }

    /// The estimate, given how many replicates have samples; `None` without pixels, or with less than two of them.
    pub fn estimate(&self, filled: usize) -> Option<ErrorEstimate> {
        if self.pixels == 0 || filled < 2 {
            return None;
        }
        if self.errors == 0.0 {
            return Some(ErrorEstimate::default());
        }
        let shared = match self.replicates {
            2 => 0.0,
            replicates if filled == replicates => {
                let near = (self.of_blocks - self.of_pixels).max(0.0);
                // What is far apart is known by one value only, and counts where that is clearly more than chance.
                let far = (variance_by_pairs(&self.gram, filled) - CHANCE * self.of_blocks).max(0.0);
                // From the mean of replicates to the difference of two halves of them.
                2.0 * (filled - 1) as f64 / filled as f64 * (near + far)
            }
            // Nothing is known of what pixels share: as if it were everything.
            _ => f64::INFINITY,
        };
        let relmse = self.errors / self.pixels as f64;
        let [low, high] = factors((self.variance + shared + self.doubt).sqrt() / self.errors);
        let allowance = if self.replicates > 2 { SHARED_ALLOWANCE } else { ALLOWANCE };
        let weights = (allowance * (self.errors / self.own).ln().abs()).exp();
        let without_outliers = (1.0 - self.outliers / self.errors).clamp(0.0, 1.0);
        Some(ErrorEstimate {
            relmse,
            interval: [relmse * without_outliers * low / weights, relmse * high * weights],
        })
    }
}

/// The factors that leave 2.5 % on either side of the ratio of the error and its estimate, whose difference has the
/// given relative standard deviation: both behave as χ² with as many degrees of freedom as give that deviation.
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

    /// Sums of a block with one value in all channels.
    fn sums(width: usize, height: usize, value: impl Fn(usize, usize) -> [f64; 2]) -> ErrorSums {
        let mut block = Block::new(width, height, 2);
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
        // Var(a b) = 4 σ⁴ for each of 256 pixels: a relative deviation of 2/16.
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
        // That it is the picture, and not an error, remains possible.
        assert!(estimate.interval[0] < 0.01 && estimate.interval[1] > expected, "{estimate:?}");
    }

    #[test]
    fn a_lamp_is_compared_with_itself_and_an_edge_with_its_side() {
        let lamp = |x, y| if (x, y) == (7, 9) { [100.0, 1.0] } else { [0.1, 0.0] };
        let estimate = sums(16, 16, lamp).estimate(2).expect("pixels");
        assert!((estimate.relmse * 256.0 / 1e-4 - 1.0).abs() < 0.01, "{estimate:?}");
        let edge = |x, _| if x < 8 { [0.0, 0.001] } else { [10.0, 0.0] };
        let estimate = sums(16, 16, edge).estimate(2).expect("pixels");
        assert!((estimate.relmse / (0.5 * 1e-4) - 1.0).abs() < 0.01, "{estimate:?}");
    }

    #[test]
    fn the_smallest_images_have_wide_intervals_and_no_error_is_none() {
        let estimate = sums(1, 1, |_, _| [1.0, 0.1]).estimate(2).expect("a pixel");
        // One degree of freedom on either side.
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
