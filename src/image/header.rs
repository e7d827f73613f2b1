//! Validation of a file's header before decoding: a header whose sizes exceed the file or the memory limit is
//! rejected before allocation.
//!
//! Only sizes are read here, from the first bytes of a file. A header that cannot be parsed is accepted and left to
//! the decoder. [PNG 1.2; ITU T.81; Truevision TGA 2.0; Greg Ward, "Real pixels"; OpenEXR file layout]

use super::format::Format;
use crate::error::counted;
use crate::memory::{Budget, Refusal, Reservation};

/// The number of bytes at the start of a file that contain its header, except for JPEG.
pub(super) const HEADER_BYTES: u64 = 1 << 20;
/// The greatest expansion ratio of Deflate.
const MAX_DEFLATE_RATIO: u64 = 1032;
/// The decoded size in bytes below which a header is not checked, because the decoder's message is more precise.
const MIN_CHECKED_BYTES: u64 = 16 << 20;

/// The sizes stated in a header.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct HeaderSizes {
    width: u64,
    height: u64,
    /// Upper bound of the number of decoded channels in all parts.
    channels: u64,
    /// Upper bound of the bytes of a pixel in the decoder's representation.
    pixel: u64,
    /// Lower bound of the bytes of a file with such pixels.
    least: u64,
}

/// The purpose for which an image is read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Purpose {
    /// All channels as floats.
    Image,
    /// The base layer with its samples in their stored size.
    Texture,
}

/// The reason for rejecting a file.
#[derive(Debug)]
pub(super) enum HeaderError {
    /// The file is too short for the sizes in its header.
    Damaged(String),
    /// The memory limit is too low for the file.
    Memory(String, Refusal),
}

/// Reserves an upper bound of the memory for decoding a file, given its first bytes and its length.
pub(super) fn reserve_decoding(
    format: Format,
    start: &[u8],
    length: u64,
    purpose: Purpose,
    memory: &Budget,
) -> Result<Reservation, HeaderError> {
    let sizes = header_sizes(format, start).unwrap_or_default();
    let HeaderSizes { width, height, channels, pixel, least } = sizes;
    let pixels = width.saturating_mul(height);
    let decoded = pixels.saturating_mul(pixel);
    if decoded > MIN_CHECKED_BYTES && length < least {
        let found = counted(length, "byte", "bytes");
        return Err(HeaderError::Damaged(format!(
            "expected at least {least} bytes for {width}x{height} pixels, found {found}"
        )));
    }
    // Libraries decode to their own buffers, which are then converted.
    let floats = pixels.saturating_mul(4 * channels);
    let needed = match (format, purpose) {
        // The file is read as a whole, and is as long as its values.
        (Format::Pfm | Format::Npy, Purpose::Image) => length.saturating_mul(2),
        (Format::Pfm | Format::Npy, Purpose::Texture) => length.saturating_mul(3),
        (Format::OpenExr, Purpose::Texture) => decoded.saturating_add(floats.saturating_mul(3)),
        (_, Purpose::Image) => decoded.saturating_add(floats.saturating_mul(2)),
        (_, Purpose::Texture) => decoded.saturating_mul(2),
    };
    let whole = if format == Format::Jpeg { length } else { 0 };
    let what = || match format {
        Format::Pfm | Format::Npy => format!("reading its {}", counted(length, "byte", "bytes")),
        _ => format!("decoding {width}x{height} pixels of {}", counted(channels, "channel", "channels")),
    };
    memory.reserve(needed.saturating_add(whole)).map_err(|refusal| HeaderError::Memory(what(), refusal))
}

/// Returns the sizes in the header; `None` if it cannot be parsed.
fn header_sizes(format: Format, start: &[u8]) -> Option<HeaderSizes> {
    match format {
        Format::OpenExr => open_exr(start),
        Format::Png => png(start),
        Format::Jpeg => jpeg(start),
        Format::Bmp => bmp(start),
        Format::Tga => tga(start),
        Format::Hdr => hdr(start),
        Format::Pfm | Format::Npy => None,
    }
}

