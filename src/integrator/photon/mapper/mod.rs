//! The integrator `photonmapper`. [Jensen 1996; Jensen 2001; Christensen 1999]
//!
//! Before the render, light paths deposit photons on surfaces. The global map has all of them, the caustic map those
//! scattered by Dirac deltas only. The irradiance is computed at every fourth photon of the global map.
//!
//! A camera path continues through mirrors, glass and glossy lobes to the first surface with a diffuse lobe. Direct
//! light there is sampled, and caustics are density estimates of the caustic map. All other light is gathered by rays
//! over the hemisphere. A gather ray ends at a surface with a diffuse lobe, where it takes the irradiance of the
//! nearest precomputed point. At other surfaces it continues. It also continues as a path where the distance to the
//! surface is less than the radius of the point's disc, which avoids blotches in corners, and where the point is not
//! visible, because light does not pass through walls.
//!
//! The result is biased. The light found by gather rays is blurred over the discs of the global map. `max_depth` is
//! counted from there, so paths through mirrors may be longer by the mirrored edges. Caustics are blurred over the
//! discs of the caustic map. More photons reduce the blur. For coated surfaces found by gather rays, the directions
//! of incident light are assumed to be uniform.
//!
//! Each replicate of the image's samples has its own maps, so the differences between replicates include the maps'
//! noise, also where pixels share it. They do not include the maps' blur, which is the same in all replicates.

mod caustics;
mod debug;
mod maps;
mod paths;

use super::{DensityEstimator, Kernel, LookupPoint};
use crate::error::Result;
use crate::integrator::block::ShadingBlock;
use crate::integrator::preparation::reject_motion;
use crate::integrator::settings::{MAX_PHOTONS, MAX_SAMPLES, PathLimits, Plugin, Read, Source};
use crate::integrator::{Integrator, Preparation, Radiance, RadianceQuery, Statistic, Wave, Worker};
use crate::scene::Scene;
use maps::Maps;
use std::sync::Arc;

pub use caustics::CausticMaps;

/// Photon maps and final gathering. [Jensen 2001]
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct PhotonmapperSettings {
    /// The paths from the camera and from emitters.
    pub limits: PathLimits,
    /// Emitter samples at the first surface that is not specular, at least 1.
    pub direct_samples: u32,
    /// BSDF samples at that surface if all its lobes are glossy, at least 1.
    pub glossy_samples: u32,
    /// BSDF samples at that surface if it has a diffuse lobe, at least 1: the final gather.
    pub gather_samples: u32,
    /// Number of photons in each global map.
    pub global_photons: u32,
    /// Number of photons in each caustic map.
    pub caustic_photons: u32,
    /// Maximum lookup radius in the global map, relative to the radius of the scene; positive.
    pub global_lookup_radius: f32,
    /// Maximum lookup radius in the caustic map, relative to the radius of the scene; positive.
    pub caustic_lookup_radius: f32,
    /// Number of photons in a lookup, at least 2.
    pub lookup_size: u32,
    /// The kernel that weights photons by their distance.
    pub kernel: Kernel,
    /// The debug image to show instead of the rendered image.
    pub debug: PhotonDebug,
}

/// The output of a photon mapper.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub enum PhotonDebug {
    /// The rendered image.
    #[default]
    None,
    /// The photons of the global map as coloured points.
    Photons,
    /// The radiance estimate of the global map at the first surface, without direct sampling or final gathering.
    Radiance,
}

impl Default for PhotonmapperSettings {
    fn default() -> Self {
        PhotonmapperSettings {
            limits: PathLimits::default(),
            direct_samples: 1,
            glossy_samples: 1,
            gather_samples: 4,
            global_photons: 250_000,
            caustic_photons: 500_000,
            global_lookup_radius: 0.05,
            caustic_lookup_radius: 0.0125,
            lookup_size: 120,
            kernel: Kernel::Epanechnikov,
            debug: PhotonDebug::None,
        }
    }
}

/// Final gathering with photon maps.
pub struct Photonmapper {
    settings: PhotonmapperSettings,
    /// The maps of each replicate of the samples; the number is a power of two.
    maps: Vec<Maps>,
    caustics: Arc<CausticMaps>,
    global: DensityEstimator,
    statistics: Vec<Statistic>,
}

impl Photonmapper {
    /// Creates the integrator without photons.
    pub fn new(settings: PhotonmapperSettings) -> Self {
        let [caustics, global] = estimators(&settings, 1.0, 2);
        let caustics = Arc::new(CausticMaps::new(caustics, vec![None]));
        Photonmapper { settings, maps: vec![Maps::default()], caustics, global, statistics: Vec::new() }
    }
}

