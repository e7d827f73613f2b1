//! Speed against error: scenes × integrators × samplers × traversals × budgets, each rendered several times.
//!
//! The renders take turns, so that whatever else the machine does meets all of them alike. Every image is compared
//! with a reference; every figure stands beside the reference's own error, where that is known.

mod budget;
mod cache;
mod handicaps;
mod measure;
mod output;
mod page;
mod reference;
mod summary;
mod tables;

pub use budget::Budget;
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
use crate::render::Progress;
use crate::sampling::SamplerKind;
use crate::session::{Choices, SceneChoices, SceneFile, Session};
use measure::Candidate;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// What is to be measured.
#[derive(Clone, Debug)]
pub struct Options {
    /// The scene files.
    pub scenes: Vec<PathBuf>,
    /// What the user says of all of them.
    pub choices: SceneChoices,
    /// Names of integrators; empty for that of the scene.
    pub integrators: Vec<String>,
    /// Samplers; empty for that of the scene.
    pub samplers: Vec<SamplerKind>,
    /// Traversals.
    pub accels: Vec<AccelKind>,
    /// What each render may take.
    pub budgets: Vec<Budget>,
    /// How often each render is made, every time with another seed.
    pub runs: u32,
    /// The seed of the first.
    pub seed: u64,
    /// Threads.
    pub threads: usize,
    /// The reference of the one scene.
    pub reference: Option<PathBuf>,
    /// The longest that rendering a reference may take.
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

/// What came of a combination.
#[derive(Clone, Debug)]
pub struct Row {
    /// What was combined.
    pub combination: Combination,
    /// Why there is no figure, if there is none.
    pub failure: Option<String>,
    /// By budget: the runs.
    pub cells: Vec<Vec<Measurement>>,
    /// The first image of the last budget.
    pub image: Option<Image>,
}

/// A traversal's structure over a scene.
#[derive(Clone, Debug)]
pub struct Traversal {
    /// Which.
    pub accel: AccelKind,
    /// Time to build it.
    pub build_seconds: f64,
    /// Its memory.
    pub memory_bytes: usize,
}

/// All about one scene.
#[derive(Clone, Debug)]
pub struct SceneReport {
    /// The scene file.
    pub path: PathBuf,
    /// Columns and rows that were rendered.
    pub size: [usize; 2],
    /// Triangles in memory.
    pub triangles: usize,
    /// What the images are compared with.
    pub reference: Reference,
    /// The structures.
    pub traversals: Vec<Traversal>,
    /// The combinations.
    pub rows: Vec<Row>,
}

impl SceneReport {
    /// The scene's name: that of its file, or of its folder if the file is called `scene`.
    pub fn name(&self) -> String {
        let stem = self.path.file_stem().unwrap_or_default().to_string_lossy();
        let folder = self.path.parent().and_then(Path::file_name).map(|f| f.to_string_lossy());
        match folder {
            Some(folder) if stem == "scene" => folder.into_owned(),
            _ => stem.into_owned(),
        }
    }
}

/// A finished bench.
#[derive(Clone, Debug)]
pub struct Report {
    /// What was asked for.
    pub options: Options,
    /// By scene: what came out. Scenes that an interruption left without any figure are missing.
    pub scenes: Vec<SceneReport>,
}

/// Measures, until all is done or the progress is interrupted; `tell` gets a line about every step.
///
/// # Errors
/// If an option means nothing, a scene cannot be loaded, or a reference cannot be read or does not fit. A
/// combination that cannot be rendered is a row with its reason.
pub fn run(options: Options, progress: &Progress, tell: &dyn Fn(&str)) -> Result<Report> {
    check(&options)?;
    // What is wrong with the last scene should not be found out at the end.
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

/// The scene as it is measured: its picture as red, green and blue.
fn load(path: &Path, options: &Options) -> Result<SceneFile> {
    let mut file = SceneFile::load(path, &options.choices)?;
    let sensor = file.sensor;
    file.description.sensors[sensor].film.pixel_format = PixelFormat::Rgb;
    Ok(file)
}

/// Measures one scene; `None` if it was interrupted before there was any figure.
fn bench_scene(
    path: &Path,
    options: &Options,
    progress: &Progress,
    tell: &dyn Fn(&str),
) -> Result<Option<SceneReport>> {
    let name = path.display();
    let file = load(path, options)?;
    file.warnings.iter().for_each(|w| tell(&format!("warning: {w}")));
    file.notes.iter().for_each(|note| tell(&format!("note: {note}")));
    let key = cache::key(&file);
    let mut sessions: Vec<_> = options
        .accels
        .iter()
        .map(|&accel| (accel, file.clone().compile(accel, options.threads).map_err(|e| e.to_string())))
        .collect();
    drop(file);
    // Where `auto` is one of the trees, which stand beside it, it says nothing new.
    let is_tree = |s: &Session| s.scene.accel.name() != "list";
    if sessions.iter().any(|(accel, _)| *accel != AccelKind::Auto) {
        sessions.retain(|(accel, s)| *accel != AccelKind::Auto || !s.as_ref().is_ok_and(is_tree));
    }
    let mut candidates = Vec::new();
    for integrator in some_or_default(&options.integrators) {
        for sampler in some_or_default(&options.samplers) {
            for (accel, session) in &sessions {
                let choices = Choices {
                    integrator: integrator.clone(),
                    sampler,
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

/// What the user lists, or one `None`: what the scene asks for.
fn some_or_default<T: Clone>(list: &[T]) -> Vec<Option<T>> {
    if list.is_empty() { vec![None] } else { list.iter().cloned().map(Some).collect() }
}
