//! Differences between two images.

use crate::estimate::metrics;
use crate::image::{Backend, Difference, Image};
use std::fmt;

/// The layer with the variance of the base layer's values.
pub(super) const VARIANCE: &str = "variance";
/// The layer with the variance of sums over blocks, for pixels that share noise.
pub(super) const BLOCK_VARIANCE: &str = "block_variance";

/// Returns whether a channel describes the uncertainty of the base layer.
pub fn is_of_noise(channel: &str) -> bool {
    [VARIANCE, BLOCK_VARIANCE].contains(&layer_of(channel))
}

/// The position of a value in an image.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Location {
    /// Column, from the left.
    pub x: usize,
    /// Row, from the top.
    pub y: usize,
    /// The channel's name.
    pub channel: String,
}

impl fmt::Display for Location {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "pixel ({}, {}), channel {}", self.x, self.y, self.channel)
    }
}

/// The NaN and infinite values of an image.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Invalid {
    /// The number of NaN values.
    pub nan: u64,
    /// The number of infinite values.
    pub inf: u64,
    /// The first of them, by rows from the top.
    pub first: Option<Location>,
}

impl Invalid {
    /// Returns whether there are any.
    pub fn any(&self) -> bool {
        self.nan + self.inf > 0
    }
}

impl fmt::Display for Invalid {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} NaN and {} infinite values", self.nan, self.inf)?;
        self.first.as_ref().map_or(Ok(()), |first| write!(f, ", the first at {first}"))
    }
}

/// Counts the NaN and infinite values of all channels and locates the first.
pub fn invalid(image: &Image) -> Invalid {
    let first = image.data.iter().position(|v| !v.is_finite()).map(|index| location(image, index));
    let nan = image.data.iter().filter(|v| v.is_nan()).count() as u64;
    let inf = image.data.iter().filter(|v| v.is_infinite()).count() as u64;
    Invalid { nan, inf, first }
}

/// Returns the position of the value with an index.
pub(super) fn location(image: &Image, index: usize) -> Location {
    let (pixel, channel) = (index / image.channels.len(), index % image.channels.len());
    Location { x: pixel % image.width, y: pixel / image.width, channel: image.channels[channel].clone() }
}

/// The reason why two images cannot be compared.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum NotComparable {
    /// The sizes differ: width and height of each.
    Size([usize; 2], [usize; 2]),
    /// The channels of the base layers differ, or no channel is common: the channels of each.
    Channels(Vec<String>, Vec<String>),
    /// A z-test needs variances: the channels that both images lack.
    NoVariance(Vec<String>),
    /// The pixels of an image share noise, but the image has no variance of blocks.
    NoBlockVariance,
    /// An image has NaN or infinite values.
    Invalid,
    /// A variance is negative or not finite.
    BadVariance(Location),
    /// An error of the image library.
    Library(String),
}

impl fmt::Display for NotComparable {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            NotComparable::Size([w, h], [v, g]) => write!(f, "the sizes differ: {w}x{h} and {v}x{g}"),
            NotComparable::Channels(a, b) => {
                write!(f, "the channels differ: {} and {}", a.join(", "), b.join(", "))
            }
            NotComparable::NoVariance(names) => {
                write!(f, "a z-test needs variances: expected the channels {} in at least one image, found none (render with --aov variance)", names.join(", "))
            }
            NotComparable::NoBlockVariance => f.write_str(
                "the pixels of an image share noise: expected the layer block_variance, found none (render with --aov variance)",
            ),
            NotComparable::Invalid => f.write_str("an image has NaN or infinite values"),
            NotComparable::BadVariance(at) => {
                write!(f, "expected variances of at least 0, found a negative or invalid one at {at}")
            }
            NotComparable::Library(why) => write!(f, "the comparison failed ({why})"),
        }
    }
}

impl std::error::Error for NotComparable {}

/// The differences within one layer of an image and its reference, which is the second image. All values are NaN or
/// meaningless if an image has NaN or infinite values.
#[derive(Clone, Debug, PartialEq)]
pub struct LayerComparison {
    /// The layer's name; empty for the base layer.
    pub layer: String,
    /// The channels compared.
    pub channels: Vec<String>,
    /// Mean absolute difference.
    pub mean_absolute: f64,
    /// Mean squared error.
    pub mse: f64,
    /// The square root of `mse`.
    pub rmse: f64,
    /// Peak signal-to-noise ratio in dB; the peak is the largest value, at least 1.
    pub psnr: f64,
    /// Mean of (x − r)² / (r² + 0.01).
    pub relmse: f64,
    /// `relmse` without the 0.1 % of pixels with the largest errors.
    pub trimmed_relmse: f64,
    /// The largest absolute difference.
    pub max: f64,
    /// The position of the first such value.
    pub max_at: Location,
    /// The image's mean divided by the reference's mean.
    pub mean_ratio: f64,
    /// The mean [FLIP](super::flip()) error, if it was computed, which [`compare`] does not.
    pub flip: Option<f64>,
}

