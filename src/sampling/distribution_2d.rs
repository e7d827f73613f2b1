//! Distributions over the unit square, sampled by inversion: first the row, then the position in it.

use super::Distribution1D;
use crate::math::Vec2;
use crate::math::lanes::{LANES, each_lane, f32x16};

/// A piecewise constant density over the cells of a regular grid on the unit square.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Distribution2D {
    rows: Distribution1D,
    /// The distribution within each row.
    columns: Vec<Distribution1D>,
    /// The number of cells along x and y.
    size: [usize; 2],
}

impl Distribution2D {
    /// Creates the distribution in proportion to the `weights` of `width` by `height` cells. Rows start at y = 0,
    /// cells of a row at x = 0. Sums are computed in `f64`. Weights that are not finite and positive count as zero.
    /// If all are zero, the distribution is empty.
    ///
    /// # Panics
    /// If the number of weights is not `width * height`.
    pub fn new(width: usize, height: usize, weights: &[f64]) -> Self {
        assert_eq!(weights.len(), width * height, "the weights of {width}x{height} cells");
        let clean = |w: &f64| if *w > 0.0 && w.is_finite() { *w } else { 0.0 };
        let largest = weights.iter().map(clean).fold(0.0, f64::max);
        if largest == 0.0 {
            return Distribution2D::default();
        }
        let (mut sums, mut columns) = (Vec::with_capacity(height), Vec::with_capacity(height));
        for row in weights.chunks_exact(width) {
            // Relative to the largest weight, no sum overflows.
            let row: Vec<f64> = row.iter().map(|w| clean(w) / largest).collect();
            sums.push(row.iter().sum());
            columns.push(Distribution1D::new(&row));
        }
        Distribution2D { rows: Distribution1D::new(&sums), columns, size: [width, height] }
    }

    /// Returns whether the distribution is empty.
    pub fn is_empty(&self) -> bool {
        self.columns.is_empty()
    }

    /// Samples a point with two random numbers in [0, 1). Returns it with its density per unit area; `None` for the
    /// empty distribution.
    #[inline]
    pub fn sample(&self, u: Vec2) -> Option<(Vec2, f32)> {
        let row = self.rows.sample(u.y)?;
        let column = self.columns[row.index].sample(u.x)?;
        let [width, height] = self.size.map(|n| n as f32);
        let point = Vec2::new((column.index as f32 + column.u) / width, (row.index as f32 + row.u) / height);
        Some((point, row.pmf * column.pmf * (width * height)))
    }

    /// Returns the density per unit area; 0 outside the square.
    #[inline]
    pub fn pdf(&self, point: Vec2) -> f32 {
        let inside = |v: f32| (0.0..=1.0).contains(&v);
        if self.is_empty() || !inside(point.x) || !inside(point.y) {
            return 0.0;
        }
        let [width, height] = self.size;
        let cell = |v: f32, n: usize| ((v * n as f32) as usize).min(n - 1);
        let (x, y) = (cell(point.x, width), cell(point.y, height));
        self.rows.pmf(y) * self.columns[y].pmf(x) * (width as f32 * height as f32)
    }
}

/// A density over the unit square that is bilinear between the vertices of a grid. The columns are equally spaced;
/// the rows are at given positions.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize)]
pub struct BilinearDistribution2D {
    /// The number of vertices in a row.
    width: usize,
    /// The y coordinates of the rows, from 0 to 1.
    ys: Vec<f64>,
    /// The density at the vertices, by row.
    densities: Vec<f32>,
    /// The integral of the density along the row, from x = 0 to each vertex.
    integrals: Vec<f32>,
    /// The probability below each row; the first is 0, the last 1.
    below: Vec<f64>,
}

