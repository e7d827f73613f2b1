//! Measured materials. [Dupuy and Jakob 2018]
//!
//! A direction on the hemisphere is a point of the unit square: u = √(2θ/π), v = (φ + π)/2π. The microfacet normals
//! that a viewer sees have a density there, which maps the square to itself. In the mapped square, materials are smooth
//! functions, so that few measurements describe them.

use super::{BsdfEval, BsdfSample, Lobe};
use crate::color::Rgb;
use crate::error::{Error, Result};
use crate::math::{Vec2, Vec3};
use std::f32::consts::{FRAC_PI_2, PI, TAU};

/// The least of the first factor of the change of area from the square to directions, at the pole.
const LEAST_AREA: f32 = 1e-6;

/// A measured reflection. The surface is dark from behind.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Measured {
    viewers: Viewers,
    /// The distribution of microfacet normals.
    ndf: Table,
    /// The projected area of the microfacets for a viewer.
    sigma: Table,
    /// The density of the visible normals for each viewer.
    vndf: Warp,
    /// The density of the luminance in the mapped square for each viewer.
    luminance: Warp,
    /// The three channels for each viewer: of f·cosθ, divided by the density of visible normals if `jacobian`.
    channels: Table,
    jacobian: bool,
}

/// The tables of a file.
pub struct Tables {
    /// The azimuths of the viewers in radians, in increasing order: one or two for an isotropic material.
    pub phi: Vec<f32>,
    /// The angles of the viewers with the normal in radians, in increasing order.
    pub theta: Vec<f32>,
    /// See [`Measured`]; one slice.
    pub ndf: Table,
    /// See [`Measured`]; one slice.
    pub sigma: Table,
    /// See [`Measured`]; a slice for each viewer, of which θ changes fastest.
    pub vndf: Table,
    /// See [`Measured`]; a slice for each viewer.
    pub luminance: Table,
    /// See [`Measured`]; three slices for each viewer.
    pub channels: Table,
    /// Whether `channels` are divided by the density of visible normals.
    pub jacobian: bool,
}

/// The viewers of the measurement.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
struct Viewers {
    phi: Vec<f32>,
    theta: Vec<f32>,
    /// The full circle divided by the range of the azimuths. The material is the same in each such part of the circle.
    symmetry: u32,
}

/// Slices of values at the points of a grid over the unit square, interpolated bilinearly.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Table {
    width: usize,
    height: usize,
    values: Vec<f32>,
}

/// Four slices and their weights.
type Slices = [(usize, f32); 4];

/// The cell of a grid and the position in it.
#[derive(Clone, Copy)]
struct Cell {
    x: usize,
    y: usize,
    s: f32,
    t: f32,
}

impl Table {
    /// Creates a table of slices, one after the other, of rows.
    ///
    /// # Errors
    /// If a slice has fewer than 2 × 2 points, the number of values does not match, or a value is negative or not
    /// finite.
    pub fn new(width: usize, height: usize, slices: usize, values: Vec<f32>) -> Result<Self> {
        if width < 2
            || height < 2
            || width.checked_mul(height).and_then(|n| n.checked_mul(slices)) != Some(values.len())
        {
            let found = values.len();
            return Err(Error::scene(format!(
                "expected {slices} slices of {width} x {height} values, at least 2 x 2, found {found} values"
            )));
        }
        match values.iter().find(|v| !(v.is_finite() && **v >= 0.0)) {
            Some(v) => Err(Error::scene(format!("expected finite values of at least 0, found {v}"))),
            None => Ok(Table { width, height, values }),
        }
    }

    fn slice_len(&self) -> usize {
        self.width * self.height
    }

    /// Returns the cell of a point.
    fn cell(&self, p: Vec2) -> Cell {
        let along = |p: f32, points: usize| {
            let p = p.clamp(0.0, 1.0) * (points - 1) as f32;
            let cell = (p as usize).min(points - 2);
            (cell, p - cell as f32)
        };
        let ((x, s), (y, t)) = (along(p.x, self.width), along(p.y, self.height));
        Cell { x, y, s, t }
    }

    /// Returns the value at a point of the grid.
    fn at(&self, slices: &Slices, x: usize, y: usize) -> f32 {
        let index = y * self.width + x;
        slices.iter().map(|(slice, weight)| weight * self.values[slice * self.slice_len() + index]).sum()
    }

    /// Returns the interpolated value at a point.
    fn eval(&self, slices: &Slices, p: Vec2) -> f32 {
        let Cell { x, y, s, t } = self.cell(p);
        let row = |y| lerp(self.at(slices, x, y), self.at(slices, x + 1, y), s);
        lerp(row(y), row(y + 1), t)
    }
}

