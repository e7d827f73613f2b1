//! Loaders, which convert scene files to a [`Description`] and settings.
//!
//! A scene file is XML in Mitsuba's language ([`mitsuba`]) or glTF ([`gltf`]). A bare mesh ([`bare`]) gets a camera and
//! an environment.

mod bare;
mod curves;
mod files;
mod framing;
mod gltf;
mod height_field;
mod measurement;
mod mesh;
mod mitsuba;
mod volume;

use crate::error::{Error, Kind, Place, Result};
use crate::integrator::settings::{AUTO, AutoSettings};
use crate::integrator::{self, PathLimits, Plugin, VolpathIntegrator};
use crate::memory::{Budget, Limit, Reservation};
use crate::sampling::SamplerKind;
use crate::scene::description::Description;
use std::path::{Path, PathBuf};

/// The user's additions to a scene file.
#[derive(Clone, Debug, Default)]
pub struct LoadOptions {
    /// `-D name=value`: values that replace those of `<default>` elements.
    pub defines: Vec<(String, String)>,
    /// `-a DIR`: folders in which files are searched for after the scene's own.
    pub search_paths: Vec<PathBuf>,
    /// `--memory-limit`: the most memory that the program may use.
    pub memory: Limit,
    /// `--integrator`: the integrator that replaces the one in the file, which may then be unsupported.
    pub integrator: Option<String>,
    /// Whether `--sampler` replaces the sampler in the file, which may then be unsupported.
    pub replaces_sampler: bool,
    /// `--sensor`: the only sensor that must be supported.
    pub sensor: Option<usize>,
    /// The errors for which a stand-in is used.
    pub tolerance: Tolerance,
}

/// The errors of a scene file for which a stand-in is used, so that loading continues.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Tolerance {
    /// None.
    #[default]
    Nothing,
    /// `--skip-unknown`: plugins and elements that Buffon does not have.
    Unsupported,
    /// `buffon check`: all errors of objects and properties, so that one run finds them all.
    Everything,
}

impl Tolerance {
    /// Returns whether an error has a stand-in.
    fn covers(self, error: &Error) -> bool {
        match self {
            Tolerance::Nothing => false,
            Tolerance::Unsupported => error.kind == Kind::Unsupported,
            Tolerance::Everything => matches!(error.kind, Kind::Scene | Kind::Unsupported),
        }
    }
}

/// Adds what was done instead to the message of a tolerated error.
fn tolerated(error: Error, consequence: &str) -> Error {
    Error { message: format!("{}: {consequence}", error.message), ..error }
}

/// A loaded scene file.
#[derive(Clone, Debug, Default)]
pub struct Loaded {
    /// The scene.
    pub description: Description,
    /// The integrator that the file specifies. If pilots choose it, its limits count.
    pub integrator: integrator::Settings,
    /// How pilots choose the integrator, if the file asks for that.
    pub auto: Option<AutoSettings>,
    /// The sampler that the file specifies, mapped to one of Buffon's; `None` if it specifies none.
    pub sampler: Option<SamplerKind>,
    /// The samples per pixel that the file specifies.
    pub samples_per_pixel: Option<u32>,
    /// The errors that were tolerated, each with its consequence, in the order in which they were found. Those of
    /// [`Tolerance::Unsupported`] are in `approximations` instead.
    pub tolerated: Vec<Error>,
    /// Warnings about what was ignored, mapped or upgraded; errors under `--strict`.
    pub warnings: Vec<Error>,
    /// What is not rendered as the file asks for: ignored, or replaced by what is similar. Errors under `--strict`.
    pub approximations: Vec<String>,
    /// Notes for the user that require no change (a sampler that was mapped).
    pub notes: Vec<String>,
    /// The files that the scene consists of, besides the one that was loaded.
    pub files: Vec<PathBuf>,
    /// The planned memory: so far the meshes and textures.
    pub memory: Budget,
}

/// The extensions of the files that can be loaded.
pub const EXTENSIONS: [&str; 5] = ["xml", "gltf", "glb", "obj", "ply"];

