//! Checkpoints: what a render has summed, in a file from which it can go on, and whose sums can be added to others.
//!
//! A checkpoint says which samples of which render it holds ([`Identity`]). Renders go on from their own only, and only
//! sums of one render are merged. Sums do not depend on how samples were grouped ([`Sum`](crate::math::Sum)), so that a
//! render that was stopped and gone on with, or split over machines and merged, has the very pixels of an
//! uninterrupted one.

pub mod file;
mod identity;
pub mod merge;

pub use identity::Identity;

use super::Picture;
use crate::error::{Error, Result};
use crate::render::State;
use std::ops::Range;
use std::path::Path;

/// What a checkpoint says of its sums.
#[derive(Clone, Debug)]
pub struct Label {
    /// Which render it is.
    pub identity: Identity,
    /// The image that its sums are of.
    pub picture: Picture,
    /// Which samples of each pixel the sums hold: ranges that do not meet, in their order. With adaptive sampling,
    /// which on average.
    pub samples: Vec<Range<u64>>,
    /// How many samples per pixel the whole render is to have, if that is known.
    pub target: Option<u64>,
}

/// Some of the samples of a render.
#[derive(Clone, Debug)]
pub struct Checkpoint {
    /// What it is.
    pub label: Label,
    /// The sums, and where the render stands.
    pub state: State,
}

impl Checkpoint {
    /// The state to go on from, if it is of this render, of the range of samples that begins with `first`, and if that
    /// ends at `end` or before.
    ///
    /// # Errors
    /// If it is not; the message names the file.
    pub fn resume(self, path: &Path, identity: &Identity, first: u64, end: Option<u64>) -> Result<State> {
        let refuse = |why: String| Err(Error::usage(format!("--resume {}: it {why}", path.display())));
        if let Some(difference) = self.label.identity.difference(identity) {
            return refuse(format!("holds {difference}; name another file, or remove it"));
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
                "has {has} samples per pixel, more than the {end} that are asked for; --spp {has} writes its picture"
            ));
        }
        Ok(self.state)
    }
}

/// "0..64, 128..192" for ranges of samples.
pub fn list(ranges: &[Range<u64>]) -> String {
    ranges.iter().map(|range| format!("{}..{}", range.start, range.end)).collect::<Vec<_>>().join(", ")
}