fn bytes<const N: usize>(start: &[u8], at: usize) -> Option<[u8; N]> {
    start.get(at..at.checked_add(N)?)?.try_into().ok()
}

fn big(start: &[u8], at: usize) -> Option<u64> {
    bytes(start, at).map(|b| u32::from_be_bytes(b).into())
}

fn little(start: &[u8], at: usize) -> Option<i64> {
    bytes(start, at).map(|b| i32::from_le_bytes(b).into())
}

fn little_16(start: &[u8], at: usize) -> Option<u64> {
    bytes(start, at).map(|b| u16::from_le_bytes(b).into())
}

fn png(start: &[u8]) -> Option<HeaderSizes> {
    let (width, height) = (big(start, 16)?, big(start, 20)?);
    let [depth, kind] = bytes(start, 24)?;
    // The stored channels, and the channels after expansion of palettes and transparent colours.
    let (stored, channels) = match kind {
        0 => (1, 2),
        2 => (3, 4),
        3 => (1, 4),
        4 => (2, 2),
        _ => (4, 4),
    };
    let row = 1 + (width * stored * u64::from(depth)).div_ceil(8);
    let pixel = channels * if depth == 16 { 2 } else { 1 };
    Some(HeaderSizes {
        width,
        height,
        channels,
        pixel,
        least: row.saturating_mul(height) / MAX_DEFLATE_RATIO,
    })
}

fn jpeg(start: &[u8]) -> Option<HeaderSizes> {
    let mut at = 2;
    loop {
        let [0xff, marker, high, low] = bytes(start, at)? else { return None };
        match marker {
            0xff => at += 1,
            // Start of frame: all of 0xc0 to 0xcf except tables and an extension.
            0xc0..=0xcf if !matches!(marker, 0xc4 | 0xc8 | 0xcc) => {
                let [_, h1, h0, w1, w0, channels]: [u8; 6] = bytes(start, at + 4)?;
                let [height, width] = [[h1, h0], [w1, w0]].map(|b| u64::from(u16::from_be_bytes(b)));
                // With Huffman coding, a block of 8x8 takes at least one bit.
                let least = if marker <= 0xc2 { width.div_ceil(8) * height.div_ceil(8) / 8 } else { 0 };
                let channels = u64::from(channels);
                return Some(HeaderSizes { width, height, channels, pixel: channels.max(3), least });
            }
            _ => at += 2 + usize::from(u16::from_be_bytes([high, low])),
        }
    }
}

fn bmp(start: &[u8]) -> Option<HeaderSizes> {
    let old = little(start, 14)? == 12;
    let (width, height, depth, compression) = if old {
        (little_16(start, 18)?, little_16(start, 20)?, little_16(start, 24)?, 0)
    } else {
        let [width, height] = [18, 22].map(|at| little(start, at).map(i64::unsigned_abs));
        (width?, height?, little_16(start, 28)?, little(start, 30)?)
    };
    let stored = (width * depth).div_ceil(8).saturating_mul(height);
    // Runs may skip any number of pixels.
    let least = if matches!(compression, 1 | 2) { 0 } else { stored };
    Some(HeaderSizes { width, height, channels: 4, pixel: 4, least })
}

fn tga(start: &[u8]) -> Option<HeaderSizes> {
    let (width, height) = (little_16(start, 12)?, little_16(start, 14)?);
    let ([kind], [depth]) = (bytes(start, 2)?, bytes(start, 16)?);
    let (pixels, size) = (width * height, u64::from(depth).div_ceil(8));
    let least = if kind >= 9 { pixels / 128 * (1 + size) } else { pixels * size };
    Some(HeaderSizes { width, height, channels: 4, pixel: 4, least })
}

fn hdr(start: &[u8]) -> Option<HeaderSizes> {
    // Lines up to an empty one, then the resolution: "-Y 480 +X 640".
    let end = start.windows(2).position(|w| w == b"\n\n")?;
    let line = start[end + 2..].split(|b| *b == b'\n').next()?;
    let words: Vec<&str> = str::from_utf8(line).ok()?.split_whitespace().collect();
    let [_, first, second, width] = words[..] else { return None };
    let (mut height, mut width): (u64, u64) = (first.parse().ok()?, width.parse().ok()?);
    if second.ends_with('Y') {
        std::mem::swap(&mut width, &mut height);
    }
    // A run-length encoded row has a word before it and at least two bytes for 127 pixels in each of four channels.
    let row = if (8..32768).contains(&width) { 4 + 8 * width.div_ceil(127) } else { 4 };
    Some(HeaderSizes { width, height, channels: 3, pixel: 12, least: height.saturating_mul(row) })
}

