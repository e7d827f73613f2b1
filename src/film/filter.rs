//! Filter importance sampling: a sample belongs to one pixel, and its position is drawn from the filter.

use super::Filter;
use crate::math::Vec2;
use crate::sampling::warp;

/// Draws positions around a pixel's centre with the density of a filter.
#[derive(Clone, Debug)]
pub enum FilterSampler {
    /// Uniform in a square.
    Box {
        /// Half the width, in pixels.
        radius: f32,
    },
    /// The product of two tents.
    Tent {
        /// Half the width, in pixels.
        radius: f32,
    },
    /// The product of two even functions, as equal steps of their distribution function.
    Table {
        /// Positions at which the distribution function is 0, 1/n, 2/n, ..., 1.
        quantiles: Vec<f32>,
    },
}

/// Steps of a tabulated filter: the density is constant between two quantiles.
const STEPS: usize = 2048;

impl FilterSampler {
    /// The sampler of a filter.
    pub fn new(filter: Filter) -> Self {
        match filter {
            Filter::Box { radius } => FilterSampler::Box { radius },
            Filter::Tent { radius } => FilterSampler::Tent { radius },
            Filter::Gaussian { stddev } => {
                let stddev = f64::from(stddev);
                let radius = 4.0 * stddev;
                let lowest = (-8.0f64).exp();
                tabulate(radius, |x| ((-0.5 * (x / stddev).powi(2)).exp() - lowest).max(0.0))
            }
        }
    }

    /// An offset from the pixel's centre, in pixels.
    #[inline]
    pub fn sample(&self, u: Vec2) -> Vec2 {
        match self {
            FilterSampler::Box { radius } => (u * 2.0 - Vec2::ONE) * *radius,
            FilterSampler::Tent { radius } => {
                Vec2::new(warp::interval_to_tent(u.x), warp::interval_to_tent(u.y)) * *radius
            }
            FilterSampler::Table { quantiles } => Vec2::new(invert(quantiles, u.x), invert(quantiles, u.y)),
        }
    }
}

fn invert(quantiles: &[f32], u: f32) -> f32 {
    let steps = quantiles.len() - 1;
    let position = u * steps as f32;
    let i = (position as usize).min(steps - 1);
    let fraction = position - i as f32;
    quantiles[i] + (quantiles[i + 1] - quantiles[i]) * fraction
}

/// Quantiles of the density in proportion to `f` on [−radius, radius], by the trapezoid rule on a fine grid.
fn tabulate(radius: f64, f: impl Fn(f64) -> f64) -> FilterSampler {
    const CELLS: usize = 1 << 16;
    let at = |i: usize| radius * (2.0 * i as f64 / CELLS as f64 - 1.0);
    let mut cdf = Vec::with_capacity(CELLS + 1);
    cdf.push(0.0);
    for i in 0..CELLS {
        cdf.push(cdf[i] + 0.5 * (f(at(i)) + f(at(i + 1))));
    }
    let total = cdf[CELLS];
    let mut cell = 0;
    let quantiles = (0..=STEPS)
        .map(|step| {
            let target = total * step as f64 / STEPS as f64;
            while cell + 1 < CELLS && cdf[cell + 1] < target {
                cell += 1;
            }
            let width = cdf[cell + 1] - cdf[cell];
            let fraction = if width > 0.0 { ((target - cdf[cell]) / width).clamp(0.0, 1.0) } else { 0.0 };
            (at(cell) + fraction * (at(cell + 1) - at(cell))) as f32
        })
        .collect();
    FilterSampler::Table { quantiles }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The second moment of the offsets is that of the filter.
    #[test]
    fn offsets_have_the_filters_mean_and_variance() {
        // ∫x²w/∫w for the Gaussian of deviation 1/2 lowered to reach zero at 2, by Simpson's rule.
        let gaussian = {
            let w = |x: f64| (-2.0 * x * x).exp() - (-8.0f64).exp();
            let n = 2000;
            let (mut m0, mut m2) = (0.0, 0.0);
            for i in 0..=n {
                let x = -2.0 + 4.0 * f64::from(i) / f64::from(n);
                let c = if i == 0 || i == n {
                    1.0
                } else if i % 2 == 1 {
                    4.0
                } else {
                    2.0
                };
                m0 += c * w(x);
                m2 += c * w(x) * x * x;
            }
            m2 / m0
        };
        for (filter, variance) in [
            (Filter::Box { radius: 0.5 }, 1.0 / 12.0),
            (Filter::Tent { radius: 1.0 }, 1.0 / 6.0),
            (Filter::Gaussian { stddev: 0.5 }, gaussian),
        ] {
            let sampler = FilterSampler::new(filter);
            let n = 100_000;
            let (mut m1, mut m2) = (0.0, 0.0);
            for i in 0..n {
                let u = (i as f32 + 0.5) / n as f32;
                let x = f64::from(sampler.sample(Vec2::splat(u)).x);
                m1 += x;
                m2 += x * x;
            }
            assert!((m1 / f64::from(n)).abs() < 1e-5, "{filter:?}");
            assert!(
                (m2 / f64::from(n) - variance).abs() < 2e-5,
                "{filter:?}: {} {variance}",
                m2 / f64::from(n)
            );
        }
    }
}
