//! The integration tests, in one binary.

mod image_io;