/// Densities on the unit square, and their distribution functions.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
struct Warp {
    /// The densities: each slice has the integral 1.
    density: Table,
    /// For each row, the integral from its first point, of which the last point has that of the row.
    rows: Table,
    /// For each row of a slice, the integral of all rows before.
    before: Vec<f32>,
}

impl Warp {
    fn new(mut density: Table) -> Result<Self> {
        let (width, height) = (density.width, density.height);
        let mut rows = density.clone();
        let mut before = Vec::new();
        let cells = ((width - 1) * (height - 1)) as f64;
        for slice in 0..density.values.len() / density.slice_len() {
            let of_slice = slice * density.slice_len()..(slice + 1) * density.slice_len();
            let values: Vec<f64> = density.values[of_slice.clone()].iter().map(|v| f64::from(*v)).collect();
            let mut sums = vec![0.0; values.len()];
            let mut until = vec![0.0; height];
            for y in 0..height {
                for x in 1..width {
                    let i = y * width + x;
                    sums[i] = sums[i - 1] + 0.5 * (values[i - 1] + values[i]);
                }
                if y > 0 {
                    until[y] = until[y - 1] + 0.5 * (sums[y * width - 1] + sums[(y + 1) * width - 1]);
                }
            }
            let total = until[height - 1] / cells;
            if total.is_nan() || total <= 0.0 {
                return Err(Error::scene("expected densities with a positive sum for each viewer"));
            }
            let scaled = |values: &[f64], by: f64| values.iter().map(|v| (v * by) as f32).collect::<Vec<_>>();
            density.values[of_slice.clone()].copy_from_slice(&scaled(&values, 1.0 / total));
            rows.values[of_slice].copy_from_slice(&scaled(&sums, 1.0 / (total * cells)));
            before.extend(scaled(&until, 1.0 / (total * cells)));
        }
        Ok(Warp { density, rows, before })
    }

    /// Returns the integral of all rows before row `y`.
    fn before(&self, slices: &Slices, y: usize) -> f32 {
        slices.iter().map(|(slice, weight)| weight * self.before[slice * self.density.height + y]).sum()
    }

    /// Returns the integral of row `y` from its first point to point `x`.
    fn row(&self, slices: &Slices, x: usize, y: usize) -> f32 {
        self.rows.at(slices, x, y)
    }

    /// Maps a uniform point to one with the density, and returns the density there.
    fn sample(&self, slices: &Slices, u: Vec2) -> (Vec2, f32) {
        let (width, height) = (self.density.width, self.density.height);
        let last = width - 1;
        let y = last_below(height - 1, |y| self.before(slices, y) <= u.y);
        let ends = [self.row(slices, last, y), self.row(slices, last, y + 1)];
        let t = invert_line(u.y - self.before(slices, y), ends);
        let of_row = |x: usize| lerp(self.row(slices, x, y), self.row(slices, x, y + 1), t);
        let target = u.x * lerp(ends[0], ends[1], t);
        let x = last_below(last, |x| of_row(x) <= target);
        let scale = last as f32 * (height - 1) as f32;
        let value = |x: usize| lerp(self.density.at(slices, x, y), self.density.at(slices, x, y + 1), t);
        let ends = [value(x), value(x + 1)];
        let s = invert_line((target - of_row(x)) * scale, ends);
        let p = Vec2::new((x as f32 + s) / last as f32, (y as f32 + t) / (height - 1) as f32);
        (p, lerp(ends[0], ends[1], s))
    }

    /// Maps a point to the one from which [`sample`](Self::sample) makes it, and returns the density there.
    fn invert(&self, slices: &Slices, p: Vec2) -> (Vec2, f32) {
        let last = self.density.width - 1;
        let Cell { x, y, s, t } = self.density.cell(p);
        let scale = last as f32 * (self.density.height - 1) as f32;
        let value = |x: usize| lerp(self.density.at(slices, x, y), self.density.at(slices, x, y + 1), t);
        let of_row = |x: usize| lerp(self.row(slices, x, y), self.row(slices, x, y + 1), t);
        let (ends, whole) = ([value(x), value(x + 1)], of_row(last));
        let within = of_row(x) + integrate_line(ends, s) / scale;
        let rows = [self.row(slices, last, y), self.row(slices, last, y + 1)];
        let u = Vec2::new(
            if whole > 0.0 { within / whole } else { 0.0 },
            self.before(slices, y) + integrate_line(rows, t),
        );
        (u.clamp(Vec2::ZERO, Vec2::ONE), lerp(ends[0], ends[1], s))
    }
}

fn lerp(a: f32, b: f32, t: f32) -> f32 {
    a + (b - a) * t
}

