//! `--checkpoint` and `--resume`: the states of a render, to a file and from it.

use super::render::RenderArgs;
use crate::error::{Error, Result};
use crate::render::RenderState;
use crate::session::checkpoint::{CheckpointLabel, Identity, file};
use crate::session::{Plan, SceneHashes, Session};
use crate::util;
use std::path::PathBuf;

/// Where the states of a render go, and what they are.
pub struct Checkpointing {
    path: PathBuf,
    label: CheckpointLabel,
    first: u64,
    resumed: Option<RenderState>,
    quiet: bool,
}

impl Checkpointing {
    /// What the command line asks for; with `--resume` the state of the file, if it is there.
    ///
    /// # Errors
    /// If the file is there and not to be gone on from, is one of another render, or cannot be written.
    pub fn open(
        args: &RenderArgs,
        session: &Session,
        plan: &Plan,
        origin: Option<SceneHashes>,
    ) -> Result<Option<Self>> {
        let Some((path, origin)) = args.checkpoint.clone().zip(origin) else { return Ok(None) };
        util::check_replaceable(&path)?;
        let identity = Identity::of(session, plan, origin);
        let resumed = match (path.exists(), args.resume) {
            (true, true) => {
                Some(file::load(&path)?.resume(&path, &identity, plan.first, plan.job.stop.samples)?)
            }
            (true, false) => {
                return Err(Error::usage(format!(
                    "--checkpoint {}: it is there already; --resume goes on from it, or remove it",
                    path.display()
                )));
            }
            (false, resume) => {
                if resume && !args.quiet {
                    eprintln!("buffon: note: {} does not exist: starting a new render", path.display());
                }
                None
            }
        };
        let label = CheckpointLabel {
            identity,
            image_description: session.image_description(plan),
            samples: Vec::new(),
            target: plan.target,
        };
        Ok(Some(Checkpointing { path, label, first: plan.first, resumed, quiet: args.quiet }))
    }

    /// The state to go on from, once.
    pub fn take_state(&mut self) -> Option<RenderState> {
        self.resumed.take()
    }

    /// Writes a state; an older file stays if that fails, and is told of.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn save(&self, state: &RenderState) -> Result<()> {
        let range = self.first..state.next;
        let samples = if range.is_empty() { Vec::new() } else { vec![range] };
        let saved = file::save(&self.path, &CheckpointLabel { samples, ..self.label.clone() }, state);
        if let Err(error) = &saved
            && !self.quiet
        {
            eprintln!("buffon: warning: {error}");
        }
        saved
    }
}
