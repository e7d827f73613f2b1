//! What two images differ by.

use crate::estimate::metrics;
use crate::image::{Backend, Image};
use std::fmt;

/// The layer that holds the variance of the picture's values.
pub(super) const VARIANCE: &str = "variance";
/// The layer that holds the variance of sums over blocks, where pixels share noise.
pub(super) const BLOCK_VARIANCE: &str = "block_variance";

/// Whether a channel says how uncertain the picture is, and not what it shows.
pub fn is_of_noise(channel: &str) -> bool {
    [VARIANCE, BLOCK_VARIANCE].contains(&layer_of(channel))
}

/// Where a value is.
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

/// The values of an image that are no numbers.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Invalid {
    /// How many are NaN.
    pub nan: u64,
    /// How many are infinite.
    pub inf: u64,
    /// The first of them, by rows from the top.
    pub first: Option<Location>,
}

impl Invalid {
    /// Whether there is any.
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

/// Counts the NaN and infinite values of all channels and finds the first.
pub fn invalid(image: &Image) -> Invalid {
    let first = image.data.iter().position(|v| !v.is_finite()).map(|index| location(image, index));
    let nan = image.data.iter().filter(|v| v.is_nan()).count() as u64;
    let inf = image.data.iter().filter(|v| v.is_infinite()).count() as u64;
    Invalid { nan, inf, first }
}

/// Where the value with an index is.
pub(super) fn location(image: &Image, index: usize) -> Location {
    let (pixel, channel) = (index / image.channels.len(), index % image.channels.len());
    Location { x: pixel % image.width, y: pixel / image.width, channel: image.channels[channel].clone() }
}

/// Why two images cannot be compared.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum NotComparable {
    /// They differ in size: width and height of each.
    Size([usize; 2], [usize; 2]),
    /// They differ in the channels of the picture or have none in common: the channels of each.
    Channels(Vec<String>, Vec<String>),
    /// A z-test needs variances: the channels that are missing, in all of the images.
    NoVariance(Vec<String>),
    /// The pixels of an image share noise, and it does not say how much.
    NoBlockVariance,
    /// A variance is negative or no number.
    BadVariance(Location),
    /// The library failed.
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
                write!(f, "a z-test needs variances: no image has the channels {}", names.join(", "))
            }
            NotComparable::NoBlockVariance => f.write_str(
                "the pixels of an image share noise, and it has no layer block_variance to say how much: expected one \
                 that was rendered with --aov variance",
            ),
            NotComparable::BadVariance(at) => {
                write!(f, "a z-test needs variances of at least 0, found another at {at}")
            }
            NotComparable::Library(why) => write!(f, "the comparison failed ({why})"),
        }
    }
}

impl std::error::Error for NotComparable {}

/// The differences within one layer. The first image is judged, the second is the reference. All are NaN or
/// meaningless if an image holds values that are no numbers.
#[derive(Clone, Debug, PartialEq)]
pub struct LayerComparison {
    /// The layer's name; empty for the picture.
    pub layer: String,
    /// The channels compared.
    pub channels: Vec<String>,
    /// Mean absolute difference.
    pub mean_absolute: f64,
    /// Mean squared error.
    pub mse: f64,
    /// Its root.
    pub rmse: f64,
    /// Peak signal-to-noise ratio in dB, against the larger of 1 and the largest value.
    pub psnr: f64,
    /// Mean of (x − r)² / (r² + 0.01).
    pub relmse: f64,
    /// The same without the 0.1 % worst pixels.
    pub trimmed_relmse: f64,
    /// The largest absolute difference.
    pub max: f64,
    /// Where that is; the first such place.
    pub max_at: Location,
    /// Mean over the reference's mean.
    pub mean_ratio: f64,
}

