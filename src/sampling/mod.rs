//! Sampling: point sets, warps, distributions, multiple importance sampling.

/// A sampler by name; what each does is told where it is built.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum SamplerKind {
    /// Independent uniform numbers.
    Independent,
    /// Jittered strata in each dimension pair.
    Stratified,
    /// Padded Owen-scrambled Sobol pairs.
    #[default]
    Sobol,
}
