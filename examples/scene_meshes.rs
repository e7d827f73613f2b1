//! Writes the smooth meshes of `scenes/interior`, `scenes/caustics` and `scenes/speed`: `cargo run --release --example
//! scene_meshes`.
//!
//! Each mesh is a parametric surface, divided into a grid of triangles, with the normals of the surface at the
//! vertices. The files are in the repository. This program documents their contents and writes the same bytes.

use std::f64::consts::{PI, TAU};
use std::io::Write;
use std::path::Path;

fn main() -> std::io::Result<()> {
    let scenes = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes");
    write(&scenes.join("interior/vase.ply"), 48, 40, |u, v| revolve(u, vase_profile(v)))?;
    write(&scenes.join("caustics/ring.ply"), 192, 24, |u, v| revolve(u, ring_profile(v)))?;
    write(&scenes.join("speed/torus.ply"), 64, 32, |u, v| {
        let (sin, cos) = (TAU * v).sin_cos();
        revolve(u, [0.5 + 0.2 * cos, 0.2 * sin])
    })?;
    write(&scenes.join("caustics/water.ply"), 88, 88, |u, v| {
        let (x, z) = (2.2 * u - 1.1, 1.1 - 2.2 * v);
        [x, water_height(x, z), z]
    })
}

/// Returns radius and height of the profile of a vase of height 1 at the origin, from the centre of its foot to its
/// rim.
fn vase_profile(v: f64) -> [f64; 2] {
    if v < 0.1 {
        return [0.2 * v / 0.1, 0.0];
    }
    let y = (v - 0.1) / 0.9;
    let belly = 0.18 * (PI * y.powf(0.8)).sin().max(0.0).powf(1.3);
    [0.2 - 0.12 * y + belly + 0.1 * y.powi(6), y]
}

/// Returns the counter-clockwise cross-section of a ring of inner radius 0.5, which is flat inside and has round edges.
fn ring_profile(v: f64) -> [f64; 2] {
    let (sin, cos) = (TAU * v).sin_cos();
    let power = |x: f64| x.signum() * x.abs().powf(0.5);
    [0.54 + 0.04 * power(cos), 0.15 + 0.15 * power(sin)]
}

/// Returns the height of the water: the sum of five waves in different directions.
fn water_height(x: f64, z: f64) -> f64 {
    const WAVES: [[f64; 4]; 5] = [
        [0.02, 7.1, 3.3, 0.4],
        [0.017, -4.2, 8.9, 2.1],
        [0.012, 11.3, -5.2, 4.0],
        [0.009, 3.1, 14.2, 1.2],
        [0.006, -15.1, -6.4, 5.5],
    ];
    WAVES.iter().map(|[height, a, b, phase]| height * (a * x + b * z + phase).sin()).sum()
}

/// Rotates a point of a profile about the y axis.
fn revolve(u: f64, [radius, height]: [f64; 2]) -> [f64; 3] {
    let (sin, cos) = (TAU * u).sin_cos();
    [radius * cos, height, -radius * sin]
}

/// Writes the surface over the unit square as a binary PLY with normals. It has `columns` × `rows` cells with two
/// triangles each. The front is the side of ∂u × ∂v.
fn write(
    path: &Path,
    columns: u32,
    rows: u32,
    surface: impl Fn(f64, f64) -> [f64; 3],
) -> std::io::Result<()> {
    let mut out = Vec::new();
    write!(
        out,
        "ply\nformat binary_little_endian 1.0\ncomment written by examples/scene_meshes.rs\nelement vertex {}\n",
        (columns + 1) * (rows + 1)
    )?;
    for name in ["x", "y", "z", "nx", "ny", "nz"] {
        writeln!(out, "property float {name}")?;
    }
    writeln!(out, "element face {}\nproperty list uchar int vertex_indices\nend_header", 2 * columns * rows)?;
    for (j, i) in (0..=rows).flat_map(|j| (0..=columns).map(move |i| (j, i))) {
        let (u, v) = (f64::from(i) / f64::from(columns), f64::from(j) / f64::from(rows));
        for number in surface(u, v).into_iter().chain(normal(&surface, u, v)) {
            out.extend((number as f32).to_le_bytes());
        }
    }
    for (j, i) in (0..rows).flat_map(|j| (0..columns).map(move |i| (j, i))) {
        let (a, side) = (j * (columns + 1) + i, columns + 1);
        for triangle in [[a, a + 1, a + side + 1], [a, a + side + 1, a + side]] {
            out.push(3);
            out.extend(triangle.into_iter().flat_map(u32::to_le_bytes));
        }
    }
    std::fs::write(path, out)
}

/// Returns the unit normal along ∂u × ∂v, from differences within the unit square.
fn normal(surface: impl Fn(f64, f64) -> [f64; 3], u: f64, v: f64) -> [f64; 3] {
    const STEP: f64 = 1e-6;
    let inside = |x: f64| x.clamp(STEP, 1.0 - STEP);
    let (u, v) = (inside(u), inside(v));
    let slope = |a: [f64; 3], b: [f64; 3]| [b[0] - a[0], b[1] - a[1], b[2] - a[2]];
    let [a, b, c] = slope(surface(u - STEP, v), surface(u + STEP, v));
    let [d, e, f] = slope(surface(u, v - STEP), surface(u, v + STEP));
    let n = [b * f - c * e, c * d - a * f, a * e - b * d];
    let length = n.iter().map(|x| x * x).sum::<f64>().sqrt();
    n.map(|x| x / length)
}
