//! Checkpoints in a file.
//!
//! A [container](crate::util::container). Its header says whose samples these are, what image they make and where the
//! render stands. Its body is the sums of the tiles, row by row, and then how adaptive sampling spreads the samples,
//! if it has begun to.

use super::{Checkpoint, Identity, Label};
use crate::error::{Error, Result};
use crate::estimate::replicates::MAX_REPLICATES;
use crate::film::{ComponentFormat, PixelFormat, PixelRect, Tile};
use crate::integrator::Counters;
use crate::integrator::settings::{Aov, Layer};
use crate::render::tracing::InvalidSample;
use crate::render::{Allocation, State};
use crate::session::Picture;
use crate::util::container::Format;
use serde::{Deserialize, Serialize};
use std::path::Path;
use std::time::Duration;

const FORMAT: Format = Format { magic: *b"BUFFONCP", version: 3, name: "a checkpoint" };
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
    FORMAT.save(path, &Header::of(label, state), |body| {
        for tile in &state.tiles {
            body.write_all(&tile.to_bytes())?;
        }
        match &state.allocation {
            Some(allocation) => body.write_all(&allocation.to_bytes()),
            None => Ok(()),
        }
    })
}

/// Reads a checkpoint.
///
/// # Errors
/// If the file cannot be read, is none, is damaged, or if another version has written it.
pub fn load(path: &Path) -> Result<Checkpoint> {
    read(path).map_err(|why| Error::output(why).in_file(path).about("checkpoint"))
}

fn read(path: &Path) -> Result<Checkpoint, String> {
    let (header, mut body) = FORMAT.open::<Header>(path)?;
    let picture = header.picture()?;
    let (channels, pixels) = (picture.channels(), picture.rect.area());
    let allocation_bytes = if header.pilot.is_some() { Allocation::byte_count(pixels) } else { 0 };
    let tile_bytes = pixels.checked_mul(Tile::bytes_per_pixel(channels, header.replicates) as u64);
    body.expect_length(tile_bytes.and_then(|bytes| bytes.checked_add(allocation_bytes)))?;
    let damaged = || "is damaged: its numbers are those of no render".to_string();
    let mut state = State::new(picture.rect, channels, header.replicates, header.next);
    let mut bytes = Vec::new();
    for tile in &mut state.tiles {
        bytes.resize(tile.pixel_count() * Tile::bytes_per_pixel(channels, header.replicates), 0);
        body.read(&mut bytes)?;
        if !tile.set_bytes(&bytes) {
            return Err(damaged());
        }
    }
    if let Some(pilot) = header.pilot {
        bytes.resize(allocation_bytes as usize, 0);
        body.read(&mut bytes)?;
        state.allocation = Some(Allocation::from_bytes(&bytes, picture.rect, pilot).ok_or_else(damaged)?);
    }
    body.finish()?;
    Ok(header.checkpoint(picture, state))
}

/// Whether a file is a checkpoint, as far as its first bytes say.
pub fn is_checkpoint(path: &Path) -> bool {
    FORMAT.is_of(path)
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