/// Returns the density estimators of the caustic map and of the global map in a scene of the given radius. The maps
/// of a half of the samples share its number of photons and lookup size, so the radius of the discs does not depend
/// on the number of replicates.
fn estimators(settings: &PhotonmapperSettings, scale: f32, replicates: u32) -> [DensityEstimator; 2] {
    let lookup_size = maps::share_of_half(u64::from(settings.lookup_size), replicates).max(2) as usize;
    [settings.caustic_lookup_radius, settings.global_lookup_radius].map(|radius| DensityEstimator {
        kernel: settings.kernel,
        lookup_size,
        lookup_radius: radius * scale,
    })
}

/// Returns the lookup point of a lane, on the side of the ray's origin.
fn lookup_point(block: &ShadingBlock<'_>, i: usize) -> LookupPoint {
    let (n, d) = (block.at.ng.lane(i), block.rays.d.lane(i));
    LookupPoint { p: block.at.p.lane(i), n: if n.dot(d) > 0.0 { -n } else { n } }
}

impl Plugin for Photonmapper {
    const NAME: &'static str = "photonmapper";
    type Settings = PhotonmapperSettings;

    fn read(source: &mut dyn Source) -> Result<PhotonmapperSettings> {
        source.ignore(&["granularity"], "the render job decides");
        source.ignore(&["volume_photons", "volume_lookup_radius"], "there are no media");
        let default = PhotonmapperSettings::default();
        let kernels = Kernel::ALL.map(|kernel| (kernel.name(), kernel));
        let debug_images = [
            ("none", PhotonDebug::None),
            ("photons", PhotonDebug::Photons),
            ("radiance", PhotonDebug::Radiance),
        ];
        Ok(PhotonmapperSettings {
            limits: PathLimits::read(source)?,
            direct_samples: source.count("direct_samples", 1..=MAX_SAMPLES, default.direct_samples)?,
            glossy_samples: source.count("glossy_samples", 1..=MAX_SAMPLES, default.glossy_samples)?,
            gather_samples: source.count("gather_samples", 1..=MAX_SAMPLES, default.gather_samples)?,
            global_photons: source.count("global_photons", 0..=MAX_PHOTONS, default.global_photons)?,
            caustic_photons: source.count("caustic_photons", 0..=MAX_PHOTONS, default.caustic_photons)?,
            global_lookup_radius: radius(source, "global_lookup_radius", default.global_lookup_radius)?,
            caustic_lookup_radius: radius(source, "caustic_lookup_radius", default.caustic_lookup_radius)?,
            lookup_size: source.count("lookup_size", 2..=MAX_SAMPLES, default.lookup_size)?,
            kernel: source.choice("kernel", &kernels, default.kernel)?,
            debug: source.choice("debug", &debug_images, default.debug)?,
        })
    }

    fn with_limits(limits: PathLimits) -> PhotonmapperSettings {
        PhotonmapperSettings { limits, ..PhotonmapperSettings::default() }
    }

    fn limits(settings: &PhotonmapperSettings) -> PathLimits {
        settings.limits
    }

    fn create(settings: &PhotonmapperSettings) -> Box<dyn Integrator> {
        Box::new(Photonmapper::new(*settings))
    }
}

/// Reads a lookup radius.
fn radius(source: &mut dyn Source, name: &'static str, default: f32) -> Result<f32> {
    match source.positive(name, default)? {
        radius if (1e-6..=1e6).contains(&radius) => Ok(radius),
        _ => Err(source.refusal(name, "expected a part of the scene's radius, from 1e-6 to 1e6")),
    }
}

impl Integrator for Photonmapper {
    fn name(&self) -> &'static str {
        "photonmapper"
    }

    fn shares_noise(&self) -> bool {
        true
    }

    fn shows_environment(&self) -> bool {
        !self.settings.limits.hide_emitters
    }

    fn check(&self, scene: &Scene) -> Result<()> {
        reject_motion("photonmapper", "photons", scene)
    }

    fn prepare(&mut self, preparation: &Preparation<'_>) -> Result<()> {
        self.check(preparation.scene)?;
        let replicates = preparation.sampler.replicates();
        let [caustics, global] = estimators(&self.settings, preparation.scene.bounds.radius(), replicates);
        let prepared = maps::prepare(preparation, &self.settings, &global)?;
        self.caustics = Arc::new(CausticMaps::new(caustics, prepared.caustic));
        (self.global, self.maps, self.statistics) = (global, prepared.maps, prepared.statistics);
        Ok(())
    }

    fn statistics(&self) -> Vec<Statistic> {
        self.statistics.clone()
    }

    fn supports_cache_file(&self) -> bool {
        true
    }

    fn caustics(&self) -> Option<Arc<CausticMaps>> {
        (!self.caustics.is_empty()).then(|| Arc::clone(&self.caustics))
    }

    fn li(
        &self,
        scene: &Scene,
        wave: Wave<'_>,
        query: RadianceQuery,
        worker: &mut Worker,
        out: &mut [Radiance],
    ) {
        match self.settings.debug {
            PhotonDebug::None => paths::li(self, scene, wave, query, worker, out),
            show => debug::li(self, scene, show, wave, worker, out),
        }
    }
}
