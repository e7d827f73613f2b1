//! The file format of checkpoints.
//!
//! The file begins with `BUFFONCP`, the version and the length of the header in bytes (u32 each, little-endian like
//! all numbers). The header is JSON: the identity of the render, the description of its image, and its progress. Then
//! follow the sums of the tiles, row by row. The CRC-32 of everything before it ends the file.

use super::{Checkpoint, CheckpointLabel, Identity};
use crate::error::{Error, Result};
use crate::estimate::replicates::MAX_REPLICATES;
use crate::film::{ComponentFormat, PixelFormat, PixelRect, Tile};
use crate::integrator::Counters;
use crate::integrator::settings::{Aov, Layer};
use crate::render::RenderState;
use crate::render::tracing::InvalidSample;
use crate::session::ImageDescription;
use crate::util::container::Format;
use crate::util::named;
use serde::{Deserialize, Serialize};
use std::path::Path;
use std::time::Duration;

const FORMAT: Format = Format { magic: *b"BUFFONCP", version: 4, name: "a checkpoint" };
/// No side of an image is longer.
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
    /// As bits, because JSON is read with a rounding error.
    #[serde(default)]
    squared_bias_bits: Option<u64>,
    replicates: usize,
    samples: Vec<[u64; 2]>,
    target: Option<u64>,
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
    FORMAT.save(path, &Header::of(label, state), |body| {
        state.tiles.iter().try_for_each(|tile| body.write_all(&tile.to_bytes()))
    })
}

/// Reads a checkpoint.
///
/// # Errors
/// If the file cannot be read, is not a checkpoint, is damaged, or was written by another version.
pub fn load(path: &Path) -> Result<Checkpoint> {
    read(path).map_err(|why| damaged(path, why))
}

/// Reads the description of a checkpoint without its sums. Its checksum is not verified.
///
/// # Errors
/// As for [`load`].
pub fn label(path: &Path) -> Result<CheckpointLabel> {
    let read = || {
        let (header, _) = FORMAT.open::<Header>(path)?;
        let image_description = header.image_description()?;
        Ok(header.label(image_description))
    };
    read().map_err(|why| damaged(path, why))
}

/// Returns the error of a file that is no checkpoint.
fn damaged(path: &Path, why: String) -> Error {
    Error::output(why).in_file(path).about("checkpoint")
}

fn read(path: &Path) -> Result<Checkpoint, String> {
    let (header, mut body) = FORMAT.open::<Header>(path)?;
    let image_description = header.image_description()?;
    let (channels, pixels) = (image_description.channels(), image_description.rect.area());
    let tile_bytes = pixels.checked_mul(Tile::bytes_per_pixel(channels, header.replicates) as u64);
    body.expect_length(tile_bytes)?;
    let damaged = || "is damaged: its sums are invalid".to_string();
    let mut state = RenderState::new(image_description.rect, channels, header.replicates, header.next);
    let mut bytes = Vec::new();
    for tile in &mut state.tiles {
        bytes.resize(tile.pixel_count() * Tile::bytes_per_pixel(channels, header.replicates), 0);
        body.read(&mut bytes)?;
        if !tile.set_bytes(&bytes) {
            return Err(damaged());
        }
    }
    body.finish()?;
    Ok(header.checkpoint(image_description, state))
}

/// Returns whether a file begins with the identifier of checkpoints.
pub fn is_checkpoint(path: &Path) -> bool {
    FORMAT.is_of(path)
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
            squared_bias_bits: image_description.squared_bias.map(f64::to_bits),
            replicates: state.tiles.first().map_or(0, Tile::replicates),
            samples: samples.iter().map(|range| [range.start, range.end]).collect(),
            target: *target,
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
            return Err(damaged("ranges of samples that are not in order"));
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
            squared_bias: self.squared_bias_bits.map(f64::from_bits),
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
        let state = RenderState {
            pass_end: self.pass_end,
            elapsed: self.elapsed,
            counters: self.counters,
            invalid: self.invalid.iter().map(invalid).collect(),
            invalid_count: self.invalid_count,
            ..sums
        };
        Checkpoint { label: self.label(image_description), state }
    }

    fn label(self, image_description: ImageDescription) -> CheckpointLabel {
        CheckpointLabel {
            identity: self.identity,
            image_description,
            samples: self.samples.iter().map(|&[start, end]| start..end).collect(),
            target: self.target,
        }
    }
}

fn name_of<T: PartialEq>(names: &[(&str, T)], value: T) -> String {
    names.iter().find(|(_, v)| *v == value).map_or_else(String::new, |(name, _)| (*name).into())
}
