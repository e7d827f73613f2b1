//! The variance of a sum of two dependent values.

use super::{power, quadrature};
use crate::lab::moments::{Measured, covariance};
use crate::lab::outcome::{Evidence, Finding, plus_minus};
use crate::lab::random::Stream;
use crate::lab::verdict::Check;
use crate::lab::{Found, Options};
use crate::report::{Align, Table};

/// Pairs for each run.
const PAIRS: u32 = 500;

/// A function of the first point of a pair and a second random number that returns the second point.
type Second = fn(f64, f64) -> f64;

/// Kinds of pairs of points.
const KINDS: [(&str, Second); 4] = [
    ("independent points", |_, v| v),
    ("the same point twice", |u, _| u),
    ("antithetic points, u and 1 − u", |u, _| 1.0 - u),
    ("half a turn apart, u and u + 1/2", |u, _| (u + 0.5).fract()),
];

/// Returns the values of 5x⁴ at the first and at the second points of pairs.
fn pairs(second: Second, part: u32, options: &Options) -> [Vec<f64>; 2] {
    let f = power().f;
    let n = options.runs * PAIRS;
    let mut stream = Stream::new(options.seed, part, 0);
    let points: Vec<[f64; 2]> = (0..n).map(|_| [stream.uniform(), stream.uniform()]).collect();
    [points.iter().map(|&[u, _]| f(u)).collect(), points.iter().map(|&[u, v]| f(second(u, v))).collect()]
}

/// Returns the exact covariance of a kind of pair: ∫f(u) f(s(u)) − (∫f)².
fn exact_covariance(kind: usize) -> f64 {
    let f = power().f;
    match kind {
        0 => 0.0,
        // s(u) jumps at 1/2, and both halves of the interval contribute the same.
        3 => quadrature(|x| f(0.5 * x) * f(0.5 * x + 0.5)) - 1.0,
        _ => quadrature(|u| f(u) * f((KINDS[kind].1)(u, 0.0))) - 1.0,
    }
}

/// Measures the covariance for every kind of pair.
pub fn run(options: &Options) -> Found {
    let variance = power().variance;
    let mut table = Table::new([
        ("x and y: 5x⁴ at", Align::Left),
        ("σ²[x] + σ²[y]", Align::Right),
        ("2 Cov[x, y]", Align::Right),
        ("their sum", Align::Right),
        ("σ²[x + y]", Align::Right),
        ("exact", Align::Right),
    ]);
    let mut checks = Vec::new();
    let mut measured = Vec::new();
    for (kind, (name, second)) in KINDS.into_iter().enumerate() {
        let [x, y] = pairs(second, 300 + kind as u32, options);
        let sums: Vec<f64> = x.iter().zip(&y).map(|(x, y)| x + y).collect();
        let separate = Measured::variance(&x).value + Measured::variance(&y).value;
        let twice_covariance = 2.0 * covariance(&x, &y);
        let of_sum = Measured::variance(&sums);
        let exact = 2.0 * variance + 2.0 * exact_covariance(kind);
        checks.push(Check::near(of_sum, exact, 0.05 * exact));
        let identity =
            Measured { value: of_sum.value - separate - twice_covariance, error: 0.0, freedom: 9.0 };
        checks.push(Check::near(identity, 0.0, 1e-9 * separate));
        measured.push(format!("{name} {}", plus_minus(of_sum)));
        table.row([
            name.to_owned(),
            format!("{separate:.4}"),
            format!("{twice_covariance:.4}"),
            format!("{:.4}", separate + twice_covariance),
            plus_minus(of_sum),
            format!("{exact:.4}"),
        ]);
    }
    let finding = Finding::new(
        "The variance of a sum is σ²[x] + σ²[y] + 2 Cov[x, y]: a repeated sample doubles it, opposite ones lower it.",
        format!("σ²[x + y]: {} (allowed 5 %)", measured.join("; ")),
        &checks,
    );
    (vec![finding], vec![Evidence::Table("Variance of the sum of two values".into(), table)])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::accel::AccelKind;
    use crate::lab::verdict::Verdict;

    /// 25·B(5, 5) − 1 for antithetic pairs, and a polynomial integrated by hand for pairs half a turn apart.
    #[test]
    fn covariances_have_closed_forms() {
        assert_eq!(exact_covariance(0), 0.0);
        assert!((exact_covariance(1) - 16.0 / 9.0).abs() < 1e-12);
        assert!((exact_covariance(2) - (25.0 * 576.0 / 362_880.0 - 1.0)).abs() < 1e-12);
        // 50 ∫₀^½ x⁴ (x + ½)⁴ = 50 Σ C(4, k) (½)⁹ / (5 + k)
        let sum: f64 = [1.0, 4.0, 6.0, 4.0, 1.0].iter().zip(5..).map(|(c, k)| c / f64::from(k)).sum();
        assert!((exact_covariance(3) - (50.0 * sum / 512.0 - 1.0)).abs() < 1e-12);
    }

    #[test]
    fn the_formula_holds() {
        let options = Options { seed: 1, runs: 100, quick: true, threads: 2, accel: AccelKind::default() };
        let (findings, _) = run(&options);
        assert!(findings.iter().all(|finding| finding.verdict != Verdict::Refuted), "{findings:?}");
    }
}
