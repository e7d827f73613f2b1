//! Student's t distribution, and the significance of multiple tests.

use statrs::function::beta::beta_reg;

/// Returns α′ of each of `n` tests that together have the significance α. [Šidák 1967]
pub fn share(significance: f64, n: usize) -> f64 {
    -((-significance).ln_1p() / n as f64).exp_m1()
}

/// Returns the probability that the least of `n` independent p-values is at most `p`. [Šidák 1967]
pub fn of_all(p: f64, n: usize) -> f64 {
    -(n as f64 * (-p).ln_1p()).exp_m1()
}

/// Returns the probability that Student's t with the given degrees of freedom is outside ±t.
pub fn tail(t: f64, freedom: f64) -> f64 {
    beta_reg(0.5 * freedom, 0.5, freedom / (freedom + t * t))
}

/// Returns the t with the given [`tail`], by bisection.
pub fn quantile(probability: f64, freedom: f64) -> f64 {
    let (mut low, mut high) = (0.0, 1e18);
    for _ in 0..200 {
        // The geometric mean once both are positive, because quantiles for few degrees of freedom are large.
        let middle = if low > 0.0 { f64::sqrt(low * high) } else { high * 1e-3 };
        if tail(middle, freedom) > probability {
            low = middle
        } else {
            high = middle
        }
        if high < 1e-3 || high - low < 1e-9 * high {
            break;
        }
    }
    high
}
