//! The Hessian of the irradiance with respect to a translation along the surface, including changes of occlusion.
//!
//! The ray hits of the hemisphere are the vertices of a mesh. Neighbouring cells are connected, the lowest ring ends
//! at the surface's horizon, and a cap closes the highest ring. A triangle has the radiance of its farthest vertex,
//! so that nearer surfaces occlude it. [Schwarzhaupt et al. 2012] The mesh's irradiance at a point x is a sum over
//! its edges, each with the difference ΔL of the radiances on both sides: E(x) = ½ Σ ΔL θ·n·(r₀ × r₁)/|r₀ × r₁|,
//! where r₀ and r₁ are the vectors from x to the edge's ends and θ is the angle between them. [Lambert 1760] The
//! Hessian is the second derivative of this sum.

use super::hemisphere::Hemisphere;
use glam::DVec3;

/// The second derivatives of the irradiance's luminance along the axes of the surface's frame, in W·m⁻² per squared
/// unit of length.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Hessian {
    /// The second derivative along the first axis.
    pub xx: f64,
    /// The mixed derivative.
    pub xy: f64,
    /// The second derivative along the second axis.
    pub yy: f64,
}

/// The distance of cells without a hit, relative to the farthest hit.
const FAR: f64 = 1e3;

impl Hessian {
    /// Computes the Hessian of a hemisphere.
    pub fn of(hemisphere: &Hemisphere<'_>) -> Self {
        // The mesh is scaled such that powers of distances neither overflow nor underflow.
        let unit = f64::from(hemisphere.harmonic_mean_distance().max(f32::MIN_POSITIVE));
        if !unit.is_finite() {
            return Hessian::default();
        }
        HemisphereMesh::new(hemisphere, unit).hessian().scaled(1.0 / (unit * unit))
    }

    /// Returns the sum of the absolute eigenvalues.
    pub fn curvature(&self) -> f64 {
        let between = (0.25 * (self.xx - self.yy).powi(2) + self.xy * self.xy).sqrt();
        (self.xx + self.yy).abs().max(2.0 * between)
    }

    fn scaled(self, factor: f64) -> Hessian {
        Hessian { xx: self.xx * factor, xy: self.xy * factor, yy: self.yy * factor }
    }

    fn add(&mut self, edge: Hessian, difference: f64) {
        self.xx += edge.xx * difference;
        self.xy += edge.xy * difference;
        self.yy += edge.yy * difference;
    }
}

/// The mesh of the surfaces that the hemisphere sees, in the surface's frame. The quadrilateral of a cell connects it
/// with the next ring outwards and the next sector. The diagonal from the cell divides it into two triangles.
struct HemisphereMesh {
    rings: usize,
    sectors: usize,
    vertices: Vec<DVec3>,
    /// For each cell, distance and luminance.
    seen: Vec<(f64, f64)>,
    /// Mean luminance of the highest ring, for the cap.
    cap: f64,
}

impl HemisphereMesh {
    fn new(hemisphere: &Hemisphere<'_>, unit: f64) -> Self {
        let distances = || hemisphere.distance.iter().map(|d| f64::from(d.max(f32::MIN_POSITIVE)) / unit);
        let far = FAR * distances().filter(|d| d.is_finite()).fold(0.0, f64::max);
        let luminances = hemisphere.radiance.iter().map(|l| f64::from(l.luminance()));
        let seen: Vec<(f64, f64)> = distances().map(|d| d.min(far)).zip(luminances).collect();
        let vertices = hemisphere.directions.iter().zip(&seen).map(|(d, (t, _))| d.as_dvec3() * *t).collect();
        let (rings, sectors) = (hemisphere.strata.rings, hemisphere.strata.sectors);
        let cap = seen[..sectors].iter().map(|(_, luminance)| luminance).sum::<f64>() / sectors as f64;
        HemisphereMesh { rings, sectors, vertices, seen, cap }
    }

    fn cell(&self, ring: usize, sector: usize) -> usize {
        ring * self.sectors + sector % self.sectors
    }

