//! Integrators: estimators of the radiance that arrives along a wave of rays.
//!
//! The one seam is [`Integrator::li`]: a wave of rays in, radiance out. The camera's samples are a wave, and so
//! are the rays with which one integrator asks another.

pub mod aov;
pub mod block;
pub mod depth;
pub mod direct;
pub mod distribution;
pub mod emission;
pub mod interrupt;
pub mod irrcache;
mod light_path;
pub mod lighting;
pub mod path;
pub mod photon;
pub mod preparation;
pub mod progressive;
pub mod ptracer;
pub mod roulette;
pub mod settings;
pub mod sppm;
mod tree;
pub mod whitted;
pub mod worker;

pub use depth::DepthIntegrator;
pub use direct::DirectIntegrator;
pub use distribution::DistributionIntegrator;
pub use interrupt::Interrupt;
pub use irrcache::IrradianceCache;
pub use path::PathIntegrator;
pub use photon::Photonmapper;
pub use preparation::{Fact, Preparation};
pub use progressive::{Begun, Progressive, SamplePass};
pub use ptracer::{Ptracer, Splat};
pub use settings::Settings;
pub use sppm::Sppm;
pub use whitted::WhittedIntegrator;
pub use worker::{Counters, Worker};

use self::photon::CausticMaps;
use self::settings::Aov;
use crate::accel::{Coherence, Hit};
use crate::color::Rgb;
use crate::error::Result;
use crate::estimate::replicates::MOST_REPLICATES;
use crate::math::Ray;
use crate::sampling::{SHARED_REPLICATES, SampleKey, SamplerKind};
use crate::scene::Scene;
use std::sync::Arc;

/// A wave of rays, each with the key of the sample that it belongs to.
#[derive(Clone, Copy, Debug)]
pub struct Wave<'a> {
    /// The rays.
    pub rays: &'a [Ray],
    /// As many keys: they decide every random number of the path that a ray begins.
    pub keys: &'a [SampleKey],
    /// What is known about neighbouring rays.
    pub coherence: Coherence,
}

/// Which light is wanted, by the number of edges between the ray's origin and the emitter.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RadianceQuery {
    /// Light emitted by what the ray meets first: one edge.
    pub emitted: bool,
    /// Light scattered once: two edges.
    pub direct: bool,
    /// Light scattered more than once.
    pub indirect: bool,
    /// Light that comes from the emitter to the ray's origin by specular lobes only, one or more: it is neither direct
    /// nor indirect here. Integrators that cannot tell it from the rest take it as they take the rest.
    pub caustic: bool,
}

impl RadianceQuery {
    /// All light.
    pub const ALL: RadianceQuery =
        RadianceQuery { emitted: true, direct: true, indirect: true, caustic: true };

    /// Whether light of a path with that many edges is wanted.
    #[inline]
    pub fn wants(&self, edges: u32) -> bool {
        match edges {
            0 | 1 => self.emitted,
            2 => self.direct,
            _ => self.indirect,
        }
    }

    /// Whether caustics have to be told from other light.
    pub fn separates_caustics(&self) -> bool {
        self.caustic != self.direct || self.caustic != self.indirect
    }
}

/// What arrives along a ray.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Radiance {
    /// Radiance, W·m⁻²·sr⁻¹.
    pub value: Rgb,
    /// Ray parameter of the first surface, infinite where the ray met nothing.
    pub distance: f32,
}

impl Radiance {
    /// Nothing, from nowhere.
    pub const NONE: Radiance = Radiance { value: Rgb::BLACK, distance: f32::INFINITY };
}

/// An estimator of radiance.
pub trait Integrator: Send + Sync {
    /// Its name in the scene language.
    fn name(&self) -> &'static str;

    /// Whether rays that meet nothing show the environment; its alpha is 1 then.
    fn shows_environment(&self) -> bool {
        false
    }

    /// Whether errors of different pixels have causes in common: photons, caches, light paths.
    fn shares_noise(&self) -> bool {
        false
    }

    /// Refuses scenes that it cannot render rightly, before any work is done.
    ///
    /// # Errors
    /// With a sentence that says why.
    fn check(&self, _scene: &Scene) -> Result<()> {
        Ok(())
    }

    /// Computes what does not depend on the camera's samples: caches, maps. Once, before the first wave.
    ///
    /// # Errors
    /// If a file that it is to read or write cannot be, or if the scene cannot be prepared for.
    fn prepare(&mut self, _preparation: &Preparation<'_>) -> Result<()> {
        Ok(())
    }

    /// Whether there is anything that it prepares.
    fn prepares(&self) -> bool {
        self.keeps_caches()
    }

    /// Whether what it prepares can be kept in a file.
    fn keeps_caches(&self) -> bool {
        false
    }

    /// The value of an image layer at the hit of a camera ray, which belongs to a sample of the given key.
    fn layer(
        &self,
        layer: Aov,
        scene: &Scene,
        ray: &Ray,
        key: SampleKey,
        hit: Option<&Hit>,
        out: &mut [f32],
    ) {
        let _ = key;
        layer.evaluate(scene, ray, hit, out);
    }

    /// What there is to say about what was prepared.
    fn facts(&self) -> Vec<Fact> {
        Vec::new()
    }

    /// The caustics that are known at every surface since it was prepared, if there are any.
    fn caustics(&self) -> Option<Arc<CausticMaps>> {
        None
    }

    /// What traces light paths besides, if anything does.
    fn light_tracer(&self) -> Option<&Ptracer> {
        None
    }

    /// What has to be computed before every sample of the pixels, if anything has.
    fn progressive(&self) -> Option<&dyn Progressive> {
        None
    }

    /// Estimates the radiance along each ray of `wave` into `out`, which has as many entries.
    fn li(
        &self,
        scene: &Scene,
        wave: Wave<'_>,
        query: RadianceQuery,
        worker: &mut Worker,
        out: &mut [Radiance],
    );
}

/// How many replicates the samples of a render are divided among: two tell how large the errors of pixels are, where
/// these are independent; eight tell also what pixels share.
pub fn replicates(integrator: &dyn Integrator, sampler: SamplerKind) -> u32 {
    const { assert!(SHARED_REPLICATES as usize <= MOST_REPLICATES) };
    if integrator.shares_noise() || sampler.shares_noise() { SHARED_REPLICATES } else { 2 }
}

/// The integrator that the settings describe; the layers of `aov` are the render job's business.
pub fn create(settings: &Settings) -> Box<dyn Integrator> {
    match settings {
        Settings::Path(path) => Box::new(PathIntegrator::new(*path)),
        Settings::Direct(direct) => Box::new(DirectIntegrator::new(*direct)),
        Settings::Whitted(whitted) => Box::new(WhittedIntegrator::new(*whitted)),
        Settings::Distribution(distribution) => Box::new(DistributionIntegrator::new(*distribution)),
        Settings::Depth => Box::new(DepthIntegrator),
        Settings::Ptracer(ptracer) => Box::new(Ptracer::new(*ptracer)),
        Settings::Irrcache(irrcache) => Box::new(IrradianceCache::new(irrcache)),
        Settings::Photonmapper(mapper) => Box::new(Photonmapper::new(*mapper)),
        Settings::Sppm(sppm) => Box::new(Sppm::new(*sppm)),
        Settings::Aov { image: Some(image), .. } => create(image),
        Settings::Aov { image: None, .. } => Box::new(aov::NoImage),
    }
}
