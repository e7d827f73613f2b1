//! Merging of checkpoints: the sums of several parts of a render become those of the whole render.

use super::{Checkpoint, CheckpointLabel, file, list};
use crate::error::{Error, Result};
use crate::film::PixelRect;
use crate::integrator::settings::WhenPays;
use crate::render::{RenderState, Rendered, StopReason};
use crate::session::plan::states_variances;
use std::ops::Range;
use std::path::{Path, PathBuf};

/// What a file has of a render, or several files of the same region.
struct Part<'a> {
    path: &'a Path,
    rect: PixelRect,
    samples: Vec<Range<u64>>,
}

/// Adds checkpoints of one render, in any order: ranges of its samples, regions of its image that make a rectangle, or
/// both. No more than two are in memory.
///
/// # Errors
/// If a file cannot be read, they belong to different renders, two have the same samples of a pixel, or some pixels
/// have samples that others lack.
pub fn merge(paths: &[PathBuf]) -> Result<Checkpoint> {
    let Some(first) = paths.first() else {
        return Err(Error::usage("merge: expected files to merge"));
    };
    let mut label = file::label(first)?;
    let mut parts = Vec::new();
    for path in paths {
        let other = file::label(path)?;
        comparable(first, &label, path, &other)?;
        label.target = label.target.max(other.target);
        let biases = [&label, &other].map(|label| label.image_description.squared_bias);
        label.image_description.squared_bias = biases.into_iter().flatten().reduce(f64::max);
        parts.push(Part { path, rect: other.image_description.rect, samples: other.samples });
    }
    (label.image_description.rect, label.samples) = whole(&regions(parts)?)?;
    let (rect, channels) = (label.image_description.rect, label.image_description.channels());
    let mut sum: Option<RenderState> = None;
    for path in paths {
        let state = file::load(path)?.state;
        let replicates = state.tiles[0].replicates();
        let sum = sum.get_or_insert_with(|| {
            let end = label.samples.last().map_or(0, |range| range.end);
            RenderState::new(rect, channels, replicates, end)
        });
        let has_changed = state.tiles.iter().any(|tile| rect.union(tile.rect) != rect);
        if has_changed || sum.tiles[0].replicates() != replicates {
            return Err(refuse(path, "has changed while it was read"));
        }
        sum.add(state);
    }
    let state = sum.expect("there are files");
    Ok(Checkpoint { label, state })
}

fn refuse(path: &Path, why: &str) -> Error {
    Error::usage(format!("merge: {} {why}", path.display()))
}

/// Checks that two parts can be added.
fn comparable(first_path: &Path, first: &CheckpointLabel, path: &Path, part: &CheckpointLabel) -> Result<()> {
    if let Some(difference) = part.identity.difference(&first.identity) {
        return Err(refuse(path, &format!("has {difference} as in {}", first_path.display())));
    }
    if part.image_description.layers != first.image_description.layers {
        return Err(refuse(path, &format!("belongs to another image than {}", first_path.display())));
    }
    Ok(())
}

/// Joins the parts of each region of the image.
fn regions(mut parts: Vec<Part<'_>>) -> Result<Vec<Part<'_>>> {
    parts.sort_by_key(|part| (part.rect.y, part.rect.x, part.rect.height, part.rect.width));
    parts.chunk_by(|a, b| a.rect == b.rect).map(region).collect()
}

/// Joins parts of one region.
fn region<'a>(parts: &[Part<'a>]) -> Result<Part<'a>> {
    let mut held: Vec<(Range<u64>, &Path)> = Vec::new();
    for part in parts {
        held.extend(part.samples.iter().map(|range| (range.clone(), part.path)));
    }
    held.sort_by_key(|(range, _)| range.start);
    Ok(Part { path: parts[0].path, rect: parts[0].rect, samples: joined(held)? })
}

/// Returns the rectangle that the regions make, and the samples of its pixels.
fn whole(regions: &[Part<'_>]) -> Result<(PixelRect, Vec<Range<u64>>)> {
    let first = &regions[0];
    for (i, region) in regions.iter().enumerate() {
        if let Some(other) = regions[..i].iter().find(|other| other.rect.overlaps(region.rect)) {
            let why = format!("has the region {}; {} has {}", region.rect, other.path.display(), other.rect);
            return Err(refuse(region.path, &why));
        }
        if region.samples != first.samples {
            let [ours, others] = [region, first].map(|region| list(&region.samples));
            let why = format!("is of the region {}, which has the samples {ours}; ", region.rect);
            return Err(refuse(region.path, &format!("{why}the region {} has {others}", first.rect)));
        }
    }
    let rect = regions.iter().map(|region| region.rect).reduce(PixelRect::union).expect("there are regions");
    let area = regions.iter().map(|region| region.rect.area()).sum::<u64>();
    match area == rect.area() {
        true => Ok((rect, first.samples.clone())),
        false => Err(Error::usage(format!(
            "merge: the regions have {area} of the {} pixels in the rectangle {rect} around them",
            rect.area()
        ))),
    }
}

/// Joins adjacent ranges of samples, which are in order and come from files.
fn joined(ranges: Vec<(Range<u64>, &Path)>) -> Result<Vec<Range<u64>>> {
    if let Some([(other, file), (range, path)]) =
        ranges.windows(2).find(|pair| pair[1].0.start < pair[0].0.end)
    {
        let [ours, theirs] = [range, other].map(|range| list(std::slice::from_ref(range)));
        let why = format!("has the samples {ours}; {} also has {theirs}", file.display());
        return Err(refuse(path, &why));
    }
    let mut joined: Vec<Range<u64>> = Vec::new();
    for (range, _) in ranges {
        match joined.last_mut() {
            Some(last) if last.end == range.start => last.end = range.end,
            _ => joined.push(range),
        }
    }
    Ok(joined)
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
        let squared_bias = self.label.image_description.squared_bias;
        let error = crate::render::state::estimate(&self.state.tiles, &pool, squared_bias);
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
        let file = Path::new("file");
        let joined = |ranges: &[Range<u64>]| joined(ranges.iter().map(|r| (r.clone(), file)).collect());
        assert_eq!(joined(&[0..4, 4..8, 8..16, 20..24]).expect("ranges"), [0..16, 20..24]);
        assert_eq!(joined(&[]).expect("no ranges"), []);
        assert!(joined(&[0..4, 3..8]).is_err());
    }
}
