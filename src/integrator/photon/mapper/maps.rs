//! The creation of photon maps, or their reading from a file.

use crate::bsdf::Split;
use crate::error::{Error, Result};
use crate::integrator::photon::boundary::Boundary;
use crate::integrator::photon::file::{self, MapKind, MapLabel, MapOrigin};
use crate::integrator::photon::{
    DensityEstimator, EmissionGuide, IrradianceMap, LightPathTracer, PathLimit, PathSequence, Photon,
    PhotonMap, PhotonPaths,
};

use crate::integrator::settings::{PathLimits, PhotonDebug, PhotonmapperSettings};
use crate::integrator::{Counters, Preparation, Statistic};
use crate::math::Vec3;
use crate::memory::Reservation;
use crate::scene::Scene;
use crate::util::digest;
use bumpalo::Bump;

/// The irradiance is computed at one of this many photons. [Christensen 1999]
const IRRADIANCE_EVERY: usize = 4;
/// The streams of the light paths' random numbers, for the two kinds of maps.
const STREAMS: [u32; 2] = [0, 2];

/// The maps of one replicate of the samples. Maps that the scene does not need are absent.
#[derive(Default)]
pub struct Maps {
    /// Irradiance of all light.
    pub irradiance: Option<IrradianceMap>,
    /// All photons, for debug images.
    pub global: Option<PhotonMap>,
    /// The diameter of photons shown as points, in scene units.
    pub point: f32,
    /// The reserved memory of the maps of all replicates, stored with the first.
    reserved: Option<Reservation>,
}

/// The result of the preparation.
pub struct PreparedMaps {
    /// The maps of each replicate.
    pub maps: Vec<Maps>,
    /// The caustic map of each replicate: light scattered by Dirac deltas only.
    pub caustic: Vec<Option<PhotonMap>>,
    /// Statistics.
    pub statistics: Vec<Statistic>,
}

/// The maps that a scene needs.
struct MapPlan {
    global: Option<PhotonPaths>,
    caustic: Option<PhotonPaths>,
}

impl MapPlan {
    fn new(scene: &Scene, settings: &PhotonmapperSettings) -> Self {
        let allows = |edges: u32| settings.limits.allows(edges);
        let photons = |before: u32, direct: bool| PhotonPaths {
            max_edges: settings.limits.max_depth.map(|max| max - before),
            rr_depth: settings.limits.rr_depth,
            direct,
            indirect: direct,
        };
        let show = settings.debug != PhotonDebug::None;
        let (lit, depth) = (!scene.lights.is_empty(), allows(3));
        MapPlan {
            // Two edges of the path belong to the camera: the one to the gathering surface and the gather ray. In
            // debug images it is one.
            global: (lit && depth && has_diffuse_parts(scene))
                .then(|| photons(if show { 1 } else { 2 }, true)),
            caustic: (lit && depth && !show && (scene.needs.deltas > 0) && scene.needs.finite_lobes)
                .then(|| photons(1, false)),
        }
    }
}

/// Returns whether some surface may have a diffuse lobe. A surface with a varying BSDF may.
fn has_diffuse_parts(scene: &Scene) -> bool {
    let arena = Bump::new();
    scene.shapes.iter().any(|shape| match &scene.materials.get(shape.material).constant {
        None => true,
        Some(bsdf) => [Vec3::Z, -Vec3::Z].into_iter().any(|wo| {
            let Split { diffuse, .. } = bsdf.split(wo, &arena);
            diffuse.is_some()
        }),
    })
}

