//! Functions of a point in space that provide the coefficients of media.

use crate::color::Rgb;
use crate::error::{Error, Result};
use crate::math::{DAffine3, DVec3, Vec3};
use crate::texture::{FilterType, WrapMode};
use std::sync::Arc;

/// A colour as a function of the point. A grid is in a box, which is the unit cube in local coordinates, and continues
/// outside by its wrap mode.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Volume {
    /// From world to local coordinates.
    to_local: DAffine3,
    field: Field,
}

#[derive(Clone, Debug, PartialEq, serde::Serialize)]
enum Field {
    Constant(Rgb),
    Grid(Arc<Grid>),
}

/// Values at the centres of the equal cells of the unit cube.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Grid {
    /// The number of cells along each axis, at least 1.
    size: [usize; 3],
    /// The number of values of a cell: 1 or 3.
    channels: usize,
    /// The values of the first cell, of its neighbour along x, and so on; x is the fastest axis and z the slowest.
    values: Vec<f32>,
    filter: FilterType,
    wrap: WrapMode,
}

impl Grid {
    /// Creates a grid from the values of its cells, of which x is the fastest axis and z the slowest.
    ///
    /// # Errors
    /// If the sizes do not match, there are neither one nor three values for each cell, or a value is negative or not
    /// finite.
    pub fn new(
        size: [usize; 3],
        channels: usize,
        values: Vec<f32>,
        filter: FilterType,
        wrap: WrapMode,
    ) -> Result<Self> {
        if channels != 1 && channels != 3 {
            return Err(Error::scene(format!(
                "expected one or three values for each cell, found {channels}"
            )));
        }
        let cells = size.iter().try_fold(channels, |product, n| product.checked_mul(*n));
        if size.contains(&0) || cells != Some(values.len()) {
            let [x, y, z] = size;
            return Err(Error::scene(format!(
                "expected {channels} values for each of {x} x {y} x {z} cells, found {}",
                values.len()
            )));
        }
        match values.iter().find(|v| !(v.is_finite() && **v >= 0.0)) {
            Some(v) => Err(Error::scene(format!("expected finite values of at least 0, found {v}"))),
            None => Ok(Grid { size, channels, values, filter, wrap }),
        }
    }

    /// Returns the number of bytes of the values.
    pub fn memory_bytes(&self) -> usize {
        size_of_val(self.values.as_slice())
    }

    /// Returns the value at a point in local coordinates.
    fn at(&self, local: DVec3) -> Rgb {
        let x = [0, 1, 2].map(|axis| local[axis] * self.size[axis] as f64);
        if self.filter == FilterType::Nearest {
            return self.cell([0, 1, 2].map(|axis| self.wrapped(x[axis].floor() as i64, axis)));
        }
        let x = x.map(|x| x - 0.5);
        let first = x.map(|x| x.floor() as i64);
        let mut sum = Rgb::BLACK;
        for corner in 0..8 {
            let mut weight = 1.0;
            let cell = [0, 1, 2].map(|axis| {
                let upper = (corner >> axis & 1) as i64;
                let fraction = x[axis] - first[axis] as f64;
                weight *= if upper == 1 { fraction } else { 1.0 - fraction };
                self.wrapped(first[axis] + upper, axis)
            });
            sum += self.cell(cell) * weight as f32;
        }
        sum
    }

    /// Returns the value of one of the cells whose mean is the value at a point in local coordinates, with its weight
    /// as the probability, for trilinear interpolation. `u` is a random number.
    fn one_of(&self, local: DVec3, mut u: f64) -> Rgb {
        self.cell([0, 1, 2].map(|axis| {
            let x = local[axis] * self.size[axis] as f64 - 0.5;
            let first = x.floor();
            let fraction = x - first;
            let upper = u < fraction;
            // The rest of the number is uniform again.
            u = if upper { u / fraction } else { (u - fraction) / (1.0 - fraction) };
            self.wrapped(first as i64 + i64::from(upper), axis)
        }))
    }

    fn wrapped(&self, i: i64, axis: usize) -> usize {
        self.wrap.wrap(i, self.size[axis])
    }

    fn cell(&self, [x, y, z]: [usize; 3]) -> Rgb {
        let values = &self.values[self.channels * ((z * self.size[1] + y) * self.size[0] + x)..];
        match self.channels {
            1 => Rgb::splat(values[0]),
            _ => Rgb::new(values[0], values[1], values[2]),
        }
    }

