//! `--checkpoint` and `--resume`: writing and reading the state of a render.

use super::render::RenderArgs;
use crate::error::{Error, Result};
use crate::integrator::settings::WhenPays;
use crate::render::RenderState;
use crate::session::checkpoint::{CheckpointLabel, Identity, file};
use crate::session::{Choices, Plan, SceneHashes, Session, connected};
use crate::util;
use std::path::PathBuf;

/// The checkpoint file of a render and its label.
pub struct Checkpointing {
    path: PathBuf,
    label: CheckpointLabel,
    first: u64,
    resumed: Option<RenderState>,
    quiet: bool,
}

impl Checkpointing {
    /// Checks the options of the command line; with `--resume`, reads the state from the file if it exists. A resumed
    /// render distributes its samples over the pixels as before, unless the user chooses otherwise: `--time` may have
    /// begun it and `--spp` may go on.
    ///
    /// # Errors
    /// If the file exists and cannot be resumed, is of a different render, or cannot be written.
    pub fn open(
        args: &RenderArgs,
        session: &Session,
        plan: &mut Plan,
        origin: Option<SceneHashes>,
    ) -> Result<Option<Self>> {
        let Some((path, origin)) = args.checkpoint.clone().zip(origin) else { return Ok(None) };
        util::check_replaceable(&path)?;
        let loaded = match (path.exists(), args.resume) {
            (true, true) => Some(file::load(&path)?),
            (true, false) => {
                return Err(Error::usage(format!(
                    "--checkpoint {}: it is there already; --resume goes on from it, or remove it",
                    path.display()
                )));
            }
            (false, resume) => {
                if resume && !args.quiet {
                    super::report!("buffon: note: {} does not exist: starting a new render", path.display());
                }
                None
            }
        };
        if let Some(checkpoint) = loaded.as_ref().filter(|_| args.adaptive == WhenPays::Auto) {
            plan.keep_adaptive(checkpoint.label.identity.adaptive);
        }
        let identity = Identity::of(session, plan, origin);
        let image_description = session.image_description(plan);
        let rect = image_description.rect;
        let (first, end) = (plan.first, plan.job.stop.samples);
        let resumed =
            loaded.map(|checkpoint| checkpoint.resume(&path, &identity, rect, first, end)).transpose()?;
        let label = CheckpointLabel { identity, image_description, samples: Vec::new(), target: plan.target };
        Ok(Some(Checkpointing { path, label, first, resumed, quiet: args.quiet }))
    }

    /// Lets a resumed render keep the bias that is known. If pilots chose the integrator when it began, it keeps that.
    ///
    /// # Errors
    /// If the file cannot be read.
    pub fn keep_integrator(args: &RenderArgs, session: &Session, choices: &mut Choices) -> Result<()> {
        let begun = args.checkpoint.as_ref().filter(|path| args.resume && path.exists());
        let Some(path) = begun else { return Ok(()) };
        let CheckpointLabel { identity, image_description, .. } = file::label(path)?;
        choices.squared_bias = image_description.squared_bias;
        let Some(question) = session.question(choices)? else { return Ok(()) };
        if question.has_answer(&identity.integrator) {
            choices.connections = connected(&identity.integrator);
            choices.integrator = Some(identity.integrator);
            (choices.allow_bias, choices.costs) = (None, None);
        }
        Ok(())
    }

    /// Returns the state to resume from, once.
    pub fn take_state(&mut self) -> Option<RenderState> {
        self.resumed.take()
    }

    /// Writes a state. If that fails, an older file remains, and a warning is printed.
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
            super::report!("buffon: warning: {error}");
        }
        saved
    }
}
