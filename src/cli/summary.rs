//! What `buffon render` says about a render: warnings, a summary, and the values that are not as they should be.

use super::render::RenderArgs;
use crate::error::{Error, Kind, Result, counted};
use crate::render::{Rendered, StopReason};

/// Prints warnings, or fails with them under `--strict`.
pub fn warn(args: &RenderArgs, mut warnings: Vec<Error>) -> Result<()> {
    if warnings.is_empty() {
        return Ok(());
    }
    if args.strict {
        let first = warnings.remove(0);
        return Err(Error { kind: Kind::Strict, ..first }.with_others(warnings));
    }
    if !args.quiet {
        warnings.iter().for_each(|w| super::report!("buffon: warning: {w}"));
    }
    Ok(())
}

/// Returns a line about a finished render.
pub fn summary(names: &str, rendered: &Rendered) -> String {
    let reason = match rendered.stop_reason {
        StopReason::Samples => "all samples taken",
        StopReason::Time => "time is up",
        StopReason::Error => "error reached",
        StopReason::Enough => "enough",
        StopReason::Interrupted => "interrupted",
    };
    let error = match (rendered.relmse, rendered.relmse_interval) {
        (Some(e), Some([low, high])) => format!(", relMSE about {e:.2e} ({low:.2e} to {high:.2e})"),
        _ => String::new(),
    };
    let counts = rendered.counts;
    let range = if counts.most > counts.least + 1 {
        format!(" ({} to {})", counts.least, counts.most)
    } else {
        String::new()
    };
    let rate = rendered.counters.paths as f64 / rendered.elapsed.as_secs_f64().max(1e-9) * 1e-6;
    format!(
        "{names}: {}x{}, {} per pixel{range} in {:.2} s ({rate:.2} M samples/s){error}; {reason}",
        rendered.rect.width,
        rendered.rect.height,
        counted(rendered.samples_per_pixel, "sample", "samples"),
        rendered.elapsed.as_secs_f64(),
    )
}

/// Reports which samples were dropped and how to render them again, and how many values the file cannot represent.
/// Under `--strict` these are errors, but the image has been written, so hours of rendering are not lost.
pub fn warn_of_values(args: &RenderArgs, names: &str, rendered: &Rendered, clamped: usize) -> Result<()> {
    let mut messages = Vec::new();
    if let Some(first) = rendered.invalid.first() {
        messages.push(format!(
            "{} dropped; the first is sample {} of pixel ({}, {}): {:?}. To see it again: --crop {},{},1,1 \
             --seed {} --spp {}",
            counted(rendered.invalid_count, "invalid sample", "invalid samples"),
            first.sample,
            first.x,
            first.y,
            first.value,
            first.x,
            first.y,
            args.method.seed,
            first.sample + 1
        ));
    }
    if rendered.adaptive && rendered.counts.least == 0 && args.sample_range.is_some() && !args.quiet {
        super::report!(
            "buffon: note: some pixels have no sample in this range and are black until it is merged with the others"
        );
    }
    if clamped > 0 {
        messages.push(format!(
            "{} clamped to the range of half floats; component_format float32 keeps them",
            counted(clamped as u64, "value", "values")
        ));
    }
    if args.strict && !messages.is_empty() {
        messages.push(format!("--strict: {names} is written, and holds what there is"));
    }
    warn(args, messages.into_iter().map(|message| Error::new(Kind::Strict, message)).collect())
}
