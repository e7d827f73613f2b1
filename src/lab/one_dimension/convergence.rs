//! The error of a mean of N values, for independent and for stratified points.

use super::{Integrand, exponential, power, stratified, unstratified};
use crate::estimate::convergence::PowerLaw;
use crate::lab::moments::Measured;
use crate::lab::outcome::{Evidence, Finding, plus_minus, slope};
use crate::lab::random::Stream;
use crate::lab::verdict::Check;
use crate::lab::{Found, Options};
use crate::report::{Align, Axis, Line, Plot, Point, Series, Table};
use rayon::prelude::*;

/// Numbers of samples: two in each decade.
const COUNTS: [u32; 11] = [1, 3, 10, 32, 100, 316, 1000, 3162, 10_000, 31_623, 100_000];
/// The fits begin at this number of samples, because the laws are asymptotic.
const FIT_FROM: u32 = 10;

/// Errors of both estimators at one number of samples.
struct CountRow {
    n: u32,
    /// Both estimates of the first run.
    first: [f64; 2],
    /// Errors of all runs.
    errors: [Vec<f64>; 2],
}

fn measure(integrand: &Integrand, part: u32, options: &Options) -> Vec<CountRow> {
    let measure = |(k, &n): (usize, &u32)| {
        let part = part + 2 * k as u32;
        let estimates: Vec<[f64; 2]> = (0..options.runs)
            .into_par_iter()
            .map(|run| {
                [
                    unstratified(integrand.f, n, &mut Stream::new(options.seed, part, run)),
                    stratified(integrand.f, n, &mut Stream::new(options.seed, part + 1, run)),
                ]
            })
            .collect();
        let errors = [0, 1].map(|i| estimates.iter().map(|e| e[i] - integrand.integral).collect());
        CountRow { n, first: estimates[0], errors }
    };
    COUNTS.iter().enumerate().map(measure).collect()
}

/// Returns the law of one estimator's RMS error.
fn law(rows: &[CountRow], estimator: usize) -> Option<PowerLaw> {
    let fitted = rows.iter().filter(|row| row.n >= FIT_FROM);
    PowerLaw::fit(fitted.map(|row| (f64::from(row.n), Measured::rms(&row.errors[estimator]).value)))
}

/// Returns the exponent of the law, with an error from the runs.
fn exponent(rows: &[CountRow], estimator: usize) -> Measured {
    let fitted = rows.iter().filter(|row| row.n >= FIT_FROM);
    let squares = |row: &CountRow| row.errors[estimator].iter().map(|e| e * e).collect();
    let points: Vec<(f64, Vec<f64>)> = fitted.map(|row| (f64::from(row.n), squares(row))).collect();
    Measured::exponent(&points.iter().map(|(n, squares)| (*n, squares.as_slice())).collect::<Vec<_>>())
}

/// Returns the squared errors of the independent estimator times N. Their expected value is the variance of f.
fn scaled(row: &CountRow) -> impl Iterator<Item = f64> {
    row.errors[0].iter().map(|e| e * e * f64::from(row.n))
}

fn table(integrand: &Integrand, rows: &[CountRow]) -> Table {
    let mut table = Table::new([
        ("N", Align::Right),
        ("one run", Align::Right),
        ("stratified", Align::Right),
        ("RMS error", Align::Right),
        ("σ/√N", Align::Right),
        ("N·variance", Align::Right),
        ("RMS stratified", Align::Right),
        ("ratio", Align::Right),
    ]);
    for row in rows {
        let [rms, rms_stratified] = [0, 1].map(|i| Measured::rms(&row.errors[i]).value);
        table.row([
            row.n.to_string(),
            format!("{:.5}", row.first[0]),
            format!("{:.5}", row.first[1]),
            format!("{rms:.3e}"),
            format!("{:.3e}", (integrand.variance / f64::from(row.n)).sqrt()),
            plus_minus(Measured::mean(&scaled(row).collect::<Vec<_>>())),
            format!("{rms_stratified:.3e}"),
            format!("{:.1}", rms / rms_stratified),
        ]);
    }
    table
}

