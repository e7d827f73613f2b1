//! From ray casting to path tracing, on one scene.

use super::moments::Measured;
use super::outcome::{Evidence, Finding, may_be, slope};
use super::studio::{BALLS, Sampling, Shot, Studio, viewer};
use super::{Found, Options};
use crate::error::Result;
use crate::estimate::convergence::PowerLaw;
use crate::estimate::metrics;
use crate::image::Image;
use crate::integrator::Settings;
use crate::integrator::settings::{DistributionSettings, PathLimits, WhittedSettings};
use crate::report::{Align, Axis, Line, Plot, Point, Series, Table};
use crate::sampling::SamplerKind;

/// Longest path of all algorithms but ray casting, in edges.
const MAX_DEPTH: u32 = 5;

/// An algorithm.
struct Algorithm {
    name: &'static str,
    settings: Settings,
    /// Samples per pixel that it is tried at.
    spp: Vec<u64>,
}

fn algorithms(options: &Options) -> [Algorithm; 4] {
    let whitted = |max_depth| Settings::Whitted(WhittedSettings { max_depth, hide_emitters: false });
    let branching = DistributionSettings {
        max_depth: MAX_DEPTH,
        emitter_samples: 4,
        bsdf_samples: 4,
        hide_emitters: false,
    };
    let path = PathLimits { max_depth: Some(MAX_DEPTH), rr_depth: u32::MAX, hide_emitters: false };
    let algorithm = |name, settings, spp: &[u64]| Algorithm { name, settings, spp: spp.to_vec() };
    [
        algorithm("ray casting", whitted(2), &[4, 16, 64]),
        algorithm("Whitted", whitted(MAX_DEPTH), &[4, 16, 64]),
        algorithm("distribution", Settings::Distribution(branching), &[1, 4, 16]),
        algorithm("path", Settings::Path(path), options.scaled(&[4, 16, 64], &[4, 16, 64, 256])),
    ]
}

/// What an algorithm did at one number of samples.
struct Row {
    algorithm: usize,
    spp: u64,
    rays: f64,
    rays_per_pixel: f64,
    seconds: f64,
    /// RMS error against the reference.
    error: f64,
    /// Mean of the picture over that of the reference; its error is that of an unbiased picture.
    brightness: Measured,
    image: Image,
}

/// The mean of an image's values.
fn mean(image: &Image) -> f64 {
    image.data.iter().map(|&v| f64::from(v)).sum::<f64>() / image.data.len() as f64
}

fn measure(studio: &Studio, algorithms: &[Algorithm], truth: &Image) -> Result<Vec<Row>> {
    let mut rows = Vec::new();
    for (i, algorithm) in algorithms.iter().enumerate() {
        for &spp in &algorithm.spp {
            let sampling = Sampling::new(SamplerKind::Independent, spp);
            let Shot { image, counters, seconds, .. } = studio.shoot(&algorithm.settings, sampling, 0)?;
            let rays = (counters.closest_rays + counters.occlusion_rays) as f64;
            let error = metrics::mse(&image.data, &truth.data).sqrt();
            let pixels = (image.width * image.height) as f64;
            // Pixels are independent; the colours of one are not.
            let brightness =
                Measured { value: mean(&image) / mean(truth), error: error / pixels.sqrt() / mean(truth) };
            rows.push(Row {
                algorithm: i,
                spp,
                rays,
                rays_per_pixel: rays / pixels,
                seconds,
                error,
                brightness,
                image,
            });
        }
    }
    Ok(rows)
}

fn table(algorithms: &[Algorithm], rows: &[Row]) -> Table {
    let mut table = Table::new([
        ("algorithm", Align::Left),
        ("spp", Align::Right),
        ("rays", Align::Right),
        ("rays a pixel", Align::Right),
        ("seconds", Align::Right),
        ("RMS error", Align::Right),
        ("brightness", Align::Right),
    ]);
    for row in rows {
        table.row([
            algorithms[row.algorithm].name.to_owned(),
            row.spp.to_string(),
            format!("{:.2} M", row.rays * 1e-6),
            format!("{:.0}", row.rays_per_pixel),
            format!("{:.2}", row.seconds),
            format!("{:.4}", row.error),
            format!("{:.1} %", 100.0 * row.brightness.value),
        ]);
    }
    table
}

/// The rows of one algorithm.
fn of(rows: &[Row], algorithm: usize) -> impl Iterator<Item = &Row> {
    rows.iter().filter(move |row| row.algorithm == algorithm)
}

fn law(rows: &[Row], algorithm: usize) -> Option<PowerLaw> {
    PowerLaw::fit(of(rows, algorithm).map(|row| (row.rays_per_pixel, row.error)))
}

