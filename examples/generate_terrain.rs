//! Writes the mesh of `scenes/terrain`: a height field of value noise as a binary PLY with vertex normals and texture
//! coordinates.
//!
//! `cargo run --release --example generate_terrain -- FILE [CELLS]`; CELLS is the number of cells per side, with two
//! triangles each (default 724: 1,048,352 triangles). The same arguments give the same bytes.

mod support;

use buffon::sampling::hash::combine;
use std::io::{BufWriter, Write};
use std::process::ExitCode;
use support::noise;

/// Half the width of the terrain, in scene units.
const EXTENT: f32 = 3.0;
const OCTAVES: u32 = 9;

/// Returns the height of the terrain: octaves of noise. Each has half the size and a little less than half the height
/// of the previous one.
fn height(x: f32, z: f32) -> f32 {
    let mut sum = 0.0;
    for octave in 0..OCTAVES {
        let frequency = (1u32 << octave) as f32 * 0.8;
        sum += (noise(x * frequency, z * frequency, combine(17, octave)) - 0.5) * 0.45f32.powi(octave as i32);
    }
    sum
}

fn write(path: &str, cells: u32) -> std::io::Result<()> {
    let side = cells + 1;
    let mut out = BufWriter::new(std::fs::File::create(path)?);
    write!(
        out,
        "ply\nformat binary_little_endian 1.0\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\n\
         property float nx\nproperty float ny\nproperty float nz\nproperty float u\nproperty float v\n\
         element face {}\nproperty list uchar uint vertex_indices\n\
         end_header\n",
        side * side,
        2 * cells * cells
    )?;
    let step = 2.0 * EXTENT / cells as f32;
    for j in 0..side {
        for i in 0..side {
            let (x, z) = (i as f32 * step - EXTENT, j as f32 * step - EXTENT);
            let slope_x = (height(x + step, z) - height(x - step, z)) / (2.0 * step);
            let slope_z = (height(x, z + step) - height(x, z - step)) / (2.0 * step);
            let [u, v] = [x, z].map(|x| (x / EXTENT + 1.0) / 2.0);
            let length = (slope_x * slope_x + 1.0 + slope_z * slope_z).sqrt();
            for v in [x, height(x, z), z, -slope_x / length, 1.0 / length, -slope_z / length, u, v] {
                out.write_all(&v.to_le_bytes())?;
            }
        }
    }
    for j in 0..cells {
        for i in 0..cells {
            let corner = j * side + i;
            for triangle in
                [[corner, corner + side, corner + 1], [corner + 1, corner + side, corner + side + 1]]
            {
                out.write_all(&[3])?;
                for v in triangle {
                    out.write_all(&v.to_le_bytes())?;
                }
            }
        }
    }
    out.flush()
}

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let cells = arguments.get(1).map_or(Ok(724), |n| n.parse::<u32>());
    let (Some(path), Ok(cells @ 1..=16_000)) = (arguments.first(), cells) else {
        eprintln!("usage: generate_terrain FILE [CELLS], with 1 to 16000 cells per side");
        return ExitCode::from(2);
    };
    match write(path, cells) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("{path}: cannot be written: {error}");
            ExitCode::from(4)
        }
    }
}
