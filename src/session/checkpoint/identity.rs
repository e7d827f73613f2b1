//! The identity of a render, which determines whether samples can be added.

use crate::integrator::settings::WhenPays;
use crate::session::{Plan, SceneHashes, Session};
use crate::util::digest;
use serde::{Deserialize, Serialize};

/// Everything that determines the samples of a render. The samples of two renders can be added only if it is equal.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Identity {
    /// Buffon's version, because random numbers may differ between versions.
    pub version: String,
    /// Hash of the scene without its sensors.
    pub scene: u64,
    /// Hash of the sensor with its film: view, size, filter; not the crop.
    pub view: u64,
    /// The name of the integrator.
    pub integrator: String,
    /// Hash of the integrator's settings.
    pub settings: u64,
    /// The name of the sampler.
    pub sampler: String,
    /// Hash of the sampler's parameters, some of which depend on the number of samples.
    pub sampling: u64,
    /// The ray accelerator, because rounding differs between accelerators.
    pub accel: String,
    /// The seed.
    pub seed: u64,
    /// The names of the layers.
    pub layers: Vec<String>,
    /// Whether noisier cells get more samples.
    pub adaptive: WhenPays,
}

impl Identity {
    /// Returns the identity of a plan for a session's scene.
    pub fn of(session: &Session, plan: &Plan, origin: SceneHashes) -> Self {
        let job = &plan.job;
        Identity {
            version: env!("CARGO_PKG_VERSION").into(),
            scene: origin.scene,
            view: origin.view,
            integrator: plan.integrator.name().into(),
            settings: digest(&plan.integrator),
            sampler: job.sampler.kind().name().into(),
            sampling: digest(&job.sampler),
            accel: session.scene.accel.name().into(),
            seed: job.seed,
            layers: job.layers.iter().map(|layer| layer.name.clone()).collect(),
            adaptive: plan.adaptive,
        }
    }

    /// Describes the difference to another identity from the point of view of this one, such as "samples of another
    /// scene".
    pub fn difference(&self, other: &Identity) -> Option<String> {
        let names = |layers: &[String]| if layers.is_empty() { "none".into() } else { layers.join(", ") };
        Some(if self.version != other.version {
            format!("samples of Buffon {}, expected {}", self.version, other.version)
        } else if self.scene != other.scene {
            "samples of another scene".into()
        } else if self.view != other.view {
            "samples of another view of the scene (sensor, size or film)".into()
        } else if self.integrator != other.integrator {
            format!("samples of the integrator {}, expected {}", self.integrator, other.integrator)
        } else if self.settings != other.settings {
            format!("samples of other settings of the integrator {}", self.integrator)
        } else if self.sampler != other.sampler {
            format!("samples of the sampler {}, expected {}", self.sampler, other.sampler)
        } else if self.sampling != other.sampling {
            format!("samples of the sampler {} for another number of samples per pixel", self.sampler)
        } else if self.accel != other.accel {
            format!("samples of the traversal {}, expected {}", self.accel, other.accel)
        } else if self.seed != other.seed {
            format!("samples of seed {}, expected {}", self.seed, other.seed)
        } else if self.layers != other.layers {
            format!("the layers {}, expected {}", names(&self.layers), names(&other.layers))
        } else if self.adaptive != other.adaptive {
            "samples with another distribution over the pixels (--adaptive)".into()
        } else {
            return None;
        })
    }
}
