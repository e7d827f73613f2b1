//! Merging of camera paths with the light paths of a pass that end nearby. [Georgiev et al. 2012; Hachisuka et al.
//! 2012]

use super::LensConnections;
use super::light_paths::StoredVertex;
use super::technique::Techniques;
use super::weights::{Earlier, Merged, Partial};
use crate::color::Rgb;
use crate::integrator::light_path::LightVertex;
use crate::integrator::photon::{EmissionGuide, PathSequence, PhotonGrid, PhotonSurface, Positioned};
use crate::integrator::preparation::Workers;
use crate::integrator::settings::PathLimits;
use crate::integrator::{Counters, Preparation, RadianceQuery, Splat};
use crate::math::Vec3;
use crate::sampling::SampleKey;
use crate::scene::Scene;
use rayon::prelude::*;
use std::f32::consts::PI;

/// The number of light paths in a batch.
const BATCH: u64 = 2048;

/// The end of a light path.
#[derive(Clone, Copy)]
pub struct PathEnd {
    p: Vec3,
    /// The unit direction towards the incident light.
    wi: Vec3,
    surface: PhotonSurface,
    /// The power relative to the shading frame, W, of a path traced alone.
    power: Rgb,
    /// The number of edges from the emitter.
    edges: u32,
    earlier: Earlier,
}

impl Positioned for PathEnd {
    #[inline]
    fn position(&self) -> Vec3 {
        self.p
    }
}

impl PathEnd {
    /// Returns the end of a light path at a vertex, if its values are finite.
    fn of(scene: &Scene, stored: &StoredVertex<'_>) -> Option<Self> {
        let LightVertex { at, wo, wo_ng, .. } = stored.vertex.surface();
        // Paths from both ends hit a surface with holes with the same probability, which must count once.
        let power = stored.power * ((wo.z / wo_ng).abs() / scene.hit_probability(at));
        let valid = at.p.is_finite() && power.is_valid();
        valid.then(|| PathEnd {
            p: at.p,
            wi: at.frame.to_world(*wo),
            surface: PhotonSurface::at(scene, at),
            power,
            edges: stored.edges,
            earlier: stored.partial.earlier,
        })
    }
}

/// The light paths of a pass.
#[derive(Default)]
pub struct Merging {
    grid: PhotonGrid<PathEnd>,
    emitted: u64,
    merged: Merged,
}

/// The result of tracing the light paths of a pass.
pub struct TracedPass {
    /// The paths with which camera paths are merged.
    pub merging: Merging,
    /// The contributions of their vertices to the film, in batches.
    pub splats: Vec<Vec<Splat>>,
    /// The number of ends dropped because they were not finite.
    pub invalid: u64,
    /// The counts of rays and their times.
    pub counters: Counters,
}

/// What the light paths of a pass are.
pub struct LightPass<'a> {
    /// The density of the starts of light paths.
    pub guide: Option<&'a EmissionGuide>,
    pub limits: PathLimits,
    pub sequence: PathSequence,
    /// The number of light paths.
    pub paths: u64,
    /// The radius of the disk in which paths are merged, in scene units.
    pub radius: f32,
    /// The width of a pixel on the surfaces seen, in scene units.
    pub pixel: f32,
    /// The time of all paths, in [0, 1] over the shutter interval, if they share it.
    pub time: Option<f32>,
    /// The extent of the reconstruction filter beyond the image, in pixels.
    pub margin: f64,
}

