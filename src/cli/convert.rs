//! `buffon convert`: writes an image in another format.

use super::shared::DisplayArgs;
use crate::error::{Error, Result};
use crate::image::{self, Image, WriteOptions};
use clap::Args;
use std::path::{Path, PathBuf};

/// Write an image in another format.
///
/// The formats follow the extensions. An EXR keeps all layers and metadata, and a .npy all layers without their names;
/// .png, .jpg and .pfm have the picture alone, or the layer that --layer names.
#[derive(Clone, Debug, Args)]
pub struct ConvertArgs {
    /// The image
    pub input: PathBuf,
    /// The image to write
    pub output: PathBuf,
    /// The layer to write instead of the picture, such as albedo
    #[arg(long, value_name = "NAME")]
    pub layer: Option<String>,
    /// Exposure and tone curve.
    #[command(flatten)]
    pub display: DisplayArgs,
}

/// Converts an image.
///
/// # Errors
/// If the image cannot be read, has no such layer, or cannot be written.
pub fn run(args: &ConvertArgs) -> Result<u8> {
    image::check_output(&args.output)?;
    args.display.check([args.output.as_path()])?;
    let image = read_layer(&args.input, args.layer.as_deref())?;
    let DisplayArgs { exposure, tonemap } = args.display;
    let options = WriteOptions { exposure, tonemap, ..WriteOptions::default() };
    image::write(&args.output, &image, &options)?;
    Ok(0)
}

/// Reads an image, or one of its layers.
///
/// # Errors
/// If the image cannot be read or has no such layer.
pub(super) fn read_layer(path: &Path, layer: Option<&str>) -> Result<Image> {
    let image = image::read(path)?;
    let Some(layer) = layer else { return Ok(image) };
    image.layer(layer).ok_or_else(|| {
        let layers = image.layers();
        let what = if layers.is_empty() { "no layers".to_owned() } else { layers.join(", ") };
        Error::usage(format!("--layer {layer}: there are {what}")).in_file(path)
    })
}
