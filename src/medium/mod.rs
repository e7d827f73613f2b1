//! Participating media: absorption and scattering in a volume.
//!
//! Directions of a phase function are directions of propagation: `d` is that of the incident light's path as a camera
//! ray follows it, `wi` the sampled one. Distances are world-space units, coefficients their inverse.

#[cfg(test)]
mod free_flight;
mod heterogeneous;
mod homogeneous;
pub mod lanes;
mod phase;
mod presets;
mod stream;
mod volume;

pub use heterogeneous::{Heterogeneous, Segment};
pub use homogeneous::Homogeneous;
pub use phase::{Phase, Tabulated};
pub use presets::{PRESETS, Preset};
pub use stream::Stream;
pub use volume::{Grid, Volume};

use crate::ids::MediumId;

/// A participating medium of the description.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub enum Medium {
    /// A medium with the same coefficients everywhere.
    Homogeneous(Homogeneous),
    /// A medium that cannot be rendered, with the reason. Integrators that ignore media accept it.
    Unsupported(String),
    /// A medium with coefficients that depend on the point.
    Heterogeneous(Box<Heterogeneous>),
}

impl Medium {
    /// Returns whether the medium scatters light in any channel.
    pub fn scatters(&self) -> bool {
        match self {
            Medium::Homogeneous(medium) => medium.scatters(),
            Medium::Heterogeneous(medium) => medium.scatters(),
            Medium::Unsupported(_) => false,
        }
    }

    /// Returns the phase function.
    #[inline]
    pub fn phase(&self) -> &Phase {
        match self {
            Medium::Homogeneous(medium) => &medium.phase,
            Medium::Heterogeneous(medium) => &medium.phase,
            Medium::Unsupported(_) => &Phase::Isotropic,
        }
    }
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

/// Returns the exponentials of three numbers, which are often the same.
pub fn exponentials([a, b, c]: [f64; 3]) -> [f64; 3] {
    let first = a.exp();
    [first, if b == a { first } else { b.exp() }, if c == a { first } else { c.exp() }]
}
