//! Comparisons of estimated means with exact means and with each other.

use super::scenes::mean;
use super::statistics::{normal_tail, sidak};
use buffon::accel::AccelKind;
use buffon::render::Rendered;
use buffon::sampling::SamplerKind;

/// The probability that at least one of the `tests` comparisons of correct means fails.
const SIGNIFICANCE: f64 = 0.01;
/// An upper bound on the accumulated rounding in `f32`, relative to the mean.
const ROUNDING: f64 = 3e-5;

/// A group of comparisons that share the significance level.
#[derive(Clone, Copy)]
pub struct Means {
    /// The number of means that are compared, three for an image.
    pub tests: usize,
    /// The largest accepted standard error, relative to the mean.
    pub largest_error: f64,
}

impl Means {
    /// Creates a group of comparisons for a number of images.
    pub fn of_images(images: usize, largest_error: f64) -> Self {
        Means { tests: 3 * images, largest_error }
    }

    /// Asserts that the mean of an image is `exact`.
    ///
    /// # Panics
    /// With the figures, if it is not, if it is too noisy for a decision, or if samples were dropped.
    pub fn expect(&self, name: &str, rendered: &Rendered, exact: [f64; 3]) {
        assert_eq!(
            rendered.invalid_count,
            0,
            "{name}: invalid samples, the first {:?}",
            rendered.invalid.first()
        );
        let (mean, error) = mean(rendered);
        for c in 0..3 {
            self.compare(name, (mean[c], error[c]), (exact[c], 0.0));
        }
    }

    /// Asserts that the means of two images that are rendered independently are the same.
    ///
    /// # Panics
    /// As for [`expect`](Self::expect).
    pub fn expect_same(&self, name: &str, a: &Rendered, b: &Rendered) {
        let ((a, error_a), (b, error_b)) = (mean(a), mean(b));
        for c in 0..3 {
            self.compare(name, (a[c], error_a[c]), (b[c], error_b[c]));
        }
    }

    fn compare(&self, name: &str, (a, error_a): (f64, f64), (b, error_b): (f64, f64)) {
        let error = error_a.hypot(error_b);
        assert!(a.is_finite() && error.is_finite(), "{name}: {a} ± {error}");
        assert!(
            error <= self.largest_error * b.abs(),
            "{name}: {a} ± {error} is too noisy to be compared with {b}"
        );
        let beyond = ((a - b).abs() - ROUNDING * b.abs()).max(0.0);
        let p = if beyond == 0.0 { 1.0 } else { normal_tail(beyond / error) };
        assert!(
            p > sidak(SIGNIFICANCE, self.tests),
            "{name}: found {a} ± {error:.2e}, expected {b}, p = {p:.1e}"
        );
    }
}

/// Returns every traversal with the samplers whose pixels are independent of each other, as the standard error of the
/// mean over pixels assumes; `samplers.rs` has the others.
pub fn combinations() -> Vec<(AccelKind, SamplerKind)> {
    let samplers = [SamplerKind::Independent, SamplerKind::Stratified, SamplerKind::Sobol];
    let with = |&accel| samplers.map(|sampler| (accel, sampler));
    AccelKind::CHOICES.iter().flat_map(with).collect()
}
