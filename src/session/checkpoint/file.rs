//! The file format of checkpoints.
//!
//! The file begins with `BUFFONCP`, the version and the length of the header in bytes (u32 each, little-endian like
//! all numbers). The header is JSON: the identity of the render, the description of its image, and its progress. Then
//! follow the sums of the tiles, row by row, and the distribution of samples if adaptive sampling has started. The
//! CRC-32 of everything before it ends the file.

use super::{Checkpoint, CheckpointLabel, Identity};
use crate::error::{Error, Result};
use crate::estimate::replicates::MAX_REPLICATES;
use crate::film::{ComponentFormat, PixelFormat, PixelRect, Tile};
use crate::integrator::Counters;
use crate::integrator::settings::{Aov, Layer};
use crate::render::tracing::InvalidSample;
use crate::render::{Allocation, RenderState};
use crate::session::ImageDescription;
use crate::util::replace_with;
use serde::{Deserialize, Serialize};
use std::fs::File;
use std::io::{self, BufReader, Read, Write};
use std::path::Path;
use std::time::Duration;

const MAGIC: [u8; 8] = *b"BUFFONCP";
const VERSION: u32 = 2;
/// The greatest length of a header in bytes.
const LONGEST_HEADER: u32 = 1 << 20;
/// The number of bytes before the header.
const PREFIX: u64 = 16;
const CHECKSUM: u64 = 4;
/// The greatest side of an image in pixels.
const LONGEST_SIDE: u32 = 1 << 20;

#[derive(Serialize, Deserialize)]
struct Header {
    identity: Identity,
    rect: [u32; 4],
    pixel_format: String,
    component_format: String,
    /// The names and contents of the layers.
    layers: Vec<[String; 2]>,
    camera: [[f32; 16]; 2],
    replicates: usize,
    samples: Vec<[u64; 2]>,
    target: Option<u64>,
    /// The samples per pixel of the pilot of adaptive sampling, if it is complete.
    pilot: Option<u64>,
    next: u64,
    pass_end: u64,
    elapsed: Duration,
    counters: Counters,
    invalid: Vec<InvalidSampleRecord>,
    invalid_count: u64,
}

/// A dropped sample. Its value is stored as bits, because JSON has no NaN.
#[derive(Serialize, Deserialize)]
struct InvalidSampleRecord {
    pixel: [u32; 2],
    sample: u64,
    value_bits: [u32; 3],
}

/// Writes a checkpoint. A failed write leaves no partial file.
///
/// # Errors
/// If the file cannot be written.
pub fn save(path: &Path, label: &CheckpointLabel, state: &RenderState) -> Result<()> {
    let header = Header::of(label, state);
    let header =
        serde_json::to_vec(&header).map_err(|e| Error::internal(format!("a checkpoint's header: {e}")))?;
    replace_with(path, |file| {
        let mut file = ChecksummedFile { file, checksum: crc32fast::Hasher::new() };
        file.write_all(&MAGIC)?;
        file.write_all(&VERSION.to_le_bytes())?;
        file.write_all(&(header.len() as u32).to_le_bytes())?;
        file.write_all(&header)?;
        for tile in &state.tiles {
            file.write_all(&tile.to_bytes())?;
        }
        if let Some(allocation) = &state.allocation {
            file.write_all(&allocation.to_bytes())?;
        }
        let ChecksummedFile { file, checksum } = file;
        file.write_all(&checksum.finalize().to_le_bytes())
    })
}

