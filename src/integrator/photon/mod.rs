//! The photon map. [Jensen 1996; Jensen 2001]

pub mod cast;
pub mod grid;
pub mod guide;
pub mod map;
#[allow(clippy::module_inception)]
pub mod photon;
pub mod tracing;

pub use cast::{Cast, Caster, PathSequence, Until};
pub use grid::{GridPhoton, PhotonGrid};
pub use guide::EmissionGuide;
pub use map::PhotonMap;
pub use photon::Photon;
pub use tracing::{Deposit, PhotonPaths};
