//! Sums over the pixels of a block, and their test by Student's t.

use super::noise::{ImageNoise, SharedNoise};
use super::rounding::Rounding;
use crate::estimate::student::{quantile, tail};
use crate::image::Image;

/// The reference and the data for the comparison.
pub(super) struct ImagePair<'a> {
    pub r: &'a Image,
    /// The noise of the first image and of the second.
    pub noise: &'a [Option<ImageNoise>; 2],
    pub rounding: [Rounding; 2],
    pub sample_ratio: Option<f64>,
}

/// The ratio between rounding and standard deviation below which rounding is ignored.
const NEGLIGIBLE: f64 = 1e-5;

/// A variance with its uncertainty.
#[derive(Clone, Copy, Default)]
struct VarianceEstimate {
    variance: f64,
    /// Half the variance of the variance: Σ v²/ν.
    uncertainty: f64,
}

impl VarianceEstimate {
    fn freedom(self) -> f64 {
        // If the squared variance underflows, one degree of freedom is assumed.
        let freedom = self.variance * self.variance / self.uncertainty;
        if freedom.is_finite() { freedom.max(1.0) } else { 1.0 }
    }

    fn plus(self, other: VarianceEstimate) -> VarianceEstimate {
        VarianceEstimate {
            variance: self.variance + other.variance,
            uncertainty: self.uncertainty + other.uncertainty,
        }
    }

    fn times(self, factor: f64) -> VarianceEstimate {
        VarianceEstimate { variance: self.variance * factor, uncertainty: self.uncertainty * factor * factor }
    }
}

/// Sums over the pixels of a block in one channel.
#[derive(Clone, Copy, Default)]
pub(super) struct BlockSums {
    pub difference: f64,
    pub reference: f64,
    /// The upper bound of the effect of rounding on the difference.
    rounding: f64,
    /// The largest relative difference of two values: |a − b| beyond rounding, divided by the larger magnitude.
    /// Infinite if a value is NaN or infinite.
    pub largest: f64,
    /// For independent pixels of either image and of both: the sum of variances, and that of their squares.
    by_pixels: [[f64; 2]; 3],
    /// For images whose pixels share noise.
    shared: [Option<VarianceEstimate>; 2],
    /// The expected ratio between the variance of both images together and that of the second.
    expected: Option<f64>,
}

impl BlockSums {
    /// Adds the value with index `i`; `x` is the first image.
    pub fn add(&mut self, x: &Image, images: &ImagePair<'_>, i: usize) {
        let (a, b) = (x.data[i], images.r.data[i]);
        let difference = f64::from(a) - f64::from(b);
        let rounding = images.rounding[0].bound(a) + images.rounding[1].bound(b);
        self.difference += difference;
        self.reference += f64::from(b);
        self.rounding += rounding;
        self.largest = self.largest.max(relative(f64::from(a), f64::from(b), rounding));
        self.expected = images.sample_ratio.map(|ratio| 1.0 + ratio);
        let mut both = 0.0;
        for (k, noise) in images.noise.iter().enumerate() {
            let Some(ImageNoise { variances, shared }) = noise else { continue };
            let v = f64::from(variances.data[i]);
            match shared {
                Some(SharedNoise { freedom, .. }) => {
                    let variance = self.shared[k].unwrap_or_default().variance + v;
                    self.shared[k] =
                        Some(VarianceEstimate { variance, uncertainty: variance * variance / freedom });
                }
                None => {
                    self.by_pixels[k][0] += v;
                    self.by_pixels[k][1] += v * v;
                    both += v;
                }
            }
        }
        self.by_pixels[2][0] += both;
        self.by_pixels[2][1] += both * both;
    }

    /// Sets the variances of the sums over the whole image, if its pixels share noise.
    pub fn set_whole_image(&mut self, images: &ImagePair<'_>, channel: usize) {
        for (spread, noise) in self.shared.iter_mut().zip(images.noise) {
            if let Some(SharedNoise { freedom, of_sum }) = noise.as_ref().and_then(|n| n.shared.as_ref()) {
                let variance = of_sum[channel];
                *spread = Some(VarianceEstimate { variance, uncertainty: variance * variance / freedom });
            }
        }
    }

    /// Returns the variance of a sum, from variances of single pixels with one degree of freedom each.
    fn pixel_estimate(&self, k: usize) -> VarianceEstimate {
        let [variance, squares] = self.by_pixels[k];
        // ν = 3·(Σv)²/Σv² − 2.
        let freedom = 3.0 * variance * variance / squares - 2.0;
        let freedom = if freedom.is_finite() { freedom.max(1.0) } else { 1.0 };
        VarianceEstimate { variance, uncertainty: variance * variance / freedom }
    }

    /// Returns the variance of the difference: the larger one of the estimated and the expected variance.
    fn spread(&self) -> VarianceEstimate {
        let found =
            self.shared.iter().flatten().fold(self.pixel_estimate(2), |sum, spread| sum.plus(*spread));
        let of_second = self.shared[1].unwrap_or_else(|| self.pixel_estimate(1));
        match self.expected.map(|factor| of_second.times(factor)) {
            Some(expected) if expected.variance > found.variance => expected,
            _ => found,
        }
    }

    pub fn variance(&self) -> f64 {
        self.spread().variance
    }

    /// Returns z; NaN if the difference is NaN. The block must have a variance.
    pub fn z(&self) -> f64 {
        let deviation = self.variance().sqrt();
        let rounding = if self.rounding > NEGLIGIBLE * deviation { self.rounding } else { 0.0 };
        let beyond = self.difference.abs() - rounding;
        // `f64::max` would drop a NaN.
        if beyond < 0.0 { 0.0 } else { beyond.copysign(self.difference) / deviation }
    }

    /// Returns the degrees of freedom of the variance.
    fn freedom(&self) -> f64 {
        self.spread().freedom()
    }

    /// Returns the p-value of a block with a variance; 0 if z is NaN or infinite.
    pub fn probability(&self) -> f64 {
        let z = self.z();
        if z.is_finite() { tail(z, self.freedom()) } else { 0.0 }
    }

    /// Returns the least relative difference of the block's sum that is detected at a significance with a probability
    /// of 0.95.
    pub fn gain(&self, significance: f64) -> f64 {
        /// The 95 % quantile of the standard normal distribution.
        const POWER: f64 = 1.644_853_627;
        let variance = self.variance();
        let far_out = if variance > 0.0 { quantile(significance, self.freedom()) + POWER } else { 0.0 };
        (far_out * variance.sqrt() + self.rounding) / self.reference.abs()
    }
}

/// Returns |a − b| beyond rounding, divided by the larger magnitude.
fn relative(a: f64, b: f64, rounding: f64) -> f64 {
    let difference = (a - b).abs();
    if !difference.is_finite() {
        f64::INFINITY
    } else if difference <= rounding {
        0.0
    } else {
        (difference - rounding) / a.abs().max(b.abs())
    }
}
