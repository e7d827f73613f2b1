//! The power spectra of patterns, which determine their aliases.

use super::points::Pattern;
use crate::error::Result;
use crate::image::Image;
use crate::lab::moments::Measured;
use crate::lab::outcome::{Evidence, Finding, plus_minus};
use crate::lab::random::Stream;
use crate::lab::studio::picture;
use crate::lab::verdict::Check;
use crate::lab::{Found, Options};
use crate::report::{Axis, Line, Plot, Point, Series};
use rayon::prelude::*;
use std::f64::consts::TAU;

/// The side of the grid; a pattern has 64 points.
const SIDE: u32 = 8;
/// The highest frequency along each axis, in cycles over the square.
const HIGHEST: i32 = 32;
/// The highest low frequency: half the frequency of the grid. Energy below it becomes aliases of low frequency.
const LOW: f64 = 0.5 * SIDE as f64;

/// Creates independent patterns of one kind.
fn sets(pattern: Pattern, part: u32, options: &Options) -> Vec<Vec<[f64; 2]>> {
    let set = |run| pattern.points(SIDE, &mut Stream::new(options.seed, part, run));
    (0..(options.runs / 5).max(10)).map(set).collect()
}

/// Returns the power of a pattern at a frequency, |Σ exp(−2πi f·p)|²/n.
fn power(points: &[[f64; 2]], f: [f64; 2]) -> f64 {
    let (mut re, mut im) = (0.0, 0.0);
    for p in points {
        let (sin, cos) = (TAU * (f[0] * p[0] + f[1] * p[1])).sin_cos();
        (re, im) = (re + cos, im + sin);
    }
    (re * re + im * im) / points.len() as f64
}

/// Returns the mean power of a pattern at low frequencies.
fn low_power(points: &[[f64; 2]]) -> f64 {
    let most = LOW as i32;
    let all = (-most..=most).flat_map(|y| (-most..=most).map(move |x| [f64::from(x), f64::from(y)]));
    let low = all.filter(|[x, y]| (0.5..=LOW).contains(&x.hypot(*y)));
    Measured::mean(&low.map(|f| power(points, f)).collect::<Vec<_>>()).value
}

/// Returns the mean of |Σ exp(−2πi f·p)|²/n over many patterns, for all frequencies row by row. It is 1 for independent
/// points.
fn periodogram(pattern: Pattern, part: u32, options: &Options) -> Vec<f64> {
    let width = (2 * HIGHEST + 1) as usize;
    let sets = sets(pattern, part, options);
    (0..width * width)
        .into_par_iter()
        .map(|i| {
            let f = [i % width, i / width].map(|k| f64::from(k as i32 - HIGHEST));
            sets.iter().map(|points| power(points, f)).sum::<f64>() / sets.len() as f64
        })
        .collect()
}

/// Returns means over rings of frequencies, from 1 to the highest. The frequency 0 is left out, because its power is
/// the number of points.
fn radial(power: &[f64]) -> Vec<f64> {
    let width = (2 * HIGHEST + 1) as usize;
    let mut rings = vec![(0.0, 0.0); HIGHEST as usize + 1];
    for (i, p) in power.iter().enumerate() {
        let [x, y] = [i % width, i / width].map(|k| f64::from(k as i32 - HIGHEST));
        let ring = x.hypot(y).round() as usize;
        if (1..rings.len()).contains(&ring) {
            rings[ring] = (rings[ring].0 + p, rings[ring].1 + 1.0);
        }
    }
    rings[1..].iter().map(|(sum, n)| sum / n).collect()
}

/// Returns the power as a grey image in which 1 is half grey. Each frequency is a square of pixels.
fn shown(power: &[f64]) -> Image {
    let (width, zoom) = ((2 * HIGHEST + 1) as usize, 4);
    let mut image = Image::new(width * zoom, width * zoom, &["R", "G", "B"]);
    for y in 0..width * zoom {
        for x in 0..width * zoom {
            let p = power[(y / zoom) * width + x / zoom];
            image.pixel_mut(x, y).fill((0.2 * p).min(1.0) as f32);
        }
    }
    image
}

/// Plots the points of a pattern.
fn points_of(pattern: Pattern, style: usize, seed: u64) -> Plot {
    let points = pattern.points(SIDE, &mut Stream::new(seed, 750, 0));
    let points = points.into_iter().map(|[x, y]| Point::new(x, y)).collect();
    Plot {
        title: format!("64 {} points", pattern.name()),
        x: Axis::linear("x"),
        y: Axis::linear("y"),
        series: vec![Series { name: pattern.name().into(), points, style, line: Line::None }],
    }
}

/// Measures the spectra of the patterns and compares their aliases.
pub fn run(options: &Options) -> Result<Found> {
    let (mut pictures, mut series, mut low, mut evidence) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    for (i, pattern) in Pattern::ALL.into_iter().enumerate() {
        let power = periodogram(pattern, 700 + i as u32, options);
        pictures.push(picture(&shown(&power), 0.0, pattern.name(), "frequency 0 in the middle")?);
        evidence.push(Evidence::Plot(points_of(pattern, i, options.seed)));
        if pattern == Pattern::Regular {
            continue;
        }
        let rings = radial(&power);
        let sets = sets(pattern, 700 + i as u32, options);
        low.push(Measured::mean(&sets.iter().map(|points| low_power(points)).collect::<Vec<_>>()));
        let points = rings.iter().zip(1..).map(|(p, f)| Point::new(f64::from(f), *p)).collect();
        series.push(Series { name: pattern.name().into(), points, style: i, line: Line::Solid });
    }
    evidence.push(Evidence::Pictures("Mean spectra of 64 points".into(), pictures));
    evidence.push(Evidence::Plot(Plot {
        title: "Power by frequency: 1 is white noise".into(),
        x: Axis::linear("cycles over the square"),
        y: Axis::linear("power"),
        series,
    }));
    let finding = Finding::new(
        "Jittered and Poisson-disk-like samples turn aliases into noise of high frequency: they have \
         little power at low ones.",
        format!(
            "mean power up to {LOW} cycles, over that of white noise: random {}, jittered {}, Poisson-disk-like {} \
             (allowed: random within 0.2 of 1, the others below 0.5)",
            plus_minus(low[0]),
            plus_minus(low[1]),
            plus_minus(low[2])
        ),
        &[Check::near(low[0], 1.0, 0.2), Check::below(low[1], 0.5), Check::below(low[2], 0.5)],
    );
    Ok((vec![finding], evidence))
}
