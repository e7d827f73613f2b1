//! Writes the textures and meshes of the scenes under `scenes/plugins`: `cargo run --example plugin_assets`.
//!
//! The files are tiny and in the repository. This program documents and reproduces their contents.

#[path = "support/volume.rs"]
mod volume;

use buffon::image::{Image, WriteOptions, write};
use flate2::{Compression, write::ZlibEncoder};
use image::{GrayImage, Luma, Rgb, RgbImage};
use std::f32::consts::{PI, TAU};
use std::io::Write;
use std::path::Path;
use volume::volume;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/plugins");
    let (textures, meshes) = (root.join("textures"), root.join("meshes"));
    std::fs::create_dir_all(&textures)?;
    std::fs::create_dir_all(&meshes)?;

    // Colours without any symmetry. Neither image is square.
    RgbImage::from_fn(6, 4, |x, y| Rgb([code(x, y, 1), code(x, y, 2), code(x, y, 3)]))
        .save(textures.join("colours.png"))?;
    let colour = |x, y, c: u32| 1.5 * f32::from(code(x, y, c + 4)) / 255.0;
    exr(&textures.join("colours.exr"), 5, 3, |x, y| [0, 1, 2].map(|c| colour(x, y, c)))?;
    // Numbers: an image of random greys, and an image with values from 0 to 1.
    GrayImage::from_fn(7, 5, |x, y| Luma([code(x, y, 8)])).save(textures.join("greys.png"))?;
    GrayImage::from_fn(8, 6, |x, y| Luma([if (x / 2 + y / 2) % 2 == 0 { 230 } else { 20 + 10 * x as u8 }]))
        .save(textures.join("holes.png"))?;
    // A height field of waves, and the normals of another height field.
    let wave = |x: u32, y: u32| {
        let (u, v) = (x as f32 / 16.0, y as f32 / 12.0);
        0.5 + 0.25 * (TAU * (2.0 * u + v)).sin() + 0.25 * (TAU * 2.0 * v).cos()
    };
    exr(&textures.join("heights.exr"), 16, 12, |x, y| [wave(x, y); 3])?;
    RgbImage::from_fn(16, 12, |x, y| {
        let (u, v) = (x as f32 / 16.0, y as f32 / 12.0);
        let slope = [0.5 * (TAU * 2.0 * u).cos(), 0.4 * (TAU * (u + 2.0 * v)).sin()];
        let length = (slope[0] * slope[0] + slope[1] * slope[1] + 1.0).sqrt();
        Rgb([-slope[0] / length, -slope[1] / length, 1.0 / length].map(|n| (127.5 * (n + 1.0)).round() as u8))
    })
    .save(textures.join("normals.png"))?;
    // A sky with one bright spot. The zenith is the top row.
    exr(&textures.join("sky.exr"), 16, 8, |x, y| {
        let sun = if (x, y) == (11, 2) { 40.0 } else { 0.0 };
        let (height, side) = (1.0 - y as f32 / 8.0, (TAU * x as f32 / 16.0).sin());
        [
            0.1 + 0.3 * height + sun,
            0.2 + 0.1 * side + 0.2 * height + 0.9 * sun,
            0.3 + 0.6 * height + 0.7 * sun,
        ]
    })?;

    // Smoke: an extinction with empty cells and a dense one, and a coarser grid of albedos.
    let density = |i: u32| match code(i, 3, 9) {
        dense if i == 77 => 0.1 * f32::from(dense),
        thin if thin < 90 => 0.0,
        other => 0.01 * f32::from(other - 90),
    };
    volume(&meshes.join("smoke.vol"), [8, 6, 5], 1, (0..240).map(density))?;
    volume(
        &meshes.join("albedo.vol"),
        [2, 3, 2],
        3,
        (0..36).map(|i| 0.3 + 0.7 * f32::from(code(i, 5, 10)) / 255.0),
    )?;

    // Distances from a ring around the axis z.
    let distance = |i: u32| {
        let [x, y, z] = [i % 16, i / 16 % 16, i / 256].map(|i| i as f32 / 15.0 - 0.5);
        ((x * x + y * y).sqrt() - 0.28).hypot(z) - 0.13
    };
    volume(&meshes.join("ring.vol"), [16, 16, 16], 1, (0..16 * 16 * 16).map(distance))?;

    measured(&meshes.join("paint.bsdf"), &[0.0], 0.3)?;
    measured(&meshes.join("brushed.bsdf"), &[-PI, -0.75 * PI, -0.5 * PI], 0.9)?;

    let ball = Ball::new(8, 12);
    std::fs::write(meshes.join("ball.obj"), ball.obj())?;
    std::fs::write(meshes.join("ball.ply"), ball.ply())?;
    std::fs::write(meshes.join("balls.serialized"), serialized(&[Ball::new(3, 4), ball])?)?;
    Ok(())
}

/// Returns a pseudo-random byte for a pixel and a channel.
fn code(x: u32, y: u32, channel: u32) -> u8 {
    let mut h = (x + 31 * y + 1009 * channel).wrapping_mul(0x9e37_79b9) ^ 0x5bd1_e995;
    h = (h ^ (h >> 15)).wrapping_mul(0x85eb_ca6b);
    h = (h ^ (h >> 13)).wrapping_mul(0xc2b2_ae35);
    20 + ((h >> 16) % 220) as u8
}

