//! The file formats and the libraries that read and write them.

use std::path::Path;

use super::srgb::{Bytes, Codes, Raster};
use super::{Compression, Image, Metadata, SampleFormat, pure};

/// The most values (pixels times channels) that a file may ask for: 16 GiB of them. More is a damaged header.
pub(super) const MAX_VALUES: u64 = 1 << 32;

/// A file format.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Format {
    OpenExr,
    Png,
    Jpeg,
    Bmp,
    Tga,
    Hdr,
    Pfm,
}

impl Format {
    /// The format that a file's first bytes announce. Readers go by this and not by the extension.
    pub(super) fn of_content(start: &[u8]) -> Option<Format> {
        Some(match start {
            [0x76, 0x2f, 0x31, 0x01, ..] => Format::OpenExr,
            [0x89, b'P', b'N', b'G', ..] => Format::Png,
            [0xff, 0xd8, 0xff, ..] => Format::Jpeg,
            [b'B', b'M', ..] => Format::Bmp,
            [b'#', b'?', ..] => Format::Hdr,
            [b'P', b'F' | b'f', b'\n' | b'\r' | b' ' | b'\t', ..] => Format::Pfm,
            // No magic number: a plausible kind of palette, kind of pixels and depth.
            [_, 0 | 1, 1..=3 | 9..=11, rest @ ..] if matches!(rest.get(13), Some(8 | 15 | 16 | 24 | 32)) => {
                Format::Tga
            }
            _ => return None,
        })
    }

    /// The format to write, by the output's extension.
    pub(super) fn of_extension(path: &Path) -> Option<Format> {
        let extension = path.extension()?.to_str()?.to_ascii_lowercase();
        Some(match extension.as_str() {
            "exr" => Format::OpenExr,
            "png" => Format::Png,
            "jpg" | "jpeg" => Format::Jpeg,
            "pfm" => Format::Pfm,
            _ => return None,
        })
    }

    /// Whether the crate `image` reads it even where OpenImageIO is built in.
    #[cfg(feature = "oiio")]
    fn is_for_rust(self) -> bool {
        matches!(self, Format::Png | Format::Bmp)
    }

    /// The format's name, for people.
    pub(super) fn name(self) -> &'static str {
        match self {
            Format::OpenExr => "OpenEXR",
            Format::Png => "PNG",
            Format::Jpeg => "JPEG",
            Format::Bmp => "BMP",
            Format::Tga => "TGA",
            Format::Hdr => "Radiance HDR",
            Format::Pfm => "PFM",
        }
    }
}

/// A part of an OpenEXR file.
pub(super) struct Part {
    pub(super) name: String,
    pub(super) image: Image,
}

/// What to write to an OpenEXR file; the values are within the sample format's range.
pub(super) struct ExrOutput<'a> {
    pub(super) image: &'a Image,
    pub(super) data: &'a [f32],
    /// By channel.
    pub(super) samples: Vec<SampleFormat>,
    pub(super) compression: Compression,
}

/// The library that reads and writes files and compares images.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Backend {
    /// OpenImageIO.
    #[cfg(feature = "oiio")]
    OpenImageIo,
    /// The crates `exr` and `image`.
    RustCrates,
}

impl Default for Backend {
    /// OpenImageIO where it is built in.
    fn default() -> Self {
        #[cfg(feature = "oiio")]
        return Backend::OpenImageIo;
        #[cfg(not(feature = "oiio"))]
        Backend::RustCrates
    }
}

impl std::fmt::Display for Backend {
    /// Name and version: `OpenImageIO 2.4.7` or `exr/image crates`.
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            #[cfg(feature = "oiio")]
            Backend::OpenImageIo => write!(f, "OpenImageIO {}", env!("BUFFON_OIIO_VERSION")),
            Backend::RustCrates => write!(f, "exr/image crates"),
        }
    }
}

/// The library in use: `OpenImageIO 2.4.7` or `exr/image crates`.
pub fn backend() -> String {
    Backend::default().to_string()
}

/// Limits OpenImageIO's threads and OpenEXR's; 0 = as many as there are cores, which is the libraries' own
/// default. Holds for the whole process; the Rust crates use the global rayon pool.
pub fn set_threads(threads: usize) {
    #[cfg(feature = "oiio")]
    super::oiio::set_threads(threads);
    #[cfg(not(feature = "oiio"))]
    let _ = threads;
}

