//! All integration tests, in one binary.

mod loader;
mod loader_errors;
mod loader_plugin_errors;
mod loader_plugins;
mod loader_robustness;
