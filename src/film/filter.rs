//! Filter importance sampling: a sample belongs to one pixel, and its position is sampled from the reconstruction
//! filter. [Ernst, Stamminger and Greiner 2006]

use super::Filter;
use crate::math::{DVec2, Vec2};
use crate::sampling::warp;
use std::f64::consts::PI;

/// A position relative to a pixel's centre, sampled from a filter.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FilterSample {
    /// Offset from the pixel's centre, in pixels.
    pub offset: Vec2,
    /// The factor on the sample's value: 1 except for filters with negative lobes, which are sampled by their
    /// magnitude.
    pub weight: f32,
}

/// Samples positions relative to a pixel's centre with the density of a filter.
#[derive(Clone, Debug)]
pub struct FilterSampler {
    filter: Filter,
    /// The integral of the filter along one axis.
    integral: f64,
    table: Option<TabulatedDensity>,
}

/// A density on [−radius, radius] that is piecewise constant in [`CELLS`] equal cells.
#[derive(Clone, Debug)]
struct TabulatedDensity {
    cells: Vec<Cell>,
    /// A lookup table for the inversion: the cell at the lower end of each of equal intervals of the random number.
    guide: Vec<u32>,
    has_weights: bool,
}

/// A cell of a [`TabulatedDensity`].
#[derive(Clone, Copy, Debug)]
struct Cell {
    /// The cumulative distribution at the lower boundary.
    cdf: f32,
    /// The offset there.
    offset: f32,
    /// The offset per probability.
    slope: f32,
    /// The filter's sign times the integral of its magnitude divided by its integral: 1 if it has one sign.
    weight: f32,
}

/// The number of cells of a tabulated filter.
const CELLS: usize = 1024;

impl Filter {
    /// Returns half the width, in pixels; the filter is zero outside.
    pub fn radius(&self) -> f64 {
        match *self {
            Filter::Box { radius } | Filter::Tent { radius } => f64::from(radius),
            Filter::Gaussian { stddev } => 4.0 * f64::from(stddev),
            Filter::Mitchell { .. } | Filter::CatmullRom => 2.0,
            Filter::Lanczos { lobes } => f64::from(lobes),
        }
    }

    /// Returns the filter along one axis at the distance `x` from the centre, up to a constant factor.
    pub fn eval(&self, x: f64) -> f64 {
        let x = x.abs();
        if x > self.radius() {
            return 0.0;
        }
        match *self {
            Filter::Box { .. } => 1.0,
            Filter::Tent { radius } => 1.0 - x / f64::from(radius),
            Filter::Gaussian { stddev } => {
                ((-0.5 * (x / f64::from(stddev)).powi(2)).exp() - (-8.0f64).exp()).max(0.0)
            }
            Filter::Mitchell { b, c } => cubic(x, b.into(), c.into()),
            Filter::CatmullRom => cubic(x, 0.0, 0.5),
            Filter::Lanczos { lobes } => {
                let sinc = |x: f64| if x == 0.0 { 1.0 } else { (PI * x).sin() / (PI * x) };
                sinc(x) * sinc(x / f64::from(lobes))
            }
        }
    }
}

/// Evaluates the family of cubic filters. [Mitchell and Netravali 1988, Eq. 8]
fn cubic(x: f64, b: f64, c: f64) -> f64 {
    let (x2, x3) = (x * x, x * x * x);
    if x < 1.0 {
        ((12.0 - 9.0 * b - 6.0 * c) * x3 + (-18.0 + 12.0 * b + 6.0 * c) * x2 + (6.0 - 2.0 * b)) / 6.0
    } else {
        ((-b - 6.0 * c) * x3 + (6.0 * b + 30.0 * c) * x2 + (-12.0 * b - 48.0 * c) * x + (8.0 * b + 24.0 * c))
            / 6.0
    }
}

impl FilterSampler {
    /// Creates the sampler of a filter.
    pub fn new(filter: Filter) -> Self {
        let radius = filter.radius();
        let table = match filter {
            Filter::Box { .. } | Filter::Tent { .. } => None,
            _ => Some(TabulatedDensity::new(radius, |x| filter.eval(x))),
        };
        let integral = simpson(-radius, radius, CELLS, |x| filter.eval(x)).iter().sum();
        FilterSampler { filter, integral, table }
    }

    /// Returns whether any sample has a weight other than 1.
    pub fn has_weights(&self) -> bool {
        self.table.as_ref().is_some_and(|t| t.has_weights)
    }

    /// Returns half the width, in pixels.
    pub fn radius(&self) -> f64 {
        self.filter.radius()
    }

    /// Returns the filter at an offset from the pixel's centre, normalised to integrate to 1.
    pub fn eval(&self, offset: DVec2) -> f32 {
        (self.along(offset.x) * self.along(offset.y)) as f32
    }

    /// Returns the factor of the filter along one axis, normalised to integrate to 1.
    pub fn along(&self, x: f64) -> f64 {
        self.filter.eval(x) / self.integral
    }

    /// Samples an offset from the pixel's centre, with its weight.
    #[inline]
    pub fn sample(&self, u: Vec2) -> FilterSample {
        let offset = match (&self.filter, &self.table) {
            (_, Some(table)) => {
                let ((x, wx), (y, wy)) = (table.invert(u.x), table.invert(u.y));
                return FilterSample { offset: Vec2::new(x, y), weight: wx * wy };
            }
            (Filter::Tent { radius }, None) => {
                Vec2::new(warp::interval_to_tent(u.x), warp::interval_to_tent(u.y)) * *radius
            }
            (filter, None) => (u * 2.0 - Vec2::ONE) * filter.radius() as f32,
        };
        FilterSample { offset, weight: 1.0 }
    }
}

