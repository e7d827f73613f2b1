//! The mean of a part of an image, its confidence interval, and the test of a claim about it.

use super::expectation::Claim;
use crate::estimate::student::{quantile, share};
use crate::film::PixelRect;
use crate::film::tile::variance_of_mean;
use crate::image::Image;

/// Names of the channels, in messages.
const CHANNELS: [&str; 3] = ["R", "G", "B"];

/// The mean of the pixels of a rectangle.
#[derive(Clone, Debug, PartialEq)]
pub struct Region {
    /// The mean of each channel.
    pub mean: [f64; 3],
    /// Half the width of the confidence interval of the mean; 0 if nothing varied.
    pub half_width: [f64; 3],
    /// The least and the greatest value of a pixel in each channel, and their positions.
    extremes: [[(f64, [usize; 2]); 2]; 3],
}

/// The quantities that determine the width of an interval.
#[derive(Clone, Copy, Debug)]
pub(super) struct Confidence<'a> {
    /// The probability that any channel's interval does not contain its expected value.
    pub significance: f64,
    /// The image of each replicate, if pixels share noise; otherwise empty.
    pub replicates: &'a [Image],
}

impl Region {
    /// Measures a rectangle of an image with a layer `variance`, or the whole image without a rectangle.
    ///
    /// The variance of a pixel comes from two halves and has one degree of freedom. The variance of the mean has
    /// 3·(Σv)²/Σv² − 2 [Satterthwaite 1946, with the squares of such estimates three times too large]. If pixels share
    /// noise, the variance of the mean comes from the replicates.
    ///
    /// # Errors
    /// If the rectangle is not a part of the image, or a value is not finite.
    pub(super) fn measure(
        image: &Image,
        pixels: Option<PixelRect>,
        confidence: Confidence<'_>,
    ) -> Result<Region, String> {
        let (width, height) = (image.width, image.height);
        let whole = PixelRect { x: 0, y: 0, width: width as u32, height: height as u32 };
        let rect = pixels.unwrap_or(whole);
        let end = |start: u32, length: u32| start as usize + length as usize;
        if end(rect.x, rect.width) > width || end(rect.y, rect.height) > height {
            return Err(format!("pixels: expected a part of the image, which has {width}x{height} pixels"));
        }
        let names = CHANNELS.map(|c| format!("variance.{c}"));
        let (Some(colours), Some(variances)) = (image.rgb_channels(), image.select(&names)) else {
            return Err("the image has no colours with variances".to_owned());
        };
        let mut region =
            Region { mean: [0.0; 3], half_width: [0.0; 3], extremes: [[(f64::NAN, [0; 2]); 2]; 3] };
        let n = f64::from(rect.width) * f64::from(rect.height);
        for c in 0..3 {
            let (mut sum, mut variance, mut squares) = (0.0, 0.0, 0.0);
            for y in rect.y as usize..end(rect.y, rect.height) {
                for x in rect.x as usize..end(rect.x, rect.width) {
                    let value = f64::from(image.pixel(x, y)[colours[c]]);
                    if !value.is_finite() {
                        return Err(format!("{} of pixel ({x}, {y}) is {value}", CHANNELS[c]));
                    }
                    let v = f64::from(variances.pixel(x, y)[c]);
                    (sum, variance, squares) = (sum + value, variance + v, squares + v * v);
                    let [least, greatest] = &mut region.extremes[c];
                    // The extremes are NaN before the first pixel.
                    if least.0.is_nan() || value < least.0 {
                        *least = (value, [x, y]);
                    }
                    if greatest.0.is_nan() || value > greatest.0 {
                        *greatest = (value, [x, y]);
                    }
                }
            }
            region.mean[c] = sum / n;
            let ratio = variance * variance / squares;
            let mut freedom = if ratio.is_finite() { (3.0 * ratio - 2.0).max(1.0) } else { 1.0 };
            if !confidence.replicates.is_empty() {
                let sums = confidence.replicates.iter().map(|image| sum_over(image, rect, c));
                variance = variance_of_mean(sums).unwrap_or(0.0);
                freedom = (confidence.replicates.len() as f64 - 1.0).max(1.0);
            }
            if variance > 0.0 {
                let t = quantile(share(confidence.significance, 3), freedom);
                region.half_width[c] = t * variance.sqrt() / n;
            }
        }
        Ok(region)
    }

