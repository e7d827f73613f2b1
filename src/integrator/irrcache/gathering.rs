//! The computation of records: hemispheres of rays, several records in one wave.

use super::diffuse_points::DiffusePoint;
use super::hemisphere::{Hemisphere, Strata};
use super::overture::RecordLevel;
use super::record::{Record, Spacing};
use crate::accel::Coherence;
use crate::color::Rgb;
use crate::integrator::settings::IrrcacheSettings;
use crate::integrator::{Integrator, Radiance, RadianceQuery, Wave, Worker};
use crate::math::{Frame, Ray, Vec3};
use crate::sampling::SampleKey;
use crate::sampling::hash::combine;
use crate::scene::Scene;

/// The approximate number of rays in a wave.
const WAVE: usize = 2048;
/// Tolerance of the radii at quality 1, see [`Spacing`].
const TOLERANCE: f32 = 0.8;
/// The upper bound of the radius relative to the harmonic mean distance, at quality 1.
const DISTANCE: f32 = 0.25;
/// Bounds of the radius of a fine record in pixels. [Tabellion and Lamorlette 2004]
const PIXELS: [f32; 2] = [4.0, 40.0];
/// Bounds of the radius of a coarse record in pixels.
const COARSE_PIXELS: [f32; 2] = [4.0, 80.0];

/// All light except caustics and the light emitted towards the point.
const GATHERED: RadianceQuery =
    RadianceQuery { emitted: false, direct: true, indirect: true, caustic: false };

/// The parameters of the computation of records.
pub struct Gathering<'a> {
    pub scene: &'a Scene,
    pub child: &'a dyn Integrator,
    pub settings: &'a IrrcacheSettings,
    /// A hash that seeds this cache's random numbers.
    pub seed: u32,
    /// The level of the records.
    pub level: RecordLevel,
    /// The replicate of the samples that uses the records.
    pub replicate: u32,
}

impl Gathering<'_> {
    /// Returns the number of records in a wave.
    pub fn records_per_wave(&self) -> usize {
        (WAVE / Strata::new(self.settings.resolution).cells()).max(1)
    }

    /// Computes the records of the given points; `first` is the cache index of the first.
    pub fn records(&self, points: &[DiffusePoint], first: usize, worker: &mut Worker) -> Vec<Record> {
        let strata = Strata::new(self.settings.resolution);
        let mut rays: Vec<Ray> = Vec::with_capacity(points.len() * strata.cells());
        let mut directions: Vec<Vec3> = Vec::with_capacity(rays.capacity());
        let mut keys: Vec<SampleKey> = Vec::with_capacity(rays.capacity());
        for (i, point) in points.iter().enumerate() {
            let scramble = combine(self.seed, (first + i) as u32);
            let frame = Frame::from_normal(point.n);
            directions.extend(strata.directions(scramble));
            rays.extend(directions[rays.len()..].iter().map(|d| point.ray(&frame, *d)));
            let key = |index| SampleKey { scramble, index, replicate: self.replicate };
            keys.extend((0..strata.cells() as u32).map(key));
        }
        let mut found = vec![Radiance::NONE; rays.len()];
        let wave = Wave { rays: &rays, keys: &keys, coherence: Coherence::Incoherent, groups: &[] };
        self.child.li(self.scene, wave, GATHERED, worker, &mut found);
        worker.counters.paths += rays.len() as u64;
        let cells = directions.chunks_exact(strata.cells()).zip(found.chunks_exact(strata.cells()));
        let record = |(point, (directions, found))| self.record(strata, point, directions, found);
        points.iter().zip(cells).map(record).collect()
    }

    /// Returns the bounds of a record's radius, where a pixel has the given size.
    pub fn radii(&self, pixel: f32) -> [f32; 2] {
        let pixels = if self.level == RecordLevel::Coarse { COARSE_PIXELS } else { PIXELS };
        match self.settings.clamp_screen {
            true => pixels.map(|size| size * pixel),
            false => [0.0, (self.scene.bounds.max - self.scene.bounds.min).length()],
        }
    }

    fn record(
        &self,
        strata: Strata,
        point: &DiffusePoint,
        directions: &[Vec3],
        found: &[Radiance],
    ) -> Record {
        let valid = |r: &Radiance| if r.value.is_valid() { r.value } else { Rgb::BLACK };
        let radiance: Vec<Rgb> = found.iter().map(valid).collect();
        let distance: Vec<f32> = found.iter().map(|r| r.distance).collect();
        let frame = Frame::from_normal(point.n);
        let hemisphere = Hemisphere { strata, frame, directions, radiance: &radiance, distance: &distance };
        let pixel = point.pixel;
        let [min, max] = self.radii(pixel);
        let per_quality = 1.0 / self.settings.quality;
        let spacing =
            Spacing { tolerance: TOLERANCE * per_quality, distance: DISTANCE * per_quality, pixel, min, max };
        Record::new(point.p, &hemisphere, self.settings.gradients, spacing)
    }
}
