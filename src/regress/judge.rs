//! Comparison of a render with its reference.

use super::reference::Reference;
use crate::compare::{
    Invalid, NotComparable, ZTest, ZTestOptions, compare, invalid, is_of_noise, z_test_with,
};
use crate::image::Image;

/// The largest accepted difference between the means of a layer, relative to the mean magnitude. Layers have no
/// variance.
const LAYER_TOLERANCE: f64 = 0.02;

/// The thresholds of a test.
#[derive(Clone, Copy, Debug)]
pub struct Rules {
    /// The probability that a correct render fails by chance. Half of it is for the blocks, half for the bias.
    pub significance: f64,
    /// The largest accepted relMSE for a reference without variances.
    pub fail: f64,
}

/// The result of a comparison.
#[derive(Clone, Debug)]
pub struct Judgement {
    /// The faults, the most serious one first; empty if there are none.
    pub faults: Vec<String>,
    /// The figures on which the decision is based.
    pub figures: String,
    /// The detectable gain, if variances are known.
    pub gain: Option<f64>,
    /// The largest |z| over the channels of each pixel's block, if variances are known.
    pub scores: Option<Image>,
}

impl Judgement {
    fn fault(fault: String) -> Self {
        Judgement { faults: vec![fault], figures: String::new(), gain: None, scores: None }
    }
}

/// Compares a render with a number of samples per pixel with its reference.
///
/// The image is tested with its variances ([`ZTest`]): every block must be accepted, and no channel may be biased. If
/// the reference has no variances, relMSE is used. Layers other than `variance` must exist in both images, and their
/// means must agree within 2 % of their magnitude. An image with NaN or infinite values never passes.
pub fn judge(image: &Image, samples_per_pixel: u64, reference: &Reference, rules: &Rules) -> Judgement {
    let stored = &reference.image;
    if (image.width, image.height) != (stored.width, stored.height) {
        return Judgement::fault(format!(
            "the render has {}x{} pixels, its reference {}x{}",
            image.width, image.height, stored.width, stored.height
        ));
    }
    if let Some(fault) = other_channels(image, stored) {
        return Judgement::fault(fault);
    }
    for (what, found) in [("the render", invalid(image)), ("the reference", invalid(stored))] {
        if found.any() {
            return Judgement::fault(no_numbers(what, &found));
        }
    }
    let judged = if reference.has_variance() {
        by_variance(image, samples_per_pixel, reference, rules)
    } else {
        by_threshold(image, stored, rules)
    };
    let mut judgement = judged.unwrap_or_else(|why| Judgement::fault(why.to_string()));
    judgement.faults.extend(layer_faults(image, stored));
    judgement
}

fn no_numbers(what: &str, found: &Invalid) -> String {
    format!("{what} holds {found}")
}

/// Returns a message if the channels of the images differ, apart from variances.
fn other_channels(image: &Image, stored: &Image) -> Option<String> {
    let [mut a, mut b] = [image, stored].map(|i| judged_channels(i).collect::<Vec<_>>());
    a.sort_unstable();
    b.sort_unstable();
    (a != b).then(|| format!("the render has the channels {}, its reference {}", a.join(", "), b.join(", ")))
}

fn judged_channels(image: &Image) -> impl Iterator<Item = &str> {
    image.channels.iter().map(String::as_str).filter(|c| !is_of_noise(c))
}

fn by_variance(
    image: &Image,
    samples_per_pixel: u64,
    reference: &Reference,
    rules: &Rules,
) -> Result<Judgement, NotComparable> {
    let options = ZTestOptions {
        variance_of_b: reference.variance.as_ref(),
        significance: 0.5 * rules.significance,
        sample_ratio: reference.samples_per_pixel().map(|n| n as f64 / samples_per_pixel as f64),
    };
    let test = z_test_with(image, &reference.image, &options)?;
    let mut faults = Vec::new();
    let by_noise = test.rejected - test.unequal;
    if by_noise > 0 {
        faults.push(format!(
            "{by_noise} of {} blocks rejected (p {}), |z| up to {:.1} at {}",
            test.blocks,
            probability(test.block_probability),
            test.max,
            test.max_at
        ));
    }
    if let Some((difference, at)) = test.unequal_at.as_ref().filter(|_| test.unequal > 0) {
        faults.push(format!(
            "{} of {} blocks without variance differ by more than {}, the worst by {} at {at}",
            test.unequal,
            test.without_variance,
            percent(ZTest::SAME),
            percent(*difference)
        ));
    }
    if let Some((channel, share)) = test.bias_at.as_ref().filter(|_| !test.is_unbiased()) {
        let p = probability(test.bias_probability);
        faults.push(format!(
            "the mean of {channel} is {:+.2} % off (p {p}), {:.1} deviations",
            100.0 * share,
            test.bias
        ));
    }
    let [blocks, bias] = [test.block_probability, test.bias_probability].map(probability);
    let gain = if test.gain.is_finite() {
        format!("; detects a gain of {}", percent(test.gain))
    } else {
        "; black".to_owned()
    };
    let without = match test.without_variance {
        0 => String::new(),
        n => format!("; {n} of {} blocks have no variance", test.blocks),
    };
    let figures = format!("p {blocks} of blocks, {bias} of bias{gain}{without}");
    Ok(Judgement { faults, figures, gain: Some(test.gain), scores: Some(scores(&test)) })
}