    /// Returns an upper bound of the values of all channels in a box, in local coordinates.
    fn bound(&self, [low, high]: [DVec3; 2]) -> f32 {
        // Wider than the rounding errors of points on the border of the box.
        const MARGIN: f64 = 1e-6;
        let range = |axis: usize| {
            let n = self.size[axis] as f64;
            let first = (low[axis] * n - 0.5 - MARGIN).floor() as i64;
            let last = (high[axis] * n - 0.5 + MARGIN).floor() as i64 + 1;
            // A range that is longer than the grid and its mirror image contains all cells.
            let cells = self.size[axis] as i64;
            if last - first >= 2 * cells { 0..=cells - 1 } else { first..=last }
        };
        let [columns, rows, slices] =
            [0, 1, 2].map(|axis| range(axis).map(|i| self.wrapped(i, axis)).collect::<Vec<_>>());
        let mut largest = 0.0f32;
        for &z in &slices {
            for &y in &rows {
                for &x in &columns {
                    largest = largest.max(self.cell([x, y, z]).max_component());
                }
            }
        }
        largest
    }
}

impl Volume {
    /// Creates a volume with the same value everywhere in the unit cube, as it is transformed to world space.
    ///
    /// # Errors
    /// If the transformation is not invertible.
    pub fn constant(value: Rgb, to_world: DAffine3) -> Result<Self> {
        Volume::new(Field::Constant(value), to_world)
    }

    /// Creates a volume from a grid over the unit cube, as it is transformed to world space.
    ///
    /// # Errors
    /// If the transformation is not invertible.
    pub fn grid(grid: Arc<Grid>, to_world: DAffine3) -> Result<Self> {
        Volume::new(Field::Grid(grid), to_world)
    }

    fn new(field: Field, to_world: DAffine3) -> Result<Self> {
        let to_local = to_world.inverse();
        match to_local.is_finite() {
            true => Ok(Volume { to_local, field }),
            false => Err(Error::scene("expected a transformation that can be inverted")),
        }
    }

    /// Returns the box in world space that is aligned with the axes and contains the unit cube of local coordinates.
    pub fn world_box(&self) -> [DVec3; 2] {
        box_of(&self.to_local.inverse(), [DVec3::ZERO, DVec3::ONE])
    }

    /// Returns the box in local coordinates that contains a box in world space.
    pub fn local_box(&self, of: [DVec3; 2]) -> [DVec3; 2] {
        box_of(&self.to_local, of)
    }

    /// Returns the value if it is the same everywhere.
    pub fn constant_value(&self) -> Option<Rgb> {
        match &self.field {
            Field::Constant(value) => Some(*value),
            Field::Grid(_) => None,
        }
    }

    /// Returns local coordinates.
    #[inline]
    pub fn local(&self, p: DVec3) -> DVec3 {
        self.to_local.transform_point3(p)
    }

    /// Returns a direction in local coordinates, which is not a unit vector.
    #[inline]
    pub fn local_direction(&self, d: Vec3) -> DVec3 {
        self.to_local.transform_vector3(d.as_dvec3())
    }

    /// Returns the value at local coordinates.
    #[inline]
    pub fn at_local(&self, local: DVec3) -> Rgb {
        match &self.field {
            Field::Constant(value) => *value,
            Field::Grid(grid) => grid.at(local),
        }
    }

    /// Returns a random value whose mean is that at local coordinates, from the random number that `uniform` returns.
    /// It reads one cell of a grey grid instead of eight. [Hofmann et al. 2021]
    #[inline]
    pub fn sample_at_local(&self, local: DVec3, uniform: impl FnOnce() -> f64) -> Rgb {
        match &self.field {
            Field::Constant(value) => *value,
            // The colour of one cell is not that of the mean, which spectral tracking would make noise of.
            Field::Grid(grid) if grid.channels == 1 && grid.filter != FilterType::Nearest => {
                grid.one_of(local, uniform())
            }
            Field::Grid(grid) => grid.at(local),
        }
    }

    /// Returns the number of cells along each axis.
    pub fn size(&self) -> [usize; 3] {
        match &self.field {
            Field::Constant(_) => [1; 3],
            Field::Grid(grid) => grid.size,
        }
    }

    /// Returns an upper bound of the values of all channels in a box, in local coordinates.
    pub fn bound(&self, part: [DVec3; 2]) -> f32 {
        match &self.field {
            Field::Constant(value) => value.max_component(),
            Field::Grid(grid) => grid.bound(part),
        }
    }
}

/// Returns the bounds of a transformed box.
fn box_of(transform: &DAffine3, [low, high]: [DVec3; 2]) -> [DVec3; 2] {
    let side = |upper: u32, axis: usize| if upper == 1 { high[axis] } else { low[axis] };
    let corner = |i: u32| DVec3::new(side(i & 1, 0), side(i >> 1 & 1, 1), side(i >> 2 & 1, 2));
    let corners = (0..8).map(|i| transform.transform_point3(corner(i)));
    corners.fold([DVec3::INFINITY, DVec3::NEG_INFINITY], |[a, b], p| [a.min(p), b.max(p)])
}