    /// Returns the luminance of the farthest of three cells.
    fn farthest(&self, cells: [usize; 3]) -> f64 {
        let [a, b, c] = cells.map(|cell| self.seen[cell]);
        let ab = if a.0 >= b.0 { a } else { b };
        if ab.0 >= c.0 { ab.1 } else { c.1 }
    }

    /// Returns the luminance of the triangle with an edge along the cell's ring; for the lowest ring, that of the
    /// part down to the horizon.
    fn inner(&self, j: usize, k: usize) -> f64 {
        let outwards = self.cell((j + 1).min(self.rings - 1), k + 1);
        self.farthest([self.cell(j, k), self.cell(j, k + 1), outwards])
    }

    /// Returns the luminance of the cell's other triangle.
    fn outer(&self, j: usize, k: usize) -> f64 {
        self.farthest([self.cell(j, k), self.cell(j + 1, k), self.cell(j + 1, k + 1)])
    }

    fn hessian(&self) -> Hessian {
        let mut sum = Hessian::default();
        let last = self.rings - 1;
        for j in 0..self.rings {
            for k in 0..self.sectors {
                let before = k + self.sectors - 1;
                let (inner, inner_before) = (self.inner(j, k), self.inner(j, before));
                let v = self.vertices[self.cell(j, k)];
                let next_sector = self.vertices[self.cell(j, k + 1)];
                let above = if j == 0 { self.cap } else { self.outer(j - 1, k) };
                sum.add(edge(v, next_sector), above - inner);
                if j == last {
                    let foot = |v: DVec3| DVec3::new(v.x, v.y, 0.0);
                    sum.add(edge(v, foot(v)), inner - inner_before);
                    sum.add(edge(foot(v), foot(next_sector)), inner);
                } else {
                    let outer = self.outer(j, k);
                    sum.add(edge(v, self.vertices[self.cell(j + 1, k)]), outer - inner_before);
                    sum.add(edge(v, self.vertices[self.cell(j + 1, k + 1)]), inner - outer);
                }
            }
        }
        sum
    }
}

/// Returns the first and second derivative of arctan(√s / d)/√s with respect to `s`, for an edge whose end vectors
/// have the dot product `d` and a cross product with the squared length `s`.
fn angle(s: f64, d: f64) -> [f64; 2] {
    let t = s / (d * d);
    if d > 0.0 && t < 0.05 {
        // Here the closed form suffers from cancellation. Six terms of the series give six digits.
        let f_s = -1.0 / 3.0
            + t * (2.0 / 5.0 + t * (-3.0 / 7.0 + t * (4.0 / 9.0 + t * (-5.0 / 11.0 + t * 6.0 / 13.0))));
        let f_ss = 2.0 / 5.0
            + t * (-6.0 / 7.0 + t * (12.0 / 9.0 + t * (-20.0 / 11.0 + t * (30.0 / 13.0 - t * 42.0 / 15.0))));
        let per_d = 1.0 / d;
        let cube = per_d * per_d * per_d;
        return [f_s * cube, f_ss * cube * per_d * per_d];
    }
    let root = s.sqrt();
    let per_product = 1.0 / (s + d * d);
    let f = root.atan2(d) / root;
    let f_s = (d * per_product - f) / (2.0 * s);
    [f_s, (-0.5 * d * per_product * per_product - 1.5 * f_s) / s]
}