/// Creates the maps of all replicates.
pub fn prepare(
    preparation: &Preparation<'_>,
    settings: &PhotonmapperSettings,
    estimator: &DensityEstimator,
) -> Result<PreparedMaps> {
    let scene = preparation.scene;
    let plan = MapPlan::new(scene, settings);
    let mut reserved = reserve(preparation, settings, &plan)?;
    let mut counters = Counters::default();
    let photons = load_or_cast(preparation, settings, &plan, &mut counters)?;
    let replicates = preparation.sampler.replicates() as usize;
    let mut maps: Vec<Maps> = (0..replicates).map(|_| Maps::default()).collect();
    let mut caustic: Vec<Option<PhotonMap>> = (0..replicates).map(|_| None).collect();
    let mut global: Vec<Option<PhotonMap>> = (0..replicates).map(|_| None).collect();
    let mut sums = MapStatistics::default();
    for (label, map) in photons {
        let replicate = label.replicate as usize % replicates;
        sums.add(label, &map);
        match label.light {
            MapKind::Caustic => caustic[replicate] = Some(map),
            MapKind::Global if settings.debug != PhotonDebug::None => maps[replicate].global = Some(map),
            MapKind::Global => global[replicate] = Some(map),
        }
    }
    for (replicate, map) in global.iter().enumerate() {
        let Some(map) = map else { continue };
        // The photon positions of the next replicate are independent of this replicate's noise.
        let places = global[(replicate + 1) % replicates].as_ref().unwrap_or(map);
        let boundary = Boundary::new(scene);
        let irradiance = preparation
            .pool
            .install(|| IrradianceMap::new(map, places, estimator, IRRADIANCE_EVERY, Some(&boundary)));
        counters.merge(&boundary.counters());
        sums.points += irradiance.len() as f64;
        sums.bytes += irradiance.memory_bytes() as f64 - map.memory_bytes() as f64;
        maps[replicate].irradiance = Some(irradiance);
    }
    for replicate in &mut maps {
        replicate.point = POINT * scene.bounds.radius();
    }
    reserved.settle(sums.bytes as u64);
    maps[0].reserved = Some(reserved);
    Ok(PreparedMaps { maps, caustic, statistics: sums.statistics(&counters) })
}

/// Bytes of a photon in a finished map.
const BYTES_IN_MAP: u64 = PhotonMap::BYTES_PER_PHOTON as u64 + 1;
/// Bytes of a photon while its map is built: the list of photons, which grows by doubling, and the buffers in which
/// the tree is sorted.
const BYTES_WHILE_BUILDING: u64 = 70;
/// Bytes of a photon for its part of a finished irradiance map.
const IRRADIANCE_BYTES_IN_MAP: u64 = 12;
/// Bytes of a photon for its part of an irradiance map under construction.
const IRRADIANCE_BYTES_WHILE_BUILDING: u64 = 25;

/// Reserves the memory required while the maps are built.
fn reserve(
    preparation: &Preparation<'_>,
    settings: &PhotonmapperSettings,
    plan: &MapPlan,
) -> Result<Reservation> {
    let count = |paths: &Option<PhotonPaths>, photons: u32| paths.as_ref().map_or(0, |_| u64::from(photons));
    let (global, caustic) =
        (count(&plan.global, settings.global_photons), count(&plan.caustic, settings.caustic_photons));
    let irradiance = global * (2 * IRRADIANCE_BYTES_IN_MAP + IRRADIANCE_BYTES_WHILE_BUILDING);
    // Irradiance is computed after all photons were traced. The maps are built one after the other.
    let one = BYTES_WHILE_BUILDING * global.max(caustic) / u64::from(preparation.sampler.replicates() / 2);
    let cast = 2 * BYTES_IN_MAP * (global + caustic) + one.max(irradiance);
    // The content of a file is unknown before it has been read, so its length is the bound.
    let file = preparation.cache.as_ref().and_then(|cache| std::fs::metadata(&cache.path).ok());
    let photons = file.map_or(0, |about| about.len() / Photon::BYTES as u64);
    let needed = cast.max(photons.saturating_mul(BYTES_IN_MAP + BYTES_WHILE_BUILDING));
    preparation.memory.reserve(needed).map_err(|refusal| {
        let what =
            format!("maps of {global} global and {caustic} caustic photons for either half of the samples");
        Error::scene(refusal.sentence(&what, "ask for fewer photons")).about("photonmapper")
    })
}

/// The diameter of photons shown as points, relative to the scene's radius.
const POINT: f32 = 2e-3;

/// Statistics over all replicates.
#[derive(Default)]
struct MapStatistics {
    photons: [f64; 2],
    emitted: [f64; 2],
    points: f64,
    bytes: f64,
}