/// Writes an EXR of floats.
fn exr(
    path: &Path,
    width: u32,
    height: u32,
    value: impl Fn(u32, u32) -> [f32; 3],
) -> Result<(), buffon::error::Error> {
    let mut image = Image::new(width as usize, height as usize, &["R", "G", "B"]);
    for (x, y) in (0..height).flat_map(|y| (0..width).map(move |x| (x, y))) {
        image.pixel_mut(x as usize, y as usize).copy_from_slice(&value(x, y));
    }
    write(path, &image, &WriteOptions::default())?;
    Ok(())
}

/// Writes a measured material for viewers with the azimuths `phi`. `stretch` is how much its microfacets depend on the
/// azimuth.
fn measured(path: &Path, phi: &[f32], stretch: f32) -> std::io::Result<()> {
    const SIDE: usize = 8;
    const THETA: [f32; 4] = [0.0, 0.5, 1.0, 1.5];
    let slice = |value: &dyn Fn(f32, f32) -> f32| -> Vec<f32> {
        let at = |i: usize| i as f32 / (SIDE - 1) as f32;
        (0..SIDE * SIDE).map(|i| value(at(i % SIDE), at(i / SIDE))).collect()
    };
    let viewers: Vec<(f32, f32)> = phi.iter().flat_map(|p| THETA.map(|t| (*p, t))).collect();
    // The normals for a viewer turn with it if the material is isotropic.
    let turn = |v: f32| if phi.len() > 1 { 2.0 * TAU * v } else { 0.0 };
    let ndf = |u: f32, v: f32| 2.5 * (-4.0 * u * u * (1.0 + stretch * turn(v).cos())).exp() + 0.05;
    let of_all = |value: &dyn Fn(f32, f32, f32) -> f32| -> Vec<f32> {
        viewers.iter().flat_map(|(_, t)| slice(&|u, v| value(*t, u, v))).collect()
    };
    let vndf = of_all(&|t, u, v| ndf(u, v) * u.powi(3) * (1.0 + 0.5 * t * (TAU * v).cos()) + 1e-4);
    let channel = |c: f32| move |t: f32, u: f32| 0.2 + 0.15 * (2.0 * u + c).cos() + 0.2 * (t / 1.5).powi(5);
    let luminance = of_all(&|t, u, _| channel(0.7)(t, u));
    let channels =
        viewers.iter().flat_map(|(_, t)| [0.0, 0.7, 1.4].map(|c| slice(&|u, _| channel(c)(*t, u)))).flatten();
    let of_viewers = |more: &[usize]| [&[phi.len(), THETA.len()], more].concat();
    let floats = |values: Vec<f32>| values.into_iter().flat_map(f32::to_le_bytes).collect::<Vec<u8>>();
    let description = b"made by examples/plugin_assets.rs".to_vec();
    let fields: [(&str, u8, Vec<usize>, Vec<u8>); 9] = [
        ("description", 1, vec![description.len()], description),
        ("phi_i", 10, vec![phi.len()], floats(phi.to_vec())),
        ("theta_i", 10, vec![THETA.len()], floats(THETA.to_vec())),
        ("ndf", 10, vec![SIDE, SIDE], floats(slice(&ndf))),
        ("sigma", 10, vec![SIDE, SIDE], floats(slice(&|u, _| 1.0 - 0.7 * u * u))),
        ("vndf", 10, of_viewers(&[SIDE, SIDE]), floats(vndf)),
        ("luminance", 10, of_viewers(&[SIDE, SIDE]), floats(luminance)),
        ("rgb", 10, of_viewers(&[3, SIDE, SIDE]), floats(channels.collect())),
        ("jacobian", 1, vec![1], vec![1]),
    ];
    let mut bytes = b"tensor_file\0\x01\x00".to_vec();
    bytes.extend((fields.len() as u32).to_le_bytes());
    let mut offset = bytes.len() + fields.iter().map(|f| 13 + f.0.len() + 8 * f.2.len()).sum::<usize>();
    for (name, kind, shape, data) in &fields {
        bytes.extend((name.len() as u16).to_le_bytes());
        bytes.extend(name.as_bytes());
        bytes.extend((shape.len() as u16).to_le_bytes());
        bytes.push(*kind);
        bytes.extend((offset as u64).to_le_bytes());
        shape.iter().for_each(|n| bytes.extend((*n as u64).to_le_bytes()));
        offset += data.len();
    }
    fields.iter().for_each(|f| bytes.extend(&f.3));
    std::fs::write(path, bytes)
}

/// A dented sphere of quadrilaterals with normals, texture coordinates and colours.
struct Ball {
    positions: Vec<[f32; 3]>,
    normals: Vec<[f32; 3]>,
    uvs: Vec<[f32; 2]>,
    quads: Vec<[u32; 4]>,
}

