//! Computing records: hemispheres of rays, several records to a wave.

use super::hemisphere::{Hemisphere, Strata};
use super::overture::Level;
use super::places::Place;
use super::record::{Record, Spacing, Tolerance};
use crate::accel::Coherence;
use crate::color::Rgb;
use crate::integrator::settings::IrrcacheSettings;
use crate::integrator::{Integrator, Radiance, RadianceQuery, Wave, Worker};
use crate::math::{Frame, Ray};
use crate::sampling::SampleKey;
use crate::sampling::hash::combine;
use crate::scene::Scene;

/// About how many rays make a wave.
const WAVE: usize = 2048;
/// What bounds a record's radius at quality 1.
const TOLERANCE: Tolerance = Tolerance { distance: 0.25, change: 0.06 };
/// Bounds of a record's radius in pixels. [Tabellion and Lamorlette 2004]
const PIXELS: [f32; 2] = [4.0, 40.0];
/// The same for coarse records.
const COARSE_PIXELS: [f32; 2] = [4.0, 80.0];

/// All light but what is emitted towards the point and caustics.
const GATHERED: RadianceQuery =
    RadianceQuery { emitted: false, direct: true, indirect: true, caustic: false };

/// How records are computed.
pub struct Gathering<'a> {
    pub scene: &'a Scene,
    pub child: &'a dyn Integrator,
    pub settings: &'a IrrcacheSettings,
    /// Hash of what tells this cache's numbers from all others.
    pub seed: u32,
    /// What the records are for.
    pub level: Level,
    /// Which half of the samples the records serve.
    pub half: usize,
}

impl Gathering<'_> {
    /// How many records make a wave.
    pub fn records_per_wave(&self) -> usize {
        (WAVE / Strata::new(self.settings.resolution).cells()).max(1)
    }

    /// The records of the places; `first` is the index of the first in the cache.
    pub fn records(&self, places: &[Place], first: usize, worker: &mut Worker) -> Vec<Record> {
        let strata = Strata::new(self.settings.resolution);
        let mut rays: Vec<Ray> = Vec::with_capacity(places.len() * strata.cells());
        let mut keys: Vec<SampleKey> = Vec::with_capacity(rays.capacity());
        for (i, place) in places.iter().enumerate() {
            let scramble = combine(self.seed, (first + i) as u32);
            let frame = Frame::from_normal(place.n);
            rays.extend(strata.directions(scramble).map(|d| place.ray(&frame, d)));
            let key = |index| SampleKey { scramble, index }.in_half(self.half as u32);
            keys.extend((0..strata.cells() as u32).map(key));
        }
        let mut found = vec![Radiance::NONE; rays.len()];
        let wave = Wave { rays: &rays, keys: &keys, coherence: Coherence::Incoherent };
        self.child.li(self.scene, wave, GATHERED, worker, &mut found);
        worker.counters.paths += rays.len() as u64;
        let cells = found.chunks_exact(strata.cells());
        places.iter().zip(cells).map(|(place, found)| self.record(strata, place, found)).collect()
    }

    fn record(&self, strata: Strata, place: &Place, found: &[Radiance]) -> Record {
        let valid = |r: &Radiance| if r.value.is_valid() { r.value } else { Rgb::BLACK };
        let radiance: Vec<Rgb> = found.iter().map(valid).collect();
        let distance: Vec<f32> = found.iter().map(|r| r.distance).collect();
        let frame = Frame::from_normal(place.n);
        let hemisphere = Hemisphere { strata, frame, radiance: &radiance, distance: &distance };
        let tolerance = TOLERANCE.scaled(1.0 / self.settings.quality);
        let size = self.scene.bounds.max - self.scene.bounds.min;
        let pixels = if self.level == Level::Coarse { COARSE_PIXELS } else { PIXELS };
        let spacing = match self.settings.clamp_screen {
            true => Spacing { min: pixels[0] * place.pixel, max: pixels[1] * place.pixel },
            false => Spacing { min: 0.0, max: size.length() },
        };
        Record::new(place.p, &hemisphere, tolerance, self.settings.gradients, spacing)
    }
}
