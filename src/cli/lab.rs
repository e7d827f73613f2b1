//! `buffon lab`: experiments, as text and as a page.

use super::print;
use super::shared::accels;
use crate::accel::AccelKind;
use crate::error::{Error, Result, counted};
use crate::lab::{Experiment, Options, Outcome, Verdict};
use crate::report::{Html, Page};
use crate::session::default_threads;
use clap::Args;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Measure the claims of lectures on Monte Carlo ray tracing.
///
/// Every experiment states claims, measures them with an interval, and decides whether the interval confirms or refutes
/// them. A run refutes a true claim with a probability of at most 0.001. The text goes to standard output; -o also
/// writes a page with plots and images. The seed determines everything but times.
#[derive(Clone, Debug, Args)]
pub struct LabArgs {
    /// The experiments.
    #[arg(value_name = "EXPERIMENT", help = format!(
        "The experiments: {} [default: all]",
        Experiment::ALL.map(Experiment::name).join(", ")
    ))]
    pub experiments: Vec<Experiment>,
    /// List the experiments
    #[arg(long)]
    pub list: bool,
    /// Write a page, DIR/index.html
    #[arg(short, long, value_name = "DIR")]
    pub output: Option<PathBuf>,
    /// Use small images and few samples: seconds instead of minutes, wider intervals
    #[arg(long)]
    pub quick: bool,
    /// Independent repetitions of estimates without images [default: 1000, with --quick 100]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(10..=1_000_000))]
    pub runs: Option<u32>,
    /// Seed of all random numbers
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub seed: u64,
    /// Number of threads, which changes the speed but not the results [default: all cores]
    #[arg(short, long, visible_alias = "nthreads", value_name = "N",
        value_parser = clap::value_parser!(u32).range(1..=4096))]
    pub threads: Option<u32>,
    /// The ray traversal.
    #[arg(long, value_name = "NAME", help = format!("The ray traversal: {} [default: auto]", accels()))]
    pub accel: Option<AccelKind>,
    /// Print only errors on standard error
    #[arg(short, long)]
    pub quiet: bool,
}

/// Runs experiments.
///
/// # Errors
/// If a folder or file cannot be written, or threads cannot be started.
pub fn run(args: &LabArgs) -> Result<u8> {
    if args.list {
        let line = |e: Experiment| format!("{:<16}{}\n", e.name(), e.title());
        return print(&Experiment::ALL.map(line).concat());
    }
    // Errors must occur before minutes of work.
    if let Some(folder) = &args.output {
        std::fs::create_dir_all(folder)
            .map_err(|e| Error::output(format!("{}: cannot be created: {e}", folder.display())))?;
        crate::util::check_replaceable(&folder.join("index.html"))?;
    }
    let options = Options {
        seed: args.seed,
        runs: args.runs.unwrap_or_else(|| Options::default_runs(args.quick)),
        quick: args.quick,
        threads: args.threads.map_or_else(default_threads, |n| n as usize),
        accel: args.accel.unwrap_or_default(),
    };
    let chosen = if args.experiments.is_empty() { &Experiment::ALL[..] } else { &args.experiments };
    let mut outcomes = Vec::new();
    for (i, experiment) in chosen.iter().enumerate() {
        let started = Instant::now();
        let outcome = experiment.run(&options)?;
        if !args.quiet {
            super::report!("buffon: {experiment} took {:.1} s", started.elapsed().as_secs_f64());
        }
        print(&format!("{}{}", if i > 0 { "\n" } else { "" }, outcome.text()))?;
        outcomes.push(outcome);
    }
    print(&format!("\n{}\n", summary(&outcomes)))?;
    if let Some(folder) = &args.output {
        let file = folder.join("index.html");
        page(&outcomes, &options).write(&file)?;
        say_where(args, &file);
    }
    Ok(0)
}

fn say_where(args: &LabArgs, file: &Path) {
    if !args.quiet {
        super::report!("buffon: {}", file.display());
    }
}

/// Returns the numbers of claims that are confirmed, undecided and refuted.
fn summary(outcomes: &[Outcome]) -> String {
    let findings = || outcomes.iter().flat_map(|outcome| &outcome.findings);
    let count = |verdict| findings().filter(|finding| finding.verdict == verdict).count();
    let counts = Verdict::ALL.map(|verdict| format!("{} {}", count(verdict), verdict.word()));
    format!("{}: {}", counted(findings().count() as u64, "claim", "claims"), counts.join(", "))
}

fn page(outcomes: &[Outcome], options: &Options) -> Page {
    let mut page = Page::new("Buffon lab");
    page.lead(&Html::paragraph(
        "What lectures on Monte Carlo ray tracing claim, measured. Intervals hold with 95 % confidence. A claim is \
         confirmed if the intervals of its numbers lie where it says, and refuted if a test rejects that they do. A \
         run refutes a true claim with a probability of at most 0.001.",
    ));
    page.lead(&Html::paragraph(&format!("{}.", summary(outcomes))));
    for outcome in outcomes {
        page.section(outcome.title, outcome.html());
    }
    page.fact("seed", options.seed.to_string());
    page.fact("runs", options.runs.to_string());
    page.circumstances();
    page
}
