//! Moments of measured values, with the uncertainty of each.

/// A number with its standard error.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Measured {
    /// The estimate.
    pub value: f64,
    /// Standard error of the estimate.
    pub error: f64,
}

/// How many standard errors a measured number may be off before a claim counts as refuted: by chance that happens to
/// one in 370 normal numbers.
pub const TOLERANCE: f64 = 3.0;

impl Measured {
    /// Whether the truth may be `exact`, within three standard errors and rounding.
    pub fn agrees_with(&self, exact: f64) -> bool {
        (self.value - exact).abs() <= TOLERANCE * self.error + 1e-12 * exact.abs().max(1.0)
    }

    /// The mean of independent values.
    pub fn mean(values: &[f64]) -> Measured {
        let n = values.len() as f64;
        let mean = values.iter().sum::<f64>() / n;
        let variance = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (n - 1.0);
        Measured { value: mean, error: (variance / n).sqrt() }
    }

    /// The variance of the distribution that independent values come from.
    pub fn variance(values: &[f64]) -> Measured {
        let n = values.len() as f64;
        let mean = values.iter().sum::<f64>() / n;
        let squares: Vec<f64> = values.iter().map(|v| (v - mean).powi(2)).collect();
        let Measured { value, error } = Measured::mean(&squares);
        Measured { value: value * n / (n - 1.0), error }
    }

    /// The root of the mean square of independent errors.
    pub fn rms(errors: &[f64]) -> Measured {
        let squares: Vec<f64> = errors.iter().map(|e| e * e).collect();
        let Measured { value, error } = Measured::mean(&squares);
        let root = value.sqrt();
        Measured { value: root, error: if root > 0.0 { 0.5 * error / root } else { 0.0 } }
    }
}

/// Covariance of pairs of values.
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
        assert_eq!(Measured::mean(&values), Measured { value: 3.0, error: (14.0f64 / 3.0 / 4.0).sqrt() });
        assert!((Measured::variance(&values).value - 14.0 / 3.0).abs() < 1e-15);
        assert!((Measured::rms(&[3.0, 4.0]).value - 12.5f64.sqrt()).abs() < 1e-15);
        assert_eq!(covariance(&values, &values.map(|v| 1.0 - 2.0 * v)), -2.0 * 14.0 / 3.0);
    }

    /// Over 400 repetitions the stated error of a variance is its true error, to within 10 %.
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