/// Formats a probability.
fn probability(p: f64) -> String {
    if p >= 0.01 { format!("{p:.2}") } else { format!("{p:.0e}") }
}

/// Formats a fraction as a percentage, with two digits.
pub(super) fn percent(share: f64) -> String {
    let percent = 100.0 * share;
    if percent >= 10.0 {
        format!("{percent:.0} %")
    } else if percent >= 1.0 {
        format!("{percent:.1} %")
    } else if percent >= 0.1 {
        format!("{percent:.2} %")
    } else {
        format!("{percent:.0e} %")
    }
}

/// Returns the largest |z| over the channels of each pixel.
fn scores(test: &ZTest) -> Image {
    let mut map = Image::new(test.scores.width, test.scores.height, &["z"]);
    for (to, from) in map.data.iter_mut().zip(test.scores.data.chunks_exact(test.scores.channels.len())) {
        // `f32::max` would ignore a NaN.
        *to = from.iter().fold(0.0, |max, z| if z.abs() > max || z.is_nan() { z.abs() } else { max });
    }
    map
}

fn by_threshold(image: &Image, stored: &Image, rules: &Rules) -> Result<Judgement, NotComparable> {
    let comparison = compare(image, stored)?;
    let relmse = comparison.layers.iter().find(|l| l.layer.is_empty()).map_or(0.0, |l| l.relmse);
    let figures = format!("relMSE {relmse:.1e} of {:.0e} (the reference has no variance)", rules.fail);
    let worst = comparison.layers.first();
    let faults = worst.filter(|_| relmse.is_nan() || relmse > rules.fail).map(|layer| {
        format!(
            "relMSE {relmse:.2e} of at most {:.0e}, largest difference {:.2e} at {}",
            rules.fail, layer.max, layer.max_at
        )
    });
    let faults = faults.into_iter().collect();
    Ok(Judgement { faults, figures, gain: None, scores: None })
}

