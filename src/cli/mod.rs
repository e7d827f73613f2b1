//! The command line: one file per subcommand.

#![deny(clippy::print_stderr)]

/// Writes a line to standard error. A line that cannot be written is lost, because the work matters more than its
/// report: `eprintln!` would panic on a full disk or a closed pipe.
macro_rules! report {
    ($($argument:tt)*) => {{
        use std::io::Write as _;
        _ = writeln!(std::io::stderr().lock(), $($argument)*);
    }};
}
use report;

pub mod bench;
pub mod check;
pub mod checkpoint;
pub mod compare;
pub mod convert;
pub mod cpu;
pub mod diff;
mod display_server;
mod frames;
pub mod info;
pub mod info_image;
pub mod lab;
pub mod merge;
mod outputs;
mod photon_notes;
pub mod plan;
pub mod progress;
pub mod regress;
mod regress_cases;
pub mod render;
mod sampling;
pub mod shared;
pub mod shell;
mod signals;
pub mod stats;
mod summary;
pub mod values;
mod watch;

use crate::error::{Error, Kind};
use clap::{Parser, Subcommand};
use std::ffi::OsString;
use std::path::Path;
use std::process::ExitCode;

/// Buffon renders scenes by Monte Carlo integration and estimates the error of each image.
///
/// `buffon SCENE ...` is short for `buffon render SCENE ...`.
#[derive(Debug, Parser)]
#[command(name = "buffon", version = VERSION, propagate_version = true, max_term_width = 100)]
#[command(
    after_help = "Exit codes: 0 done, 1 internal error, 2 usage, 3 scene or asset, 4 reading or writing \
    output, 5 invalid samples, warnings or approximations under --strict, 85 stopped by a signal with a \
    checkpoint written, 128 + n stopped by signal n (what there is was written)."
)]
pub struct Cli {
    #[command(subcommand)]
    command: Command,
}

/// Name, version, commit, and the libraries of this build.
const VERSION: &str = env!("BUFFON_VERSION");

#[derive(Debug, Subcommand)]
enum Command {
    Render(Box<render::RenderArgs>),
    Plan(plan::PlanArgs),
    Merge(merge::MergeArgs),
    Diff(diff::DiffArgs),
    Compare(compare::CompareArgs),
    Convert(convert::ConvertArgs),
    Bench(Box<bench::BenchArgs>),
    Regress(Box<regress::RegressArgs>),
    Info(info::InfoArgs),
    Check(check::CheckArgs),
    Lab(lab::LabArgs),
    Completions(shell::CompletionsArgs),
    Man(shell::ManArgs),
}

/// Parses the command line, runs the command and returns the exit code.
pub fn main() -> ExitCode {
    let cli = match Cli::try_parse_from(with_subcommand(std::env::args_os().collect())) {
        Ok(cli) => cli,
        Err(error) => {
            let code = if error.use_stderr() { Kind::Usage.exit_code() } else { 0 };
            // A closed pipe is not an error.
            let _ = error.print();
            return ExitCode::from(code);
        }
    };
    let result = match cli.command {
        Command::Render(args) => render::run(&args),
        Command::Plan(args) => plan::run(&args),
        Command::Merge(args) => merge::run(&args),
        Command::Diff(args) => diff::run(&args),
        Command::Compare(args) => compare::run(&args),
        Command::Convert(args) => convert::run(&args),
        Command::Bench(args) => bench::run(&args),
        Command::Regress(args) => regress::run(&args),
        Command::Info(args) => info::run(&args),
        Command::Check(args) => check::run(&args),
        Command::Lab(args) => lab::run(&args),
        Command::Completions(args) => shell::completions(&args),
        Command::Man(args) => shell::man(&args),
    };
    match result {
        Ok(code) => ExitCode::from(code),
        Err(error) => {
            report!("buffon: {error}");
            ExitCode::from(error.kind.exit_code())
        }
    }
}

/// Inserts `render` if the first argument is a file or an option of it instead of a subcommand, none of which has an
/// extension.
fn with_subcommand(mut arguments: Vec<OsString>) -> Vec<OsString> {
    const OWN: [&str; 4] = ["-h", "--help", "-V", "--version"];
    let renders = |first: &OsString| {
        let text = first.to_string_lossy();
        Path::new(first).extension().is_some() || text.starts_with('-') && !OWN.contains(&&*text)
    };
    if arguments.get(1).is_some_and(renders) {
        arguments.insert(1, "render".into());
    }
    arguments
}

/// Writes text or the bytes of a file to standard output. A closed pipe is not an error.
fn print(bytes: &(impl AsRef<[u8]> + ?Sized)) -> Result<u8, Error> {
    use std::io::Write;
    let mut out = std::io::stdout();
    match out.write_all(bytes.as_ref()).and_then(|()| out.flush()) {
        Err(e) if e.kind() != std::io::ErrorKind::BrokenPipe => {
            Err(Error::output(format!("cannot write to standard output: {e}")))
        }
        _ => Ok(0),
    }
}
