//! Computing records: hemispheres of rays, several records to a wave.

use super::hemisphere::{Hemisphere, Strata};
use super::overture::Level;
use super::places::Place;
use super::record::{Record, Spacing};
use crate::accel::Coherence;
use crate::color::Rgb;
use crate::integrator::settings::IrrcacheSettings;
use crate::integrator::{Integrator, Radiance, RadianceQuery, Wave, Worker};
use crate::math::{Frame, Ray, Vec3};
use crate::sampling::SampleKey;
use crate::sampling::hash::combine;
use crate::scene::Scene;

/// About how many rays make a wave.
const WAVE: usize = 2048;
/// Tolerance of the radii at quality 1, see [`Spacing`].
const TOLERANCE: f32 = 0.8;
/// The share of the mean distance of surfaces that bounds them.
const DISTANCE: f32 = 0.25;
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
    /// Which replicate of the samples the records serve.
    pub replicate: u32,
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
        let mut directions: Vec<Vec3> = Vec::with_capacity(rays.capacity());
        let mut keys: Vec<SampleKey> = Vec::with_capacity(rays.capacity());
        for (i, place) in places.iter().enumerate() {
            let scramble = combine(self.seed, (first + i) as u32);
            let frame = Frame::from_normal(place.n);
            directions.extend(strata.directions(scramble));
            rays.extend(directions[rays.len()..].iter().map(|d| place.ray(&frame, *d)));
            let key = |index| SampleKey { scramble, index, replicate: self.replicate };
            keys.extend((0..strata.cells() as u32).map(key));
        }
        let mut found = vec![Radiance::NONE; rays.len()];
        let wave = Wave { rays: &rays, keys: &keys, coherence: Coherence::Incoherent };
        self.child.li(self.scene, wave, GATHERED, worker, &mut found);
        worker.counters.paths += rays.len() as u64;
        let cells = directions.chunks_exact(strata.cells()).zip(found.chunks_exact(strata.cells()));
        let record = |(place, (directions, found))| self.record(strata, place, directions, found);
        places.iter().zip(cells).map(record).collect()
    }

    fn record(&self, strata: Strata, place: &Place, directions: &[Vec3], found: &[Radiance]) -> Record {
        let valid = |r: &Radiance| if r.value.is_valid() { r.value } else { Rgb::BLACK };
        let radiance: Vec<Rgb> = found.iter().map(valid).collect();
        let distance: Vec<f32> = found.iter().map(|r| r.distance).collect();
        let frame = Frame::from_normal(place.n);
        let hemisphere = Hemisphere { strata, frame, directions, radiance: &radiance, distance: &distance };
        let pixel = place.pixel;
        let pixels = if self.level == Level::Coarse { COARSE_PIXELS } else { PIXELS };
        let [min, max] = match self.settings.clamp_screen {
            true => pixels.map(|size| size * pixel),
            false => [0.0, (self.scene.bounds.max - self.scene.bounds.min).length()],
        };
        let per_quality = 1.0 / self.settings.quality;
        let spacing =
            Spacing { tolerance: TOLERANCE * per_quality, distance: DISTANCE * per_quality, pixel, min, max };
        Record::new(place.p, &hemisphere, self.settings.gradients, spacing)
    }
}
