//! Writing image files.

use std::borrow::Cow;
use std::collections::HashSet;
use std::path::Path;

use super::format::{Backend, ExrOutput, Format};
use super::{Image, Tonemap, Value, npy, pfm, srgb};
use crate::error::{Error, Result};
use crate::util::{check_replaceable, replace};

/// The largest finite half.
const HALF_MAX: f32 = 65504.0;

/// The greatest width and height that libjpeg writes.
const JPEG_MAX: usize = 65500;

/// The sample type of an OpenEXR file.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum SampleFormat {
    /// 16 bits: 11 significant bits, up to 65504.
    Half,
    /// 32 bits, without rounding.
    #[default]
    Float,
}

/// The compression of an OpenEXR file; all of these are lossless.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Compression {
    /// No compression.
    None,
    /// Run-length encoding.
    Rle,
    /// Deflate, single rows.
    Zips,
    /// Deflate, 16 rows at a time.
    #[default]
    Zip,
    /// Wavelets and Huffman coding; suitable for noisy images.
    Piz,
}

/// The options for writing an image. Options that do not apply to a format are ignored.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WriteOptions {
    /// OpenEXR: the sample type of the base layer; other layers are floats.
    pub samples: SampleFormat,
    /// OpenEXR: the compression.
    pub compression: Compression,
    /// JPEG: the quality from 1 to 100.
    pub jpeg_quality: u8,
    /// PNG and JPEG: the base layer is scaled by 2^exposure before encoding.
    pub exposure: f32,
    /// PNG and JPEG: the tone curve.
    pub tonemap: Tonemap,
}

impl Default for WriteOptions {
    /// Returns float samples, zip compression, quality 95, exposure 0 and no tone curve.
    fn default() -> Self {
        WriteOptions {
            samples: SampleFormat::default(),
            compression: Compression::default(),
            jpeg_quality: 95,
            exposure: 0.0,
            tonemap: Tonemap::None,
        }
    }
}

impl WriteOptions {
    /// Returns the sample type of a channel. Only the base layer uses half. Other layers have positions, counts and
    /// variances, for which half is not precise enough, and always use float.
    fn format_of(&self, channel: &str) -> SampleFormat {
        if channel.contains('.') { SampleFormat::Float } else { self.samples }
    }
}

/// The changes that writing made to the values.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct WriteReport {
    /// The number of finite values beyond the range of half, written as ±65504.
    pub clamped_half: usize,
}

/// Writes an image in the format of the extension: `.exr` (linear, all channels, metadata), `.png` and `.jpg`/`.jpeg`
/// (the base layer, sRGB-encoded with an ordered dither), `.pfm` (the base layer, linear), `.npy` (linear, all channels
/// in their order, without their names).
///
/// The file is written to a temporary name in the same folder and then renamed. An existing file is therefore
/// replaced only by a complete one, and is unchanged if writing fails.
///
/// # Errors
/// If the extension is unknown, the image is empty or inconsistent, the format cannot represent it, or the folder is
/// missing or not writable.
pub fn write(path: &Path, image: &Image, options: &WriteOptions) -> Result<WriteReport> {
    write_with(Backend::default(), path, image, options)
}

/// Checks whether [`write()`] can write to the path, as far as this is possible without the image, so that a render
/// does not fail at its end.
///
/// # Errors
/// If the extension is unknown, or the folder is missing or not writable.
pub fn check_output(path: &Path) -> Result<()> {
    Format::of_extension(path).ok_or_else(|| Error::usage(unknown_extension(path)).in_file(path))?;
    check_replaceable(path)
}

/// Returns whether exposure and tone curve apply to files with the extension of a path.
pub fn is_display_format(path: &Path) -> bool {
    matches!(Format::of_extension(path), Some(Format::Png | Format::Jpeg))
}

/// Returns an upper bound of the bytes that [`write()`] needs in addition to an image with the given numbers of
/// pixels and channels: the converted values, the file and a copy of it.
pub fn encoding_bytes(path: &Path, pixels: u64, channels: u64) -> u64 {
    let of_pixel = match Format::of_extension(path) {
        Some(Format::OpenExr) => 12 * channels,
        Some(Format::Npy) => 4 * channels,
        Some(Format::Pfm) => 24,
        _ => 12,
    };
    pixels.saturating_mul(of_pixel)
}

