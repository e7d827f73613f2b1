//! Error metrics of an image against a reference.
//!
//! All functions take the image's values `x` and the reference's values `r` in the same order. They compute in `f64`
//! with compensated sums and return NaN for empty slices. A NaN value makes the result NaN, so callers count such
//! values first. All panic if the slices differ in length.

/// The constant that keeps the relative squared error finite for a black reference.
pub const RELATIVE_FLOOR: f64 = 0.01;

/// The fraction of pixels with the largest errors that [`trimmed_relmse`] excludes.
pub const TRIMMED_SHARE: f64 = 1e-3;

/// A compensated sum. [Neumaier 1974]
#[derive(Clone, Copy, Default)]
struct CompensatedSum {
    sum: f64,
    lost: f64,
}

impl CompensatedSum {
    fn add(&mut self, value: f64) {
        let sum = self.sum + value;
        self.lost +=
            if self.sum.abs() >= value.abs() { (self.sum - sum) + value } else { (value - sum) + self.sum };
        self.sum = sum;
    }

    fn total(self) -> f64 {
        self.sum + self.lost
    }
}

/// Returns the mean of the values, or NaN if there are none.
fn mean(values: impl Iterator<Item = f64>) -> f64 {
    let (mut sum, mut count) = (CompensatedSum::default(), 0u64);
    for value in values {
        sum.add(value);
        count += 1;
    }
    sum.total() / count as f64
}

/// Iterates over pairs of values as `f64`.
fn pairs<'a>(x: &'a [f32], r: &'a [f32]) -> impl Iterator<Item = (f64, f64)> + 'a {
    assert_eq!(x.len(), r.len(), "image and reference differ in their number of values");
    x.iter().zip(r).map(|(&x, &r)| (f64::from(x), f64::from(r)))
}

/// Returns the mean absolute difference.
pub fn mean_absolute(x: &[f32], r: &[f32]) -> f64 {
    mean(pairs(x, r).map(|(x, r)| (x - r).abs()))
}

/// Returns the mean squared error.
pub fn mse(x: &[f32], r: &[f32]) -> f64 {
    mean(pairs(x, r).map(|(x, r)| (x - r) * (x - r)))
}

/// Returns the largest value of both images, at least 1, as the peak for [`psnr`].
pub fn peak(x: &[f32], r: &[f32]) -> f64 {
    pairs(x, r).fold(1.0, |peak: f64, (x, r)| peak.max(x).max(r))
}

/// Returns the peak signal-to-noise ratio in dB, 10·log₁₀(peak² / mse); infinite for equal images.
pub fn psnr(mse: f64, peak: f64) -> f64 {
    10.0 * (peak * peak / mse).log10()
}

/// Returns the relative squared error of one value: (x − r)² / (r² + 0.01).
#[inline]
pub fn relative_squared(x: f64, r: f64) -> f64 {
    (x - r) * (x - r) / (r * r + RELATIVE_FLOOR)
}

/// Returns the mean over pixels and channels of (x − r)² / (r² + 0.01).
pub fn relmse(x: &[f32], r: &[f32]) -> f64 {
    mean(pairs(x, r).map(|(x, r)| relative_squared(x, r)))
}

/// Returns the relative squared error of each pixel: the mean over its `channels` interleaved values.
///
/// # Panics
/// If `channels` is 0.
pub fn relative_by_pixel(x: &[f32], r: &[f32], channels: usize) -> Vec<f64> {
    assert_eq!(x.len(), r.len(), "image and reference differ in their number of values");
    x.chunks_exact(channels)
        .zip(r.chunks_exact(channels))
        .map(|(x, r)| mean(pairs(x, r).map(|(x, r)| relative_squared(x, r))))
        .collect()
}

/// Returns [`relmse`] without the 0.1 % of pixels (rounded up) with the largest errors, so that a few fireflies do
/// not dominate it. A pixel has `channels` values.
///
/// # Panics
/// If `channels` is 0.
pub fn trimmed_relmse(x: &[f32], r: &[f32], channels: usize) -> f64 {
    let mut errors = relative_by_pixel(x, r, channels);
    errors.sort_unstable_by(f64::total_cmp);
    let dropped = (errors.len() as f64 * TRIMMED_SHARE).ceil() as usize;
    mean(errors[..errors.len() - dropped].iter().copied())
}

