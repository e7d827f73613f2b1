//! What every room may use and what knows nothing of rendering: files that are replaced whole or not at all, the binary
//! container of caches and checkpoints, and hashes of data.

pub mod container;
mod digest;
mod replace;
pub mod wording;

pub use digest::digest;
pub use replace::{check_replaceable, replace, replace_with};
