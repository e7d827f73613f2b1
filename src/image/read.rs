//! Reading image files.

use std::fs::File;
use std::io::Read;
use std::path::Path;

use super::format::{Backend, Format, ImagePart};
use super::header::{self, HeaderError, Purpose};
use super::texture::{MAX_TEXTURE_VALUES, TextureImage, TextureLayers};
use super::{Image, npy, pfm, srgb};
use crate::error::{Error, Result};
use crate::memory::{Budget, Limit, Reservation};

/// Reads an image: OpenEXR, PNG, JPEG, BMP, TGA, Radiance HDR, PFM or a NumPy array, detected by content, not by
/// extension.
///
/// The result is linear with premultiplied alpha. Channels have a fixed order: R, G, B, A, others by name, then
/// layers by name. A multi-part OpenEXR file gives one image, whose channel names begin with the part's name. If a
/// file has mip levels, the full resolution is read; if it has a display window, all stored pixels are read.
///
/// # Errors
/// If the file is missing, empty, not an image, damaged or truncated, if its parts differ in size, or if decoding
/// exceeds the available memory.
pub fn read(path: &Path) -> Result<Image> {
    read_with(Backend::default(), path)
}

/// Computes [`read`] with a given library.
pub fn read_with(backend: Backend, path: &Path) -> Result<Image> {
    let file = ImageFile::open(path)?;
    let _reserved = file.reserve_decoding(Purpose::Image, &Budget::open(Limit::Available))?;
    file.image(backend)
}

/// Reads an image as a texture: as [`read`], but integer samples are not converted to floats.
///
/// # Errors
/// As [`read`]; also if the image has no base layer or more than 2^30 values.
pub fn read_texture(path: &Path) -> Result<TextureImage> {
    read_texture_with(Backend::default(), path)
}

/// Computes [`read_texture`] with a budget, to which the texture's memory is charged.
///
/// # Errors
/// As [`read_texture`], with the remaining budget.
pub fn read_texture_within(path: &Path, memory: &Budget) -> Result<TextureImage> {
    texture(Backend::default(), path, memory)
}

/// Computes [`read_texture`] with a given library.
pub fn read_texture_with(backend: Backend, path: &Path) -> Result<TextureImage> {
    texture(backend, path, &Budget::open(Limit::Available))
}

fn texture(backend: Backend, path: &Path, memory: &Budget) -> Result<TextureImage> {
    let file = ImageFile::open(path)?;
    let reserved = file.reserve_decoding(Purpose::Texture, memory)?;
    let texture = match file.format {
        Format::OpenExr | Format::Pfm | Format::Npy => {
            let image = file.image(backend)?;
            TextureImage::from_image(&image).map_err(|message| file.fail(message))?
        }
        Format::Png | Format::Jpeg | Format::Bmp | Format::Tga | Format::Hdr => {
            file.check_whole()?;
            let stored = backend.read_stored(path, file.format, MAX_TEXTURE_VALUES);
            TextureImage::from_stored(stored.map_err(|why| file.damaged(&why))?)
        }
    };
    reserved.keep(texture.memory_bytes() as u64);
    Ok(texture)
}

/// Reads the bytes of a PNG, JPEG, BMP, TGA or Radiance HDR file as a texture; `name` is the name in error messages.
///
/// # Errors
/// If they are not such an image, damaged or truncated, if there are more than 2^30 values, or if decoding exceeds
/// the available memory.
pub fn read_texture_bytes(name: &Path, bytes: &[u8]) -> Result<TextureLayers> {
    read_texture_bytes_with(Backend::default(), name, bytes)
}

/// Computes [`read_texture_bytes`] with a budget, to which the layers' memory is charged.
///
/// # Errors
/// As [`read_texture_bytes`], with the remaining budget.
pub fn read_texture_bytes_within(name: &Path, bytes: &[u8], memory: &Budget) -> Result<TextureLayers> {
    layers(Backend::default(), name, bytes, memory)
}

/// Computes [`read_texture_bytes`] with a given library.
pub fn read_texture_bytes_with(backend: Backend, name: &Path, bytes: &[u8]) -> Result<TextureLayers> {
    layers(backend, name, bytes, &Budget::open(Limit::Available))
}