impl BilinearDistribution2D {
    /// Creates the distribution in proportion to the bilinear interpolation of `weights` at the vertices, with
    /// `width` vertices in each of the rows `ys`. Sums are computed in `f64`. Weights that are not finite and
    /// positive count as zero. If all are zero, the distribution is empty.
    ///
    /// # Panics
    /// If there are fewer than two columns or rows, the numbers of weights and vertices differ, or `ys` do not
    /// increase from 0 to 1.
    pub fn new(width: usize, ys: Vec<f64>, weights: &[f32]) -> Self {
        assert!(width >= 2 && ys.len() >= 2, "a grid of {width}x{} vertices", ys.len());
        assert_eq!(weights.len(), width * ys.len(), "the weights of the vertices");
        assert!(ys[0] == 0.0 && ys[ys.len() - 1] == 1.0 && ys.is_sorted_by(|a, b| a < b), "rows from 0 to 1");
        let clean = |w: f32| if w > 0.0 && w.is_finite() { f64::from(w) } else { 0.0 };
        let dx = 1.0 / (width - 1) as f64;
        let along =
            |row: &[f32]| -> f64 { row.windows(2).map(|w| 0.5 * dx * (clean(w[0]) + clean(w[1]))).sum() };
        let rows: Vec<f64> = weights.chunks_exact(width).map(along).collect();
        let mut below = vec![0.0];
        let mut total = 0.0;
        for (y, row) in ys.windows(2).zip(rows.windows(2)) {
            total += 0.5 * (y[1] - y[0]) * (row[0] + row[1]);
            below.push(total);
        }
        if total <= 0.0 {
            return BilinearDistribution2D::default();
        }
        below.iter_mut().for_each(|b| *b /= total);
        let (mut densities, mut integrals) =
            (Vec::with_capacity(weights.len()), Vec::with_capacity(weights.len()));
        for row in weights.chunks_exact(width) {
            let mut sum = 0.0;
            let mut last = None;
            for &w in row {
                let density = clean(w) / total;
                sum += last.map_or(0.0, |last| 0.5 * dx * (last + density));
                last = Some(density);
                densities.push(density as f32);
                integrals.push(sum as f32);
            }
        }
        BilinearDistribution2D { width, ys, densities, integrals, below }
    }

    /// Returns whether the distribution is empty.
    pub fn is_empty(&self) -> bool {
        self.ys.is_empty()
    }

    /// Samples a point with two random numbers in [0, 1). Returns it with its density per unit area; `None` for the
    /// empty distribution.
    #[inline]
    pub fn sample(&self, u: Vec2) -> Option<([f64; 2], f32)> {
        if self.is_empty() {
            return None;
        }
        let (ux, uy) = (f64::from(u.x), f64::from(u.y));
        // Selects the band between two rows, and the position in it by the rows' integrals. The search ends at the
        // last band with a positive probability.
        let band = self.below.partition_point(|&b| b <= uy).min(self.below.len() - 1) - 1;
        let (low, high) = (self.below[band], self.below[band + 1]);
        let [first, second] = [band, band + 1].map(|r| &self.integrals[r * self.width..][..self.width]);
        let whole = [first, second].map(|row| f64::from(row[self.width - 1]));
        let t = linear_quantile(whole[0], whole[1], (uy - low) / (high - low));
        // Inverts the distribution along the line at that height.
        let at = |[a, b]: [f32; 2]| (1.0 - t) * f64::from(a) + t * f64::from(b);
        let until = |i: usize| at([first[i], second[i]]);
        let wanted = ux * until(self.width - 1);
        let (mut i, mut size) = (0, self.width - 1);
        while size > 1 {
            let half = size / 2;
            if until(i + half) <= wanted {
                i += half;
            }
            size -= half;
        }
        let [a, b] = self.cell(band, i).map(at);
        let (low, high) = (until(i), until(i + 1));
        let s = linear_quantile(a, b, (wanted - low) / (high - low));
        let pdf = (1.0 - s) * a + s * b;
        if pdf <= 0.0 {
            return None;
        }
        let y = self.ys[band] + t * (self.ys[band + 1] - self.ys[band]);
        Some(([(i as f64 + s) / (self.width - 1) as f64, y], pdf as f32))
    }