/// Returns the greatest index below `count` for which `below` holds, which is true up to some index; 0 if for none.
fn last_below(count: usize, below: impl Fn(usize) -> bool) -> usize {
    let (mut low, mut high) = (0, count);
    while high - low > 1 {
        let middle = usize::midpoint(low, high);
        if below(middle) { low = middle } else { high = middle }
    }
    low
}

/// Returns the integral from 0 to `x` of a line with the values `a` at 0 and `b` at 1.
fn integrate_line([a, b]: [f32; 2], x: f32) -> f32 {
    x * (a + 0.5 * x * (b - a))
}

/// Returns the `x` in [0, 1] for which [`integrate_line`] is `area`.
fn invert_line(area: f32, [a, b]: [f32; 2]) -> f32 {
    let root = (a * a + 2.0 * area * (b - a)).max(0.0).sqrt();
    let x = 2.0 * area / (a + root);
    if x.is_nan() { 0.0 } else { x.clamp(0.0, 1.0) }
}

impl Viewers {
    fn is_isotropic(&self) -> bool {
        self.phi.len() <= 2
    }

    /// Returns the slices around a viewer.
    fn slices(&self, phi: f32, theta: f32) -> Slices {
        let (p, t) = (between(&self.phi, phi), between(&self.theta, theta));
        let slice = |p: usize, t: usize| p * self.theta.len() + t;
        [
            (slice(p.0, t.0), (1.0 - p.2) * (1.0 - t.2)),
            (slice(p.0, t.1), (1.0 - p.2) * t.2),
            (slice(p.1, t.0), p.2 * (1.0 - t.2)),
            (slice(p.1, t.1), p.2 * t.2),
        ]
    }

    /// Returns the signs of x and y that take a viewer to the measured azimuths.
    fn mirror(&self, wo: Vec3) -> Vec3 {
        let sign = |v: f32| if v.is_sign_negative() { 1.0 } else { -1.0 };
        match self.symmetry {
            4 => Vec3::new(sign(wo.x), sign(wo.y), 1.0),
            0 | 1 => Vec3::ONE,
            _ => Vec3::new(sign(wo.y), sign(wo.y), 1.0),
        }
    }
}

/// Returns the indices of the entries around a value in increasing entries, and the share of the second.
fn between(entries: &[f32], value: f32) -> (usize, usize, f32) {
    let last = entries.len() - 1;
    let upper = entries.partition_point(|entry| *entry <= value).clamp(1.min(last), last);
    let lower = upper.saturating_sub(1);
    let span = entries[upper] - entries[lower];
    let share = if span > 0.0 { ((value - entries[lower]) / span).clamp(0.0, 1.0) } else { 0.0 };
    (lower, upper, share)
}

/// Returns the angles of a direction with the normal, and around it.
fn angles(w: Vec3) -> [f32; 2] {
    // Exact near the normal, where the arc cosine is not.
    let theta = 2.0 * (0.5 * (w - Vec3::Z).length()).min(1.0).asin();
    [theta, w.y.atan2(w.x)]
}

/// Returns the point of the unit square of a direction with the given angles.
fn to_square([theta, phi]: [f32; 2]) -> Vec2 {
    let v = (phi + PI) / TAU;
    Vec2::new((theta / FRAC_PI_2).sqrt(), v - v.floor())
}

/// A direction of the viewer, and its slices.
struct View {
    wo: Vec3,
    mirror: Vec3,
    angles: [f32; 2],
    slices: Slices,
}

impl Measured {
    /// Creates a material from the tables of a file.
    ///
    /// # Errors
    /// If the tables do not match, an angle is not finite, the projected area is 0, or a density has no positive sum.
    pub fn new(tables: Tables) -> Result<Self> {
        let Tables { phi, theta, ndf, sigma, vndf, luminance, channels, jacobian } = tables;
        let increases = |angles: &[f32]| {
            let finite = angles.iter().all(|angle| angle.is_finite());
            finite && angles.windows(2).all(|w| w[0] < w[1]) && !angles.is_empty()
        };
        if !increases(&phi) || !increases(&theta) {
            return Err(Error::scene("expected finite angles in increasing order"));
        }
        if sigma.values.iter().all(|v| *v == 0.0) {
            return Err(Error::scene(
                "expected some projected area of the microfacets, found 0 for all viewers",
            ));
        }
        let viewers = phi.len() * theta.len();
        let slices = |table: &Table| table.values.len() / table.slice_len();
        let counts = [&ndf, &sigma, &vndf, &luminance, &channels].map(slices);
        if counts != [1, 1, viewers, viewers, 3 * viewers] {
            return Err(Error::scene(format!("expected tables for {viewers} viewers")));
        }
        let whole = TAU / (phi[phi.len() - 1] - phi[0]);
        let symmetry = if phi.len() <= 2 { 1 } else { whole.round() as u32 };
        Ok(Measured {
            viewers: Viewers { phi, theta, symmetry },
            ndf,
            sigma,
            vndf: Warp::new(vndf)?,
            luminance: Warp::new(luminance)?,
            channels,
            jacobian,
        })
    }

