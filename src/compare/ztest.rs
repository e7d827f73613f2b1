//! Whether two images may be estimates of the same picture, judged by their variances.

use super::images::{BLOCK_VARIANCE, Location, NotComparable, VARIANCE, layer_channels, location};
use super::rounding::Rounding;
use crate::estimate::student::{of_all, quantile, share, tail};
use crate::image::{Image, Value};

/// The metadata that says whether the pixels of an image share noise.
pub const NOISE: &str = "buffon:noise";
/// What [`NOISE`] says if they do.
pub const SHARED_NOISE: &str = "shared by pixels";
/// The metadata that says how many independent replicates the variances of an image with shared noise are from.
pub const REPLICATES: &str = "buffon:replicates";
/// The beginning of the metadata that hold the variance of the mean of a channel of such an image.
pub const MEAN_VARIANCE: &str = "buffon:mean_variance.";

/// The outcome of a z-test of the picture, in blocks of [`ZTest::SIDE`]² pixels and each channel by itself.
///
/// z = Σ(a − b) / √Σ(var a + var b) over the pixels of a block, where a variance is that of the stored value (not of
/// a single sample). A variance that is estimated from two halves has one degree of freedom, and z by pixels would
/// have tails without a mean; the sum over a block has ν = 3·(Σv)²/Σv² − 2 [Satterthwaite 1946, with the squares
/// of such estimates three times too large]. Where pixels share noise, the variance of a block is the one that its
/// replicates give, of one degree of freedom less than there are replicates. A block is accepted if a Student's t of
/// ν degrees of freedom is as far out with a probability of at least α′, where α′ = 1 − (1 − α)^(1/n) [Šidák 1967]
/// makes α the probability that any of the n blocks of a right pair is rejected.
///
/// What rounding may have done to the stored values (half a step of the format for each, as large as the sum of a
/// block's can be) is taken off |Σ(a − b)|: the rounding of a smooth picture is no noise. Images whose values are
/// halves throughout are taken as rounded to halves.
#[derive(Clone, Debug, PartialEq)]
pub struct ZTest {
    /// α: the significance of the whole test.
    pub significance: f64,
    /// How many blocks there are, over all channels.
    pub blocks: usize,
    /// How many of them are rejected.
    pub rejected: usize,
    /// The share of blocks that are accepted.
    pub accepted: f64,
    /// The probability that in a right pair any block is as far out as the worst one; 0 if a block is no number.
    pub block_probability: f64,
    /// Mean of z where there is a variance: about 0, ± 1/√n, if neither image is biased.
    pub mean: f64,
    /// Root mean square of z where there is a variance: a little over 1 if the variances are right.
    pub rms: f64,
    /// The largest |z| of a channel with the whole image as one block: it finds a bias that is too small for any
    /// single block.
    pub bias: f64,
    /// The least probability of a channel's bias in a right pair.
    pub bias_probability: f64,
    /// The channel of the least probability, and Σ(a − b) / Σb there; `None` without any variance.
    pub bias_at: Option<(String, f64)>,
    /// The least relative difference of the means that is found in some channel with a probability of 0.95, at these
    /// variances; infinite if the reference is black.
    pub gain: f64,
    /// The largest |z|; infinite where values differ without any variance.
    pub max: f64,
    /// The first pixel of its block, and the channel.
    pub max_at: Location,
    /// How many blocks have no variance in either image; they are accepted if they are equal.
    pub without_variance: usize,
    /// z at each pixel of its block, the picture's channels.
    pub scores: Image,
}

impl ZTest {
    /// The share of blocks that must be accepted, as in Mitsuba's render tests: a few outliers of a
    /// heavy-tailed estimator are not held against the image.
    pub const ENOUGH: f64 = 0.9975;
    /// Pixels of a block along each axis.
    pub const SIDE: usize = 4;

    /// Whether enough blocks are accepted, and no channel is biased at the test's significance.
    pub fn passes(&self) -> bool {
        self.accepted >= Self::ENOUGH && self.is_unbiased()
    }

    /// Whether no channel is biased at the test's significance.
    pub fn is_unbiased(&self) -> bool {
        self.bias_probability >= share(self.significance, self.scores.channels.len())
    }
}