impl MapStatistics {
    fn add(&mut self, label: MapLabel, map: &PhotonMap) {
        self.photons[label.light as usize] += map.len() as f64;
        self.emitted[label.light as usize] += map.emitted() as f64;
        self.bytes += map.memory_bytes() as f64;
    }

    fn statistics(&self, counters: &Counters) -> Vec<Statistic> {
        [
            ("global_photons", self.photons[0]),
            ("global_light_paths", self.emitted[0]),
            ("irradiance_points", self.points),
            ("caustic_photons", self.photons[1]),
            ("caustic_light_paths", self.emitted[1]),
            ("photon_map_bytes", self.bytes),
        ]
        .map(|(name, value)| Statistic { name, value })
        .into_iter()
        .chain(Statistic::of_rays(counters))
        .collect()
    }
}

fn load_or_cast(
    preparation: &Preparation<'_>,
    settings: &PhotonmapperSettings,
    plan: &MapPlan,
    counters: &mut Counters,
) -> Result<Vec<(MapLabel, PhotonMap)>> {
    let Some(cache) = &preparation.cache else {
        return Ok(cast(preparation, settings, plan, counters));
    };
    let origin = MapOrigin { scene: cache.scene, settings: dependence(preparation, settings) };
    if cache.path.exists() {
        return file::load(&cache.path, origin);
    }
    let photons = cast(preparation, settings, plan, counters);
    if !preparation.interrupt.is_raised() {
        let maps: Vec<_> = photons.iter().map(|(label, map)| (*label, map)).collect();
        file::save(&cache.path, origin, &maps)?;
    }
    Ok(photons)
}

/// Returns the hash of the parameters, besides the scene, on which the photons depend.
fn dependence(preparation: &Preparation<'_>, settings: &PhotonmapperSettings) -> u64 {
    let PhotonmapperSettings { limits, global_photons, caustic_photons, debug, .. } = settings;
    let PathLimits { max_depth, rr_depth, hide_emitters: _ } = limits;
    let Preparation { sampler, seed, .. } = preparation;
    digest(&(max_depth, rr_depth, global_photons, caustic_photons, debug, sampler, seed))
}

/// Returns the number of photons of one replicate, given that of a half of the samples; at least one.
pub(super) fn share_of_half(photons: u64, replicates: u32) -> u64 {
    photons.div_ceil(u64::from(replicates / 2))
}

fn cast(
    preparation: &Preparation<'_>,
    settings: &PhotonmapperSettings,
    plan: &MapPlan,
    counters: &mut Counters,
) -> Vec<(MapLabel, PhotonMap)> {
    let Preparation { scene, sampler, seed, pool, interrupt, .. } = *preparation;
    let mut maps = Vec::new();
    for (light, paths, count) in [
        (MapKind::Global, plan.global, settings.global_photons),
        (MapKind::Caustic, plan.caustic, settings.caustic_photons),
    ] {
        let Some(paths) = paths.filter(|_| count > 0) else { continue };
        let plain = LightPathTracer { scene, sampler, guide: None, pool, interrupt, time: None };
        // Objects that cause caustics often subtend a small solid angle at the emitters, so emission is guided.
        let guide = match light {
            MapKind::Global => None,
            MapKind::Caustic => EmissionGuide::learn(&plain, &paths, EmissionGuide::PILOT, seed, |_| true),
        };
        let tracer = LightPathTracer { guide: guide.as_ref(), ..plain };
        let replicates = sampler.replicates();
        for replicate in 0..replicates {
            let sequence =
                PathSequence { seed, stream: STREAMS[light as usize], number: replicate, first: 0 };
            let kept = share_of_half(u64::from(count), replicates);
            let until = PathLimit { paths: u64::MAX, kept: Some(kept) };
            let cast = tracer.cast(&paths, sequence, until, |deposit, _| {
                Photon::new(deposit.p, deposit.shading_power(), deposit.wi, deposit.surface.ng)
            });
            counters.merge(&cast.counters);
            let map = pool.install(|| PhotonMap::new(cast.kept, cast.emitted));
            maps.push((MapLabel { light, replicate }, map));
        }
    }
    maps
}
