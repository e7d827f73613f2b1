//! Samplers by name.

use super::strata::Grid;
use super::zsobol;
use std::fmt;
use std::str::FromStr;

/// A sampler by name.
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
    /// Sobol pairs along a shuffled Z-curve over the screen: blue noise.
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

    /// The name in scene files and on the command line.
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

    /// Whether the samples of a pixel say nothing of those of other pixels.
    pub fn has_independent_pixels(self) -> bool {
        !matches!(self, SamplerKind::Zsobol | SamplerKind::Fixed)
    }

    /// Whether errors of different pixels are so much alike that the error of an average over pixels is larger than
    /// if they were independent.
    pub fn shares_noise(self) -> bool {
        self == SamplerKind::Fixed
    }

    /// What to know about this sampler at that many samples per pixel (`None` where no rule says how many), if it would do
    /// better with another number.
    pub fn advice(self, samples_per_pixel: Option<u64>) -> Option<String> {
        let of_two = matches!(self, SamplerKind::Zsobol);
        if !of_two && !matches!(self, SamplerKind::Stratified | SamplerKind::Multijitter) {
            return None;
        }
        let Some(samples) = samples_per_pixel else {
            let planned = super::PLANNED;
            return Some(format!(
                "the sampler {self} is laid out for {planned} samples per pixel where --spp names no number, and begins \
                 anew after those"
            ));
        };
        let (most, fits): (u64, fn(u64) -> bool) = match of_two {
            true => (2 << zsobol::MOST_LOG2, u64::is_power_of_two),
            false => (2 * Grid::MOST, |n| n % 2 == 0 && u64::from(Grid::new(n / 2).cells()) == n / 2),
        };
        if samples > most {
            return Some(format!("the sampler {self} begins anew after {most} samples per pixel"));
        }
        if samples == 1 || fits(samples) {
            return None;
        }
        let below = (1..samples).rev().find(|&n| fits(n)).unwrap_or(1);
        let above = (samples + 1..).find(|&n| fits(n)).unwrap_or(most);
        let why = match of_two {
            true => "spreads its error best at powers of two",
            false => "fills all of its strata only at some numbers of samples",
        };
        Some(format!("the sampler {self} {why}: {below} or {above} samples per pixel instead of {samples}"))
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