    /// Returns the densities at the left and right side of a cell, for its two rows.
    #[inline]
    fn cell(&self, band: usize, i: usize) -> [[f32; 2]; 2] {
        let at = |r: usize, i: usize| self.densities[r * self.width + i];
        [i, i + 1].map(|i| [at(band, i), at(band + 1, i)])
    }

    /// Returns the density per unit area; 0 outside the square.
    #[inline]
    pub fn pdf(&self, [x, y]: [f64; 2]) -> f32 {
        let inside = |v: f64| (0.0..=1.0).contains(&v);
        if self.is_empty() || !inside(x) || !inside(y) {
            return 0.0;
        }
        let band = self.ys.partition_point(|&row| row <= y).clamp(1, self.ys.len() - 1) - 1;
        let t = (y - self.ys[band]) / (self.ys[band + 1] - self.ys[band]);
        let x = x * (self.width - 1) as f64;
        let i = (x as usize).min(self.width - 2);
        let [a, b] = self.cell(band, i).map(|[a, b]| (1.0 - t) * f64::from(a) + t * f64::from(b));
        let s = x - i as f64;
        ((1.0 - s) * a + s * b) as f32
    }

    /// Computes [`sample`](Self::sample) in sixteen lanes, for a distribution that is not empty. Returns the points
    /// with their densities, which are 0 where there is no sample.
    #[inline]
    pub fn sample_x16(&self, u: [f32x16; 2]) -> (PointsX16, f32x16) {
        let uy = u[1].to_array().map(f64::from);
        let bands = each_lane(|i| self.below.partition_point(|&b| b <= uy[i]).min(self.below.len() - 1) - 1);
        let starts = bands.map(|band| band * self.width);
        let rows = |i: usize| self.integrals[starts[i]..][..2 * self.width].split_at(self.width);
        let share = |i: usize| {
            let (low, high) = (self.below[bands[i]], self.below[bands[i] + 1]);
            ((uy[i] - low) / (high - low)) as f32
        };
        let last = self.width - 1;
        let whole = [each_lane(|i| rows(i).0[last]), each_lane(|i| rows(i).1[last])].map(f32x16::new);
        let t = linear_quantile_x16(whole, f32x16::new(each_lane(share)));
        let (t, one_minus_t) = (t.to_array(), (f32x16::ONE - t).to_array());
        let until = |i: usize, column: usize| {
            let (first, second) = rows(i);
            one_minus_t[i] * first[column] + t[i] * second[column]
        };
        let wanted = u[0] * f32x16::new(each_lane(|i| until(i, last)));
        let (mut columns, mut size) = ([0; LANES], last);
        while size > 1 {
            let half = size / 2;
            // In step and without branches, because nothing predicts the direction of a search.
            let below = f32x16::new(each_lane(|i| until(i, columns[i] + half)));
            let reached = wanted.simd_ge(below).to_bitmask() as usize;
            for (i, column) in columns.iter_mut().enumerate() {
                *column += half & (reached >> i & 1).wrapping_neg();
            }
            size -= half;
        }
        let (low, high) = (each_lane(|i| until(i, columns[i])), each_lane(|i| until(i, columns[i] + 1)));
        let (low, high) = (f32x16::new(low), f32x16::new(high));
        let (t, s) = (f32x16::new(t), (wanted - low) / (high - low));
        let mut points = PointsX16 { bands, columns, s, t };
        let [a, b] = self.sides_x16(&points);
        points.s = linear_quantile_x16([a, b], s);
        (points, (f32x16::ONE - points.s) * a + points.s * b)
    }

    /// Returns the densities at the left and right side of the cells of points, at the points' heights.
    #[inline(always)]
    fn sides_x16(&self, points: &PointsX16) -> [f32x16; 2] {
        [0, 1].map(|side| {
            let corner = |below: usize| {
                let at = |i: usize| (points.bands[i] + below) * self.width + points.columns[i] + side;
                f32x16::new(each_lane(|i| self.densities[at(i)]))
            };
            (f32x16::ONE - points.t) * corner(0) + points.t * corner(1)
        })
    }

