//! Casting photons into maps, or reading them from a file.

use crate::bsdf::Split;
use crate::error::{Error, Result};
use crate::integrator::photon::boundary::Boundary;
use crate::integrator::photon::file::{self, Label, Light, Origin};
use crate::integrator::photon::{
    Caster, DensityEstimator, EmissionGuide, IrradianceMap, PathSequence, Photon, PhotonMap, PhotonPaths,
    Until,
};

use crate::integrator::settings::{PhotonDebug, PhotonmapperSettings};
use crate::integrator::{Counters, Fact, Preparation};
use crate::math::Vec3;
use crate::memory::Reservation;
use crate::scene::Scene;
use crate::util::digest;
use bumpalo::Bump;

/// One of so many photons gets its irradiance computed. [Christensen 1999]
const IRRADIANCE_EVERY: usize = 4;
/// The streams of the light paths' numbers, by what is cast.
const STREAMS: [u32; 2] = [0, 2];

/// What a replicate of the samples knows of light. What the scene does not need is not there.
#[derive(Default)]
pub struct Maps {
    /// Irradiance by all light.
    pub irradiance: Option<IrradianceMap>,
    /// All photons, where they are to be shown.
    pub global: Option<PhotonMap>,
    /// The width of what points show photons as, scene units.
    pub point: f32,
    /// Of the maps of all replicates, in the first.
    reserved: Option<Reservation>,
}

/// What there is to render with.
pub struct Prepared {
    /// Of each replicate.
    pub maps: Vec<Maps>,
    /// Light that Dirac deltas alone have brought, of each replicate.
    pub caustic: Vec<Option<PhotonMap>>,
    /// What there is to say of them.
    pub facts: Vec<Fact>,
}

/// Which maps a scene needs.
struct Plan {
    global: Option<PhotonPaths>,
    caustic: Option<PhotonPaths>,
}

impl Plan {
    fn new(scene: &Scene, settings: &PhotonmapperSettings) -> Self {
        let allows = |edges: u32| settings.max_depth.is_none_or(|max| max >= edges);
        let photons = |before: u32, direct: bool| PhotonPaths {
            max_edges: settings.max_depth.map(|max| max - before),
            rr_depth: settings.rr_depth,
            direct,
            indirect: direct,
        };
        let show = settings.debug != PhotonDebug::None;
        let (lit, depth) = (!scene.lights.is_empty(), allows(3));
        Plan {
            // The edges to the gathering surface and of its ray are the camera's; where photons are shown, the first is.
            global: (lit && depth && has_diffuse_parts(scene))
                .then(|| photons(if show { 1 } else { 2 }, true)),
            caustic: (lit && depth && !show && (scene.needs.deltas > 0) && scene.needs.finite_lobes)
                .then(|| photons(1, false)),
        }
    }
}

/// Whether some surface may have a diffuse part. Those that are not the same everywhere may.
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

