//! Convergence rates: power laws fitted to measured errors.

use statrs::distribution::{ContinuousCDF, StudentsT};

/// The confidence level of the intervals.
pub const CONFIDENCE: f64 = 0.95;

/// A power law `y = factor · x^exponent`, fitted by least squares to the logarithms.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PowerLaw {
    /// The exponent, which is the slope in a log-log plot.
    pub exponent: f64,
    /// The 95 % confidence interval of the exponent, from the residuals of the fit.
    pub interval: [f64; 2],
    /// The value at x = 1.
    pub factor: f64,
}

impl PowerLaw {
    /// Fits a power law to the points (x, y). Points with coordinates that are not positive and finite are ignored;
    /// `None` with fewer than three different points.
    pub fn fit(points: impl IntoIterator<Item = (f64, f64)>) -> Option<PowerLaw> {
        let usable = |v: f64| v > 0.0 && v.is_finite();
        let points: Vec<(f64, f64)> = points
            .into_iter()
            .filter(|&(x, y)| usable(x) && usable(y))
            .map(|(x, y)| (x.ln(), y.ln()))
            .collect();
        let n = points.len() as f64;
        if points.len() < 3 {
            return None;
        }
        let mean_x = points.iter().map(|p| p.0).sum::<f64>() / n;
        let mean_y = points.iter().map(|p| p.1).sum::<f64>() / n;
        let spread = points.iter().map(|p| (p.0 - mean_x).powi(2)).sum::<f64>();
        if spread <= 0.0 {
            return None;
        }
        let exponent = points.iter().map(|p| (p.0 - mean_x) * (p.1 - mean_y)).sum::<f64>() / spread;
        let offset = mean_y - exponent * mean_x;
        let residual = points.iter().map(|p| (p.1 - offset - exponent * p.0).powi(2)).sum::<f64>();
        let error = (residual / (n - 2.0) / spread).sqrt();
        let quantile = StudentsT::new(0.0, 1.0, n - 2.0).ok()?.inverse_cdf(0.5 + 0.5 * CONFIDENCE);
        let half = quantile * error;
        Some(PowerLaw { exponent, interval: [exponent - half, exponent + half], factor: offset.exp() })
    }

    /// Returns the value of the law at `x`.
    pub fn at(&self, x: f64) -> f64 {
        self.factor * x.powf(self.exponent)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_law_without_scatter_is_found_exactly() {
        let law = PowerLaw::fit([1.0, 10.0, 100.0, 1e4].map(|x: f64| (x, 3.0 * x.powf(-0.5)))).unwrap();
        assert!((law.exponent + 0.5).abs() < 1e-12 && (law.factor - 3.0).abs() < 1e-12);
        assert!(law.interval[1] - law.interval[0] < 1e-6);
        assert!((law.at(25.0) - 0.6).abs() < 1e-12);
    }

    /// Computed by hand: the logarithms (0, 0), (1, 1), (2, 0) have the slope 0 with the standard error √(2/3 / 2),
    /// times 12.706.
    #[test]
    fn the_interval_is_students() {
        let e = std::f64::consts::E;
        let law = PowerLaw::fit([(1.0, 1.0), (e, e), (e * e, 1.0)]).unwrap();
        assert!(law.exponent.abs() < 1e-12);
        assert!((law.interval[1] - 12.706_204_7 * (1.0f64 / 3.0).sqrt()).abs() < 1e-5, "{law:?}");
    }

    #[test]
    fn too_few_points_have_no_law() {
        assert_eq!(PowerLaw::fit([(1.0, 1.0), (2.0, 1.0)]), None);
        assert_eq!(PowerLaw::fit([(1.0, 1.0); 5]), None);
        assert_eq!(PowerLaw::fit([(1.0, 1.0), (2.0, 0.0), (3.0, f64::NAN), (4.0, 1.0)]), None);
    }
}
