//! Regression tests of a folder of scenes, with stored references of mean and variance.
//!
//! A reference is a render of many samples with its variances (`refs/NAME.exr` beside the scene; see [`Reference`]). A
//! test renders the scene again, with different random numbers and fewer samples, and tests whether both images can be
//! estimates of the same image ([`judge`]). A different seed or a different order of random numbers therefore passes,
//! whereas a change of the expected image fails. The smallest detectable change depends on the noise of both images.
//! Each row states the detectable gain, and samples are added until it is small enough ([`Options::gain`]).
//!
//! A scene may also state its expected values in closed form ([`Expectations`], `NAME.toml` beside the scene). Each of
//! its cases is a variant of the scene, rendered on every traversal by every integrator that claims it. A case passes
//! if the whole confidence interval of the measured mean lies within the stated bounds.
//!
//! With [`Options::cross_accel`], each scene is instead rendered on every traversal with the same random numbers, and
//! the images are compared. Their paths are the same except for rounding.

mod case;
mod cross;
mod discover;
mod expectation;
mod judge;
mod junit;
mod page;
mod reference;
mod region;
mod runner;
mod table;

pub use case::{CaseResult, Measured};
pub use discover::{Found, FoundScene, discover};
pub use expectation::{Case, Claim, Expectations, Known, expectations_path};
pub use judge::{Judgement, Rules, judge};
pub use junit::junit;
pub use page::write_page;
pub use reference::{Reference, reference_path, variance_path, write_reference};
pub use region::Region;
pub use table::{Beside, json, markdown};

use crate::accel::AccelKind;
use crate::error::{Error, Result};
use crate::estimate::student::share;
use crate::loader::LoadOptions;
use crate::render::Progress;
use crate::report::Html;
use crate::session::{Choices, default_threads};
use runner::Runner;
use std::collections::HashMap;
use std::path::PathBuf;
use std::time::{Duration, Instant};

/// The seed of references, which no test uses.
pub const REFERENCE_SEED: u64 = u64::MAX;

/// The options of a run.
#[derive(Clone, Debug)]
pub struct Options {
    /// Values for the scenes' `<default>`s, and search folders for files.
    pub load: LoadOptions,
    /// The traversal of tests against references.
    pub accel: AccelKind,
    /// The traversals of cases. If two options select the same traversal, it is measured once.
    pub case_accels: Vec<AccelKind>,
    /// The number of threads, which changes the speed but not the pixels.
    pub threads: usize,
    /// Integrator, sampler and seed, if the user chose them. The run sets stop rules and layers itself.
    pub choices: Choices,
    /// Samples per pixel of a test, regardless of its gain; without it, the scene's own number, and up to 16 times as
    /// many until the gain is reached.
    pub samples: Option<u64>,
    /// The relative difference of the means that a test must detect with a probability of 0.95.
    pub gain: f64,
    /// The probability that any scene fails with a correct renderer.
    pub significance: f64,
    /// The largest accepted relMSE for a reference without variances.
    pub fail: f64,
    /// Whether warnings and approximations are errors.
    pub strict: bool,
    /// The references to write.
    pub update: Option<Update>,
    /// Samples per pixel of a reference; without it, 16 times as many as those of a test, and up to 64 times as many
    /// until its noise is small enough to detect the gain.
    pub update_samples: Option<u64>,
    /// The time limit for each reference. When it is reached, the reference is written with the samples taken so far.
    pub update_time: Option<Duration>,
    /// A function that receives sentences about the run, such as the time that a reference will take.
    pub note: fn(&str),
    /// The folder for images of failed tests.
    pub output: Option<PathBuf>,
    /// Whether to compare the traversals instead of references.
    pub cross_accel: bool,
}

impl Default for Options {
    fn default() -> Self {
        Options {
            load: LoadOptions::default(),
            accel: AccelKind::default(),
            case_accels: [AccelKind::ALL, &[AccelKind::Auto]].concat(),
            threads: default_threads(),
            choices: Choices::default(),
            samples: None,
            gain: 0.005,
            significance: 0.001,
            fail: 1e-3,
            strict: false,
            update: None,
            update_samples: None,
            update_time: None,
            note: |_| {},
            output: None,
            cross_accel: false,
        }
    }
}

/// The references to write.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Update {
    /// Missing references.
    Missing,
    /// Missing references and those of failed tests.
    Failed,
    /// All references.
    All,
}

/// The result of a test.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Status {
    /// The render agrees with its reference or claim.
    Pass,
    /// The render does not agree with its reference or claim.
    Fail,
    /// There is no reference.
    New,
    /// The scene cannot be rendered, or a file cannot be read or written.
    Error,
    /// A reference was written.
    Wrote,
    /// The test fails as the scene's cases state, with a cause.
    Known,
    /// The run was interrupted before the test.
    NotRun,
}

impl Status {
    /// All results, in the order of a summary.
    pub const ALL: [Status; 7] = [
        Status::Pass,
        Status::Wrote,
        Status::Known,
        Status::Fail,
        Status::New,
        Status::Error,
        Status::NotRun,
    ];

