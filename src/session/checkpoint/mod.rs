//! Checkpoints: files with the sums of a render, from which it can continue, and which can be merged.
//!
//! A checkpoint states the samples and the render to which it belongs ([`Identity`]). A render continues only from
//! its own checkpoint, and only sums of the same render are merged. Sums do not depend on the grouping of samples
//! ([`Sum`](crate::math::Sum)). A render that was stopped and continued, or split over machines and merged, therefore
//! has bit-identical pixels.

pub mod file;
mod identity;
pub mod merge;

pub use identity::Identity;

use super::ImageDescription;
use crate::error::{Error, Result};
use crate::film::PixelRect;
use crate::render::RenderState;
use std::ops::Range;
use std::path::Path;

/// The description of a checkpoint's sums.
#[derive(Clone, Debug)]
pub struct CheckpointLabel {
    /// The identity of the render.
    pub identity: Identity,
    /// The description of the image.
    pub image_description: ImageDescription,
    /// The samples of each pixel in the sums, as disjoint ranges in order. With adaptive sampling, the range of the
    /// average.
    pub samples: Vec<Range<u64>>,
    /// The samples per pixel of the complete render, if known.
    pub target: Option<u64>,
}

/// A part of the samples of a render.
#[derive(Clone, Debug)]
pub struct Checkpoint {
    /// The description.
    pub label: CheckpointLabel,
    /// The sums and the progress of the render.
    pub state: RenderState,
}

impl Checkpoint {
    /// Returns the state from which to continue, if it belongs to this render, to its region of the image and to the
    /// range of samples that begins with `first`, and if it ends at `end` or before.
    ///
    /// # Errors
    /// If it does not; the message names the file.
    pub fn resume(
        self,
        path: &Path,
        identity: &Identity,
        rect: PixelRect,
        first: u64,
        end: Option<u64>,
    ) -> Result<RenderState> {
        let refuse = |why: String| Err(Error::usage(format!("--resume {}: it {why}", path.display())));
        if let Some(difference) = self.label.identity.difference(identity) {
            return refuse(format!("has {difference}; choose another file, or remove it"));
        }
        let own = self.label.image_description.rect;
        if own != rect {
            return refuse(format!(
                "has the region {own}, expected {rect}; choose another file, or remove it"
            ));
        }
        let expected = Range { start: first, end: self.state.next };
        match self.label.samples.as_slice() {
            [] => {}
            [only] if *only == expected => {}
            ranges => {
                return refuse(format!("holds the samples {}, expected them from {first} on", list(ranges)));
            }
        }
        if end.is_some_and(|end| self.state.next > end) {
            let (has, end) = (self.state.next, end.unwrap_or_default());
            return refuse(format!(
                "has {has} samples per pixel, more than the requested {end}; use --spp {has} to write its image"
            ));
        }
        Ok(self.state)
    }
}

/// Formats ranges of samples: "0..64, 128..192", or "none".
pub fn list(ranges: &[Range<u64>]) -> String {
    if ranges.is_empty() {
        return "none".into();
    }
    ranges.iter().map(|range| format!("{}..{}", range.start, range.end)).collect::<Vec<_>>().join(", ")
}
