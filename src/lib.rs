//! Buffon: a Monte-Carlo renderer.

pub mod accel;
#[cfg(feature = "embree")]
pub mod embree;
pub mod error;
pub mod ids;
pub mod math;
