//! `buffon completions` and `buffon man`: completion scripts and manual pages.

use super::{Cli, print};
use crate::error::{Error, Result};
use crate::util::replace;
use clap::{Args, CommandFactory};
use clap_complete::Shell;
use std::path::PathBuf;

/// Print a completion script for a shell.
#[derive(Debug, Args)]
pub struct CompletionsArgs {
    /// The shell
    pub shell: Shell,
}

/// Print a manual page, or write all of them.
///
/// `buffon man --dir ~/.local/share/man/man1` installs the pages for `man buffon` and `man buffon-render`.
#[derive(Debug, Args)]
pub struct ManArgs {
    /// The subcommand to describe; without it, the program
    pub subcommand: Option<String>,
    /// Write the pages of the program and of all subcommands to a folder, which is created if it is missing
    #[arg(long, value_name = "DIR", conflicts_with = "subcommand")]
    pub dir: Option<PathBuf>,
}

/// Prints the script.
///
/// # Errors
/// If standard output cannot be written to.
pub fn completions(args: &CompletionsArgs) -> Result<u8> {
    let mut text = Vec::new();
    clap_complete::generate(args.shell, &mut Cli::command(), "buffon", &mut text);
    print(&text)
}

/// Prints a page or writes all pages.
///
/// # Errors
/// If there is no such subcommand, or a page cannot be written.
pub fn man(args: &ManArgs) -> Result<u8> {
    let mut command = Cli::command().disable_help_subcommand(true);
    command.build();
    let subcommands = command.get_subcommands().map(|c| c.clone().name(format!("buffon-{}", c.get_name())));
    let pages: Vec<clap::Command> = subcommands.chain([command.clone()]).collect();
    let Some(folder) = &args.dir else {
        let name = args.subcommand.as_ref().map_or_else(|| "buffon".into(), |name| format!("buffon-{name}"));
        let page = pages.into_iter().find(|page| page.get_name() == name).ok_or_else(|| {
            let name = args.subcommand.as_deref().unwrap_or_default();
            Error::usage(format!("expected a subcommand of buffon, found \"{name}\""))
        })?;
        return print(&rendered(page)?);
    };
    std::fs::create_dir_all(folder)
        .map_err(|e| Error::output(format!("the folder cannot be made: {e}")).in_file(folder))?;
    for page in pages {
        replace(&folder.join(format!("{}.1", page.get_name())), &rendered(page)?)?;
    }
    Ok(0)
}

/// Returns a manual page.
fn rendered(page: clap::Command) -> Result<Vec<u8>> {
    let mut text = Vec::new();
    clap_mangen::Man::new(page)
        .render(&mut text)
        .map_err(|e| Error::internal(format!("cannot write the manual page: {e}")))?;
    Ok(text)
}
