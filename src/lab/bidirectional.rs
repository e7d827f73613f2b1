//! The techniques of bidirectional path tracing: which light each of them finds. [Veach 1997, Figure 10.3]

use super::moments::Measured;
use super::outcome::{Evidence, Finding, plus_minus};
use super::studio::{LAMPS, Sampling, Studio, picture};
use super::verdict::Check;
use super::{Found, Options};
use crate::error::Result;
use crate::image::Image;
use crate::integrator::Settings;
use crate::integrator::settings::{BdptSettings, PathLimits, Technique, Techniques, techniques_with_edges};
use crate::report::{Align, Picture, Table, exposure_of};
use crate::sampling::SamplerKind;

/// The images of a technique: its part of the image, in independent takes, and all light that it can sample.
struct TechniqueImages {
    technique: Technique,
    parts: Vec<Image>,
    alone: Image,
}

impl TechniqueImages {
    /// Returns the number of edges of the paths.
    fn edges(&self) -> u32 {
        self.technique.light + self.technique.camera - 1
    }

    /// Returns the technique as in Veach's figure.
    fn name(&self) -> String {
        format!("s = {}, t = {}", self.technique.light, self.technique.camera)
    }
}

/// Renders all techniques of all lengths.
struct Experiment<'a> {
    studio: &'a Studio,
    limits: PathLimits,
    samples: u64,
    takes: u64,
}

impl Experiment<'_> {
    fn shoot(&self, techniques: Techniques, take: u64) -> Result<Image> {
        let settings =
            Settings::Bdpt(BdptSettings { limits: self.limits, techniques, ..BdptSettings::default() });
        let sampling = Sampling::new(SamplerKind::Sobol, self.samples);
        Ok(self.studio.shoot(&settings, sampling, take)?.image)
    }

    fn takes(&self, techniques: Techniques) -> Result<Vec<Image>> {
        (0..self.takes).map(|take| self.shoot(techniques, take)).collect()
    }

    fn techniques(&self, longest: u32) -> Result<Vec<TechniqueImages>> {
        let all = (1..=longest).flat_map(techniques_with_edges);
        all.map(|technique| {
            let parts = self.takes(Techniques::Weighted(technique))?;
            let alone = self.shoot(Techniques::Alone(technique), 0)?;
            Ok(TechniqueImages { technique, parts, alone })
        })
        .collect()
    }
}

/// A window of an image, in fractions of its size: left, top, right, bottom.
type Window = [f64; 4];

/// The whole image.
const ALL: Window = [0.0, 0.0, 1.0, 1.0];
/// The floor below the glass ball.
const CAUSTIC: Window = [0.62, 0.89, 0.73, 0.95];

/// Returns the sum of all values in a window.
fn light(image: &Image, [left, top, right, bottom]: Window) -> f64 {
    let (width, height) = (image.width as f64, image.height as f64);
    let inside = |i: usize| {
        let x = ((i / 3 % image.width) as f64 + 0.5) / width;
        let y = ((i / 3 / image.width) as f64 + 0.5) / height;
        (left..right).contains(&x) && (top..bottom).contains(&y)
    };
    image.data.iter().enumerate().filter(|(i, _)| inside(*i)).map(|(_, v)| f64::from(*v)).sum()
}

/// Returns the share of the light of all techniques in `all` that those in `some` bring to a window.
fn share<'a>(
    takes: u64,
    window: Window,
    all: impl Iterator<Item = &'a TechniqueImages> + Clone,
    some: impl Fn(&TechniqueImages) -> bool,
) -> Measured {
    let shares: Vec<f64> = (0..takes as usize)
        .map(|take| {
            let light = |images: &TechniqueImages| light(&images.parts[take], window);
            let part: f64 = all.clone().filter(|images| some(images)).map(light).sum();
            part / all.clone().map(light).sum::<f64>()
        })
        .collect();
    Measured::mean(&shares)
}

fn table(takes: u64, images: &[TechniqueImages]) -> Table {
    let mut table = Table::new([
        ("edges", Align::Right),
        ("technique", Align::Left),
        ("share of the light", Align::Right),
        ("in the caustic", Align::Right),
    ]);
    for one in images.iter().filter(|one| one.edges() > 1) {
        let of = |window| {
            let same = images.iter().filter(|other| other.edges() == one.edges());
            plus_minus(share(takes, window, same, |other| other.technique == one.technique))
        };
        table.row([one.edges().to_string(), one.name(), of(ALL), of(CAUSTIC)]);
    }
    table
}

