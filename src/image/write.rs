//! Writing image files.

use std::borrow::Cow;
use std::collections::HashSet;
use std::path::Path;

use super::format::{Backend, ExrOutput, Format};
use super::{Image, Value, pfm, srgb};
use crate::error::{Error, Result};
use crate::util::{check_replaceable, replace};

/// The largest finite half.
const HALF_MAX: f32 = 65504.0;

/// The longest side that libjpeg writes.
const JPEG_MAX: usize = 65500;

/// How an OpenEXR file stores values.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum SampleFormat {
    /// 16 bits: 11 significant bits, up to 65504.
    Half,
    /// 32 bits, the very values.
    #[default]
    Float,
}

/// How an OpenEXR file is compressed; all of these are lossless.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Compression {
    /// Not at all.
    None,
    /// Run lengths.
    Rle,
    /// Deflate, single rows.
    Zips,
    /// Deflate, 16 rows at a time.
    #[default]
    Zip,
    /// Wavelets and Huffman codes; good for noise.
    Piz,
}

/// How to write an image. What a format has no use for is ignored.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WriteOptions {
    /// OpenEXR: the picture as half or float; layers are floats.
    pub samples: SampleFormat,
    /// OpenEXR: the compression.
    pub compression: Compression,
    /// JPEG: the quality from 1 to 100.
    pub jpeg_quality: u8,
    /// PNG and JPEG: the picture is scaled by 2^exposure before it is encoded.
    pub exposure: f32,
}

impl Default for WriteOptions {
    /// Float, zip, quality 95, exposure 0.
    fn default() -> Self {
        WriteOptions {
            samples: SampleFormat::default(),
            compression: Compression::default(),
            jpeg_quality: 95,
            exposure: 0.0,
        }
    }
}

impl WriteOptions {
    /// How a channel is stored. Half is for the picture: layers hold positions, counts and variances, which it would
    /// coarsen or lose, and are floats always.
    fn format_of(&self, channel: &str) -> SampleFormat {
        if channel.contains('.') { SampleFormat::Float } else { self.samples }
    }
}

/// What writing did to the values.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct WriteReport {
    /// How many finite values were beyond a half's range and were written as ±65504.
    pub clamped_half: usize,
}

/// Writes an image in the format that the extension names: `.exr` (linear, all channels, metadata), `.png` and
/// `.jpg`/`.jpeg` (the picture, sRGB-encoded with an ordered dither), `.pfm` (the picture, linear).
///
/// The file is written under another name in the same folder and then renamed, so an older file of that name
/// is whole until the new one is, and stays if writing fails.
///
/// # Errors
/// If the extension is another, the image is empty or inconsistent, the format cannot hold it, or the folder
/// is missing or cannot be written to.
pub fn write(path: &Path, image: &Image, options: &WriteOptions) -> Result<WriteReport> {
    write_with(Backend::default(), path, image, options)
}

/// Whether [`write()`] could write there, as far as that can be known before there is an image: a render should
/// not fail at its end.
///
/// # Errors
/// If the extension is unknown, or the folder is missing or cannot be written to.
pub fn check_output(path: &Path) -> Result<()> {
    let fail = |message: String| Error::output(message).in_file(path);
    Format::of_extension(path).ok_or_else(|| fail(unknown_extension(path)))?;
    check_replaceable(path)
}

/// Bytes that [`write()`] takes beside an image of so many pixels and channels, at most: the values in the file's form, the file, and
/// its copy.
pub fn encoding_bytes(path: &Path, pixels: u64, channels: u64) -> u64 {
    let of_pixel = match Format::of_extension(path) {
        Some(Format::OpenExr) => 12 * channels,
        Some(Format::Pfm) => 24,
        _ => 12,
    };
    pixels.saturating_mul(of_pixel)
}

/// [`write()`] with a given library.
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
        Format::Png | Format::Jpeg | Format::Bmp | Format::Tga | Format::Hdr => {
            let keep_alpha = format == Format::Png;
            let pixels = srgb::encode(image, options.exposure, keep_alpha).ok_or_else(lacks_picture)?;
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
    let expected = "expected the extension .exr, .png, .jpg, .jpeg or .pfm";
    match path.extension() {
        Some(found) => format!("{expected}, found .{}", found.to_string_lossy()),
        None => format!("{expected}, found none"),
    }
}

fn no_picture(image: &Image, format: Format) -> String {
    let found = image.channels.join(", ");
    format!("a {} file holds the channels R, G, B or Y, this image has {found}", format.name())
}

/// Whether the image is one that a file can hold.
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
        return Err(format!("{width}x{height} pixels of {channels} channels do not make {found} values"));
    }
    let mut seen = HashSet::new();
    for name in &image.channels {
        if name.is_empty() || name.len() > 255 || name.contains('\0') {
            return Err(format!("expected a channel name of 1 to 255 bytes, found \"{name}\""));
        }
        if !seen.insert(name) {
            return Err(format!("there are two channels named \"{name}\""));
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

/// The picture's values alone, three to a pixel or one.
fn picture(image: &Image) -> Option<(usize, Vec<f32>)> {
    let rgb = image.rgb_channels()?;
    let indices: &[usize] = if rgb[0] == rgb[1] { &rgb[..1] } else { &rgb };
    Some((indices.len(), image.select_indices(indices).data))
}

/// Brings finite values of the half channels into a half's range and counts them. NaN and infinities stay what they
/// are.
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