/// Returns the second derivatives of ½ θ n·(r₀ × r₁)/|r₀ × r₁| with respect to the common origin of the vectors `r0`
/// and `r1`, along the first two axes; n is the third.
fn edge(r0: DVec3, r1: DVec3) -> Hessian {
    let (c, d, w) = (r0.cross(r1), r0.dot(r1), r1 - r0);
    let s = c.length_squared();
    if s == 0.0 {
        // An edge seen end-on, or of zero length, does not contribute: its direction is undefined.
        return Hessian::default();
    }
    let [f_s, f_ss] = angle(s, d);
    let per_product = 1.0 / (s + d * d);
    let (f_d, f_sd) = (-per_product, per_product * per_product);
    let f_dd = 2.0 * d * f_sd;
    // The cross product is affine in the origin; its square and the dot product are quadratic.
    let (c_x, c_y) = (DVec3::new(0.0, w.z, -w.y), DVec3::new(-w.z, 0.0, w.x));
    let (s_x, s_y) = (2.0 * c.dot(c_x), 2.0 * c.dot(c_y));
    let (d_x, d_y) = (-(r0.x + r1.x), -(r0.y + r1.y));
    let (f_x, f_y) = (f_s * s_x + f_d * d_x, f_s * s_y + f_d * d_y);
    let second = |s_k: f64, s_l: f64, d_k: f64, d_l: f64, s_kl: f64, d_kl: f64| {
        f_ss * s_k * s_l + f_sd * (s_k * d_l + s_l * d_k) + f_dd * d_k * d_l + f_s * s_kl + f_d * d_kl
    };
    let f_xx = second(s_x, s_x, d_x, d_x, 2.0 * c_x.length_squared(), 2.0);
    let f_xy = second(s_x, s_y, d_x, d_y, 2.0 * c_x.dot(c_y), 0.0);
    let f_yy = second(s_y, s_y, d_y, d_y, 2.0 * c_y.length_squared(), 2.0);
    Hessian {
        xx: c_x.z * f_x + 0.5 * c.z * f_xx,
        xy: 0.5 * (c_x.z * f_y + c_y.z * f_x + c.z * f_xy),
        yy: c_y.z * f_y + 0.5 * c.z * f_yy,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::color::Rgb;
    use crate::integrator::irrcache::hemisphere::Strata;
    use crate::math::{Frame, Vec3};
    use std::f64::consts::PI;

    /// The contribution of one edge to the irradiance.
    fn value(r0: DVec3, r1: DVec3) -> f64 {
        let c = r0.cross(r1);
        0.5 * c.length().atan2(r0.dot(r1)) * c.z / c.length()
    }

    #[test]
    fn an_edges_second_derivatives_are_finite_differences() {
        let edges = [
            (DVec3::new(0.3, 0.7, 0.9), DVec3::new(-0.4, 0.5, 0.6)),
            (DVec3::new(1.0, 0.2, 0.5), DVec3::new(1.1, 0.25, 0.5)),
            (DVec3::new(-1.0, 0.2, 0.1), DVec3::new(0.9, 0.4, 0.2)),
            (DVec3::new(0.5, -0.8, 0.0), DVec3::new(0.9, 0.4, 0.0)),
        ];
        for (r0, r1) in edges {
            let at = |x: f64, y: f64| {
                let moved = DVec3::new(x, y, 0.0);
                value(r0 - moved, r1 - moved)
            };
            let h = 1e-3;
            let xx = (at(h, 0.0) - 2.0 * at(0.0, 0.0) + at(-h, 0.0)) / (h * h);
            let yy = (at(0.0, h) - 2.0 * at(0.0, 0.0) + at(0.0, -h)) / (h * h);
            let xy = (at(h, h) - at(h, -h) - at(-h, h) + at(-h, -h)) / (4.0 * h * h);
            let found = edge(r0, r1);
            for (found, wanted) in [(found.xx, xx), (found.xy, xy), (found.yy, yy)] {
                assert!((found - wanted).abs() < 1e-4 * wanted.abs().max(1.0), "{found} instead of {wanted}");
            }
        }
    }

    #[test]
    fn the_series_for_small_angles_meets_the_closed_form() {
        for d in [0.1, 1.0, 30.0] {
            let (below, above) = (angle(0.049_999 * d * d, d), angle(0.050_001 * d * d, d));
            for (a, b) in below.into_iter().zip(above) {
                assert!((a / b - 1.0).abs() < 2e-5, "{a} and {b}");
            }
        }
    }

    /// The mean over many scrambles of the Hessian at `o` with the normal z, in world-space axes.
    fn mean(o: Vec3, view: impl Fn(Vec3, Vec3) -> (f32, f32)) -> Hessian {
        let (strata, frame) = (Strata::new(64), Frame::from_normal(Vec3::Z));
        let mut sum = Hessian::default();
        for scramble in 0..32 {
            let directions: Vec<Vec3> = strata.directions(scramble).collect();
            let seen = directions.iter().map(|d| view(o, frame.to_world(*d)));
            let (radiance, distance): (Vec<_>, Vec<_>) = seen.map(|(l, t)| (Rgb::splat(l), t)).unzip();
            let hemisphere = Hemisphere {
                strata,
                frame,
                directions: &directions,
                radiance: &radiance,
                distance: &distance,
            };
            sum.add(Hessian::of(&hemisphere), 1.0 / 32.0);
        }
        let Hessian { xx, xy, yy } = sum;
        let (s, t) = (frame.s.as_dvec3(), frame.t.as_dvec3());
        let along = |a: fn(DVec3) -> f64, b: fn(DVec3) -> f64| {
            a(s) * b(s) * xx + (a(s) * b(t) + a(t) * b(s)) * xy + a(t) * b(t) * yy
        };
        Hessian { xx: along(|v| v.x, |v| v.x), xy: along(|v| v.x, |v| v.y), yy: along(|v| v.y, |v| v.y) }
    }

    /// The test scenes of the gradients, with the second derivative of π/2·(1 ∓ x/√(1 + x²)).
    #[test]
    fn the_hessians_of_a_wall_and_under_a_roof_are_those_of_the_closed_forms() {
        let wall = |o: Vec3, d: Vec3| {
            let t = -o.x / d.x;
            if t > 0.0 && t * d.z < 1.0 { (1.0, t) } else { (0.0, f32::INFINITY) }
        };
        let roof = |o: Vec3, d: Vec3| {
            let t = 1.0 / d.z;
            if o.x + t * d.x < 0.0 { (0.0, t) } else { (1.0, f32::INFINITY) }
        };
        for x in [0.3f32, 0.7, 1.5] {
            let o = Vec3::new(x, 0.0, 0.0);
            let wanted = 1.5 * PI * f64::from(x) / f64::from(1.0 + x * x).powf(2.5);
            for (found, wanted) in [(mean(o, wall), wanted), (mean(o, roof), -wanted)] {
                let Hessian { xx, xy, yy } = found;
                assert!((xx - wanted).abs() < 0.2 * wanted.abs(), "at {x}: {xx} instead of {wanted}");
                assert!(xy.abs() < 0.05 && yy.abs() < 0.1, "at {x}: {xy} and {yy} instead of 0");
            }
        }
    }

    /// Under a ceiling with a cosine-shaped radiance, the irradiance is a cosine too: ∫ cos u/(1 + u² + v²)² du dv =
    /// π K₁(1).
    #[test]
    fn the_hessian_under_a_smooth_ceiling_is_that_of_the_closed_form() {
        let ceiling = |o: Vec3, d: Vec3| {
            let t = 1.0 / d.z.max(1e-6);
            ((o.x + t * d.x).cos(), t)
        };
        let Hessian { xx, xy, yy } = mean(Vec3::ZERO, ceiling);
        let wanted = -PI * 0.601_907;
        assert!((xx - wanted).abs() < 0.1 * wanted.abs(), "{xx} instead of {wanted}");
        assert!(xy.abs() < 0.1 && yy.abs() < 0.1, "{xy} and {yy} instead of 0");
    }

    #[test]
    fn curvatures_are_sums_of_absolute_eigenvalues() {
        let of = |xx, xy, yy| Hessian { xx, xy, yy }.curvature();
        assert_eq!(of(3.0, 0.0, 1.0), 4.0);
        assert_eq!(of(-3.0, 0.0, 1.0), 4.0);
        assert_eq!(of(0.0, 2.0, 0.0), 4.0);
        assert_eq!(of(0.0, 0.0, 0.0), 0.0);
    }
}
