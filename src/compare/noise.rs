//! The noise that an image states: the variances of its pixels, or of its blocks if pixels share noise.

use super::images::{BLOCK_VARIANCE, NotComparable, VARIANCE};
use crate::image::{Image, Value};

/// The metadata key that states whether the pixels of an image share noise.
pub const NOISE: &str = "buffon:noise";
/// The value of [`NOISE`] if they do.
pub const SHARED_NOISE: &str = "shared by pixels";
/// The value of [`NOISE`] if pixels share noise with the few of their group.
pub const GROUP_NOISE: &str = "shared by groups of pixels";
/// The metadata key for the number of independent replicates from which the variances of an image with shared noise
/// were computed.
pub const REPLICATES: &str = "buffon:replicates";
/// The prefix of the metadata keys for the variance of a channel's mean in such an image.
pub const MEAN_VARIANCE: &str = "buffon:mean_variance.";

/// Returns the variance layer of the base layer's channels.
pub(super) fn variance_of(image: &Image, names: &[&str]) -> Option<Image> {
    image.select(&names.iter().map(|c| format!("{VARIANCE}.{c}")).collect::<Vec<_>>())
}

/// The noise of an image.
pub(super) struct ImageNoise {
    /// For each pixel and channel; their sum over a block is the variance of the block's sum.
    pub variances: Image,
    /// The shared noise, if pixels share noise.
    pub shared: Option<SharedNoise>,
}

/// Noise that pixels share.
pub(super) struct SharedNoise {
    /// The degrees of freedom of the variance of a block, and of the whole image.
    pub freedom: f64,
    /// The variance of the sum over all pixels, for each channel.
    pub of_sum: Vec<f64>,
}

impl ImageNoise {
    /// Creates the noise of independent pixels.
    pub fn by_pixels(variances: Image) -> Self {
        ImageNoise { variances, shared: None }
    }
}

/// Returns the noise stated by an image; `None` if there is no statement.
pub(super) fn noise_of(image: &Image, names: &[&str]) -> Result<Option<ImageNoise>, NotComparable> {
    let shares = matches!(image.metadata.get(NOISE), Some(Value::Text(noise)) if noise == SHARED_NOISE);
    let by_pixels = variance_of(image, names);
    if !shares || by_pixels.is_none() {
        return Ok(by_pixels.map(ImageNoise::by_pixels));
    }
    let missing = || NotComparable::NoBlockVariance;
    let layers: Vec<String> = names.iter().map(|c| format!("{BLOCK_VARIANCE}.{c}")).collect();
    let variances = image.select(&layers).ok_or_else(missing)?;
    let freedom = match image.metadata.get(REPLICATES) {
        Some(Value::Int(replicates)) if *replicates > 1 => f64::from(replicates - 1),
        _ => return Err(missing()),
    };
    let pixels = (image.width * image.height) as f64;
    let of_sum = names.iter().map(|c| match image.metadata.get(&format!("{MEAN_VARIANCE}{c}")) {
        Some(Value::Float(variance)) => Ok(f64::from(*variance) * pixels * pixels),
        _ => Err(missing()),
    });
    let of_sum = of_sum.collect::<Result<_, _>>()?;
    Ok(Some(ImageNoise { variances, shared: Some(SharedNoise { freedom, of_sum }) }))
}