fn plot(algorithms: &[Algorithm], rows: &[Row]) -> Plot {
    let series = algorithms.iter().enumerate().map(|(i, algorithm)| Series {
        name: format!("{}, slope {}", algorithm.name, slope(law(rows, i))),
        points: of(rows, i)
            .map(|row| Point {
                note: format!("{} spp", row.spp),
                ..Point::new(row.rays_per_pixel, row.error)
            })
            .collect(),
        style: i,
        line: Line::Solid,
    });
    Plot {
        title: "RMS error against the rays that it cost".into(),
        x: Axis::log("rays for each pixel"),
        y: Axis::log("RMS error"),
        series: series.collect(),
    }
}

/// Rays times squared error: what one unit of precision costs, the same for any number of samples.
fn cost(rows: &[Row], algorithm: usize) -> f64 {
    let (sum, n) = of(rows, algorithm)
        .fold((0.0, 0.0), |(sum, n), row| (sum + (row.rays_per_pixel * row.error * row.error).ln(), n + 1.0));
    (sum / n).exp()
}

/// The brightness of an algorithm's best picture, in percent of the truth's.
fn brightness(rows: &[Row], algorithm: usize) -> f64 {
    of(rows, algorithm).last().map_or(f64::NAN, |row| 100.0 * row.brightness.value)
}

fn findings(rows: &[Row]) -> Vec<Finding> {
    let errors = |i: usize| -> Vec<f64> { of(rows, i).map(|row| row.error).collect() };
    let [casting, whitted] = [0, 1].map(errors);
    // Four times the samples halve the error of an unbiased picture.
    let gain = |errors: &[f64]| errors[errors.len() - 2] / errors[errors.len() - 1];
    let biased = |i: usize, errors: &[f64]| {
        format!(
            "RMS error {:.4} at 16 spp, {:.4} at 64: lower by {:.2} (without bias by 2; held below 1.5); brightness {:.1} % of \
             the truth",
            errors[errors.len() - 2],
            errors[errors.len() - 1],
            gain(errors),
            brightness(rows, i)
        )
    };
    let unbiased = || [2, 3].into_iter().flat_map(|i| of(rows, i)).map(|row| row.brightness);
    let slopes = [law(rows, 2), law(rows, 3)];
    let near_half = |law: &Option<PowerLaw>| law.is_some_and(|law| may_be(law, -0.5, 0.15));
    let costs = cost(rows, 2) / cost(rows, 3);
    vec![
        Finding::new(
            "Ray casting sees what is lit from points; it is biased, and more samples do not help.",
            biased(0, &casting),
            gain(&casting) < 1.5 && brightness(rows, 0) < 99.0,
        ),
        Finding::new(
            "Whitted's rays add mirrors and glass, but neither penumbrae nor light between diffuse surfaces: still biased.",
            biased(1, &whitted),
            gain(&whitted) < 1.5 && brightness(rows, 0) < brightness(rows, 1) && brightness(rows, 1) < 99.0,
        ),
        Finding::new(
            "Distribution ray tracing and path tracing estimate the same picture without bias: error falls as 1/√rays.",
            format!(
                "slopes {} and {} (held within 0.15 or its interval); brightness {:.2} % and {:.2} % of the truth (held within three standard \
                 errors)",
                slope(slopes[0]),
                slope(slopes[1]),
                brightness(rows, 2),
                brightness(rows, 3)
            ),
            slopes.iter().all(near_half) && unbiased().all(|brightness| brightness.agrees_with(1.0)),
        ),
        Finding::new(
            "One secondary ray at each surface and many camera rays (path tracing) is the better use of rays than a tree.",
            format!("for the same error the tree casts {costs:.2} times as many rays"),
            costs > 1.0,
        ),
    ]
}

/// Renders all four, and compares them.
pub fn run(options: &Options) -> Result<Found> {
    let studio = Studio::open(BALLS, options.scaled((32, 24), (120, 90)), options)?;
    let algorithms = algorithms(options);
    let reference = Sampling::new(SamplerKind::Sobol, options.scaled(512, 1024));
    let Shot { image: truth, noise, .. } = studio.shoot(&algorithms[3].settings, reference, 99)?;
    let rows = measure(&studio, &algorithms, &truth)?;
    let mut images: Vec<(String, &Image)> = Vec::new();
    for (i, algorithm) in algorithms.iter().enumerate() {
        if let Some(row) = of(&rows, i).last() {
            let rays = row.rays_per_pixel;
            images.push((format!("{}, {} spp, {rays:.0} rays a pixel", algorithm.name, row.spp), &row.image));
        }
    }
    images.push((format!("reference, path, {} spp", reference.spp), &truth));
    let note = format!(
        "Ray casting is whitted with paths of two edges; all others have {MAX_DEPTH}. distribution draws 4 emitter and 4 BSDF \
         samples at each surface. The reference has an RMS error of about {noise:.4}. Seconds depend on the machine."
    );
    let evidence = vec![
        Evidence::Text(note),
        Evidence::Table("Rays, time and error".into(), table(&algorithms, &rows)),
        Evidence::Plot(plot(&algorithms, &rows)),
        Evidence::Viewer(viewer("Ray casting, Whitted, distribution ray tracing, path tracing", images)?),
    ];
    Ok((findings(&rows), evidence))
}
