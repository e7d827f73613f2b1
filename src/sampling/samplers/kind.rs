//! The names of samplers.

use super::strata::Grid;
use super::zsobol;
use std::fmt;
use std::str::FromStr;

/// The kind of a sampler.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum SamplerKind {
    /// Independent uniform numbers.
    Independent,
    /// Jittered strata in each dimension.
    Stratified,
    /// Correlated multi-jittered strata.
    Multijitter,
    /// Padded Owen-scrambled Halton pairs.
    Halton,
    /// Padded Owen-scrambled Sobol pairs.
    #[default]
    Sobol,
    /// Sobol pairs along a shuffled Z-curve over the image: blue noise.
    Zsobol,
    /// The same Sobol pairs in every pixel.
    Fixed,
}

impl SamplerKind {
    /// All samplers.
    pub const ALL: [SamplerKind; 7] = [
        SamplerKind::Independent,
        SamplerKind::Stratified,
        SamplerKind::Multijitter,
        SamplerKind::Halton,
        SamplerKind::Sobol,
        SamplerKind::Zsobol,
        SamplerKind::Fixed,
    ];

    /// Returns the name in scene files and on the command line.
    pub fn name(self) -> &'static str {
        match self {
            SamplerKind::Independent => "independent",
            SamplerKind::Stratified => "stratified",
            SamplerKind::Multijitter => "multijitter",
            SamplerKind::Halton => "halton",
            SamplerKind::Sobol => "sobol",
            SamplerKind::Zsobol => "zsobol",
            SamplerKind::Fixed => "fixed",
        }
    }

    /// Returns whether the samples of different pixels are independent.
    pub fn has_independent_pixels(self) -> bool {
        !matches!(self, SamplerKind::Zsobol | SamplerKind::Fixed)
    }

    /// Returns whether the samples of a pixel fill a grid, which is made for their number.
    pub fn is_grid(self) -> bool {
        matches!(self, SamplerKind::Stratified | SamplerKind::Multijitter)
    }

    /// Returns whether the errors of different pixels are so strongly correlated that the error of an average over
    /// pixels is larger than for independent errors.
    pub fn shares_noise(self) -> bool {
        self == SamplerKind::Fixed
    }

    /// Returns a note if this sampler works better with another number of samples per pixel. `None` for
    /// `samples_per_pixel` means that the number is unknown.
    pub fn advice(self, samples_per_pixel: Option<u64>) -> Option<String> {
        let of_two = matches!(self, SamplerKind::Zsobol);
        if !of_two && !self.is_grid() {
            return None;
        }
        let Some(samples) = samples_per_pixel else {
            let planned = super::DEFAULT_COUNT;
            return Some(format!(
                "the sampler {self} assumes {planned} samples per pixel without --spp, and starts a new sequence after that"
            ));
        };
        let (most, fits): (u64, fn(u64) -> bool) = match of_two {
            true => (2 << zsobol::MAX_LOG2, u64::is_power_of_two),
            false => (2 * Grid::MAX_POINTS, |n| n % 2 == 0 && u64::from(Grid::new(n / 2).cells()) == n / 2),
        };
        if samples > most {
            return Some(format!("the sampler {self} starts a new sequence after {most} samples per pixel"));
        }
        if samples == 1 || fits(samples) {
            return None;
        }
        let below = (1..samples).rev().find(|&n| fits(n)).unwrap_or(1);
        let above = (samples + 1..).find(|&n| fits(n)).unwrap_or(most);
        let why = match of_two {
            true => "has the best error distribution for powers of two",
            false => "fills all strata only for certain numbers of samples",
        };
        Some(format!(
            "the sampler {self} {why}: use {below} or {above} samples per pixel instead of {samples}"
        ))
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
        SamplerKind::ALL.into_iter().find(|k| k.name() == s).ok_or_else(|| {
            let names = SamplerKind::ALL.map(SamplerKind::name).join(", ");
            format!("unknown sampler \"{s}\"; there are {names}")
        })
    }
}
