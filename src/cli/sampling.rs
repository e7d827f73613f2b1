//! Sampling, with those who get the image so far: files, a viewer, a page, and checkpoints.

use super::checkpoint::Checkpointing;
use super::display_server::{self, DisplayServer};
use super::outputs::is_piped;
use super::progress::{ProgressKind, Watcher};
use super::render::RenderArgs;
use super::shared::DisplayArgs;
use super::summary::warn;
use super::watch::{self, Watch};
use crate::error::{Error, Result};
use crate::image::{self, WriteOptions};
use crate::memory::Reservation;
use crate::render::{CheckpointSink, PreviewSink, Progress, RenderState, Rendered, Sinks, StopRules};
use crate::session::{Plan, Session};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Instant;

/// Renders a plan, and gives the image so far to all who want it.
///
/// # Errors
/// If the render fails, or there is no memory for the copies of the image.
pub fn sample(
    args: &RenderArgs,
    session: &Session,
    plan: &Plan,
    progress: &Arc<Progress>,
    checkpoint: Option<Checkpointing>,
    watch: Option<&Watch>,
) -> Result<Rendered> {
    let _copies = reserve_copies(args, session, plan)?;
    let kind = if args.quiet { ProgressKind::None } else { args.progress };
    let pixels = session.camera().film.rect().area();
    // The progress counts from the first sample of the range.
    let samples = plan.job.stop.samples.map(|end| end.saturating_sub(plan.first));
    let rules = StopRules { samples, ..plan.job.stop };
    let watcher = Watcher::start(kind, progress.clone(), pixels, rules);
    let name = args.output.iter().find(|target| !is_piped(target)).unwrap_or(&args.scene);
    let viewer =
        args.display_server.as_ref().map(|address| DisplayServer::connect(address, name, args.quiet));
    let viewer = match viewer.transpose() {
        Ok(viewer) => viewer,
        Err(error) => warn(args, vec![error]).map(|()| None)?,
    };
    if let Some(watch) = watch {
        watch.begin(name, args.frames.as_ref().map(|frames| frames.start), progress, pixels, rules);
    }
    let last_written = Mutex::new(Instant::now());
    let show = |rendered: &Rendered, requested: bool| {
        if let Some(viewer) = &viewer {
            viewer.show(rendered, || session.image(plan, rendered));
        }
        if let Some(watch) = watch {
            watch.show(rendered, || session.image(plan, rendered));
        }
        let mut last = last_written.lock().unwrap_or_else(PoisonError::into_inner);
        if !args.skip_existing && (requested || args.write_every.is_some_and(|every| last.elapsed() >= every))
        {
            write_preview(args, session, plan, rendered);
            *last = Instant::now();
        }
    };
    let viewing = viewer.as_ref().map(|_| display_server::INTERVAL);
    let intervals = [args.write_every, viewing, watch.map(|_| watch::INTERVAL)];
    let every = intervals.into_iter().flatten().min();
    let previews = Some(PreviewSink { every, show: &show });
    let rendered = match checkpoint {
        None => session.render_on(plan, progress, None, Sinks { checkpoints: None, previews }),
        Some(mut checkpoint) => {
            let resumed = checkpoint.take_state();
            let keep = |state: &RenderState| checkpoint.save(state);
            let checkpoints = Some(CheckpointSink { every: args.checkpoint_every, keep: &keep });
            session.render_on(plan, progress, resumed, Sinks { checkpoints, previews })
        }
    };
    watcher.finish();
    if let (Some(watch), Ok(rendered)) = (watch, &rendered) {
        watch.end(rendered, || session.image(plan, rendered));
    }
    if let (Some(viewer), Ok(rendered)) = (viewer, &rendered) {
        viewer.finish(rendered, || session.image(plan, rendered));
    }
    rendered
}

/// Reserves the memory of the copies of the image that a viewer and a page get.
///
/// # Errors
/// If there is not enough beside the render, with the kind [`Output`](crate::error::Kind::Output).
fn reserve_copies(args: &RenderArgs, session: &Session, plan: &Plan) -> Result<Reservation> {
    let (rect, render) = (session.camera().film.rect(), session.render_memory(plan));
    let copies = [
        ("--watch", args.watch.is_some(), watch::memory(render.image, rect.area())),
        (
            "--display-server",
            args.display_server.is_some(),
            display_server::memory(render.image, rect.area()),
        ),
    ];
    let mut reserved = session.memory.nothing();
    for (option, _, bytes) in copies.into_iter().filter(|(_, is_given, _)| *is_given) {
        let fits = session.memory.reserve(render.total().saturating_add(bytes));
        drop(fits.map_err(|refusal| {
            let what = format!("rendering {}x{} pixels and copies of them", rect.width, rect.height);
            let change = format!("ask for fewer pixels, or leave out {option}");
            Error::output(refusal.sentence(&what, &change)).about(option)
        })?);
        // What fits beside the render fits alone.
        reserved.settle(reserved.bytes().saturating_add(bytes));
    }
    Ok(reserved)
}

/// Returns how the files of a render are written.
pub fn write_options(args: &RenderArgs, session: &Session) -> WriteOptions {
    let samples = session.camera().film.component_format.into();
    let DisplayArgs { exposure, tonemap } = args.display;
    WriteOptions { samples, exposure, tonemap, ..WriteOptions::default() }
}

/// Writes the image so far to the output files, without the layers that are rendered last. If that fails, a warning is
/// printed and the render goes on.
fn write_preview(args: &RenderArgs, session: &Session, plan: &Plan, rendered: &Rendered) {
    let (image, options) = (session.image(plan, rendered), write_options(args, session));
    for target in args.output.iter().filter(|target| !is_piped(target)) {
        if let Err(error) = image::write(target, &image, &options)
            && !args.quiet
        {
            super::report!("buffon: warning: {error}");
        }
    }
}