    /// Returns the word at the beginning of a line.
    pub fn word(self) -> &'static str {
        match self {
            Status::Pass => "PASS",
            Status::Fail => "FAIL",
            Status::New => "NEW",
            Status::Error => "ERROR",
            Status::Wrote => "WROTE",
            Status::Known => "KNOWN",
            Status::NotRun => "-",
        }
    }

    /// Returns whether the test passed or its reference was written.
    pub fn is_good(self) -> bool {
        matches!(self, Status::Pass | Status::Wrote)
    }

    /// Returns whether the result is good or a known failure.
    pub fn is_known(self) -> bool {
        self.is_good() || self == Status::Known
    }
}

/// The result of the test of a scene, or of one of its cases with one integrator.
#[derive(Clone, Debug)]
pub struct RegressRow {
    /// The scene's name; for a case, `SCENE: CASE, INTEGRATOR`.
    pub name: String,
    /// The result.
    pub status: Status,
    /// The faults, or the figures on which the decision is based.
    pub message: String,
    /// Samples per pixel; 0 if nothing was rendered.
    pub samples_per_pixel: u64,
    /// The time for loading and rendering.
    pub elapsed: Duration,
    /// The warnings about the scene.
    pub warnings: Vec<Error>,
    /// The images to show.
    pub shown: Option<Html>,
    /// The measurements, for a case.
    pub case: Option<CaseResult>,
}

/// The result of a run.
#[derive(Clone, Debug)]
pub struct Report {
    /// The scenes, in the order of their names.
    pub rows: Vec<RegressRow>,
    /// The significance of each scene's test.
    pub significance_each: f64,
    /// The time of the run.
    pub elapsed: Duration,
}

impl Report {
    /// Returns the number of rows with a status.
    pub fn count(&self, status: Status) -> usize {
        self.rows.iter().filter(|row| row.status == status).count()
    }

    /// Returns whether every scene passed, had its reference written, or failed as it is known to.
    pub fn is_good(&self) -> bool {
        self.rows.iter().all(|row| row.status.is_known())
    }
}

/// Tests the scenes one after another, and passes each finished row to `each`. A scene with an error gets a row and
/// does not end the run. If `progress` is interrupted, the remaining scenes are not run.
pub fn run(
    scenes: &[FoundScene],
    options: &Options,
    progress: &Progress,
    mut each: impl FnMut(&RegressRow),
) -> Report {
    let started = Instant::now();
    let tests: Vec<Test<'_>> = scenes.iter().map(|scene| Test::new(scene, options)).collect();
    let measurements: usize = tests.iter().map(|test| test.measurements(options)).sum();
    let significance_each = share(options.significance, measurements.max(1));
    let runner = Runner::new(options, significance_each, progress);
    let mut users: HashMap<PathBuf, Vec<&str>> = HashMap::new();
    for scene in scenes {
        users.entry(reference_path(&scene.path)).or_default().push(&scene.name);
    }
    let mut rows = Vec::with_capacity(scenes.len());
    let mut add = |row: RegressRow| {
        each(&row);
        rows.push(row);
    };
    for Test { scene, expectations, by_reference } in &tests {
        match expectations {
            Ok(Some(expectations)) => case::rows(&runner, scene, expectations, &mut add),
            Ok(None) => {}
            Err(error) => add(broken(scene, error.to_string())),
        }
        let others = users[&reference_path(&scene.path)].iter().find(|name| **name != scene.name);
        match others {
            _ if !by_reference => {}
            Some(other) if !options.cross_accel => add(clash(scene, other)),
            _ => add(runner.row(scene)),
        }
    }
    Report { rows, significance_each, elapsed: started.elapsed() }
}

/// The test of a scene.
struct Test<'a> {
    scene: &'a FoundScene,
    /// The scene's cases, if it has any.
    expectations: Result<Option<Expectations>>,
    /// Whether the scene is compared with a reference, gets one, or is compared between traversals.
    by_reference: bool,
}

impl<'a> Test<'a> {
    fn new(scene: &'a FoundScene, options: &Options) -> Self {
        let cases_count = options.update.is_none() && !options.cross_accel;
        let has_cases = expectations_path(&scene.path).exists();
        Test {
            scene,
            expectations: if cases_count { Expectations::read(&scene.path) } else { Ok(None) },
            by_reference: options.cross_accel || !has_cases || reference_path(&scene.path).exists(),
        }
    }

    /// Returns the number of tests among which the significance of the run is divided.
    fn measurements(&self, options: &Options) -> usize {
        let cases = match &self.expectations {
            Ok(Some(expectations)) => case::measurements(&options.case_accels, expectations),
            _ => 0,
        };
        cases + usize::from(self.by_reference)
    }
}

/// Creates the row of a scene that has the same reference file as another scene.
fn clash(scene: &FoundScene, other: &str) -> RegressRow {
    let reference = reference_path(&scene.path);
    broken(
        scene,
        format!(
            "{other} has the same reference, {}: expected names that differ in more than the extension",
            reference.display()
        ),
    )
}

/// Creates the row of a scene that cannot be tested.
fn broken(scene: &FoundScene, message: String) -> RegressRow {
    RegressRow {
        name: scene.name.clone(),
        status: Status::Error,
        message,
        samples_per_pixel: 0,
        elapsed: Duration::ZERO,
        warnings: Vec::new(),
        shown: None,
        case: None,
    }
}
