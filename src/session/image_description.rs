//! The description of a render's image: everything needed to create it from the sums, without the scene.

use super::Session;
use crate::film::{ComponentFormat, PixelFormat, PixelRect};
use crate::image::{Image, Metadata, Value};
use crate::integrator::settings::Layer;
use crate::render::{Rendered, output};

/// The film and metadata of a render.
#[derive(Clone, Debug, PartialEq)]
pub struct ImageDescription {
    /// The region of the full image.
    pub rect: PixelRect,
    /// The channels.
    pub pixel_format: PixelFormat,
    /// The sample type of an EXR file.
    pub component_format: ComponentFormat,
    /// The layers in addition to the channels.
    pub layers: Vec<Layer>,
    /// `worldToCamera` and `worldToNDC`, in OpenEXR's convention.
    pub camera: [[f32; 16]; 2],
    /// The integrator's name.
    pub integrator: String,
    /// The mean squared relative bias of the integrator, if it is known.
    pub squared_bias: Option<f64>,
    /// The seed.
    pub seed: u64,
}

/// The names of the camera's matrices.
const MATRICES: [&str; 2] = ["worldToCamera", "worldToNDC"];

impl Session {
    /// Returns the description of a plan's image.
    pub fn image_description(&self, plan: &super::Plan) -> ImageDescription {
        let film = &self.camera().film;
        ImageDescription {
            rect: film.rect(),
            pixel_format: film.pixel_format,
            component_format: film.component_format,
            layers: plan.job.layers.clone(),
            camera: output::camera_matrices(self.camera()),
            integrator: plan.integrator.name().into(),
            squared_bias: plan.job.squared_bias,
            seed: plan.job.seed,
        }
    }
}

impl ImageDescription {
    /// Returns the number of values that are summed for each pixel.
    pub fn channels(&self) -> usize {
        let sampled = self.layers.iter().filter(|layer| layer.aov.is_sampled());
        let layers: usize = sampled.map(|layer| layer.aov.channels().len()).sum();
        3 + usize::from(self.pixel_format.has_alpha()) + layers
    }

    /// Returns the image of a render, with layers and metadata.
    pub fn image(&self, rendered: &Rendered) -> Image {
        let samples = i32::try_from(rendered.samples_per_pixel).unwrap_or(i32::MAX);
        let mut metadata = Metadata::new()
            .with("Software", Value::Text(format!("Buffon {}", env!("CARGO_PKG_VERSION"))))
            .with("samplesPerPixel", Value::Int(samples))
            .with("renderTimeSeconds", Value::Float((rendered.prepared + rendered.elapsed).as_secs_f32()))
            .with("buffon:seed", Value::Text(self.seed.to_string()))
            .with("buffon:integrator", Value::Text(self.integrator.clone()))
            .with("buffon:stop", Value::Text(rendered.stop_reason.to_string()));
        if let Some(relmse) = rendered.relmse {
            metadata.set("buffon:relmse", Value::Float(relmse as f32));
        }
        if let Some([low, high]) = rendered.relmse_interval {
            metadata.set("buffon:relmse_low", Value::Float(low as f32));
            metadata.set("buffon:relmse_high", Value::Float(high as f32));
        }
        if let Some(squared_bias) = self.squared_bias {
            metadata.set("buffon:bias", Value::Float(squared_bias.sqrt() as f32));
        }
        output::noise_metadata(rendered, &mut metadata);
        for (name, matrix) in MATRICES.into_iter().zip(self.camera).filter(|(_, m)| *m != [0.0; 16]) {
            metadata.set(name, Value::Matrix(matrix));
        }
        output::to_image(rendered, self.pixel_format, metadata)
    }
}