/// Loads a scene (`.xml`, `.gltf`, `.glb`) or a bare mesh (`.obj`, `.ply`).
///
/// A bare mesh gets a camera that frames it from the front and above, the materials of its MTL files or a grey one, a
/// constant white environment if none of them emits light, and a note that says so.
///
/// # Errors
/// Of kind [`Scene`](crate::error::Kind::Scene), with file, line and column if there are any: if the file cannot be
/// read, is malformed, unknown or out of range, or does not fit into memory. All missing mesh and spectrum files are in
/// one error.
pub fn load(path: &Path, options: &LoadOptions) -> Result<Loaded> {
    let extension = path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase()).unwrap_or_default();
    let memory = Budget::open(options.memory);
    let loaded = match extension.as_str() {
        "xml" => mitsuba::load(path, options, &memory),
        "gltf" | "glb" => gltf::load(path, &options.search_paths, &memory)
            .map(|loaded| warn_of_defines(note_media(loaded, options), options)),
        "obj" | "ply" => {
            bare::load(path, &options.search_paths, &memory).map(|loaded| warn_of_defines(loaded, options))
        }
        _ => {
            let expected = "expected a scene (.xml, .gltf, .glb) or a mesh (.obj, .ply)";
            Err(Error::scene(expected).in_file(path))
        }
    }?;
    Ok(Loaded { memory, ..loaded })
}

/// The note about media that are not rendered.
const NO_MEDIA: &str = "the scene has media, which are not rendered: every medium is vacuum";

impl Loaded {
    /// Returns whether there is a medium around a sensor or at a shape.
    pub fn has_media(&self) -> bool {
        let Description { sensors, shapes, groups, .. } = &self.description;
        let grouped = groups.iter().flatten();
        sensors.iter().any(|sensor| sensor.medium.is_some())
            || shapes.iter().chain(grouped).any(|shape| !shape.boundary.is_none())
    }
}

/// Returns the integrator that decides what media mean: that of the file, or the one that the user names instead.
pub fn judge_of_media(of_file: &integrator::Settings, replacement: Option<&str>) -> integrator::Settings {
    let replacement = match replacement {
        Some(AUTO) => Some(VolpathIntegrator::NAME),
        other => other.filter(|name| *name != "aov"),
    };
    replacement
        .and_then(|name| integrator::Settings::by_name(name, PathLimits::default()))
        .unwrap_or_else(|| of_file.clone())
}

/// Adds a note if the user's integrator ignores the media of a file.
fn note_media(mut loaded: Loaded, options: &LoadOptions) -> Loaded {
    let ignored = judge_of_media(&loaded.integrator, options.integrator.as_deref()).ignores_media();
    if !loaded.description.media.is_empty() && ignored {
        loaded.notes.push(NO_MEDIA.to_owned());
    }
    loaded
}

/// Adds a warning for each parameter that the user defines; the files of these formats have none.
fn warn_of_defines(mut loaded: Loaded, options: &LoadOptions) -> Loaded {
    let unused = |(name, _): &(String, String)| {
        Error::scene("nothing to define: files of this kind have no parameters").about(format!("-D {name}"))
    };
    loaded.warnings.extend(options.defines.iter().map(unused));
    loaded
}

/// Reads a file. The reservation covers its bytes until it is dropped.
///
/// # Errors
/// If the file does not exist or cannot be read, with the system's message, or is larger than the memory that is left.
fn read_bytes(path: &Path, memory: &Budget) -> Result<(Vec<u8>, Reservation)> {
    let length = std::fs::metadata(path).map_or(0, |about| about.len());
    let reserved = memory.reserve(length).map_err(|refusal| {
        Error::scene(refusal.sentence("reading the file", "use a smaller one")).in_file(path)
    })?;
    Ok((std::fs::read(path).map_err(|e| unreadable(path, &e))?, reserved))
}

fn unreadable(path: &Path, error: &std::io::Error) -> Error {
    Error::scene(format!("cannot be read: {error}")).in_file(path)
}

/// Reads a text file.
///
/// # Errors
/// As for [`read_bytes`], and if the file is not UTF-8.
fn read_text(path: &Path, memory: &Budget) -> Result<String> {
    let (bytes, _reserved) = read_bytes(path, memory)?;
    let text = String::from_utf8(bytes).map_err(|e| {
        let before = &e.as_bytes()[..e.utf8_error().valid_up_to()];
        let line = 1 + before.iter().filter(|b| **b == b'\n').count();
        let column = 1 + before.iter().rev().take_while(|b| **b != b'\n').count();
        let place = Place { line: line as u32, column: column as u32, ..Place::file(path) };
        Error::scene("expected text in UTF-8, found an invalid byte").at(place)
    })?;
    Ok(match text.strip_prefix('\u{feff}') {
        Some(rest) => rest.to_owned(),
        None => text,
    })
}
