//! What a file's header claims, before anything is allocated for it.
//!
//! Only sizes are read here, from the first bytes of a file. A header that is not understood claims nothing, and is left to the
//! decoder. [PNG 1.2; ITU T.81; Truevision TGA 2.0; Greg Ward, "Real pixels"; OpenEXR file layout]

use super::format::Format;
use crate::error::counted;
use crate::memory::{Budget, Refusal, Reservation};

/// As many bytes of a file hold its header; a JPEG's may be anywhere.
pub(super) const START: u64 = 1 << 20;
/// Deflate makes at most so many bytes of one.
const DEFLATE: u64 = 1032;
/// Claims of fewer bytes do no harm: what is wrong with such a file the decoder knows better.
const HARMLESS: u64 = 16 << 20;

/// What a header says of the pixels.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Claim {
    width: u64,
    height: u64,
    /// Channels of all parts once decoded, at most.
    channels: u64,
    /// Bytes of a pixel in the decoder's own form, at most.
    pixel: u64,
    /// A file of such pixels has at least so many bytes.
    least: u64,
}

/// What an image is read for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Purpose {
    /// All channels as floats.
    Image,
    /// A picture whose samples stay as small as they are.
    Texture,
}

/// Why a file is not decoded.
#[derive(Debug)]
pub(super) enum Denied {
    /// The file cannot hold what its header claims.
    Damaged(String),
    /// There is no memory for it.
    Memory(String, Refusal),
}

/// Reserves what decoding a file takes at most, given its first bytes and its length.
pub(super) fn admit(
    format: Format,
    start: &[u8],
    length: u64,
    purpose: Purpose,
    memory: &Budget,
) -> Result<Reservation, Denied> {
    let claim = claim(format, start).unwrap_or_default();
    let Claim { width, height, channels, pixel, least } = claim;
    let pixels = width.saturating_mul(height);
    let decoded = pixels.saturating_mul(pixel);
    if decoded > HARMLESS && length < least {
        let found = counted(length, "byte", "bytes");
        return Err(Denied::Damaged(format!(
            "expected at least {least} bytes for {width}x{height} pixels, found {found}"
        )));
    }
    // Libraries decode into buffers of their own, and what comes out is brought into our form.
    let floats = pixels.saturating_mul(4 * channels);
    let needed = match (format, purpose) {
        // Read whole, and as long as its values.
        (Format::Pfm, Purpose::Image) => length.saturating_mul(2),
        (Format::Pfm, Purpose::Texture) => length.saturating_mul(3),
        (Format::OpenExr, Purpose::Texture) => decoded.saturating_add(floats.saturating_mul(3)),
        (_, Purpose::Image) => decoded.saturating_add(floats.saturating_mul(2)),
        (_, Purpose::Texture) => decoded.saturating_mul(2),
    };
    let whole = if format == Format::Jpeg { length } else { 0 };
    let what = || match format {
        Format::Pfm => format!("reading its {}", counted(length, "byte", "bytes")),
        _ => format!("decoding {width}x{height} pixels of {}", counted(channels, "channel", "channels")),
    };
    memory.reserve(needed.saturating_add(whole)).map_err(|refusal| Denied::Memory(what(), refusal))
}

