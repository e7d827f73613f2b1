//! A glossy surface with 1 and 256 samples.

use super::outcome::{Evidence, Finding, plus_minus};
use super::studio::{ROOM, Sampling, Studio, viewer};
use super::verdict::Check;
use super::{Found, Options};
use crate::error::Result;
use crate::integrator::Settings;
use crate::integrator::settings::{PathLimits, PathSettings};
use crate::report::{Align, Table};
use crate::sampling::{Domain, DomainSet, SamplerKind};

/// Returns a sampler that varies the glossy lobe only.
fn lobe(kind: SamplerKind, spp: u64) -> Sampling {
    let Sampling { sampler, spp } = Sampling::new(kind, spp);
    Sampling { sampler: sampler.with_fixed(DomainSet::all_but(&[Domain::Bsdf])), spp }
}

/// Measures the error at both numbers of samples and shows both images.
pub fn run(options: &Options) -> Result<Found> {
    // Surfaces hit by reflected rays receive direct light only. Longer paths would add noise of other domains.
    let integrator =
        Settings::Path(PathSettings::independent(PathLimits { max_depth: Some(3), ..PathLimits::default() }));
    let studio = Studio::open(ROOM, options.scaled((36, 27), (100, 75)), options)?;
    let pairs = 4;
    let mut table = Table::new([
        ("sampler", Align::Left),
        ("1 sample", Align::Right),
        ("256 samples", Align::Right),
        ("ratio", Align::Right),
    ]);
    let mut ratios = Vec::new();
    for sampler in [SamplerKind::Independent, SamplerKind::Sobol] {
        let one = studio.noise(&integrator, lobe(sampler, 1), 4 * pairs)?;
        let many = studio.noise(&integrator, lobe(sampler, 256), pairs)?;
        let ratio = one.over(many);
        table.row([sampler.to_string(), plus_minus(one), plus_minus(many), plus_minus(ratio)]);
        ratios.push(ratio);
    }
    let shoot = |spp, take| studio.shoot(&integrator, lobe(SamplerKind::Independent, spp), take);
    let (one, many) = (shoot(1, 0)?, shoot(256, 0)?);
    let truth = studio.shoot(&integrator, lobe(SamplerKind::Sobol, options.scaled(256, 512)), 99)?;
    let images = vec![
        ("1 sample".to_owned(), &one.image),
        ("256 samples".to_owned(), &many.image),
        ("reference".to_owned(), &truth.image),
    ];
    let findings = vec![
        Finding::new(
            "256 random reflections instead of one lower the error of glossy surfaces by √256 = 16.",
            format!("ratio of RMS errors {} (allowed 10 %)", plus_minus(ratios[0])),
            &[Check::near(ratios[0], 16.0, 1.6)],
        ),
        Finding::new(
            "Samples that are stratified over the lobe (Sobol) lower it by more.",
            format!("ratio of RMS errors {}", plus_minus(ratios[1])),
            &[Check::above(ratios[1].minus(ratios[0]), 0.0)],
        ),
    ];
    let note = "Only the lobes of the first surface are sampled; pixel, lens, time and lamp are held at their middles.";
    let evidence = vec![
        Evidence::Text(note.into()),
        Evidence::Table("RMS error by samples of the lobe".into(), table),
        Evidence::Viewer(viewer("1 and 256 reflections for each pixel", images)?),
    ];
    Ok((findings, evidence))
}