/// The differences of two images.
#[derive(Clone, Debug, PartialEq)]
pub struct Comparison {
    /// NaN and infinite values of the first image.
    pub invalid_a: Invalid,
    /// NaN and infinite values of the second image.
    pub invalid_b: Invalid,
    /// The layers that both images have, the base layer first, without `variance`.
    pub layers: Vec<LayerComparison>,
    /// Channels of only one image, which were not compared.
    pub ignored: Vec<String>,
}

impl Comparison {
    /// Returns whether an image has NaN or infinite values. Such a pair never passes.
    pub fn has_invalid(&self) -> bool {
        self.invalid_a.any() || self.invalid_b.any()
    }
}

/// Returns the layer in which a channel is compared: its prefix, or the base layer for R, G, B and Y. Any other
/// channel is its own layer, so that alpha and depth do not change the base layer's error.
fn layer_of(channel: &str) -> &str {
    match channel.rsplit_once('.') {
        Some((layer, _)) => layer,
        None if matches!(channel, "R" | "G" | "B" | "Y") => "",
        None => channel,
    }
}

/// Returns the channels of a layer, in the image's order.
pub(super) fn layer_channels<'a>(image: &'a Image, layer: &str) -> Vec<&'a str> {
    image.channels.iter().map(String::as_str).filter(|c| layer_of(c) == layer).collect()
}

/// Returns the layers of both images, the base layer first if there is one, and the channels of only one image.
fn common_layers(a: &Image, b: &Image) -> Result<(Vec<String>, Vec<String>), NotComparable> {
    let differ = || NotComparable::Channels(a.channels.clone(), b.channels.clone());
    let (mut layers, mut ignored) = (Vec::<String>::new(), Vec::new());
    for (image, other) in [(a, b), (b, a)] {
        for channel in image.channels.iter().filter(|c| !is_of_noise(c)) {
            let layer = layer_of(channel);
            if other.channel(channel).is_some() {
                if !layers.iter().any(|l| l == layer) {
                    layers.push(layer.to_owned());
                }
            } else if layer.is_empty() {
                return Err(differ());
            } else {
                ignored.push(channel.clone());
            }
        }
    }
    layers.sort_by_key(|layer| !layer.is_empty());
    if layers.is_empty() { Err(differ()) } else { Ok((layers, ignored)) }
}

/// Compares an image with a reference, layer by layer. The image library computes the absolute differences,
/// [`metrics`] the relative errors.
///
/// # Errors
/// If the sizes differ, the channels of the base layers differ, or no channel is common.
pub fn compare(a: &Image, b: &Image) -> Result<Comparison, NotComparable> {
    if (a.width, a.height) != (b.width, b.height) {
        return Err(NotComparable::Size([a.width, a.height], [b.width, b.height]));
    }
    let (layers, ignored) = common_layers(a, b)?;
    let layers = layers.iter().map(|layer| compare_layer(a, b, layer)).collect::<Result<_, _>>()?;
    Ok(Comparison { invalid_a: invalid(a), invalid_b: invalid(b), layers, ignored })
}

/// Computes the differences of two images of the same shape, as OpenImageIO does.
fn own_difference(a: &Image, b: &Image) -> Difference {
    let (x, r) = (&a.data, &b.data);
    let (channels, mse) = (a.channels.len(), metrics::mse(x, r));
    let largest = metrics::largest_difference(x, r);
    let pixel = largest.index / channels;
    Difference {
        mean_absolute: metrics::mean_absolute(x, r),
        rms: mse.sqrt(),
        psnr: metrics::psnr(mse, metrics::peak(x, r)),
        max: largest.value,
        x: pixel % a.width,
        y: pixel / a.width,
        channel: largest.index % channels,
    }
}

