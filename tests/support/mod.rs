//! What the tests share.

pub mod chi2;
pub mod scenes;
pub mod statistics;
