//! Ten and a hundred paths for each pixel.

use super::moments::Measured;
use super::outcome::{Evidence, Finding, plus_minus};
use super::studio::{BALLS, Sampling, Studio, viewer};
use super::{Found, Options};
use crate::error::Result;
use crate::integrator::Settings;
use crate::integrator::settings::PathLimits;
use crate::report::{Align, Table};
use crate::sampling::SamplerKind;

/// Paths for each pixel.
const PATHS: [u64; 2] = [10, 100];

/// Whether a ratio may be `expected`: within 10 %, which the errors of few pictures can be off, or three standard
/// errors.
pub fn about(ratio: Measured, expected: f64) -> bool {
    (ratio.value / expected - 1.0).abs() <= 0.1 || ratio.agrees_with(expected)
}

/// The ratio of two measured numbers.
pub fn ratio(a: Measured, b: Measured) -> Measured {
    let value = a.value / b.value;
    Measured { value, error: value * (a.error / a.value).hypot(b.error / b.value) }
}

/// Measures both, and shows them.
pub fn run(options: &Options) -> Result<Found> {
    let integrator = Settings::Path(PathLimits { max_depth: Some(5), ..PathLimits::default() });
    let studio = Studio::open(BALLS, options.scaled((48, 36), (120, 90)), options)?;
    let pairs = 3;
    let mut table = Table::new([
        ("sampler", Align::Left),
        ("10 paths", Align::Right),
        ("100 paths", Align::Right),
        ("ratio", Align::Right),
    ]);
    let (mut ratios, mut hundred) = (Vec::new(), Vec::new());
    for sampler in [SamplerKind::Independent, SamplerKind::Sobol] {
        let [few, many] = PATHS.map(|spp| studio.noise(&integrator, Sampling::new(sampler, spp), pairs));
        let (few, many) = (few?, many?);
        let ratio = ratio(few, many);
        table.row([sampler.to_string(), plus_minus(few), plus_minus(many), plus_minus(ratio)]);
        ratios.push(ratio);
        hundred.push(many);
    }
    let [few, many] =
        PATHS.map(|spp| studio.shoot(&integrator, Sampling::new(SamplerKind::Independent, spp), 0));
    let (few, many) = (few?, many?);
    let truth = studio.shoot(&integrator, Sampling::new(SamplerKind::Sobol, options.scaled(256, 512)), 99)?;
    let images = vec![
        ("10 paths per pixel".to_owned(), &few.image),
        ("100 paths per pixel".to_owned(), &many.image),
        ("reference".to_owned(), &truth.image),
    ];
    let expected = 10f64.sqrt();
    let findings = vec![
        Finding::new(
            "Ten times as many paths for each pixel lower the error by √10.",
            format!(
                "ratio of RMS errors {} (√10 = {expected:.3}; held within 10 % or three standard errors)",
                plus_minus(ratios[0])
            ),
            about(ratios[0], expected),
        ),
        Finding::new(
            "Stratified samples (Sobol) make more of the same hundred paths than independent ones.",
            format!("RMS errors {} and {}", plus_minus(hundred[1]), plus_minus(hundred[0])),
            hundred[1].value < hundred[0].value,
        ),
    ];
    let evidence = vec![
        Evidence::Table("RMS error by paths per pixel".into(), table),
        Evidence::Viewer(viewer("10 and 100 independent paths per pixel", images)?),
    ];
    Ok((findings, evidence))
}