fn plot(integrand: &Integrand, rows: &[CountRow], laws: [Option<PowerLaw>; 2]) -> Plot {
    let mut series = Vec::new();
    for (i, name) in ["independent", "stratified"].into_iter().enumerate() {
        let points = rows.iter().map(|row| {
            let Measured { value, error, .. } = Measured::rms(&row.errors[i]);
            let interval = Some([value - 1.96 * error, value + 1.96 * error]);
            Point { interval, ..Point::new(f64::from(row.n), value) }
        });
        let title = format!("{name}, slope {}", slope(laws[i]));
        series.push(Series { name: title, points: points.collect(), style: i, line: Line::None });
        if let Some(law) = laws[i] {
            let ends = [f64::from(FIT_FROM), 1e5].map(|n| Point::new(n, law.at(n)));
            let name = format!("{name}, fitted");
            series.push(Series { name, points: ends.to_vec(), style: i, line: Line::Guide });
        }
    }
    Plot {
        title: format!("RMS error of the integral of {} against the number of samples", integrand.name),
        x: Axis::log("samples N"),
        y: Axis::log("RMS error"),
        series,
    }
}

fn findings(integrand: &Integrand, rows: &[CountRow]) -> Vec<Finding> {
    let name = integrand.name;
    let last = &rows[rows.len() - 1];
    let off = Measured::mean(&last.errors[1]);
    let slopes = [0, 1].map(|estimator| exponent(rows, estimator));
    let variance = Measured::mean(&rows.iter().flat_map(scaled).collect::<Vec<_>>());
    vec![
        Finding::new(
            format!("The integral of {name} over [0, 1] is {:.5}.", integrand.integral),
            format!(
                "{:.5} by {} stratified samples, the mean of all runs (allowed 5e-6)",
                integrand.integral + off.value,
                last.n
            ),
            &[Check::near(off, 0.0, 5e-6)],
        ),
        Finding::new(
            format!("The error of a mean of N independent values of {name} falls as N to the power −1/2."),
            format!("slope {} (allowed 0.03)", plus_minus(slopes[0])),
            &[Check::near(slopes[0], -0.5, 0.03)],
        ),
        Finding::new(
            format!("Stratified, the error for {name} falls at least as 1/N."),
            format!("slope {} (−3/2 is expected of smooth functions)", plus_minus(slopes[1])),
            &[Check::below(slopes[1], -1.0)],
        ),
        Finding::new(
            format!("The variance of a mean of N independent values of {name} is σ²/N."),
            format!(
                "N·variance {} over all N; σ² = {:.5} (allowed 10 %)",
                plus_minus(variance),
                integrand.variance
            ),
            &[Check::near(variance, integrand.variance, 0.1 * integrand.variance)],
        ),
    ]
}

/// Measures the convergence for both integrands.
pub fn run(options: &Options) -> Found {
    let mut found: Found = (Vec::new(), Vec::new());
    for (i, integrand) in [power(), exponential()].into_iter().enumerate() {
        let rows = measure(&integrand, 100 * (i as u32 + 1), options);
        let laws = [law(&rows, 0), law(&rows, 1)];
        found.0.extend(findings(&integrand, &rows));
        let title = format!(
            "{}: {} runs; slopes of the RMS errors from N = {FIT_FROM} on: independent {}, stratified {}",
            integrand.name,
            options.runs,
            slope(laws[0]),
            slope(laws[1])
        );
        found.1.push(Evidence::Table(title, table(&integrand, &rows)));
        found.1.push(Evidence::Plot(plot(&integrand, &rows, laws)));
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::accel::AccelKind;
    use crate::lab::verdict::Verdict;

    /// With 200 runs, the exponents are −1/2 within 0.03 and −3/2 within 0.05, and the variances agree with the exact
    /// ones.
    #[test]
    fn slopes_and_variances_are_those_of_the_theory() {
        let options = Options { seed: 1, runs: 200, quick: true, threads: 2, accel: AccelKind::default() };
        for (i, integrand) in [power(), exponential()].into_iter().enumerate() {
            let rows = measure(&integrand, 100 * i as u32, &options);
            let laws = [0, 1].map(|k| law(&rows, k));
            let [independent, stratified] = laws.map(|law| law.expect("eleven points").exponent);
            assert!((independent + 0.5).abs() < 0.03, "{} {independent}", integrand.name);
            assert!((stratified + 1.5).abs() < 0.05, "{} {stratified}", integrand.name);
            let findings = findings(&integrand, &rows);
            assert!(findings.iter().all(|finding| finding.verdict != Verdict::Refuted), "{findings:?}");
        }
    }
}
