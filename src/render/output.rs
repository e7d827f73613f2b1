//! The conversion of sums to an image with layers and metadata.

use super::job::Rendered;
use crate::color::Rgb;
use crate::compare::{GROUP_NOISE, MEAN_VARIANCE, NOISE, REPLICATES, SHARED_NOISE, ZTest};
use crate::film::tile::variance_of_mean;
use crate::film::{ComponentFormat, PixelFormat, Tile};
use crate::image::{Image, Metadata, SampleFormat, Value};
use crate::integrator::settings::{Aov, Layer};
use crate::math::{DMat4, DVec3};
use crate::sensor::Camera;

impl PixelFormat {
    /// Returns the names of the image's channels.
    fn channels(self) -> &'static [&'static str] {
        match self {
            PixelFormat::Luminance => &["Y"],
            PixelFormat::LuminanceAlpha => &["Y", "A"],
            PixelFormat::Rgb => &["R", "G", "B"],
            PixelFormat::Rgba => &["R", "G", "B", "A"],
            PixelFormat::Xyz => &["X", "Y", "Z"],
            PixelFormat::Xyza => &["X", "Y", "Z", "A"],
        }
    }

    /// Converts a linear RGB value to the image's colour channels.
    fn convert(self, c: Rgb) -> Vec<f32> {
        match self {
            PixelFormat::Luminance | PixelFormat::LuminanceAlpha => vec![c.luminance()],
            PixelFormat::Rgb | PixelFormat::Rgba => c.to_array().to_vec(),
            PixelFormat::Xyz | PixelFormat::Xyza => vec![
                0.412_453 * c.r + 0.357_58 * c.g + 0.180_423 * c.b,
                0.212_671 * c.r + 0.715_16 * c.g + 0.072_169 * c.b,
                0.019_334 * c.r + 0.119_193 * c.g + 0.950_227 * c.b,
            ],
        }
    }
}

impl From<ComponentFormat> for SampleFormat {
    fn from(format: ComponentFormat) -> Self {
        match format {
            ComponentFormat::Half => SampleFormat::Half,
            ComponentFormat::Float => SampleFormat::Float,
        }
    }
}

/// Returns the image of a render: the film's channels, then the layers as `name.channel`.
pub fn to_image(rendered: &Rendered, format: PixelFormat, metadata: Metadata) -> Image {
    let layers = &rendered.layers;
    let mut names: Vec<String> = format.channels().iter().map(|c| (*c).to_string()).collect();
    for Layer { name, aov } in layers {
        names.extend(aov.channels().iter().map(|c| format!("{name}.{c}")));
    }
    let names: Vec<&str> = names.iter().map(String::as_str).collect();
    let rect = rendered.rect;
    let mut image = Image::new(rect.width as usize, rect.height as usize, &names);
    image.metadata = metadata;
    let wants_blocks = layers.iter().any(|layer| layer.aov == Aov::BlockVariance);
    for tile in &rendered.tiles {
        let blocks = if wants_blocks { block_variances(tile) } else { Vec::new() };
        for i in 0..tile.pixel_count() {
            let (x, y) = tile.position(i);
            let values = pixel_values(tile, i, format, rendered, &blocks);
            image.pixel_mut((x - rect.x) as usize, (y - rect.y) as usize).copy_from_slice(&values);
        }
    }
    image
}

/// Returns the nearest finite `f32`: the square of a finite value may overflow, and an image has no infinite values.
fn finite(value: f64) -> f32 {
    value.min(f64::from(f32::MAX)) as f32
}

/// The side of the blocks of block variances, which is that of the z-test. Tiles contain whole blocks.
const BLOCK: usize = ZTest::SIDE;

/// Returns [`Aov::BlockVariance`] at each pixel of a tile.
fn block_variances(tile: &Tile) -> Vec<[f64; 3]> {
    let (width, height) = (tile.rect.width as usize, tile.rect.height as usize);
    let mut variances = vec![[0.0; 3]; width * height];
    for top in (0..height).step_by(BLOCK) {
        for left in (0..width).step_by(BLOCK) {
            let (columns, rows) = (left..(left + BLOCK).min(width), top..(top + BLOCK).min(height));
            let pixels = (columns.len() * rows.len()) as f64;
            let sums = tile.replicate_sums(columns.clone(), rows.clone());
            let of_block = variances_of(&sums).map(|variance| variance / pixels);
            rows.for_each(|y| variances[y * width..][columns.clone()].fill(of_block));
        }
    }
    variances
}

/// Returns the variance of the mean over replicates in each channel; 0 with fewer than two replicates.
fn variances_of(replicates: &[Option<[f64; 3]>]) -> [f64; 3] {
    [0, 1, 2].map(|c| variance_of_mean(replicates.iter().flatten().map(|sum| sum[c])).unwrap_or(0.0))
}

