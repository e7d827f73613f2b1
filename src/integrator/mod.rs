//! Integrators: estimators of the radiance that arrives along a wave of rays.

pub mod settings;

pub use settings::Settings;
