//! Regression tests of a folder of scenes against stored references of mean and variance.
//!
//! A reference is a render of many samples, with its variances (`refs/NAME.exr` beside the scene; see [`Reference`]).
//! A test renders the scene anew, with other random numbers and fewer samples, and asks whether both can be
//! estimates of one picture ([`judge`]): so neither another seed fails nor another order of random numbers, but what
//! changes the picture does. How small a change is found depends on the noise of both: each row states the gain that
//! would have been found, and samples are added until it is small enough ([`Options::gain`]).
//!
//! A scene may also say itself what it must show, in closed form ([`Expectations`], `NAME.toml` beside the scene):
//! each of its cases is a variant of the scene, rendered on every traversal by every integrator that claims it, and
//! passes if the whole confidence interval of what was measured lies within the stated bounds.
//!
//! With [`Options::cross_accel`] each scene is rendered on every traversal with the same random numbers instead, and
//! the pictures are compared: they take the same paths, but for rounding.

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

/// The seed of references: that of no test.
pub const REFERENCE_SEED: u64 = u64::MAX;

/// What a run does.
#[derive(Clone, Debug)]
pub struct Options {
    /// Values for the scenes' `<default>`s, and folders to look for files in.
    pub load: LoadOptions,
    /// The traversal of tests against references.
    pub accel: AccelKind,
    /// The traversals of cases; those that turn out to be the same are measured once.
    pub case_accels: Vec<AccelKind>,
    /// Threads; they change the speed, never the pixels.
    pub threads: usize,
    /// Integrator, sampler and seed, where they are chosen. Stop rules and layers are the run's own business.
    pub choices: Choices,
    /// Samples per pixel of a test, whatever its gain; without it, as many as the scene asks for, and up to 16 times
    /// as many until the gain is found.
    pub samples: Option<u64>,
    /// The relative difference of the means that is to be found with a probability of 0.95.
    pub gain: f64,
    /// The probability that any scene of a right renderer fails.
    pub significance: f64,
    /// The largest relMSE where a reference has no variance.
    pub fail: f64,
    /// Whether warnings are errors.
    pub strict: bool,
    /// Which references to write.
    pub update: Option<Update>,
    /// Samples per pixel of a reference; without it, 16 times as many as those of a test, and up to 64 times as many
    /// until its noise leaves room to find the gain.
    pub update_samples: Option<u64>,
    /// The time for each reference. A reference whose time is up is written with the samples that it has.
    pub update_time: Option<Duration>,
    /// Receives sentences about the run, such as the time that a reference will take.
    pub note: fn(&str),
    /// The folder for images of what failed.
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

/// Which references to write.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Update {
    /// Those that are missing.
    Missing,
    /// Those that are missing, and those of tests that fail.
    Failed,
    /// All.
    All,
}

/// How a test ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Status {
    /// The render is what its reference shows.
    Pass,
    /// It is not.
    Fail,
    /// There is no reference.
    New,
    /// The scene cannot be rendered, or a file not be read or written.
    Error,
    /// A reference was written.
    Wrote,
    /// It is not, as it is known, and the scene says why.
    Known,
    /// The run was interrupted before.
    NotRun,
}

impl Status {
    /// All of them, in the order of a summary.
    pub const ALL: [Status; 7] = [
        Status::Pass,
        Status::Wrote,
        Status::Known,
        Status::Fail,
        Status::New,
        Status::Error,
        Status::NotRun,
    ];

    /// The word at the beginning of a line.
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

    /// Whether it is as it should be.
    pub fn is_good(self) -> bool {
        matches!(self, Status::Pass | Status::Wrote)
    }

    /// Whether it is as it was known to be: good, or a failure that is known.
    pub fn is_known(self) -> bool {
        self.is_good() || self == Status::Known
    }
}

/// How the test of a scene, or of one of its cases with one integrator, ended.
#[derive(Clone, Debug)]
pub struct Row {
    /// The scene's name; of a case `SCENE: CASE, INTEGRATOR`.
    pub name: String,
    /// How it ended.
    pub status: Status,
    /// What is wrong, or the figures that decided.
    pub message: String,
    /// Samples per pixel; 0 if nothing was rendered.
    pub samples_per_pixel: u64,
    /// What loading and rendering it took.
    pub elapsed: Duration,
    /// What the scene was warned of.
    pub warnings: Vec<Error>,
    /// The images to look at.
    pub shown: Option<Html>,
    /// What was measured, if it is a case.
    pub case: Option<CaseResult>,
}

/// How a run ended.
#[derive(Clone, Debug)]
pub struct Report {
    /// The scenes, in the order of their names.
    pub rows: Vec<Row>,
    /// The significance of each scene's test.
    pub significance_each: f64,
    /// What the run took.
    pub elapsed: Duration,
}

impl Report {
    /// How many rows there are of a status.
    pub fn count(&self, status: Status) -> usize {
        self.rows.iter().filter(|row| row.status == status).count()
    }

    /// Whether every scene passed, got its reference, or failed as it is known to.
    pub fn is_good(&self) -> bool {
        self.rows.iter().all(|row| row.status.is_known())
    }
}

/// Tests the scenes, one after the other; `each` is shown every row when it is done. What is wrong with a scene
/// is in its row and ends nothing. Once `progress` is interrupted, the scenes that are left are not run.
///
/// # Errors
/// If the traversals are to be compared and there is only one.
pub fn run(
    scenes: &[FoundScene],
    options: &Options,
    progress: &Progress,
    mut each: impl FnMut(&Row),
) -> Result<Report> {
    if options.cross_accel && AccelKind::ALL.len() < 2 {
        return Err(Error::usage(
            "--cross-accel: expected two traversals to compare, this build has obvhs alone (it lacks the feature embree)",
        ));
    }
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
    let mut add = |row: Row| {
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
    Ok(Report { rows, significance_each, elapsed: started.elapsed() })
}

/// How a scene is tested.
struct Test<'a> {
    scene: &'a FoundScene,
    /// What it must show, if it says so.
    expectations: Result<Option<Expectations>>,
    /// Whether it is held against a reference, or gets one, or is compared between traversals.
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

    /// How many tests share the significance of the run.
    fn measurements(&self, options: &Options) -> usize {
        let cases = match &self.expectations {
            Ok(Some(expectations)) => case::measurements(&options.case_accels, expectations),
            _ => 0,
        };
        cases + usize::from(self.by_reference)
    }
}

/// The row of a scene whose reference another one has, too.
fn clash(scene: &FoundScene, other: &str) -> Row {
    let reference = reference_path(&scene.path);
    broken(
        scene,
        format!(
            "{other} has the same reference, {}: expected names that differ in more than the extension",
            reference.display()
        ),
    )
}

/// The row of a scene that cannot be tested.
fn broken(scene: &FoundScene, message: String) -> Row {
    Row {
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
