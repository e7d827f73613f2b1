//! Reading image files.

use std::fs::File;
use std::io::Read;
use std::path::Path;

use super::format::{Backend, Format, Part};
use super::header::{self, Denied, Purpose};
use super::texture::{MAX_TEXTURE_VALUES, TextureImage, TextureLayers};
use super::{Image, pfm, srgb};
use crate::error::{Error, Result};
use crate::memory::{Budget, Limit, Reservation};

/// Reads an image: OpenEXR, PNG, JPEG, BMP, TGA, Radiance HDR or PFM, told apart by content and not by extension.
///
/// The result is linear with premultiplied alpha. Channels come in a fixed order: R, G, B, A, others by name,
/// then layers by name. An OpenEXR file of several parts gives one image whose channels have the part's name
/// in front; of a file with mip levels the full resolution is read, of one with a display window all stored
/// pixels.
///
/// # Errors
/// If the file is missing, empty, no image, damaged or cut short, if its parts differ in size, or if decoding it would take
/// more memory than is available.
pub fn read(path: &Path) -> Result<Image> {
    read_with(Backend::default(), path)
}

/// [`read`] with a given library.
pub fn read_with(backend: Backend, path: &Path) -> Result<Image> {
    let file = ImageFile::open(path)?;
    let _reserved = file.admit(Purpose::Image, &Budget::open(Limit::Available))?;
    file.image(backend)
}

/// Reads an image as a texture: what [`read`] reads, but integers stay what they are.
///
/// # Errors
/// As [`read`]; also if there is no picture in it, or more than 2^30 values.
pub fn read_texture(path: &Path) -> Result<TextureImage> {
    read_texture_with(Backend::default(), path)
}

/// [`read_texture`] within a budget, where the texture's memory is planned from then on.
///
/// # Errors
/// As [`read_texture`], by what the budget has left.
pub fn read_texture_within(path: &Path, memory: &Budget) -> Result<TextureImage> {
    texture(Backend::default(), path, memory)
}

/// [`read_texture`] with a given library.
pub fn read_texture_with(backend: Backend, path: &Path) -> Result<TextureImage> {
    texture(backend, path, &Budget::open(Limit::Available))
}

fn texture(backend: Backend, path: &Path, memory: &Budget) -> Result<TextureImage> {
    let file = ImageFile::open(path)?;
    let reserved = file.admit(Purpose::Texture, memory)?;
    let texture = match file.format {
        Format::OpenExr | Format::Pfm => {
            let image = file.image(backend)?;
            TextureImage::from_image(&image).map_err(|message| file.fail(message))?
        }
        Format::Png | Format::Jpeg | Format::Bmp | Format::Tga | Format::Hdr => {
            file.check_whole()?;
            let codes = backend.read_codes(path, file.format, MAX_TEXTURE_VALUES);
            TextureImage::from_codes(codes.map_err(|why| file.damaged(&why))?)
        }
    };
    reserved.keep(texture.memory_bytes() as u64);
    Ok(texture)
}

/// Reads the bytes of a PNG, JPEG, BMP, TGA or Radiance HDR file as a texture; `name` is what errors call it.
///
/// # Errors
/// If they are no such image, damaged or cut short, if there are more than 2^30 values, or if decoding them would take more
/// memory than is available.
pub fn read_texture_bytes(name: &Path, bytes: &[u8]) -> Result<TextureLayers> {
    read_texture_bytes_with(Backend::default(), name, bytes)
}

/// [`read_texture_bytes`] within a budget, where the layers' memory is planned from then on.
///
/// # Errors
/// As [`read_texture_bytes`], by what the budget has left.
pub fn read_texture_bytes_within(name: &Path, bytes: &[u8], memory: &Budget) -> Result<TextureLayers> {
    layers(Backend::default(), name, bytes, memory)
}

/// [`read_texture_bytes`] with a given library.
pub fn read_texture_bytes_with(backend: Backend, name: &Path, bytes: &[u8]) -> Result<TextureLayers> {
    layers(backend, name, bytes, &Budget::open(Limit::Available))
}