/// For several parts, returns the sum of their channels with the area of the largest part.
fn open_exr(start: &[u8]) -> Option<HeaderSizes> {
    let version = little(start, 4)?;
    let several = version & 0x1000 != 0;
    let mut at = 8;
    let mut whole: Option<HeaderSizes> = None;
    loop {
        let part;
        (part, at) = exr_part(start, at)?;
        whole = Some(whole.map_or(part, |sum| add(sum, part)));
        if !several || start.get(at) == Some(&0) {
            return whole;
        }
    }
}

fn add(a: HeaderSizes, b: HeaderSizes) -> HeaderSizes {
    let larger = if a.width.saturating_mul(a.height) >= b.width.saturating_mul(b.height) { a } else { b };
    HeaderSizes {
        channels: a.channels.saturating_add(b.channels),
        pixel: a.pixel.saturating_add(b.pixel),
        least: a.least.saturating_add(b.least),
        ..larger
    }
}

/// Returns the sizes of the part whose header begins at `at`, and the end of the header.
fn exr_part(start: &[u8], mut at: usize) -> Option<(HeaderSizes, usize)> {
    let text = |from: usize| {
        let length = start.get(from..)?.iter().position(|b| *b == 0)?;
        Some((&start[from..from + length], from + length + 1))
    };
    let (mut sizes, mut compression, mut tile) = (HeaderSizes::default(), 0, None);
    loop {
        let (name, kind) = text(at)?;
        if name.is_empty() {
            at = kind;
            break;
        }
        let size = text(kind)?.1;
        let value = size + 4;
        at = value.checked_add(usize::try_from(little(start, size)?).ok()?)?;
        match name {
            b"dataWindow" => {
                let side = |low: usize| {
                    Some((little(start, value + low + 8)? - little(start, value + low)? + 1).max(0))
                };
                (sizes.width, sizes.height) = (side(0)?.unsigned_abs(), side(4)?.unsigned_abs());
            }
            b"channels" => {
                let mut entry = value;
                while let Some((_, kind)) = text(entry).filter(|(name, _)| !name.is_empty() && entry < at) {
                    sizes.channels += 1;
                    sizes.pixel += if little(start, kind)? == 1 { 2 } else { 4 };
                    entry = kind + 16;
                }
            }
            b"compression" => compression = *start.get(value)?,
            b"tiles" => {
                tile = Some(
                    [value, value + 4].map(|at| little(start, at).map_or(1, |n| n.max(1).unsigned_abs())),
                )
            }
            _ => {}
        }
    }
    sizes.least = exr_least(&sizes, compression, tile);
    Some((sizes, at))
}