/// What a z-test is told besides the images.
#[derive(Clone, Copy, Debug)]
pub struct ZTestOptions<'a> {
    /// An image whose channels `R`, `G`, `B` or `Y` (or whose layer `variance`) are the variances of the second
    /// image; without it, those of the image's own layer `variance`.
    pub variance_of_b: Option<&'a Image>,
    /// The significance of the blocks together, and of the channels' biases together.
    pub significance: f64,
    /// Samples of the second image over those of the first, if both are estimates by one method: the first image's
    /// variance is expected to be so many times that of the second, and where it seems to be less, the expected
    /// one counts. An image that has missed what is rarely found does not know its variance.
    pub sample_ratio: Option<f64>,
}

/// Tests whether two images estimate the same picture. Variances are taken from the layer `variance` of
/// either image and from `variance_of_b`, an image whose channels `R`, `G`, `B` or `Y` (or whose layer
/// `variance`) are the variances of `b`; an image without any counts as exact.
///
/// # Errors
/// If the images differ in size or in the channels of the picture or have no picture, if neither has a
/// variance, or if a variance is negative or no number.
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

/// [`z_test`] with all options.
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
        Some(image) => Some(Noise::by_pixels(
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
    for Noise { variances, .. } in noise.iter().flatten() {
        if let Some(index) = variances.data.iter().position(|v| !(v.is_finite() && *v >= 0.0)) {
            return Err(NotComparable::BadVariance(location(variances, index)));
        }
    }
    let rounding = [Rounding::of(&x), Rounding::of(&r)];
    Ok(summarise(x, &Pair { r: &r, noise: &noise, rounding, sample_ratio }, significance))
}

/// The variance layer of the picture's channels.
fn variance_of(image: &Image, names: &[&str]) -> Option<Image> {
    image.select(&names.iter().map(|c| format!("{VARIANCE}.{c}")).collect::<Vec<_>>())
}

/// What is known of the noise of an image.
struct Noise {
    /// By pixel and channel, so that their sum over a block is the variance of its sum.
    variances: Image,
    /// Where pixels share noise.
    shared: Option<SharedNoise>,
}

/// What is known of noise that pixels share.
struct SharedNoise {
    /// The degrees of freedom of the variance of a block, and of the whole.
    freedom: f64,
    /// The variance of the sum over all pixels, by channel.
    of_sum: Vec<f64>,
}

impl Noise {
    /// That of independent pixels.
    fn by_pixels(variances: Image) -> Self {
        Noise { variances, shared: None }
    }
}

/// What an image says of its noise; `None` if it says nothing.
fn noise_of(image: &Image, names: &[&str]) -> Result<Option<Noise>, NotComparable> {
    let shares = matches!(image.metadata.get(NOISE), Some(Value::Text(noise)) if noise == SHARED_NOISE);
    let by_pixels = variance_of(image, names);
    if !shares || by_pixels.is_none() {
        return Ok(by_pixels.map(Noise::by_pixels));
    }
    let missing = || NotComparable::NoBlockVariance;
    let layers: Vec<String> = names.iter().map(|c| format!("{BLOCK_VARIANCE}.{c}")).collect();
    let variances = image.select(&layers).ok_or_else(missing)?;
    let freedom = match image.metadata.get(REPLICATES) {
        Some(Value::Int(replicates)) if *replicates > 1 => f64::from(replicates - 1),
        _ => return Err(missing()),
    };
    let pixels = (image.width * image.height) as f64;
    let of_sum = names.iter().map(|c| match image.metadata.get(&format!("{MEAN_VARIANCE}{c}")) {
        Some(Value::Float(variance)) => Ok(f64::from(*variance) * pixels * pixels),
        _ => Err(missing()),
    });
    let of_sum = of_sum.collect::<Result<_, _>>()?;
    Ok(Some(Noise { variances, shared: Some(SharedNoise { freedom, of_sum }) }))
}

/// What the first image is held against.
struct Pair<'a> {
    r: &'a Image,
    /// Of the first image, and of the second.
    noise: &'a [Option<Noise>; 2],
    rounding: [Rounding; 2],
    sample_ratio: Option<f64>,
}

