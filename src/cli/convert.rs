//! `buffon convert`: writes an image in another format.

use super::shared::DisplayArgs;
use crate::error::{Error, Result};
use crate::image::{self, WriteOptions};
use clap::Args;
use std::path::PathBuf;

/// Write an image in another format.
///
/// The formats follow the extensions. An EXR keeps all layers and metadata; .png, .jpg and .pfm have the picture alone,
/// or the layer that --layer names.
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
    let mut image = image::read(&args.input)?;
    if let Some(layer) = &args.layer {
        image = image.layer(layer).ok_or_else(|| {
            let message = format!("--layer {layer}: there are {}", image.layers().join(", "));
            Error::usage(message).in_file(&args.input)
        })?;
    }
    let DisplayArgs { exposure, tonemap } = args.display;
    let options = WriteOptions { exposure, tonemap, ..WriteOptions::default() };
    image::write(&args.output, &image, &options)?;
    Ok(0)
}
