//! Form factors between the elements of a cube: in closed form, and by casting rays.
//!
//! The form factor F_ij is the share of the power that leaves the diffuse element i and arrives at the element j.

use crate::lab::random::Stream;
use rayon::prelude::*;
use std::f64::consts::TAU;

/// A square element of a face of the unit cube.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Element {
    /// The axis of the face's normal.
    pub axis: usize,
    /// The coordinate of the face along that axis, 0 or 1.
    pub side: f64,
    /// The range along each axis. Along the face's own axis, it is not used.
    pub ranges: [[f64; 2]; 3],
}

impl Element {
    /// Returns the centre.
    pub fn centre(&self) -> [f64; 3] {
        std::array::from_fn(|k| {
            if k == self.axis { self.side } else { 0.5 * (self.ranges[k][0] + self.ranges[k][1]) }
        })
    }

    /// Returns the other two axes.
    fn axes(&self) -> [usize; 2] {
        [(self.axis + 1) % 3, (self.axis + 2) % 3]
    }

    fn area(&self) -> f64 {
        self.axes().iter().map(|k| self.ranges[*k][1] - self.ranges[*k][0]).product()
    }
}

/// Returns the elements of a cube with `n` × `n` elements on each face, face by face.
pub fn elements(n: usize) -> Vec<Element> {
    let range = |i: usize| [i as f64 / n as f64, (i + 1) as f64 / n as f64];
    let face = |face: usize| {
        (0..n * n).map(move |i| {
            let (axis, side) = (face / 2, (face % 2) as f64);
            let mut element = Element { axis, side, ranges: [[0.0, 1.0]; 3] };
            let [u, v] = element.axes();
            (element.ranges[u], element.ranges[v]) = (range(i % n), range(i / n));
            element
        })
    };
    (0..6).flat_map(face).collect()
}

/// Returns the form factors of all pairs of elements in closed form, row by row.
pub fn closed_forms(elements: &[Element]) -> Vec<f64> {
    let row = |from: &Element| elements.iter().map(|to| closed_form(from, to)).collect::<Vec<f64>>();
    elements.par_iter().flat_map_iter(row).collect()
}

/// Returns the form factor of two elements in closed form. [Ehlert & Smith 1993, "View Factors for Perpendicular and
/// Parallel Rectangular Plates"]
fn closed_form(from: &Element, to: &Element) -> f64 {
    if from.axis == to.axis {
        if from.side == to.side {
            return 0.0;
        }
        let [u, v] = from.axes();
        return corners([from.ranges[u], from.ranges[v], to.ranges[v], to.ranges[u]], parallel) / from.area();
    }
    let [a, b] = [from.axis, to.axis];
    let shared = 3 - a - b;
    // Distances from the line in which the faces meet.
    let away = |range: [f64; 2], side: f64| {
        let [x, y] = range.map(|x| (x - side).abs());
        [x.min(y), x.max(y)]
    };
    let [x, xi] = [away(from.ranges[b], to.side), away(to.ranges[a], from.side)];
    corners([x, from.ranges[shared], to.ranges[shared], xi], perpendicular) / from.area()
}

/// Returns the sum of a function over all corners of two rectangles, with alternating signs.
fn corners([x, y, eta, xi]: [[f64; 2]; 4], g: impl Fn(f64, f64, f64, f64) -> f64) -> f64 {
    let mut sum = 0.0;
    for corner in 0..16usize {
        let [i, j, k, l] = [0, 1, 2, 3].map(|bit| corner >> bit & 1);
        let sign = if (i + j + k + l) % 2 == 0 { 1.0 } else { -1.0 };
        sum += sign * g(x[i], y[j], eta[k], xi[l]);
    }
    sum / TAU
}

/// For parallel rectangles at the distance 1.
fn parallel(x: f64, y: f64, eta: f64, xi: f64) -> f64 {
    let (dx, dy) = (x - xi, y - eta);
    let term = |along: f64, across: f64| {
        let root = across.hypot(1.0);
        along * root * (along / root).atan()
    };
    term(dy, dx) + term(dx, dy) - 0.5 * (dx * dx + dy * dy + 1.0).ln()
}

/// For perpendicular rectangles at the distances `x` and `xi` from the line in which their planes meet.
fn perpendicular(x: f64, y: f64, eta: f64, xi: f64) -> f64 {
    let (dy, square) = (y - eta, x * x + xi * xi);
    let angle = if square > 0.0 { dy * square.sqrt() * (dy / square.sqrt()).atan() } else { 0.0 };
    // ¼ (x² + ξ²)(1 − K²) ln((x² + ξ²)(1 + K²)) with K² = dy²/(x² + ξ²).
    let sum = square + dy * dy;
    let logarithm = if sum > 0.0 { 0.25 * (square - dy * dy) * sum.ln() } else { 0.0 };
    angle - logarithm
}

