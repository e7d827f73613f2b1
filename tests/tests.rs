//! The integration tests, in one binary.

mod cli;
mod closed_form;
mod closed_form_specular;
mod determinism;
mod distributions;
#[cfg(feature = "embree")]
mod embree_ffi;
mod emitters;
mod environment_map;
mod image_io;
mod layering;
mod loader;
mod loader_errors;
mod loader_plugin_errors;
mod loader_plugins;
mod loader_robustness;
mod mesh_robustness;
mod meshes;
mod own_scenes;
mod parity;
mod parity_instances;
mod plugins;
mod scattering;
mod scattering_extremes;
mod scattering_principled;
mod scattering_rough;
mod scattering_values;
mod self_intersection;
mod support;
mod texture_files;
mod watertight;