fn layers(backend: Backend, name: &Path, bytes: &[u8], memory: &Budget) -> Result<TextureLayers> {
    let fail = |message: String| Error::output(message).in_file(name);
    let format = match Format::of_content(&bytes[..bytes.len().min(18)]) {
        Some(Format::OpenExr | Format::Pfm | Format::Npy) | None => {
            let expected = "PNG, JPEG, BMP, TGA or Radiance HDR";
            return Err(fail(format!("expected an image ({expected}), found something else")));
        }
        Some(format) => format,
    };
    let damaged =
        |why: String| fail(format!("damaged or truncated {} image ({})", format.name(), why.trim()));
    if format == Format::Jpeg && !jpeg_is_whole(bytes) {
        return Err(damaged("the file is truncated".into()));
    }
    let admitted = header::reserve_decoding(format, bytes, bytes.len() as u64, Purpose::Texture, memory);
    let reserved = admitted.map_err(|denied| match denied {
        HeaderError::Damaged(why) => damaged(why),
        HeaderError::Memory(what, refusal) => fail(refusal.sentence(&what, "use a smaller image")),
    })?;
    let stored = backend.decode_stored(bytes, format, MAX_TEXTURE_VALUES).map_err(damaged)?;
    let layers = TextureLayers::from_stored(stored);
    let alpha = layers.alpha.as_ref().map_or(0, TextureImage::memory_bytes);
    reserved.keep((layers.color.memory_bytes() + alpha) as u64);
    Ok(layers)
}

/// Returns whether a file can hold values above that of white.
///
/// # Errors
/// If the file cannot be read, or is no image.
pub fn has_high_range(path: &Path) -> Result<bool> {
    let format = ImageFile::open(path)?.format;
    Ok(matches!(format, Format::OpenExr | Format::Pfm | Format::Npy | Format::Hdr))
}

/// A file with known format.
struct ImageFile<'a> {
    path: &'a Path,
    format: Format,
}

impl<'a> ImageFile<'a> {
    fn open(path: &'a Path) -> Result<Self> {
        let format = sniff(path).map_err(|message| Error::output(message).in_file(path))?;
        Ok(ImageFile { path, format })
    }

    fn fail(&self, message: String) -> Error {
        Error::output(message).in_file(self.path)
    }

    fn damaged(&self, why: &str) -> Error {
        self.fail(format!("damaged or truncated {} file ({})", self.format.name(), why.trim()))
    }

    /// Reserves the memory for decoding according to the header, whose sizes must not exceed what the file can
    /// contain.
    fn reserve_decoding(&self, purpose: Purpose, memory: &Budget) -> Result<Reservation> {
        let start_and_length = || {
            let file = File::open(self.path)?;
            let length = file.metadata()?.len();
            let mut start = Vec::new();
            // In a JPEG, the size may come after any number of other segments.
            let most = if self.format == Format::Jpeg { length } else { header::HEADER_BYTES };
            file.take(most).read_to_end(&mut start)?;
            Ok((start, length))
        };
        let (start, length) =
            start_and_length().map_err(|e: std::io::Error| self.fail(format!("cannot be read: {e}")))?;
        header::reserve_decoding(self.format, &start, length, purpose, memory).map_err(
            |denied| match denied {
                HeaderError::Damaged(why) => self.damaged(&why),
                HeaderError::Memory(what, refusal) => {
                    self.fail(refusal.sentence(&what, "use a smaller image"))
                }
            },
        )
    }

    /// Decodes the image, with its channels in order.
    fn image(&self, backend: Backend) -> Result<Image> {
        let damaged = |why: String| self.damaged(&why);
        let image = match self.format {
            Format::OpenExr => {
                let parts = backend.read_exr(self.path).map_err(damaged)?;
                join(parts).map_err(|message| self.fail(message))?
            }
            Format::Pfm => pfm::decode(&self.bytes()?).map_err(damaged)?,
            Format::Npy => npy::decode(&self.bytes()?).map_err(damaged)?,
            Format::Png | Format::Jpeg | Format::Bmp | Format::Tga | Format::Hdr => {
                self.check_whole()?;
                srgb::decode(backend.read_raster(self.path, self.format).map_err(damaged)?)
            }
        };
        Ok(image.sort_channels())
    }

