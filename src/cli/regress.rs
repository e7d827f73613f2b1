//! `buffon regress`: tests the scenes of a folder against their references.

use super::regress_cases::{CaseLines, Tables};
use super::shared::{MethodArgs, SceneArgs};
use super::{signals, values};
use crate::error::{Error, Result, counted};
use crate::image;
use crate::regress::{self, Found, Options, RegressRow, Report, Status, Update, discover, junit, write_page};
use crate::render::Progress;
use crate::session::Choices;
use crate::util;
use clap::{Args, ValueEnum};
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

/// The exit code when a scene fails, has no reference or cannot be rendered.
const FAILED: u8 = 1;

/// Render the scenes of a folder and test them against stored references.
///
/// A reference is a render of many samples with its variances: refs/NAME.exr beside the scene, with the layer
/// `variance`, or with the variances in refs/NAME_var.exr. --update writes it. A test decides whether the render and
/// the reference can be estimates of the same image: every block of 4x4 pixels by Student's t, and the mean of each
/// channel. A different seed therefore passes, and a change of the expected image fails. A reference without variances
/// is compared by relMSE (--fail), and layers by their means (2 %). NaN, other sizes or channels, and dropped samples
/// always fail.
///
/// A scene may also state its expected values: NAME.toml beside NAME.xml contains cases, each a variant of the scene
/// (-D) with an expected value, its tolerance and the reason. Every case is rendered on every traversal and by every
/// integrator that claims it, and passes if the whole confidence interval of the measured mean lies within the
/// tolerance. A failure that the file lists as known is shown as KNOWN with its cause, and does not fail the run. Such
/// a scene needs no reference. --table writes the cases as a table. --integrator selects one of the integrators that a
/// case claims, and --accel one of the traversals. --seed is the seed of tests; references have a seed of their own.
///
/// Scenes are .xml, .gltf and .glb files in the folder and below. XML files that others include, that have no sensor,
/// or whose root is not `scene` are skipped, and so are folders named refs. The first sensor of a scene is rendered, in
/// linear RGB.
#[derive(Clone, Debug, Args)]
#[command(
    after_help = "Exit codes: 0 all passed (were written, or are known to fail), 1 something failed, has no \
    reference or cannot be rendered, 2 usage, 3 no such folder or no scene in it, 4 an output cannot be \
    written, 128 + n stopped by signal n (after the summary of what was done)."
)]
pub struct RegressArgs {
    /// The folder of scenes
    #[arg(value_name = "DIR")]
    pub folder: PathBuf,
    /// Write references: missing ones, missing and failed ones, or all; each file is replaced as a whole
    #[arg(long, value_name = "WHICH", value_enum, num_args = 0..=1, require_equals = true,
        default_missing_value = "failed", conflicts_with = "cross_accel")]
    pub update: Option<Which>,
    /// Samples per pixel of references [default: 16 times those of a test, and up to 64 times until their noise is
    /// small enough for --gain]
    #[arg(long, value_name = "N", value_parser = values::samples::<2>, requires = "update")]
    pub update_spp: Option<u64>,
    /// The time limit for sampling each reference (90s, 1.5m, 2h). When it is reached, the reference is written with
    /// its number of samples. A reference that will take more than 10 s is announced
    #[arg(long, value_name = "TIME", value_parser = values::duration, requires = "update")]
    pub time: Option<Duration>,
    /// Samples per pixel of tests [default: the scene's, and up to 16 times as many until --gain is reached]
    #[arg(long, value_name = "N", value_parser = values::samples::<2>)]
    pub spp: Option<u64>,
    /// The relative change of brightness to detect with a probability of 0.95; the detectable change is printed for
    /// each scene
    #[arg(long, value_name = "SHARE", default_value_t = 0.005, value_parser = values::positive)]
    pub gain: f64,
    /// The probability that any scene fails although all are correct
    #[arg(long, value_name = "ALPHA", default_value_t = 0.001, value_parser = probability)]
    pub significance: f64,
    /// The largest relMSE that passes for a reference without variances
    #[arg(long, value_name = "RELMSE", default_value_t = 1e-3, value_parser = values::positive)]
    pub fail: f64,
    /// Compare the traversals instead of references: each scene is rendered by the default one, by Embree and by
    /// obvhs with the same random numbers, and the images may differ by rounding (relMSE 1e-3, means 0.1 %, half the
    /// noise; no block by more than its noise)
    #[arg(long, conflicts_with = "accel")]
    pub cross_accel: bool,
    /// Only scenes whose path from DIR contains this
    #[arg(long, value_name = "PATTERN")]
    pub filter: Option<String>,
    /// Write the results as JUnit XML
    #[arg(long, value_name = "FILE")]
    pub junit: Option<PathBuf>,
    /// Write the cases as tables of Markdown (.md) or as JSON (.json); may be given several times
    #[arg(long, value_name = "FILE")]
    pub table: Vec<PathBuf>,
    /// A column of the table for the measurements of another renderer: a JSON object with the names of rows in the
    /// table's JSON as keys and texts as values
    #[arg(long, value_name = "TITLE=FILE", value_parser = values::definition, requires = "table")]
    pub beside: Vec<(String, String)>,
    /// A folder for failed tests: the images, their heat maps, and index.html, a page to compare them
    #[arg(short, long, value_name = "DIR")]
    pub output: Option<PathBuf>,
    /// Integrator, sampler, traversal and seed.
    #[command(flatten)]
    pub method: MethodArgs,
    /// Definitions, folders, memory and threads.
    #[command(flatten)]
    pub resources: SceneArgs,
    /// Treat warnings, and notes about what is not rendered as the file asks for, as errors
    #[arg(long)]
    pub strict: bool,
    /// Print only failures and the summary
    #[arg(short, long)]
    pub quiet: bool,
}

