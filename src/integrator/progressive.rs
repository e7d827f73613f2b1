//! Integrators that compute something anew for every sample of the pixels.

use super::{Counters, Preparation};

/// One sample of every pixel, about to be taken.
pub struct SamplePass<'a> {
    /// What it may be computed from.
    pub preparation: &'a Preparation<'a>,
    /// The index of the sample.
    pub sample: u64,
}

/// What it took to prepare a sample.
#[derive(Clone, Copy, Debug, Default)]
pub struct Begun {
    /// Rays, and the time for them.
    pub counters: Counters,
    /// Photons that were dropped because they were not finite.
    pub invalid: u64,
    /// The time of the camera's rays in [0, 1] over the shutter interval, if the sample has one for all pixels.
    pub time: Option<f32>,
}

/// What is computed before each sample of the pixels. All pixels take a sample before the next one begins.
pub trait Progressive: Sync {
    /// Computes what the sample needs; it must depend on nothing but the scene, the seed and the sample's index.
    fn begin_sample(&self, pass: &SamplePass<'_>) -> Begun;
}
