//! Moments of measured values, and their standard errors.

use crate::estimate::convergence::PowerLaw;

/// A number with its standard error.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Measured {
    /// The estimate.
    pub value: f64,
    /// Standard error of the estimate.
    pub error: f64,
    /// Degrees of freedom of the standard error.
    pub freedom: f64,
}

/// The greatest number of groups of runs from which a jackknife leaves out one at a time.
const GROUPS: usize = 10;

impl Measured {
    /// The value of a number that was not measured.
    pub const NONE: Measured = Measured { value: f64::NAN, error: f64::NAN, freedom: 1.0 };

    /// Returns the ratio of two measured numbers with independent errors.
    pub fn over(self, other: Measured) -> Measured {
        let value = self.value / other.value;
        let error = value.abs() * (self.error / self.value).hypot(other.error / other.value);
        Measured { value, error, freedom: self.freedom.min(other.freedom) }
    }

    /// Returns the difference of two measured numbers with independent errors.
    pub fn minus(self, other: Measured) -> Measured {
        let error = self.error.hypot(other.error);
        Measured { value: self.value - other.value, error, freedom: self.freedom.min(other.freedom) }
    }

    /// Returns the exponent of the power law that root mean squares follow. Each of the `points` has an abscissa and
    /// the squared error of every run. The standard error is that of a jackknife over groups of runs.
    pub fn exponent(points: &[(f64, &[f64])]) -> Measured {
        let runs = points.iter().map(|(_, squares)| squares.len()).min().unwrap_or(0);
        let groups = runs.min(GROUPS);
        let without = |left_out: Option<usize>| {
            let rms = |squares: &[f64]| {
                let kept = squares.iter().enumerate().filter(|(i, _)| Some(i % groups.max(1)) != left_out);
                let (sum, n) = kept.fold((0.0, 0.0), |(sum, n), (_, square)| (sum + square, n + 1.0));
                (sum / n).sqrt()
            };
            let law = PowerLaw::fit(points.iter().map(|(x, squares)| (*x, rms(squares))));
            law.map_or(f64::NAN, |law| law.exponent)
        };
        Measured::jackknife(groups, without)
    }

    /// Returns an estimate from all groups of the data, `without(None)`. Its standard error comes from the estimates
    /// that leave out one group each, and is unknown with fewer than two groups.
    pub fn jackknife(groups: usize, without: impl Fn(Option<usize>) -> f64) -> Measured {
        if groups < 2 {
            return Measured { value: without(None), ..Measured::NONE };
        }
        let parts: Vec<f64> = (0..groups).map(|group| without(Some(group))).collect();
        let Measured { error, freedom, .. } = Measured::mean(&parts);
        Measured { value: without(None), error: error * freedom, freedom }
    }

    /// Returns the mean of independent values.
    pub fn mean(values: &[f64]) -> Measured {
        let n = values.len() as f64;
        let mean = values.iter().sum::<f64>() / n;
        let variance = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (n - 1.0);
        Measured { value: mean, error: (variance / n).sqrt(), freedom: n - 1.0 }
    }

    /// Returns the variance of the distribution of independent values.
    pub fn variance(values: &[f64]) -> Measured {
        let n = values.len() as f64;
        let mean = values.iter().sum::<f64>() / n;
        let squares: Vec<f64> = values.iter().map(|v| (v - mean).powi(2)).collect();
        let mean = Measured::mean(&squares);
        Measured { value: mean.value * n / (n - 1.0), ..mean }
    }

    /// Returns the root mean square of independent errors.
    pub fn rms(errors: &[f64]) -> Measured {
        Measured::root(&errors.iter().map(|e| e * e).collect::<Vec<_>>())
    }

    /// Returns the square root of the mean of independent squares.
    pub fn root(squares: &[f64]) -> Measured {
        let Measured { value, error, freedom } = Measured::mean(squares);
        let root = value.sqrt();
        Measured { value: root, error: if root > 0.0 { 0.5 * error / root } else { 0.0 }, freedom }
    }
}

/// Returns the covariance of pairs of values.
pub fn covariance(x: &[f64], y: &[f64]) -> f64 {
    let n = x.len() as f64;
    let mean = |values: &[f64]| values.iter().sum::<f64>() / n;
    let (mean_x, mean_y) = (mean(x), mean(y));
    x.iter().zip(y).map(|(x, y)| (x - mean_x) * (y - mean_y)).sum::<f64>() / (n - 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lab::random::Stream;

    #[test]
    fn moments_by_hand() {
        let values = [1.0, 2.0, 3.0, 6.0];
        assert_eq!(
            Measured::mean(&values),
            Measured { value: 3.0, error: (14.0f64 / 3.0 / 4.0).sqrt(), freedom: 3.0 }
        );
        assert!((Measured::variance(&values).value - 14.0 / 3.0).abs() < 1e-15);
        assert!((Measured::rms(&[3.0, 4.0]).value - 12.5f64.sqrt()).abs() < 1e-15);
        assert_eq!(covariance(&values, &values.map(|v| 1.0 - 2.0 * v)), -2.0 * 14.0 / 3.0);
    }

    /// Over 300 repetitions, the stated error of a slope agrees with its true error within 25 %.
    #[test]
    fn slopes_are_as_uncertain_as_stated() {
        let slopes: Vec<Measured> = (0..300)
            .map(|run| {
                let mut stream = Stream::new(2, 0, run);
                let mut squares = |n: f64| (0..100).map(|_| (stream.uniform() - 0.5).powi(2) / n).collect();
                let points: [(f64, Vec<f64>); 3] = [1.0, 4.0, 16.0].map(|n| (n, squares(n)));
                Measured::exponent(&points.each_ref().map(|(n, squares)| (*n, squares.as_slice())))
            })
            .collect();
        let true_error = Measured::rms(&slopes.iter().map(|m| m.value + 0.5).collect::<Vec<_>>()).value;
        let stated = Measured::rms(&slopes.iter().map(|m| m.error).collect::<Vec<_>>()).value;
        assert!((stated / true_error - 1.0).abs() < 0.25, "{stated} {true_error}");
        assert!(slopes.iter().all(|m| m.freedom == 9.0));
    }

    /// Over 400 repetitions, the stated error of a variance agrees with its true error within 10 %.
    #[test]
    fn errors_are_as_large_as_stated() {
        let repeated: Vec<Measured> = (0..400)
            .map(|run| {
                let mut stream = Stream::new(1, 0, run);
                Measured::variance(&(0..500).map(|_| stream.uniform().powi(2)).collect::<Vec<_>>())
            })
            .collect();
        let exact = 1.0 / 5.0 - 1.0 / 9.0;
        let true_error = Measured::rms(&repeated.iter().map(|m| m.value - exact).collect::<Vec<_>>()).value;
        let stated = Measured::rms(&repeated.iter().map(|m| m.error).collect::<Vec<_>>()).value;
        assert!((stated / true_error - 1.0).abs() < 0.1, "{stated} {true_error}");
    }
}
