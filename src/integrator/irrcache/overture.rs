//! The overture pass: creates the records that the image needs before it is rendered.

use super::diffuse_points::{self, DiffusePoint, RayCone};
use super::gathering::Gathering;
use super::octree::Octree;
use super::record::Record;
use super::weight::weight;
use crate::accel::{Coherence, Hit};
use crate::integrator::preparation::Workers;
use crate::integrator::settings::IrrcacheSettings;
use crate::integrator::worker::intersect;
use crate::integrator::{Counters, Integrator, Preparation, Worker};
use crate::math::{DVec2, Frame, Ray, Vec2};
use crate::sampling::hash::{combine, pcg3d, to_unit};
use crate::sampling::{SampleKey, warp};
use rayon::prelude::*;

/// The number of film points that are looked up in the cache before missing records are computed.
const BATCH: usize = 2048;
/// The number of camera rays in a task.
const CHUNK: usize = 256;

/// The level of a cache.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RecordLevel {
    /// Records at surfaces seen by the camera.
    Fine,
    /// Records at surfaces seen from the fine records.
    Coarse,
}

impl RecordLevel {
    /// Returns the distances in pixels between the film points of each pass.
    fn strides(self) -> &'static [u32] {
        match self {
            RecordLevel::Fine => &[32, 16, 8, 4, 2],
            RecordLevel::Coarse => &[32, 16, 8, 6],
        }
    }
}

/// Adds the records that the view needs to the existing records of a replicate's cache. Returns all records, and the
/// rays that were traced for them.
pub fn run(
    preparation: &Preparation<'_>,
    settings: &IrrcacheSettings,
    child: &dyn Integrator,
    replicate: u32,
    level: RecordLevel,
    known: Vec<Record>,
) -> (Vec<Record>, Counters) {
    let Preparation { scene, pool, seed, sampler, .. } = *preparation;
    let seed =
        combine(combine(combine(seed as u32, (seed >> 32) as u32), replicate), 0x6972_7263 + level as u32);
    let gathering = Gathering { scene, child, settings, seed, replicate, level };
    let workers = Workers::new(pool, sampler, preparation.interrupt);
    let mut overture = Overture {
        preparation,
        gathering,
        workers,
        tree: Octree::of(&known, scene.bounds),
        records: known,
        clamp: settings.clamp_neighbor,
    };
    pool.install(|| {
        for (pass, &stride) in level.strides().iter().enumerate() {
            let points = overture.points(pass as u32, stride);
            for batch in points.chunks(BATCH) {
                if preparation.interrupt.is_raised() {
                    return;
                }
                overture.process_batch(batch);
            }
        }
    });
    (overture.records, overture.workers.counters())
}

struct Overture<'a> {
    preparation: &'a Preparation<'a>,
    gathering: Gathering<'a>,
    workers: Workers,
    records: Vec<Record>,
    tree: Octree,
    clamp: bool,
}

/// A record whose radius has to be reduced.
#[derive(Clone, Copy)]
struct Narrowing {
    record: u32,
    radius: f32,
}

/// A point on the film, with the key of its random numbers.
#[derive(Clone, Copy)]
struct FilmPoint {
    at: DVec2,
    key: SampleKey,
}

