//! A rectangular emitter sampled by area, sampled by solid angle, and not sampled.

use super::moments::Measured;
use super::outcome::{Evidence, Finding, plus_minus, slope};
use super::studio::{BALLS, Sampling, Studio, viewer};
use super::verdict::Check;
use super::{Found, Options};
use crate::error::Result;
use crate::estimate::convergence::PowerLaw;
use crate::integrator::Settings;
use crate::integrator::settings::{DirectSettings, DistributionSettings, PathLimits, PathSettings};
use crate::report::{Align, Axis, Line, Plot, Point, Series, Table};
use crate::sampling::SamplerKind;
use std::f64::consts::PI;

const LAMP: &str = include_str!("scenes/lamp.xml");
/// The radiance of the emitter, W·m⁻²·sr⁻¹, and the reflectance of the floor.
const RADIANCE: f64 = 2.0;
const REFLECTANCE: f64 = 0.5;
/// The position of the receiver on the floor.
const RECEIVER: [f64; 2] = [0.3, 0.2];
/// Heights of the emitter above the floor. Half of its side is 1.
const HEIGHTS: [f64; 2] = [0.5, 4.0];

/// A way to sample the emitter.
#[derive(Clone, Copy, PartialEq)]
enum Way {
    Area,
    SolidAngle,
    NotAtAll,
}

impl Way {
    const ALL: [Way; 3] = [Way::Area, Way::SolidAngle, Way::NotAtAll];

    fn name(self) -> &'static str {
        match self {
            Way::Area => "by area",
            Way::SolidAngle => "by solid angle",
            Way::NotAtAll => "not at all",
        }
    }

    /// Returns the scene with the emitter at a height. A mesh is sampled by area, a rectangle by solid angle.
    fn scene(self, height: f64) -> String {
        let (shape, file) = match self {
            Way::Area => ("obj", "<string name=\"filename\" value=\"square.obj\"/>"),
            _ => ("rectangle", ""),
        };
        let lamp = format!(
            "<shape type=\"{shape}\">{file}<transform name=\"to_world\"><rotate x=\"1\" angle=\"180\"/>\
             <translate z=\"{height}\"/></transform>\
             <bsdf type=\"diffuse\"><rgb name=\"reflectance\" value=\"0\"/></bsdf>\
             <emitter type=\"area\"><rgb name=\"radiance\" value=\"{RADIANCE}\"/></emitter></shape>"
        );
        LAMP.replace("$LAMP", &lamp)
    }

    fn integrator(self) -> Settings {
        let lamp = u32::from(self != Way::NotAtAll);
        Settings::Direct(DirectSettings {
            emitter_samples: lamp,
            bsdf_samples: 1 - lamp,
            hide_emitters: false,
        })
    }
}

/// The square [−1, 1]² as two triangles.
const SQUARE: &str = "v -1 -1 0\nv 1 -1 0\nv 1 1 0\nv -1 1 0\nf 1 2 3\nf 1 3 4\n";

/// Returns the irradiance at a point below a corner of a parallel rectangle, divided by the rectangle's radiance. The
/// sides are a and b times the distance. [Siegel and Howell 1992, configuration B-4, times π]
fn corner(a: f64, b: f64) -> f64 {
    let (sa, sb) = ((1.0 + a * a).sqrt(), (1.0 + b * b).sqrt());
    0.5 * (a / sa * (b / sa).atan() + b / sb * (a / sb).atan())
}

/// Returns the exact radiance of the floor at the receiver.
fn exact(height: f64) -> f64 {
    let mut irradiance = 0.0;
    for sx in [-1.0, 1.0] {
        for sy in [-1.0, 1.0] {
            irradiance += corner((1.0 + sx * RECEIVER[0]) / height, (1.0 + sy * RECEIVER[1]) / height);
        }
    }
    REFLECTANCE / PI * RADIANCE * irradiance
}

/// The errors of one way at one height.
struct WayRow {
    way: Way,
    height: f64,
    /// Mean of all estimates.
    mean: Measured,
    /// RMS error relative to the truth at each number of samples.
    errors: Vec<(u64, Measured)>,
    law: Option<PowerLaw>,
}

fn measure(way: Way, height: f64, options: &Options) -> Result<WayRow> {
    let side = options.scaled(24, 64);
    let files = [("square.obj", SQUARE)];
    let studio = Studio::open_with(&way.scene(height), &files, (side, side), options)?;
    let exact = exact(height);
    let mut errors = Vec::new();
    let mut mean = Measured::NONE;
    for spp in (0..=4).map(|k| 1u64 << (2 * k)) {
        let image = studio.shoot(&way.integrator(), Sampling::new(SamplerKind::Independent, spp), spp)?.image;
        // Every pixel is an estimate of the same value.
        let values: Vec<f64> = image.data.chunks_exact(3).map(|pixel| f64::from(pixel[0])).collect();
        mean = Measured::mean(&values);
        let relative: Vec<f64> = values.iter().map(|v| v / exact - 1.0).collect();
        errors.push((spp, Measured::rms(&relative)));
    }
    let law = PowerLaw::fit(errors.iter().map(|(spp, e)| (*spp as f64, e.value)));
    Ok(WayRow { way, height, mean, errors, law })
}

