//! Writes what the scenes of `scenes/speed` need and what is too large to keep: `cargo run --release --example
//! speed_scenes`. That is the textures, the sky, the smoke, and the rooms of 400 and 10,000 lights.

mod support;
#[path = "support/volume.rs"]
mod volume;

use buffon::image::{Image, WriteOptions, write};
use image::{Rgb, RgbImage};
use std::f32::consts::{PI, TAU};
use std::fmt::Write as _;
use std::path::Path;
use support::{noise, random};
use volume::volume;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/speed");
    // Boards with a grain.
    RgbImage::from_fn(512, 512, |x, y| {
        let board = y / 64;
        let shade = 0.75 + 0.25 * random(board, 7, 1);
        let grain = noise(x as f32 / 90.0 + 13.0 * board as f32, y as f32 / 5.0, 2);
        let joint = if y % 64 < 2 { 0.4 } else { 1.0 };
        Rgb([0.62, 0.42, 0.26].map(|c| code(c * shade * joint * (0.7 + 0.5 * grain))))
    })
    .save(folder.join("wood.png"))?;
    // Stone: spots of three sizes.
    RgbImage::from_fn(512, 512, |x, y| {
        let at = |size: f32, seed| noise(x as f32 / size, y as f32 / size, seed);
        let spots = 0.5 * at(64.0, 3) + 0.3 * at(16.0, 4) + 0.2 * at(4.0, 5);
        Rgb([0.72, 0.66, 0.55].map(|c| code(c * (0.5 + 0.8 * spots))))
    })
    .save(folder.join("stone.png"))?;
    // A sky with clouds and a sun of 6 degrees behind haze. The zenith is the top row.
    let (width, height) = (1024, 512);
    let mut sky = Image::new(width, height, &["R", "G", "B"]);
    for (x, y) in (0..height).flat_map(|y| (0..width).map(move |x| (x, y))) {
        let (u, v) = (x as f32 / width as f32, y as f32 / height as f32);
        let (elevation, azimuth) = (PI * (0.5 - v), TAU * (u - 0.68));
        let cloud = (noise(u * 24.0, v * 30.0, 6) * 0.7 + noise(u * 96.0, v * 120.0, 8) * 0.3 - 0.5).max(0.0);
        let to_sun = (elevation.sin() * 0.6 + elevation.cos() * 0.8 * azimuth.cos()).clamp(-1.0, 1.0).acos();
        let sun = 180.0 * (-(to_sun / 0.05).powi(2)).exp() + 1.5 * (-to_sun / 0.3).exp();
        let up = elevation.sin();
        let clear = if up > 0.0 {
            [0.25 + 0.35 * (1.0 - up), 0.4 + 0.3 * (1.0 - up), 0.75 + 0.1 * (1.0 - up)]
        } else {
            [0.2, 0.18, 0.15]
        };
        let light = [1.0, 0.85, 0.65];
        for (channel, value) in sky.pixel_mut(x, y).iter_mut().enumerate() {
            *value = clear[channel] + if up > 0.0 { 1.5 * cloud } else { 0.0 } + sun * light[channel];
        }
    }
    write(&folder.join("sky.exr"), &sky, &WriteOptions::default())?;
    let side = SMOKE as u32;
    let cells = (0..side.pow(3)).map(|i| smoke([i % side, i / side % side, i / side.pow(2)]));
    volume(&folder.join("smoke.vol"), [SMOKE; 3], 1, cells)?;
    for lights in [400, 10_000] {
        std::fs::write(folder.join(format!("lights-{lights}.xml")), room_of_lights(lights))?;
    }
    Ok(())
}

/// The number of values of the smoke along each edge.
const SMOKE: i32 = 256;

/// Returns the density of the smoke, in [0, 1]: a column that winds, widens upwards and frays.
fn smoke(cell: [u32; 3]) -> f32 {
    let [x, y, z] = cell.map(|i| (i as f32 + 0.5) / SMOKE as f32);
    let turbulence = |frequency: f32, seed| solid_noise([x, y, z].map(|t| t * frequency), seed);
    let fray = 0.5 * turbulence(6.0, 20) + 0.3 * turbulence(17.0, 40) + 0.2 * turbulence(47.0, 90);
    let (axis_x, axis_z) = (0.5 + 0.12 * y * (5.0 * y).sin(), 0.5 + 0.12 * y * (4.0 * y).cos());
    let radius = (x - axis_x).hypot(z - axis_z) / (0.08 + 0.28 * y);
    let inside = 1.45 - radius - 1.1 * (1.0 - fray) * (0.4 + 0.6 * y);
    (3.0 * inside).clamp(0.0, 1.0) * (y * 20.0).min((1.0 - y) * 6.0).clamp(0.0, 1.0)
}