/// Reads a checkpoint.
///
/// # Errors
/// If the file cannot be read, is not a checkpoint, is damaged, or was written by another version.
pub fn load(path: &Path) -> Result<Checkpoint> {
    let bad = |why: &str| Error::output(why).in_file(path).about("checkpoint");
    let unreadable = |e: io::Error| bad(&format!("cannot be read: {e}"));
    let file = File::open(path).map_err(unreadable)?;
    let size = file.metadata().map_err(unreadable)?.len();
    let mut file = ChecksummedFile { file: BufReader::new(file), checksum: crc32fast::Hasher::new() };
    let (header, header_length) = read_header(&mut file, size).map_err(|why| bad(&why))?;
    let image_description = header.image_description().map_err(|why| bad(&why))?;
    let channels = image_description.channels();
    let pixels = image_description.rect.area();
    let allocation_bytes = if header.pilot.is_some() { Allocation::byte_count(pixels) } else { 0 };
    let expected = u128::from(pixels) * Tile::bytes_per_pixel(channels, header.replicates) as u128
        + u128::from(PREFIX + header_length + allocation_bytes + CHECKSUM);
    if u128::from(size) != expected {
        return Err(bad(&format!("is damaged: it has {size} bytes, expected {expected}")));
    }
    let damaged = || bad("is damaged: its numbers are those of no render");
    let mut state = RenderState::new(image_description.rect, channels, header.replicates, header.next);
    let mut bytes = Vec::new();
    for tile in &mut state.tiles {
        bytes.resize(tile.pixel_count() * Tile::bytes_per_pixel(channels, header.replicates), 0);
        file.read_exact(&mut bytes).map_err(unreadable)?;
        if !tile.set_bytes(&bytes) {
            return Err(damaged());
        }
    }
    if let Some(pilot) = header.pilot {
        bytes.resize(allocation_bytes as usize, 0);
        file.read_exact(&mut bytes).map_err(unreadable)?;
        state.allocation =
            Some(Allocation::from_bytes(&bytes, image_description.rect, pilot).ok_or_else(damaged)?);
    }
    let ChecksummedFile { mut file, checksum } = file;
    let mut sum = [0; CHECKSUM as usize];
    file.read_exact(&mut sum).map_err(unreadable)?;
    if checksum.finalize() != u32::from_le_bytes(sum) {
        return Err(bad("is damaged: its checksum is not that of its bytes"));
    }
    Ok(header.checkpoint(image_description, state))
}

/// Returns whether a file begins with the identifier of checkpoints.
pub fn is_checkpoint(path: &Path) -> bool {
    let mut magic = [0; MAGIC.len()];
    File::open(path).and_then(|mut file| file.read_exact(&mut magic)).is_ok() && magic == MAGIC
}

/// Reads the header. Returns it with its length in bytes.
fn read_header(file: &mut impl Read, size: u64) -> Result<(Header, u64), String> {
    let mut prefix = [0; PREFIX as usize];
    let short = || "ends before its header does".to_string();
    file.read_exact(&mut prefix).map_err(|_| "is no checkpoint".to_string())?;
    let word = |at: usize| u32::from_le_bytes(std::array::from_fn(|i| prefix[at + i]));
    if prefix[..8] != MAGIC {
        return Err("is no checkpoint".into());
    }
    if word(8) != VERSION {
        return Err(format!("has version {}, expected {VERSION}", word(8)));
    }
    let length = word(12);
    if length > LONGEST_HEADER || u64::from(length) > size {
        return Err(short());
    }
    let mut bytes = vec![0; length as usize];
    file.read_exact(&mut bytes).map_err(|_| short())?;
    let header = serde_json::from_slice(&bytes).map_err(|e| format!("is damaged: its header: {e}"))?;
    Ok((header, u64::from(length)))
}

impl Header {
    fn of(label: &CheckpointLabel, state: &RenderState) -> Self {
        let CheckpointLabel { identity, image_description, samples, target } = label;
        let PixelRect { x, y, width, height } = image_description.rect;
        let layer = |layer: &Layer| [layer.name.clone(), layer.aov.name().into()];
        let invalid = |s: &InvalidSample| InvalidSampleRecord {
            pixel: [s.x, s.y],
            sample: s.sample,
            value_bits: s.value.map(f32::to_bits),
        };
        Header {
            identity: identity.clone(),
            rect: [x, y, width, height],
            pixel_format: name_of(&PixelFormat::NAMES, image_description.pixel_format),
            component_format: name_of(&ComponentFormat::NAMES, image_description.component_format),
            layers: image_description.layers.iter().map(layer).collect(),
            camera: image_description.camera,
            replicates: state.tiles.first().map_or(0, Tile::replicates),
            samples: samples.iter().map(|range| [range.start, range.end]).collect(),
            target: *target,
            pilot: state.allocation.as_ref().map(Allocation::pilot),
            next: state.next,
            pass_end: state.pass_end,
            elapsed: state.elapsed,
            counters: state.counters,
            invalid: state.invalid.iter().map(invalid).collect(),
            invalid_count: state.invalid_count,
        }
    }

