//! Experiments: claims about Monte Carlo integration and ray tracing, and their measurement.
//!
//! An experiment states claims. It measures each of them with an interval, decides whether the interval confirms or
//! refutes the claim ([`Verdict`]), and shows the data. The seed determines everything but times.

mod bidirectional;
mod domains;
mod glossy;
mod history;
mod light_sampling;
mod moments;
mod one_dimension;
mod outcome;
mod paths;
mod patterns;
mod radiosity;
mod random;
mod studio;
mod verdict;

pub use outcome::{Evidence, Finding, Outcome};
pub use verdict::{LEVEL, Verdict};

use crate::accel::AccelKind;
use crate::error::Result;
use std::fmt;
use std::str::FromStr;

/// The options of an experiment.
#[derive(Clone, Copy, Debug)]
pub struct Options {
    /// Seed of all random numbers.
    pub seed: u64,
    /// Independent repetitions of an estimate, for experiments without images.
    pub runs: u32,
    /// Whether to use small images and few samples, so that an experiment takes seconds instead of minutes.
    pub quick: bool,
    /// The number of threads, which changes the speed but not the results.
    pub threads: usize,
    /// The ray traversal.
    pub accel: AccelKind,
}

impl Options {
    /// Returns the default number of repetitions.
    pub fn default_runs(quick: bool) -> u32 {
        if quick { 100 } else { 1000 }
    }

    /// Returns one of two sizes of an experiment.
    fn scaled<T>(&self, quick: T, full: T) -> T {
        if self.quick { quick } else { full }
    }
}

/// An experiment.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Experiment {
    /// Estimators of one-dimensional integrals.
    OneDimension,
    /// The domains that a pixel is an integral over.
    Domains,
    /// Sampling patterns.
    Patterns,
    /// Ways to sample an emitter.
    LightSampling,
    /// Few and many samples on a glossy surface.
    Glossy,
    /// Few and many paths for each pixel.
    Paths,
    /// Algorithms from ray casting to path tracing.
    History,
    /// The techniques of bidirectional path tracing.
    Bidirectional,
    /// Finite elements and Monte Carlo.
    Radiosity,
}

impl Experiment {
    /// All experiments.
    pub const ALL: [Experiment; 9] = [
        Experiment::OneDimension,
        Experiment::Domains,
        Experiment::Patterns,
        Experiment::LightSampling,
        Experiment::Glossy,
        Experiment::Paths,
        Experiment::History,
        Experiment::Bidirectional,
        Experiment::Radiosity,
    ];

    /// Returns the experiment's name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Experiment::OneDimension => "one-dimension",
            Experiment::Domains => "domains",
            Experiment::Patterns => "patterns",
            Experiment::LightSampling => "light-sampling",
            Experiment::Glossy => "glossy",
            Experiment::Paths => "paths",
            Experiment::History => "history",
            Experiment::Bidirectional => "bidirectional",
            Experiment::Radiosity => "radiosity",
        }
    }

    /// Returns the experiment's title.
    pub fn title(self) -> &'static str {
        match self {
            Experiment::OneDimension => "estimators of one-dimensional integrals",
            Experiment::Domains => "what a pixel is an integral over, one domain at a time",
            Experiment::Patterns => "random, fixed, jittered and Poisson-disk samples",
            Experiment::LightSampling => "a light sampled by area, by solid angle, and not at all",
            Experiment::Glossy => "1 and 256 samples of a glossy surface",
            Experiment::Paths => "10 and 100 paths for each pixel",
            Experiment::History => "ray casting, Whitted, distribution ray tracing, path tracing",
            Experiment::Bidirectional => "the techniques of bidirectional path tracing",
            Experiment::Radiosity => "a diffuse cube by finite elements and by path tracing",
        }
    }

    /// Runs the experiment.
    ///
    /// # Errors
    /// If threads cannot be started or a temporary file cannot be written.
    pub fn run(self, options: &Options) -> Result<Outcome> {
        let (findings, evidence) = match self {
            Experiment::OneDimension => one_dimension::run(options)?,
            Experiment::Domains => domains::run(options)?,
            Experiment::Patterns => patterns::run(options)?,
            Experiment::LightSampling => light_sampling::run(options)?,
            Experiment::Glossy => glossy::run(options)?,
            Experiment::Paths => paths::run(options)?,
            Experiment::History => history::run(options)?,
            Experiment::Bidirectional => bidirectional::run(options)?,
            Experiment::Radiosity => radiosity::run(options)?,
        };
        Ok(Outcome { name: self.name(), title: self.title(), findings, evidence })
    }
}

/// The findings of an experiment and the evidence for them.
type Found = (Vec<Finding>, Vec<Evidence>);

impl fmt::Display for Experiment {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for Experiment {
    type Err = String;

    fn from_str(s: &str) -> std::result::Result<Self, String> {
        Experiment::ALL.into_iter().find(|e| e.name() == s).ok_or_else(|| {
            let names = Experiment::ALL.map(Experiment::name).join(", ");
            format!("there is no experiment \"{s}\"; there are {names}")
        })
    }
}

/// Creates a pool with a number of threads.
fn pool(threads: usize) -> Result<rayon::ThreadPool> {
    rayon::ThreadPoolBuilder::new()
        .num_threads(threads)
        .build()
        .map_err(|e| crate::error::Error::internal(format!("cannot start {threads} threads: {e}")))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_round_trip_and_unknown_ones_are_refused() {
        for experiment in Experiment::ALL {
            assert_eq!(experiment.name().parse(), Ok(experiment));
        }
        let refused = "glosy".parse::<Experiment>();
        assert!(
            refused
                .is_err_and(|e| e.starts_with("there is no experiment \"glosy\"; there are one-dimension,"))
        );
    }
}
