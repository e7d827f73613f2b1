//! Antialiasing with each pattern: an edge through a pixel, a zone plate, and the discrepancy.

use super::points::{Pattern, discrepancy};
use crate::error::Result;
use crate::estimate::convergence::PowerLaw;
use crate::image::Image;
use crate::lab::moments::Measured;
use crate::lab::outcome::{Evidence, Finding, plus_minus, slope};
use crate::lab::random::Stream;
use crate::lab::studio::picture;
use crate::lab::verdict::Check;
use crate::lab::{Found, Options};
use crate::report::{Align, Axis, Line, Plot, Point, Series, Table};
use rayon::prelude::*;
use std::f64::consts::{PI, TAU};

/// The number of samples on the side of each grid. The number of samples is its square.
const SIDES: [u32; 5] = [1, 2, 4, 8, 16];
/// The index of the grid for the findings and the table: 16 samples.
const TYPICAL: usize = 2;

/// An edge that covers the points with `normal · p < offset`.
struct Edge {
    normal: [f64; 2],
    offset: f64,
}

impl Edge {
    /// Creates an edge through a uniform point of the pixel, in a uniform direction.
    fn random(stream: &mut Stream) -> Self {
        let (sin, cos) = (TAU * stream.uniform()).sin_cos();
        let p = [stream.uniform(), stream.uniform()];
        Edge { normal: [cos, sin], offset: cos * p[0] + sin * p[1] }
    }

    fn side(&self, p: [f64; 2]) -> f64 {
        self.normal[0] * p[0] + self.normal[1] * p[1] - self.offset
    }

    /// Returns the covered area of the unit square.
    fn coverage(&self) -> f64 {
        let square = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];
        let mut clipped: Vec<[f64; 2]> = Vec::new();
        for (i, &a) in square.iter().enumerate() {
            let b = square[(i + 1) % 4];
            let (da, db) = (self.side(a), self.side(b));
            if da < 0.0 {
                clipped.push(a);
            }
            if (da < 0.0) != (db < 0.0) {
                let t = da / (da - db);
                clipped.push([a[0] + t * (b[0] - a[0]), a[1] + t * (b[1] - a[1])]);
            }
        }
        let next = clipped.iter().cycle().skip(1);
        0.5 * clipped.iter().zip(next).map(|(a, b)| a[0] * b[1] - a[1] * b[0]).sum::<f64>()
    }

    fn estimate(&self, points: &[[f64; 2]]) -> f64 {
        points.iter().filter(|&&p| self.side(p) < 0.0).count() as f64 / points.len() as f64
    }
}

/// The errors of a pattern at each number of samples.
struct PatternRow {
    pattern: Pattern,
    /// RMS error of the coverage of a random edge.
    edge: Vec<Measured>,
    discrepancy: Vec<f64>,
    law: Option<PowerLaw>,
    /// The exponent of the law, with an error from the runs.
    exponent: Measured,
}

fn measure(i: usize, options: &Options) -> PatternRow {
    let pattern = Pattern::ALL[i];
    let of = |(k, &side): (usize, &u32)| {
        let one = |run| {
            let stream = &mut Stream::new(options.seed, 600 + 10 * i as u32 + k as u32, run);
            let edge = Edge::random(stream);
            let points = pattern.points(side, stream);
            [edge.estimate(&points) - edge.coverage(), discrepancy(&points)]
        };
        let values: Vec<[f64; 2]> = (0..2 * options.runs).into_par_iter().map(one).collect();
        let [errors, discrepancies] = [0, 1].map(|j| values.iter().map(|v| v[j]).collect::<Vec<f64>>());
        (errors.iter().map(|e| e * e).collect::<Vec<f64>>(), Measured::mean(&discrepancies).value)
    };
    let (squares, discrepancy): (Vec<Vec<f64>>, Vec<f64>) = SIDES.iter().enumerate().map(of).unzip();
    let edge: Vec<Measured> = squares.iter().map(|squares| Measured::root(squares)).collect();
    let law = PowerLaw::fit(SIDES.iter().zip(&edge).map(|(&side, e)| (f64::from(side * side), e.value)));
    let points = SIDES.iter().zip(&squares).map(|(&side, s)| (f64::from(side * side), s.as_slice()));
    let exponent = Measured::exponent(&points.collect::<Vec<_>>());
    PatternRow { pattern, edge, discrepancy, law, exponent }
}

/// Returns the brightness of a zone plate: rings around a corner of the image, with a frequency that grows to 0.7
/// cycles per pixel at the opposite corner.
fn rings([x, y]: [f64; 2], width: usize) -> f64 {
    let width = width as f64;
    0.5 + 0.5 * (PI * 0.5 * (x * x + y * y) / width).cos()
}

