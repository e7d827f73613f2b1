//! Functions and data that the tests share.

pub mod bsdfs;
pub mod chi2;
pub mod cli;
pub mod docs;
pub mod expect;
pub mod gltf;
pub mod quadrature;
pub mod scenes;
pub mod statistics;
