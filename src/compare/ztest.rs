//! A z-test: whether two images are estimates of the same image, given their variances.

use super::block::{BlockSums, ImagePair};
use super::images::{Location, NotComparable, VARIANCE, layer_channels, location};
use super::noise::{ImageNoise, noise_of, variance_of};
use super::rounding::Rounding;
use crate::estimate::student::{of_all, share};
use crate::image::Image;

/// The result of a z-test of the base layer, in blocks of [`ZTest::SIDE`]² pixels, with each channel separately.
///
/// z = Σ(a − b) / √Σ(var a + var b) over the pixels of a block, where a variance is that of the stored value (not of
/// a single sample). A variance estimated from two halves has one degree of freedom, so the distribution of z for
/// single pixels would have no mean. The sum over a block has ν = 3·(Σv)²/Σv² − 2 degrees of freedom [Satterthwaite
/// 1946, with the squares of such estimates three times too large]. If pixels share noise, the variance of a block
/// comes from its replicates, and ν is the number of replicates minus 1. A block is accepted if Student's t with ν
/// degrees of freedom exceeds |z| with a probability of at least α′. With α′ = 1 − (1 − α)^(1/n) [Šidák 1967], α is
/// the probability that any of the n blocks is rejected although both images have the same expected value.
///
/// The largest possible effect of rounding (half a step of the format for each stored value, summed over the block)
/// is subtracted from |Σ(a − b)|, because the rounding error of a smooth image is not noise. Images in which all
/// values are halves are assumed to be rounded to halves.
///
/// A block has no variance if all samples of its pixels had the same value, in both images. It has no z. It is
/// accepted if no two values differ by more than [`ZTest::SAME`] of the larger one, beyond rounding.
#[derive(Clone, Debug, PartialEq)]
pub struct ZTest {
    /// α, the significance of the whole test.
    pub significance: f64,
    /// The number of blocks, over all channels.
    pub blocks: usize,
    /// The number of rejected blocks.
    pub rejected: usize,
    /// The fraction of accepted blocks.
    pub accepted: f64,
    /// The probability that some block with a variance deviates as much as the worst one, for images with the same
    /// expected value; 0 if a block has a NaN.
    pub block_probability: f64,
    /// The mean of z over blocks with a variance: about 0 ± 1/√n for unbiased images.
    pub mean: f64,
    /// The root mean square of z over blocks with a variance: slightly above 1 for correct variances.
    pub rms: f64,
    /// The largest |z| of a channel with the whole image as one block. It detects a bias that is too small for any
    /// single block.
    pub bias: f64,
    /// The least p-value of a channel's bias.
    pub bias_probability: f64,
    /// The channel with the least p-value, and its Σ(a − b) / Σb; `None` without any variance.
    pub bias_at: Option<(String, f64)>,
    /// The least relative difference of the means that the test detects in some channel with a probability of 0.95,
    /// for these variances; infinite if the reference is black.
    pub gain: f64,
    /// The largest |z| of the blocks with a variance; infinite if a value is NaN or infinite.
    pub max: f64,
    /// The first pixel of that block, and its channel.
    pub max_at: Location,
    /// The number of blocks without variance in either image.
    pub without_variance: usize,
    /// The number of rejected blocks among them.
    pub unequal: usize,
    /// The largest relative difference of two values in blocks without variance, and the first pixel of that block;
    /// `None` if no such block differs.
    pub unequal_at: Option<(f64, Location)>,
    /// The z of each pixel's block, for the channels of the base layer. Of a block without variance it is 0 if the
    /// block is accepted, and otherwise infinite.
    pub scores: Image,
}

impl ZTest {
    /// The fraction of blocks that must be accepted, as in Mitsuba's render tests. It allows for a few outliers of a
    /// heavy-tailed estimator.
    pub const ENOUGH: f64 = 0.9975;
    /// The largest relative difference between values without variance that are accepted as equal.
    pub const SAME: f64 = 1e-3;
    /// The side of a block in pixels.
    pub const SIDE: usize = 4;

    /// Returns whether enough blocks are accepted and no channel is biased at the test's significance.
    pub fn passes(&self) -> bool {
        self.accepted >= Self::ENOUGH && self.is_unbiased()
    }

    /// Returns whether no channel is biased at the test's significance.
    pub fn is_unbiased(&self) -> bool {
        self.bias_probability >= share(self.significance, self.scores.channels.len())
    }
}