/// Compares one layer of two images of the same size.
fn compare_layer(a: &Image, b: &Image, layer: &str) -> Result<LayerComparison, NotComparable> {
    let channels: Vec<&str> =
        layer_channels(a, layer).into_iter().filter(|c| b.channel(c).is_some()).collect();
    let (Some(a), Some(b)) = (a.select(&channels), b.select(&channels)) else {
        return Err(NotComparable::Channels(a.channels.clone(), b.channels.clone()));
    };
    let difference = match Backend::default().difference(&a, &b) {
        Some(found) => found.map_err(NotComparable::Library)?,
        None => own_difference(&a, &b),
    };
    let (x, r) = (&a.data, &b.data);
    Ok(LayerComparison {
        layer: layer.to_owned(),
        mean_absolute: difference.mean_absolute,
        mse: metrics::mse(x, r),
        rmse: difference.rms,
        psnr: difference.psnr,
        relmse: metrics::relmse(x, r),
        trimmed_relmse: metrics::trimmed_relmse(x, r, channels.len()),
        max: difference.max,
        max_at: Location {
            x: difference.x,
            y: difference.y,
            channel: a.channels[difference.channel].clone(),
        },
        mean_ratio: metrics::mean_ratio(x, r),
        flip: None,
        channels: a.channels,
    })
}

/// The quantity of an error map.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ErrorKind {
    /// (x − r)² / (r² + 0.01).
    RelativeSquared,
    /// |x − r|.
    Absolute,
}

/// Returns the error of each pixel in the base layer (or else in the first common layer), averaged over its channels,
/// as an image with one channel `error`.
///
/// # Errors
/// As [`compare`].
pub fn error_map(a: &Image, b: &Image, kind: ErrorKind) -> Result<Image, NotComparable> {
    if (a.width, a.height) != (b.width, b.height) {
        return Err(NotComparable::Size([a.width, a.height], [b.width, b.height]));
    }
    let (layers, _) = common_layers(a, b)?;
    let names: Vec<&str> =
        layer_channels(a, &layers[0]).into_iter().filter(|c| b.channel(c).is_some()).collect();
    let (Some(a), Some(b)) = (a.select(&names), b.select(&names)) else {
        return Err(NotComparable::Channels(a.channels.clone(), b.channels.clone()));
    };
    let errors = match kind {
        ErrorKind::RelativeSquared => metrics::relative_by_pixel(&a.data, &b.data, names.len()),
        ErrorKind::Absolute => {
            let pixels = a.data.chunks_exact(names.len()).zip(b.data.chunks_exact(names.len()));
            pixels.map(|(x, r)| metrics::mean_absolute(x, r)).collect()
        }
    };
    let mut map = Image::new(a.width, a.height, &["error"]);
    map.data = errors.into_iter().map(|e| e as f32).collect();
    Ok(map)
}

#[cfg(all(test, feature = "oiio"))]
mod tests {
    use super::*;

    /// Two images with values of several magnitudes, without infinities.
    fn pair() -> (Image, Image) {
        let mut a = Image::new(130, 70, &["R", "G", "B"]);
        let mut b = a.clone();
        for (i, (x, r)) in a.data.iter_mut().zip(&mut b.data).enumerate() {
            *r = ((i * 7919) % 1009) as f32 / 250.0;
            *x = *r + (((i * 104_729) % 997) as f32 - 498.0) * 1e-4;
        }
        a.pixel_mut(77, 33)[2] -= 3.0;
        (a, b)
    }

    #[test]
    fn our_own_numbers_are_those_of_openimageio() {
        let (a, b) = pair();
        let ours = own_difference(&a, &b);
        let theirs = Backend::OpenImageIo.difference(&a, &b).unwrap().unwrap();
        // The library subtracts in single precision.
        let near = |x: f64, y: f64| (x - y).abs() <= 1e-6 * y.abs();
        assert!(near(ours.mean_absolute, theirs.mean_absolute), "{ours:?} {theirs:?}");
        assert!(near(ours.rms, theirs.rms), "{ours:?} {theirs:?}");
        assert!(near(ours.psnr, theirs.psnr), "{ours:?} {theirs:?}");
        assert!(near(ours.max, theirs.max), "{ours:?} {theirs:?}");
        assert_eq!((ours.x, ours.y, ours.channel), (77, 33, 2));
        assert_eq!((theirs.x, theirs.y, theirs.channel), (77, 33, 2));
        assert_eq!(Backend::OpenImageIo.difference(&a, &a), Some(Ok(own_difference(&a, &a))));
    }

    #[test]
    fn invalid_values_are_counted() {
        let (mut a, _) = pair();
        for (i, bad) in
            [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, -f32::NAN, f32::NAN].into_iter().enumerate()
        {
            a.data[100 + 1717 * i] = bad;
        }
        let first = Location { x: 33, y: 0, channel: "G".into() };
        assert_eq!(invalid(&a), Invalid { nan: 3, inf: 2, first: Some(first) });
    }
}