/// Returns the integrals of `f` over `n` equal parts of [a, b], by Simpson's rule.
fn simpson(a: f64, b: f64, n: usize, f: impl Fn(f64) -> f64) -> Vec<f64> {
    let h = (b - a) / n as f64;
    let part = |i: usize| {
        let x = a + h * i as f64;
        (f(x) + 4.0 * f(x + 0.5 * h) + f(x + h)) * h / 6.0
    };
    (0..n).map(part).collect()
}

impl TabulatedDensity {
    /// Tabulates a density in proportion to the magnitude of `f`.
    fn new(radius: f64, f: impl Fn(f64) -> f64) -> Self {
        let parts = simpson(-radius, radius, CELLS, f);
        let mut sums = vec![0.0];
        for part in &parts {
            sums.push(sums[sums.len() - 1] + part.abs());
        }
        let cdf: Vec<f32> = sums.iter().map(|s| (s / sums[CELLS]) as f32).collect();
        let cell_of = |u: f32| cdf.partition_point(|&c| c <= u).saturating_sub(1).min(CELLS - 1) as u32;
        let guide = (0..CELLS).map(|i| cell_of(i as f32 / CELLS as f32)).collect();
        let total: f64 = parts.iter().sum();
        let (radius, width) = (radius as f32, 2.0 * radius as f32 / CELLS as f32);
        let cell = |(i, part): (usize, &f64)| Cell {
            cdf: cdf[i],
            offset: i as f32 * width - radius,
            slope: if cdf[i + 1] > cdf[i] { width / (cdf[i + 1] - cdf[i]) } else { 0.0 },
            weight: (sums[CELLS] / total).copysign(*part) as f32,
        };
        let cells = parts.iter().enumerate().map(cell).collect();
        TabulatedDensity { cells, guide, has_weights: parts.iter().any(|&part| part < 0.0) }
    }

    /// Returns the offset and its weight for a random number.
    #[inline]
    fn invert(&self, u: f32) -> (f32, f32) {
        let first = self.guide[((u * CELLS as f32) as usize).min(CELLS - 1)] as usize;
        let begins_before = |cell: usize| self.cells.get(cell).is_some_and(|cell| cell.cdf <= u);
        // Nearly all offsets need one step at most, and a sum is no branch.
        let mut cell = first + usize::from(begins_before(first + 1));
        while begins_before(cell + 1) {
            cell += 1;
        }
        let Cell { cdf, offset, slope, weight } = self.cells[cell];
        (offset + (u - cdf) * slope, weight)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Weighted offsets have the integral, mean and second moment of the filter.
    #[test]
    fn offsets_have_the_filters_moments() {
        for filter in [
            Filter::Box { radius: 0.5 },
            Filter::Tent { radius: 1.0 },
            Filter::Gaussian { stddev: 0.5 },
            Filter::Mitchell { b: 1.0 / 3.0, c: 1.0 / 3.0 },
            Filter::CatmullRom,
            Filter::Lanczos { lobes: 3 },
        ] {
            let moment = |power: i32| -> f64 {
                let r = filter.radius();
                simpson(-r, r, 2000, |x| filter.eval(x) * x.powi(power)).iter().sum()
            };
            let variance = moment(2) / moment(0);
            let sampler = FilterSampler::new(filter);
            let n = 100_000;
            let mut m = [0.0; 3];
            for i in 0..n {
                let u = (i as f32 + 0.5) / n as f32;
                let FilterSample { offset, .. } = sampler.sample(Vec2::new(u, 0.5));
                let weight = sampler.table.as_ref().map_or(1.0, |t| t.invert(u).1);
                let (x, w) = (f64::from(offset.x), f64::from(weight));
                for (k, sum) in m.iter_mut().enumerate() {
                    *sum += w * x.powi(k as i32) / f64::from(n);
                }
            }
            assert!((m[0] - 1.0).abs() < 1e-3, "{filter:?}: {m:?}");
            assert!(m[1].abs() < 1e-4, "{filter:?}: {m:?}");
            assert!((m[2] - variance).abs() < 2e-3, "{filter:?}: {} {variance}", m[2]);
        }
    }

    #[test]
    fn filters_have_their_closed_forms() {
        let mitchell = Filter::Mitchell { b: 1.0 / 3.0, c: 1.0 / 3.0 };
        assert!(
            (mitchell.eval(0.0) - 8.0 / 9.0).abs() < 1e-6 && (mitchell.eval(1.0) - 1.0 / 18.0).abs() < 1e-6
        );
        assert!(mitchell.eval(1.5) < 0.0 && mitchell.eval(2.0).abs() < 1e-12);
        let lanczos = Filter::Lanczos { lobes: 3 };
        assert!(lanczos.eval(1.0).abs() < 1e-12 && lanczos.eval(0.0) == 1.0 && lanczos.eval(1.5) < 0.0);
        assert!((Filter::CatmullRom.eval(0.5) - 0.5625).abs() < 1e-12);
        let sampler = FilterSampler::new(Filter::Box { radius: 0.5 });
        assert!((sampler.eval(DVec2::new(0.2, -0.3)) - 1.0).abs() < 1e-6);
    }
}
