//! Distribution functions for tests, from their series and asymptotics.

/// Returns the upper tail of the chi-square distribution: the probability of a value above `x` with `k` degrees of
/// freedom. [Abramowitz and Stegun 1964, 26.4.14 via the regularised incomplete gamma function 6.5]
pub fn chi2_tail(x: f64, k: f64) -> f64 {
    let (a, x) = (0.5 * k, 0.5 * x);
    if x <= 0.0 {
        return 1.0;
    }
    let front = (-x + a * x.ln() - libm::lgamma(a)).exp();
    if x < a + 1.0 {
        // Series of the lower part.
        let (mut term, mut sum, mut n) = (1.0 / a, 1.0 / a, a);
        while term > sum * 1e-16 {
            n += 1.0;
            term *= x / n;
            sum += term;
        }
        return 1.0 - front * sum;
    }
    // Continued fraction of the upper part, by Lentz' method.
    let mut b = x + 1.0 - a;
    let mut c = 1e300;
    let mut d = 1.0 / b;
    let mut h = d;
    for i in 1..10_000 {
        let an = -f64::from(i) * (f64::from(i) - a);
        b += 2.0;
        d = 1.0 / (an * d + b);
        c = b + an / c;
        h *= d * c;
        if (d * c - 1.0).abs() < 1e-15 {
            break;
        }
    }
    front * h
}

/// Returns the two-sided tail of the normal distribution: the probability of a value beyond ±z.
pub fn normal_tail(z: f64) -> f64 {
    libm::erfc(z.abs() / std::f64::consts::SQRT_2)
}

/// Returns the significance of each of `n` tests such that all of them together have `alpha`. [Šidák 1967]
pub fn sidak(alpha: f64, n: usize) -> f64 {
    1.0 - (1.0 - alpha).powf(1.0 / n as f64)
}

#[test]
fn tails_agree_with_tables() {
    assert!((chi2_tail(3.841_458_8, 1.0) - 0.05).abs() < 1e-8);
    assert!((chi2_tail(124.342_113, 100.0) - 0.05).abs() < 1e-8);
    assert!((chi2_tail(2.705_543_5, 1.0) - 0.1).abs() < 1e-8);
    assert!((normal_tail(1.959_963_985) - 0.05).abs() < 1e-9);
}
