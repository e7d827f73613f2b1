//! Different random numbers for each pixel, compared with one fixed sequence for all pixels.

use crate::error::Result;
use crate::estimate::metrics;
use crate::image::Image;
use crate::integrator::Settings;
use crate::integrator::settings::{PathLimits, PathSettings};
use crate::lab::moments::Measured;
use crate::lab::outcome::{Evidence, Finding, plus_minus};
use crate::lab::studio::{BALLS, Sampling, Studio, viewer};
use crate::lab::verdict::Check;
use crate::lab::{Found, Options};
use crate::report::{Align, Table};
use crate::sampling::SamplerKind;

const SAMPLERS: [SamplerKind; 3] = [SamplerKind::Independent, SamplerKind::Sobol, SamplerKind::Fixed];

/// Returns the correlation of the errors of horizontally neighbouring pixels, from the difference of two independent
/// renders.
///
/// Differences are relative to the brightness and compressed to (−1, 1), so that single bright paths do not dominate.
/// Their distribution is symmetric, so those of independent pixels remain uncorrelated.
fn correlation(a: &Image, b: &Image) -> Measured {
    let differences: Vec<f64> = a
        .data
        .chunks_exact(3)
        .zip(b.data.chunks_exact(3))
        .map(|(a, b)| {
            let [a, b] = [a, b].map(|v| v.iter().map(|&v| f64::from(v)).sum::<f64>());
            (a - b) / (a + b + 0.1)
        })
        .collect();
    let mut sizes: Vec<f64> = differences.iter().map(|d| d.abs()).collect();
    sizes.sort_unstable_by(f64::total_cmp);
    let typical = sizes[sizes.len() / 2].max(f64::MIN_POSITIVE);
    let squeezed: Vec<f64> = differences.iter().map(|d| d / (d.abs() + typical)).collect();
    let square = squeezed.iter().map(|e| e * e).sum::<f64>() / squeezed.len() as f64;
    let rows = squeezed.chunks_exact(a.width);
    let by_row =
        |row: &[f64]| row.windows(2).map(|w| w[0] * w[1]).sum::<f64>() / (row.len() - 1) as f64 / square;
    Measured::mean(&rows.map(by_row).collect::<Vec<_>>())
}

/// Renders with each sampler and measures the structure of the error.
pub fn run(options: &Options) -> Result<Found> {
    let integrator =
        Settings::Path(PathSettings::independent(PathLimits { max_depth: Some(4), ..PathLimits::default() }));
    let studio = Studio::open(BALLS, options.scaled((64, 48), (120, 90)), options)?;
    let truth =
        studio.shoot(&integrator, Sampling::new(SamplerKind::Sobol, options.scaled(256, 512)), 99)?.image;
    let mut table = Table::new([
        ("sampler", Align::Left),
        ("RMS error", Align::Right),
        ("correlation of neighbours", Align::Right),
    ]);
    let (mut correlations, mut shots) = (Vec::new(), Vec::new());
    for sampler in SAMPLERS {
        let [image, other] = [0, 1].map(|take| studio.shoot(&integrator, Sampling::new(sampler, 16), take));
        let image = image?.image;
        let found = correlation(&image, &other?.image);
        let rms = metrics::mse(&image.data, &truth.data).sqrt();
        table.row([sampler.to_string(), format!("{rms:.4}"), plus_minus(found)]);
        correlations.push(found);
        shots.push((format!("{sampler}, 16 spp"), image));
    }
    let finding = Finding::new(
        "The same sequence in every pixel makes neighbours err alike, so that the eye sees structure; \
         random numbers do not.",
        format!(
            "correlation of neighbouring errors: independent {} (allowed 0.1), fixed {} (at least 0.2)",
            plus_minus(correlations[0]),
            plus_minus(correlations[2])
        ),
        &[Check::near(correlations[0], 0.0, 0.1), Check::above(correlations[2], 0.2)],
    );
    let mut images: Vec<(String, &Image)> = shots.iter().map(|(name, image)| (name.clone(), image)).collect();
    images.push(("reference".into(), &truth));
    let evidence = vec![
        Evidence::Table("Errors from pixel to pixel, 16 samples each".into(), table),
        Evidence::Viewer(viewer("Random numbers and a fixed sequence", images)?),
    ];
    Ok((vec![finding], evidence))
}