/// Rounding of fewer deviations than this decides nothing, and is not taken off.
const NEGLIGIBLE: f64 = 1e-5;

/// A variance and how well it is known.
#[derive(Clone, Copy, Default)]
struct Spread {
    variance: f64,
    /// The variance of the variance, half of it: Σ v²/ν.
    doubt: f64,
}

impl Spread {
    fn freedom(self) -> f64 {
        // A variance whose square is less than the least number is as good as any.
        let freedom = self.variance * self.variance / self.doubt;
        if freedom.is_finite() { freedom.max(1.0) } else { 1.0 }
    }

    fn plus(self, other: Spread) -> Spread {
        Spread { variance: self.variance + other.variance, doubt: self.doubt + other.doubt }
    }

    fn times(self, factor: f64) -> Spread {
        Spread { variance: self.variance * factor, doubt: self.doubt * factor * factor }
    }
}

/// Sums over the pixels of a block, in one channel.
#[derive(Clone, Copy, Default)]
struct Block {
    difference: f64,
    reference: f64,
    /// What rounding may make of the difference, at most.
    rounding: f64,
    /// Whether any two values differ by more than that (or are no numbers), though differences may add up to nothing.
    differs: bool,
    /// Of independent pixels, of either image and of both: the sum of variances, and that of their squares.
    by_pixels: [[f64; 2]; 3],
    /// Of images whose pixels share noise.
    shared: [Option<Spread>; 2],
    /// What is expected of the first image's noise and the second's together, over the second's.
    expected: Option<f64>,
}

