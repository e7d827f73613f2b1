//! A chi-square test of samples against their density, over the unit square.
//!
//! Samples are first mapped to the unit square, such that the density is smooth within each cell: a sharp lobe or a
//! small emitter has its own map.

use super::statistics::{chi2_tail, sidak};
use buffon::math::{Vec2, Vec3};
use buffon::sampling::{Dimension, SampleKey, Sampler, SamplerKind};
use std::f64::consts::{PI, TAU};

/// The number of cells along the first axis; odd, so that cell borders avoid the equator and the poles' symmetries.
const ROWS: usize = 31;
/// The number of cells along the second axis.
const COLUMNS: usize = 61;
const SAMPLES: usize = 200_000;
/// The greatest number of refinements of a cell in which the density varies.
const REFINEMENTS: u32 = 4;
/// Cells with fewer expected samples are pooled.
const FEWEST: f64 = 5.0;
/// The least number of cells for a test.
const FEWEST_CELLS: f64 = 20.0;
/// The probability that a correct sampler fails at least one of the `tests`.
const SIGNIFICANCE: f64 = 0.01;

/// Compares sampled directions with `pdf` per unit solid angle. Returns the integral of the density.
///
/// `tests` is the number of comparisons that share the significance level.
///
/// # Panics
/// As for [`check_square`], and if a direction is not of unit length.
pub fn check_directions(
    name: &str,
    tests: usize,
    mut sample: impl FnMut(f32, Vec2) -> Option<Vec3>,
    pdf: impl Fn(Vec3) -> f32,
) -> f64 {
    let to_square = |w: Vec3| {
        assert!((w.length() - 1.0).abs() < 1e-4, "{name}: a direction of length {}", w.length());
        let phi = f64::from(w.y).atan2(f64::from(w.x)).rem_euclid(TAU);
        [0.5 * (f64::from(w.z) + 1.0), phi / TAU]
    };
    let density = |[x, y]: [f64; 2]| {
        let z = 2.0 * x - 1.0;
        let r = (1.0 - z * z).max(0.0).sqrt();
        let (sin, cos) = (TAU * y).sin_cos();
        4.0 * PI * f64::from(pdf(Vec3::new((r * cos) as f32, (r * sin) as f32, z as f32)))
    };
    check_square(name, tests, |u_lobe, u| sample(u_lobe, u).map(to_square), density)
}

/// Compares sampled points of the unit square with `density` per unit area. Returns the integral of the density.
///
/// # Panics
/// With the figures, if the distributions differ, the density integrates to more than 1, or it is so concentrated that
/// nothing is tested.
pub fn check_square(
    name: &str,
    tests: usize,
    mut sample: impl FnMut(f32, Vec2) -> Option<[f64; 2]>,
    density: impl Fn([f64; 2]) -> f64,
) -> f64 {
    let mut counts = vec![0u64; ROWS * COLUMNS];
    for (u_lobe, u) in numbers() {
        if let Some(point) = sample(u_lobe, u) {
            counts[cell_of(name, point)] += 1;
        }
    }
    let shares = integrate(&density);
    let total: f64 = shares.iter().sum();
    assert!(total < 1.0 + 2e-3, "{name}: the density integrates to {total}");
    let (statistic, cells) = statistic(name, &counts, &shares);
    assert!(cells >= FEWEST_CELLS, "{name}: the density is concentrated in {cells} cells: nothing is tested");
    let p = chi2_tail(statistic, cells - 1.0);
    let n: u64 = counts.iter().sum();
    assert!(
        p > sidak(SIGNIFICANCE, tests),
        "{name}: chi-square {statistic:.1} over {cells} cells, p = {p:.2e}; the density integrates to {total:.4}, {n} of \
         {SAMPLES} samples; cells far off (row, column, count, expected): {:?}",
        outliers(&counts, &shares)
    );
    total
}

/// Returns Pearson's statistic and its number of cells, with rare cells pooled. The samples that were not drawn are
/// also a cell.
fn statistic(name: &str, counts: &[u64], shares: &[f64]) -> (f64, f64) {
    let (mut sum, mut cells) = (0.0, 0.0);
    let mut add = |count: u64, expected: f64| {
        sum += (count as f64 - expected).powi(2) / expected;
        cells += 1.0;
    };
    let (mut pooled_expected, mut pooled_count) = (0.0, 0u64);
    for (count, share) in counts.iter().zip(shares) {
        let expected = share * SAMPLES as f64;
        if expected < FEWEST {
            pooled_expected += expected;
            pooled_count += count;
        } else {
            add(*count, expected);
        }
    }
    if pooled_expected >= FEWEST {
        add(pooled_count, pooled_expected);
    } else {
        assert!(pooled_count <= 20, "{name}: {pooled_count} samples where {pooled_expected:.2} are expected");
    }
    let missing = SAMPLES as f64 * (1.0 - shares.iter().sum::<f64>());
    if missing >= SAMPLES as f64 * 0.01 {
        add(SAMPLES as u64 - counts.iter().sum::<u64>(), missing);
    }
    (sum, cells)
}