impl Overture<'_> {
    /// Returns the film points of a pass, one in each square of `stride` pixels, in a random order. Consecutive
    /// points are therefore seldom neighbours, and a batch computes few redundant records.
    fn points(&self, pass: u32, stride: u32) -> Vec<FilmPoint> {
        // A crop has the records of the whole image, so that its pixels are the same.
        let rect = self.preparation.camera.film.full_rect();
        let (columns, rows) = (rect.width.div_ceil(stride), rect.height.div_ceil(stride));
        let Gathering { seed, replicate, .. } = self.gathering;
        let seed = combine(seed, pass);
        let mut points: Vec<(u32, FilmPoint)> = Vec::with_capacity(columns as usize * rows as usize);
        for y in 0..rows {
            for x in 0..columns {
                let [a, b, order] = pcg3d(seed ^ 0x7061_7373, x, y);
                let along = |start: u32, i: u32, length: u32, u: u32| {
                    let width = stride.min(length - i * stride);
                    f64::from(start + i * stride) + f64::from(to_unit(u)) * f64::from(width)
                };
                let at = DVec2::new(along(rect.x, x, rect.width, a), along(rect.y, y, rect.height, b));
                let key = SampleKey { scramble: combine(combine(seed, x), y), index: 0, replicate };
                points.push((order, FilmPoint { at, key }));
            }
        }
        points.sort_by_key(|(order, _)| *order);
        points.into_iter().map(|(_, point)| point).collect()
    }

    /// Looks up a batch in the cache, computes the missing records and merges them in order.
    fn process_batch(&mut self, batch: &[FilmPoint]) {
        let this = &*self;
        let looked_up: Vec<(Vec<DiffusePoint>, Vec<Narrowing>)> =
            batch.par_chunks(CHUNK).map(|points| this.missing(points)).collect();
        let (missing, narrowings): (Vec<_>, Vec<_>) = looked_up.into_iter().unzip();
        let missing: Vec<DiffusePoint> = missing.into_iter().flatten().collect();
        // Waves are kept small enough that every thread gets work.
        let shared = missing.len().div_ceil(2 * rayon::current_num_threads());
        let per_wave = this.gathering.records_per_wave().min(shared).max(1);
        let first = this.records.len();
        let computed: Vec<Vec<Record>> = missing
            .par_chunks(per_wave)
            .enumerate()
            .map(|(i, points)| {
                this.workers.with(|worker| this.gathering.records(points, first + i * per_wave, worker))
            })
            .collect();
        for Narrowing { record, radius } in narrowings.into_iter().flatten() {
            let record = &mut self.records[record as usize];
            record.radius = record.radius.min(radius);
        }
        computed.into_iter().flatten().for_each(|record| self.merge(record));
    }

    /// Returns the surface points seen from the film points that no record covers, and the records that reach too far.
    fn missing(&self, points: &[FilmPoint]) -> (Vec<DiffusePoint>, Vec<Narrowing>) {
        let Preparation { scene, camera, .. } = self.preparation;
        let cones = points.iter().map(|point| {
            let time = if scene.needs.time { to_unit(combine(point.key.scramble, 0x7469_6d65)) } else { 0.0 };
            let ray = camera.ray(point.at, Vec2::splat(0.5), time);
            let beside = camera.ray(point.at + DVec2::X, Vec2::splat(0.5), time);
            let (size, growth) = ((beside.o - ray.o).length(), (beside.d - ray.d).length());
            RayCone { ray, key: point.key, size, growth }
        });
        let mut found = Vec::new();
        self.workers.with(|worker| diffuse_points::find(scene, cones.collect(), worker, &mut found));
        if self.gathering.level == RecordLevel::Coarse {
            found = self.visible_from(found);
        }
        let room = if self.clamp { self.room(&found) } else { vec![f32::INFINITY; found.len()] };
        let mut narrowings = Vec::new();
        let missing = found.into_iter().zip(room);
        let missing = missing.filter(|(point, room)| !self.is_covered(point, *room, &mut narrowings));
        (missing.map(|(point, _)| point).collect(), narrowings)
    }

    /// Returns the distance to what one ray from each point hits, in a cosine-distributed random direction; it is at
    /// least the smallest radius.
    fn room(&self, points: &[DiffusePoint]) -> Vec<f32> {
        let rays: Vec<Ray> = points.iter().enumerate().map(|(i, point)| random_ray(point, i).0).collect();
        self.workers.with(|worker| {
            let Worker { hits, counters, .. } = worker;
            intersect(self.preparation.scene, &rays, Coherence::Incoherent, hits, counters);
            let distance = |hit: &Option<Hit>| hit.map_or(f32::INFINITY, |hit| hit.t);
            let least = points.iter().map(|point| self.gathering.radii(point.pixel)[0]);
            hits.iter().zip(least).map(|(hit, least)| distance(hit).max(least)).collect()
        })
    }

    /// Returns one point seen from each of the given points, in a cosine-distributed random direction.
    fn visible_from(&self, points: Vec<DiffusePoint>) -> Vec<DiffusePoint> {
        let cones = points.iter().enumerate().map(|(i, point)| {
            let (ray, scramble) = random_ray(point, i);
            let key = SampleKey { scramble, index: 0, replicate: self.gathering.replicate };
            RayCone { ray, key, size: point.pixel, growth: point.growth }
        });
        let mut found = Vec::new();
        let scene = self.preparation.scene;
        self.workers.with(|worker| diffuse_points::find(scene, cones.collect(), worker, &mut found));
        found
    }

    /// Returns whether a record reaches the point. Records that have missed a surface at the distance `room` from the
    /// point count with the radius that [`merge`](Self::merge) would leave them beside a record with that radius.
    fn is_covered(&self, point: &DiffusePoint, room: f32, narrowings: &mut Vec<Narrowing>) -> bool {
        let mut covered = false;
        for &i in self.tree.near(point.p) {
            let record = &self.records[i as usize];
            if weight(record, point.p, point.n) > 0.0 {
                let radius = record.radius.min(room + (record.p - point.p).length());
                covered |= weight(&Record { radius, ..*record }, point.p, point.n) > 0.0;
                if radius < record.radius {
                    narrowings.push(Narrowing { record: i, radius });
                }
            }
        }
        covered
    }

    /// Adds a record. With clamping, the radii of two neighbours differ by at most their distance, because a surface
    /// near one record is at most that much farther from the other. [Křivánek 2006]
    fn merge(&mut self, mut record: Record) {
        if self.clamp {
            for &i in self.tree.near(record.p) {
                let other = &mut self.records[i as usize];
                let distance = (other.p - record.p).length();
                if other.n.dot(record.n) <= 0.0 || distance > other.radius {
                    continue;
                }
                record.radius = record.radius.min(other.radius + distance);
                other.radius = other.radius.min(record.radius + distance);
            }
        }
        self.records.push(record);
        self.tree.insert(self.records.len() as u32 - 1, &self.records);
    }
}

/// Returns the ray from the `i`-th point of a list in a cosine-distributed random direction, and one more random
/// number.
fn random_ray(point: &DiffusePoint, i: usize) -> (Ray, u32) {
    let [a, b, more] = pcg3d(point.p.x.to_bits() ^ point.p.y.to_bits(), point.p.z.to_bits(), i as u32);
    let d = warp::square_to_cosine_hemisphere(Vec2::new(to_unit(a), to_unit(b)));
    (point.ray(&Frame::from_normal(point.n), d), more)
}