impl LightPass<'_> {
    /// Traces the light paths, and connects their vertices to the camera.
    pub fn trace(&self, preparation: &Preparation<'_>) -> TracedPass {
        let Preparation { scene, camera, sampler, pool, interrupt, .. } = *preparation;
        let workers = Workers::new(pool, sampler, interrupt).at_time(self.time);
        let (limits, query, margin, merged) = (self.limits, RadianceQuery::ALL, self.margin, self.merged());
        let techniques = Techniques::All;
        let lens = LensConnections {
            scene,
            camera,
            guide: self.guide,
            techniques,
            limits,
            query,
            margin,
            merged,
            media: None,
            caustics: None,
        };
        let batch = |batch: u64| {
            let range = batch * BATCH..((batch + 1) * BATCH).min(self.paths);
            let keys: Vec<SampleKey> = range.map(|i| self.sequence.key(i)).collect();
            workers.with(|worker| {
                let mut splats = Vec::new();
                let mut arena = std::mem::take(&mut worker.kept_arena);
                arena.reset();
                let paths = lens.light_paths(&arena, &keys, worker);
                let points = lens.queue(&paths, &keys, worker);
                let scattered = || paths.vertices.iter().filter(|vertex| vertex.edges > 1);
                let ends: Vec<PathEnd> =
                    scattered().filter_map(|vertex| PathEnd::of(scene, vertex)).collect();
                let invalid = (scattered().count() - ends.len()) as u64;
                drop(paths);
                worker.kept_arena = arena;
                lens.trace(&points, worker, |_, splat| splats.push(splat));
                (ends, splats, invalid)
            })
        };
        let batches = 0..self.paths.div_ceil(BATCH);
        let (merging, splats, invalid) = pool.install(|| {
            let traced: Vec<_> = batches.into_par_iter().map(batch).collect();
            let invalid = traced.iter().map(|(_, _, invalid)| invalid).sum();
            let (ends, splats): (Vec<_>, Vec<_>) =
                traced.into_iter().map(|(ends, splats, _)| (ends, splats)).unzip();
            let grid = PhotonGrid::new(&ends.concat(), self.radius);
            (Merging { grid, emitted: self.paths, merged }, splats, invalid)
        });
        TracedPass { merging, splats, invalid, counters: workers.counters() }
    }

    /// Returns the densities of merging. The light paths of a disk that count as one are those in the area of a pixel:
    /// there are as many light paths as pixels.
    fn merged(&self) -> Merged {
        let disk = f64::from(PI) * f64::from(self.radius).powi(2);
        let paths = self.paths as f64;
        Merged { first: paths * disk, later: paths * disk.min(f64::from(self.pixel).powi(2)) }
    }
}

impl Merging {
    /// Returns the densities of merging.
    pub fn merged(&self) -> Merged {
        self.merged
    }

    /// Returns the radius of the disk, in scene units.
    pub fn radius(&self) -> f32 {
        self.grid.radius()
    }

    /// Returns the number of ends.
    pub fn len(&self) -> usize {
        self.grid.len()
    }

    /// Returns the bytes of memory.
    pub fn memory_bytes(&self) -> usize {
        self.grid.memory_bytes()
    }

    /// Returns the weighted radiance that the finite lobes of a vertex of a camera path scatter towards the camera,
    /// from the light paths that end nearby: the sum of `f·Φ·K`, with the kernel `K = 2/(πr²)·(1 − d²/r²)`. `wanted`
    /// selects them by their number of edges.
    pub fn radiance(
        &self,
        scene: &Scene,
        vertex: &LightVertex<'_>,
        partial: &Partial,
        wanted: impl Fn(u32) -> bool,
    ) -> Rgb {
        let squared_radius = self.grid.radius().powi(2);
        let surface = PhotonSurface::at(scene, &vertex.at);
        let mut sum = Rgb::BLACK;
        self.grid.within(vertex.at.p, |light, squared| {
            if !wanted(light.edges) || !light.surface.matches(surface) {
                return;
            }
            let wi = vertex.at.frame.to_local(light.wi);
            let scattered = vertex.bsdf.eval(vertex.wo, wi);
            if scattered.f.is_black() {
                return;
            }
            let reverse = vertex.bsdf.pdf_adjoint(wi, vertex.wo);
            let weight = partial.of_merging(reverse.into(), &light.earlier, scattered.pdf.into());
            sum += scattered.f * light.power * (weight as f32 * (1.0 - squared / squared_radius));
        });
        sum * (2.0 / (PI * squared_radius * self.emitted as f32))
    }
}
