//! Error against time: scenes × integrators × samplers × traversals × budgets, each rendered several times.
//!
//! The renders take turns, so that other load on the machine affects all of them equally. Every image is compared with
//! a reference. The reference's own error is reported with the measurements, if it is known.

mod budget;
mod cache;
mod calibration;
mod handicaps;
mod measure;
mod output;
mod page;
mod reference;
mod summary;
mod tables;

pub use budget::Budget;
pub use calibration::{Calibration, calibrate, text as calibration_text};
pub use measure::Measurement;
pub use output::{csv, json};
pub use page::page;
pub use reference::Reference;
pub use summary::{Median, Slope, WIDEST_SLOPE};
pub use tables::text;

use crate::accel::AccelKind;
use crate::error::{Error, Result, counted};
use crate::film::PixelFormat;
use crate::image::Image;
use crate::integrator::Bdpt;
use crate::integrator::settings::{AUTO, Plugin, WhenPays};
use crate::render::Progress;
use crate::sampling::SamplerKind;
use crate::session::{Choices, Costs, SceneChoices, SceneFile, Session};
use measure::Candidate;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// The options of a benchmark.
#[derive(Clone, Debug)]
pub struct Options {
    /// The scene files.
    pub scenes: Vec<PathBuf>,
    /// The user's choices for all scenes.
    pub choices: SceneChoices,
    /// Names of integrators; if empty, each scene's own is used.
    pub integrators: Vec<String>,
    /// The greatest bias of an integrator that `auto` may choose; none if `None`.
    pub allow_bias: Option<f64>,
    /// What a ray of each candidate of `auto` costs; the table of the program if `None`.
    pub costs: Option<Costs>,
    /// Whether `bdpt` connects paths; the scene decides if it is `None`.
    pub connections: Option<WhenPays>,
    /// Samplers; if empty, each scene's own is used.
    pub samplers: Vec<SamplerKind>,
    /// The traversals.
    pub accels: Vec<AccelKind>,
    /// The budgets of each render.
    pub budgets: Vec<Budget>,
    /// The number of renders for each budget, each with a different seed.
    pub runs: u32,
    /// The seed of the first run.
    pub seed: u64,
    /// The number of threads.
    pub threads: usize,
    /// The reference, if there is only one scene.
    pub reference: Option<PathBuf>,
    /// The time limit for rendering a reference.
    pub reference_time: Duration,
}

/// An integrator, a sampler and a traversal.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Combination {
    /// Name of the integrator.
    pub integrator: String,
    /// The sampler.
    pub sampler: SamplerKind,
    /// The traversal.
    pub accel: AccelKind,
}

/// The results of a combination.
#[derive(Clone, Debug)]
pub struct BenchRow {
    /// The combination.
    pub combination: Combination,
    /// The reason why there are no measurements, if there are none.
    pub failure: Option<String>,
    /// The measurements of all runs, for each budget.
    pub cells: Vec<Vec<Measurement>>,
    /// The first image with the last budget.
    pub image: Option<Image>,
}

/// The acceleration structure of a traversal for a scene.
#[derive(Clone, Debug)]
pub struct Traversal {
    /// The traversal.
    pub accel: AccelKind,
    /// Build time in seconds.
    pub build_seconds: f64,
    /// Memory in bytes.
    pub memory_bytes: usize,
}

/// The results for one scene.
#[derive(Clone, Debug)]
pub struct SceneReport {
    /// The scene file.
    pub path: PathBuf,
    /// Width and height of the image in pixels.
    pub size: [usize; 2],
    /// The number of triangles in memory.
    pub triangles: usize,
    /// The reference of the images.
    pub reference: Reference,
    /// The acceleration structures.
    pub traversals: Vec<Traversal>,
    /// The results of each combination.
    pub rows: Vec<BenchRow>,
}

impl SceneReport {
    /// Returns the scene's name.
    pub fn name(&self) -> String {
        name_of(&self.path)
    }
}

/// Returns the name of a scene: that of its file, or of its folder if the file is called `scene`.
fn name_of(path: &Path) -> String {
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    let folder = path.parent().and_then(Path::file_name).map(|f| f.to_string_lossy());
    match folder {
        Some(folder) if stem == "scene" => folder.into_owned(),
        _ => stem.into_owned(),
    }
}

/// The result of a benchmark.
#[derive(Clone, Debug)]
pub struct Report {
    /// The options.
    pub options: Options,
    /// The results for each scene, without scenes that have no measurement because of an interruption.
    pub scenes: Vec<SceneReport>,
}

/// Measures until everything is done or the progress is interrupted. `tell` receives a line about every step.
///
/// # Errors
/// If the options contradict each other, a scene cannot be loaded, or a reference cannot be read or does not fit. A
/// combination that cannot be rendered is a row with the reason.
pub fn run(options: Options, progress: &Progress, tell: &dyn Fn(&str)) -> Result<Report> {
    check(&options)?;
    // An error in the last scene is reported at the start.
    for path in &options.scenes {
        load(path, &options)?;
    }
    let mut scenes = Vec::new();
    for path in &options.scenes {
        if !progress.is_interrupted() {
            scenes.extend(bench_scene(path, &options, progress, tell)?);
        }
    }
    Ok(Report { options, scenes })
}

