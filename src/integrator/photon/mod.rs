//! The photon map. [Jensen 1996; Jensen 2001]

pub mod map;
#[allow(clippy::module_inception)]
pub mod photon;

pub use map::PhotonMap;
pub use photon::Photon;
