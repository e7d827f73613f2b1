//! Distributions over the unit square, compared with their densities.

use crate::support::chi2::check_square;
use buffon::sampling::{BilinearDistribution2D, Distribution2D};

/// The number of comparisons by which the significance is divided.
const TESTS: usize = 3;

/// Returns irregular weights from 0 to 22.
fn weights(n: usize) -> Vec<f64> {
    (0..n).map(|i| (i * 37 % 23) as f64).collect()
}

#[test]
fn cells_are_drawn_by_their_weight() {
    // The cells of the test, each with one weight.
    let (width, height) = (31, 61);
    let d = Distribution2D::new(width, height, &weights(width * height));
    let total = check_square(
        "cells",
        TESTS,
        |_, u| d.sample(u).map(|(p, _)| [f64::from(p.x), f64::from(p.y)]),
        |[x, y]| f64::from(d.pdf(buffon::math::Vec2::new(x as f32, y as f32))),
    );
    assert!((total - 1.0).abs() < 1e-4, "{total}");
}

#[test]
fn bilinear_densities_are_drawn_exactly() {
    let grid: Vec<f32> = weights(20).into_iter().map(|w| w as f32).collect();
    let mut hat = vec![0.0; 20];
    hat[7] = 1.0;
    for (name, weights) in [("bilinear", grid), ("hat", hat)] {
        let d = BilinearDistribution2D::new(5, vec![0.0, 0.2, 0.8, 1.0], &weights);
        let total = check_square(name, TESTS, |_, u| d.sample(u).map(|(p, _)| p), |p| f64::from(d.pdf(p)));
        assert!((total - 1.0).abs() < 1e-3, "{name}: {total}");
    }
}