fn table(rows: &[WayRow]) -> Table {
    let mut table = Table::new([
        ("lamp at height", Align::Right),
        ("sampled", Align::Left),
        ("mean of estimates", Align::Right),
        ("exact", Align::Right),
        ("relative RMS error, 1 sample", Align::Right),
        ("256 samples", Align::Right),
        ("slope", Align::Right),
    ]);
    for row in rows {
        table.row([
            row.height.to_string(),
            row.way.name().to_owned(),
            format!("{:.5} ± {:.5}", row.mean.value, 1.96 * row.mean.error),
            format!("{:.5}", exact(row.height)),
            format!("{:.4}", row.errors[0].1.value),
            format!("{:.4}", row.errors[row.errors.len() - 1].1.value),
            slope(row.law),
        ]);
    }
    table
}

fn plot(rows: &[WayRow], height: f64) -> Plot {
    let series = rows.iter().filter(|row| row.height == height).enumerate().map(|(i, row)| Series {
        name: row.way.name().into(),
        points: row.errors.iter().map(|(spp, e)| Point::new(*spp as f64, e.value)).collect(),
        style: i,
        line: Line::Solid,
    });
    Plot {
        title: format!("Relative RMS error of the light of a square lamp of side 2 at height {height}"),
        x: Axis::log("samples"),
        y: Axis::log("relative RMS error"),
        series: series.collect(),
    }
}

fn findings(rows: &[WayRow]) -> Vec<Finding> {
    let error = |way: Way, height: f64| {
        let row = rows.iter().find(|row| row.way == way && row.height == height);
        row.map_or(Measured::NONE, |row| row.errors[row.errors.len() - 1].1)
    };
    let [near, far] = HEIGHTS;
    let offs = rows.iter().map(|row| (row.mean.value - exact(row.height)).abs() / row.mean.error);
    let worst = offs.fold(0.0, f64::max);
    let near_gain = error(Way::Area, near).over(error(Way::SolidAngle, near));
    let far_gain = error(Way::NotAtAll, far).over(error(Way::SolidAngle, far));
    let means = rows.iter().map(|row| Check::near(row.mean, exact(row.height), 0.02 * exact(row.height)));
    vec![
        Finding::new(
            "Over area or over solid angle: with the right density every way estimates the same light.",
            format!(
                "the means of 256 samples are at most {worst:.1} standard errors off the closed form (allowed 2 %)"
            ),
            &means.collect::<Vec<_>>(),
        ),
        Finding::new(
            "Near a lamp, uniform points of its area are a worse density than uniform directions to it.",
            format!(
                "at height {near}, by area the error is {} times that by solid angle",
                plus_minus(near_gain)
            ),
            &[Check::above(near_gain, 1.0)],
        ),
        Finding::new(
            "A lamp that is small as seen from the surface must be sampled: rays in random directions rarely find it.",
            format!(
                "at height {far}, without sampling it the error is {} times as large (at least 3)",
                plus_minus(far_gain)
            ),
            &[Check::above(far_gain, 3.0)],
        ),
    ]
}

/// Path-traces an image with and without sampling the emitter, with the same number of samples.
fn pictures(options: &Options) -> Result<Evidence> {
    let studio = Studio::open(BALLS, options.scaled((48, 36), (120, 90)), options)?;
    let tree = |emitter_samples| {
        let tree =
            DistributionSettings { max_depth: 4, emitter_samples, bsdf_samples: 1, hide_emitters: false };
        Settings::Distribution(tree)
    };
    let path =
        Settings::Path(PathSettings::independent(PathLimits { max_depth: Some(4), ..PathLimits::default() }));
    let few = Sampling::new(SamplerKind::Independent, 16);
    let without = studio.shoot(&tree(0), few, 0)?.image;
    let with = studio.shoot(&tree(1), few, 0)?.image;
    let truth = studio.shoot(&path, Sampling::new(SamplerKind::Sobol, options.scaled(128, 512)), 99)?.image;
    let images = vec![
        ("lamp not sampled, 16 paths".to_owned(), &without),
        ("lamp sampled, 16 paths".to_owned(), &with),
        ("reference".to_owned(), &truth),
    ];
    Ok(Evidence::Viewer(viewer(
        "Paths that sample the lamp at every surface, and paths that do not",
        images,
    )?))
}

/// Measures the errors of every way at every height.
pub fn run(options: &Options) -> Result<Found> {
    let mut rows = Vec::new();
    for height in HEIGHTS {
        for way in Way::ALL {
            rows.push(measure(way, height, options)?);
        }
    }
    let mut evidence =
        vec![Evidence::Table("Light of a square lamp on a point of the floor".into(), table(&rows))];
    evidence.extend(HEIGHTS.map(|height| Evidence::Plot(plot(&rows, height))));
    evidence.push(pictures(options)?);
    Ok((findings(&rows), evidence))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An emitter that covers the whole sky gives π, a distant one A/d².
    #[test]
    fn the_closed_form_has_its_limits() {
        assert!((4.0 * corner(1e9, 1e9) - PI).abs() < 1e-8);
        assert!((4.0 * corner(1e-4, 1e-4) / 4e-8 - 1.0).abs() < 1e-7);
    }
}
