//! A chi-square test of sampled directions against their density, over the sphere.

use super::statistics::{chi2_tail, sidak};
use buffon::math::Vec3;
use buffon::sampling::{Dimension, SampleKey, Sampler};
use std::f64::consts::{PI, TAU};

/// Cells of cosθ; odd, so that cell borders avoid the equator and the poles' symmetries.
const COS_CELLS: usize = 31;
const PHI_CELLS: usize = 61;
const SAMPLES: usize = 200_000;
/// Cells are refined this often where the density varies within them.
const REFINEMENTS: u32 = 5;
/// Share of the samples that may fall where the quadrature saw nothing: slivers of cells along a silhouette.
const SILHOUETTE: f64 = 5e-4;
/// Cells with fewer expected samples are pooled.
const FEWEST: f64 = 5.0;
/// Probability that a correct sampler fails any of the `tests` that it is part of.
const SIGNIFICANCE: f64 = 0.01;

/// Compares `sample` (a direction, or nothing) with `pdf` per unit solid angle.
///
/// `tests` is the number of comparisons that share the significance level. Returns the density's integral.
///
/// # Panics
/// With the figures, if the distributions differ, or the density integrates to more than 1.
pub fn check_directions(
    name: &str,
    tests: usize,
    mut sample: impl FnMut(f32, [f32; 2]) -> Option<Vec3>,
    pdf: impl Fn(Vec3) -> f32,
) -> f64 {
    let mut counts = vec![0u64; COS_CELLS * PHI_CELLS];
    for (u_lobe, u) in numbers() {
        if let Some(w) = sample(u_lobe, u) {
            assert!((w.length() - 1.0).abs() < 1e-4, "{name}: a direction of length {}", w.length());
            counts[cell_of(w)] += 1;
        }
    }
    let expected = integrate(&pdf, &counts);
    let total: f64 = expected.iter().sum();
    assert!(total < 1.0 + 2e-3, "{name}: the density integrates to {total}");
    let (mut statistic, mut cells) = (0.0, 0.0);
    let (mut pooled_expected, mut pooled_count) = (0.0, 0u64);
    for (count, share) in counts.iter().zip(&expected) {
        let expected = share * SAMPLES as f64;
        if expected < FEWEST {
            pooled_expected += expected;
            pooled_count += count;
        } else {
            statistic += (*count as f64 - expected).powi(2) / expected;
            cells += 1.0;
        }
    }
    if pooled_expected >= FEWEST {
        statistic += (pooled_count as f64 - pooled_expected).powi(2) / pooled_expected;
        cells += 1.0;
    } else {
        let allowed = 5.0 * FEWEST + SILHOUETTE * SAMPLES as f64;
        assert!(
            (pooled_count as f64) < allowed,
            "{name}: {pooled_count} samples where {pooled_expected:.2} are expected"
        );
    }
    assert!(cells > 1.0, "{name}: the density is concentrated in {cells} cells: nothing is tested");
    let p = chi2_tail(statistic, cells - 1.0);
    assert!(
        p > sidak(SIGNIFICANCE, tests),
        "{name}: chi-square {statistic:.1} over {cells} cells, p = {p:.2e}; density integrates to {total:.4}, {} of {SAMPLES} \
         samples",
        counts.iter().sum::<u64>()
    );
    total
}

/// Independent random numbers, the same in every run.
fn numbers() -> impl Iterator<Item = (f32, [f32; 2])> {
    let keys: Vec<_> = (0..SAMPLES as u32).map(|i| SampleKey::new(11, i % 1024, i / 1024, 0)).collect();
    let draw = |d: u32| {
        let (mut x, mut y) = (vec![0.0; SAMPLES], vec![0.0; SAMPLES]);
        Sampler::Independent.fill_2d(Dimension(d), &keys, &mut x, &mut y);
        (x, y)
    };
    let (lobe, _) = draw(0);
    let (x, y) = draw(1);
    lobe.into_iter().zip(x.into_iter().zip(y).map(|(x, y)| [x, y]))
}

fn cell_of(w: Vec3) -> usize {
    let c = ((f64::from(w.z) + 1.0) * 0.5 * COS_CELLS as f64) as usize;
    let phi = f64::from(w.y).atan2(f64::from(w.x)).rem_euclid(TAU);
    let p = (phi / TAU * PHI_CELLS as f64) as usize;
    c.min(COS_CELLS - 1) * PHI_CELLS + p.min(PHI_CELLS - 1)
}

/// The density's integral over each cell, by the midpoint rule; cells where it varies much are refined.
fn integrate(pdf: &impl Fn(Vec3) -> f32, counts: &[u64]) -> Vec<f64> {
    let mut result = Vec::with_capacity(COS_CELLS * PHI_CELLS);
    for c in 0..COS_CELLS {
        for p in 0..PHI_CELLS {
            let cos = [c, c + 1].map(|i| 2.0 * i as f64 / COS_CELLS as f64 - 1.0);
            let phi = [p, p + 1].map(|i| TAU * i as f64 / PHI_CELLS as f64);
            result.push(integrate_cell(pdf, cos, phi, counts[result.len()] > 0, 0));
        }
    }
    result
}

fn midpoint(pdf: &impl Fn(Vec3) -> f32, cos: [f64; 2], phi: [f64; 2], n: usize) -> f64 {
    let mut sum = 0.0;
    for i in 0..n {
        for j in 0..n {
            let z = cos[0] + (cos[1] - cos[0]) * (i as f64 + 0.5) / n as f64;
            let a = phi[0] + (phi[1] - phi[0]) * (j as f64 + 0.5) / n as f64;
            let r = (1.0 - z * z).max(0.0).sqrt();
            sum += f64::from(pdf(Vec3::new((r * a.cos()) as f32, (r * a.sin()) as f32, z as f32)));
        }
    }
    sum * (cos[1] - cos[0]) * (phi[1] - phi[0]) / (n * n) as f64
}

fn integrate_cell(pdf: &impl Fn(Vec3) -> f32, cos: [f64; 2], phi: [f64; 2], hit: bool, level: u32) -> f64 {
    let coarse = midpoint(pdf, cos, phi, 5);
    let fine = midpoint(pdf, cos, phi, 7);
    let whole_sphere = 4.0 * PI / (COS_CELLS * PHI_CELLS) as f64;
    // Two grids that agree may both miss a sliver; then it shows as samples.
    let missed = fine == 0.0 && hit && level < 3;
    if level == REFINEMENTS || (!missed && (coarse - fine).abs() <= 1e-3 * fine + 1e-5 * whole_sphere) {
        return fine;
    }
    let (zm, am) = (0.5 * (cos[0] + cos[1]), 0.5 * (phi[0] + phi[1]));
    let mut sum = 0.0;
    for z in [[cos[0], zm], [zm, cos[1]]] {
        for a in [[phi[0], am], [am, phi[1]]] {
            sum += integrate_cell(pdf, z, a, hit, level + 1);
        }
    }
    sum
}