    /// Returns the violations of a claim. There are none if every channel's whole interval is within the bounds and so
    /// is every pixel.
    pub(super) fn faults(&self, claim: &Claim, pixels_within: Option<f64>) -> Vec<String> {
        let bounds = |c: usize| match claim {
            Claim::Value { expected, within } => {
                let room = within * expected[c].abs();
                Some([expected[c] - room, expected[c] + room])
            }
            Claim::Between { low, high } => Some([low[c], high[c]]),
            Claim::SameAs { .. } | Claim::Refused(_) => None,
        };
        let mut faults: Vec<String> = (0..3).filter_map(|c| self.fault(c, bounds(c)?, CHANNELS[c])).collect();
        if self.is_grey() && faults.len() == 3 {
            faults = self.fault(0, bounds(0).unwrap_or_default(), "the mean").into_iter().collect();
        }
        if let (Claim::Value { expected, .. }, Some(within)) = (claim, pixels_within) {
            faults.extend(self.worst_pixel(*expected, within));
        }
        faults
    }

    /// Returns whether all channels agree.
    pub(super) fn is_grey(&self) -> bool {
        let same = |v: [f64; 3]| v[0] == v[1] && v[1] == v[2];
        same(self.mean) && same(self.half_width)
    }

    fn fault(&self, c: usize, [low, high]: [f64; 2], name: &str) -> Option<String> {
        let (mean, half) = (self.mean[c], self.half_width[c]);
        if mean - half >= low && mean + half <= high {
            return None;
        }
        let room = 0.5 * (high - low);
        let middle = 0.5 * (high + low);
        let share = |v: f64| format!("{} %", figures(100.0 * v / middle.abs()));
        let [off, limit, noise] =
            [mean - middle, room, half].map(|v| if middle == 0.0 { figures(v) } else { share(v) });
        Some(if mean + half >= low && mean - half <= high {
            format!("{name} is known to ± {noise} only, of at most ± {limit}: more samples would tell")
        } else {
            format!("{name} is off by {off}, ± {noise}, of at most ± {limit}")
        })
    }

    fn worst_pixel(&self, expected: [f64; 3], within: f64) -> Option<String> {
        let all = (0..3).flat_map(|c| self.extremes[c].map(|(value, at)| (c, value, at)));
        let off = |(c, value, _): &(usize, f64, [usize; 2])| (value - expected[*c]).abs();
        let beyond = |found: &(usize, f64, [usize; 2])| off(found) > within * expected[found.0].abs();
        let (c, value, [x, y]) =
            all.filter(beyond).reduce(|worst, next| if off(&next) > off(&worst) { next } else { worst })?;
        let (channel, value, expected) = (CHANNELS[c], figures(value), figures(expected[c]));
        Some(format!(
            "{channel} of pixel ({x}, {y}) is {value}, expected {expected} ± {} %",
            figures(100.0 * within)
        ))
    }
}

/// Returns the sum of a channel over the pixels of a rectangle.
fn sum_over(image: &Image, rect: PixelRect, c: usize) -> f64 {
    let columns = rect.x as usize..(rect.x + rect.width) as usize;
    let rows = rect.y as usize..(rect.y + rect.height) as usize;
    rows.flat_map(|y| columns.clone().map(move |x| (x, y)))
        .map(|(x, y)| f64::from(image.pixel(x, y)[c]))
        .sum()
}

/// Formats a number with three significant figures.
pub(super) fn figures(value: f64) -> String {
    rounded(value, 3)
}

/// Formats a number with a number of significant figures, without trailing zeros.
pub(super) fn rounded(value: f64, figures: usize) -> String {
    if value == 0.0 || !value.is_finite() {
        return format!("{}", value + 0.0);
    }
    let scientific = format!("{value:.*e}", figures - 1);
    let exponent: i32 = scientific.split_once('e').and_then(|(_, e)| e.parse().ok()).unwrap_or(0);
    if (-4..6).contains(&exponent) {
        let decimals = usize::try_from(figures as i32 - 1 - exponent).unwrap_or(0);
        trimmed(&format!("{value:.decimals$}")).to_owned()
    } else {
        let (mantissa, _) = scientific.split_once('e').unwrap_or((&scientific, ""));
        format!("{}e{exponent}", trimmed(mantissa))
    }
}