/// The references to write.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Which {
    /// Missing references
    Missing,
    /// Missing references and those of scenes that fail
    Failed,
    /// All references, without a test
    All,
}

impl From<Which> for Update {
    fn from(which: Which) -> Self {
        match which {
            Which::Missing => Update::Missing,
            Which::Failed => Update::Failed,
            Which::All => Update::All,
        }
    }
}

/// Parses a number between 0 and 1.
fn probability(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(v) if v > 0.0 && v < 1.0 => Ok(v),
        _ => Err("expected a number between 0 and 1".into()),
    }
}

/// Runs the tests and prints a line for each scene.
///
/// # Errors
/// If the command line has an error, the folder contains no scene, or an output cannot be written.
pub fn run(args: &RegressArgs) -> Result<u8> {
    for path in args.junit.iter().chain(&args.table) {
        util::check_replaceable(path)?;
    }
    let tables = Tables::new(&args.table, &args.beside)?;
    if let Some(folder) = &args.output {
        std::fs::create_dir_all(folder)
            .map_err(|e| Error::output(format!("the folder cannot be made: {e}")).in_file(folder))?;
    }
    let found = discover(&args.folder, args.filter.as_deref())?;
    if let Some(path) = &args.junit
        && found.scenes.iter().any(|scene| util::is_same_file(&scene.path, path))
    {
        return Err(Error::usage(format!("--junit {}: it is one of the scenes", path.display())));
    }
    let options = options(args);
    image::set_threads(options.threads);
    let progress = Arc::new(Progress::new());
    signals::interrupt(&progress, None)?;
    announce(args, &found)?;
    let width = found.scenes.iter().map(|s| s.name.chars().count()).max().unwrap_or(0);
    let mut printed = Ok(0);
    let mut lines = CaseLines::default();
    let report = regress::run(&found.scenes, &options, &progress, |row| {
        if !args.quiet {
            row.warnings.iter().for_each(|w| super::report!("buffon: warning: {w}"));
        }
        if printed.is_ok() && !(args.quiet && row.status.is_good()) {
            printed = super::print(&lines.line(row).unwrap_or_else(|| line(row, width)));
        }
    });
    printed?;
    let summary = summary(args, &report);
    super::print(&format!("{summary}\n"))?;
    tables.write(&report)?;
    if let Some(path) = &args.junit {
        util::replace(path, junit(&report)?.as_bytes())?;
    }
    if let Some(folder) = &args.output {
        write_page(
            &folder.join("index.html"),
            &format!("buffon regress {}", args.folder.display()),
            &summary,
            &report,
        )?;
    }
    let done = if report.is_good() { 0 } else { FAILED };
    Ok(signals::exit_code().unwrap_or(done))
}