fn check(options: &Options) -> Result<()> {
    if options.reference.is_some() && options.scenes.len() > 1 {
        return Err(Error::usage(format!(
            "--reference: expected one scene, found {}: a reference is of one picture",
            options.scenes.len()
        )));
    }
    Ok(())
}

/// Loads a scene with a film of red, green and blue.
fn load(path: &Path, options: &Options) -> Result<SceneFile> {
    let mut file = SceneFile::load(path, &options.choices)?;
    let sensor = file.sensor;
    file.description.sensors[sensor].film.pixel_format = PixelFormat::Rgb;
    Ok(file)
}

/// Tells what is wrong with a scene file, or not rendered as it asks for.
fn warn(file: &SceneFile, tell: &dyn Fn(&str)) {
    file.warnings.iter().for_each(|w| tell(&format!("warning: {w}")));
    file.approximations.iter().chain(&file.notes).for_each(|note| tell(&format!("note: {note}")));
}

/// Measures one scene; returns `None` if it was interrupted before the first measurement.
fn bench_scene(
    path: &Path,
    options: &Options,
    progress: &Progress,
    tell: &dyn Fn(&str),
) -> Result<Option<SceneReport>> {
    let name = path.display();
    let mut file = load(path, options)?;
    file.pass_panes(options.integrators.iter().map(String::as_str));
    warn(&file, tell);
    let of_scene = file.defaults.integrator_name();
    let is = |integrator: &Option<String>, name| integrator.as_deref().unwrap_or(of_scene) == name;
    let is_auto = |integrator: &Option<String>| is(integrator, AUTO);
    let is_bdpt = |integrator: &Option<String>| is(integrator, Bdpt::NAME);
    let integrators = some_or_default(&options.integrators);
    let Options { allow_bias, costs, .. } = options;
    if !integrators.iter().any(is_auto) && (allow_bias.is_some() || costs.is_some()) {
        let option = if allow_bias.is_some() { "--allow-bias" } else { "--auto-costs" };
        return Err(Error::usage(format!("{option}: only the integrator auto uses it")));
    }
    if !integrators.iter().any(is_bdpt) && options.connections.is_some() {
        return Err(Error::usage("--bdpt-connections: only the integrator bdpt uses it"));
    }
    let key = cache::key(&file);
    let mut sessions: Vec<_> = options
        .accels
        .iter()
        .map(|&accel| (accel, file.clone().compile(accel, options.threads).map_err(|e| e.to_string())))
        .collect();
    drop(file);
    // If `auto` selects one of the trees and other traversals are measured too, `auto` is redundant.
    let is_tree = |s: &Session| !s.scene.accel.name().contains("list");
    if sessions.iter().any(|(accel, _)| *accel != AccelKind::Auto) {
        sessions.retain(|(accel, s)| *accel != AccelKind::Auto || !s.as_ref().is_ok_and(is_tree));
    }
    let mut candidates = Vec::new();
    for integrator in integrators {
        for sampler in some_or_default(&options.samplers) {
            for (accel, session) in &sessions {
                let choices = Choices {
                    integrator: integrator.clone(),
                    allow_bias: allow_bias.filter(|_| is_auto(&integrator)),
                    costs: costs.clone().filter(|_| is_auto(&integrator)),
                    connections: options.connections.filter(|_| is_bdpt(&integrator)),
                    sampler,
                    replace_independent: true,
                    seed: options.seed,
                    ..Choices::default()
                };
                candidates.push(Candidate::new(*accel, session.as_ref(), choices)?);
            }
        }
    }
    let Some(session) = sessions.iter().find_map(|(_, session)| session.as_ref().ok()) else {
        let reason = sessions.first().and_then(|(_, s)| s.as_ref().err());
        return Err(Error::scene(reason.map_or_else(|| "no traversal".into(), Clone::clone)));
    };
    session.warnings.iter().for_each(|w| tell(&format!("warning: {w}")));
    let reference = reference::find(session, options, key, &candidates, progress, tell)?;
    let pictures = candidates.iter().filter(|c| c.failure().is_none()).count() as u64;
    let runs =
        counted(u64::from(options.runs) * pictures * options.budgets.len() as u64, "render", "renders");
    tell(&format!("{name}: {runs}"));
    let rows = measure::measure(candidates, &reference, options, progress, &|line| {
        tell(&format!("{name}: {line}"))
    })?;
    let camera = session.camera().film.rect();
    let traversals = sessions
        .iter()
        .filter_map(|(accel, session)| {
            let session = session.as_ref().ok()?;
            let memory_bytes = session.scene.accel.memory_bytes();
            Some(Traversal { accel: *accel, build_seconds: session.report.build_seconds, memory_bytes })
        })
        .collect();
    let report = SceneReport {
        path: path.to_owned(),
        size: [camera.width as usize, camera.height as usize],
        triangles: session.scene.triangle_count(),
        reference,
        traversals,
        rows,
    };
    let any = report.rows.iter().any(|r| r.failure.is_some() || r.cells.iter().any(|c| !c.is_empty()));
    Ok(any.then_some(report))
}

/// Returns the user's list, or one `None` for the scene's own choice if the list is empty.
fn some_or_default<T: Clone>(list: &[T]) -> Vec<Option<T>> {
    if list.is_empty() { vec![None] } else { list.iter().cloned().map(Some).collect() }
}
