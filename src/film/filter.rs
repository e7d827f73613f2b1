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
    /// The product of two functions, tabulated.
    Table(Table),
}

/// A density on [−radius, radius] that is constant in each of [`CELLS`] equal cells.
#[derive(Clone, Debug)]
pub struct Table {
    radius: f32,
    /// The distribution function at the cells' ends, from 0 to 1.
    cdf: Vec<f32>,
    /// For each of as many equal intervals of the random number, the cell that its lower end falls into.
    guide: Vec<u32>,
}

/// Cells of a tabulated filter.
const CELLS: usize = 1024;

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
                FilterSampler::Table(Table::new(radius, |x| {
                    ((-0.5 * (x / stddev).powi(2)).exp() - lowest).max(0.0)
                }))
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
            FilterSampler::Table(table) => Vec2::new(table.invert(u.x), table.invert(u.y)),
        }
    }
}

impl Table {
    /// The table of the density in proportion to `f`, which is integrated over each cell by Simpson's rule.
    fn new(radius: f64, f: impl Fn(f64) -> f64) -> Self {
        let at = |i: f64| radius * (2.0 * i / CELLS as f64 - 1.0);
        let mut sums = vec![0.0];
        for i in 0..CELLS {
            let i = i as f64;
            sums.push(sums[sums.len() - 1] + f(at(i)) + 4.0 * f(at(i + 0.5)) + f(at(i + 1.0)));
        }
        let cdf: Vec<f32> = sums.iter().map(|s| (s / sums[CELLS]) as f32).collect();
        let cell_of = |u: f32| cdf.partition_point(|&c| c <= u).saturating_sub(1).min(CELLS - 1) as u32;
        let guide = (0..CELLS).map(|i| cell_of(i as f32 / CELLS as f32)).collect();
        Table { radius: radius as f32, cdf, guide }
    }

    #[inline]
    fn invert(&self, u: f32) -> f32 {
        let mut cell = self.guide[((u * CELLS as f32) as usize).min(CELLS - 1)] as usize;
        while cell + 1 < CELLS && self.cdf[cell + 1] <= u {
            cell += 1;
        }
        let width = self.cdf[cell + 1] - self.cdf[cell];
        let fraction = if width > 0.0 { (u - self.cdf[cell]) / width } else { 0.5 };
        self.radius * (2.0 * (cell as f32 + fraction) / CELLS as f32 - 1.0)
    }
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
