//! From sums to an image with layers and metadata.

use super::job::Rendered;
use crate::color::Rgb;
use crate::film::{ComponentFormat, PixelFormat, Tile};
use crate::image::{Image, Metadata, SampleFormat};
use crate::integrator::settings::{Aov, Layer};
use crate::math::{DMat4, DVec3};
use crate::sensor::Camera;

impl PixelFormat {
    /// Names of the image's channels.
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

    /// The image's colour channels for a linear RGB value.
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

/// The image of a render: the film's channels, then the layers as `name.channel`.
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
    for tile in &rendered.tiles {
        for i in 0..tile.pixel_count() {
            let (x, y) = tile.position(i);
            let values = pixel_values(tile, i, format, rendered);
            image.pixel_mut((x - rect.x) as usize, (y - rect.y) as usize).copy_from_slice(&values);
        }
    }
    image
}

/// The nearest finite `f32`: squares of finite values may be beyond its range, and an image holds no infinity.
fn finite(value: f64) -> f32 {
    value.min(f64::from(f32::MAX)) as f32
}

fn pixel_values(tile: &Tile, i: usize, format: PixelFormat, rendered: &Rendered) -> Vec<f32> {
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

/// The camera's matrices for the image's metadata: `worldToCamera`, and `worldToNDC`.
///
/// The first takes world points to the sensor's coordinates (x left, y up, z along the view), the second
/// to x and y in [0, 1] from the image's top left to its bottom right corner.
pub fn camera_matrices(camera: &Camera) -> [[f32; 16]; 2] {
    let world_to_camera = DMat4::from(camera.world_to_camera());
    let [right, down, corner] = camera.image_plane();
    // A camera-space direction is a multiple of corner + x·right + y·down: solve for (x, y, 1)·z.
    let plane = crate::math::DMat3::from_cols(right, down, corner).inverse();
    let project = DMat4::from_cols(
        plane.x_axis.truncate().extend(0.0).extend(plane.x_axis.z),
        plane.y_axis.truncate().extend(0.0).extend(plane.y_axis.z),
        plane.z_axis.truncate().extend(0.0).extend(plane.z_axis.z),
        DVec3::Z.extend(0.0),
    );
    [world_to_camera.as_mat4().to_cols_array(), (project * world_to_camera).as_mat4().to_cols_array()]
}
