//! The image file formats and the libraries that read and write them.

use std::path::Path;

use super::srgb::{BytePixels, Raster, StoredPixels};
use super::{Compression, Image, Metadata, SampleFormat, npy, pure};

/// The greatest number of values (pixels times channels) in a file, which take 16 GiB. A header with more is treated
/// as damaged.
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
    Npy,
}

impl Format {
    /// Detects the format from the first bytes of a file. Readers use the content, not the extension.
    pub(super) fn of_content(start: &[u8]) -> Option<Format> {
        Some(match start {
            [0x76, 0x2f, 0x31, 0x01, ..] => Format::OpenExr,
            [0x89, b'P', b'N', b'G', ..] => Format::Png,
            [0xff, 0xd8, 0xff, ..] => Format::Jpeg,
            [b'B', b'M', ..] => Format::Bmp,
            [b'#', b'?', ..] => Format::Hdr,
            [b'P', b'F' | b'f', b'\n' | b'\r' | b' ' | b'\t', ..] => Format::Pfm,
            start if start.starts_with(npy::MAGIC) => Format::Npy,
            // TGA has no magic number: checks for a plausible colour map type, image type and pixel depth.
            [_, 0 | 1, 1..=3 | 9..=11, rest @ ..] if matches!(rest.get(13), Some(8 | 15 | 16 | 24 | 32)) => {
                Format::Tga
            }
            _ => return None,
        })
    }

    /// Returns the format to write for the output's extension.
    pub(super) fn of_extension(path: &Path) -> Option<Format> {
        let extension = path.extension()?.to_str()?.to_ascii_lowercase();
        Some(match extension.as_str() {
            "exr" => Format::OpenExr,
            "png" => Format::Png,
            "jpg" | "jpeg" => Format::Jpeg,
            "pfm" => Format::Pfm,
            "npy" => Format::Npy,
            _ => return None,
        })
    }

    /// Returns whether the crate `image` reads the format even if OpenImageIO is available.
    #[cfg(feature = "oiio")]
    fn is_for_rust(self) -> bool {
        matches!(self, Format::Png | Format::Bmp)
    }

    /// Returns the format's name for messages.
    pub(super) fn name(self) -> &'static str {
        match self {
            Format::OpenExr => "OpenEXR",
            Format::Png => "PNG",
            Format::Jpeg => "JPEG",
            Format::Bmp => "BMP",
            Format::Tga => "TGA",
            Format::Hdr => "Radiance HDR",
            Format::Pfm => "PFM",
            Format::Npy => "NumPy",
        }
    }
}

/// A part of an OpenEXR file.
pub(super) struct ImagePart {
    pub(super) name: String,
    pub(super) image: Image,
}

/// The content of an OpenEXR file to write; the values are within the range of the sample format.
pub(super) struct ExrOutput<'a> {
    pub(super) image: &'a Image,
    pub(super) data: &'a [f32],
    /// For each channel.
    pub(super) samples: Vec<SampleFormat>,
    pub(super) compression: Compression,
}

/// The library that reads and writes image files and compares images.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Backend {
    /// OpenImageIO.
    #[cfg(feature = "oiio")]
    OpenImageIo,
    /// The crates `exr` and `image`.
    RustCrates,
}

impl Default for Backend {
    /// Returns OpenImageIO if it is compiled in.
    fn default() -> Self {
        #[cfg(feature = "oiio")]
        return Backend::OpenImageIo;
        #[cfg(not(feature = "oiio"))]
        Backend::RustCrates
    }
}

impl std::fmt::Display for Backend {
    /// Writes name and version: `OpenImageIO 2.4.7` or `exr/image crates`.
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            #[cfg(feature = "oiio")]
            Backend::OpenImageIo => match super::oiio::load_error() {
                None => write!(f, "OpenImageIO {}", env!("BUFFON_OIIO_VERSION")),
                Some(why) => write!(f, "exr/image crates ({why})"),
            },
            Backend::RustCrates => write!(f, "exr/image crates"),
        }
    }
}

/// Returns the library in use: `OpenImageIO 2.4.7` or `exr/image crates`.
pub fn backend() -> String {
    Backend::default().to_string()
}