/// Returns smooth noise in [0, 1) of a point.
fn solid_noise([x, y, z]: [f32; 3], seed: u32) -> f32 {
    let (below, t) = (z.floor() as u32, z.fract());
    let t = t * t * t * (t * (t * 6.0 - 15.0) + 10.0);
    noise(x, y, seed + below) * (1.0 - t) + noise(x, y, seed + below + 1) * t
}

/// Returns the sRGB code of a reflectance, approximately.
fn code(reflectance: f32) -> u8 {
    (255.0 * reflectance.clamp(0.0, 1.0).powf(1.0 / 2.2)).round() as u8
}

/// Returns a scene: a box with some cubes, lit by small spheres of equal power at random positions.
fn room_of_lights(lights: u32) -> String {
    let mut text = String::from(
        r#"<!-- A room lit by many small spheres of equal power; written by examples/speed_scenes.rs. -->
<scene version="3.0.0">
    <default name="spp" value="64"/>
    <default name="width" value="400"/>
    <default name="height" value="300"/>
    <default name="max_depth" value="-1"/>
    <integrator type="path">
        <integer name="max_depth" value="$max_depth"/>
    </integrator>
    <sensor type="perspective">
        <float name="fov" value="60"/>
        <transform name="to_world">
            <lookat origin="0, 1.5, 4.8" target="0, 1.3, 0" up="0, 1, 0"/>
        </transform>
        <sampler type="independent">
            <integer name="sample_count" value="$spp"/>
        </sampler>
        <film type="hdrfilm">
            <integer name="width" value="$width"/>
            <integer name="height" value="$height"/>
            <string name="pixel_format" value="rgb"/>
            <rfilter type="box"/>
        </film>
    </sensor>
    <bsdf type="twosided" id="wall">
        <bsdf type="diffuse">
            <rgb name="reflectance" value="0.6, 0.55, 0.5"/>
        </bsdf>
    </bsdf>
    <bsdf type="twosided" id="metal">
        <bsdf type="roughconductor">
            <string name="material" value="Al"/>
            <float name="alpha" value="0.2"/>
        </bsdf>
    </bsdf>
    <shape type="cube">
        <transform name="to_world">
            <scale x="4" y="1.5" z="5"/>
            <translate y="1.5"/>
        </transform>
        <ref id="wall"/>
    </shape>
"#,
    );
    for i in 0..12 {
        let at = |k| random(i, k, 11);
        let (x, z, size) = (6.0 * at(0) - 3.0, 5.0 * at(1) - 4.0, 0.15 + 0.35 * at(2));
        let _ = write!(
            text,
            r#"    <shape type="cube">
        <transform name="to_world">
            <scale value="{size}"/>
            <rotate y="1" angle="{angle}"/>
            <translate x="{x}" y="{size}" z="{z}"/>
        </transform>
        <ref id="{material}"/>
    </shape>
"#,
            angle = 90.0 * at(3),
            material = if i % 3 == 0 { "metal" } else { "wall" }
        );
    }
    for i in 0..lights {
        let at = |k| random(i, k, 12);
        let [r, g, b] =
            [at(3), at(4), at(5)].map(|c| (0.3 + 0.7 * c) * 12.0 / (PI * lights as f32 * 0.015f32.powi(2)));
        let _ = write!(
            text,
            r#"    <shape type="sphere">
        <point name="center" x="{x}" y="{y}" z="{z}"/>
        <float name="radius" value="0.015"/>
        <emitter type="area">
            <rgb name="radiance" value="{r}, {g}, {b}"/>
        </emitter>
    </shape>
"#,
            x = 7.8 * at(0) - 3.9,
            y = 0.1 + 2.8 * at(1),
            z = 9.0 * at(2) - 4.9
        );
    }
    text + "</scene>\n"
}
