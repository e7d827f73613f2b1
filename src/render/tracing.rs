//! Sampling of one tile and one range of samples: camera rays, radiance, sums.

use super::edges::TileEdges;
use super::job::Job;
use crate::accel::{Coherence, Hit};
use crate::color::Rgb;
use crate::film::{FilterSample, PixelRect, Tile};
use crate::integrator::path::groups::PixelGroups;
use crate::integrator::worker::{draw_1d, draw_2d};
use crate::integrator::{Group, NO_RAY, Radiance, RadianceQuery, Wave, Worker};
use crate::math::lanes::{LANES, f32x16, load};
use crate::math::{DVec2, Ray, Vec2};
use crate::sampling::{Dimension, SampleKey};
use std::ops::Range;

/// The number of paths in a wave: large enough for long SIMD loops and few calls, small enough for the second-level
/// cache.
const WAVE: usize = 2048;
/// The number of paths in a wave with groups, which need more memory.
const GROUPED_WAVE: usize = 1024;

/// A sample that was dropped because it is not a finite, non-negative radiance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct InvalidSample {
    /// Column in the full image.
    pub x: u32,
    /// Row in the full image.
    pub y: u32,
    /// Index of the sample in its pixel.
    pub sample: u64,
    /// The value.
    pub value: [f32; 3],
}

/// Consecutive samples of one pixel.
#[derive(Clone, Copy)]
struct SampleSpan {
    /// The pixel's index in the tile; `None` outside.
    pixel: Option<usize>,
    /// The position in the full image.
    position: (u32, u32),
    first: u64,
    end: u64,
    /// The number of paths in addition to the first one of each sample.
    more: u32,
}

/// A sample that is the mean of several paths.
#[derive(Clone, Copy)]
struct Mean {
    /// The index of its first path in the wave.
    first: usize,
    /// The number of its other paths, which are a group if there are groups. Those of all such samples follow the
    /// first paths of all samples of the wave.
    more: u32,
    /// The position of the pixel in the full image.
    position: (u32, u32),
}

/// One thread's buffers for camera rays.
pub struct CameraWorker {
    /// The integrator's worker.
    pub worker: Worker,
    /// The pixels and samples of the current wave.
    spans: Vec<SampleSpan>,
    /// The samples of the wave that are means.
    means: Vec<Mean>,
    rays: Vec<Ray>,
    keys: Vec<SampleKey>,
    positions: [Vec<f32>; 2],
    /// The positions on the film in pixels of the full image, by coordinate.
    film: [Vec<f64>; 2],
    lens: [Vec<f32>; 2],
    times: Vec<f32>,
    /// The weights of filter samples, for filters that have them.
    weights: Vec<f32>,
    /// The factors of the radiance of each ray, for cameras that have them.
    factors: Vec<f32>,
    groups: Vec<Group>,
    radiance: Vec<Radiance>,
    values: Vec<f32>,
    /// The first dropped samples of this thread.
    pub invalid: Vec<InvalidSample>,
    /// The number of dropped samples.
    pub invalid_count: u64,
}

/// The number of dropped samples that each thread records.
const REMEMBERED: usize = 16;

/// Returns the number of camera rays of a wave without groups.
fn rays_per_wave(job: &Job<'_>) -> usize {
    (WAVE / job.integrator.paths_per_ray() as usize).max(1)
}

impl CameraWorker {
    /// Creates a worker with empty buffers.
    pub fn new(worker: Worker) -> Self {
        CameraWorker {
            worker,
            spans: Vec::new(),
            means: Vec::new(),
            rays: Vec::new(),
            keys: Vec::new(),
            positions: [Vec::new(), Vec::new()],
            film: [Vec::new(), Vec::new()],
            lens: [Vec::new(), Vec::new()],
            times: Vec::new(),
            weights: Vec::new(),
            factors: Vec::new(),
            groups: Vec::new(),
            radiance: Vec::new(),
            values: Vec::new(),
            invalid: Vec::new(),
            invalid_count: 0,
        }
    }

    /// Takes the given samples of every pixel of the tile, unless the render is interrupted between waves.
    pub fn render_tile(&mut self, job: &Job<'_>, tile: &mut Tile, edges: TileEdges<'_>, samples: Range<u64>) {
        self.render_region(job, tile, (tile.rect(), edges), samples);
    }

