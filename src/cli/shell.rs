//! `buffon completions` and `buffon man`: what a shell and a terminal want to know.

use super::{Cli, print};
use crate::error::{Error, Result};
use clap::{Args, CommandFactory};
use clap_complete::Shell;

/// Print a completion script for a shell.
#[derive(Debug, Args)]
pub struct CompletionsArgs {
    /// The shell
    pub shell: Shell,
}

/// Print the manual page.
#[derive(Debug, Args)]
pub struct ManArgs {
    /// The subcommand to describe; without it, the program
    pub subcommand: Option<String>,
}

/// Prints the script.
///
/// # Errors
/// If standard output cannot be written to.
pub fn completions(args: &CompletionsArgs) -> Result<u8> {
    let mut text = Vec::new();
    clap_complete::generate(args.shell, &mut Cli::command(), "buffon", &mut text);
    print(&String::from_utf8_lossy(&text))
}

/// Prints the page.
///
/// # Errors
/// If there is no such subcommand, or standard output cannot be written to.
pub fn man(args: &ManArgs) -> Result<u8> {
    let mut command = Cli::command();
    command.build();
    let page = match &args.subcommand {
        None => command,
        Some(name) => command
            .find_subcommand(name)
            .cloned()
            .map(|c| c.name(format!("buffon-{name}")))
            .ok_or_else(|| Error::usage(format!("expected a subcommand of buffon, found \"{name}\"")))?,
    };
    let mut text = Vec::new();
    clap_mangen::Man::new(page)
        .render(&mut text)
        .map_err(|e| Error::internal(format!("cannot write the manual page: {e}")))?;
    print(&String::from_utf8_lossy(&text))
}
