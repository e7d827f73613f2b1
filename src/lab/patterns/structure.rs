//! Random numbers against one fixed sequence for every pixel.

use crate::error::Result;
use crate::estimate::metrics;
use crate::image::Image;
use crate::integrator::Settings;
use crate::integrator::settings::PathSettings;
use crate::lab::outcome::{Evidence, Finding};
use crate::lab::studio::{BALLS, Sampling, Studio, viewer};
use crate::lab::{Found, Options};
use crate::report::{Align, Table};
use crate::sampling::SamplerKind;

const SAMPLERS: [SamplerKind; 3] = [SamplerKind::Independent, SamplerKind::Sobol, SamplerKind::Fixed];

/// The correlation of the errors of horizontal neighbours, relative to the truth's brightness there.
fn correlation(image: &Image, truth: &Image) -> f64 {
    let errors: Vec<f64> = image
        .data
        .chunks_exact(3)
        .zip(truth.data.chunks_exact(3))
        .map(|(x, r)| {
            let [x, r] = [x, r].map(|v| v.iter().map(|&v| f64::from(v)).sum::<f64>());
            (x - r) / (r + 0.1)
        })
        .collect();
    let rows = || errors.chunks_exact(image.width);
    let square = errors.iter().map(|e| e * e).sum::<f64>() / errors.len() as f64;
    let pairs: f64 = rows().flat_map(|row| row.windows(2)).map(|w| w[0] * w[1]).sum();
    pairs / (image.height * (image.width - 1)) as f64 / square
}

/// Renders with each sampler, and looks for structure in the error.
pub fn run(options: &Options) -> Result<Found> {
    let integrator = Settings::Path(PathSettings { max_depth: Some(4), ..PathSettings::default() });
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
        let image = studio.shoot(&integrator, Sampling::new(sampler, 16), 0)?.image;
        let found = correlation(&image, &truth);
        let rms = metrics::mse(&image.data, &truth.data).sqrt();
        table.row([sampler.to_string(), format!("{rms:.4}"), format!("{found:.3}")]);
        correlations.push(found);
        shots.push((format!("{sampler}, 16 spp"), image));
    }
    let chance = 3.0 / ((truth.width - 1) as f64 * truth.height as f64).sqrt();
    let finding = Finding::new(
        "The same sequence in every pixel makes neighbours err alike, so that the eye sees structure; random numbers do not.",
        format!(
            "correlation of neighbouring errors: independent {:.3}, fixed {:.3} (by chance up to {chance:.3})",
            correlations[0], correlations[2]
        ),
        correlations[0].abs() <= 2.0 * chance && correlations[2] > 10.0 * chance,
    );
    let mut images: Vec<(String, &Image)> = shots.iter().map(|(name, image)| (name.clone(), image)).collect();
    images.push(("reference".into(), &truth));
    let evidence = vec![
        Evidence::Table("Errors from pixel to pixel, 16 samples each".into(), table),
        Evidence::Viewer(viewer("Random numbers and a fixed sequence", images)?),
    ];
    Ok((vec![finding], evidence))
}
