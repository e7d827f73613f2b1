//! Integrators that compute shared data anew for each sample of the pixels.

use super::photon::{PathSequence, radius};
use super::{Counters, Preparation, Splat};
use crate::sampling::{Dimension, SampleKey, Sampler, SamplerKind};

/// One sample of every pixel, before it is taken.
pub struct SamplePass<'a> {
    /// The input of the computation.
    pub preparation: &'a Preparation<'a>,
    /// The index of the sample.
    pub sample: u64,
    /// The extent of the reconstruction filter beyond the image, in pixels.
    pub margin: f64,
}

impl SamplePass<'_> {
    /// Returns the sequence of the light paths of the pass, of which there are `paths` in each pass. Each half of the
    /// samples is an independent sequence of passes.
    pub fn light_paths(&self, paths: u64) -> PathSequence {
        let (half, index) = ((self.sample & 1) as u32, self.sample >> 1);
        PathSequence { seed: self.preparation.seed, stream: 0, number: half, first: index * paths }
    }

    /// Returns the radius within which photons are gathered, which shrinks from pass to pass. `first` is that of the
    /// first pass in scene units, and `alpha` the parameter of the reduction.
    pub fn radius(&self, first: f32, alpha: f32) -> f32 {
        // All replicates use the same radius for a pass, that of the first replicate.
        let each = u64::from(self.preparation.sampler.replicates() / 2);
        radius::of_pass(first, alpha, (self.sample >> 1) / each * each)
    }

    /// Returns the time of the pass, in [0, 1) over the shutter interval; `None` if the scene does not need any. All
    /// photons and camera rays of a pass share it, so that photons on moving objects are looked up at the same
    /// position. Times are stratified over the passes of each half.
    pub fn time(&self) -> Option<f32> {
        if !self.preparation.scene.needs.time {
            return None;
        }
        // No path has this pixel.
        let key = SampleKey::new(self.preparation.seed, u32::MAX, 0, self.sample);
        let mut time = [0.0];
        Sampler::new(SamplerKind::Sobol, None).fill_1d(Dimension::TIME, &[key], &mut time);
        Some(time[0])
    }
}

/// The result of the computation before a sample.
#[derive(Clone, Debug, Default)]
pub struct PreparedPass {
    /// The counts of rays and their times.
    pub counters: Counters,
    /// The contributions of light paths to the film, in batches whose order does not depend on threads.
    pub splats: Vec<Vec<Splat>>,
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
