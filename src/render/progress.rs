//! What a render shows of itself while it runs.

use crate::estimate::replicates::ErrorEstimate;
use crate::integrator::Interrupt;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

/// Shared between the render and whoever watches or stops it.
#[derive(Debug, Default)]
pub struct Progress {
    interrupt: Interrupt,
    /// Whether the first sample is under way or taken.
    begun: AtomicBool,
    pixel_samples: AtomicU64,
    samples_per_pixel: AtomicU64,
    /// The bits of `f64`s: the estimated relMSE, the ends of its interval; NaN while there is no estimate.
    relmse: [AtomicU64; 3],
}

impl Progress {
    /// A render that has not begun.
    pub fn new() -> Self {
        Progress {
            relmse: std::array::from_fn(|_| AtomicU64::new(f64::NAN.to_bits())),
            ..Progress::default()
        }
    }

    /// Asks the render to stop at once: what every thread has in hand is thrown away.
    pub fn interrupt(&self) {
        self.interrupt.raise();
    }

    /// Whether it was asked to stop.
    pub fn is_interrupted(&self) -> bool {
        self.interrupt.is_raised()
    }

    /// What is raised when it is asked to stop.
    pub fn interrupt_flag(&self) -> &Interrupt {
        &self.interrupt
    }

    /// Whether any sample is under way or taken: before, nothing is lost by an end.
    pub fn has_begun(&self) -> bool {
        self.begun.load(Ordering::Relaxed)
    }

    pub(super) fn begin(&self) {
        self.begun.store(true, Ordering::Relaxed);
    }

    /// Samples taken so far, over all pixels.
    pub fn pixel_samples(&self) -> u64 {
        self.pixel_samples.load(Ordering::Relaxed)
    }

    /// Samples per pixel of the passes that are done.
    pub fn samples_per_pixel(&self) -> u64 {
        self.samples_per_pixel.load(Ordering::Relaxed)
    }

    /// The estimated relMSE after the last pass.
    pub fn relmse(&self) -> Option<f64> {
        self.error().map(|error| error.relmse)
    }

    /// The same with its interval.
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
