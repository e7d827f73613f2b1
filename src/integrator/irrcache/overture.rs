//! The overture: records wherever the image needs any, before it is rendered.

use super::gathering::Gathering;
use super::octree::Octree;
use super::places::{self, Place, Sight};
use super::record::Record;
use super::weight::weight;
use crate::integrator::preparation::Workers;
use crate::integrator::settings::IrrcacheSettings;
use crate::integrator::{Integrator, Preparation};
use crate::math::{DVec2, Frame, Vec2};
use crate::sampling::hash::{combine, pcg3d, to_unit};
use crate::sampling::{SampleKey, warp};
use rayon::prelude::*;

/// Places that are looked up in the cache before what is missing is computed.
const BATCH: usize = 2048;
/// Camera rays of a task.
const CHUNK: usize = 256;

/// What records are for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Level {
    /// What the camera sees.
    Fine,
    /// What is seen from there.
    Coarse,
}

impl Level {
    /// Distance in pixels between the places that are looked at, pass after pass.
    fn strides(self) -> &'static [u32] {
        match self {
            Level::Fine => &[32, 16, 8, 4, 2],
            Level::Coarse => &[32, 16, 8, 6],
        }
    }
}

/// Adds what the view needs to the known records of a cache for one replicate of the samples, and returns all.
pub fn run(
    preparation: &Preparation<'_>,
    settings: &IrrcacheSettings,
    child: &dyn Integrator,
    replicate: u32,
    level: Level,
    known: Vec<Record>,
) -> Vec<Record> {
    let Preparation { scene, pool, seed, sampler, .. } = *preparation;
    let seed =
        combine(combine(combine(seed as u32, (seed >> 32) as u32), replicate), 0x6972_7263 + level as u32);
    let gathering = Gathering { scene, child, settings, seed, replicate, level };
    let workers = Workers::new(pool, sampler, preparation.interrupt);
    let mut overture = Overture {
        preparation,
        gathering,
        workers,
        tree: Octree::of(&known, scene.bounds, 1.0),
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
                overture.serve(batch);
            }
        }
    });
    overture.records
}

struct Overture<'a> {
    preparation: &'a Preparation<'a>,
    gathering: Gathering<'a>,
    workers: Workers,
    records: Vec<Record>,
    tree: Octree,
    clamp: bool,
}

/// A place on the film, with its number in the pass.
#[derive(Clone, Copy)]
struct FilmPoint {
    at: DVec2,
    key: SampleKey,
}

impl Overture<'_> {
    /// The points of a pass, one in each square of `stride` pixels, in an order that leads everywhere at once: two that follow each
    /// other are seldom neighbours, so a batch computes few records that another of it would have made needless.
    fn points(&self, pass: u32, stride: u32) -> Vec<FilmPoint> {
        let rect = self.preparation.camera.film.rect();
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

    /// Looks a batch up in the cache, computes what is missing and merges it in order.
    fn serve(&mut self, batch: &[FilmPoint]) {
        let this = &*self;
        let missing: Vec<Vec<Place>> = batch.par_chunks(CHUNK).map(|points| this.missing(points)).collect();
        let missing: Vec<Place> = missing.into_iter().flatten().collect();
        // No thread is to wait for a wave that another one could have shared.
        let shared = missing.len().div_ceil(2 * rayon::current_num_threads());
        let per_wave = this.gathering.records_per_wave().min(shared).max(1);
        let first = this.records.len();
        let computed: Vec<Vec<Record>> = missing
            .par_chunks(per_wave)
            .enumerate()
            .map(|(i, places)| {
                this.workers.with(|worker| this.gathering.records(places, first + i * per_wave, worker))
            })
            .collect();
        computed.into_iter().flatten().for_each(|record| self.merge(record));
    }

    /// The places that the points see and that no record reaches.
    fn missing(&self, points: &[FilmPoint]) -> Vec<Place> {
        let Preparation { scene, camera, .. } = self.preparation;
        let sights = points.iter().map(|point| {
            let time = if scene.needs.time { to_unit(combine(point.key.scramble, 0x7469_6d65)) } else { 0.0 };
            let ray = camera.ray(point.at, Vec2::splat(0.5), time);
            let beside = camera.ray(point.at + DVec2::X, Vec2::splat(0.5), time);
            let (size, growth) = ((beside.o - ray.o).length(), (beside.d - ray.d).length());
            Sight { ray, key: point.key, size, growth }
        });
        let mut found = Vec::new();
        let deep = (scene.needs.deltas > 0) || scene.needs.lobe_choice || scene.needs.varying_materials;
        self.workers.with(|worker| places::find(scene, sights.collect(), deep, worker, &mut found));
        if self.gathering.level == Level::Coarse {
            found = self.seen_from(found, deep);
        }
        found.retain(|place| !self.reached(place));
        found
    }

    /// One place that is seen from each of the places, in a direction drawn by its cosine.
    fn seen_from(&self, places: Vec<Place>, deep: bool) -> Vec<Place> {
        let sights = places.iter().enumerate().map(|(i, place)| {
            let [a, b, scramble] =
                pcg3d(place.p.x.to_bits() ^ place.p.y.to_bits(), place.p.z.to_bits(), i as u32);
            let d = warp::square_to_cosine_hemisphere(Vec2::new(to_unit(a), to_unit(b)));
            let ray = place.ray(&Frame::from_normal(place.n), d);
            let key = SampleKey { scramble, index: 0, replicate: self.gathering.replicate };
            Sight { ray, key, size: place.pixel, growth: place.growth }
        });
        let mut found = Vec::new();
        let scene = self.preparation.scene;
        self.workers.with(|worker| places::find(scene, sights.collect(), deep, worker, &mut found));
        found
    }

    fn reached(&self, place: &Place) -> bool {
        let weight = |i: &u32| weight(&self.records[*i as usize], 1.0, place.p, place.n);
        self.tree.near(place.p).iter().any(|i| weight(i) > 0.0)
    }

    /// Adds a record. No two neighbours' radii differ by more than their distance: what one has found near by, the other one cannot
    /// have farther away. [Křivánek 2006]
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
