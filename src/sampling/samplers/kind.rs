//! Samplers by name.

use std::fmt;
use std::str::FromStr;

/// A sampler by name.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum SamplerKind {
    /// Independent uniform numbers.
    Independent,
    /// Jittered strata in each dimension.
    Stratified,
    /// Padded Owen-scrambled Sobol pairs.
    #[default]
    Sobol,
}

impl SamplerKind {
    /// All samplers.
    pub const ALL: [SamplerKind; 3] = [SamplerKind::Independent, SamplerKind::Stratified, SamplerKind::Sobol];

    /// The name in scene files and on the command line.
    pub fn name(self) -> &'static str {
        match self {
            SamplerKind::Independent => "independent",
            SamplerKind::Stratified => "stratified",
            SamplerKind::Sobol => "sobol",
        }
    }
}

impl fmt::Display for SamplerKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for SamplerKind {
    type Err = String;

    fn from_str(s: &str) -> Result<Self, String> {
        SamplerKind::ALL
            .into_iter()
            .find(|k| k.name() == s)
            .ok_or_else(|| format!("unknown sampler \"{s}\"; there are independent, stratified and sobol"))
    }
}
