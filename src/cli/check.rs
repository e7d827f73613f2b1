//! `buffon check`: everything in scene files that Buffon cannot load or renders differently.

use super::print;
use super::shared::SceneArgs;
use crate::error::{Error, Kind, Result, counted};
use crate::loader::{self, LoadOptions, Loaded, Tolerance};
use crate::session::NOTHING_TO_SEE;
use clap::Args;
use std::fmt::Write;
use std::path::{Path, PathBuf};

/// List everything in a scene that Buffon cannot load or renders differently.
///
/// All problems are listed in one run, with their places and what --skip-unknown would do instead. The exit code is 0
/// if every scene loads and 3 if one does not.
#[derive(Clone, Debug, Args)]
pub struct CheckArgs {
    /// The scenes (.xml, .gltf, .glb, .obj, .ply)
    #[arg(required_unless_present = "corpus")]
    pub scenes: Vec<PathBuf>,
    /// Check every .xml, .gltf and .glb file in a folder and its subfolders, and print how many of them load
    #[arg(long, value_name = "DIR")]
    pub corpus: Option<PathBuf>,
    /// The integrator that replaces those of the scenes, which may then be unknown
    #[arg(long, value_name = "NAME")]
    pub integrator: Option<String>,
    /// Print JSON
    #[arg(long)]
    pub json: bool,
    /// Definitions, folders and memory.
    #[command(flatten)]
    pub resources: SceneArgs,
}

/// The result for one file.
#[derive(serde::Serialize)]
struct Checked {
    scene: PathBuf,
    loads: bool,
    problems: Vec<Problem>,
    warnings: Vec<Problem>,
    /// What is not rendered as the file asks for; an error of `render --strict`.
    approximations: Vec<String>,
    notes: Vec<String>,
}

/// A problem and its place.
#[derive(serde::Serialize)]
struct Problem {
    file: Option<PathBuf>,
    /// The line and column, from 1; `None` if the problem concerns a whole file.
    line: Option<u32>,
    column: Option<u32>,
    element: String,
    message: String,
    /// Whether --skip-unknown renders the scene without it.
    skippable: bool,
    #[serde(skip)]
    text: String,
}

impl Problem {
    /// Splits an error with others of the same cause into one problem each.
    fn all(error: Error) -> Vec<Problem> {
        let Error { kind, place, thing, message, others } = error;
        let mut alone = Error { kind, place, thing, message, others: Vec::new() };
        let text = alone.to_string();
        let place = alone.place.take();
        let position = place.as_ref().filter(|p| p.line > 0);
        let problem = Problem {
            line: position.map(|p| p.line),
            column: position.map(|p| p.column),
            file: place.map(|p| p.file),
            element: alone.thing,
            message: alone.message,
            skippable: kind == Kind::Unsupported,
            text,
        };
        std::iter::once(problem).chain(others.into_iter().flat_map(Problem::all)).collect()
    }
}

/// Checks the scenes and prints the result.
///
/// # Errors
/// If the folder cannot be read.
pub fn run(args: &CheckArgs) -> Result<u8> {
    let mut scenes = args.scenes.clone();
    if let Some(folder) = &args.corpus {
        let before = scenes.len();
        scenes_below(folder, &mut scenes)?;
        scenes[before..].sort();
        if scenes.is_empty() {
            return Err(Error::usage("found no .xml, .gltf or .glb file").in_file(folder));
        }
    }
    let checked: Vec<Checked> = scenes.iter().map(|scene| check(scene, args)).collect();
    let loading = checked.iter().filter(|c| c.loads).count();
    let text = match args.json {
        true => {
            let text = serde_json::to_string_pretty(&checked);
            text.map_err(|e| Error::internal(e.to_string()))? + "\n"
        }
        false => describe(&checked, loading),
    };
    print(&text)?;
    Ok(if loading == checked.len() { 0 } else { Kind::Scene.exit_code() })
}

/// Adds the scene files in a folder and its subfolders. Links to folders are not followed.
fn scenes_below(folder: &Path, scenes: &mut Vec<PathBuf>) -> Result<()> {
    let unreadable = |e: std::io::Error| Error::scene(format!("cannot be read: {e}")).in_file(folder);
    for entry in std::fs::read_dir(folder).map_err(unreadable)? {
        let entry = entry.map_err(unreadable)?;
        let path = entry.path();
        if entry.file_type().map_err(unreadable)?.is_dir() {
            scenes_below(&path, scenes)?;
        } else if path
            .extension()
            .is_some_and(|e| ["xml", "gltf", "glb"].iter().any(|x| e.eq_ignore_ascii_case(x)))
        {
            scenes.push(path);
        }
    }
    Ok(())
}

/// Loads a scene with a stand-in for everything that has one.
fn check(scene: &Path, args: &CheckArgs) -> Checked {
    let options = args.resources.load_options(args.integrator.as_deref());
    let skips = options.tolerance == Tolerance::Unsupported;
    let options = LoadOptions { tolerance: Tolerance::Everything, ..options };
    let loaded = loader::load(scene, &options).unwrap_or_else(|error| {
        // What was found before a problem without a stand-in is not known.
        Loaded { tolerated: vec![error], ..Loaded::default() }
    });
    let has_media = loaded.has_media();
    let integrator = loader::judge_of_media(&loaded.integrator, args.integrator.as_deref());
    let Loaded { mut tolerated, warnings, approximations, notes, .. } = loaded;
    tolerated.extend(integrator.check_media().err().filter(|_| has_media).map(|error| error.in_file(scene)));
    if loaded.description.sensors.is_empty() && tolerated.is_empty() {
        tolerated.push(Error::scene(NOTHING_TO_SEE).in_file(scene));
    }
    let mut problems: Vec<Problem> = tolerated.into_iter().flat_map(Problem::all).collect();
    problems.sort_by(|a, b| (&a.file, a.line, a.column).cmp(&(&b.file, b.line, b.column)));
    let warnings = warnings.into_iter().flat_map(Problem::all).collect();
    let loads = problems.iter().all(|problem| skips && problem.skippable);
    Checked { scene: scene.to_owned(), loads, problems, warnings, approximations, notes }
}

fn describe(all: &[Checked], loading: usize) -> String {
    let mut text = String::new();
    for Checked { scene, loads, problems, warnings, approximations, notes } in all {
        for problem in problems {
            let _ = writeln!(text, "{}", problem.text);
        }
        for warning in warnings {
            let _ = writeln!(text, "warning: {}", warning.text);
        }
        for note in approximations.iter().chain(notes) {
            let _ = writeln!(text, "note: {note}");
        }
        let verdict = if *loads { "loads" } else { "does not load" };
        let found = [
            counted(problems.len() as u64, "problem", "problems"),
            counted(warnings.len() as u64, "warning", "warnings"),
            counted((approximations.len() + notes.len()) as u64, "note", "notes"),
        ];
        let _ = writeln!(text, "{}: {verdict} ({})", scene.display(), found.join(", "));
    }
    if all.len() > 1 {
        let share = 100.0 * loading as f64 / all.len() as f64;
        let _ = writeln!(
            text,
            "{loading} of {} load ({share:.1} %)",
            counted(all.len() as u64, "scene", "scenes")
        );
    }
    text
}
