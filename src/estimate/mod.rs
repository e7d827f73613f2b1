//! Statistics: error metrics, error estimates, convergence rates, significance.

pub mod convergence;
pub mod metrics;
pub mod replicates;
pub mod student;