/// Returns for each replicate the sum of its means over all pixels.
fn sums_of_image(tiles: &[Tile]) -> Vec<Option<[f64; 3]>> {
    let sums = tiles
        .iter()
        .map(|tile| tile.replicate_sums(0..tile.rect.width as usize, 0..tile.rect.height as usize));
    let add = |a: [f64; 3], b: [f64; 3]| [0, 1, 2].map(|c| a[c] + b[c]);
    sums.reduce(|sum, other| sum.into_iter().zip(other).map(|(a, b)| Some(add(a?, b?))).collect())
        .unwrap_or_default()
}

/// Adds metadata about noise that pixels share: the number of replicates, and the variance of each channel's mean.
pub fn noise_metadata(rendered: &Rendered, metadata: &mut Metadata) {
    let shared = rendered.tiles.first().is_some_and(|tile| tile.replicates() > 2);
    let noise = match rendered.reuses_paths {
        true => GROUP_NOISE,
        false if shared => SHARED_NOISE,
        false => "independent",
    };
    metadata.set(NOISE, Value::Text(noise.into()));
    if !shared {
        return;
    }
    let sums = sums_of_image(&rendered.tiles);
    let filled = sums.iter().flatten().count();
    metadata.set(REPLICATES, Value::Int(i32::try_from(filled).unwrap_or(i32::MAX)));
    let pixels = rendered.rect.area() as f64;
    for (channel, variance) in ["R", "G", "B"].into_iter().zip(variances_of(&sums)) {
        let name = format!("{MEAN_VARIANCE}{channel}");
        metadata.set(&name, Value::Float((variance / (pixels * pixels)) as f32));
    }
}

/// Returns an image (R, G and B) of each replicate that has samples in every pixel.
pub fn replicate_images(rendered: &Rendered) -> Vec<Image> {
    let replicates = rendered.tiles.first().map_or(0, Tile::replicates);
    (0..replicates).filter_map(|r| replicate_image(rendered, r)).collect()
}

fn replicate_image(rendered: &Rendered, r: usize) -> Option<Image> {
    let rect = rendered.rect;
    let mut image = Image::new(rect.width as usize, rect.height as usize, &["R", "G", "B"]);
    for tile in &rendered.tiles {
        for i in 0..tile.pixel_count() {
            let (x, y) = tile.position(i);
            let pixel = image.pixel_mut((x - rect.x) as usize, (y - rect.y) as usize);
            for (c, value) in pixel.iter_mut().enumerate() {
                *value = tile.replicate_mean(i, r, c)? as f32;
            }
        }
    }
    Some(image)
}

fn pixel_values(
    tile: &Tile,
    i: usize,
    format: PixelFormat,
    rendered: &Rendered,
    blocks: &[[f64; 3]],
) -> Vec<f32> {
    let mean = |c: usize| tile.estimate(i, c).mean as f32;
    let mut values = format.convert(Rgb::new(mean(0), mean(1), mean(2)));
    let mut channel = 3;
    if rendered.alpha {
        values.push(mean(channel));
        channel += 1;
    }
    for layer in &rendered.layers {
        match layer.aov {
            Aov::Variance => {
                values.extend((0..3).map(|c| finite(tile.estimate(i, c).variance.unwrap_or(0.0))));
            }
            Aov::StandardError => {
                values.extend((0..3).map(|c| finite(tile.estimate(i, c).variance.unwrap_or(0.0).sqrt())));
            }
            Aov::BlockVariance => values.extend(blocks[i].map(finite)),
            Aov::Samples => values.push(tile.count(i) as f32),
            sampled => {
                for _ in sampled.channels() {
                    values.push(mean(channel));
                    channel += 1;
                }
            }
        }
    }
    values
}

/// Returns the camera's matrices for the image's metadata: `worldToCamera` and `worldToNDC`.
///
/// The first transforms world space to camera space (x left, y up, z along the view). The second transforms world
/// space to x and y in [0, 1], from the image's top left to its bottom right corner; it is zero if there is no image
/// plane.
pub fn camera_matrices(camera: &Camera) -> [[f32; 16]; 2] {
    let world_to_camera = DMat4::from(camera.world_to_camera());
    let Some([right, down, corner]) = camera.image_plane() else {
        return [world_to_camera.as_mat4().to_cols_array(), [0.0; 16]];
    };
    // A direction in camera space is a multiple of corner + x·right + y·down; the inverse gives (x, y, 1)·z.
    let plane = crate::math::DMat3::from_cols(right, down, corner).inverse();
    let project = DMat4::from_cols(
        plane.x_axis.truncate().extend(0.0).extend(plane.x_axis.z),
        plane.y_axis.truncate().extend(0.0).extend(plane.y_axis.z),
        plane.z_axis.truncate().extend(0.0).extend(plane.z_axis.z),
        DVec3::Z.extend(0.0),
    );
    [world_to_camera.as_mat4().to_cols_array(), (project * world_to_camera).as_mat4().to_cols_array()]
}
