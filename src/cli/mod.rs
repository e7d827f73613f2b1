//! The command line.

pub mod diff;
pub mod info_image;