    /// Returns the densities per unit area at points, for a distribution that is not empty.
    #[inline]
    pub fn pdf_x16(&self, points: &PointsX16) -> f32x16 {
        let [a, b] = self.sides_x16(points);
        (f32x16::ONE - points.s) * a + points.s * b
    }

    /// Returns the positions of rows, from 0 to 1.
    #[inline]
    pub fn rows(&self) -> &[f64] {
        &self.ys
    }

    /// Returns the bytes of memory.
    pub fn memory_bytes(&self) -> usize {
        8 * (self.ys.len() + self.below.len()) + 4 * (self.densities.len() + self.integrals.len())
    }
}

/// Points in the cells of a [`BilinearDistribution2D`], in sixteen lanes.
#[derive(Clone, Copy, Debug)]
pub struct PointsX16 {
    /// The row above the cell.
    pub bands: [usize; LANES],
    /// The column to the left of the cell.
    pub columns: [usize; LANES],
    /// The position in the cell along x, in [0, 1].
    pub s: f32x16,
    /// The position in the cell along y, in [0, 1].
    pub t: f32x16,
}

/// Returns the `p`-quantile on [0, 1] of a density that is linear from `a` to `b`. [pbrt, A.4.4]
#[inline]
fn linear_quantile(a: f64, b: f64, p: f64) -> f64 {
    // Rounded sums may slightly exceed the total.
    let p = if p > 0.0 { p.min(1.0) } else { 0.0 };
    let root = (a * a * (1.0 - p) + b * b * p).sqrt();
    let divisor = a + root;
    if divisor > 0.0 { (p * (a + b) / divisor).min(1.0) } else { p }
}

/// Computes [`linear_quantile`] in each lane.
#[inline(always)]
fn linear_quantile_x16([a, b]: [f32x16; 2], p: f32x16) -> f32x16 {
    let p = p.fast_min(f32x16::ONE) & p.simd_gt(f32x16::ZERO);
    // Relative to the larger one, no square is too small.
    let larger = a.fast_max(b);
    let (a, b) = (a / larger, b / larger);
    let divisor = a + (a * a * (f32x16::ONE - p) + b * b * p).sqrt();
    // False if both densities are zero, too.
    divisor.simd_gt(f32x16::ZERO).select((p * (a + b) / divisor).fast_min(f32x16::ONE), p)
}

#[cfg(test)]
mod tests {
    use super::*;

    const LAST: f32 = 1.0 - f32::EPSILON / 2.0;

    #[test]
    fn a_single_cell_has_all_points() {
        let mut weights = vec![0.0; 12];
        weights[6] = 1e-300;
        let d = Distribution2D::new(4, 3, &weights);
        for u in [Vec2::ZERO, Vec2::splat(0.5), Vec2::splat(LAST)] {
            let (p, pdf) = d.sample(u).unwrap();
            assert!((0.5..=0.75).contains(&p.x) && (0.333..=0.667).contains(&p.y), "{p}");
            assert_eq!(pdf, 12.0);
        }
        assert_eq!(d.pdf(Vec2::new(0.6, 0.5)), 12.0);
        assert_eq!([d.pdf(Vec2::new(0.4, 0.5)), d.pdf(Vec2::new(1.1, 0.5))], [0.0; 2]);
        let d = Distribution2D::new(1, 1, &[3.0]);
        assert_eq!(d.sample(Vec2::new(0.25, 0.75)), Some((Vec2::new(0.25, 0.75), 1.0)));
    }

