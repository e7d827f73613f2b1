//! References: images of mean and variance, stored beside the scenes.

use super::discover::REFERENCES;
use crate::error::{Error, Result};
use crate::image::{self, Image, Value, WriteOptions};
use std::path::{Path, PathBuf};

/// A stored reference.
#[derive(Clone, Debug)]
pub struct Reference {
    /// The image and its layers. Its variances are in the layer `variance`, if it has one.
    pub image: Image,
    /// The variances as an image from a second file.
    pub variance: Option<Image>,
}

/// Returns the path of a scene's reference: `refs/NAME.exr` beside the scene.
pub fn reference_path(scene: &Path) -> PathBuf {
    let mut name = scene.file_stem().unwrap_or_default().to_owned();
    name.push(".exr");
    scene.with_file_name(REFERENCES).join(name)
}

/// Returns the path of the variances of a reference without a layer of them: `refs/NAME_var.exr`.
pub fn variance_path(scene: &Path) -> PathBuf {
    let mut name = scene.file_stem().unwrap_or_default().to_owned();
    name.push("_var.exr");
    scene.with_file_name(REFERENCES).join(name)
}

impl Reference {
    /// Reads the reference of a scene; returns `None` if there is none.
    ///
    /// # Errors
    /// If a file exists but cannot be read.
    pub fn read(scene: &Path) -> Result<Option<Reference>> {
        let path = reference_path(scene);
        if !path.exists() {
            return Ok(None);
        }
        let image = image::read(&path)?;
        let variance = variance_path(scene);
        let separate = !has_variance(&image) && variance.exists();
        let variance = if separate { Some(image::read(&variance)?) } else { None };
        Ok(Some(Reference { image, variance }))
    }

    /// Returns whether its variances are known.
    pub fn has_variance(&self) -> bool {
        self.variance.is_some() || has_variance(&self.image)
    }

    /// Returns its samples per pixel, if they are in its metadata.
    pub fn samples_per_pixel(&self) -> Option<u64> {
        match self.image.metadata.get("samplesPerPixel") {
            Some(Value::Int(n)) => u64::try_from(*n).ok().filter(|n| *n > 0),
            _ => None,
        }
    }
}

/// Returns whether an image has a layer `variance`.
fn has_variance(image: &Image) -> bool {
    image.channels.iter().any(|c| c.starts_with("variance."))
}

/// Writes an image as the reference of a scene, in 32-bit floats, and returns its path. An older reference is replaced
/// only when the new one is complete.
///
/// # Errors
/// If it cannot be written.
pub fn write_reference(scene: &Path, image: &Image) -> Result<PathBuf> {
    let path = reference_path(scene);
    if let Some(folder) = path.parent() {
        std::fs::create_dir_all(folder)
            .map_err(|e| Error::output(format!("the folder cannot be made: {e}")).in_file(folder))?;
    }
    image::write(&path, image, &WriteOptions::default())?;
    Ok(path)
}
