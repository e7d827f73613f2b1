//! The statistics that everything reports.

pub mod metrics;
pub mod replicates;
