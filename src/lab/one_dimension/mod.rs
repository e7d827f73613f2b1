//! Estimators of integrals over [0, 1]: convergence, variance, covariance, importance sampling.

mod convergence;
mod covariance;
mod importance;

use super::random::Stream;
use super::{Found, Options, pool};
use crate::error::Result;

/// A function on [0, 1] with a known integral.
#[derive(Clone, Copy)]
struct Integrand {
    name: &'static str,
    f: fn(f64) -> f64,
    /// ∫f
    integral: f64,
    /// Variance of f(u) for a uniform u: ∫f² − (∫f)².
    variance: f64,
}

/// Returns 5x⁴, whose integral is 1 and whose variance is 25/9 − 1.
fn power() -> Integrand {
    Integrand { name: "5x⁴", f: |x| 5.0 * x.powi(4), integral: 1.0, variance: 25.0 / 9.0 - 1.0 }
}

/// Returns e^{sin 3x²}.
fn exponential() -> Integrand {
    let f = |x: f64| (3.0 * x * x).sin().exp();
    let integral = quadrature(f);
    Integrand {
        name: "exp(sin(3x²))",
        f,
        integral,
        variance: quadrature(|x| f(x).powi(2)) - integral.powi(2),
    }
}

/// Integrates f over [0, 1] by Simpson's rule. For smooth functions, all digits are correct.
fn quadrature(f: impl Fn(f64) -> f64) -> f64 {
    let n = 1 << 14;
    let h = 1.0 / f64::from(n);
    let inner: f64 = (1..n).map(|i| f(f64::from(i) * h) * if i % 2 == 1 { 4.0 } else { 2.0 }).sum();
    (f(0.0) + inner + f(1.0)) * h / 3.0
}

/// Returns the mean of f over n independent uniform points.
fn unstratified(f: impl Fn(f64) -> f64, n: u32, stream: &mut Stream) -> f64 {
    (0..n).map(|_| f(stream.uniform())).sum::<f64>() / f64::from(n)
}

/// Returns the mean of f over one uniform point in each of n equal strata.
fn stratified(f: impl Fn(f64) -> f64, n: u32, stream: &mut Stream) -> f64 {
    (0..n).map(|i| f((f64::from(i) + stream.uniform()) / f64::from(n))).sum::<f64>() / f64::from(n)
}

/// Runs all parts of the experiment.
pub fn run(options: &Options) -> Result<Found> {
    let pool = pool(options.threads)?;
    Ok(pool.install(|| {
        let mut found = (Vec::new(), Vec::new());
        for (findings, evidence) in
            [convergence::run(options), covariance::run(options), importance::run(options)]
        {
            found.0.extend(findings);
            found.1.extend(evidence);
        }
        found
    }))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::accel::AccelKind;
    use crate::lab::moments::Measured;
    use crate::lab::verdict::Verdict;
    use rayon::prelude::*;

    /// The claims are true. A run refutes any of them with a probability of at most 0.001. None of these 200 seeds
    /// does.
    #[test]
    fn true_claims_are_refuted_with_no_seed() {
        (0..200u64).into_par_iter().for_each(|seed| {
            let options = Options { seed, runs: 10, quick: true, threads: 1, accel: AccelKind::default() };
            for (findings, _) in [covariance::run(&options), importance::run(&options)] {
                assert!(findings.iter().all(|f| f.verdict != Verdict::Refuted), "seed {seed}: {findings:?}");
            }
        });
    }

    #[test]
    fn integrals_are_those_of_the_books() {
        assert!((quadrature(power().f) - 1.0).abs() < 1e-12);
        assert!((quadrature(|x| (power().f)(x).powi(2)) - 25.0 / 9.0).abs() < 1e-12);
        assert_eq!(format!("{:.5}", exponential().integral), "1.77610");
    }

    /// For any number of points, the mean of 20,000 estimates lies within five standard errors of the integral.
    #[test]
    fn both_estimators_are_unbiased() {
        let expect = |name: &str, n: u32, integral: f64, estimate: &dyn Fn(&mut Stream) -> f64| {
            let estimates: Vec<f64> = (0..20_000).map(|run| estimate(&mut Stream::new(3, n, run))).collect();
            let mean = Measured::mean(&estimates);
            assert!((mean.value - integral).abs() < 5.0 * mean.error, "{name} {n}: {mean:?}");
        };
        for n in [1, 3, 10] {
            for Integrand { name, f, integral, .. } in [power(), exponential()] {
                expect(name, n, integral, &|stream| unstratified(f, n, stream));
                expect(name, n, integral, &|stream| stratified(f, n, stream));
            }
        }
    }
}
