//! The files that `buffon render` writes.

use super::display_server::DisplayServer;
use super::render::{RenderArgs, STRATEGIES};
use crate::error::{Error, Result};
use crate::image::{self, WriteOptions};
use crate::util;
use std::path::{Path, PathBuf};

/// Returns the scene's name in the current directory, with the range of samples if there is one, so that ranges do not
/// overwrite each other's images.
pub fn default_output(args: &RenderArgs) -> PathBuf {
    let name = Path::new(args.scene.file_name().unwrap_or(args.scene.as_os_str()));
    match &args.sample_range {
        Some(range) => name.with_extension(format!("{}-{}.exr", range.start, range.end)),
        None => name.with_extension("exr"),
    }
}

/// Returns whether a target is standard output.
pub fn is_piped(target: &Path) -> bool {
    target == Path::new("-")
}

/// Returns the name of a target in messages. Standard output gets an EXR.
pub fn named(target: &Path) -> &Path {
    if is_piped(target) { Path::new("standard output.exr") } else { target }
}

/// Writes an EXR to standard output. Libraries write to files only.
///
/// # Errors
/// If a temporary file or standard output cannot be written.
pub fn write_piped(image: &image::Image, options: &WriteOptions) -> Result<image::WriteReport> {
    let file = tempfile::Builder::new().prefix("buffon-").suffix(".exr").tempfile();
    let failed = |e: std::io::Error| {
        let folder = std::env::temp_dir();
        Error::output(format!("no temporary file can be used in {}: {}", folder.display(), e.kind()))
    };
    let file = file.map_err(failed)?.into_temp_path();
    let report = image::write(&file, image, options)?;
    super::print(&std::fs::read(&file).map_err(failed)?)?;
    Ok(report)
}

/// Returns the files that are written, with their options.
pub fn written(args: &RenderArgs) -> Vec<(&'static str, &Path)> {
    let options = [("--stats", &args.stats), ("--checkpoint", &args.checkpoint), ("--cache", &args.cache)];
    let options = options.into_iter().filter_map(|(option, file)| Some((option, file.as_deref()?)));
    let outputs = args.output.iter().map(|file| ("-o", file.as_path()));
    outputs.chain(options).filter(|(_, file)| !is_piped(file)).collect()
}

/// Refuses options that have no effect or contradict each other, and outputs that would replace the scene or each
/// other.
///
/// # Errors
/// If there are any.
pub fn refuse(args: &RenderArgs, targets: &[PathBuf]) -> Result<()> {
    if let Some(address) = &args.display_server {
        DisplayServer::check(address)?;
    }
    if args.output.iter().any(|target| is_piped(target)) && args.stats.as_deref().is_some_and(is_piped) {
        return Err(Error::usage("-o - and --stats -: only one of them can be standard output"));
    }
    if args.write_every.is_some() && args.output.iter().all(|target| is_piped(target)) {
        return Err(Error::usage("--write-every: standard output is written once; name a file with -o"));
    }
    if args.aov.iter().any(|name| name == STRATEGIES)
        && (args.sample_range.is_some() || args.checkpoint.is_some())
    {
        return Err(Error::usage(
            "--aov strategies: its layers are rendered in one piece, without --checkpoint and --sample-range",
        ));
    }
    args.display.check(targets.iter().map(PathBuf::as_path))?;
    let takes_layers = |target: &&PathBuf| {
        target.extension().is_some_and(|e| e.eq_ignore_ascii_case("exr") || e.eq_ignore_ascii_case("npy"))
    };
    let layers = [("--aov", !args.aov.is_empty()), ("--cryptomatte", args.cryptomatte)];
    let layered = layers.into_iter().find_map(|(option, is_used)| is_used.then_some(option));
    if let (Some(option), Some(other)) = (layered, targets.iter().find(|target| !takes_layers(target))) {
        return Err(Error::usage(format!(
            "{option}: layers need an .exr or .npy, which {} is not",
            other.display()
        )));
    }
    let written = written(args);
    if args.output.iter().filter(|target| is_piped(target)).count() > 1 {
        return Err(Error::usage("-o -: standard output is named twice"));
    }
    for (i, (option, file)) in written.iter().enumerate() {
        let named = format!("{option} {}", file.display());
        if util::is_same_file(file, &args.scene) {
            return Err(Error::usage(format!("{named}: it is the scene")));
        }
        if let Some((other, _)) = written[..i].iter().find(|(_, earlier)| util::is_same_file(earlier, file)) {
            return Err(Error::usage(match other == option {
                true => format!("{named}: this file is named twice"),
                false => format!("{named}: it is also the file of {other}"),
            }));
        }
    }
    Ok(())
}
