//! Participating media: absorption and scattering in a volume.
//!
//! Directions of a phase function are directions of propagation: `d` is that of the incident light's path as a camera
//! ray follows it, `wi` the sampled one. Distances are world-space units, coefficients their inverse.

mod free_flight;
mod homogeneous;
mod phase;
mod presets;

pub use free_flight::FreeFlight;
pub use homogeneous::Homogeneous;
pub use phase::{Phase, Tabulated};
pub use presets::{PRESETS, Preset};

use crate::ids::MediumId;

/// A participating medium of the description.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub enum Medium {
    /// A medium with the same coefficients everywhere.
    Homogeneous(Homogeneous),
    /// A medium that cannot be rendered, with the reason. Integrators that ignore media accept it.
    Unsupported(String),
}

/// The media on the two sides of a surface; `None` is vacuum.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct MediumBoundary {
    /// The medium on the geometric back side.
    pub interior: Option<MediumId>,
    /// The medium on the geometric front side.
    pub exterior: Option<MediumId>,
}

impl MediumBoundary {
    /// Returns whether the surface bounds no medium. A ray that passes it stays in its medium.
    pub fn is_none(&self) -> bool {
        self.interior.is_none() && self.exterior.is_none()
    }
}