fn trimmed(number: &str) -> &str {
    if number.contains('.') { number.trim_end_matches('0').trim_end_matches('.') } else { number }
}

/// Formats a value with half the width of its interval, which determines the number of decimals.
pub(super) fn with_interval(value: f64, half_width: f64) -> String {
    if half_width <= 0.0 {
        return rounded(value, 6);
    }
    let digits = |v: f64| v.abs().log10().floor();
    let figures = if value == 0.0 { 2.0 } else { digits(value) - digits(half_width) + 2.0 };
    format!("{} ± {}", rounded(value, figures.clamp(1.0, 9.0) as usize), rounded(half_width, 2))
}

#[cfg(test)]
mod tests {
    use super::*;

    const SURE: Confidence<'static> = Confidence { significance: 1e-3, replicates: &[] };

    fn image(values: &[f32], variance: f32) -> Image {
        let mut image =
            Image::new(values.len(), 1, &["R", "G", "B", "variance.R", "variance.G", "variance.B"]);
        for (pixel, v) in image.data.chunks_exact_mut(6).zip(values) {
            pixel.copy_from_slice(&[*v, *v, *v, variance, variance, variance]);
        }
        image
    }

    fn value(expected: f64, within: f64) -> Claim {
        Claim::Value { expected: [expected; 3], within }
    }

    #[test]
    fn the_whole_interval_must_be_within_the_bounds() {
        let region = Region::measure(&image(&[0.92, 1.1, 0.96, 1.02], 1e-4), None, SURE).unwrap();
        // √(4e-4)/4 = 0.005, times the quantile of Student's t of 10 degrees of freedom beyond 1e-3/3.
        assert!(
            (region.mean[0] - 1.0).abs() < 1e-6 && (0.025..0.028).contains(&region.half_width[0]),
            "{region:?}"
        );
        assert!(region.faults(&value(1.0, 0.03), None).is_empty());
        let says = |claim, pixels| region.faults(&claim, pixels).join("; ");
        let noisy = says(value(1.0, 0.01), None);
        assert!(
            noisy.starts_with("the mean is known to ± 2.")
                && noisy.ends_with("% only, of at most ± 1 %: more samples would tell"),
            "{noisy}"
        );
        let off = says(value(2.0, 0.01), None);
        assert!(
            off.starts_with("the mean is off by -50 %, ± 1.") && off.ends_with(" %, of at most ± 1 %"),
            "{off}"
        );
        assert_eq!(says(value(1.0, 0.03), Some(0.05)), "R of pixel (1, 0) is 1.1, expected 1 ± 5 %");
        assert!(says(Claim::Between { low: [0.9; 3], high: [1.1; 3] }, None).is_empty());
    }

    #[test]
    fn rectangles_and_black() {
        let image = image(&[7.0, 0.0, 0.0], 0.0);
        let rect = |x, width| Some(PixelRect { x, y: 0, width, height: 1 });
        let region = Region::measure(&image, rect(1, 2), SURE).unwrap();
        assert!(region.faults(&value(0.0, 0.01), Some(0.1)).is_empty());
        let seven = Region::measure(&image, rect(0, 1), SURE).unwrap();
        assert_eq!(seven.faults(&value(0.0, 0.01), None), ["the mean is off by 7, ± 0, of at most ± 0"]);
        let beyond = Region::measure(&image, rect(2, 2), SURE).unwrap_err();
        assert_eq!(beyond, "pixels: expected a part of the image, which has 3x1 pixels");
    }

    #[test]
    fn numbers_have_the_figures_that_are_known() {
        assert_eq!(with_interval(0.999_83, 0.000_412), "0.99983 ± 0.00041");
        assert_eq!(with_interval(123_456.0, 70.0), "123456 ± 70");
        assert_eq!(with_interval(1.0, 0.0), "1");
        assert_eq!(with_interval(3.2e-9, 1.4e-10), "3.2e-9 ± 1.4e-10");
        assert_eq!([figures(0.0), figures(-12.3456), figures(1e8)], ["0", "-12.3", "1e8"]);
    }
}
