//! What a page shows: the render now, its error so far, and the last picture.

use super::history::History;
use crate::cli::progress::View;
use crate::estimate::replicates::ErrorEstimate;
use crate::render::{Progress, Rendered, StopReason, StopRules};
use serde_json::{Value, json};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// The time without a request after which a page counts as closed.
const CLOSED: Duration = Duration::from_secs(3);

/// A render, of one frame if there are several.
pub struct Render {
    name: String,
    frame: Option<u64>,
    view: View,
    history: History,
    /// The progress at the end of sampling.
    last: Option<Value>,
    stop_reason: Option<StopReason>,
}

/// A picture.
pub struct Picture {
    /// Its number, from 1.
    pub number: u32,
    /// The bytes that a page gets.
    pub bytes: Arc<Vec<u8>>,
    /// The time from which there may be another.
    pub due: Instant,
}

/// How the program ends.
pub struct Ending {
    /// The exit code.
    pub code: u8,
    /// The error, if there is one.
    pub message: Option<String>,
}

/// The state of the program.
#[derive(Default)]
pub struct State {
    /// The number of the state. It changes with whatever a page must know at once.
    pub number: u64,
    /// The last render; `None` while the scene is loaded.
    pub render: Option<Render>,
    /// The number of pictures of all renders.
    pictures: u32,
    /// The last picture of the render.
    pub picture: Option<Picture>,
    /// The end of the program.
    pub ending: Option<Ending>,
    /// The time of the last request of a page.
    asked: Option<Instant>,
    /// The number of requests of pages that are being answered.
    answering: usize,
    /// Whether a page knows of the end.
    informed: bool,
    /// The number of pages that know of the end, but lack the last picture.
    lacking: usize,
    /// Whether the user has stopped the program.
    stopped: bool,
}

impl Render {
    /// Creates a render that has not begun.
    pub fn new(
        name: String,
        frame: Option<u64>,
        progress: Arc<Progress>,
        pixels: u64,
        rules: StopRules,
    ) -> Self {
        let view = View { progress, pixels, rules, started: Instant::now() };
        Render { name, frame, view, history: History::default(), last: None, stop_reason: None }
    }

    fn seconds(&self) -> f64 {
        self.view.started.elapsed().as_secs_f64()
    }

    /// Returns whether samples are being taken.
    fn is_sampling(&self) -> bool {
        self.last.is_none() && self.view.progress.has_begun()
    }
}

impl State {
    /// Begins another render.
    pub fn begin(&mut self, render: Render) {
        self.render = Some(render);
        self.picture = None;
    }

    /// Returns the number of the next picture.
    pub fn next_picture(&mut self) -> u32 {
        self.pictures += 1;
        self.pictures
    }

    /// Returns whether there may be another picture.
    pub fn is_due(&self) -> bool {
        self.is_open() && self.picture.as_ref().is_none_or(|last| Instant::now() >= last.due)
    }

    /// Returns whether a page has asked for something lately.
    pub fn is_open(&self) -> bool {
        self.answering > 0 || self.asked.is_some_and(|last| last.elapsed() < CLOSED)
    }

    /// Returns whether all pages know of the end and have the last picture.
    pub fn is_known(&self) -> bool {
        self.informed && self.lacking == 0 && self.answering == 0
    }

    /// Counts a request of a page.
    pub fn begin_answer(&mut self) {
        self.answering += 1;
        self.asked = Some(Instant::now());
    }

    /// Counts an answer, and the picture with a number if the page has taken that.
    pub fn end_answer(&mut self, taken: Option<u32>) {
        self.answering -= 1;
        self.asked = Some(Instant::now());
        if taken.is_some() && self.is_last(taken) {
            self.lacking = self.lacking.saturating_sub(1);
        }
    }

    /// Notes that a page that has a picture gets the state.
    pub fn inform(&mut self, has: Option<u64>) {
        if self.ending.is_some() {
            self.informed = true;
            let has = has.and_then(|number| u32::try_from(number).ok());
            self.lacking += usize::from(self.picture.is_some() && !self.is_last(has));
        }
    }

    /// Returns whether this is the number of the last picture.
    fn is_last(&self, number: Option<u32>) -> bool {
        self.picture.as_ref().map(|picture| picture.number) == number
    }

    /// Notes that the user stops the program. Returns false if that was so.
    pub fn stop(&mut self) -> bool {
        !std::mem::replace(&mut self.stopped, true)
    }

    /// Records the error.
    pub fn record(&mut self) {
        if let Some(render) = self.render.as_mut().filter(|render| render.is_sampling()) {
            let (seconds, error) = (render.seconds(), render.view.progress.error());
            render.history.record(seconds, error);
        }
    }

    /// Keeps the progress at the end of sampling.
    pub fn end_sampling(&mut self, rendered: &Rendered) {
        let Some(render) = &mut self.render else { return };
        let (seconds, mut last) = (render.seconds(), render.view.json());
        last["seconds_left"] = 0.0.into();
        last["relmse_estimate"] = json!(rendered.relmse);
        last["relmse_interval"] = json!(rendered.relmse_interval);
        last["samples_per_pixel"] = rendered.samples_per_pixel.into();
        if rendered.stop_reason != StopReason::Interrupted {
            last["share"] = 1.0.into();
        }
        let error = rendered.relmse.zip(rendered.relmse_interval);
        let error = error.map(|(relmse, interval)| ErrorEstimate { relmse, interval });
        render.history.finish(seconds, error);
        render.last = Some(last);
        render.stop_reason = Some(rendered.stop_reason);
    }

    /// Requests that the render ends with the samples so far. Returns false if there is none that could.
    pub fn request_end(&self) -> bool {
        let render = self.render.as_ref().filter(|render| render.last.is_none());
        render.is_some_and(|render| {
            render.view.progress.request_end();
            true
        })
    }

    fn phase(&self) -> &'static str {
        match (&self.ending, &self.render) {
            (Some(Ending { message: Some(_), .. }), _) => "failed",
            (Some(_), _) => "finished",
            (None, None) => "loading",
            (None, Some(render)) if render.last.is_some() => "writing",
            (None, Some(render)) if render.is_sampling() => "rendering",
            (None, Some(_)) => "preparing",
        }
    }

    /// Returns the state as a JSON object.
    pub fn json(&self) -> Value {
        let render = self.render.as_ref();
        let progress = |render: &Render| render.last.clone().unwrap_or_else(|| render.view.json());
        json!({
            "state": self.number,
            "phase": self.phase(),
            "name": render.map(|render| &render.name),
            "frame": render.and_then(|render| render.frame),
            "progress": render.map(progress),
            "history": render.map(|render| render.history.json()),
            "stop_reason": render.and_then(|render| render.stop_reason).map(|reason| reason.to_string()),
            "picture": self.picture.as_ref().map(|picture| picture.number),
            "exit_code": self.ending.as_ref().map(|ending| ending.code),
            "message": self.ending.as_ref().and_then(|ending| ending.message.as_ref()),
        })
    }
}
