//! Importance sampling of 5x⁴ with densities (k + 1)·x^k: good ones, a perfect one and a bad one.

use super::power;
use crate::estimate::convergence::PowerLaw;
use crate::lab::moments::Measured;
use crate::lab::outcome::{Evidence, Finding, plus_minus, slope};
use crate::lab::random::Stream;
use crate::lab::verdict::Check;
use crate::lab::{Found, Options};
use crate::report::{Align, Axis, Line, Plot, Point, Series, Table};
use rayon::prelude::*;

/// Exponents k. For each of them the fourth moment of f/p is finite, so that a measured variance has an interval.
const EXPONENTS: [f64; 6] = [-0.9, 0.0, 1.0, 3.0, 4.0, 5.0];
const COUNTS: [u32; 7] = [10, 32, 100, 316, 1000, 3162, 10_000];

/// Returns the variance of f/p: ∫f²/p − 1 = 25/((k + 1)(9 − k)) − 1.
fn exact_variance(k: f64) -> f64 {
    25.0 / ((k + 1.0) * (9.0 - k)) - 1.0
}

/// Returns f(x)/p(x) at a point x sampled from p.
fn weighted(k: f64, u: f64) -> f64 {
    let x = u.powf(1.0 / (k + 1.0));
    5.0 / (k + 1.0) * x.powf(4.0 - k)
}

/// Returns the mean of f/p over n points.
fn estimate(k: f64, n: u32, stream: &mut Stream) -> f64 {
    (0..n).map(|_| weighted(k, stream.uniform())).sum::<f64>() / f64::from(n)
}

/// The errors of one density.
struct DensityRow {
    k: f64,
    /// Variance of f/p, from many values.
    variance: Measured,
    /// RMS error at each number of samples.
    errors: Vec<Measured>,
    law: Option<PowerLaw>,
    /// The exponent of the law, with an error from the runs.
    exponent: Measured,
}

fn measure(i: usize, options: &Options) -> DensityRow {
    let (k, part) = (EXPONENTS[i], 400 + 20 * i as u32);
    let mut stream = Stream::new(options.seed, part, 0);
    let values: Vec<f64> = (0..500 * options.runs).map(|_| weighted(k, stream.uniform())).collect();
    let squares = |(j, &n): (usize, &u32)| -> Vec<f64> {
        let stream = |run| Stream::new(options.seed, part + 1 + j as u32, run);
        let errors: Vec<f64> = (0..options.runs)
            .into_par_iter()
            .map(|run| estimate(k, n, &mut stream(run)) - power().integral)
            .collect();
        errors.iter().map(|e| e * e).collect()
    };
    let squares: Vec<Vec<f64>> = COUNTS.iter().enumerate().map(squares).collect();
    let errors: Vec<Measured> = squares.iter().map(|squares| Measured::root(squares)).collect();
    // A perfect density has only rounding errors, which follow no law.
    let perfect = exact_variance(k).abs() < 1e-12;
    let points = COUNTS.iter().zip(&errors).map(|(&n, e)| (f64::from(n), e.value));
    let law = if perfect { None } else { PowerLaw::fit(points) };
    let points: Vec<_> = COUNTS.iter().zip(&squares).map(|(&n, s)| (f64::from(n), s.as_slice())).collect();
    let exponent = Measured::exponent(&points);
    DensityRow { k, variance: Measured::variance(&values), errors, law, exponent }
}

/// Returns the density as a formula.
fn density(k: f64) -> String {
    match k {
        0.0 => "1 (uniform)".into(),
        1.0 => "2x".into(),
        4.0 => "5x⁴ (perfect)".into(),
        _ => format!("{}·x^{k}", ((k + 1.0) * 10.0).round() / 10.0),
    }
}

fn plot(rows: &[DensityRow]) -> Plot {
    let series = rows.iter().enumerate().filter(|(_, row)| row.law.is_some()).map(|(i, row)| {
        let points = COUNTS.iter().zip(&row.errors).map(|(&n, e)| Point::new(f64::from(n), e.value));
        Series {
            name: format!("p = {}", density(row.k)),
            points: points.collect(),
            style: i,
            line: Line::Solid,
        }
    });
    Plot {
        title: "RMS error of the integral of 5x⁴ by the density of the samples".into(),
        x: Axis::log("samples N"),
        y: Axis::log("RMS error"),
        series: series.collect(),
    }
}

/// Measures the error with every density.
pub fn run(options: &Options) -> Found {
    let rows: Vec<DensityRow> = (0..EXPONENTS.len()).map(|i| measure(i, options)).collect();
    let mut table = Table::new([
        ("density p", Align::Left),
        ("variance of f/p", Align::Right),
        ("exact", Align::Right),
        ("against uniform", Align::Right),
        ("slope of the RMS error", Align::Right),
    ]);
    for row in &rows {
        table.row([
            density(row.k),
            plus_minus(row.variance),
            format!("{:.5}", exact_variance(row.k)),
            format!("{:.3}", exact_variance(row.k) / exact_variance(0.0)),
            slope(row.law),
        ]);
    }
    let of = |k: f64| rows.iter().find(|row| row.k == k).map_or(Measured::NONE, |row| row.variance);
    let laws: Vec<Measured> = rows.iter().filter(|row| row.law.is_some()).map(|row| row.exponent).collect();
    let (least, most) = laws.iter().fold((f64::MAX, f64::MIN), |(a, b), e| (a.min(e.value), b.max(e.value)));
    let mut variances: Vec<Check> = rows
        .iter()
        .map(|row| Check::near(row.variance, exact_variance(row.k), 0.05 * exact_variance(row.k)))
        .collect();
    variances.extend([Check::below(of(3.0).minus(of(0.0)), 0.0), Check::below(of(0.0).minus(of(-0.9)), 0.0)]);
    let findings = vec![
        Finding::new(
            "A density that resembles the integrand lowers the variance and a bad one raises it, to ∫f²/p − I².",
            format!(
                "variance of one sample: p = 1 {:.3}, p = 4x³ {:.4}, p = 0.1·x^−0.9 {:.2} (allowed 5 %)",
                of(0.0).value,
                of(3.0).value,
                of(-0.9).value
            ),
            &variances,
        ),
        Finding::new(
            "Importance sampling changes the constant, not the rate: the error falls as N to the power −1/2.",
            format!("slopes from {least:.3} to {most:.3} (allowed 0.05)"),
            &laws.iter().map(|e| Check::near(*e, -0.5, 0.05)).collect::<Vec<_>>(),
        ),
    ];
    (findings, vec![Evidence::Table("Importance sampling of 5x⁴".into(), table), Evidence::Plot(plot(&rows))])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::accel::AccelKind;
    use crate::lab::verdict::Verdict;

    #[test]
    fn variances_have_closed_forms() {
        assert!((exact_variance(0.0) - power().variance).abs() < 1e-15);
        assert_eq!(exact_variance(4.0), 0.0);
        let options = Options { seed: 1, runs: 100, quick: true, threads: 2, accel: AccelKind::default() };
        let (findings, _) = run(&options);
        assert!(findings.iter().all(|finding| finding.verdict != Verdict::Refuted), "{findings:?}");
    }
}