/// Renders the zone plate with `side`² samples per pixel.
fn plate(pattern: Pattern, side: u32, width: usize, seed: u64) -> Image {
    let mut image = Image::new(width, width, &["R", "G", "B"]);
    image.data.par_chunks_exact_mut(3).enumerate().for_each(|(i, pixel)| {
        let corner = [(i % width) as f64, (i / width) as f64];
        let points = pattern.points(side, &mut Stream::new(seed, 690, i as u32));
        let sum: f64 = points.iter().map(|p| rings([corner[0] + p[0], corner[1] + p[1]], width)).sum();
        pixel.fill((sum / points.len() as f64) as f32);
    });
    image
}

fn table(rows: &[PatternRow]) -> Table {
    let mut table = Table::new([
        ("pattern", Align::Left),
        ("edge, RMS error at 16", Align::Right),
        ("at 256", Align::Right),
        ("slope", Align::Right),
        ("discrepancy at 16", Align::Right),
        ("at 256", Align::Right),
    ]);
    for row in rows {
        table.row([
            row.pattern.name().to_owned(),
            format!("{:.4}", row.edge[TYPICAL].value),
            format!("{:.4}", row.edge[SIDES.len() - 1].value),
            slope(row.law),
            format!("{:.4}", row.discrepancy[TYPICAL]),
            format!("{:.4}", row.discrepancy[SIDES.len() - 1]),
        ]);
    }
    table
}

fn plot(rows: &[PatternRow]) -> Plot {
    let series = rows.iter().enumerate().map(|(i, row)| Series {
        name: format!("{}, slope {}", row.pattern.name(), slope(row.law)),
        points: SIDES
            .iter()
            .zip(&row.edge)
            .map(|(&side, e)| Point::new(f64::from(side * side), e.value))
            .collect(),
        style: i,
        line: Line::Solid,
    });
    Plot {
        title: "RMS error of the coverage of a pixel by a random edge".into(),
        x: Axis::log("samples per pixel"),
        y: Axis::log("RMS error"),
        series: series.collect(),
    }
}

fn findings(rows: &[PatternRow]) -> Vec<Finding> {
    let of = |pattern: Pattern| rows.iter().find(|row| row.pattern == pattern);
    let at = |pattern| of(pattern).map_or(Measured::NONE, |row| row.edge[TYPICAL]);
    let exponent = |pattern| of(pattern).map_or(Measured::NONE, |row| row.exponent);
    let [jittered, disk] =
        [Pattern::Jittered, Pattern::BestCandidate].map(|p| at(Pattern::Random).over(at(p)));
    vec![
        Finding::new(
            "Jittered samples have a lower variance than random ones.",
            format!(
                "16 samples of a pixel with an edge: the error of random ones is {} times as large",
                plus_minus(jittered)
            ),
            &[Check::above(jittered, 1.0)],
        ),
        Finding::new(
            "Of an edge, jittering finds the coverage with an error that falls as N to the power −3/4, \
             random samples −1/2.",
            format!(
                "slopes {} and {} (allowed 0.05)",
                plus_minus(exponent(Pattern::Jittered)),
                plus_minus(exponent(Pattern::Random))
            ),
            &[
                Check::near(exponent(Pattern::Jittered), -0.75, 0.05),
                Check::near(exponent(Pattern::Random), -0.5, 0.05),
            ],
        ),
        Finding::new(
            "Samples that keep their distance (Poisson-disk-like) beat random ones, too.",
            format!(
                "16 samples of a pixel with an edge: the error of random ones is {} times as large",
                plus_minus(disk)
            ),
            &[Check::above(disk, 1.0)],
        ),
    ]
}

/// Measures the errors of every pattern and shows the zone plate.
pub fn run(options: &Options) -> Result<Found> {
    let rows: Vec<PatternRow> = (0..Pattern::ALL.len()).map(|i| measure(i, options)).collect();
    let (side, width) = (2, options.scaled(128, 256));
    let mut pictures = Vec::new();
    for pattern in Pattern::ALL {
        let image = plate(pattern, side, width, options.seed);
        let note = match pattern {
            Pattern::Regular => "aliases: rings that are not there",
            _ => "noise instead",
        };
        pictures.push(picture(&image, 0.0, pattern.name(), note)?);
    }
    let evidence = vec![
        Evidence::Table("Patterns in a pixel".into(), table(&rows)),
        Evidence::Plot(plot(&rows)),
        Evidence::Pictures(
            "Rings that get finer to the right and below, 4 samples per pixel".into(),
            pictures,
        ),
    ];
    Ok((findings(&rows), evidence))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn coverage_is_the_area_of_the_clipped_square() {
        let covered = |normal, offset| Edge { normal, offset }.coverage();
        assert!((covered([1.0, 0.0], 0.3) - 0.3).abs() < 1e-12);
        assert!((covered([0.0, -1.0], -0.3) - 0.7).abs() < 1e-12);
        let s = 0.5f64.sqrt();
        assert!((covered([s, s], s) - 0.5).abs() < 1e-12);
        assert!((covered([s, s], 0.5 * s) - 0.125).abs() < 1e-12);
        assert_eq!((covered([1.0, 0.0], 2.0), covered([1.0, 0.0], -1.0)), (1.0, 0.0));
    }
}
