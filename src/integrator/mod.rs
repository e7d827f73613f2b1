//! Integrators: estimators of the incident radiance along a wave of rays.
//!
//! All integrators implement [`Integrator::li`], which takes a wave of rays and returns radiance. A wave may hold
//! camera rays, or rays with which one integrator queries another.

pub mod ao;
pub mod aov;
pub mod bdpt;
pub mod block;
pub mod depth;
pub mod direct;
pub mod distribution;
pub mod emission;
pub mod flight;
pub mod guiding;
pub mod interrupt;
pub mod irrcache;
mod light_path;
pub mod lighting;
pub mod path;
pub mod path_wave;
pub mod photon;
pub mod pilot;
pub mod preparation;
pub mod progressive;
pub mod pssmlt;
pub mod ptracer;
pub mod roulette;
pub mod settings;
pub mod shadows;
pub mod sppm;
mod tree;
pub mod vcm;
pub mod volpath;
pub mod when_pays;
pub mod whitted;
pub mod worker;

pub use ao::AmbientOcclusion;
pub use bdpt::Bdpt;
pub use depth::DepthIntegrator;
pub use direct::DirectIntegrator;
pub use distribution::DistributionIntegrator;
pub use interrupt::Interrupt;
pub use irrcache::IrradianceCache;
pub use path::PathIntegrator;
pub use photon::Photonmapper;
pub use preparation::{Preparation, Statistic};
pub use progressive::{PreparedPass, Progressive, SamplePass};
pub use pssmlt::Pssmlt;
pub use ptracer::{LightTracer, Ptracer, Splat};
pub use settings::{PathLimits, Plugin, Settings, Source};
pub use sppm::Sppm;
pub use vcm::Vcm;
pub use volpath::VolpathIntegrator;
pub use whitted::WhittedIntegrator;
pub use worker::{Counters, Worker};

use self::path::groups::CellSide;
use self::photon::CausticMaps;
use self::settings::Aov;
use crate::accel::{Coherence, Hit};
use crate::color::Rgb;
use crate::error::Result;
use crate::estimate::replicates::MAX_REPLICATES;
use crate::math::{LANES, Ray};
use crate::sampling::{SHARED_REPLICATES, SampleKey, SamplerKind};
use crate::scene::Scene;
use std::sync::Arc;

/// Up to sixteen rays of a wave, by their indices, whose paths may share what they find; [`NO_RAY`] fills the rest.
pub type Group = [u32; LANES];
/// The index in a [`Group`] that stands for no ray.
pub const NO_RAY: u32 = u32::MAX;

/// A wave of rays, each with the key of its sample.
#[derive(Clone, Copy, Debug)]
pub struct Wave<'a> {
    /// The rays.
    pub rays: &'a [Ray],
    /// One key for each ray. The key determines every random number of the path that the ray starts.
    pub keys: &'a [SampleKey],
    /// The coherence of neighbouring rays.
    pub coherence: Coherence,
    /// Groups of rays of the same sample index. Without groups, no path shares anything; else, each ray is in one.
    pub groups: &'a [Group],
}

/// A selection of light by the number of edges between the ray's origin and the emitter.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RadianceQuery {
    /// Light emitted by the first surface that the ray hits: one edge.
    pub emitted: bool,
    /// Light scattered once: two edges.
    pub direct: bool,
    /// Light scattered more than once.
    pub indirect: bool,
    /// Light that reaches the ray's origin from the emitter through one or more specular lobes only. It then counts
    /// as neither direct nor indirect. Integrators that cannot separate it treat it as other light.
    pub caustic: bool,
}

impl RadianceQuery {
    /// All light.
    pub const ALL: RadianceQuery =
        RadianceQuery { emitted: true, direct: true, indirect: true, caustic: true };

    /// Returns whether the query includes light from paths with the given number of edges.
    #[inline]
    pub fn wants(&self, edges: u32) -> bool {
        match edges {
            0 | 1 => self.emitted,
            2 => self.direct,
            _ => self.indirect,
        }
    }

    /// Returns whether caustics must be separated from other light.
    pub fn separates_caustics(&self) -> bool {
        self.caustic != self.direct || self.caustic != self.indirect
    }
}