/// Differences of two images, as a library gives them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Difference {
    pub(crate) mean_absolute: f64,
    pub(crate) rms: f64,
    pub(crate) psnr: f64,
    pub(crate) max: f64,
    pub(crate) x: usize,
    pub(crate) y: usize,
    pub(crate) channel: usize,
}

/// What a library does for us. An error is the library's reason, without the file's name.
///
/// PNG and BMP files are always read by the crate `image`: libpng, which OpenImageIO reads PNG with, writes what it
/// finds wrong with a file to the process's stderr by itself; and its own reader of BMP (2.4.7) goes on with numbers that it
/// has not read where a header is damaged, and allocates by them.
impl Backend {
    /// All parts of an OpenEXR file.
    pub(super) fn read_exr(self, path: &Path) -> Result<Vec<Part>, String> {
        match self {
            #[cfg(feature = "oiio")]
            Backend::OpenImageIo => super::oiio::read_exr(path),
            Backend::RustCrates => pure::read_exr(path),
        }
    }

    /// The bytes of an OpenEXR file.
    pub(super) fn encode_exr(self, output: &ExrOutput) -> Result<Vec<u8>, String> {
        match self {
            #[cfg(feature = "oiio")]
            Backend::OpenImageIo => super::oiio::encode_exr(output),
            Backend::RustCrates => pure::encode_exr(output),
        }
    }

    /// The samples of a PNG, JPEG, BMP or TGA file as they are stored, or of an HDR file.
    pub(super) fn read_codes(self, path: &Path, format: Format, most: u64) -> Result<Codes, String> {
        match self {
            #[cfg(feature = "oiio")]
            Backend::OpenImageIo if !format.is_for_rust() => super::oiio::read_codes(path, format, most),
            _ => pure::read_codes(path, format, most),
        }
    }

    /// The samples of a PNG, JPEG, BMP, TGA or HDR file.
    pub(super) fn read_raster(self, path: &Path, format: Format) -> Result<Raster, String> {
        match self {
            #[cfg(feature = "oiio")]
            Backend::OpenImageIo if !format.is_for_rust() => super::oiio::read_raster(path, format),
            _ => pure::read_raster(path, format),
        }
    }

    /// As [`read_codes`](Self::read_codes), of a file in memory.
    pub(super) fn decode_codes(self, bytes: &[u8], format: Format, most: u64) -> Result<Codes, String> {
        match self {
            #[cfg(feature = "oiio")]
            Backend::OpenImageIo if !format.is_for_rust() => super::oiio::decode_codes(bytes, format, most),
            _ => pure::decode_codes(bytes, format, most),
        }
    }

    /// The bytes of a PNG or JPEG file.
    pub(super) fn encode_bytes(self, format: Format, bytes: &Bytes, quality: u8) -> Result<Vec<u8>, String> {
        match self {
            #[cfg(feature = "oiio")]
            Backend::OpenImageIo => super::oiio::encode_bytes(format, bytes, quality),
            Backend::RustCrates => pure::encode_bytes(format, bytes, quality),
        }
    }

    /// Compares two images of the same shape, which hold no NaN and no infinity.
    pub(crate) fn difference(self, a: &Image, b: &Image) -> Result<Difference, String> {
        match self {
            #[cfg(feature = "oiio")]
            Backend::OpenImageIo => super::oiio::difference(a, b),
            Backend::RustCrates => Ok(pure::difference(a, b)),
        }
    }
}

/// Metadata that both libraries keep of an OpenEXR file: everything but what describes the encoding itself
/// and the standard attributes that one of them does not hand out.
pub(super) fn kept(metadata: Metadata) -> Metadata {
    const DROPPED: [&str; 13] = [
        "DateTime",
        "Orientation",
        "PixelAspectRatio",
        "capDate",
        "compression",
        "framesPerSecond",
        "lineOrder",
        "multiView",
        "name",
        "screenWindowCenter",
        "screenWindowWidth",
        "type",
        "view",
    ];
    let mut kept = Metadata::new();
    for (name, value) in metadata.iter() {
        if !DROPPED.contains(&name) && !name.starts_with("oiio:") && !name.starts_with("openexr:") {
            kept.set(name, value.clone());
        }
    }
    kept.sort();
    kept
}
