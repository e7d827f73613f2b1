//! Whether two images may be estimates of the same picture, judged by their variances.

use super::Image;
use super::compare::{Location, NotComparable, VARIANCE, layer_channels, location};

/// The outcome of a z-test of the picture's values.
///
/// z = (a − b) / √(var a + var b), where a variance is that of the stored value (not of a single sample). A
/// value is accepted if a normal deviate is as far out with a probability of at least α′, where
/// α′ = 1 − (1 − α)^(1/n) [Šidák 1967] makes α the probability that any of the n values of a right pair is
/// rejected.
#[derive(Clone, Debug, PartialEq)]
pub struct ZTest {
    /// α: the significance of the whole test.
    pub significance: f64,
    /// The share of values that are accepted.
    pub accepted: f64,
    /// Mean of z where there is a variance: about 0, ± 1/√n, if neither image is biased.
    pub mean: f64,
    /// Root mean square of z where there is a variance: about 1 if the variances are right.
    pub rms: f64,
    /// The largest |z|; infinite where values differ without any variance.
    pub max: f64,
    /// Where that is.
    pub max_at: Location,
    /// How many values have no variance in either image; they are accepted if they are equal.
    pub without_variance: usize,
    /// z of each value, the picture's channels.
    pub scores: Image,
}

impl ZTest {
    /// The share of values that must be accepted, as in Mitsuba's render tests: a few outliers of a
    /// heavy-tailed estimator are not held against the image.
    pub const ENOUGH: f64 = 0.9975;

    /// Whether enough values are accepted.
    pub fn passes(&self) -> bool {
        self.accepted >= Self::ENOUGH
    }
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
    let given = match variance_of_b {
        Some(image) => Some(
            variance_of(image, &names)
                .or_else(|| image.select(&names))
                .ok_or_else(|| NotComparable::Channels(a.channels.clone(), image.channels.clone()))?,
        ),
        None => variance_of(b, &names),
    };
    let variances: Vec<Image> = variance_of(a, &names).into_iter().chain(given).collect();
    if variances.is_empty() {
        return Err(NotComparable::NoVariance(names.iter().map(|c| format!("{VARIANCE}.{c}")).collect()));
    }
    for image in &variances {
        if let Some(index) = image.data.iter().position(|v| !(v.is_finite() && *v >= 0.0)) {
            return Err(NotComparable::BadVariance(location(image, index)));
        }
    }
    Ok(summarise(x, &r, &variances, significance))
}

/// The variance layer of the picture's channels.
fn variance_of(image: &Image, names: &[&str]) -> Option<Image> {
    image.select(&names.iter().map(|c| format!("{VARIANCE}.{c}")).collect::<Vec<_>>())
}

/// Scores all values. `x` becomes the image of the scores.
fn summarise(mut x: Image, r: &Image, variances: &[Image], significance: f64) -> ZTest {
    let n = x.data.len();
    let each = -((-significance).ln_1p() / n as f64).exp_m1();
    let (mut accepted, mut without_variance) = (0usize, 0usize);
    let (mut sum, mut squares) = (0.0, 0.0);
    let (mut max, mut max_index) = (0.0, 0);
    for (i, value) in x.data.iter_mut().enumerate() {
        let difference = f64::from(*value) - f64::from(r.data[i]);
        let variance: f64 = variances.iter().map(|v| f64::from(v.data[i])).sum();
        let z = if variance > 0.0 {
            difference / variance.sqrt()
        } else if difference == 0.0 {
            0.0
        } else {
            f64::INFINITY.copysign(difference)
        };
        if variance > 0.0 {
            sum += z;
            squares += z * z;
        } else {
            without_variance += 1;
        }
        // A NaN is never accepted.
        accepted += usize::from(libm::erfc(z.abs() / std::f64::consts::SQRT_2) >= each);
        if z.abs() > max {
            (max, max_index) = (z.abs(), i);
        }
        *value = z as f32;
    }
    let with_variance = (n - without_variance) as f64;
    ZTest {
        significance,
        accepted: accepted as f64 / n as f64,
        mean: sum / with_variance,
        rms: (squares / with_variance).sqrt(),
        max,
        max_at: location(&x, max_index),
        without_variance,
        scores: x,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two images of n values whose difference is `z` standard deviations.
    fn pair(zs: &[f32]) -> (Image, Image) {
        let mut a = Image::new(zs.len(), 1, &["Y", "variance.Y"]);
        let mut b = Image::new(zs.len(), 1, &["Y", "variance.Y"]);
        for (i, z) in zs.iter().enumerate() {
            // Variances 0.09 and 0.16: a standard deviation of 0.5.
            a.pixel_mut(i, 0).copy_from_slice(&[1.0 + 0.5 * z, 0.09]);
            b.pixel_mut(i, 0).copy_from_slice(&[1.0, 0.16]);
        }
        (a, b)
    }

    #[test]
    fn scores_are_differences_over_the_standard_deviation_of_both() {
        let (a, b) = pair(&[0.0, 2.0, -1.0, 1.0]);
        let test = z_test(&a, &b, None, 0.01).unwrap();
        assert!((test.mean - 0.5).abs() < 1e-6 && (test.rms - 1.5f64.sqrt()).abs() < 1e-6, "{test:?}");
        assert!((test.max - 2.0).abs() < 1e-6);
        assert_eq!((test.max_at.x, test.accepted, test.without_variance), (1, 1.0, 0));
        assert!(test.passes());
    }

    #[test]
    fn the_significance_is_shared_among_the_values() {
        // Two-sided 1 % of one value lies beyond 2.5758; of ten values, beyond 3.2892.
        let (a, b) = pair(&[2.57]);
        assert_eq!(z_test(&a, &b, None, 0.01).unwrap().accepted, 1.0);
        let (a, b) = pair(&[2.58]);
        assert_eq!(z_test(&a, &b, None, 0.01).unwrap().accepted, 0.0);
        let (a, b) = pair(&[3.28, -3.30, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
        assert_eq!(z_test(&a, &b, None, 0.01).unwrap().accepted, 0.9);
    }

    #[test]
    fn without_variance_only_equal_values_pass() {
        let mut a = Image::new(2, 1, &["Y"]);
        let b = a.clone();
        let variance = a.clone();
        assert_eq!(z_test(&a, &b, Some(&variance), 0.01).unwrap().accepted, 1.0);
        a.data[1] = 1e-20;
        let test = z_test(&a, &b, Some(&variance), 0.01).unwrap();
        assert_eq!((test.accepted, test.max, test.max_at.x), (0.5, f64::INFINITY, 1));
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