/// Returns the options of the run from the command line.
fn options(args: &RegressArgs) -> Options {
    Options {
        load: args.resources.load_options(args.method.integrator.as_deref()),
        accel: args.method.accel.unwrap_or_default(),
        case_accels: args.method.accel.map_or_else(|| Options::default().case_accels, |kind| vec![kind]),
        threads: args.resources.threads(),
        choices: Choices {
            integrator: args.method.integrator.clone(),
            sampler: args.method.sampler(),
            replace_independent: args.method.replaces_independent(false),
            seed: args.method.seed,
            ..Choices::default()
        },
        samples: args.spp,
        gain: args.gain,
        significance: args.significance,
        fail: args.fail,
        strict: args.strict,
        update: args.update.map(Update::from),
        update_samples: args.update_spp,
        update_time: args.time,
        note: if args.quiet { |_| {} } else { |text| super::report!("buffon: note: {text}") },
        output: args.output.clone(),
        cross_accel: args.cross_accel,
    }
}

/// Prints the names of the skipped files.
fn announce(args: &RegressArgs, found: &Found) -> Result<()> {
    if args.quiet {
        return Ok(());
    }
    for (name, why) in &found.skipped {
        super::print(&format!("skip   {name}: {why}\n"))?;
    }
    Ok(())
}

/// Formats the line of a scene.
fn line(row: &RegressRow, width: usize) -> String {
    let samples = match row.samples_per_pixel {
        0 => String::new(),
        n => format!("{n} spp"),
    };
    // A message may have several lines, with the place of an error.
    let message = row.message.replace('\n', "\n       ");
    format!(
        "{:<5}  {:<width$}  {samples:>10}  {:>6.2} s  {message}\n",
        row.status.word(),
        row.name,
        row.elapsed.as_secs_f64()
    )
}

/// Returns the number of scenes with each result and the method of the test.
fn summary(args: &RegressArgs, report: &Report) -> String {
    let word = |status| match status {
        Status::Pass => "passed",
        Status::Wrote => "written",
        Status::Known => "known to fail",
        Status::Fail => "failed",
        Status::New => "without a reference",
        Status::Error => "with an error",
        Status::NotRun => "not run",
    };
    let counts = Status::ALL.into_iter().map(|status| (report.count(status), status));
    let counts: Vec<String> =
        counts.filter(|(n, _)| *n > 0).map(|(n, status)| format!("{n} {}", word(status))).collect();
    let cases = report.rows.iter().filter(|row| row.case.is_some()).count();
    let scenes = match (report.rows.len() - cases, cases) {
        (scenes, 0) => counted(scenes as u64, "scene", "scenes"),
        (0, cases) => counted(cases as u64, "case", "cases"),
        (scenes, cases) => {
            let scenes = counted(scenes as u64, "scene", "scenes");
            format!("{scenes} and {}", counted(cases as u64, "case", "cases"))
        }
    };
    format!(
        "{scenes}: {} in {:.1} s (seed {}, significance {} over all, {:.1e} for each test)",
        counts.join(", "),
        report.elapsed.as_secs_f64(),
        args.method.seed,
        args.significance,
        report.significance_each
    )
}