/// What the header says; `None` if it says nothing that is understood.
fn claim(format: Format, start: &[u8]) -> Option<Claim> {
    match format {
        Format::OpenExr => open_exr(start),
        Format::Png => png(start),
        Format::Jpeg => jpeg(start),
        Format::Bmp => bmp(start),
        Format::Tga => tga(start),
        Format::Hdr => hdr(start),
        Format::Pfm => None,
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

fn png(start: &[u8]) -> Option<Claim> {
    let (width, height) = (big(start, 16)?, big(start, 20)?);
    let [depth, kind] = bytes(start, 24)?;
    // Stored channels, and those after palettes and transparent colours are expanded.
    let (stored, channels) = match kind {
        0 => (1, 2),
        2 => (3, 4),
        3 => (1, 4),
        4 => (2, 2),
        _ => (4, 4),
    };
    let row = 1 + (width * stored * u64::from(depth)).div_ceil(8);
    let pixel = channels * if depth == 16 { 2 } else { 1 };
    Some(Claim { width, height, channels, pixel, least: row.saturating_mul(height) / DEFLATE })
}

fn jpeg(start: &[u8]) -> Option<Claim> {
    let mut at = 2;
    loop {
        let [0xff, marker, high, low] = bytes(start, at)? else { return None };
        match marker {
            0xff => at += 1,
            // Frames: all of 0xc0 to 0xcf but tables and an extension.
            0xc0..=0xcf if !matches!(marker, 0xc4 | 0xc8 | 0xcc) => {
                let [_, h1, h0, w1, w0, channels]: [u8; 6] = bytes(start, at + 4)?;
                let [height, width] = [[h1, h0], [w1, w0]].map(|b| u64::from(u16::from_be_bytes(b)));
                // In Huffman codes a block of 8x8 takes a bit at least.
                let least = if marker <= 0xc2 { width.div_ceil(8) * height.div_ceil(8) / 8 } else { 0 };
                let channels = u64::from(channels);
                return Some(Claim { width, height, channels, pixel: channels.max(3), least });
            }
            _ => at += 2 + usize::from(u16::from_be_bytes([high, low])),
        }
    }
}

fn bmp(start: &[u8]) -> Option<Claim> {
    let old = little(start, 14)? == 12;
    let (width, height, depth, compression) = if old {
        (little_16(start, 18)?, little_16(start, 20)?, little_16(start, 24)?, 0)
    } else {
        let [width, height] = [18, 22].map(|at| little(start, at).map(i64::unsigned_abs));
        (width?, height?, little_16(start, 28)?, little(start, 30)?)
    };
    let stored = (width * depth).div_ceil(8).saturating_mul(height);
    // Runs may leave any number of pixels out.
    let least = if matches!(compression, 1 | 2) { 0 } else { stored };
    Some(Claim { width, height, channels: 4, pixel: 4, least })
}

fn tga(start: &[u8]) -> Option<Claim> {
    let (width, height) = (little_16(start, 12)?, little_16(start, 14)?);
    let ([kind], [depth]) = (bytes(start, 2)?, bytes(start, 16)?);
    let (pixels, size) = (width * height, u64::from(depth).div_ceil(8));
    let least = if kind >= 9 { pixels / 128 * (1 + size) } else { pixels * size };
    Some(Claim { width, height, channels: 4, pixel: 4, least })
}

fn hdr(start: &[u8]) -> Option<Claim> {
    // Lines up to an empty one, then the resolution: "-Y 480 +X 640".
    let end = start.windows(2).position(|w| w == b"\n\n")?;
    let line = start[end + 2..].split(|b| *b == b'\n').next()?;
    let words: Vec<&str> = str::from_utf8(line).ok()?.split_whitespace().collect();
    let [_, first, second, width] = words[..] else { return None };
    let (mut height, mut width): (u64, u64) = (first.parse().ok()?, width.parse().ok()?);
    if second.ends_with('Y') {
        std::mem::swap(&mut width, &mut height);
    }
    // A row in runs has a word before it, and in each of four channels at least two bytes for 127 pixels.
    let row = if (8..32768).contains(&width) { 4 + 8 * width.div_ceil(127) } else { 4 };
    Some(Claim { width, height, channels: 3, pixel: 12, least: height.saturating_mul(row) })
}

/// Of several parts the sum, on the area of the largest.
fn open_exr(start: &[u8]) -> Option<Claim> {
    let version = little(start, 4)?;
    let several = version & 0x1000 != 0;
    let mut at = 8;
    let mut whole: Option<Claim> = None;
    loop {
        let part;
        (part, at) = exr_part(start, at)?;
        whole = Some(whole.map_or(part, |sum| add(sum, part)));
        if !several || start.get(at) == Some(&0) {
            return whole;
        }
    }
}

fn add(a: Claim, b: Claim) -> Claim {
    let larger = if a.width.saturating_mul(a.height) >= b.width.saturating_mul(b.height) { a } else { b };
    Claim {
        channels: a.channels.saturating_add(b.channels),
        pixel: a.pixel.saturating_add(b.pixel),
        least: a.least.saturating_add(b.least),
        ..larger
    }
}

/// A part's header from `at` on, and where it ends.
fn exr_part(start: &[u8], mut at: usize) -> Option<(Claim, usize)> {
    let text = |from: usize| {
        let length = start.get(from..)?.iter().position(|b| *b == 0)?;
        Some((&start[from..from + length], from + length + 1))
    };
    let (mut claim, mut compression, mut tile) = (Claim::default(), 0, None);
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
                (claim.width, claim.height) = (side(0)?.unsigned_abs(), side(4)?.unsigned_abs());
            }
            b"channels" => {
                let mut entry = value;
                while let Some((_, kind)) = text(entry).filter(|(name, _)| !name.is_empty() && entry < at) {
                    claim.channels += 1;
                    claim.pixel += if little(start, kind)? == 1 { 2 } else { 4 };
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
    claim.least = exr_least(&claim, compression, tile);
    Some((claim, at))
}

/// Bytes of a part at least: a place in the table and a head for every chunk, and what compression cannot bring the pixels below.
fn exr_least(claim: &Claim, compression: u8, tile: Option<[u64; 2]>) -> u64 {
    let Claim { width, height, pixel, .. } = *claim;
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
        2 | 3 => stored / DEFLATE,
        // 24 bits of 32 are stored.
        5 => stored / (2 * DEFLATE),
        _ => 0,
    };
    chunks.saturating_add(data)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::{Compression, Image, WriteOptions, write};
    use crate::memory::Limit;

    fn size(claim: Option<Claim>) -> Option<[u64; 4]> {
        claim.map(|c| [c.width, c.height, c.channels, c.pixel])
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
            let claim = claim(Format::OpenExr, &bytes);
            assert_eq!(size(claim), Some([300, 200, 4, 16]), "{compression:?}");
            assert!(claim.unwrap().least <= bytes.len() as u64, "{compression:?}: {claim:?}");
        }
        for (name, format, pixel) in [("a.png", Format::Png, 4), ("a.jpg", Format::Jpeg, 3)] {
            let path = folder.path().join(name);
            write(&path, &image, &WriteOptions::default()).unwrap();
            let bytes = std::fs::read(&path).unwrap();
            let claim = claim(format, &bytes);
            assert_eq!(size(claim).map(|[w, h, _, pixel]| [w, h, pixel]), Some([300, 200, pixel]), "{name}");
            assert!(claim.unwrap().least <= bytes.len() as u64, "{name}: {claim:?}");
        }
    }

    #[test]
    fn other_headers_are_understood() {
        let hdr = |text: &str| size(claim(Format::Hdr, text.as_bytes()));
        assert_eq!(hdr("#?RADIANCE\nA=1\n\n-Y 480 +X 640\nxyz"), Some([640, 480, 3, 12]));
        assert_eq!(hdr("#?RADIANCE\n\n+X 640 -Y 480\n"), Some([640, 480, 3, 12]));
        assert_eq!(hdr("#?RADIANCE\n\n-Y 480\n"), None);
        let mut bmp = [0; 54];
        (bmp[14], bmp[18], bmp[28]) = (40, 7, 24);
        bmp[22..26].copy_from_slice(&(-3i32).to_le_bytes());
        assert_eq!(claim(Format::Bmp, &bmp).map(|c| [c.width, c.height, c.least]), Some([7, 3, 63]));
        bmp[30] = 1;
        assert_eq!(claim(Format::Bmp, &bmp).map(|c| c.least), Some(0));
        let mut tga = [0; 18];
        (tga[2], tga[12], tga[14], tga[16]) = (2, 5, 4, 32);
        assert_eq!(claim(Format::Tga, &tga).map(|c| [c.width, c.height, c.least]), Some([5, 4, 80]));
        for format in [Format::OpenExr, Format::Png, Format::Jpeg, Format::Bmp, Format::Tga, Format::Hdr] {
            assert_eq!(claim(format, &[0xff; 12]), None, "{}", format.name());
            assert_eq!(claim(format, &[]), None, "{}", format.name());
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
        let admitted = |side| admit(Format::Bmp, &header(side), 54, Purpose::Texture, &memory);
        assert!(admitted(1000).is_ok());
        let Err(Denied::Damaged(why)) = admitted(10_000) else { panic!("10000x10000 pixels in 54 bytes") };
        assert_eq!(why, "expected at least 300000000 bytes for 10000x10000 pixels, found 54 bytes");
    }
}