    /// Reads the whole file.
    fn bytes(&self) -> Result<Vec<u8>> {
        std::fs::read(self.path).map_err(|e| self.fail(format!("cannot be read: {e}")))
    }

    /// Checks the end of a file, for formats whose decoders do not detect truncation.
    fn check_whole(&self) -> Result<()> {
        if self.format != Format::Jpeg {
            return Ok(());
        }
        let bytes = std::fs::read(self.path).map_err(|e| self.damaged(&e.to_string()))?;
        match jpeg_is_whole(&bytes) {
            true => Ok(()),
            false => Err(self.damaged("the file is truncated")),
        }
    }
}

/// Detects the format from the file's content.
fn sniff(path: &Path) -> Result<Format, String> {
    let mut start = Vec::new();
    match std::fs::metadata(path) {
        Ok(about) if about.is_dir() => return Err("expected an image, found a folder".into()),
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => return Err("no such file".into()),
        _ => {}
    }
    File::open(path)
        .and_then(|file| file.take(18).read_to_end(&mut start))
        .map_err(|e| format!("cannot be read: {e}"))?;
    if start.is_empty() {
        return Err("expected an image, found an empty file".into());
    }
    Format::of_content(&start).ok_or_else(|| {
        "expected an image (OpenEXR, PNG, JPEG, BMP, TGA, Radiance HDR, PFM or a NumPy array), found something else"
            .into()
    })
}

/// Returns whether a JPEG file has an end-of-image marker after its first scan. Decoders replace missing data by
/// grey.
fn jpeg_is_whole(bytes: &[u8]) -> bool {
    // A segment has 0xff, a marker, and a length that includes itself. Thumbnails inside segments have their own
    // markers.
    let mut at = 2;
    while let Some(&[0xff, marker, high, low]) = bytes.get(at..at + 4) {
        if marker == 0xff {
            at += 1;
            continue;
        }
        at += 2 + usize::from(u16::from_be_bytes([high, low]));
        if marker == 0xda {
            // Within a scan, 0xff is followed by 0 or by a restart marker.
            return bytes.get(at..).is_some_and(|scan| scan.windows(2).any(|w| w == [0xff, 0xd9]));
        }
    }
    false
}

/// Joins all parts of a file to one image.
fn join(parts: Vec<ImagePart>) -> Result<Image, String> {
    let mut parts = parts.into_iter();
    let first = parts.next().ok_or("expected an image, found a file without parts")?;
    let rest: Vec<ImagePart> = parts.collect();
    if rest.is_empty() {
        return Ok(first.image);
    }
    let (width, height) = (first.image.width, first.image.height);
    let all: Vec<ImagePart> = std::iter::once(first).chain(rest).collect();
    if let Some(other) = all.iter().find(|p| (p.image.width, p.image.height) != (width, height)) {
        let (w, h) = (other.image.width, other.image.height);
        let name = &other.name;
        return Err(format!(
            "expected parts of one size, found {width}x{height} and {w}x{h} (part \"{name}\")"
        ));
    }
    let mut joined =
        Image { width, height, channels: Vec::new(), data: Vec::new(), metadata: Default::default() };
    for part in &all {
        joined
            .channels
            .extend(part.image.channels.iter().map(|channel| channel_of_part(&part.name, channel)));
        for (name, value) in part.image.metadata.iter() {
            if joined.metadata.get(name).is_none() {
                joined.metadata.set(name, value.clone());
            }
        }
    }
    for pixel in 0..width * height {
        for part in &all {
            let n = part.image.channels.len();
            joined.data.extend_from_slice(&part.image.data[pixel * n..][..n]);
        }
    }
    Ok(joined)
}

/// Returns a channel's name with the name of its part as a prefix, unless it already has the prefix.
fn channel_of_part(part: &str, channel: &str) -> String {
    let has_it = channel.strip_prefix(part).is_some_and(|rest| rest.starts_with('.'));
    if part.is_empty() || has_it { channel.to_owned() } else { format!("{part}.{channel}") }
}