    /// Returns whether the material depends on the tangents of the local frame.
    pub fn is_anisotropic(&self) -> bool {
        !self.viewers.is_isotropic()
    }

    fn view(&self, wo: Vec3) -> View {
        let mirror = self.viewers.mirror(wo);
        let wo = wo * mirror;
        let angles = angles(wo);
        View { wo, mirror, angles, slices: self.viewers.slices(angles[1], angles[0]) }
    }

    /// Returns the bare BSDF and the density.
    pub fn eval(&self, wo: Vec3, wi: Vec3) -> BsdfEval {
        if !(wo.z > 0.0 && wi.z > 0.0) {
            return BsdfEval::ZERO;
        }
        let View { wo, mirror, angles: [theta, phi], slices } = self.view(wo);
        let m = (wo + wi * mirror).normalize_or(Vec3::Z);
        let [theta_m, phi_m] = angles(m);
        let turn = if self.viewers.is_isotropic() { phi } else { 0.0 };
        let at = to_square([theta_m, phi_m - turn]);
        let (u, visible) = self.vndf.invert(&slices, at);
        let luminance = self.luminance.density.eval(&slices, u);
        let pdf = visible * luminance / area(at, m, wo);
        let mut scale = 1.0 / wi.z;
        if self.jacobian {
            let one = [(0, 1.0), (0, 0.0), (0, 0.0), (0, 0.0)];
            scale *= self.ndf.eval(&one, at) / (4.0 * self.sigma.eval(&one, to_square([theta, phi])));
        }
        let channel =
            |c: usize| self.channels.eval(&slices.map(|(slice, weight)| (3 * slice + c, weight)), u);
        let f = Rgb::new(channel(0), channel(1), channel(2)) * scale;
        if f.is_valid() && pdf.is_finite() { BsdfEval { f, pdf } } else { BsdfEval::ZERO }
    }

    /// Samples a direction.
    pub fn sample(&self, wo: Vec3, u: Vec2) -> Option<BsdfSample> {
        if wo.z <= 0.0 {
            return None;
        }
        let View { wo: to, mirror, angles: [_, phi], slices } = self.view(wo);
        let (at, _) = self.luminance.sample(&slices, Vec2::new(u.y, u.x));
        let (at, _) = self.vndf.sample(&slices, at);
        let turn = if self.viewers.is_isotropic() { phi } else { 0.0 };
        let ((sin, cos), (sin_phi, cos_phi)) =
            ((at.x * at.x * FRAC_PI_2).sin_cos(), ((2.0 * at.y - 1.0) * PI + turn).sin_cos());
        let m = Vec3::new(cos_phi * sin, sin_phi * sin, cos);
        let wi = (m * (2.0 * m.dot(to)) - to) * mirror;
        let wi = wi.normalize();
        let BsdfEval { f, pdf } = self.eval(wo, wi);
        let weight = f * (wi.z / pdf);
        (pdf > 0.0).then_some(BsdfSample { wi, weight, pdf, lobe: Lobe::Glossy, eta: 1.0 })
    }

    /// Returns the reflectance for a viewer on the normal: the mean of f·cosθ/pdf over a grid of samples.
    pub fn albedo(&self) -> Rgb {
        const SIDE: u32 = 16;
        let mut sum = Rgb::BLACK;
        for i in 0..SIDE * SIDE {
            let u = Vec2::new((i % SIDE) as f32 + 0.5, (i / SIDE) as f32 + 0.5) / SIDE as f32;
            sum += self.sample(Vec3::Z, u).map_or(Rgb::BLACK, |sample| sample.weight);
        }
        sum * (1.0 / (SIDE * SIDE) as f32)
    }

    /// Returns the bytes of the tables.
    pub fn memory_bytes(&self) -> usize {
        let tables = [&self.ndf, &self.sigma, &self.vndf.density, &self.vndf.rows, &self.channels];
        let more = [&self.luminance.density, &self.luminance.rows];
        tables.into_iter().chain(more).map(|table| size_of_val(&table.values[..])).sum()
    }
}

/// Returns the solid angle of directions `wi` for a unit of area around the point `at`, whose microfacet normal is `m`.
fn area(at: Vec2, m: Vec3, wo: Vec3) -> f32 {
    (2.0 * PI * PI * at.x * m.x.hypot(m.y)).max(LEAST_AREA) * 4.0 * wo.dot(m)
}
