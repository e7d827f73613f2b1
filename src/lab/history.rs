//! The algorithms from ray casting to path tracing, on one scene.

use super::moments::Measured;
use super::outcome::{Evidence, Finding, plus_minus, slope};
use super::studio::{BALLS, Sampling, Shot, Studio, viewer};
use super::verdict::Check;
use super::{Found, Options};
use crate::error::Result;
use crate::estimate::convergence::PowerLaw;
use crate::estimate::metrics;
use crate::image::Image;
use crate::integrator::Settings;
use crate::integrator::settings::{DistributionSettings, PathLimits, PathSettings, WhittedSettings};
use crate::report::{Align, Axis, Line, Plot, Point, Series, Table};
use crate::sampling::SamplerKind;

/// The greatest number of edges of a path, for all algorithms but ray casting.
const MAX_DEPTH: u32 = 5;

/// An algorithm.
struct Algorithm {
    name: &'static str,
    settings: Settings,
    /// The numbers of samples per pixel to render with.
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
        algorithm(
            "path",
            Settings::Path(PathSettings::independent(path)),
            options.scaled(&[4, 16, 64], &[4, 16, 64, 256]),
        ),
    ]
}

/// The result of an algorithm at one number of samples.
struct AlgorithmRow {
    algorithm: usize,
    spp: u64,
    rays: f64,
    rays_per_pixel: f64,
    seconds: f64,
    /// Mean squared errors against the reference, one for each group of pixels.
    squares: Vec<f64>,
    /// RMS error against the reference.
    error: Measured,
    /// Mean of the image divided by the mean of the reference. The standard error is that of an unbiased image.
    brightness: Measured,
    image: Image,
}

/// The number of groups that the pixels of an image are divided into.
const GROUPS: usize = 10;

/// Returns the mean squared difference of two images for each group of pixels. Group k has every tenth pixel from k.
fn squares(image: &Image, truth: &Image) -> Vec<f64> {
    let pixels = || image.data.chunks_exact(3).zip(truth.data.chunks_exact(3));
    let square = |(a, b): (&[f32], &[f32])| metrics::mse(a, b);
    let group = |k| Measured::mean(&pixels().skip(k).step_by(GROUPS).map(square).collect::<Vec<_>>()).value;
    (0..GROUPS).map(group).collect()
}

/// Returns the mean of an image's values.
fn mean(image: &Image) -> f64 {
    image.data.iter().map(|&v| f64::from(v)).sum::<f64>() / image.data.len() as f64
}

fn measure(studio: &Studio, algorithms: &[Algorithm], truth: &Image) -> Result<Vec<AlgorithmRow>> {
    let mut rows = Vec::new();
    for (i, algorithm) in algorithms.iter().enumerate() {
        for &spp in &algorithm.spp {
            let sampling = Sampling::new(SamplerKind::Independent, spp);
            let Shot { image, counters, seconds, .. } = studio.shoot(&algorithm.settings, sampling, 0)?;
            let rays = (counters.closest_rays + counters.occlusion_rays) as f64;
            let squares = squares(&image, truth);
            let error = Measured::root(&squares);
            let pixels = (image.width * image.height) as f64;
            // Pixels are independent of each other; the colours of one pixel are not.
            let brightness = Measured {
                value: mean(&image) / mean(truth),
                error: error.value / pixels.sqrt() / mean(truth),
                freedom: pixels - 1.0,
            };
            rows.push(AlgorithmRow {
                algorithm: i,
                spp,
                rays,
                rays_per_pixel: rays / pixels,
                seconds,
                squares,
                error,
                brightness,
                image,
            });
        }
    }
    Ok(rows)
}

fn table(algorithms: &[Algorithm], rows: &[AlgorithmRow]) -> Table {
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
            format!("{:.4}", row.error.value),
            format!("{:.1} %", 100.0 * row.brightness.value),
        ]);
    }
    table
}

/// Returns the rows of one algorithm.
fn of(rows: &[AlgorithmRow], algorithm: usize) -> impl Iterator<Item = &AlgorithmRow> {
    rows.iter().filter(move |row| row.algorithm == algorithm)
}

fn law(rows: &[AlgorithmRow], algorithm: usize) -> Option<PowerLaw> {
    PowerLaw::fit(of(rows, algorithm).map(|row| (row.rays_per_pixel, row.error.value)))
}