/// Returns the mean of `x` divided by the mean of `r`: 1 for an unbiased image, NaN if both are black.
pub fn mean_ratio(x: &[f32], r: &[f32]) -> f64 {
    assert_eq!(x.len(), r.len(), "image and reference differ in their number of values");
    mean(x.iter().map(|&v| f64::from(v))) / mean(r.iter().map(|&v| f64::from(v)))
}

/// The largest absolute difference and its position.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LargestDifference {
    /// The absolute value of the difference.
    pub value: f64,
    /// The index of the value in the slices; the first one of several equal values.
    pub index: usize,
}

/// Finds the largest absolute difference; 0 at index 0 for equal or empty slices. NaN differences are ignored.
pub fn largest_difference(x: &[f32], r: &[f32]) -> LargestDifference {
    pairs(x, r).enumerate().fold(LargestDifference { value: 0.0, index: 0 }, |largest, (index, (x, r))| {
        let value = (x - r).abs();
        if value > largest.value { LargestDifference { value, index } } else { largest }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    // The differences from these references are 0.5, 0, -1, 0.
    const X: [f32; 4] = [1.5, 2.0, 0.0, 0.0];
    const R: [f32; 4] = [1.0, 2.0, 1.0, 0.0];

    #[test]
    fn the_metrics_are_what_the_hand_computes() {
        assert_eq!(mean_absolute(&X, &R), 1.5 / 4.0);
        assert_eq!(mse(&X, &R), 1.25 / 4.0);
        let by_hand = (0.25 / 1.01 + 1.0 / 1.01) / 4.0;
        assert!((relmse(&X, &R) - by_hand).abs() < 1e-15);
        assert_eq!(peak(&X, &R), 2.0);
        assert_eq!(peak(&[0.25], &[-3.0]), 1.0);
        assert!((psnr(0.01, 1.0) - 20.0).abs() < 1e-12);
        assert!((psnr(0.04, 2.0) - 20.0).abs() < 1e-12);
        assert_eq!(psnr(0.0, 1.0), f64::INFINITY);
        assert_eq!(mean_ratio(&X, &R), 3.5 / 4.0);
        assert_eq!(largest_difference(&X, &R), LargestDifference { value: 1.0, index: 2 });
        assert_eq!(largest_difference(&R, &R), LargestDifference { value: 0.0, index: 0 });
    }

    #[test]
    fn a_black_reference_gives_a_finite_relative_error() {
        assert!((relmse(&[0.1], &[0.0]) - 1.0).abs() < 1e-6);
    }

    #[test]
    fn the_worst_thousandth_is_trimmed_by_whole_pixels_and_rounded_up() {
        let r = vec![1.0f32; 3 * 2000];
        let mut x = r.clone();
        for pixel in [7, 400, 1999] {
            x[3 * pixel + 1] = 1.0 + pixel as f32;
        }
        // Of 2000 pixels, the two worst are excluded; the error of pixel 7 remains.
        let expected = (49.0 / 1.01) / 3.0 / 1998.0;
        assert!((trimmed_relmse(&x, &r, 3) - expected).abs() < 1e-12);
        // A single pixel is excluded too.
        assert!(trimmed_relmse(&[1.0], &[1.0], 1).is_nan());
        assert_eq!(trimmed_relmse(&[1.0, 9.0], &[1.0, 1.0], 1), 0.0);
    }

    #[test]
    fn sums_lose_nothing_to_large_neighbours() {
        let mut sum = CompensatedSum::default();
        for value in [1e17, 1.0, -1e17, 1.0] {
            sum.add(value);
        }
        assert_eq!(sum.total(), 2.0);
    }

    #[test]
    fn a_nan_is_never_averaged_away() {
        assert!(mse(&[f32::NAN, 1.0], &[1.0, 1.0]).is_nan());
        assert!(relmse(&[1.0, 1.0], &[1.0, f32::NAN]).is_nan());
        assert!(mse(&[], &[]).is_nan());
    }

    #[test]
    #[should_panic(expected = "differ in their number of values")]
    fn slices_of_different_length_are_refused() {
        mse(&[1.0], &[1.0, 2.0]);
    }
}
