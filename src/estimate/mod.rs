//! The statistics that everything reports.

pub mod convergence;
pub mod metrics;
pub mod replicates;
pub mod student;
