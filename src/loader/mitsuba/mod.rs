//! Scene files in the XML language of Mitsuba 3.
//!
//! Loading has four steps, each in its own file: [`xml`] reads elements with their positions in the file, [`resolve`]
//! substitutes parameters, follows includes and references and types the values, [`props`] looks up the properties of
//! an object and records their use, and [`instantiate`] converts objects to the scene's plain data.

mod graph;
mod instantiate;
mod parameters;
mod props;
mod resolve;
mod transform;
mod upgrade;
mod values;
mod xml;

use super::{LoadOptions, Loaded, Tolerance};
use crate::error::Result;
use crate::memory::Budget;
use std::path::Path;

/// Loads a scene in Mitsuba's language.
///
/// # Errors
/// As for [`load`](super::load).
pub fn load(path: &Path, options: &LoadOptions, memory: &Budget) -> Result<Loaded> {
    let resolved = resolve::resolve(path, options, memory)?;
    let mut loaded = instantiate::instantiate(resolved, options, memory)?;
    if options.tolerance == Tolerance::Unsupported {
        // One note for each kind.
        for error in std::mem::take(&mut loaded.tolerated) {
            let note = format!("{}: {}", error.thing, error.message);
            if !loaded.approximations.contains(&note) {
                loaded.approximations.push(note);
            }
        }
    }
    Ok(loaded)
}