/// The differences of two images.
#[derive(Clone, Debug, PartialEq)]
pub struct Comparison {
    /// What is no number in the first.
    pub invalid_a: Invalid,
    /// What is no number in the second.
    pub invalid_b: Invalid,
    /// The layers that both have, the picture first. `variance` is not among them.
    pub layers: Vec<LayerComparison>,
    /// Channels that only one image has, which were not compared.
    pub ignored: Vec<String>,
}

impl Comparison {
    /// Whether an image holds NaN or infinite values. Such a pair never passes.
    pub fn has_invalid(&self) -> bool {
        self.invalid_a.any() || self.invalid_b.any()
    }
}

/// The layer that a channel is compared in: its prefix; the picture for R, G, B and Y; else the channel is a
/// layer of its own, so that alpha and depth do not dilute the picture's error.
fn layer_of(channel: &str) -> &str {
    match channel.rsplit_once('.') {
        Some((layer, _)) => layer,
        None if matches!(channel, "R" | "G" | "B" | "Y") => "",
        None => channel,
    }
}

/// The channels of a layer, in the image's order.
pub(super) fn layer_channels<'a>(image: &'a Image, layer: &str) -> Vec<&'a str> {
    image.channels.iter().map(String::as_str).filter(|c| layer_of(c) == layer).collect()
}

/// The layers of both images, the picture first if there is one, and the channels that only one image has.
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

/// Compares an image with a reference, layer by layer. The differences come from the library in use; the
/// relative errors, which it does not know, from [`metrics`].
///
/// # Errors
/// If the sizes differ, or the channels of the picture do, or no channel is common.
pub fn compare(a: &Image, b: &Image) -> Result<Comparison, NotComparable> {
    if (a.width, a.height) != (b.width, b.height) {
        return Err(NotComparable::Size([a.width, a.height], [b.width, b.height]));
    }
    let (layers, ignored) = common_layers(a, b)?;
    let layers = layers.iter().map(|layer| compare_layer(a, b, layer)).collect::<Result<_, _>>()?;
    Ok(Comparison { invalid_a: invalid(a), invalid_b: invalid(b), layers, ignored })
}

/// Compares one layer of images of one size.
fn compare_layer(a: &Image, b: &Image, layer: &str) -> Result<LayerComparison, NotComparable> {
    let channels: Vec<&str> =
        layer_channels(a, layer).into_iter().filter(|c| b.channel(c).is_some()).collect();
    let (Some(a), Some(b)) = (a.select(&channels), b.select(&channels)) else {
        return Err(NotComparable::Channels(a.channels.clone(), b.channels.clone()));
    };
    let difference = Backend::default().difference(&a, &b).map_err(NotComparable::Library)?;
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
        channels: a.channels,
    })
}

/// What an error map shows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ErrorKind {
    /// (x − r)² / (r² + 0.01).
    RelativeSquared,
    /// |x − r|.
    Absolute,
}

/// The error of each pixel of the picture (or, without one, of the first common layer), the mean over its
/// channels, as an image of one channel `error`.
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

    /// Two images whose values wander over a few magnitudes, without infinities.
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
        let ours = Backend::RustCrates.difference(&a, &b).unwrap();
        let theirs = Backend::OpenImageIo.difference(&a, &b).unwrap();
        // It subtracts in single precision.
        let near = |x: f64, y: f64| (x - y).abs() <= 1e-6 * y.abs();
        assert!(near(ours.mean_absolute, theirs.mean_absolute), "{ours:?} {theirs:?}");
        assert!(near(ours.rms, theirs.rms), "{ours:?} {theirs:?}");
        assert!(near(ours.psnr, theirs.psnr), "{ours:?} {theirs:?}");
        assert!(near(ours.max, theirs.max), "{ours:?} {theirs:?}");
        assert_eq!((ours.x, ours.y, ours.channel), (77, 33, 2));
        assert_eq!((theirs.x, theirs.y, theirs.channel), (77, 33, 2));
        assert_eq!(Backend::OpenImageIo.difference(&a, &a), Backend::RustCrates.difference(&a, &a));
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