/// Returns the form factors of one element to all elements of a cube with `n` × `n` elements on each face, estimated by
/// `rays` cosine-distributed rays.
pub fn by_ray_casting(from: &Element, n: usize, rays: u32, stream: &mut Stream) -> Vec<f64> {
    let mut counts = vec![0.0; 6 * n * n];
    let [u, v] = from.axes();
    for _ in 0..rays {
        let mut origin = from.centre();
        for k in [u, v] {
            origin[k] = from.ranges[k][0] + (from.ranges[k][1] - from.ranges[k][0]) * stream.uniform();
        }
        let (radius, angle) = (stream.uniform(), TAU * stream.uniform());
        let mut direction = [0.0; 3];
        direction[u] = radius.sqrt() * angle.cos();
        direction[v] = radius.sqrt() * angle.sin();
        direction[from.axis] = (1.0 - radius).sqrt() * (1.0 - 2.0 * from.side);
        counts[hit(origin, direction, from, n)] += 1.0;
    }
    counts.iter().map(|count| count / f64::from(rays)).collect()
}

/// Returns the index of the element that a ray from inside the cube hits.
fn hit(origin: [f64; 3], direction: [f64; 3], from: &Element, n: usize) -> usize {
    let distance = |k: usize| {
        let side = if direction[k] > 0.0 { 1.0 } else { 0.0 };
        if direction[k] == 0.0 || (k == from.axis && side == from.side) {
            return f64::INFINITY;
        }
        (side - origin[k]) / direction[k]
    };
    let axis = (0..3).min_by(|a, b| distance(*a).total_cmp(&distance(*b))).unwrap_or(0);
    let t = distance(axis);
    let cell = |k: usize| ((origin[k] + t * direction[k]) * n as f64).clamp(0.0, n as f64 - 1.0) as usize;
    let face = 2 * axis + usize::from(direction[axis] > 0.0);
    face * n * n + cell((axis + 2) % 3) * n + cell((axis + 1) % 3)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::PI;

    /// The form factor of opposite faces of a cube. [Hottel 1931]
    fn of_opposite_faces() -> f64 {
        // 2/π · (ln √(4/3) + 2√2 atan(1/√2) − 2 atan 1)
        2.0 / PI * (0.5 * (4.0f64 / 3.0).ln() + 2.0 * 2f64.sqrt() * 0.5f64.sqrt().atan() - 0.5 * PI)
    }

    #[test]
    fn faces_of_a_cube_have_known_form_factors() {
        let faces = elements(1);
        let factors = closed_forms(&faces);
        for (i, from) in faces.iter().enumerate() {
            for (j, to) in faces.iter().enumerate() {
                let exact = match (from.axis == to.axis, i == j) {
                    (_, true) => 0.0,
                    (true, _) => of_opposite_faces(),
                    _ => (1.0 - of_opposite_faces()) / 4.0,
                };
                assert!((factors[6 * i + j] - exact).abs() < 1e-12, "{i} {j}: {}", factors[6 * i + j]);
            }
        }
        assert!((of_opposite_faces() - 0.199_824_9).abs() < 1e-7);
    }

    /// All power arrives somewhere, and power is exchanged symmetrically between equal elements.
    #[test]
    fn form_factors_are_complete_and_reciprocal() {
        let elements = elements(4);
        let (factors, count) = (closed_forms(&elements), elements.len());
        for i in 0..count {
            let sum: f64 = factors[i * count..(i + 1) * count].iter().sum();
            assert!((sum - 1.0).abs() < 1e-11, "{sum}");
            for j in 0..i {
                let [there, back] = [factors[i * count + j], factors[j * count + i]];
                assert!(there > -1e-12 && (there - back).abs() < 1e-11, "{there} {back}");
            }
        }
    }

    #[test]
    fn rays_find_the_closed_forms() {
        let (n, rays) = (2, 100_000);
        let elements = elements(n);
        for from in [0, 9, 23] {
            let found = by_ray_casting(&elements[from], n, rays, &mut Stream::new(1, 0, from as u32));
            for (to, found) in elements.iter().zip(found) {
                let exact = closed_form(&elements[from], to);
                let deviation = (exact * (1.0 - exact) / f64::from(rays)).sqrt();
                assert!((found - exact).abs() <= 5.0 * deviation + 1e-12, "{found}, expected {exact}");
            }
        }
    }
}