impl Block {
    /// Adds the value with index `i`; `x` is the first image.
    fn add(&mut self, x: &Image, pair: &Pair<'_>, i: usize) {
        let (a, b) = (x.data[i], pair.r.data[i]);
        let difference = f64::from(a) - f64::from(b);
        let rounding = pair.rounding[0].bound(a) + pair.rounding[1].bound(b);
        self.difference += difference;
        self.reference += f64::from(b);
        self.rounding += rounding;
        self.differs |= difference.abs() > rounding;
        self.expected = pair.sample_ratio.map(|ratio| 1.0 + ratio);
        let mut both = 0.0;
        for (k, noise) in pair.noise.iter().enumerate() {
            let Some(Noise { variances, shared }) = noise else { continue };
            let v = f64::from(variances.data[i]);
            match shared {
                Some(SharedNoise { freedom, .. }) => {
                    let variance = self.shared[k].unwrap_or_default().variance + v;
                    self.shared[k] = Some(Spread { variance, doubt: variance * variance / freedom });
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

    /// Takes the variances of the sums over the whole image, where its pixels share noise.
    fn of_whole(&mut self, pair: &Pair<'_>, channel: usize) {
        for (spread, noise) in self.shared.iter_mut().zip(pair.noise) {
            if let Some(SharedNoise { freedom, of_sum }) = noise.as_ref().and_then(|n| n.shared.as_ref()) {
                let variance = of_sum[channel];
                *spread = Some(Spread { variance, doubt: variance * variance / freedom });
            }
        }
    }

    /// What variances of single pixels, of one degree of freedom each, say of their sum.
    fn of_pixels(&self, k: usize) -> Spread {
        let [variance, squares] = self.by_pixels[k];
        // ν = 3·(Σv)²/Σv² − 2.
        let freedom = 3.0 * variance * variance / squares - 2.0;
        let freedom = if freedom.is_finite() { freedom.max(1.0) } else { 1.0 };
        Spread { variance, doubt: variance * variance / freedom }
    }

    /// The variance of the difference, of the larger estimate.
    fn spread(&self) -> Spread {
        let found = self.shared.iter().flatten().fold(self.of_pixels(2), |sum, spread| sum.plus(*spread));
        let of_second = self.shared[1].unwrap_or_else(|| self.of_pixels(1));
        match self.expected.map(|factor| of_second.times(factor)) {
            Some(expected) if expected.variance > found.variance => expected,
            _ => found,
        }
    }

    fn variance(&self) -> f64 {
        self.spread().variance
    }

    fn z(&self) -> f64 {
        let variance = self.variance();
        if variance > 0.0 && !self.difference.is_nan() {
            let deviation = variance.sqrt();
            let rounding = if self.rounding > NEGLIGIBLE * deviation { self.rounding } else { 0.0 };
            (self.difference.abs() - rounding).max(0.0).copysign(self.difference) / deviation
        } else if self.difference.is_nan() {
            self.difference
        } else if self.differs {
            f64::INFINITY
        } else {
            0.0
        }
    }

    /// The degrees of freedom of the variance.
    fn freedom(&self) -> f64 {
        self.spread().freedom()
    }

    /// The probability that a right pair is as far out; NaN where z is.
    fn probability(&self) -> f64 {
        let t = self.z();
        if self.variance() == 0.0 || !t.is_finite() {
            return if t.is_nan() { f64::NAN } else { f64::from(u8::from(t == 0.0)) };
        }
        tail(t, self.freedom())
    }

    /// The least share of the reference's sum by which the other one is off if it is found at a significance, with a
    /// probability of 0.95.
    fn gain(&self, significance: f64) -> f64 {
        /// The normal distribution is below this with a probability of 0.95.
        const POWER: f64 = 1.644_853_627;
        let variance = self.variance();
        let far_out = if variance > 0.0 { quantile(significance, self.freedom()) + POWER } else { 0.0 };
        (far_out * variance.sqrt() + self.rounding) / self.reference.abs()
    }
}

/// Scores all blocks. `x` becomes the image of the scores.
fn summarise(mut x: Image, pair: &Pair<'_>, significance: f64) -> ZTest {
    let channels = x.channels.len();
    let (columns, rows) = (x.width.div_ceil(ZTest::SIDE), x.height.div_ceil(ZTest::SIDE));
    let n = columns * rows * channels;
    let each = share(significance, n);
    let (mut accepted, mut without_variance) = (0usize, 0usize);
    let mut whole = vec![Block::default(); channels];
    let (mut sum, mut squares, mut least) = (0.0, 0.0, 1f64);
    let (mut max, mut max_index) = (0.0, 0);
    for corner in 0..columns * rows {
        for (channel, whole) in whole.iter_mut().enumerate() {
            let indices = indices_of(&x, corner, channel);
            let mut block = Block::default();
            for &i in &indices {
                block.add(&x, pair, i);
                whole.add(&x, pair, i);
            }
            let (z, probability) = (block.z(), block.probability());
            if block.variance() > 0.0 {
                sum += z;
                squares += z * z;
            } else {
                without_variance += 1;
            }
            // A NaN is never accepted.
            accepted += usize::from(probability >= each);
            least = if probability.is_nan() { 0.0 } else { least.min(probability) };
            if z.abs() > max {
                (max, max_index) = (z.abs(), indices[0]);
            }
            indices.into_iter().for_each(|i| x.data[i] = z as f32);
        }
    }
    whole.iter_mut().enumerate().for_each(|(channel, whole)| whole.of_whole(pair, channel));
    let with_variance = (n - without_variance) as f64;
    let gain = whole.iter().map(|c| c.gain(share(significance, channels))).fold(f64::INFINITY, f64::min);
    let Bias { z, probability, at } = bias(&whole, &x.channels);
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
        scores: x,
    }
}

/// The indices of a channel's values in a block; blocks are counted row by row.
fn indices_of(image: &Image, block: usize, channel: usize) -> Vec<usize> {
    let columns = image.width.div_ceil(ZTest::SIDE);
    let (x0, y0) = (block % columns * ZTest::SIDE, block / columns * ZTest::SIDE);
    let (x1, y1) = ((x0 + ZTest::SIDE).min(image.width), (y0 + ZTest::SIDE).min(image.height));
    let pixels = (y0..y1).flat_map(|y| (x0..x1).map(move |x| y * image.width + x));
    pixels.map(|pixel| pixel * image.channels.len() + channel).collect()
}

/// What the channels' sums say.
struct Bias {
    z: f64,
    probability: f64,
    at: Option<(String, f64)>,
}

/// The bias of the channels that have a variance: differences without any are for the blocks to judge.
fn bias(whole: &[Block], channels: &[String]) -> Bias {
    let mut found = Bias { z: 0.0, probability: 1.0, at: None };
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

    /// Two images of n blocks whose differences are `z` standard deviations, all variances alike.
    fn pair(zs: &[f32]) -> (Image, Image) {
        let mut a = Image::new(4 * zs.len(), 4, &["Y", "variance.Y"]);
        let mut b = Image::new(4 * zs.len(), 4, &["Y", "variance.Y"]);
        for (i, z) in zs.iter().enumerate() {
            for (x, y) in (0..16).map(|k| (4 * i + k % 4, k / 4)) {
                // Variances 0.09 and 0.16: a standard deviation of 0.5, and of the mean of sixteen a quarter of it.
                a.pixel_mut(x, y).copy_from_slice(&[1.0 + 0.125 * z, 0.09]);
                b.pixel_mut(x, y).copy_from_slice(&[1.0, 0.16]);
            }
        }
        (a, b)
    }

    #[test]
    fn scores_are_differences_over_the_standard_deviation_of_both() {
        let (a, b) = pair(&[0.0, 2.0, -1.0, 1.0]);
        let test = z_test(&a, &b, None, 0.01).unwrap();
        assert!((test.mean - 0.5).abs() < 1e-6 && (test.rms - 1.5f64.sqrt()).abs() < 1e-6, "{test:?}");
        assert!((test.max - 2.0).abs() < 1e-6);
        assert_eq!((test.max_at.x, test.accepted, test.without_variance), (4, 1.0, 0));
        // The sum of four: 2 / √4.
        assert!((test.bias - 1.0).abs() < 1e-6 && test.passes(), "{test:?}");
    }

    /// Tables of Student's t: two-sided 1 % of one value of 46 degrees of freedom (16 equal variances) lies beyond
    /// 2.6870; of ten values, 0.1005 % each, beyond 3.5134 (by numerical integration).
    #[test]
    fn the_significance_is_shared_among_the_blocks() {
        let accepted = |zs: &[f32]| {
            let (a, b) = pair(zs);
            z_test(&a, &b, None, 0.01).unwrap().accepted
        };
        assert_eq!((accepted(&[2.68]), accepted(&[2.70])), (1.0, 0.0));
        assert_eq!(accepted(&[3.50, -3.53, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]), 0.9);
    }

    /// Variances from two halves of normal values: the right pair passes, 2 % of bias does not.
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
    fn without_variance_only_equal_values_pass() {
        let mut a = Image::new(7, 1, &["Y"]);
        let b = a.clone();
        let variance = a.clone();
        let equal = z_test(&a, &b, Some(&variance), 0.01).unwrap();
        assert_eq!((equal.accepted, equal.without_variance, equal.passes()), (1.0, 2, true));
        // Differences that add up to nothing are differences.
        (a.data[5], a.data[6]) = (1e-20, -1e-20);
        let test = z_test(&a, &b, Some(&variance), 0.01).unwrap();
        assert_eq!((test.accepted, test.max, test.max_at.x), (0.5, f64::INFINITY, 4));
    }

    #[test]
    fn a_nan_is_rejected() {
        let (mut a, b) = pair(&[0.0]);
        a.data[0] = f32::NAN;
        assert_eq!(z_test(&a, &b, None, 0.01).unwrap().accepted, 0.0);
    }

    #[test]
    fn what_is_missing_or_wrong_is_said() {
        let plain = Image::new(1, 1, &["R", "G", "B"]);
        let says = |a: &Image, b: &Image, v| z_test(a, b, v, 0.01).unwrap_err().to_string();
        assert_eq!(
            says(&plain, &plain, None),
            "a z-test needs variances: no image has the channels variance.R, variance.G, variance.B"
        );
        let mut negative = plain.clone();
        negative.data[1] = -1.0;
        assert_eq!(
            says(&plain, &plain, Some(&negative)),
            "a z-test needs variances of at least 0, found another at pixel (0, 0), channel G"
        );
        let other = Image::new(2, 1, &["R", "G", "B"]);
        assert_eq!(says(&plain, &plain, Some(&other)), "the sizes differ: 1x1 and 2x1");
    }
}
