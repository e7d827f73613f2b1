//! Buffon: a Monte-Carlo renderer.
#![deny(unsafe_code)]

pub mod accel;
pub mod bsdf;
pub mod color;
pub mod emitter;
pub mod error;
pub mod film;
pub mod ids;
pub mod integrator;
pub mod loader;
pub mod material;
pub mod math;
pub mod sampling;
pub mod scene;
pub mod sensor;
pub mod shape;