/// The maps of all replicates.
pub fn prepare(
    preparation: &Preparation<'_>,
    settings: &PhotonmapperSettings,
    estimator: &DensityEstimator,
) -> Result<Prepared> {
    let scene = preparation.scene;
    let plan = Plan::new(scene, settings);
    let mut reserved = reserve(preparation, settings, &plan)?;
    let mut counters = Counters::default();
    let photons = load_or_cast(preparation, settings, &plan, &mut counters)?;
    let replicates = preparation.sampler.replicates() as usize;
    let mut maps: Vec<Maps> = (0..replicates).map(|_| Maps::default()).collect();
    let mut caustic: Vec<Option<PhotonMap>> = (0..replicates).map(|_| None).collect();
    let mut global: Vec<Option<PhotonMap>> = (0..replicates).map(|_| None).collect();
    let mut sums = Sums::default();
    for (label, map) in photons {
        let replicate = label.replicate as usize % replicates;
        sums.add(label, &map);
        match label.light {
            Light::Caustic => caustic[replicate] = Some(map),
            Light::Global if settings.debug != PhotonDebug::None => maps[replicate].global = Some(map),
            Light::Global => global[replicate] = Some(map),
        }
    }
    for (replicate, map) in global.iter().enumerate() {
        let Some(map) = map else { continue };
        // The places of the next replicate's photons do not know how this one's are spread by chance.
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
    Ok(Prepared { maps, caustic, facts: sums.facts(&counters) })
}

/// Bytes of a photon in a finished map.
const KEPT: u64 = PhotonMap::BYTES_PER_PHOTON as u64 + 1;
/// Bytes of a photon while its map is built: the list that it was cast into, which grows by doubling, and what the tree is
/// sorted in.
const BUILDING: u64 = 70;
/// As [`KEPT`], of its share of an irradiance map.
const IRRADIANCE_KEPT: u64 = 12;
/// As [`BUILDING`], of its share of an irradiance map.
const IRRADIANCE_BUILDING: u64 = 25;

/// Reserves what the maps take while they are built.
fn reserve(
    preparation: &Preparation<'_>,
    settings: &PhotonmapperSettings,
    plan: &Plan,
) -> Result<Reservation> {
    let count = |paths: &Option<PhotonPaths>, photons: u32| paths.as_ref().map_or(0, |_| u64::from(photons));
    let (global, caustic) =
        (count(&plan.global, settings.global_photons), count(&plan.caustic, settings.caustic_photons));
    let irradiance = global * (2 * IRRADIANCE_KEPT + IRRADIANCE_BUILDING);
    // Irradiance is computed when all photons have been cast. Maps are built one after the other.
    let one = BUILDING * global.max(caustic) / u64::from(preparation.sampler.replicates() / 2);
    let cast = 2 * KEPT * (global + caustic) + one.max(irradiance);
    // A file may hold anything until it has been read.
    let file = preparation.cache.as_ref().and_then(|cache| std::fs::metadata(&cache.path).ok());
    let photons = file.map_or(0, |about| about.len() / Photon::BYTES as u64);
    let needed = cast.max(photons.saturating_mul(KEPT + BUILDING));
    preparation.memory.reserve(needed).map_err(|refusal| {
        let what =
            format!("maps of {global} global and {caustic} caustic photons for either half of the samples");
        Error::scene(refusal.sentence(&what, "ask for fewer photons")).about("photonmapper")
    })
}

/// Of the scene's radius: how large photons are shown as points.
const POINT: f32 = 2e-3;

/// What the facts say, of all replicates together.
#[derive(Default)]
struct Sums {
    photons: [f64; 2],
    emitted: [f64; 2],
    points: f64,
    bytes: f64,
}

impl Sums {
    fn add(&mut self, label: Label, map: &PhotonMap) {
        self.photons[label.light as usize] += map.len() as f64;
        self.emitted[label.light as usize] += map.emitted() as f64;
        self.bytes += map.memory_bytes() as f64;
    }

    fn facts(&self, counters: &Counters) -> Vec<Fact> {
        [
            ("global_photons", self.photons[0]),
            ("global_light_paths", self.emitted[0]),
            ("irradiance_points", self.points),
            ("caustic_photons", self.photons[1]),
            ("caustic_light_paths", self.emitted[1]),
            ("photon_map_bytes", self.bytes),
            ("preparation_rays", counters.closest_rays as f64),
        ]
        .map(|(name, value)| Fact { name, value })
        .to_vec()
    }
}

fn load_or_cast(
    preparation: &Preparation<'_>,
    settings: &PhotonmapperSettings,
    plan: &Plan,
    counters: &mut Counters,
) -> Result<Vec<(Label, PhotonMap)>> {
    let Some(cache) = &preparation.cache else {
        return Ok(cast(preparation, settings, plan, counters));
    };
    let origin = Origin { scene: cache.scene, settings: dependence(preparation, settings) };
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

/// Hash of what the photons depend on besides the scene.
fn dependence(preparation: &Preparation<'_>, settings: &PhotonmapperSettings) -> u64 {
    let PhotonmapperSettings { max_depth, rr_depth, global_photons, caustic_photons, debug, .. } = settings;
    let Preparation { sampler, seed, .. } = preparation;
    digest(&(max_depth, rr_depth, global_photons, caustic_photons, debug, sampler, seed))
}

/// What a replicate has of the photons of a half of the samples; at least one.
pub(super) fn share_of_half(photons: u64, replicates: u32) -> u64 {
    photons.div_ceil(u64::from(replicates / 2))
}

fn cast(
    preparation: &Preparation<'_>,
    settings: &PhotonmapperSettings,
    plan: &Plan,
    counters: &mut Counters,
) -> Vec<(Label, PhotonMap)> {
    let Preparation { scene, sampler, seed, pool, interrupt, .. } = *preparation;
    let mut maps = Vec::new();
    for (light, paths, count) in [
        (Light::Global, plan.global, settings.global_photons),
        (Light::Caustic, plan.caustic, settings.caustic_photons),
    ] {
        let Some(paths) = paths.filter(|_| count > 0) else { continue };
        let plain = Caster { scene, sampler, guide: None, pool, interrupt, time: None };
        // What makes caustics is often small, as seen from the emitters.
        let guide = match light {
            Light::Global => None,
            Light::Caustic => EmissionGuide::learn(&plain, &paths, seed, |_| true),
        };
        let caster = Caster { guide: guide.as_ref(), ..plain };
        let replicates = sampler.replicates();
        for replicate in 0..replicates {
            let sequence =
                PathSequence { seed, stream: STREAMS[light as usize], number: replicate, first: 0 };
            let kept = share_of_half(u64::from(count), replicates);
            let until = Until { paths: u64::MAX, kept: Some(kept) };
            let cast = caster.cast(&paths, sequence, until, |deposit, _| {
                Photon::new(deposit.p, deposit.shading_power(), deposit.wi, deposit.ng)
            });
            counters.merge(&cast.counters);
            let map = pool.install(|| PhotonMap::new(cast.kept, cast.emitted));
            maps.push((Label { light, replicate }, map));
        }
    }
    maps
}
