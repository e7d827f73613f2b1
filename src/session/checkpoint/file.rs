//! Checkpoints in a file.
//!
//! The file begins with `BUFFONCP`, the version and the length of the header in bytes (u32 each, little-endian as all
//! numbers). The header is JSON: whose samples these are, what image they make, where the render stands. Then the sums
//! of the tiles follow, row by row, and how adaptive sampling spreads the samples, if it has begun to; at the end the CRC-32
//! of everything before it.

use super::{Checkpoint, Identity, Label};
use crate::error::{Error, Result};
use crate::estimate::replicates::MAX_REPLICATES;
use crate::film::{ComponentFormat, PixelFormat, PixelRect, Tile};
use crate::integrator::Counters;
use crate::integrator::settings::{Aov, Layer};
use crate::render::tracing::InvalidSample;
use crate::render::{Allocation, State};
use crate::session::Picture;
use crate::util::replace_with;
use serde::{Deserialize, Serialize};
use std::fs::File;
use std::io::{self, BufReader, Read, Write};
use std::path::Path;
use std::time::Duration;

const MAGIC: [u8; 8] = *b"BUFFONCP";
const VERSION: u32 = 2;
/// No header is longer.
const LONGEST_HEADER: u32 = 1 << 20;
/// Bytes before the header.
const PREFIX: u64 = 16;
const CHECKSUM: u64 = 4;
/// No side of an image is longer.
const LONGEST_SIDE: u32 = 1 << 20;

#[derive(Serialize, Deserialize)]
struct Header {
    identity: Identity,
    rect: [u32; 4],
    pixel_format: String,
    component_format: String,
    /// Names and what they hold.
    layers: Vec<[String; 2]>,
    camera: [[f32; 16]; 2],
    replicates: usize,
    samples: Vec<[u64; 2]>,
    target: Option<u64>,
    /// Samples per pixel of adaptive sampling's pilot, if it is over.
    pilot: Option<u64>,
    next: u64,
    pass_end: u64,
    elapsed: Duration,
    counters: Counters,
    invalid: Vec<Invalid>,
    invalid_count: u64,
}

/// A dropped sample; its value in bits, because JSON has no NaN.
#[derive(Serialize, Deserialize)]
struct Invalid {
    pixel: [u32; 2],
    sample: u64,
    value_bits: [u32; 3],
}

/// Writes a checkpoint, whole or not at all.
///
/// # Errors
/// If the file cannot be written.
pub fn save(path: &Path, label: &Label, state: &State) -> Result<()> {
    let header = Header::of(label, state);
    let header =
        serde_json::to_vec(&header).map_err(|e| Error::internal(format!("a checkpoint's header: {e}")))?;
    replace_with(path, |file| {
        let mut file = Checked { file, checksum: crc32fast::Hasher::new() };
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
        let Checked { file, checksum } = file;
        file.write_all(&checksum.finalize().to_le_bytes())
    })
}

/// Reads a checkpoint.
///
/// # Errors
/// If the file cannot be read, is none, is damaged, or if another version has written it.
pub fn load(path: &Path) -> Result<Checkpoint> {
    let bad = |why: &str| Error::output(why).in_file(path).about("checkpoint");
    let unreadable = |e: io::Error| bad(&format!("cannot be read: {e}"));
    let file = File::open(path).map_err(unreadable)?;
    let size = file.metadata().map_err(unreadable)?.len();
    let mut file = Checked { file: BufReader::new(file), checksum: crc32fast::Hasher::new() };
    let (header, header_length) = read_header(&mut file, size).map_err(|why| bad(&why))?;
    let picture = header.picture().map_err(|why| bad(&why))?;
    let channels = picture.channels();
    let pixels = picture.rect.area();
    let allocation_bytes = if header.pilot.is_some() { Allocation::byte_count(pixels) } else { 0 };
    let expected = u128::from(pixels) * Tile::bytes_per_pixel(channels, header.replicates) as u128
        + u128::from(PREFIX + header_length + allocation_bytes + CHECKSUM);
    if u128::from(size) != expected {
        return Err(bad(&format!("is damaged: it has {size} bytes, expected {expected}")));
    }
    let damaged = || bad("is damaged: its numbers are those of no render");
    let mut state = State::new(picture.rect, channels, header.replicates, header.next);
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
        state.allocation = Some(Allocation::from_bytes(&bytes, picture.rect, pilot).ok_or_else(damaged)?);
    }
    let Checked { mut file, checksum } = file;
    let mut sum = [0; CHECKSUM as usize];
    file.read_exact(&mut sum).map_err(unreadable)?;
    if checksum.finalize() != u32::from_le_bytes(sum) {
        return Err(bad("is damaged: its checksum is not that of its bytes"));
    }
    Ok(header.checkpoint(picture, state))
}

/// Whether a file is a checkpoint, as far as its first bytes say.
pub fn is_checkpoint(path: &Path) -> bool {
    let mut magic = [0; MAGIC.len()];
    File::open(path).and_then(|mut file| file.read_exact(&mut magic)).is_ok() && magic == MAGIC
}

/// The header and its length in bytes.
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
    fn of(label: &Label, state: &State) -> Self {
        let Label { identity, picture, samples, target } = label;
        let PixelRect { x, y, width, height } = picture.rect;
        let layer = |layer: &Layer| [layer.name.clone(), layer.aov.name().into()];
        let invalid = |s: &InvalidSample| Invalid {
            pixel: [s.x, s.y],
            sample: s.sample,
            value_bits: s.value.map(f32::to_bits),
        };
        Header {
            identity: identity.clone(),
            rect: [x, y, width, height],
            pixel_format: name_of(&PixelFormat::NAMES, picture.pixel_format),
            component_format: name_of(&ComponentFormat::NAMES, picture.component_format),
            layers: picture.layers.iter().map(layer).collect(),
            camera: picture.camera,
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

    fn picture(&self) -> Result<Picture, String> {
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
        Ok(Picture {
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

    fn checkpoint(self, picture: Picture, sums: State) -> Checkpoint {
        let invalid = |s: &Invalid| InvalidSample {
            x: s.pixel[0],
            y: s.pixel[1],
            sample: s.sample,
            value: s.value_bits.map(f32::from_bits),
        };
        Checkpoint {
            label: Label {
                identity: self.identity,
                picture,
                samples: self.samples.iter().map(|&[start, end]| start..end).collect(),
                target: self.target,
            },
            state: State {
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

/// A file whose bytes are summed as they pass.
struct Checked<F> {
    file: F,
    checksum: crc32fast::Hasher,
}

impl<F: Write> Write for Checked<F> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let written = self.file.write(bytes)?;
        self.checksum.update(&bytes[..written]);
        Ok(written)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.file.flush()
    }
}

impl<F: Read> Read for Checked<F> {
    fn read(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
        let read = self.file.read(bytes)?;
        self.checksum.update(&bytes[..read]);
        Ok(read)
    }
}
