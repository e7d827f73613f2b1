//! The photon map. [Jensen 1996; Jensen 2001]

pub mod boundary;
pub mod cast;
pub mod density;
#[cfg(test)]
mod density_tests;
pub mod file;
pub mod grid;
pub mod guide;
pub mod irradiance;
pub mod kdtree;
pub mod kernel;
pub mod map;
pub mod mapper;
#[allow(clippy::module_inception)]
pub mod photon;
pub mod radius;
pub mod tracing;
pub mod visible_surfaces;

pub use cast::{LightPathTracer, PathLimit, PathSequence, TracedPaths};
pub use density::{DensityEstimator, Irradiance, LookupPoint, Sides};
pub use grid::{GridPhoton, PhotonGrid, PhotonSurface, Positioned};
pub use guide::EmissionGuide;
pub use irradiance::IrradianceMap;
pub use kernel::Kernel;
pub use map::PhotonMap;
pub use mapper::{CausticMaps, Photonmapper};
pub use photon::Photon;
pub use tracing::{Deposit, PhotonPaths};
pub use visible_surfaces::VisibleSurfaces;