fn layers(backend: Backend, name: &Path, bytes: &[u8], memory: &Budget) -> Result<TextureLayers> {
    let fail = |message: String| Error::output(message).in_file(name);
    let format = match Format::of_content(&bytes[..bytes.len().min(18)]) {
        Some(Format::OpenExr | Format::Pfm) | None => {
            let expected = "PNG, JPEG, BMP, TGA or Radiance HDR";
            return Err(fail(format!("expected an image ({expected}), found something else")));
        }
        Some(format) => format,
    };
    let damaged =
        |why: String| fail(format!("damaged or cut short {} image ({})", format.name(), why.trim()));
    if format == Format::Jpeg && !jpeg_is_whole(bytes) {
        return Err(damaged("the end of the image is missing".into()));
    }
    let admitted = header::admit(format, bytes, bytes.len() as u64, Purpose::Texture, memory);
    let reserved = admitted.map_err(|denied| match denied {
        Denied::Damaged(why) => damaged(why),
        Denied::Memory(what, refusal) => fail(refusal.sentence(&what, "use a smaller image")),
    })?;
    let codes = backend.decode_codes(bytes, format, MAX_TEXTURE_VALUES).map_err(damaged)?;
    let layers = TextureLayers::from_codes(codes);
    let alpha = layers.alpha.as_ref().map_or(0, TextureImage::memory_bytes);
    reserved.keep((layers.color.memory_bytes() + alpha) as u64);
    Ok(layers)
}

/// A file whose format is known.
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
        self.fail(format!("damaged or cut short {} file ({})", self.format.name(), why.trim()))
    }

    /// Reserves what decoding takes by the header, which must not claim more than the file can hold.
    fn admit(&self, purpose: Purpose, memory: &Budget) -> Result<Reservation> {
        let start_and_length = || {
            let file = File::open(self.path)?;
            let length = file.metadata()?.len();
            let mut start = Vec::new();
            // In a JPEG the size may stand behind any number of other things.
            let most = if self.format == Format::Jpeg { length } else { header::START };
            file.take(most).read_to_end(&mut start)?;
            Ok((start, length))
        };
        let (start, length) =
            start_and_length().map_err(|e: std::io::Error| self.fail(format!("cannot be read: {e}")))?;
        header::admit(self.format, &start, length, purpose, memory).map_err(|denied| match denied {
            Denied::Damaged(why) => self.damaged(&why),
            Denied::Memory(what, refusal) => self.fail(refusal.sentence(&what, "use a smaller image")),
        })
    }

    /// The image, with its channels in order.
    fn image(&self, backend: Backend) -> Result<Image> {
        let damaged = |why: String| self.damaged(&why);
        let image = match self.format {
            Format::OpenExr => {
                let parts = backend.read_exr(self.path).map_err(damaged)?;
                join(parts).map_err(|message| self.fail(message))?
            }
            Format::Pfm => {
                let bytes =
                    std::fs::read(self.path).map_err(|e| self.fail(format!("cannot be read: {e}")))?;
                pfm::decode(&bytes).map_err(damaged)?
            }
            Format::Png | Format::Jpeg | Format::Bmp | Format::Tga | Format::Hdr => {
                self.check_whole()?;
                srgb::decode(backend.read_raster(self.path, self.format).map_err(damaged)?)
            }
        };
        Ok(image.sort_channels())
    }

    /// Looks for the end of a file whose decoders do not miss it.
    fn check_whole(&self) -> Result<()> {
        if self.format != Format::Jpeg {
            return Ok(());
        }
        let bytes = std::fs::read(self.path).map_err(|e| self.damaged(&e.to_string()))?;
        match jpeg_is_whole(&bytes) {
            true => Ok(()),
            false => Err(self.damaged("the end of the image is missing")),
        }
    }
}

/// The format that the file's content announces.
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
        "expected an image (OpenEXR, PNG, JPEG, BMP, TGA, Radiance HDR or PFM), found something else".into()
    })
}

/// Whether a JPEG file has an end of image behind its first scan. Decoders fill up what is missing with grey.
fn jpeg_is_whole(bytes: &[u8]) -> bool {
    // Segments: 0xff, a marker, a length that counts itself; thumbnails in them have ends of their own.
    let mut at = 2;
    while let Some(&[0xff, marker, high, low]) = bytes.get(at..at + 4) {
        if marker == 0xff {
            at += 1;
            continue;
        }
        at += 2 + usize::from(u16::from_be_bytes([high, low]));
        if marker == 0xda {
            // Within a scan 0xff is followed by 0 or by a restart marker.
            return bytes.get(at..).is_some_and(|scan| scan.windows(2).any(|w| w == [0xff, 0xd9]));
        }
    }
    false
}

/// One image of all parts of a file.
fn join(parts: Vec<Part>) -> Result<Image, String> {
    let mut parts = parts.into_iter();
    let first = parts.next().ok_or("expected an image, found a file without parts")?;
    let rest: Vec<Part> = parts.collect();
    if rest.is_empty() {
        return Ok(first.image);
    }
    let (width, height) = (first.image.width, first.image.height);
    let all: Vec<Part> = std::iter::once(first).chain(rest).collect();
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

/// A channel's name with its part's in front, unless it is there already.
fn channel_of_part(part: &str, channel: &str) -> String {
    let has_it = channel.strip_prefix(part).is_some_and(|rest| rest.starts_with('.'));
    if part.is_empty() || has_it { channel.to_owned() } else { format!("{part}.{channel}") }
}
