//! The integration tests, in one binary.

mod diff_metrics;
mod image_io;
