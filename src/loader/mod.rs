//! Loaders: scene files in, [`Description`] and settings out.

use crate::error::Error;
use crate::integrator;
use crate::sampling::SamplerKind;
use crate::scene::description::Description;
use std::path::PathBuf;

/// What the user adds to a scene file.
#[derive(Clone, Debug, Default)]
pub struct LoadOptions {
    /// `-D name=value`: values that replace those of `<default>` elements.
    pub defines: Vec<(String, String)>,
    /// `-a DIR`: folders to look for files in, after the scene's own.
    pub search_paths: Vec<PathBuf>,
}

/// A loaded scene file.
#[derive(Clone, Debug, Default)]
pub struct Loaded {
    /// What is in the scene.
    pub description: Description,
    /// The integrator that the file asks for.
    pub integrator: integrator::Settings,
    /// The sampler that the file asks for, mapped to one of ours; `None` where it names none.
    pub sampler: Option<SamplerKind>,
    /// Samples per pixel that the file asks for.
    pub samples_per_pixel: Option<u32>,
    /// What was ignored, mapped or upgraded; errors under `--strict`.
    pub warnings: Vec<Error>,
    /// What the user should know but need not change (a sampler that was mapped).
    pub notes: Vec<String>,
}
