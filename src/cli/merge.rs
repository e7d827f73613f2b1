//! `buffon merge`: adds parts of one render.

use crate::error::{Error, Kind, Result, counted};
use crate::image::{self, WriteOptions};
use crate::session::checkpoint::{self, file, merge};
use crate::session::default_threads;
use crate::util;
use clap::Args;
use std::path::PathBuf;

/// Add the samples of several parts of one render.
///
/// The parts are checkpoints of `buffon render --sample-range A..B --crop X,Y,W,H --checkpoint FILE`, in any order. The
/// regions must make a rectangle, and all must have the same samples. If the parts cover the whole render, the pixels
/// are exactly those of a single render. Parts of different renders, or with common samples, are refused. A folder
/// stands for the files *.sums in it.
#[derive(Clone, Debug, Args)]
pub struct MergeArgs {
    /// The checkpoints, or folders of them
    #[arg(required = true)]
    pub parts: Vec<PathBuf>,
    /// The image to write
    #[arg(short, long, value_name = "FILE", required_unless_present = "checkpoint")]
    pub output: Option<PathBuf>,
    /// Write the sums as a checkpoint, to merge it with others or to resume from it
    #[arg(long, value_name = "FILE")]
    pub checkpoint: Option<PathBuf>,
    /// Print only errors
    #[arg(short, long)]
    pub quiet: bool,
    /// Treat missing samples as an error
    #[arg(long)]
    pub strict: bool,
}

/// Merges the parts.
///
/// # Errors
/// If the parts cannot be read or belong to different renders, or the result cannot be written.
pub fn run(args: &MergeArgs) -> Result<u8> {
    if let Some(output) = &args.output {
        image::check_output(output)?;
    }
    if let Some(path) = &args.checkpoint {
        util::check_replaceable(path)?;
    }
    let parts: Vec<PathBuf> = args.parts.iter().map(files).collect::<Result<Vec<_>>>()?.concat();
    let merged = merge::merge(&parts)?;
    let missing = merged.missing();
    if !missing.is_empty() {
        let target = merged.label.target.unwrap_or(0);
        let message = format!("of {target} samples per pixel {} are missing", checkpoint::list(&missing));
        if args.strict {
            return Err(Error::new(Kind::Strict, message));
        }
        if !args.quiet {
            super::report!("buffon: warning: {message}");
        }
    }
    if let Some(path) = &args.checkpoint {
        file::save(path, &merged.label, &merged.state)?;
    }
    let Some(output) = &args.output else { return Ok(0) };
    let rendered = merged.rendered(default_threads())?;
    let image = merged.label.image_description.image(&rendered);
    let samples = merged.label.image_description.component_format.into();
    let report = image::write(output, &image, &WriteOptions { samples, ..WriteOptions::default() })?;
    if report.clamped_half > 0 && !args.quiet {
        let values = counted(report.clamped_half as u64, "value", "values");
        super::report!("buffon: warning: {values} clamped to the range of half floats");
    }
    if !args.quiet {
        let error = rendered.relmse.map_or_else(String::new, |e| format!(", relMSE about {e:.2e}"));
        let samples = checkpoint::list(&merged.label.samples);
        super::report!("{}: samples {samples}{error}", output.display());
    }
    Ok(0)
}

/// Returns a part, or the checkpoints in it if it is a folder, without those that a killed render left half written.
fn files(part: &PathBuf) -> Result<Vec<PathBuf>> {
    if !part.is_dir() {
        return Ok(vec![part.clone()]);
    }
    let failed = |e: std::io::Error| Error::output(format!("cannot be read: {e}")).in_file(part);
    let mut files = Vec::new();
    for entry in std::fs::read_dir(part).map_err(failed)? {
        let file = entry.map_err(failed)?.path();
        let is_whole = file.file_stem().is_some_and(|stem| !stem.to_string_lossy().ends_with(".part"));
        if is_whole && file.extension().is_some_and(|extension| extension == "sums") {
            files.push(file);
        }
    }
    files.sort();
    match files.is_empty() {
        true => Err(Error::output("expected checkpoints (*.sums) in the folder, found none").in_file(part)),
        false => Ok(files),
    }
}