    fn image_description(&self) -> Result<ImageDescription, String> {
        let damaged = |what: &str| format!("is damaged: its header has {what}");
        let [x, y, width, height] = self.rect;
        let sides = 1..=LONGEST_SIDE;
        if !sides.contains(&width) || !sides.contains(&height) || x > LONGEST_SIDE || y > LONGEST_SIDE {
            return Err(damaged("an image of impossible size"));
        }
        if !(2..=MAX_REPLICATES).contains(&self.replicates) || !self.replicates.is_power_of_two() {
            return Err(damaged("an impossible number of replicates"));
        }
        let mut layers = Vec::new();
        for [name, aov] in &self.layers {
            let aov = Aov::by_name(aov).ok_or_else(|| damaged("a layer of unknown content"))?;
            layers.push(Layer { name: name.clone(), aov });
        }
        let ordered = self.samples.iter().flatten().is_sorted_by(|a, b| a <= b);
        if !ordered || self.samples.iter().any(|[start, end]| start >= end) {
            return Err(damaged("samples in no order"));
        }
        if self.pass_end < self.next || self.samples.last().is_some_and(|last| last[1] != self.next) {
            return Err(damaged("a pass that ends before it begins"));
        }
        Ok(ImageDescription {
            rect: PixelRect { x, y, width, height },
            pixel_format: named(&PixelFormat::NAMES, &self.pixel_format)
                .ok_or_else(|| damaged("an unknown pixel format"))?,
            component_format: named(&ComponentFormat::NAMES, &self.component_format)
                .ok_or_else(|| damaged("an unknown component format"))?,
            layers,
            camera: self.camera,
            integrator: self.identity.integrator.clone(),
            seed: self.identity.seed,
        })
    }

    fn checkpoint(self, image_description: ImageDescription, sums: RenderState) -> Checkpoint {
        let invalid = |s: &InvalidSampleRecord| InvalidSample {
            x: s.pixel[0],
            y: s.pixel[1],
            sample: s.sample,
            value: s.value_bits.map(f32::from_bits),
        };
        Checkpoint {
            label: CheckpointLabel {
                identity: self.identity,
                image_description,
                samples: self.samples.iter().map(|&[start, end]| start..end).collect(),
                target: self.target,
            },
            state: RenderState {
                pass_end: self.pass_end,
                elapsed: self.elapsed,
                counters: self.counters,
                invalid: self.invalid.iter().map(invalid).collect(),
                invalid_count: self.invalid_count,
                ..sums
            },
        }
    }
}

fn name_of<T: PartialEq>(names: &[(&str, T)], value: T) -> String {
    names.iter().find(|(_, v)| *v == value).map_or_else(String::new, |(name, _)| (*name).into())
}

fn named<T: Copy>(names: &[(&str, T)], name: &str) -> Option<T> {
    names.iter().find(|(n, _)| *n == name).map(|(_, value)| *value)
}

/// A file with a checksum of the bytes read from it or written to it.
struct ChecksummedFile<F> {
    file: F,
    checksum: crc32fast::Hasher,
}

impl<F: Write> Write for ChecksummedFile<F> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let written = self.file.write(bytes)?;
        self.checksum.update(&bytes[..written]);
        Ok(written)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.file.flush()
    }
}

impl<F: Read> Read for ChecksummedFile<F> {
    fn read(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
        let read = self.file.read(bytes)?;
        self.checksum.update(&bytes[..read]);
        Ok(read)
    }
}
