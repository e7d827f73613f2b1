//! Splitting: several samples of emitters and of directions at the first surface of a camera path. [Arvo and Kirk 1990]
//!
//! A camera ray and its first surface cost as much as some edges of the path after it. Where the noise is that of the
//! light at this surface, one camera ray serves several samples of it. With m emitter samples and n directions, each
//! counts 1/m and 1/n, and the weights of multiple importance sampling have the densities m·p and n·q. [Veach 1997, Eq.
//! 9.8]

use crate::integrator::Radiance;
use crate::integrator::lighting::TechniqueCounts;
use crate::integrator::worker::{BounceNumbers, RandomNumbers};
use crate::sampling::{SampleKey, Sampler};

/// The numbers of samples at the first surface of a camera path.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Splitting {
    /// The number of emitter samples, at least 1.
    pub emitters: u32,
    /// The number of directions, each of which continues the path; at least 1.
    pub directions: u32,
}

impl Splitting {
    /// One sample of each.
    pub const NONE: Splitting = Splitting { emitters: 1, directions: 1 };

    /// Returns the counts for the weights of emitter samples.
    #[inline]
    pub fn counts(self) -> TechniqueCounts {
        TechniqueCounts::like_one_each(self.emitters, self.directions)
    }

    /// Returns the density of directions relative to emitter samples, if there were one of each. With it, a direction
    /// is weighted as where nothing is split.
    #[inline]
    pub fn density(self) -> f32 {
        self.directions as f32 / self.emitters as f32
    }

    /// Draws the random numbers of all samples at the first surface, one set for each number of the sample.
    pub fn draw(
        self,
        uses: BounceNumbers,
        sampler: Sampler,
        keys: &[SampleKey],
        sets: &mut Vec<RandomNumbers>,
    ) {
        sets.resize_with(self.emitters.max(self.directions) as usize, RandomNumbers::default);
        let mut buffer = Vec::with_capacity(keys.len());
        let mut draw = |set: &mut RandomNumbers, uses, count: u32, number: usize| {
            buffer.clear();
            buffer.extend(keys.iter().map(|key| sampler.split(*key, count, number as u32)));
            set.draw(uses, 0, sampler, &buffer);
        };
        for (number, set) in sets.iter_mut().enumerate() {
            if uses.next_event && number < self.emitters as usize {
                let uses = BounceNumbers { lobe: false, direction: false, roulette: false, ..uses };
                draw(set, uses, self.emitters, number);
            }
            if number < self.directions as usize {
                let uses = BounceNumbers { next_event: false, ..uses };
                draw(set, uses, self.directions, number);
            }
        }
    }
}

/// Adds the radiance of the split paths, which follow those of the `out.len()` camera rays, to that of their rays.
pub fn gather(all: &[Radiance], out: &mut [Radiance]) {
    let (own, split) = all.split_at(out.len());
    out.copy_from_slice(own);
    for part in split.chunks(out.len()) {
        for (out, part) in out.iter_mut().zip(part) {
            out.value += part.value;
        }
    }
}
