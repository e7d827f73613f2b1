//! The isosurface of signed distances in a grid.

use crate::accel::{Hit, Primitive, SdfCell, Surfaces};
use crate::error::{Error, Result};
use crate::math::{DAffine3, DVec3, Vec3};
use std::sync::Arc;

/// The normals for shading.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub enum SdfNormals {
    /// Continuous over the faces of cells. [Hansson-Söderlund et al. 2022, section 5]
    #[default]
    Smooth,
    /// Those of the isosurface, which has edges at the faces of cells.
    Analytic,
}

/// Signed distances at the points of a grid that covers the cube [0, 1]³. Between them, the distance is interpolated
/// trilinearly. The surface is where it is zero. Its front side is that of greater distances.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct SdfGrid {
    /// The number of points along each axis, at least 2.
    size: [usize; 3],
    /// The distances; x is the fastest axis and z the slowest.
    values: Vec<f32>,
    normals: SdfNormals,
}

impl SdfGrid {
    /// Creates a grid from its distances.
    ///
    /// # Errors
    /// If there are fewer than two points along an axis, the number of distances does not match, a distance is not
    /// finite, or the surface is nowhere.
    pub fn new(size: [usize; 3], values: Vec<f32>, normals: SdfNormals) -> Result<Self> {
        let [x, y, z] = size;
        if size.iter().any(|n| *n < 2) {
            return Err(Error::scene(format!(
                "expected at least 2 points along each axis, found {x} x {y} x {z}"
            )));
        }
        let points = size.iter().try_fold(1usize, |product, n| product.checked_mul(*n));
        if points != Some(values.len()) || u32::try_from(values.len()).is_err() {
            let count = values.len();
            return Err(Error::scene(format!("expected {x} x {y} x {z} distances, found {count}")));
        }
        if let Some(value) = values.iter().find(|v| !v.is_finite()) {
            return Err(Error::scene(format!("expected finite distances, found {value}")));
        }
        let grid = SdfGrid { size, values, normals };
        if grid.cells().next().is_none() {
            return Err(Error::scene("expected distances of both signs in some cell, found none"));
        }
        Ok(grid)
    }

    /// Returns the index of a point.
    fn index(&self, [x, y, z]: [usize; 3]) -> usize {
        (z * self.size[1] + y) * self.size[0] + x
    }

    /// Returns the distances at the corners of the cell above a point.
    fn corners(&self, [x, y, z]: [usize; 3]) -> [f32; 8] {
        [0, 1, 2, 3, 4, 5, 6, 7]
            .map(|i| self.values[self.index([x + (i & 1), y + (i >> 1 & 1), z + (i >> 2)])])
    }

    /// Returns the cells in which there is a part of the surface, by their first points.
    fn cells(&self) -> impl Iterator<Item = [usize; 3]> + '_ {
        let [nx, ny, nz] = self.size.map(|n| n - 1);
        let all = (0..nz).flat_map(move |z| (0..ny).flat_map(move |y| (0..nx).map(move |x| [x, y, z])));
        all.filter(|cell| {
            let corners = self.corners(*cell);
            corners.iter().any(|v| *v < 0.0) && corners.iter().any(|v| *v >= 0.0)
        })
    }

    /// Returns the distance in the plane of points with the coordinate `plane` along `axis`, at the point `p`
    /// along the other two. Coordinates are in cells.
    fn in_plane(&self, axis: usize, plane: usize, p: DVec3) -> f64 {
        let [b, c] = [(axis + 1) % 3, (axis + 2) % 3];
        let cell = |a: usize| (p[a].max(0.0) as usize).min(self.size[a] - 2);
        let (first, mut sum) = ([b, c].map(cell), 0.0);
        for corner in 0..4 {
            let upper = [corner & 1, corner >> 1];
            let mut at = [plane; 3];
            let mut weight = 1.0;
            for (k, a) in [b, c].into_iter().enumerate() {
                at[a] = first[k] + upper[k];
                let fraction = p[a] - first[k] as f64;
                weight *= if upper[k] == 1 { fraction } else { 1.0 - fraction };
            }
            sum += weight * f64::from(self.values[self.index(at)]);
        }
        sum
    }

    /// Returns a vector along the smooth normal at a point in local coordinates: the normals of the eight cells around
    /// the nearest point of the grid, interpolated trilinearly between the centres of the cells. A cell outside of the
    /// grid has the normal of its neighbour inside. [Hansson-Söderlund et al. 2022, section 5]
    fn smooth_normal(&self, local: DVec3) -> DVec3 {
        let scale = DVec3::from(self.size.map(|n| (n - 1) as f64));
        let p = local * scale;
        // For each axis: the weight of the upper cell, and the slopes of both.
        let along = [0, 1, 2].map(|axis| {
            let last = self.size[axis] as i64 - 2;
            let lower = (p[axis] - 0.5).floor();
            let slope = |cell: i64| {
                let cell = cell.clamp(0, last) as usize;
                (self.in_plane(axis, cell + 1, p) - self.in_plane(axis, cell, p)) * scale[axis]
            };
            (p[axis] - 0.5 - lower, [slope(lower as i64), slope(lower as i64 + 1)])
        });
        let mut sum = DVec3::ZERO;
        for cell in 0..8 {
            let upper = [0, 1, 2].map(|axis| cell >> axis & 1);
            let weight: f64 =
                [0, 1, 2].map(|a| if upper[a] == 1 { along[a].0 } else { 1.0 - along[a].0 }).iter().product();
            sum += weight * DVec3::from([0, 1, 2].map(|a| along[a].1[upper[a]])).normalize_or_zero();
        }
        sum
    }
}