/// Limits the threads of OpenImageIO and OpenEXR; 0 = the number of cores, which is the libraries' default. The limit
/// applies to the whole process. The Rust crates use the global rayon pool.
pub fn set_threads(threads: usize) {
    #[cfg(feature = "oiio")]
    super::oiio::set_threads(threads);
    #[cfg(not(feature = "oiio"))]
    let _ = threads;
}

/// Differences of two images, as computed by a library.
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

/// The operations of a library. An error is the library's message without the file's name. If OpenImageIO cannot be
/// loaded, the Rust crates do its work: a finished render must not be lost.
///
/// The crate `image` always reads PNG and BMP files. libpng, which OpenImageIO uses for PNG, writes problems of a
/// file directly to stderr. OpenImageIO's reader of BMP (2.4.7) continues with uninitialised numbers if a header is
/// damaged, and allocates memory according to them.
impl Backend {
    /// Reads all parts of an OpenEXR file.
    pub(super) fn read_exr(self, path: &Path) -> Result<Vec<ImagePart>, String> {
        match self {
            #[cfg(feature = "oiio")]
            Backend::OpenImageIo if super::oiio::can_load() => super::oiio::read_exr(path),
            _ => pure::read_exr(path),
        }
    }

    /// Encodes an OpenEXR file.
    pub(super) fn encode_exr(self, output: &ExrOutput) -> Result<Vec<u8>, String> {
        match self {
            #[cfg(feature = "oiio")]
            Backend::OpenImageIo if super::oiio::can_load() => super::oiio::encode_exr(output),
            _ => pure::encode_exr(output),
        }
    }

    /// Reads the stored samples of a PNG, JPEG, BMP, TGA or HDR file, without conversion.
    pub(super) fn read_stored(self, path: &Path, format: Format, most: u64) -> Result<StoredPixels, String> {
        match self {
            #[cfg(feature = "oiio")]
            Backend::OpenImageIo if !format.is_for_rust() && super::oiio::can_load() => {
                super::oiio::read_stored(path, format, most)
            }
            _ => pure::read_stored(path, format, most),
        }
    }

    /// Reads the samples of a PNG, JPEG, BMP, TGA or HDR file.
    pub(super) fn read_raster(self, path: &Path, format: Format) -> Result<Raster, String> {
        match self {
            #[cfg(feature = "oiio")]
            Backend::OpenImageIo if !format.is_for_rust() && super::oiio::can_load() => {
                super::oiio::read_raster(path, format)
            }
            _ => pure::read_raster(path, format),
        }
    }

    /// Decodes a file in memory as [`read_stored`](Self::read_codes) does.
    pub(super) fn decode_stored(
        self,
        bytes: &[u8],
        format: Format,
        most: u64,
    ) -> Result<StoredPixels, String> {
        match self {
            #[cfg(feature = "oiio")]
            Backend::OpenImageIo if !format.is_for_rust() && super::oiio::can_load() => {
                super::oiio::decode_stored(bytes, format, most)
            }
            _ => pure::decode_stored(bytes, format, most),
        }
    }

    /// Encodes a PNG or JPEG file.
    pub(super) fn encode_bytes(
        self,
        format: Format,
        bytes: &BytePixels,
        quality: u8,
    ) -> Result<Vec<u8>, String> {
        match self {
            #[cfg(feature = "oiio")]
            Backend::OpenImageIo if super::oiio::can_load() => {
                super::oiio::encode_bytes(format, bytes, quality)
            }
            _ => pure::encode_bytes(format, bytes, quality),
        }
    }

    /// Compares two images of the same shape without NaN and infinite values; `None` if the library compares none.
    pub(crate) fn difference(self, a: &Image, b: &Image) -> Option<Result<Difference, String>> {
        match self {
            #[cfg(feature = "oiio")]
            Backend::OpenImageIo if super::oiio::can_load() => Some(super::oiio::difference(a, b)),
            _ => {
                let _ = (a, b);
                None
            }
        }
    }
}

/// Returns the metadata of an OpenEXR file that both libraries preserve: all except those that describe the encoding,
/// and the standard attributes that one library does not return.
pub(super) fn preserved_metadata(metadata: Metadata) -> Metadata {
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
    let mut preserved_metadata = Metadata::new();
    for (name, value) in metadata.iter() {
        if !DROPPED.contains(&name) && !name.starts_with("oiio:") && !name.starts_with("openexr:") {
            preserved_metadata.set(name, value.clone());
        }
    }
    preserved_metadata.sort();
    preserved_metadata
}
