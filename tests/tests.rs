//! All integration tests, in one binary.

mod loader;
mod loader_errors;
