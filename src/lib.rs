//! Buffon, a Monte-Carlo renderer.

pub mod cli;
pub mod error;
pub mod estimate;
pub mod image;
