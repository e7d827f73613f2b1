//! Progress on standard error, in a separate thread.

use crate::error::counted;
use crate::render::{Progress, StopRules};
use clap::ValueEnum;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use serde_json::{Value, json};
use std::io::IsTerminal;
use std::sync::Arc;
use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// The form of the progress output.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum ProgressKind {
    /// A bar on a terminal, else plain lines
    Auto,
    /// A bar
    Bar,
    /// A line every few seconds
    Plain,
    /// A JSON object on a line every second
    Json,
    /// Nothing
    None,
}

/// Shows a render's progress until it is finished.
pub struct Watcher {
    stop: Option<(Sender<()>, JoinHandle<()>)>,
}

/// The render whose progress is shown.
pub(super) struct View {
    /// The progress.
    pub progress: Arc<Progress>,
    /// The number of pixels.
    pub pixels: u64,
    /// The stop rules.
    pub rules: StopRules,
    /// The beginning of the render.
    pub started: Instant,
}

impl Watcher {
    /// Starts to show the progress of a render with a number of pixels.
    pub fn start(kind: ProgressKind, progress: Arc<Progress>, pixels: u64, rules: StopRules) -> Self {
        let terminal = std::io::stderr().is_terminal();
        let kind = match kind {
            ProgressKind::Auto if terminal => ProgressKind::Bar,
            ProgressKind::Auto => ProgressKind::Plain,
            kind => kind,
        };
        let view = View { progress, pixels, rules, started: Instant::now() };
        let (sender, receiver) = channel::<()>();
        let (period, bar) = match kind {
            ProgressKind::None | ProgressKind::Auto => return Watcher { stop: None },
            ProgressKind::Bar => (Duration::from_millis(100), Some(bar())),
            ProgressKind::Plain => (Duration::from_secs(5), None),
            ProgressKind::Json => (Duration::from_secs(1), None),
        };
        let thread = std::thread::spawn(move || {
            while let Err(RecvTimeoutError::Timeout) = receiver.recv_timeout(period) {
                match &bar {
                    Some(bar) => view.draw(bar),
                    None if kind == ProgressKind::Json => super::report!("{}", view.json()),
                    None => super::report!("{}", view.line()),
                }
            }
            if let Some(bar) = bar {
                bar.finish_and_clear();
            }
        });
        Watcher { stop: Some((sender, thread)) }
    }

    /// Ends the output and waits for its last line.
    pub fn finish(self) {
        if let Some((sender, thread)) = self.stop {
            drop(sender);
            // A failure of the watcher must not lose the image.
            let _ = thread.join();
        }
    }
}

const STEPS: u64 = 1000;
/// The greatest fraction that is shown of an unfinished render.
const NOT_DONE: f64 = 0.999;

fn bar() -> ProgressBar {
    let bar = ProgressBar::with_draw_target(Some(STEPS), ProgressDrawTarget::stderr());
    if let Ok(style) = ProgressStyle::with_template("[{bar:30}] {msg}") {
        bar.set_style(style.progress_chars("=> "));
    }
    bar
}

impl View {
    /// Returns the fraction of the work that is done, according to the rule that is closest to its limit; less than 1
    /// until the rule ends the render.
    fn share(&self) -> Option<f64> {
        let elapsed = self.started.elapsed().as_secs_f64();
        let samples = self.progress.pixel_samples() as f64 / self.pixels as f64;
        let by_samples = self.rules.samples.map(|n| samples / n as f64);
        let by_time = self.rules.time.map(|t| elapsed / t.as_secs_f64());
        // The error is about inversely proportional to the number of samples.
        let by_error = self.rules.error.and_then(|target| Some(target / self.progress.error()?.interval[1]));
        let shares = [by_samples, by_time, by_error].into_iter().flatten();
        shares.reduce(f64::max).map(|share| share.clamp(0.0, NOT_DONE))
    }

    fn rate(&self) -> f64 {
        self.progress.pixel_samples() as f64 / self.started.elapsed().as_secs_f64().max(1e-9)
    }

    fn eta(&self) -> Option<Duration> {
        let share = self.share().filter(|&s| s > 1e-3)?;
        Some(self.started.elapsed().mul_f64((1.0 - share) / share))
    }

    fn line(&self) -> String {
        let mut line = self.share().map_or_else(|| "running".into(), percentage);
        let per_pixel = (self.progress.pixel_samples() as f64 / self.pixels as f64) as u64;
        line += &match self.rules.samples {
            Some(n) => format!(", {per_pixel}/{n} samples per pixel"),
            None => format!(", {} per pixel", counted(per_pixel, "sample", "samples")),
        };
        if let Some(time) = self.rules.time {
            line += &format!(", {} s of {} s", self.started.elapsed().as_secs(), time.as_secs_f64());
        }
        if let Some(error) = self.progress.error() {
            let [low, high] = error.interval;
            line += &format!(", relMSE {:.1e} ({low:.1e} to {high:.1e})", error.relmse);
            if let Some(target) = self.rules.error {
                line += &format!(" → {target}");
            }
        }
        line += &format!(", {:.2} M samples/s", self.rate() * 1e-6);
        if let Some(eta) = self.eta() {
            line += &format!(", {:.0} s left", eta.as_secs_f64().ceil());
        }
        line
    }

    /// Returns the progress as a JSON object.
    pub fn json(&self) -> Value {
        json!({
            "share": self.share(),
            "seconds": self.started.elapsed().as_secs_f64(),
            "seconds_left": self.eta().map(|d| d.as_secs_f64()),
            "samples_per_pixel": self.progress.samples_per_pixel(),
            "samples": self.progress.pixel_samples(),
            "relmse_estimate": self.progress.relmse(),
            "relmse_interval": self.progress.error().map(|error| error.interval),
            "rules": {
                "samples": self.rules.samples,
                "seconds": self.rules.time.map(|time| time.as_secs_f64()),
                "relmse": self.rules.error,
            },
        })
    }

    fn draw(&self, bar: &ProgressBar) {
        bar.set_position((self.share().unwrap_or(0.0) * STEPS as f64) as u64);
        bar.set_message(self.line());
    }
}

/// Formats a fraction as a percentage, rounded down so that an unfinished render never shows 100 %.
fn percentage(share: f64) -> String {
    // 0.578 is 57.8 %, although 1000 times its binary value is slightly less than 578.
    format!("{:>4.1} %", (share * 1000.0 + 1e-9).floor() / 10.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn percentages_are_rounded_down() {
        let shown = [0.0, 0.0009999, 0.578, 0.9996, 0.99999, 1.0].map(percentage);
        assert_eq!(shown, [" 0.0 %", " 0.0 %", "57.8 %", "99.9 %", "99.9 %", "100.0 %"]);
    }

    #[test]
    fn the_line_shows_every_rule_that_was_given() {
        let progress = Arc::new(Progress::new());
        let rules = StopRules { samples: Some(64), time: Some(Duration::from_secs(3600)), error: Some(0.01) };
        let view = View { progress, pixels: 100, rules, started: Instant::now() };
        assert!(view.line().starts_with(" 0.0 %, 0/64 samples per pixel, 0 s of 3600 s"), "{}", view.line());
        let view = View { rules: StopRules::default(), ..view };
        assert!(view.line().starts_with("running, 0 samples per pixel"), "{}", view.line());
    }
}
