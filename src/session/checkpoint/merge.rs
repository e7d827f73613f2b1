//! Merging of checkpoints: the sums of several parts of a render become those of the whole render.

use super::{Checkpoint, file, list};
use crate::error::{Error, Result};
use crate::integrator::settings::WhenPays;
use crate::render::{Rendered, StopReason};
use crate::session::plan::states_variances;
use std::ops::Range;
use std::path::{Path, PathBuf};

/// Adds checkpoints of one render, in any order. No more than two are in memory.
///
/// # Errors
/// If a file cannot be read, they belong to different renders, or two have the same samples.
pub fn merge(paths: &[PathBuf]) -> Result<Checkpoint> {
    let Some((first_path, others)) = paths.split_first() else {
        return Err(Error::usage("merge: expected files to merge"));
    };
    let mut sum = file::load(first_path)?;
    let held = |part: &Checkpoint, path: &Path| {
        part.label.samples.iter().map(|range| (range.clone(), path.to_owned())).collect::<Vec<_>>()
    };
    let mut all: Vec<(Range<u64>, PathBuf)> = held(&sum, first_path);
    for path in others {
        let part = file::load(path)?;
        comparable(first_path, &sum, path, &part)?;
        let new = held(&part, path);
        for (range, _) in &new {
            if let Some((other, file)) = all.iter().find(|(r, _)| r.start < range.end && range.start < r.end)
            {
                let [ours, theirs] = [range, other].map(|range| list(std::slice::from_ref(range)));
                let why = format!("has the samples {ours}; {} also has {theirs}", file.display());
                return Err(refuse(path, &why));
            }
        }
        all.extend(new);
        add(&mut sum, part);
    }
    sum.label.samples = joined(all.into_iter().map(|(range, _)| range).collect());
    let end = sum.label.samples.last().map_or(0, |range| range.end);
    (sum.state.next, sum.state.pass_end) = (end, end);
    Ok(sum)
}

fn refuse(path: &Path, why: &str) -> Error {
    Error::usage(format!("merge: {} {why}", path.display()))
}

/// Checks that two parts can be added.
fn comparable(first_path: &Path, first: &Checkpoint, path: &Path, part: &Checkpoint) -> Result<()> {
    if let Some(difference) = part.label.identity.difference(&first.label.identity) {
        return Err(refuse(path, &format!("has {difference} as in {}", first_path.display())));
    }
    if part.label.image_description.rect != first.label.image_description.rect
        || part.label.image_description.layers != first.label.image_description.layers
    {
        return Err(refuse(path, &format!("belongs to another image than {}", first_path.display())));
    }
    Ok(())
}

fn add(sum: &mut Checkpoint, part: Checkpoint) {
    let (state, other) = (&mut sum.state, part.state);
    state.tiles.iter_mut().zip(&other.tiles).for_each(|(tile, other)| tile.merge(other));
    state.elapsed += other.elapsed;
    state.counters.merge(&other.counters);
    state.invalid.extend(other.invalid);
    state.invalid.sort_by_key(|s| (s.y, s.x, s.sample));
    state.invalid_count += other.invalid_count;
    sum.label.target = sum.label.target.max(part.label.target);
}

/// Joins adjacent ranges of samples, in order.
fn joined(mut ranges: Vec<Range<u64>>) -> Vec<Range<u64>> {
    ranges.sort_by_key(|range| range.start);
    let mut joined: Vec<Range<u64>> = Vec::new();
    for range in ranges {
        match joined.last_mut() {
            Some(last) if last.end == range.start => last.end = range.end,
            _ => joined.push(range),
        }
    }
    joined
}

impl Checkpoint {
    /// Returns the samples of 0..target that are missing, if the target is known.
    pub fn missing(&self) -> Vec<Range<u64>> {
        let mut from = 0;
        let mut missing = Vec::new();
        let end = self.label.target.unwrap_or(0);
        for range in &self.label.samples {
            if from < range.start.min(end) {
                missing.push(from..range.start.min(end));
            }
            from = range.end;
        }
        if from < end {
            missing.push(from..end);
        }
        missing
    }

    /// Returns the render of the sums, with its error estimate.
    ///
    /// # Errors
    /// If threads cannot be started.
    pub fn rendered(&self, threads: usize) -> Result<Rendered> {
        let pool = crate::render::thread_pool(threads)?;
        let error = crate::render::state::estimate(&self.state.tiles, &pool);
        let layers = self.label.image_description.layers.clone();
        let alpha = self.label.image_description.pixel_format.has_alpha();
        let rendered = Rendered::new(self.state.clone(), self.label.image_description.rect, layers, alpha);
        let taken: u64 = self.label.samples.iter().map(|range| range.end - range.start).sum();
        let whole = self.label.target.is_some() && self.missing().is_empty();
        let description = &self.label.image_description;
        Ok(Rendered {
            // A checkpoint does not say whether the pilot chose reuse.
            reuses_paths: ["path", "volpath"].contains(&description.integrator.as_str())
                && !states_variances(&description.layers),
            samples_per_pixel: if self.label.identity.adaptive != WhenPays::Never {
                rendered.samples_per_pixel
            } else {
                taken
            },
            stop_reason: if whole { StopReason::Samples } else { StopReason::Interrupted },
            relmse: error.map(|e| e.relmse),
            relmse_interval: error.map(|e| e.interval),
            ..rendered
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranges_are_joined_where_they_meet() {
        assert_eq!(joined(vec![8..16, 0..4, 4..8, 20..24]), [0..16, 20..24]);
        assert_eq!(joined(Vec::new()), []);
    }
}