impl Ball {
    fn new(rings: u32, sectors: u32) -> Self {
        let (mut positions, mut normals, mut uvs) = (Vec::new(), Vec::new(), Vec::new());
        for (i, k) in (0..=rings).flat_map(|i| (0..=sectors).map(move |k| (i, k))) {
            let (v, u) = (i as f32 / rings as f32, k as f32 / sectors as f32);
            // There are small holes at the poles.
            let theta = PI * (0.04 + 0.92 * v);
            let (sin, cos) = theta.sin_cos();
            let n = [sin * (TAU * u).cos(), cos, -sin * (TAU * u).sin()];
            let radius = 0.8 - 0.15 * (2.0 * TAU * u).sin() * sin;
            positions.push(n.map(|x| radius * x));
            normals.push(n);
            uvs.push([u, 1.0 - v]);
        }
        let at = |i: u32, k: u32| i * (sectors + 1) + k;
        let quads = (0..rings)
            .flat_map(|i| (0..sectors).map(move |k| (i, k)))
            .map(|(i, k)| [at(i, k), at(i + 1, k), at(i + 1, k + 1), at(i, k + 1)])
            .collect();
        Ball { positions, normals, uvs, quads }
    }

    fn obj(&self) -> String {
        let mut text = String::from("# A dented ball; written by examples/plugin_assets.rs\n");
        for [x, y, z] in &self.positions {
            text += &format!("v {x:.5} {y:.5} {z:.5}\n");
        }
        for [u, v] in &self.uvs {
            text += &format!("vt {u:.5} {v:.5}\n");
        }
        for [x, y, z] in &self.normals {
            text += &format!("vn {x:.5} {y:.5} {z:.5}\n");
        }
        for quad in &self.quads {
            let [a, b, c, d] = quad.map(|i| i + 1);
            text += &format!("f {a}/{a}/{a} {b}/{b}/{b} {c}/{c}/{c} {d}/{d}/{d}\n");
        }
        text
    }

    /// Returns the surface as triangles, because some PLY readers do not support quadrilaterals.
    fn triangles(&self) -> impl Iterator<Item = [u32; 3]> {
        self.quads.iter().flat_map(|[a, b, c, d]| [[*a, *b, *c], [*a, *c, *d]])
    }

    fn ply(&self) -> String {
        let mut text = format!(
            "ply\nformat ascii 1.0\ncomment A dented ball; written by examples/plugin_assets.rs\nelement vertex {}\n",
            self.positions.len()
        );
        for name in ["x", "y", "z", "nx", "ny", "nz", "u", "v", "r", "g", "b", "wear_x"] {
            text += &format!("property float {name}\n");
        }
        text += &format!("element face {}\nproperty list uchar int vertex_indices\n", 2 * self.quads.len());
        for name in ["r", "g", "b"] {
            text += &format!("property float {name}\n");
        }
        text += "end_header\n";
        for (i, (([x, y, z], [a, b, c]), [u, v])) in
            self.positions.iter().zip(&self.normals).zip(&self.uvs).enumerate()
        {
            let [red, green, blue] = [1, 2, 3].map(|c| f32::from(code(i as u32, 0, c)) / 255.0);
            let wear = 0.1 + 0.4 * (0.5 + 0.5 * (TAU * 3.0 * u).sin()) * v;
            text += &format!("{x:.5} {y:.5} {z:.5} {a:.5} {b:.5} {c:.5} {u:.5} {v:.5} ");
            text += &format!("{red:.4} {green:.4} {blue:.4} {wear:.4}\n");
        }
        for (i, [a, b, c]) in self.triangles().enumerate() {
            let [red, green, blue] = [4, 5, 6].map(|c| f32::from(code(i as u32, 1, c)) / 255.0);
            text += &format!("3 {a} {b} {c} {red:.4} {green:.4} {blue:.4}\n");
        }
        text
    }
}

/// Returns meshes in Mitsuba's binary format, version 4, single precision, with normals and texture coordinates.
fn serialized(balls: &[Ball]) -> std::io::Result<Vec<u8>> {
    let (mut bytes, mut starts) = (Vec::new(), Vec::new());
    for ball in balls {
        starts.push(bytes.len() as u64);
        bytes.extend(0x041cu16.to_le_bytes());
        bytes.extend(4u16.to_le_bytes());
        let mut data = ZlibEncoder::new(&mut bytes, Compression::best());
        data.write_all(&(0x1u32 | 0x2 | 0x1000).to_le_bytes())?;
        data.write_all(b"ball\0")?;
        data.write_all(&(ball.positions.len() as u64).to_le_bytes())?;
        data.write_all(&(ball.triangles().count() as u64).to_le_bytes())?;
        let numbers = ball.positions.iter().chain(&ball.normals).flatten().chain(ball.uvs.iter().flatten());
        for number in numbers {
            data.write_all(&number.to_le_bytes())?;
        }
        for corner in ball.triangles().flatten() {
            data.write_all(&corner.to_le_bytes())?;
        }
        data.finish()?;
    }
    for start in &starts {
        bytes.extend(start.to_le_bytes());
    }
    bytes.extend((starts.len() as u32).to_le_bytes());
    Ok(bytes)
}