/// The incident radiance along a ray.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Radiance {
    /// Radiance, W·m⁻²·sr⁻¹.
    pub value: Rgb,
    /// Ray parameter of the first surface; infinite if the ray hits nothing.
    pub distance: f32,
}

impl Radiance {
    /// No radiance and no surface.
    pub const NONE: Radiance = Radiance { value: Rgb::BLACK, distance: f32::INFINITY };
}

/// An estimator of radiance.
pub trait Integrator: Send + Sync {
    /// Returns the integrator's name in the scene language.
    fn name(&self) -> &'static str;

    /// Returns whether rays that hit nothing show the environment with alpha 1.
    fn shows_environment(&self) -> bool {
        false
    }

    /// Returns whether the image shows the emitters that camera rays hit, and the mean of several paths may be a sample
    /// of a pixel.
    fn shows_emitters(&self) -> bool {
        false
    }

    /// Returns whether the errors of different pixels are correlated, because pixels share photons, caches or light
    /// paths.
    fn shares_noise(&self) -> bool {
        false
    }

    /// Returns the side of the cells in which pixels reuse each other's paths, after the preparation; `None` if the
    /// paths of all pixels are independent. Waves of camera rays have groups if there are cells.
    fn reuse_cells(&self) -> Option<CellSide> {
        None
    }

    /// Returns the greatest number of paths that begin with the same camera ray, after the preparation.
    fn paths_per_ray(&self) -> u32 {
        1
    }

    /// Returns whether noisier cells of the image get more samples if the user does not choose.
    fn adapts(&self) -> bool {
        false
    }

    /// Rejects scenes that the integrator cannot render correctly, before any work is done.
    ///
    /// # Errors
    /// If the scene is rejected; the message gives the reason.
    fn check(&self, _scene: &Scene) -> Result<()> {
        Ok(())
    }

    /// Computes everything that does not depend on the camera's samples: caches and maps. It is called once, before
    /// the first wave.
    ///
    /// # Errors
    /// If a file cannot be read or written, or if the preparation for this scene is impossible.
    fn prepare(&mut self, _preparation: &Preparation<'_>) -> Result<()> {
        Ok(())
    }

    /// Returns whether [`prepare`](Self::prepare) does anything.
    fn prepares(&self) -> bool {
        self.supports_cache_file()
    }

    /// Returns whether the result of [`prepare`](Self::prepare) can be stored in a file.
    fn supports_cache_file(&self) -> bool {
        false
    }

    /// Returns the value of an image layer at the hit of a camera ray with the given sample key.
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

    /// Returns statistics of the preparation.
    fn statistics(&self) -> Vec<Statistic> {
        Vec::new()
    }

    /// Returns the caustic maps, if the preparation computed them.
    fn caustics(&self) -> Option<Arc<CausticMaps>> {
        None
    }

    /// Returns the light tracer that runs in addition, if any.
    fn light_tracer(&self) -> Option<&dyn LightTracer> {
        None
    }

    /// Returns whether light paths contribute to the film, so that an image without some of them is too dark.
    fn traces_light_paths(&self) -> bool {
        self.light_tracer().is_some()
    }

    /// Returns the computation required before each sample of the pixels, if any.
    fn progressive(&self) -> Option<&dyn Progressive> {
        None
    }

    /// Estimates the radiance along each ray of `wave`. `out` has one entry for each ray.
    fn li(
        &self,
        scene: &Scene,
        wave: Wave<'_>,
        query: RadianceQuery,
        worker: &mut Worker,
        out: &mut [Radiance],
    );
}

/// Returns the number of replicates among which the samples of a render are divided. Two estimate the error of pixels
/// that are independent, or correlated in groups; eight also estimate the error that pixels share.
pub fn replicates(integrator: &dyn Integrator, sampler: SamplerKind) -> u32 {
    const { assert!(SHARED_REPLICATES as usize <= MAX_REPLICATES) };
    if integrator.shares_noise() || sampler.shares_noise() { SHARED_REPLICATES } else { 2 }
}
