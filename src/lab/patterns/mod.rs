//! Patterns of samples, within a pixel and across pixels.

mod aliasing;
mod points;
mod spectrum;
mod structure;

use super::{Found, Options, pool};
use crate::error::Result;

/// Runs all parts of the experiment.
///
/// # Errors
/// If threads cannot be started or a temporary file cannot be written.
pub fn run(options: &Options) -> Result<Found> {
    let pool = pool(options.threads)?;
    let in_a_pixel = pool.install(|| Ok([aliasing::run(options)?, spectrum::run(options)?]))?;
    let mut found = structure::run(options)?;
    for (findings, evidence) in in_a_pixel {
        found.0.extend(findings);
        found.1.extend(evidence);
    }
    Ok(found)
}
