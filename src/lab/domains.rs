//! The error caused by each domain of a pixel's integral, with only that domain sampled.

use super::outcome::{Evidence, Finding, plus_minus, slope};
use super::studio::{ROOM, Sampling, Studio, picture};
use super::verdict::Check;
use super::{Found, Options};
use crate::error::Result;
use crate::estimate::convergence::PowerLaw;
use crate::integrator::Settings;
use crate::integrator::settings::{PathLimits, PathSettings};
use crate::lab::moments::Measured;
use crate::report::{Align, Axis, Line, Plot, Point, Series, Table};
use crate::sampling::{Domain, DomainSet, SamplerKind};

/// The domains and the effects that they cause.
const DOMAINS: [(Domain, &str); 6] = [
    (Domain::Pixel, "antialiasing"),
    (Domain::Lens, "depth of field"),
    (Domain::Time, "motion blur"),
    (Domain::Light, "soft shadows"),
    (Domain::Bsdf, "glossy reflection"),
    (Domain::Hemisphere, "indirect light"),
];
const SAMPLERS: [SamplerKind; 2] = [SamplerKind::Independent, SamplerKind::Sobol];

/// Returns a sampler that varies one domain only.
fn alone(domain: Domain, kind: SamplerKind, spp: u64) -> Sampling {
    let Sampling { sampler, spp } = Sampling::new(kind, spp);
    Sampling { sampler: sampler.with_fixed(DomainSet::all_but(&[domain])), spp }
}

/// The errors of one sampler in one domain.
struct DomainRow {
    domain: usize,
    sampler: SamplerKind,
    /// RMS errors at each number of samples.
    errors: Vec<(u64, Measured)>,
    law: Option<PowerLaw>,
    /// The exponent of the power law, from pairs of renders.
    exponent: Measured,
}

fn measure(studio: &Studio, integrator: &Settings, options: &Options) -> Result<Vec<DomainRow>> {
    let most = options.scaled(5, 6);
    let mut rows = Vec::new();
    for (domain, (of, _)) in DOMAINS.into_iter().enumerate() {
        for sampler in SAMPLERS {
            let mut squares = Vec::new();
            for spp in (1..=most).map(|k| 1u64 << k) {
                squares
                    .push((spp, studio.squares(integrator, alone(of, sampler, spp), options.scaled(8, 4))?));
            }
            let errors: Vec<_> = squares.iter().map(|(spp, s)| (*spp, Measured::root(s))).collect();
            let law = PowerLaw::fit(errors.iter().map(|(spp, e)| (*spp as f64, e.value)));
            let points: Vec<_> = squares.iter().map(|(spp, s)| (*spp as f64, s.as_slice())).collect();
            rows.push(DomainRow { domain, sampler, errors, law, exponent: Measured::exponent(&points) });
        }
    }
    Ok(rows)
}

fn table(rows: &[DomainRow]) -> Table {
    let mut table = Table::new([
        ("domain", Align::Left),
        ("what it brings", Align::Left),
        ("sampler", Align::Left),
        ("RMS error, fewest", Align::Right),
        ("most samples", Align::Right),
        ("slope", Align::Right),
    ]);
    for row in rows {
        let (domain, effect) = DOMAINS[row.domain];
        let ends = [row.errors.first(), row.errors.last()];
        let [first, last] = ends.map(|e| e.map_or_else(String::new, |(_, e)| format!("{:.3e}", e.value)));
        table.row([domain.to_string(), effect.into(), row.sampler.to_string(), first, last, slope(row.law)]);
    }
    table
}

fn plot(rows: &[DomainRow], sampler: SamplerKind) -> Plot {
    let series = rows.iter().filter(|row| row.sampler == sampler).map(|row| Series {
        name: format!("{}, slope {}", DOMAINS[row.domain].0, slope(row.law)),
        points: row.errors.iter().map(|(spp, e)| Point::new(*spp as f64, e.value)).collect(),
        style: row.domain,
        line: Line::Solid,
    });
    Plot {
        title: format!("RMS error with one domain switched on, sampler {sampler}"),
        x: Axis::log("samples per pixel"),
        y: Axis::log("RMS error"),
        series: series.collect(),
    }
}

fn findings(rows: &[DomainRow]) -> Vec<Finding> {
    let exponents = |sampler: SamplerKind| -> Vec<Measured> {
        rows.iter().filter(|row| row.sampler == sampler).map(|row| row.exponent).collect()
    };
    let listed = |values: &[Measured]| {
        let named = DOMAINS.iter().zip(values).map(|((domain, _), e)| format!("{domain} {}", plus_minus(*e)));
        named.collect::<Vec<_>>().join(", ")
    };
    let [independent, sobol] = SAMPLERS.map(exponents);
    vec![
        Finding::new(
            "Pixel, lens, time, light, BSDF and hemisphere are domains of one integral: of each, the error falls \
             as 1/√N.",
            format!("slopes of independent samples: {} (allowed 0.1)", listed(&independent)),
            &independent.iter().map(|e| Check::near(*e, -0.5, 0.1)).collect::<Vec<_>>(),
        ),
        Finding::new(
            "Stratified over a domain, samples of it converge faster than independent ones.",
            format!("slopes of Sobol samples: {}", listed(&sobol)),
            &sobol.iter().zip(&independent).map(|(s, i)| Check::below(s.minus(*i), 0.0)).collect::<Vec<_>>(),
        ),
    ]
}

/// Measures the error of every domain and shows an image of each.
pub fn run(options: &Options) -> Result<Found> {
    // Russian roulette would be a seventh domain, which has no visible effect.
    let path = PathLimits { max_depth: Some(6), rr_depth: u32::MAX, hide_emitters: false };
    let integrator = Settings::Path(PathSettings::independent(path));
    let rows =
        measure(&Studio::open(ROOM, options.scaled((24, 18), (48, 36)), options)?, &integrator, options)?;
    let studio = Studio::open(ROOM, options.scaled((80, 60), (160, 120)), options)?;
    let spp = options.scaled(16, 32);
    let mut pictures = Vec::new();
    let held = Sampling::new(SamplerKind::Sobol, 1);
    let nothing = Sampling { sampler: held.sampler.with_fixed(DomainSet::all_but(&[])), ..held };
    pictures.push(picture(
        &studio.shoot(&integrator, nothing, 0)?.image,
        0.0,
        "none",
        "every domain held at its middle",
    )?);
    for (domain, effect) in DOMAINS {
        let shot = studio.shoot(&integrator, alone(domain, SamplerKind::Sobol, spp), 0)?;
        pictures.push(picture(&shot.image, 0.0, domain.to_string(), effect)?);
    }
    let all = studio.shoot(&integrator, Sampling::new(SamplerKind::Sobol, spp), 0)?;
    pictures.push(picture(&all.image, 0.0, "all", "the picture")?);
    let note = "A domain that is not switched on is held at its middle: the lens is a pinhole, the shutter an instant, \
                the lamp a point, a reflection one direction. RMS errors are those of pairs of independent renders.";
    let evidence = vec![
        Evidence::Text(note.into()),
        Evidence::Table("Error against samples, domain by domain".into(), table(&rows)),
        Evidence::Plot(plot(&rows, SamplerKind::Independent)),
        Evidence::Plot(plot(&rows, SamplerKind::Sobol)),
        Evidence::Pictures(format!("One domain at a time, {spp} samples per pixel"), pictures),
    ];
    Ok((findings(&rows), evidence))
}