fn plot(algorithms: &[Algorithm], rows: &[AlgorithmRow]) -> Plot {
    let series = algorithms.iter().enumerate().map(|(i, algorithm)| Series {
        name: format!("{}, slope {}", algorithm.name, slope(law(rows, i))),
        points: of(rows, i)
            .map(|row| Point {
                note: format!("{} spp", row.spp),
                ..Point::new(row.rays_per_pixel, row.error.value)
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

/// Returns the mean squared error of a row, over all groups of pixels or all but one.
fn mse(row: &AlgorithmRow, left_out: Option<usize>) -> f64 {
    let kept = row.squares.iter().enumerate().filter(|(group, _)| Some(*group) != left_out);
    Measured::mean(&kept.map(|(_, square)| *square).collect::<Vec<_>>()).value
}

/// Returns the number of rays times the squared error. For an unbiased estimator, it does not depend on the number of
/// samples.
fn cost(rows: &[AlgorithmRow], algorithm: usize, left_out: Option<usize>) -> f64 {
    let logs: Vec<f64> =
        of(rows, algorithm).map(|row| (row.rays_per_pixel * mse(row, left_out)).ln()).collect();
    Measured::mean(&logs).value.exp()
}

/// Returns the brightness of an algorithm's image with the most samples, relative to the reference.
fn brightness(rows: &[AlgorithmRow], algorithm: usize) -> Measured {
    of(rows, algorithm).last().map_or(Measured::NONE, |row| row.brightness)
}

fn findings(rows: &[AlgorithmRow]) -> Vec<Finding> {
    // Four times the samples halve the error of an unbiased image.
    let gain = |i: usize| {
        let rows: Vec<&AlgorithmRow> = of(rows, i).collect();
        let [few, many] = [rows[rows.len() - 2], rows[rows.len() - 1]];
        Measured::jackknife(GROUPS, |left_out| (mse(few, left_out) / mse(many, left_out)).sqrt())
    };
    let biased = |i: usize| {
        let errors: Vec<f64> = of(rows, i).map(|row| row.error.value).collect();
        format!(
            "RMS error {:.4} at 16 spp, {:.4} at 64: lower by {} (without bias by 2; allowed 1.5); brightness \
             {:.1} % of the truth (allowed 99 %)",
            errors[errors.len() - 2],
            errors[errors.len() - 1],
            plus_minus(gain(i)),
            100.0 * brightness(rows, i).value
        )
    };
    let unbiased = || [2, 3].into_iter().flat_map(|i| of(rows, i)).map(|row| row.brightness);
    let exponents = [2, 3].map(|i| {
        let points: Vec<_> = of(rows, i).map(|row| (row.rays_per_pixel, row.squares.as_slice())).collect();
        Measured::exponent(&points)
    });
    let same = unbiased().map(|brightness| Check::near(brightness, 1.0, 0.02));
    let same: Vec<Check> = exponents.map(|e| Check::near(e, -0.5, 0.15)).into_iter().chain(same).collect();
    let costs = Measured::jackknife(GROUPS, |left_out| cost(rows, 2, left_out) / cost(rows, 3, left_out));
    vec![
        Finding::new(
            "Ray casting sees what is lit from points; it is biased, and more samples do not help.",
            biased(0),
            &[Check::below(gain(0), 1.5), Check::below(brightness(rows, 0), 0.99)],
        ),
        Finding::new(
            "Whitted's rays add mirrors and glass, but neither penumbrae nor light between diffuse surfaces: \
             still biased.",
            biased(1),
            &[
                Check::below(gain(1), 1.5),
                Check::below(brightness(rows, 0).minus(brightness(rows, 1)), 0.0),
                Check::below(brightness(rows, 1), 0.99),
            ],
        ),
        Finding::new(
            "Distribution ray tracing and path tracing estimate the same picture without bias: error falls as 1/√rays.",
            format!(
                "slopes {} and {} (allowed 0.15); brightness {:.2} % and {:.2} % of the truth (allowed 2 %)",
                plus_minus(exponents[0]),
                plus_minus(exponents[1]),
                100.0 * brightness(rows, 2).value,
                100.0 * brightness(rows, 3).value
            ),
            &same,
        ),
        Finding::new(
            "One secondary ray at each surface and many camera rays (path tracing) is the better use of rays \
             than a tree.",
            format!("for the same error the tree casts {} times as many rays", plus_minus(costs)),
            &[Check::above(costs, 1.0)],
        ),
    ]
}

/// Renders with all four algorithms and compares them.
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
        "Ray casting is whitted with paths of two edges; all others have {MAX_DEPTH}. distribution draws 4 emitter \
         and 4 BSDF samples at each surface. The reference has an RMS error of about {noise:.4}. Seconds \
         depend on the machine."
    );
    let evidence = vec![
        Evidence::Text(note),
        Evidence::Table("Rays, time and error".into(), table(&algorithms, &rows)),
        Evidence::Plot(plot(&algorithms, &rows)),
        Evidence::Viewer(viewer("Ray casting, Whitted, distribution ray tracing, path tracing", images)?),
    ];
    Ok((findings(&rows), evidence))
}
