//! The progress of a render.

use crate::estimate::replicates::ErrorEstimate;
use crate::integrator::Interrupt;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

/// The progress shared between a render and the code that displays or stops it.
#[derive(Debug, Default)]
pub struct Progress {
    interrupt: Interrupt,
    /// Whether the image so far is requested.
    preview: AtomicBool,
    /// Whether the samples so far are enough.
    end: AtomicBool,
    /// Whether the first sample has been started.
    begun: AtomicBool,
    pixel_samples: AtomicU64,
    samples_per_pixel: AtomicU64,
    /// The estimated relMSE and the ends of its interval, as bits of `f64`; NaN without an estimate.
    relmse: [AtomicU64; 3],
}

impl Progress {
    /// Creates the progress of a render that has not started.
    pub fn new() -> Self {
        Progress {
            relmse: std::array::from_fn(|_| AtomicU64::new(f64::NAN.to_bits())),
            ..Progress::default()
        }
    }

    /// Requests that the render stops immediately; waves in progress are discarded.
    pub fn interrupt(&self) {
        self.interrupt.raise();
    }

    /// Returns whether a stop was requested.
    pub fn is_interrupted(&self) -> bool {
        self.interrupt.is_raised()
    }

    /// Returns the flag that is raised by a request to stop.
    pub fn interrupt_flag(&self) -> &Interrupt {
        &self.interrupt
    }

    /// Requests the image so far, for a render that has a receiver of previews.
    pub fn request_preview(&self) {
        self.preview.store(true, Ordering::Relaxed);
    }

    /// Requests that the render ends after the current part of a pass, with the same number of samples in every pixel
    /// unless sampling is adaptive. The first pass is always finished. Only a render that has a receiver of previews
    /// obeys.
    pub fn request_end(&self) {
        self.end.store(true, Ordering::Relaxed);
    }

    pub(super) fn take_end_request(&self) -> bool {
        self.end.swap(false, Ordering::Relaxed)
    }

    pub(super) fn take_preview_request(&self) -> bool {
        self.preview.swap(false, Ordering::Relaxed)
    }

    /// Returns whether sampling has started. Before that, a stop loses nothing.
    pub fn has_begun(&self) -> bool {
        self.begun.load(Ordering::Relaxed)
    }

    pub(super) fn begin(&self) {
        self.begun.store(true, Ordering::Relaxed);
    }

    /// Returns the number of samples so far, over all pixels.
    pub fn pixel_samples(&self) -> u64 {
        self.pixel_samples.load(Ordering::Relaxed)
    }

    /// Returns the samples per pixel of the completed passes.
    pub fn samples_per_pixel(&self) -> u64 {
        self.samples_per_pixel.load(Ordering::Relaxed)
    }

    /// Returns the estimated relMSE after the last pass.
    pub fn relmse(&self) -> Option<f64> {
        self.error().map(|error| error.relmse)
    }

    /// Returns the estimated relMSE with its interval.
    pub fn error(&self) -> Option<ErrorEstimate> {
        let [relmse, low, high] =
            std::array::from_fn(|i| f64::from_bits(self.relmse[i].load(Ordering::Relaxed)));
        (!relmse.is_nan()).then_some(ErrorEstimate { relmse, interval: [low, high] })
    }

    pub(super) fn add_samples(&self, n: u64) {
        self.pixel_samples.fetch_add(n, Ordering::Relaxed);
    }

    pub(super) fn finish_pass(&self, samples_per_pixel: u64, error: Option<ErrorEstimate>) {
        self.samples_per_pixel.store(samples_per_pixel, Ordering::Relaxed);
        let values = error.map_or([f64::NAN; 3], |e| [e.relmse, e.interval[0], e.interval[1]]);
        for (place, value) in self.relmse.iter().zip(values) {
            place.store(value.to_bits(), Ordering::Relaxed);
        }
    }
}