    #[test]
    fn hopeless_weights_give_an_empty_distribution() {
        for weights in [[0.0; 4], [f64::NAN, -1.0, 0.0, f64::INFINITY]] {
            let d = Distribution2D::new(2, 2, &weights);
            assert!(d.is_empty() && d.sample(Vec2::ZERO).is_none() && d.pdf(Vec2::ZERO) == 0.0);
        }
        let d = BilinearDistribution2D::new(2, vec![0.0, 1.0], &[0.0, f32::NAN, -1.0, f32::INFINITY]);
        assert!(d.is_empty() && d.sample(Vec2::ZERO).is_none() && d.pdf([0.5; 2]) == 0.0);
    }

    #[test]
    fn huge_weights_do_not_overflow() {
        let d = Distribution2D::new(2, 2, &[f64::MAX, f64::MAX, 0.0, f64::MAX]);
        assert!((d.pdf(Vec2::new(0.1, 0.1)) - 4.0 / 3.0).abs() < 1e-6);
        let d = BilinearDistribution2D::new(2, vec![0.0, 1.0], &[f32::MAX; 4]);
        assert_eq!(d.pdf([0.3, 0.7]), 1.0);
    }

    #[test]
    fn samples_have_the_density_of_their_point() {
        let weights: Vec<f64> = (0..35).map(|i| f64::from(i * 37 % 23)).collect();
        let constant = Distribution2D::new(7, 5, &weights);
        let weights: Vec<f32> = weights.iter().map(|&w| w as f32).collect();
        let bilinear = BilinearDistribution2D::new(7, vec![0.0, 0.1, 0.5, 0.6, 1.0], &weights);
        let (mut sums, n) = ([0.0; 2], 200);
        for y in 0..n {
            for x in 0..n {
                let u = Vec2::new((x as f32 + 0.5) / n as f32, (y as f32 + 0.5) / n as f32);
                let (p, pdf) = constant.sample(u).unwrap();
                assert!((constant.pdf(p) / pdf - 1.0).abs() < 1e-6, "{u}");
                let (p, pdf) = bilinear.sample(u).unwrap();
                assert!((bilinear.pdf(p) / pdf - 1.0).abs() < 1e-5, "{u}");
                sums[0] += f64::from(constant.pdf(u));
                sums[1] += f64::from(bilinear.pdf([f64::from(u.x), f64::from(u.y)]));
            }
        }
        for sum in sums {
            assert!((sum / f64::from(n * n) - 1.0).abs() < 1e-2, "{sum}");
        }
    }

    #[test]
    fn a_single_vertex_has_all_points() {
        for (at, x, y) in [(0, 0.0..0.5, 0.0..0.25), (4, 0.0..1.0, 0.0..1.0), (8, 0.5..1.0, 0.25..1.0)] {
            let mut weights = [0.0; 9];
            weights[at] = 3.0;
            let d = BilinearDistribution2D::new(3, vec![0.0, 0.25, 1.0], &weights);
            for ux in [0.0, 0.3, 0.5, LAST] {
                for uy in [0.0, 0.3, 0.5, LAST] {
                    // The density is zero on the border of the vertex's support, where no sample exists.
                    let Some((p, pdf)) = d.sample(Vec2::new(ux, uy)) else { continue };
                    assert!(pdf > 0.0, "{ux} {uy}");
                    assert!((x.start..=x.end).contains(&p[0]) && (y.start..=y.end).contains(&p[1]), "{p:?}");
                }
            }
        }
    }

    #[test]
    fn quantiles_invert_their_share() {
        for (a, b) in [(1.0, 1.0), (0.0, 2.0), (3.0, 0.0), (1e-30, 1.0), (5.0, 4.0)] {
            for p in [0.0, 1e-9, 0.3, 0.7, 1.0] {
                let t = linear_quantile(a, b, p);
                let share = t * (a + 0.5 * t * (b - a)) / (0.5 * (a + b));
                assert!((share - p).abs() < 1e-12, "{a} {b} {p}");
            }
        }
        assert_eq!(linear_quantile(0.0, 0.0, 0.25), 0.25);
    }
}
