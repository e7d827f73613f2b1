//! Estimated means against exact ones and against each other.

use super::scenes::mean;
use super::statistics::{normal_tail, sidak};
use buffon::accel::AccelKind;
use buffon::render::Rendered;
use buffon::sampling::SamplerKind;

/// Probability that any of the `tests` comparisons of right means fails.
const SIGNIFICANCE: f64 = 0.01;
/// What rounding in `f32` may add up to, relative to the mean.
const ROUNDING: f64 = 3e-5;

/// A group of comparisons that share the significance level.
#[derive(Clone, Copy)]
pub struct Means {
    /// How many means are compared, three for an image.
    pub tests: usize,
    /// The largest standard error, relative to the mean: a noisy estimate proves nothing.
    pub largest_error: f64,
}

impl Means {
    /// A group of comparisons of so many images.
    pub fn of_images(images: usize, largest_error: f64) -> Self {
        Means { tests: 3 * images, largest_error }
    }

    /// The mean of an image must be `exact`.
    ///
    /// # Panics
    /// With the figures, if it is not, if it is too noisy to tell, or if samples were dropped.
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

    /// The means of two images that are rendered independently must be the same.
    ///
    /// # Panics
    /// As [`expect`](Self::expect).
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

/// Every traversal with samplers whose pixels are independent of each other, as a standard error of the mean over
/// pixels supposes; `samplers.rs` has the others.
pub fn combinations() -> Vec<(AccelKind, SamplerKind)> {
    let samplers = [SamplerKind::Independent, SamplerKind::Stratified, SamplerKind::Sobol];
    let with = |&accel| samplers.map(|sampler| (accel, sampler));
    AccelKind::CHOICES.iter().flat_map(with).collect()
}