/// The options of a z-test.
#[derive(Clone, Copy, Debug)]
pub struct ZTestOptions<'a> {
    /// An image with the variances of the second image in its channels `R`, `G`, `B` or `Y` (or in its layer
    /// `variance`). Without it, the second image's own layer `variance` is used.
    pub variance_of_b: Option<&'a Image>,
    /// The significance of all blocks together, and of all channels' biases together.
    pub significance: f64,
    /// The number of samples of the second image divided by that of the first, if both are estimates by the same
    /// method. The first image's variance is then expected to be the second's times this ratio. Where its estimate is
    /// lower, the expected variance is used, because an image that missed rare contributions underestimates its
    /// variance.
    pub sample_ratio: Option<f64>,
}

/// Tests whether two images estimate the same image. Variances are taken from the layer `variance` of either image
/// and from `variance_of_b`, an image with the variances of `b` in its channels `R`, `G`, `B` or `Y` (or in its layer
/// `variance`). An image without variances is assumed to be exact.
///
/// # Errors
/// If the images differ in size or in the channels of the base layer, have no base layer, or both lack a variance, or
/// if a variance is negative or not finite.
///
/// # Panics
/// If `significance` is not between 0 and 1.
pub fn z_test(
    a: &Image,
    b: &Image,
    variance_of_b: Option<&Image>,
    significance: f64,
) -> Result<ZTest, NotComparable> {
    z_test_with(a, b, &ZTestOptions { variance_of_b, significance, sample_ratio: None })
}

/// Performs a [`z_test`] with all options.
///
/// # Errors
/// As [`z_test`].
///
/// # Panics
/// If the significance is not between 0 and 1.
pub fn z_test_with(a: &Image, b: &Image, options: &ZTestOptions<'_>) -> Result<ZTest, NotComparable> {
    let ZTestOptions { variance_of_b, significance, sample_ratio } = *options;
    assert!(significance > 0.0 && significance < 1.0, "a significance of {significance}");
    for other in std::iter::once(b).chain(variance_of_b) {
        if (a.width, a.height) != (other.width, other.height) {
            return Err(NotComparable::Size([a.width, a.height], [other.width, other.height]));
        }
    }
    let names = layer_channels(a, "");
    let differ = || NotComparable::Channels(a.channels.clone(), b.channels.clone());
    let x = a.select(&names).filter(|_| !names.is_empty()).ok_or_else(differ)?;
    let r = b.select(&names).ok_or_else(differ)?;
    let of_b = match variance_of_b {
        Some(image) => Some(ImageNoise::by_pixels(
            variance_of(image, &names)
                .or_else(|| image.select(&names))
                .ok_or_else(|| NotComparable::Channels(a.channels.clone(), image.channels.clone()))?,
        )),
        None => noise_of(b, &names)?,
    };
    let noise = [noise_of(a, &names)?, of_b];
    if noise.iter().all(Option::is_none) {
        return Err(NotComparable::NoVariance(names.iter().map(|c| format!("{VARIANCE}.{c}")).collect()));
    }
    for ImageNoise { variances, .. } in noise.iter().flatten() {
        if let Some(index) = variances.data.iter().position(|v| !(v.is_finite() && *v >= 0.0)) {
            return Err(NotComparable::BadVariance(location(variances, index)));
        }
    }
    let rounding = [Rounding::of(&x), Rounding::of(&r)];
    Ok(summarise(x, &ImagePair { r: &r, noise: &noise, rounding, sample_ratio }, significance))
}

/// Computes the scores of all blocks. `x` becomes the image of the scores.
fn summarise(mut x: Image, images: &ImagePair<'_>, significance: f64) -> ZTest {
    let channels = x.channels.len();
    let (columns, rows) = (x.width.div_ceil(ZTest::SIDE), x.height.div_ceil(ZTest::SIDE));
    let n = columns * rows * channels;
    let each = share(significance, n);
    let (mut accepted, mut without_variance, mut unequal) = (0, 0, 0);
    let (mut largest, mut largest_index) = (0.0, 0);
    let mut whole = vec![BlockSums::default(); channels];
    let (mut sum, mut squares, mut least) = (0.0, 0.0, 1f64);
    let (mut max, mut max_index) = (0.0, 0);
    for corner in 0..columns * rows {
        for (channel, whole) in whole.iter_mut().enumerate() {
            let indices = indices_of(&x, corner, channel);
            let mut block = BlockSums::default();
            for &i in &indices {
                block.add(&x, images, i);
                whole.add(&x, images, i);
            }
            let z = if block.variance() > 0.0 {
                let (z, probability) = (block.z(), block.probability());
                sum += z;
                squares += z * z;
                accepted += usize::from(probability >= each);
                least = least.min(probability);
                let size = if z.is_nan() { f64::INFINITY } else { z.abs() };
                if size > max {
                    (max, max_index) = (size, indices[0]);
                }
                z
            } else {
                let differs = block.largest > ZTest::SAME;
                without_variance += 1;
                unequal += usize::from(differs);
                accepted += usize::from(!differs);
                if block.largest > largest {
                    (largest, largest_index) = (block.largest, indices[0]);
                }
                if differs { f64::INFINITY } else { 0.0 }
            };
            indices.into_iter().for_each(|i| x.data[i] = z as f32);
        }
    }
    whole.iter_mut().enumerate().for_each(|(channel, whole)| whole.set_whole_image(images, channel));
    let with_variance = (n - without_variance) as f64;
    let gain = whole.iter().map(|c| c.gain(share(significance, channels))).fold(f64::INFINITY, f64::min);
    let ChannelBias { z, probability, at } = bias(&whole, &x.channels);
    ZTest {
        significance,
        blocks: n,
        rejected: n - accepted,
        accepted: accepted as f64 / n as f64,
        block_probability: of_all(least, n),
        mean: sum / with_variance,
        rms: (squares / with_variance).sqrt(),
        bias: z,
        bias_probability: probability,
        bias_at: at,
        gain,
        max,
        max_at: location(&x, max_index),
        without_variance,
        unequal,
        unequal_at: (largest > 0.0).then(|| (largest, location(&x, largest_index))),
        scores: x,
    }
}

