//! `buffon bench`: error against time.

use super::shared::{AutoArgs, SceneArgs, ViewArgs, accels, integrators, samplers};
use super::{signals, values};
use crate::accel::AccelKind;
use crate::bench::{self, Budget, Options};
use crate::error::{Error, Result};
use crate::image;
use crate::render::Progress;
use crate::sampling::SamplerKind;
use crate::session::SceneChoices;
use crate::util;
use clap::Args;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

/// Measure error against time.
///
/// Renders every scene with every combination of integrator, sampler, ray traversal and budget, several times. The
/// renders take turns, and each image is compared with a reference. Prints a table, and writes index.html (one
/// self-contained page: plots, images, a side-by-side viewer), bench.csv (a line for each render) and bench.json to a
/// folder.
///
/// The reference is that of --reference, else refs/NAME.exr beside the scene. Without either, the path integrator
/// renders one with 32 times the largest budget and keeps it in $XDG_CACHE_HOME/buffon or ~/.cache/buffon. The
/// reference's own error is reported with the measurements.
#[derive(Clone, Debug, Args)]
pub struct BenchArgs {
    /// The scene files
    #[arg(required = true)]
    pub scenes: Vec<PathBuf>,
    /// Integrators.
    #[arg(long, value_name = "LIST", value_delimiter = ',', help = format!(
        "Integrators, separated by commas, of {} [default: the scene's]",
        integrators()
    ))]
    pub integrators: Vec<String>,
    /// The choice by auto.
    #[command(flatten)]
    pub auto: AutoArgs,
    /// Instead of all that, measure what a ray of each integrator costs in the scenes on this machine, with the first
    /// budget, and write a file for --auto-costs
    #[arg(long, value_name = "FILE", conflicts_with_all = OF_COMPARISONS)]
    pub calibrate: Option<PathBuf>,
    /// Samplers.
    #[arg(long, value_name = "LIST", value_delimiter = ',', help = format!(
        "Samplers, separated by commas, of {} [default: the scene's, and sobol instead of independent]",
        samplers()
    ))]
    pub samplers: Vec<SamplerKind>,
    /// Ray traversals.
    #[arg(long, value_name = "LIST", value_delimiter = ',', help = format!(
        "Ray traversals, separated by commas, of {} [default: all, and auto where it is none of the others]",
        accels()
    ))]
    pub accels: Vec<AccelKind>,
    /// The budgets of each render: times (1s,2s,4s) or samples per pixel (16,64,256)
    #[arg(long, value_name = "LIST", default_value = "1s,2s,4s")]
    pub budgets: String,
    /// The reference; needs a single scene
    #[arg(long, value_name = "FILE")]
    pub reference: Option<PathBuf>,
    /// The time limit for rendering a reference, for each scene
    #[arg(long, value_name = "TIME", default_value = "2m", value_parser = values::duration)]
    pub reference_time: Duration,
    /// The folder for the page, CSV and JSON
    #[arg(short, long, value_name = "DIR", default_value = "bench")]
    pub output: PathBuf,
    /// Number of renders for each budget, each with a different seed
    #[arg(long, value_name = "N", default_value_t = 3, value_parser = clap::value_parser!(u32).range(1..=10_000))]
    pub runs: u32,
    /// Definitions, folders, memory and threads.
    #[command(flatten)]
    pub resources: SceneArgs,
    /// Sensor and size.
    #[command(flatten)]
    pub view: ViewArgs,
    /// Seed of the first run
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub seed: u64,
    /// Print only the table and errors
    #[arg(short, long)]
    pub quiet: bool,
}

/// The options that a calibration does not use.
const OF_COMPARISONS: [&str; 8] = [
    "integrators",
    "samplers",
    "accels",
    "reference",
    "output",
    "auto_costs",
    "allow_bias",
    "bdpt_connections",
];

/// Measures, prints the table and writes the files.
///
/// # Errors
/// If the command line, a scene, the reference or the output has an error.
pub fn run(args: &BenchArgs) -> Result<u8> {
    let options = options(args)?;
    if let Some(file) = &args.calibrate {
        return calibrate(args, &options, file);
    }
    let files = ["index.html", "bench.csv", "bench.json"].map(|name| args.output.join(name));
    make_folder(&args.output)?;
    files.iter().try_for_each(|file| util::check_replaceable(file))?;
    let (progress, tell) = begin(args, options.threads)?;
    let report = bench::run(options, &progress, &tell)?;
    super::print(&bench::text(&report))?;
    if !report.scenes.is_empty() {
        let [page, csv, json] = &files;
        bench::page(&report, &args.output)?.write(page)?;
        util::replace(csv, &bench::csv(&report)?)?;
        util::replace(json, format!("{:#}\n", bench::json(&report)).as_bytes())?;
        tell(&format!("wrote {}", page.display()));
    }
    Ok(signals::exit_code().unwrap_or(0))
}

/// Writes the costs of integrators.
fn calibrate(args: &BenchArgs, options: &Options, file: &Path) -> Result<u8> {
    util::check_replaceable(file)?;
    let (progress, tell) = begin(args, options.threads)?;
    match bench::calibrate(options, file, &progress, &tell)? {
        Some(calibration) => {
            super::print(&bench::calibration_text(&calibration))?;
            util::replace(file, calibration.costs.to_json().as_bytes())?;
            tell(&format!("wrote {}", file.display()));
        }
        None => super::report!("buffon: interrupted: {} is left as it was", file.display()),
    }
    Ok(signals::exit_code().unwrap_or(0))
}

/// Prepares for measurements: returns their progress, and what tells the user about each step.
fn begin(args: &BenchArgs, threads: usize) -> Result<(Arc<Progress>, impl Fn(&str) + use<>)> {
    image::set_threads(threads);
    let progress = Arc::new(Progress::new());
    signals::interrupt(&progress, None)?;
    let quiet = args.quiet;
    let tell = move |line: &str| {
        if !quiet {
            super::report!("buffon: {line}");
        }
    };
    Ok((progress, tell))
}

fn options(args: &BenchArgs) -> Result<Options> {
    let budgets = Budget::list(&args.budgets).map_err(|e| Error::usage(e).about("--budgets"))?;
    let mut accels = if args.accels.is_empty() { AccelKind::CHOICES.to_vec() } else { args.accels.clone() };
    let (mut integrators, mut samplers) = (args.integrators.clone(), args.samplers.clone());
    accels = each_once(accels);
    integrators = each_once(integrators);
    samplers = each_once(samplers);
    Ok(Options {
        scenes: args.scenes.clone(),
        choices: SceneChoices {
            load: args.resources.load_options(args.integrators.first().map(String::as_str)),
            sensor: args.view.sensor,
            size: args.view.size,
            crop: None,
        },
        integrators,
        allow_bias: args.auto.allow_bias,
        costs: args.auto.costs()?,
        connections: args.auto.bdpt_connections,
        samplers,
        accels,
        budgets,
        runs: args.runs,
        seed: args.seed,
        threads: args.resources.threads(),
        reference: args.reference.clone(),
        reference_time: args.reference_time,
    })
}

/// Returns the list without duplicates.
fn each_once<T: PartialEq>(list: Vec<T>) -> Vec<T> {
    let mut once = Vec::with_capacity(list.len());
    for item in list {
        if !once.contains(&item) {
            once.push(item);
        }
    }
    once
}

fn make_folder(folder: &Path) -> Result<()> {
    std::fs::create_dir_all(folder).map_err(|e| {
        let reason = std::io::Error::from(e.kind());
        Error::output(format!("cannot be made: {reason}")).in_file(folder)
    })
}
