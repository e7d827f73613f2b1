//! Sampling: point sets, warps, discrete distributions, multiple importance sampling.

pub mod dimension;
pub mod distribution;
pub mod distribution_2d;
pub mod domain;
pub mod hash;
pub mod mis;
pub mod samplers;
pub mod warp;

pub use dimension::Dimension;
pub use distribution::Distribution1D;
pub use distribution_2d::{BilinearDistribution2D, Distribution2D, PointsX16};
pub use domain::{Domain, DomainSet};
pub use samplers::{CHAIN_STEPS, SHARED_REPLICATES, SampleKey, Sampler, SamplerKind};
