//! Integrators that compute shared data anew for each sample of the pixels.

use super::{Counters, Preparation};

/// One sample of every pixel, before it is taken.
pub struct SamplePass<'a> {
    /// The input of the computation.
    pub preparation: &'a Preparation<'a>,
    /// The index of the sample.
    pub sample: u64,
}

/// The result of the computation before a sample.
#[derive(Clone, Copy, Debug, Default)]
pub struct PreparedPass {
    /// The counts of rays and their times.
    pub counters: Counters,
    /// Photons that were dropped because they were not finite.
    pub invalid: u64,
    /// The time of the camera's rays in [0, 1] over the shutter interval, if the sample has one for all pixels.
    pub time: Option<f32>,
}

/// A computation before each sample of the pixels. All pixels take a sample before the next one begins.
pub trait Progressive: Sync {
    /// Computes the data that the sample needs. It must depend on nothing but the scene, the seed and the sample's
    /// index.
    fn begin_sample(&self, pass: &SamplePass<'_>) -> PreparedPass;
}