/// Returns the cells that contribute most, for the message of a failure.
fn outliers(counts: &[u64], shares: &[f64]) -> Vec<(usize, usize, u64, f64)> {
    let mut list: Vec<_> = counts
        .iter()
        .zip(shares)
        .enumerate()
        .map(|(i, (&n, share))| (i / COLUMNS, i % COLUMNS, n, (share * SAMPLES as f64 * 10.0).round() / 10.0))
        .collect();
    let contribution =
        |&(_, _, n, expected): &(usize, usize, u64, f64)| (n as f64 - expected).powi(2) / expected.max(1.0);
    list.sort_by(|a, b| contribution(b).total_cmp(&contribution(a)));
    list.truncate(5);
    list
}

/// Returns independent random numbers, the same in every run.
fn numbers() -> impl Iterator<Item = (f32, Vec2)> {
    let keys: Vec<_> = (0..SAMPLES as u32).map(|i| SampleKey::new(11, i % 1024, i / 1024, 0)).collect();
    let draw = |d: u64| {
        let (mut x, mut y) = (vec![0.0; SAMPLES], vec![0.0; SAMPLES]);
        Sampler::new(SamplerKind::Independent, None).fill_2d(Dimension(d), &keys, &mut x, &mut y);
        (x, y)
    };
    let (lobe, _) = draw(0);
    let (x, y) = draw(1);
    lobe.into_iter().zip(x.into_iter().zip(y).map(|(x, y)| Vec2::new(x, y)))
}

/// Returns the cell of a point. Rounding may move a point slightly over the border of the square.
fn cell_of(name: &str, [x, y]: [f64; 2]) -> usize {
    let inside = -1e-3..=1.0 + 1e-3;
    assert!(
        inside.contains(&x) && inside.contains(&y),
        "{name}: a sample is outside of the domain, at ({x}, {y})"
    );
    let index = |v: f64, n: usize| ((v.max(0.0) * n as f64) as usize).min(n - 1);
    index(x, ROWS) * COLUMNS + index(y, COLUMNS)
}

/// Returns the integral of the density over each cell.
fn integrate(density: &impl Fn([f64; 2]) -> f64) -> Vec<f64> {
    let mut result = Vec::with_capacity(ROWS * COLUMNS);
    for row in 0..ROWS {
        for column in 0..COLUMNS {
            let x = [row, row + 1].map(|i| i as f64 / ROWS as f64);
            let y = [column, column + 1].map(|i| i as f64 / COLUMNS as f64);
            result.push(integrate_cell(density, x, y, 0));
        }
    }
    result
}

/// Gauss-Legendre points and weights on [−1, 1].
const GAUSS_2: [(f64, f64); 2] = [(-0.577_350_269_189_625_8, 1.0), (0.577_350_269_189_625_8, 1.0)];
const GAUSS_3: [(f64, f64); 3] =
    [(-0.774_596_669_241_483_4, 5.0 / 9.0), (0.0, 8.0 / 9.0), (0.774_596_669_241_483_4, 5.0 / 9.0)];

fn gauss(density: &impl Fn([f64; 2]) -> f64, x: [f64; 2], y: [f64; 2], rule: &[(f64, f64)]) -> f64 {
    let at = |[low, high]: [f64; 2], t: f64| 0.5 * (low + high) + 0.5 * (high - low) * t;
    let mut sum = 0.0;
    for &(s, weight_s) in rule {
        for &(t, weight_t) in rule {
            sum += weight_s * weight_t * density([at(x, s), at(y, t)]);
        }
    }
    sum * 0.25 * (x[1] - x[0]) * (y[1] - y[0])
}

/// Integrates a cell with two rules, and divides it into quarters if they disagree.
fn integrate_cell(density: &impl Fn([f64; 2]) -> f64, x: [f64; 2], y: [f64; 2], level: u32) -> f64 {
    let coarse = gauss(density, x, y, &GAUSS_2);
    let fine = gauss(density, x, y, &GAUSS_3);
    let mean_cell = 1.0 / (ROWS * COLUMNS) as f64;
    // A corner of the domain may be between the points of both rules.
    let hidden = fine == 0.0 && coarse == 0.0 && level < 2;
    if !hidden && (level == REFINEMENTS || (coarse - fine).abs() <= 1e-3 * fine + 1e-5 * mean_cell) {
        return fine;
    }
    let (xm, ym) = (0.5 * (x[0] + x[1]), 0.5 * (y[0] + y[1]));
    let mut sum = 0.0;
    for x in [[x[0], xm], [xm, x[1]]] {
        for y in [[y[0], ym], [ym, y[1]]] {
            sum += integrate_cell(density, x, y, level + 1);
        }
    }
    sum
}

#[test]
fn a_wrong_density_is_found() {
    // Both integrate to 1; samples are uniform.
    let uniform = |_: f32, u: Vec2| Some([f64::from(u.x), f64::from(u.y)]);
    assert!((check_square("uniform", 1, uniform, |_| 1.0) - 1.0).abs() < 1e-12);
    for tilt in [0.02, 0.05] {
        let tilted = move |[x, _]: [f64; 2]| 1.0 + tilt * (2.0 * x - 1.0);
        let found = std::panic::catch_unwind(|| check_square("tilted", 1, uniform, tilted));
        assert_eq!(found.is_err(), tilt > 0.03, "a tilt of {tilt}");
    }
    let short = std::panic::catch_unwind(|| check_square("short", 1, uniform, |_| 0.95));
    assert!(short.is_err(), "a density that integrates to less than what is drawn");
}