/// Computes [`write()`] with a given library.
pub fn write_with(
    backend: Backend,
    path: &Path,
    image: &Image,
    options: &WriteOptions,
) -> Result<WriteReport> {
    let fail = |message: String| Error::output(message).in_file(path);
    let format = Format::of_extension(path).ok_or_else(|| fail(unknown_extension(path)))?;
    check(image).map_err(fail)?;
    let (width, height) = (image.width, image.height);
    let lacks_picture = || fail(no_picture(image, format));
    let failed = |why: String| fail(format!("cannot be written: {why}"));
    let mut report = WriteReport::default();
    let bytes = match format {
        Format::OpenExr => {
            let samples: Vec<SampleFormat> = image.channels.iter().map(|c| options.format_of(c)).collect();
            let (data, clamped_half) = clamp_to_half(&image.data, &samples);
            report.clamped_half = clamped_half;
            let compression = options.compression;
            backend.encode_exr(&ExrOutput { image, data: &data, samples, compression }).map_err(failed)?
        }
        Format::Pfm => {
            let (channels, data) = picture(image).ok_or_else(lacks_picture)?;
            pfm::encode(width, height, channels, &data)
        }
        Format::Npy => npy::encode(width, height, image.channels.len(), &image.data),
        Format::Png | Format::Jpeg | Format::Bmp | Format::Tga | Format::Hdr => {
            let keep_alpha = format == Format::Png;
            let pixels = srgb::encode(image, options.exposure, options.tonemap, keep_alpha)
                .ok_or_else(lacks_picture)?;
            if format == Format::Jpeg && width.max(height) > JPEG_MAX {
                let limit = format!("expected at most {JPEG_MAX}x{JPEG_MAX} pixels, found {width}x{height}");
                return Err(fail(limit).about("JPEG"));
            }
            let quality = options.jpeg_quality.clamp(1, 100);
            backend.encode_bytes(format, &pixels, quality).map_err(failed)?
        }
    };
    replace(path, &bytes)?;
    Ok(report)
}

fn unknown_extension(path: &Path) -> String {
    let expected = "expected the extension .exr, .png, .jpg, .jpeg, .pfm or .npy";
    match path.extension() {
        Some(found) => format!("{expected}, found .{}", found.to_string_lossy()),
        None => format!("{expected}, found none"),
    }
}

fn no_picture(image: &Image, format: Format) -> String {
    let found = image.channels.join(", ");
    format!("a {} file holds the channels R, G, B or Y, this image has {found}", format.name())
}

/// Checks that an image can be stored in a file.
fn check(image: &Image) -> Result<(), String> {
    let (width, height, channels) = (image.width, image.height, image.channels.len());
    if width == 0 || height == 0 || channels == 0 {
        return Err(format!(
            "expected an image of at least one pixel and channel, this one has {width}x{height} pixels, {channels} channels"
        ));
    }
    if width > i32::MAX as usize || height > i32::MAX as usize {
        return Err(format!("expected a size of at most {0}x{0}, this image has {width}x{height}", i32::MAX));
    }
    let expected = width.checked_mul(height).and_then(|n| n.checked_mul(channels));
    if expected != Some(image.data.len()) {
        let found = image.data.len();
        return Err(format!(
            "expected {width}x{height} pixels with {channels} channels, found {found} values"
        ));
    }
    let mut seen = HashSet::new();
    for name in &image.channels {
        if name.is_empty() || name.len() > 255 || name.contains('\0') {
            return Err(format!("expected a channel name of 1 to 255 bytes, found \"{name}\""));
        }
        if !seen.insert(name) {
            return Err(format!("expected unique channel names, found \"{name}\" twice"));
        }
    }
    for (name, value) in image.metadata.iter() {
        let text = if let Value::Text(text) = value { text.as_str() } else { "" };
        if name.is_empty() || name.len() > 255 || name.contains('\0') || text.contains('\0') {
            return Err(format!(
                "expected a metadata name of 1 to 255 bytes and no NUL, found {name:?} = {text:?}"
            ));
        }
    }
    Ok(())
}

/// Returns the values of the base layer, three or one for each pixel.
fn picture(image: &Image) -> Option<(usize, Vec<f32>)> {
    let rgb = image.rgb_channels()?;
    let indices: &[usize] = if rgb[0] == rgb[1] { &rgb[..1] } else { &rgb };
    Some((indices.len(), image.select_indices(indices).data))
}

/// Clamps finite values of the half channels to the range of half and counts the clamped ones. NaN and infinities are
/// unchanged.
fn clamp_to_half<'a>(data: &'a [f32], samples: &[SampleFormat]) -> (Cow<'a, [f32]>, usize) {
    let halves = || samples.iter().map(|s| *s == SampleFormat::Half).cycle();
    let beyond = |v: f32, half: bool| half && v.is_finite() && v.abs() > HALF_MAX;
    let clamped = data.iter().zip(halves()).filter(|(v, half)| beyond(**v, *half)).count();
    if clamped == 0 {
        return (Cow::Borrowed(data), 0);
    }
    let within = |(v, half): (&f32, bool)| if beyond(*v, half) { v.clamp(-HALF_MAX, HALF_MAX) } else { *v };
    (Cow::Owned(data.iter().zip(halves()).map(within).collect()), clamped)
}