/// Returns the indices of a channel's values in a block; blocks are numbered row by row.
fn indices_of(image: &Image, block: usize, channel: usize) -> Vec<usize> {
    let columns = image.width.div_ceil(ZTest::SIDE);
    let (x0, y0) = (block % columns * ZTest::SIDE, block / columns * ZTest::SIDE);
    let (x1, y1) = ((x0 + ZTest::SIDE).min(image.width), (y0 + ZTest::SIDE).min(image.height));
    let pixels = (y0..y1).flat_map(|y| (x0..x1).map(move |x| y * image.width + x));
    pixels.map(|pixel| pixel * image.channels.len() + channel).collect()
}

/// The result of the test of the channels' sums.
struct ChannelBias {
    z: f64,
    probability: f64,
    at: Option<(String, f64)>,
}

/// Tests the bias of the channels with a variance. Differences in other channels are found by the blocks.
fn bias(whole: &[BlockSums], channels: &[String]) -> ChannelBias {
    let mut found = ChannelBias { z: 0.0, probability: 1.0, at: None };
    for (block, channel) in whole.iter().zip(channels).filter(|(block, _)| block.variance() > 0.0) {
        let probability = block.probability();
        found.z = found.z.max(block.z().abs());
        if found.at.is_none() || probability < found.probability {
            found.probability = probability.min(found.probability);
            found.at = Some((channel.clone(), block.difference / block.reference));
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Creates two images of n blocks whose differences are `z` standard deviations, with equal variances.
    fn images(zs: &[f32]) -> (Image, Image) {
        let mut a = Image::new(4 * zs.len(), 4, &["Y", "variance.Y"]);
        let mut b = Image::new(4 * zs.len(), 4, &["Y", "variance.Y"]);
        for (i, z) in zs.iter().enumerate() {
            for (x, y) in (0..16).map(|k| (4 * i + k % 4, k / 4)) {
                // The variances 0.09 and 0.16 give a standard deviation of 0.5, and a quarter of it for the mean of
                // sixteen.
                a.pixel_mut(x, y).copy_from_slice(&[1.0 + 0.125 * z, 0.09]);
                b.pixel_mut(x, y).copy_from_slice(&[1.0, 0.16]);
            }
        }
        (a, b)
    }

    #[test]
    fn scores_are_differences_over_the_standard_deviation_of_both() {
        let (a, b) = images(&[0.0, 2.0, -1.0, 1.0]);
        let test = z_test(&a, &b, None, 0.01).unwrap();
        assert!((test.mean - 0.5).abs() < 1e-6 && (test.rms - 1.5f64.sqrt()).abs() < 1e-6, "{test:?}");
        assert!((test.max - 2.0).abs() < 1e-6);
        assert_eq!((test.max_at.x, test.accepted, test.without_variance), (4, 1.0, 0));
        // The sum of four: 2 / √4.
        assert!((test.bias - 1.0).abs() < 1e-6 && test.passes(), "{test:?}");
    }

    /// From tables of Student's t: for one value with 46 degrees of freedom (16 equal variances), the two-sided 1 %
    /// limit is 2.6870; for ten values with 0.1005 % each, it is 3.5134 (by numerical integration).
    #[test]
    fn the_significance_is_shared_among_the_blocks() {
        let accepted = |zs: &[f32]| {
            let (a, b) = images(zs);
            z_test(&a, &b, None, 0.01).unwrap().accepted
        };
        assert_eq!((accepted(&[2.68]), accepted(&[2.70])), (1.0, 0.0));
        assert_eq!(accepted(&[3.50, -3.53, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]), 0.9);
    }

    /// Variances from two halves of normal values: the unbiased pair passes, the pair with 2 % bias fails.
    #[test]
    fn pairs_with_variances_of_one_degree_of_freedom_are_judged_rightly() {
        let mut state = 1u64;
        let mut uniform = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 40) as f64 / (1u64 << 24) as f64
        };
        let mut normal = || (0..12).map(|_| uniform()).sum::<f64>() - 6.0;
        let mut render = |bias: f64| {
            let mut image = Image::new(400, 400, &["Y", "variance.Y"]);
            for pixel in image.data.chunks_exact_mut(2) {
                let halves = [0.5 + bias + 0.1 * normal(), 0.5 + bias + 0.1 * normal()];
                pixel[0] = (0.5 * (halves[0] + halves[1])) as f32;
                pixel[1] = (0.25 * (halves[0] - halves[1]).powi(2)) as f32;
            }
            image
        };
        let (a, b, off) = (render(0.0), render(0.0), render(0.01));
        let right = z_test(&a, &b, None, 0.01).unwrap();
        assert!(right.accepted == 1.0 && right.passes(), "{} {}", right.mean, right.rms);
        assert!(right.mean.abs() < 0.05 && right.rms < 1.2, "{} {}", right.mean, right.rms);
        let wrong = z_test(&a, &off, None, 0.01).unwrap();
        assert!(wrong.mean < -0.3 && wrong.bias > 20.0 && !wrong.passes(), "{} {}", wrong.mean, wrong.bias);
    }

    #[test]
    fn without_variance_values_pass_that_differ_by_a_thousandth_at_most() {
        let mut a = Image::new(7, 1, &["Y"]);
        let variance = a.clone();
        a.data.fill(0.3);
        let b = a.clone();
        let test = |a: &Image| z_test(a, &b, Some(&variance), 0.01).unwrap();
        let equal = test(&a);
        assert_eq!((equal.accepted, equal.without_variance, equal.passes()), (1.0, 2, true));
        assert_eq!(equal.unequal_at, None);
        // Differences that cancel in the sum are detected.
        (a.data[5], a.data[6]) = (0.3 * 1.0009, 0.3 * 0.9991);
        let almost = test(&a);
        let (difference, place) = almost.unequal_at.clone().unwrap();
        assert!((difference - 0.0009).abs() < 1e-6 && place.x == 4, "{almost:?}");
        assert_eq!((almost.accepted, almost.unequal, almost.max), (1.0, 0, 0.0));
        (a.data[5], a.data[6]) = (0.3 * 1.002, 0.3 * 0.998);
        let different = test(&a);
        assert_eq!((different.accepted, different.unequal, different.max), (0.5, 1, 0.0));
        assert_eq!(different.scores.data[4..], [f32::INFINITY; 3]);
        // Against black any value differs.
        assert_eq!(z_test(&Image::new(7, 1, &["Y"]), &b, Some(&variance), 0.01).unwrap().unequal, 2);
    }

    /// A block without variance beside one with: z is that of the latter.
    #[test]
    fn z_is_finite_where_a_block_lacks_a_variance() {
        let (mut a, mut b) = images(&[0.0, 2.0]);
        for (x, y) in (0..16).map(|k| (k % 4, k / 4)) {
            a.pixel_mut(x, y).copy_from_slice(&[1.1, 0.0]);
            b.pixel_mut(x, y)[1] = 0.0;
        }
        let test = z_test(&a, &b, None, 0.01).unwrap();
        assert!((test.max - 2.0).abs() < 1e-6 && test.block_probability > 0.05, "{test:?}");
        assert_eq!((test.blocks, test.rejected, test.without_variance, test.unequal), (2, 1, 1, 1));
    }

    #[test]
    fn a_nan_is_rejected() {
        let (mut a, b) = images(&[0.0]);
        a.data[0] = f32::NAN;
        assert_eq!(z_test(&a, &b, None, 0.01).unwrap().accepted, 0.0);
    }

    #[test]
    fn what_is_missing_or_wrong_is_said() {
        let plain = Image::new(1, 1, &["R", "G", "B"]);
        let says = |a: &Image, b: &Image, v| z_test(a, b, v, 0.01).unwrap_err().to_string();
        assert_eq!(
            says(&plain, &plain, None),
            "a z-test needs variances: expected the channels variance.R, variance.G, variance.B in at least one image, found none (render with --aov variance)"
        );
        let mut negative = plain.clone();
        negative.data[1] = -1.0;
        assert_eq!(
            says(&plain, &plain, Some(&negative)),
            "expected variances of at least 0, found a negative or invalid one at pixel (0, 0), channel G"
        );
        let other = Image::new(2, 1, &["R", "G", "B"]);
        assert_eq!(says(&plain, &plain, Some(&other)), "the sizes differ: 1x1 and 2x1");
    }
}
