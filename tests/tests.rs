//! The integration tests, in one binary.

mod cli;
mod closed_form;
mod closed_form_specular;
mod determinism;
#[cfg(feature = "embree")]
mod embree_ffi;
mod emitters;
mod image_io;
mod layering;
mod loader;
mod loader_errors;
mod loader_plugin_errors;
mod loader_plugins;
mod loader_robustness;
mod meshes;
mod own_scenes;
mod parity;
mod parity_instances;
mod scattering;
mod self_intersection;
mod support;
mod watertight;