/// Returns a lower bound of a part's bytes: an entry in the offset table and a header for each chunk, and the pixels
/// at the greatest compression ratio.
fn exr_least(sizes: &HeaderSizes, compression: u8, tile: Option<[u64; 2]>) -> u64 {
    let HeaderSizes { width, height, pixel, .. } = *sizes;
    let rows = match compression {
        0..=2 => 1,
        3 | 5 => 16,
        9 => 256,
        _ => 32,
    };
    let [across, down] =
        tile.map_or([1, height.div_ceil(rows)], |[w, h]| [width.div_ceil(w), height.div_ceil(h)]);
    let chunks = across.saturating_mul(down).saturating_mul(16);
    let stored = width.saturating_mul(height).saturating_mul(pixel);
    let data = match compression {
        0 => stored,
        1 => stored / 64,
        2 | 3 => stored / MAX_DEFLATE_RATIO,
        // 24 of 32 bits are stored.
        5 => stored / (2 * MAX_DEFLATE_RATIO),
        _ => 0,
    };
    chunks.saturating_add(data)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::{Compression, Image, WriteOptions, write};
    use crate::memory::Limit;

    fn size(sizes: Option<HeaderSizes>) -> Option<[u64; 4]> {
        sizes.map(|c| [c.width, c.height, c.channels, c.pixel])
    }

    #[test]
    fn what_buffon_writes_is_understood_and_never_too_short() {
        let folder = tempfile::tempdir().unwrap();
        let image = Image::new(300, 200, &["R", "G", "B", "N.X"]);
        for compression in
            [Compression::None, Compression::Rle, Compression::Zips, Compression::Zip, Compression::Piz]
        {
            let path = folder.path().join("a.exr");
            write(&path, &image, &WriteOptions { compression, ..WriteOptions::default() }).unwrap();
            let bytes = std::fs::read(&path).unwrap();
            let sizes = header_sizes(Format::OpenExr, &bytes);
            assert_eq!(size(sizes), Some([300, 200, 4, 16]), "{compression:?}");
            assert!(sizes.unwrap().least <= bytes.len() as u64, "{compression:?}: {sizes:?}");
        }
        for (name, format, pixel) in [("a.png", Format::Png, 4), ("a.jpg", Format::Jpeg, 3)] {
            let path = folder.path().join(name);
            write(&path, &image, &WriteOptions::default()).unwrap();
            let bytes = std::fs::read(&path).unwrap();
            let sizes = header_sizes(format, &bytes);
            assert_eq!(size(sizes).map(|[w, h, _, pixel]| [w, h, pixel]), Some([300, 200, pixel]), "{name}");
            assert!(sizes.unwrap().least <= bytes.len() as u64, "{name}: {sizes:?}");
        }
    }

    #[test]
    fn other_headers_are_understood() {
        let hdr = |text: &str| size(header_sizes(Format::Hdr, text.as_bytes()));
        assert_eq!(hdr("#?RADIANCE\nA=1\n\n-Y 480 +X 640\nxyz"), Some([640, 480, 3, 12]));
        assert_eq!(hdr("#?RADIANCE\n\n+X 640 -Y 480\n"), Some([640, 480, 3, 12]));
        assert_eq!(hdr("#?RADIANCE\n\n-Y 480\n"), None);
        let mut bmp = [0; 54];
        (bmp[14], bmp[18], bmp[28]) = (40, 7, 24);
        bmp[22..26].copy_from_slice(&(-3i32).to_le_bytes());
        assert_eq!(header_sizes(Format::Bmp, &bmp).map(|c| [c.width, c.height, c.least]), Some([7, 3, 63]));
        bmp[30] = 1;
        assert_eq!(header_sizes(Format::Bmp, &bmp).map(|c| c.least), Some(0));
        let mut tga = [0; 18];
        (tga[2], tga[12], tga[14], tga[16]) = (2, 5, 4, 32);
        assert_eq!(header_sizes(Format::Tga, &tga).map(|c| [c.width, c.height, c.least]), Some([5, 4, 80]));
        for format in [Format::OpenExr, Format::Png, Format::Jpeg, Format::Bmp, Format::Tga, Format::Hdr] {
            assert_eq!(header_sizes(format, &[0xff; 12]), None, "{}", format.name());
            assert_eq!(header_sizes(format, &[]), None, "{}", format.name());
        }
    }

    #[test]
    fn boasting_is_damage_only_where_it_would_do_harm() {
        let header = |side: i32| {
            let mut bmp = [0; 54];
            (bmp[14], bmp[28]) = (40, 24);
            bmp[18..22].copy_from_slice(&side.to_le_bytes());
            bmp[22..26].copy_from_slice(&side.to_le_bytes());
            bmp
        };
        let memory = Budget::open(Limit::None);
        let admitted = |side| reserve_decoding(Format::Bmp, &header(side), 54, Purpose::Texture, &memory);
        assert!(admitted(1000).is_ok());
        let Err(HeaderError::Damaged(why)) = admitted(10_000) else {
            panic!("10000x10000 pixels in 54 bytes")
        };
        assert_eq!(why, "expected at least 300000000 bytes for 10000x10000 pixels, found 54 bytes");
    }
}
