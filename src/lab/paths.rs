//! Ten and a hundred paths per pixel.

use super::outcome::{Evidence, Finding, plus_minus};
use super::studio::{BALLS, Sampling, Studio, viewer};
use super::verdict::Check;
use super::{Found, Options};
use crate::error::Result;
use crate::integrator::Settings;
use crate::integrator::settings::{PathLimits, PathSettings};
use crate::report::{Align, Table};
use crate::sampling::SamplerKind;

/// Numbers of paths per pixel.
const PATHS: [u64; 2] = [10, 100];

/// Measures the error at both numbers of paths and shows both images.
pub fn run(options: &Options) -> Result<Found> {
    let integrator =
        Settings::Path(PathSettings::independent(PathLimits { max_depth: Some(5), ..PathLimits::default() }));
    let studio = Studio::open(BALLS, options.scaled((48, 36), (120, 90)), options)?;
    let pairs = 4;
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
        let ratio = few.over(many);
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
            format!("ratio of RMS errors {} (√10 = {expected:.3}; allowed 10 %)", plus_minus(ratios[0])),
            &[Check::near(ratios[0], expected, 0.1 * expected)],
        ),
        Finding::new(
            "Stratified samples (Sobol) make more of the same hundred paths than independent ones.",
            format!("RMS errors {} and {}", plus_minus(hundred[1]), plus_minus(hundred[0])),
            &[Check::below(hundred[1].minus(hundred[0]), 0.0)],
        ),
    ];
    let evidence = vec![
        Evidence::Table("RMS error by paths per pixel".into(), table),
        Evidence::Viewer(viewer("10 and 100 independent paths per pixel", images)?),
    ];
    Ok((findings, evidence))
}