/// The cells in which there is a part of the surface, in world space.
#[derive(Debug)]
pub struct SdfCells {
    grid: SdfGrid,
    /// The index of the first point of each cell.
    first_points: Vec<u32>,
    to_world: DAffine3,
}

impl SdfCells {
    fn cell(&self, i: usize) -> SdfCell {
        let (index, [nx, ny, _]) = (self.first_points[i] as usize, self.grid.size);
        let first = [index % nx, index / nx % ny, index / (nx * ny)];
        let scale = DVec3::from(self.grid.size.map(|n| (n - 1) as f64));
        let corner = |first: [usize; 3]| {
            self.to_world.transform_point3(DVec3::from(first.map(|i| i as f64)) / scale).as_vec3()
        };
        let low = corner(first);
        SdfCell { corner: low, size: corner(first.map(|i| i + 1)) - low, values: self.grid.corners(first) }
    }
}

impl Surfaces for SdfCells {
    fn count(&self) -> usize {
        self.first_points.len()
    }

    fn surface(&self, i: usize) -> Primitive {
        Primitive::SdfCell(self.cell(i))
    }
}

/// An isosurface in world space. The accelerator shares its cells.
pub struct WorldSdfGrid {
    /// The cells.
    pub cells: Arc<SdfCells>,
    to_local: DAffine3,
}

impl WorldSdfGrid {
    /// Transforms a grid.
    ///
    /// # Errors
    /// If the axes of the grid are not those of the space.
    pub fn new(grid: SdfGrid, to_world: &DAffine3) -> Result<Self> {
        let m = to_world.matrix3;
        let off_axis = [m.x_axis.y, m.x_axis.z, m.y_axis.x, m.y_axis.z, m.z_axis.x, m.z_axis.y];
        let greatest = m.to_cols_array().into_iter().map(f64::abs).fold(0.0, f64::max);
        if off_axis.iter().any(|v| v.abs() > 1e-6 * greatest) {
            return Err(Error::scene(
                "an sdfgrid cannot be rotated: put it into a shapegroup, and rotate the instance",
            ));
        }
        let scale = DVec3::new(m.x_axis.x, m.y_axis.y, m.z_axis.z);
        let to_world = DAffine3::from_translation(to_world.translation) * DAffine3::from_scale(scale);
        let first_points = grid.cells().map(|first| grid.index(first) as u32).collect();
        let cells = Arc::new(SdfCells { grid, first_points, to_world });
        Ok(WorldSdfGrid { cells, to_local: to_world.inverse() })
    }

    /// Returns the unit normal of the surface at a hit at or near `p`.
    pub fn normal(&self, hit: &Hit, p: Vec3) -> Vec3 {
        let cell = self.cells.cell(hit.primitive as usize);
        let (_, gradient) = cell.value(cell.local(p.as_dvec3()));
        (gradient / cell.size.as_dvec3()).normalize_or(DVec3::Z).as_vec3()
    }

    /// Moves a point at or near `p` onto the surface. Returns it with its unit normal, the unit normal for shading, and
    /// the greatest magnitude of its coordinates.
    pub fn surface(&self, hit: &Hit, p: Vec3) -> (Vec3, [Vec3; 2], Vec3) {
        let cell = self.cells.cell(hit.primitive as usize);
        let reach = cell.corner.abs().max((cell.corner + cell.size).abs());
        let (value, gradient) = cell.value(cell.local(p.as_dvec3()));
        let gradient = gradient / cell.size.as_dvec3();
        let ng = gradient.normalize_or(DVec3::Z);
        // One step of Newton's method: the hit is within a few roundings of the surface.
        let step = value / gradient.length();
        let p =
            if step.abs() < f64::from(cell.size.length()) { p.as_dvec3() - ng * step } else { p.as_dvec3() };
        let ns = match self.cells.grid.normals {
            SdfNormals::Analytic => ng,
            SdfNormals::Smooth => {
                let local = self.cells.grid.smooth_normal(self.to_local.transform_point3(p));
                (self.to_local.matrix3.transpose() * local).normalize_or(ng)
            }
        };
        (p.as_vec3(), [ng.as_vec3(), ns.as_vec3()], reach)
    }

    /// Returns the bytes of the arrays.
    pub fn memory_bytes(&self) -> usize {
        size_of_val(&self.cells.grid.values[..]) + size_of_val(&self.cells.first_points[..])
    }
}