/// Returns the small images of all techniques of one length, as parts of the image or alone. They are exposed for the
/// light of all paths of that length.
fn row(images: &[TechniqueImages], edges: u32, alone: bool) -> Result<Vec<Picture>> {
    let same = images.iter().filter(|images| images.edges() == edges);
    let sum = same.clone().map(|images| images.parts[0].clone()).reduce(|mut sum, part| {
        sum.data.iter_mut().zip(part.data).for_each(|(sum, part)| *sum += part);
        sum
    });
    let exposure = sum.map_or(0.0, |sum| exposure_of(&sum));
    same.map(|images| {
        let image = if alone { &images.alone } else { &images.parts[0] };
        picture(image, exposure, images.name(), if alone { "alone" } else { "weighted" })
    })
    .collect()
}

/// Renders the images of all techniques, and compares the light that they find.
pub fn run(options: &Options) -> Result<Found> {
    let studio = Studio::open(LAMPS, options.scaled((48, 36), (160, 120)), options)?;
    let longest = options.scaled(4, 5);
    let limits = PathLimits { max_depth: Some(longest), rr_depth: u32::MAX, hide_emitters: false };
    let experiment =
        Experiment { studio: &studio, limits, samples: options.scaled(8, 32), takes: options.scaled(4, 8) };
    let images = experiment.techniques(longest)?;
    let whole = experiment.takes(Techniques::All)?;
    let takes = experiment.takes;
    let sums: Vec<f64> = (0..takes as usize)
        .map(|take| {
            let parts: f64 = images.iter().map(|images| light(&images.parts[take], ALL)).sum();
            parts / light(&whole[take], ALL)
        })
        .collect();
    let (sum, of_edges) = (Measured::mean(&sums), |edges| images.iter().filter(move |i| i.edges() == edges));
    let hit = share(takes, ALL, of_edges(2), |images| images.technique.light == 0);
    let joined = share(takes, ALL, of_edges(3), |images| images.technique.light >= 2);
    let caustic = share(takes, CAUSTIC, of_edges(4), |images| images.technique.camera == 1);
    let findings = vec![
        Finding::new(
            "The weighted images of all techniques add up to the image.",
            format!("sum of their light / light of the image {}", plus_minus(sum)),
            &[Check::near(sum, 1.0, 1e-3)],
        ),
        Finding::new(
            "Camera paths that hit small lamps by chance (s = 0) bring nearly none of the direct light (two edges).",
            format!("share {}", plus_minus(hit)),
            &[Check::below(hit, 0.05)],
        ),
        Finding::new(
            "Light that a lamp throws at the ceiling (three edges) is found from the lamp (s ≥ 2).",
            format!("share {}", plus_minus(joined)),
            &[Check::above(joined, 0.5)],
        ),
        Finding::new(
            "The caustic (four edges: two through glass) is found by light paths that reach the camera (t = 1).",
            format!("share {}", plus_minus(caustic)),
            &[Check::above(caustic, 0.5)],
        ),
    ];
    let mut evidence = vec![
        Evidence::Text(
            "A technique joins a light path of s vertices and a camera path of t vertices. Weighted images are parts \
             of the image. An image of a technique alone has all light of paths that it can sample, with all its \
             noise: it is black where a lamp is too small to be hit, or where glass cannot be joined."
                .into(),
        ),
        Evidence::Table("Light of each technique, as a share of that of all with as many edges".into(), table(takes, &images)),
    ];
    let exposure = exposure_of(&whole[0]);
    for edges in 2..=longest {
        let title = |what| format!("Paths of {edges} edges, {what}");
        evidence.push(Evidence::Pictures(title("weighted"), row(&images, edges, false)?));
        evidence.push(Evidence::Pictures(title("each technique alone"), row(&images, edges, true)?));
    }
    evidence.push(Evidence::Pictures(
        "All techniques together".into(),
        vec![picture(&whole[0], exposure, "bdpt", format!("{} spp", experiment.samples))?],
    ));
    Ok((findings, evidence))
}