    /// Takes the given samples of every pixel of a region of the tile, which contains whole cells or their parts inside
    /// the tile, unless the render is interrupted between waves.
    fn render_region(
        &mut self,
        job: &Job<'_>,
        tile: &mut Tile,
        (region, edges): (PixelRect, TileEdges<'_>),
        samples: Range<u64>,
    ) {
        let (film, seed) = (&job.camera.film, job.settings.seed);
        let cells = job.integrator.reuse_cells();
        let groups = cells.map(|side| PixelGroups::new(side, seed, [film.width, film.height], region));
        let outside = groups.as_ref().map_or(&[][..], |groups| &groups.outside);
        let rect = tile.rect();
        let inside = (region.y..region.y + region.height).flat_map(|y| {
            (region.x..region.x + region.width)
                .map(move |x| (Some(((y - rect.y) * rect.width + x - rect.x) as usize), (x, y)))
        });
        let pixels: Vec<_> = inside.chain(outside.iter().map(|&position| (None, position))).collect();
        let wave = if groups.is_some() { GROUPED_WAVE } else { rays_per_wave(job) };
        let more = |pixel: Option<usize>| pixel.map_or(0, |pixel| edges.more(pixel));
        let paths: usize = pixels.iter().map(|(pixel, _)| 1 + more(*pixel) as usize).sum();
        let per_wave = (wave / paths).max(1) as u64;
        let mut first = samples.start;
        while first < samples.end && !job.progress.is_interrupted() {
            let end = (first + per_wave).min(samples.end);
            self.spans.clear();
            let span = |&(pixel, position)| SampleSpan { pixel, position, first, end, more: more(pixel) };
            self.spans.extend(pixels.iter().map(span));
            if let Some(groups) = &groups {
                groups.of_wave((end - first) as u32, &mut self.groups);
            }
            self.render_wave(job, tile);
            first = end;
        }
        self.groups.clear();
    }

    /// Takes the samples that `samples` returns for the position of each pixel in the full image, unless the render
    /// is interrupted between waves. They must be the same for all pixels of a cell in which paths are reused.
    pub fn render_allocated(
        &mut self,
        job: &Job<'_>,
        tile: &mut Tile,
        edges: TileEdges<'_>,
        samples: impl Fn((u32, u32)) -> Range<u64>,
    ) {
        if let Some(side) = job.integrator.reuse_cells() {
            for cell in tile.rect().cells(side as u32) {
                self.render_region(job, tile, (cell, edges), samples((cell.x, cell.y)));
            }
            return;
        }
        self.spans.clear();
        let wave = rays_per_wave(job) as u64;
        let mut free = wave;
        for pixel in 0..tile.pixel_count() {
            let position = tile.position(pixel);
            let Range { start: mut first, end: last } = samples(position);
            while first < last && !job.progress.is_interrupted() {
                let more = edges.more(pixel);
                let paths = u64::from(1 + more);
                let end = last.min(first + (free / paths).max(1));
                self.spans.push(SampleSpan { pixel: Some(pixel), position, first, end, more });
                free = free.saturating_sub(paths * (end - first));
                first = end;
                if free == 0 {
                    self.render_wave(job, tile);
                    self.spans.clear();
                    free = wave;
                }
            }
        }
        if !self.spans.is_empty() && !job.progress.is_interrupted() {
            self.render_wave(job, tile);
        }
    }

    /// Takes the samples of `spans`.
    fn render_wave(&mut self, job: &Job<'_>, tile: &mut Tile) {
        self.generate_rays(job);
        let (rays, keys, groups) = (&self.rays, &self.keys, &self.groups);
        let wave = Wave { rays, keys, coherence: Coherence::Coherent, groups };
        self.radiance.clear();
        self.radiance.resize(self.rays.len(), Radiance::NONE);
        job.integrator.li(job.scene, wave, RadianceQuery::ALL, &mut self.worker, &mut self.radiance);
        // The paths may be incomplete.
        if job.progress.is_interrupted() {
            return;
        }
        self.radiance.iter_mut().zip(&self.factors).for_each(|(radiance, factor)| radiance.value *= *factor);
        self.worker.counters.paths += self.rays.len() as u64;
        if job.has_sampled_layers() {
            self.worker.intersect(job.scene, &self.rays, Coherence::Coherent);
        }
        self.accumulate(job, tile);
        let inside = self.spans.iter().filter(|span| span.pixel.is_some());
        job.progress.add_samples(inside.map(|span| span.end - span.first).sum());
    }

    /// Generates the camera rays, pixel by pixel; the samples of a pixel are consecutive. The other paths of means
    /// follow them.
    fn generate_rays(&mut self, job: &Job<'_>) {
        let sampler = self.worker.sampler;
        self.keys.clear();
        self.means.clear();
        for span in &self.spans {
            let (x, y) = span.position;
            let first = self.keys.len();
            self.keys.extend((span.first..span.end).map(|s| sampler.key(job.settings.seed, x, y, s)));
            if span.more > 0 {
                let mean = |first| Mean { first, more: span.more, position: span.position };
                self.means.extend((first..self.keys.len()).map(mean));
            }
        }
        for mean in &self.means {
            if !self.groups.is_empty() {
                let first = self.keys.len() as u32;
                let path = |k| if k < mean.more { first + k } else { NO_RAY };
                self.groups.push(std::array::from_fn(|k| path(k as u32)));
            }
            let key = self.keys[mean.first].beside();
            self.keys.extend((0..mean.more).map(|k| sampler.split(key, mean.more, k)));
        }
        self.worker.shared_light.clear();
        if job.integrator.shares_noise() && job.integrator.traces_light_paths() {
            for span in &self.spans {
                let key = |x, y, sample| sampler.key(job.settings.seed, x, y, sample);
                self.worker.shared_light.add(span.position, span.first..span.end, key);
            }
            for mean in &self.means {
                self.worker.shared_light.repeat(mean.first, mean.more);
            }
        }
        draw_2d(sampler, Dimension::PIXEL, &self.keys, &mut self.positions);
        if job.camera.has_lens() {
            draw_2d(sampler, Dimension::LENS, &self.keys, &mut self.lens);
        }
        if job.scene.needs.time && self.worker.time.is_none() {
            draw_1d(sampler, Dimension::TIME, &self.keys, &mut self.times);
        }
        self.film.iter_mut().for_each(Vec::clear);
        self.weights.clear();
        let spans = self.spans.iter().map(|span| (span.position, span.end - span.first));
        let means = self.means.iter().map(|mean| (mean.position, u64::from(mean.more)));
        let mut i = 0;
        for ((x, y), count) in spans.chain(means) {
            for _ in 0..count {
                let u = Vec2::new(self.positions[0][i], self.positions[1][i]);
                let FilterSample { offset, weight } = job.filter.sample(u);
                self.film[0].push(f64::from(x) + 0.5 + f64::from(offset.x));
                self.film[1].push(f64::from(y) + 0.5 + f64::from(offset.y));
                if job.filter.has_weights() {
                    self.weights.push(weight);
                }
                i += 1;
            }
        }
        self.rays.clear();
        self.factors.clear();
        for first in (0..self.keys.len()).step_by(LANES) {
            self.generate_block(job, first);
        }
    }

    /// Generates at most sixteen rays, from the sample `first` of the wave on.
    fn generate_block(&mut self, job: &Job<'_>, first: usize) {
        let Job { camera, scene, .. } = job;
        let u = match camera.has_lens() {
            true => [0, 1].map(|k| load(&self.lens[k], first)),
            false => [f32x16::ZERO; 2],
        };
        let time = match self.worker.time {
            Some(time) => f32x16::splat(time),
            None if scene.needs.time => load(&self.times, first),
            None => f32x16::ZERO,
        };
        self.add_rays(job, first, u, time);
    }

    /// Adds at most sixteen rays through the points of `film` from `first` on. `u` chooses the points on the lens.
    fn add_rays(&mut self, job: &Job<'_>, first: usize, u: [f32x16; 2], time: f32x16) {
        let camera = job.camera;
        let count = LANES.min(self.film[0].len() - first);
        let mut film = [[0.0; LANES]; 2];
        for (lanes, film) in film.iter_mut().zip(&self.film) {
            lanes[..count].copy_from_slice(&film[first..first + count]);
        }
        if let Some(rays) = camera.rays_x16([&film[0], &film[1]], u, time) {
            self.rays.extend_from_slice(&rays.to_rays()[..count]);
            return;
        }
        let [u, v, time] = [u[0], u[1], time].map(f32x16::to_array);
        for (i, (x, y)) in film[0].into_iter().zip(film[1]).take(count).enumerate() {
            let (ray, factor) = camera.weighted_ray(DVec2::new(x, y), Vec2::new(u[i], v[i]), time[i]);
            self.rays.push(ray);
            if camera.has_weights() {
                self.factors.push(factor);
            }
        }
    }

    /// Returns the radiance, in its brightest channel, of the emitters that rays through the centres of pixels of the
    /// full image and of the lens hit; 0 where they hit none. The rays are not counted: they are few, and the same for
    /// any number of samples.
    pub fn emitted(&mut self, job: &Job<'_>, pixels: impl Iterator<Item = (u32, u32)>) -> Vec<f32> {
        let counters = self.worker.counters;
        self.film.iter_mut().for_each(Vec::clear);
        for (x, y) in pixels {
            self.film[0].push(f64::from(x) + 0.5);
            self.film[1].push(f64::from(y) + 0.5);
        }
        self.rays.clear();
        let centre = f32x16::splat(0.5);
        for first in (0..self.film[0].len()).step_by(LANES) {
            self.add_rays(job, first, [centre; 2], centre);
        }
        self.worker.intersect(job.scene, &self.rays, Coherence::Coherent);
        self.worker.counters = counters;
        let scene = job.scene;
        let emitted = |(ray, hit): (&Ray, &Option<Hit>)| {
            let Some(hit) = hit.filter(|hit| scene.shapes[hit.geometry as usize].emitter.is_some()) else {
                return 0.0;
            };
            let at = scene.interaction(ray, &hit);
            scene.emitter_at(&at).map_or(0.0, |emitter| scene.emitted(emitter, &at).max_component())
        };
        self.rays.iter().zip(&self.worker.hits).map(emitted).collect()
    }

    fn accumulate(&mut self, job: &Job<'_>, tile: &mut Tile) {
        let only_colour = !job.alpha && !job.has_sampled_layers() && !job.filter.has_weights();
        let (mut j, mut other) = (0, self.rays.len());
        other -= self.means.iter().map(|mean| mean.more as usize).sum::<usize>();
        for s in 0..self.spans.len() {
            let SampleSpan { pixel, position, first, end, more } = self.spans[s];
            let Some(pixel) = pixel else {
                j += (end - first) as usize;
                continue;
            };
            for sample in first..end {
                let others = other..other + more as usize;
                other = others.end;
                let mut value = self.radiance[j].value;
                if more > 0 {
                    others.clone().for_each(|k| value += self.radiance[k].value);
                    value = value / (1 + more) as f32;
                }
                let replicate = job.settings.sampler.replicate(sample) as usize;
                if !value.is_valid() {
                    self.drop_sample(position, sample, value);
                } else if only_colour {
                    tile.add(pixel, replicate, &value.to_array());
                } else {
                    self.evaluate_layers(job, j, others);
                    if let Some(&weight) = self.weights.get(j) {
                        self.values.iter_mut().for_each(|v| *v *= weight);
                    }
                    tile.add(pixel, replicate, &self.values);
                }
                j += 1;
            }
        }
    }

    /// Fills `values` with the means of all channels over path `j` of the wave and others.
    fn evaluate_layers(&mut self, job: &Job<'_>, j: usize, others: Range<usize>) {
        let paths = 1 + others.len();
        self.values.clear();
        self.append_layers(job, j);
        let channels = self.values.len();
        for k in others {
            self.append_layers(job, k);
            let (sum, added) = self.values.split_at_mut(channels);
            sum.iter_mut().zip(added).for_each(|(sum, v)| *sum += *v);
            self.values.truncate(channels);
        }
        if paths > 1 {
            self.values.iter_mut().for_each(|v| *v /= paths as f32);
        }
    }

    /// Appends all channels of path `j` of the wave to `values`.
    fn append_layers(&mut self, job: &Job<'_>, j: usize) {
        let radiance = self.radiance[j];
        self.values.extend(radiance.value.to_array());
        if job.alpha {
            let opaque = job.opaque_environment || radiance.distance.is_finite();
            self.values.push(if opaque { 1.0 } else { 0.0 });
        }
        for layer in job.sampled_layers() {
            let start = self.values.len();
            self.values.resize(start + layer.channels().len(), 0.0);
            let hit = self.worker.hits[j].as_ref();
            let (ray, key) = (&self.rays[j], self.keys[j]);
            job.integrator.layer(layer, job.scene, ray, key, hit, &mut self.values[start..]);
        }
    }

    #[cold]
    fn drop_sample(&mut self, (x, y): (u32, u32), sample: u64, value: Rgb) {
        self.invalid_count += 1;
        if self.invalid.len() < REMEMBERED {
            self.invalid.push(InvalidSample { x, y, sample, value: value.to_array() });
        }
    }
}