/// Returns the faults of layers with different means. Alpha is one of the layers.
fn layer_faults(image: &Image, stored: &Image) -> Vec<String> {
    let layers = judged_channels(stored).filter(|c| !matches!(*c, "R" | "G" | "B" | "Y"));
    let off = |channel: &str| {
        let values = |image: &Image| image.select(&[channel]).map(|i| i.data).unwrap_or_default();
        let (x, r) = (values(image), values(stored));
        let difference: f64 = x.iter().zip(&r).map(|(x, r)| f64::from(*x) - f64::from(*r)).sum();
        let magnitude: f64 = r.iter().map(|r| f64::from(r.abs())).sum();
        // Equal layers have no difference, even if they are black.
        let share = if x == r { 0.0 } else { difference.abs() / magnitude };
        (share.is_nan() || share > LAYER_TOLERANCE).then(|| {
            format!(
                "the layer {channel} is {:.2} % off, of at most {}",
                100.0 * share,
                percent(LAYER_TOLERANCE)
            )
        })
    };
    layers.filter_map(off).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::Value;

    const RULES: Rules = Rules { significance: 0.001, fail: 1e-3 };

    fn reference(image: Image) -> Reference {
        Reference { image, variance: None }
    }

    /// Creates an image with noise and its variance, and an exact image with the same mean.
    fn pair() -> (Image, Reference) {
        let channels = ["R", "G", "B", "variance.R", "variance.G", "variance.B"];
        let mut a = Image::new(32, 32, &channels);
        for (i, pixel) in a.data.chunks_exact_mut(6).enumerate() {
            let up = if (i % 32 + i / 32) % 2 == 0 { 0.1 } else { -0.1 };
            pixel.copy_from_slice(&[1.0 + up, 0.5 - up, 0.7 + up, 0.01, 0.01, 0.01]);
        }
        let mut b = a.clone();
        b.data.chunks_exact_mut(6).for_each(|pixel| pixel.copy_from_slice(&[1.0, 0.5, 0.7, 0.0, 0.0, 0.0]));
        (a, reference(b))
    }

    #[test]
    fn what_differs_is_said() {
        let (a, r) = pair();
        let says = |image: &Image, r: &Reference| judge(image, 16, r, &RULES).faults.join("; ");
        assert_eq!(says(&a, &r), "");
        let mut bright = a.clone();
        bright.data.chunks_exact_mut(6).for_each(|p| p[0] += 0.05);
        assert_eq!(says(&bright, &r), "the mean of R is +5.00 % off (p 2e-55), 16.0 deviations");
        let mut spot = a.clone();
        spot.pixel_mut(9, 6)[1] += 4.0;
        assert!(says(&spot, &r).starts_with("1 of 192 blocks rejected (p "), "{}", says(&spot, &r));
        assert!(
            says(&spot, &r).ends_with("|z| up to 10.0 at pixel (8, 4), channel G"),
            "{}",
            says(&spot, &r)
        );
        let (mut constant, mut exact) = (a.clone(), r.image.clone());
        for image in [&mut constant, &mut exact] {
            for (x, y) in (0..16).map(|k| (4 + k % 4, 8 + k / 4)) {
                image.pixel_mut(x, y).copy_from_slice(&[0.3, 0.3, 0.3, 0.0, 0.0, 0.0]);
            }
        }
        let exact = reference(exact);
        let figures = judge(&constant, 16, &exact, &RULES).figures;
        assert!(figures.ends_with("; 3 of 192 blocks have no variance"), "{figures}");
        assert_eq!(says(&constant, &exact), "");
        constant.pixel_mut(5, 9)[2] = 0.315;
        let unequal = "1 of 3 blocks without variance differ by more than 0.10 %, the worst by 4.8 % at \
                       pixel (4, 8), channel B";
        assert_eq!(says(&constant, &exact), unequal);
        let mut bad = a.clone();
        bad.pixel_mut(3, 2)[1] = f32::NAN;
        let nan = "the render holds 1 NaN and 0 infinite values, the first at pixel (3, 2), channel G";
        assert_eq!(says(&bad, &r), nan);
        let small = reference(Image::new(3, 2, &["R", "G", "B"]));
        assert_eq!(says(&a, &small), "the render has 32x32 pixels, its reference 3x2");
        let other = reference(Image::new(32, 32, &["R", "G", "B", "Z"]));
        let expected = "the render has the channels B, G, R, its reference B, G, R, Z";
        assert_eq!(says(&a, &other), expected);
    }

    #[test]
    fn without_variances_a_threshold_decides_and_layers_are_compared_by_their_means() {
        let (a, r) = pair();
        let plain = r.image.select(&["R", "G", "B"]).unwrap();
        let judged = judge(&a, 16, &reference(plain.clone()), &RULES);
        let (relmse, threshold) = ("2.3e-2", "1e-3");
        assert!(judged.figures.starts_with(&format!("relMSE {relmse} of {threshold}")), "{}", judged.figures);
        assert_eq!(judged.faults.len(), 1);
        assert!(judge(&plain, 16, &reference(plain.clone()), &RULES).faults.is_empty());
        let mut layers = Image::new(4, 4, &["R", "G", "B", "N.X", "N.Y"]);
        layers.data.iter_mut().for_each(|v| *v = 0.5);
        let stored = reference(layers.clone());
        layers.data.chunks_exact_mut(5).for_each(|p| p[4] = 0.52);
        let faults = judge(&layers, 16, &stored, &RULES).faults;
        assert_eq!(faults, ["the layer N.Y is 4.00 % off, of at most 2.0 %"]);
    }

    /// If a reference of 4096 samples per pixel contains a rare contribution, a render of 16 samples without it passes.
    #[test]
    fn what_is_rarely_found_may_be_missed() {
        let (mut a, mut r) = pair();
        a.data.iter_mut().for_each(|v| *v = 1e-6);
        r.image.data.iter_mut().for_each(|v| *v = 1e-6);
        // A tenth of the pixels has one sample of value 4096 among 4096.
        for pixel in r.image.data.chunks_exact_mut(6).step_by(10) {
            (pixel[0], pixel[3]) = (1.0, 1.0);
        }
        assert!(!judge(&a, 16, &r, &RULES).faults.is_empty());
        r.image.metadata.set("samplesPerPixel", Value::Int(256 * 16));
        let judged = judge(&a, 16, &r, &RULES);
        assert!(judged.faults.is_empty(), "{judged:?}");
        assert!(judged.gain.is_some_and(|g| g > 0.5), "{judged:?}");
    }
}
