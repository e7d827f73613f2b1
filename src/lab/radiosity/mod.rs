//! Finite elements against Monte Carlo: the light in a diffuse cube by radiosity and by path tracing.

mod form_factors;
mod solve;

use self::form_factors::{Element, by_ray_casting, closed_forms, elements};
use self::solve::Equation;
use super::moments::Measured;
use super::outcome::{Evidence, Finding, plus_minus};
use super::random::Stream;
use super::studio::{Sampling, Shot, Studio, viewer};
use super::verdict::Check;
use super::{Found, Options};
use crate::error::Result;
use crate::estimate::convergence::PowerLaw;
use crate::image::Image;
use crate::integrator::Settings;
use crate::integrator::settings::{PathLimits, PathSettings};
use crate::report::{Axis, Line, Plot, Point, Series};
use crate::sampling::SamplerKind;
use std::fmt::Write;
use std::time::Instant;

/// The reflectances of the faces x = 0, x = 1, floor, ceiling, z = 0, z = 1.
const REFLECTANCES: [f64; 6] = [0.2, 0.7, 0.5, 0.6, 0.65, 0.4];
/// The face that emits the radiance 1 where x < 1/2.
const CEILING: usize = 3;
/// The faces seen by the cameras: the wall x = 1, the floor and the wall z = 0.
const VIEWS: [usize; 3] = [1, 2, 4];
/// Pixels along each side of a face.
const PIXELS: usize = 16;
/// The residual of the solutions, relative to the emission.
const TOLERANCE: f64 = 1e-4;

/// Returns the vector with the given value along an axis.
fn along(axis: usize, value: f64) -> [f64; 3] {
    std::array::from_fn(|k| if k == axis { value } else { 0.0 })
}

/// Returns the text of a point for the scene language.
fn text([x, y, z]: [f64; 3]) -> String {
    format!("{x},{y},{z}")
}

/// Returns the upward direction of the image of a face.
fn up(face: usize) -> [f64; 3] {
    along(if face / 2 == 1 { 2 } else { 1 }, 1.0)
}

/// Returns the scene, seen by an orthographic camera that covers a face. Its pixels are elements.
fn scene(view: usize) -> String {
    let mut xml = String::from("<scene version=\"3.0.0\">");
    let look = |from: [f64; 3], direction: [f64; 3], face: usize| {
        let target = std::array::from_fn(|k| from[k] + direction[k]);
        format!("<lookat origin=\"{}\" target=\"{}\" up=\"{}\"/>", text(from), text(target), text(up(face)))
    };
    for (face, reflectance) in REFLECTANCES.into_iter().enumerate() {
        let (axis, side) = (face / 2, (face % 2) as f64);
        let inward = along(axis, 1.0 - 2.0 * side);
        // The ceiling has two halves.
        let parts: &[(f64, f64)] =
            if face == CEILING { &[(0.25, 0.25), (0.25, 0.75)] } else { &[(0.5, 0.5)] };
        for (part, (half, x)) in parts.iter().enumerate() {
            let mut centre = [0.5; 3];
            centre[axis] = side;
            if face == CEILING {
                centre[0] = *x;
            }
            let emitter = if face == CEILING && part == 0 {
                "<emitter type=\"area\"><rgb name=\"radiance\" value=\"1\"/></emitter>"
            } else {
                ""
            };
            let _ = write!(
                xml,
                "<shape type=\"rectangle\"><transform name=\"to_world\"><scale x=\"{half}\" y=\"0.5\"/>{}</transform>\
                 <bsdf type=\"diffuse\"><rgb name=\"reflectance\" value=\"{}\"/></bsdf>{emitter}</shape>",
                look(centre, inward, face),
                reflectance
            );
        }
    }
    let (axis, side) = (view / 2, (view % 2) as f64);
    let mut from = [0.5; 3];
    from[axis] = 1.0 - side;
    let _ = write!(
        xml,
        "<sensor type=\"orthographic\"><float name=\"near_clip\" value=\"0.001\"/>\
         <transform name=\"to_world\"><scale x=\"0.5\" y=\"0.5\"/>{}</transform>\
         <film type=\"hdrfilm\"><string name=\"pixel_format\" value=\"rgb\"/>\
         <string name=\"component_format\" value=\"float32\"/><rfilter type=\"box\"/></film></sensor></scene>",
        look(from, along(axis, 2.0 * side - 1.0), view)
    );
    xml
}

/// Returns the position on the face of the view at the centre of a pixel.
fn position(view: usize, x: usize, y: usize) -> [f64; 3] {
    let (axis, side) = (view / 2, (view % 2) as f64);
    let (direction, up) = (along(axis, 2.0 * side - 1.0), up(view));
    let left: [f64; 3] = std::array::from_fn(|k| {
        let [a, b] = [(k + 1) % 3, (k + 2) % 3];
        up[a] * direction[b] - up[b] * direction[a]
    });
    let [x, y] = [x, y].map(|i| (i as f64 + 0.5) / PIXELS as f64 - 0.5);
    std::array::from_fn(|k| if k == axis { side } else { 0.5 - left[k] * x - up[k] * y })
}

/// Radiances by finite elements, and their cost.
struct Radiosity {
    n: usize,
    /// The radiance of each element.
    radiance: Vec<f64>,
    seconds: f64,
    /// Elements updated by Jacobi iteration and by Southwell relaxation.
    updates: [u64; 2],
    /// The greatest difference of the sum of an element's form factors from 1.
    incomplete: f64,
}

impl Radiosity {
    fn new(n: usize) -> Self {
        let start = Instant::now();
        let elements = elements(n);
        let face = |element: &Element| 2 * element.axis + element.side as usize;
        let emits = |element: &Element| face(element) == CEILING && element.centre()[0] < 0.5;
        let equation = Equation {
            emission: elements.iter().map(|element| f64::from(u8::from(emits(element)))).collect(),
            reflectance: elements.iter().map(|element| REFLECTANCES[face(element)]).collect(),
            form_factors: closed_forms(&elements),
        };
        let southwell = equation.southwell(TOLERANCE);
        let seconds = start.elapsed().as_secs_f64();
        let updates = [equation.jacobi(TOLERANCE).updates, southwell.updates];
        let sums = equation.form_factors.chunks(elements.len()).map(|row| row.iter().sum::<f64>());
        let incomplete = sums.fold(0.0, |most: f64, sum| most.max((sum - 1.0).abs()));
        Radiosity { n, radiance: southwell.radiosity, seconds, updates, incomplete }
    }

    /// Returns the image of a view: the radiance of the element of each pixel, or the mean of its elements.
    fn image(&self, view: usize, like: &Image) -> Image {
        let mut image = like.clone();
        for (i, pixel) in image.data.chunks_exact_mut(3).enumerate() {
            let p = position(view, i % PIXELS, i / PIXELS);
            let axis = view / 2;
            let cell = |k: usize| ((p[k] * self.n as f64) as usize).min(self.n - 1);
            let element = view * self.n * self.n + cell((axis + 2) % 3) * self.n + cell((axis + 1) % 3);
            pixel.fill(self.radiance[element] as f32);
        }
        image
    }
}

/// The mean squared error of images of all views, relative to the squared mean of the reference.
fn error(images: &[Image], truth: &[Image]) -> f64 {
    let pairs = || images.iter().zip(truth).flat_map(|(a, b)| a.data.iter().zip(&b.data));
    let square: f64 = pairs().map(|(a, b)| f64::from(a - b).powi(2)).sum();
    let norm: f64 = pairs().map(|(_, b)| f64::from(*b).powi(2)).sum();
    (square / norm).sqrt()
}

/// Measures the error of form factors by ray casting.
fn ray_casting(options: &Options) -> Measured {
    let n = 2;
    let elements = elements(n);
    let exact = &closed_forms(&elements)[..elements.len()];
    let runs = options.runs.min(200);
    let squares: Vec<(f64, Vec<f64>)> = [16, 64, 256, 1024]
        .into_iter()
        .map(|rays| {
            let run = |run| {
                let found = by_ray_casting(&elements[0], n, rays, &mut Stream::new(options.seed, rays, run));
                found.iter().zip(exact).map(|(a, b)| (a - b).powi(2)).sum::<f64>()
            };
            (f64::from(rays), (0..runs).map(run).collect())
        })
        .collect();
    Measured::exponent(&squares.iter().map(|(rays, squares)| (*rays, squares.as_slice())).collect::<Vec<_>>())
}

/// Solves the radiosity equation, traces paths, and compares both.
pub fn run(options: &Options) -> Result<Found> {
    let limits = PathLimits { max_depth: None, rr_depth: 5, hide_emitters: false };
    let path = Settings::Path(PathSettings::independent(limits));
    let size = (PIXELS as u32, PIXELS as u32);
    let studios = VIEWS.map(|view| Studio::open(&scene(view), size, options));
    let studios: Vec<Studio> = studios.into_iter().collect::<Result<_>>()?;
    let shoot = |kind, spp, take| -> Result<Vec<Shot>> {
        studios.iter().map(|studio| studio.shoot(&path, Sampling::new(kind, spp), take)).collect()
    };
    let reference = shoot(SamplerKind::Sobol, options.scaled(1024, 16_384), 99)?;
    let truth: Vec<Image> = reference.iter().map(|shot| shot.image.clone()).collect();
    let mut traced = Vec::new();
    for spp in options.scaled([4, 16, 64, 256], [16, 64, 256, 1024]) {
        let shots = shoot(SamplerKind::Independent, spp, 0)?;
        let seconds: f64 = shots.iter().map(|shot| shot.seconds).sum();
        let images: Vec<Image> = shots.into_iter().map(|shot| shot.image).collect();
        traced.push((spp, seconds, error(&images, &truth)));
    }
    let solved: Vec<Radiosity> =
        options.scaled(vec![2, 4, 8], vec![2, 4, 8, 16]).into_iter().map(Radiosity::new).collect();
    let images = |radiosity: &Radiosity| -> Vec<Image> {
        VIEWS.iter().zip(&truth).map(|(view, like)| radiosity.image(*view, like)).collect()
    };
    let errors: Vec<f64> = solved.iter().map(|radiosity| error(&images(radiosity), &truth)).collect();
    let finest = solved.last().expect("there are several");
    let finest_images = images(finest);
    let mean =
        |image: &Image| image.data.iter().map(|v| f64::from(*v)).sum::<f64>() / image.data.len() as f64;
    let ratios: Vec<Measured> = reference
        .iter()
        .zip(&finest_images)
        .map(|(shot, image)| {
            let (pixels, truth) = ((PIXELS * PIXELS) as f64, mean(&shot.image));
            let value = mean(image) / truth;
            Measured { value, error: shot.noise / pixels.sqrt() / truth, freedom: pixels - 1.0 }
        })
        .collect();
    let exact = |value| Measured { value, error: 0.0, freedom: 9.0 };
    let cast = ray_casting(options);
    let findings = vec![
        Finding::new(
            "The closed forms of parallel and perpendicular squares are complete: the form factors of an element sum to 1.",
            format!("greatest difference {:.1e}", finest.incomplete),
            &[Check::below(exact(finest.incomplete), 1e-9)],
        ),
        Finding::new(
            "Form factors by ray casting converge to the closed forms as 1/√rays.",
            format!("exponent {} (allowed 0.05)", plus_minus(cast)),
            &[Check::near(cast, -0.5, 0.05)],
        ),
        Finding::new(
            "Radiosity and path tracing find the same light.",
            format!(
                "means by radiosity / by path tracing, for the wall x = 1, the floor and the wall z = 0: {} (allowed 1 %)",
                ratios.iter().map(|ratio| plus_minus(*ratio)).collect::<Vec<_>>().join(", ")
            ),
            &ratios.iter().map(|ratio| Check::near(*ratio, 1.0, 0.01)).collect::<Vec<_>>(),
        ),
        Finding::new(
            "The error of radiosity is that of its elements: finer ones have less.",
            format!(
                "relative RMS errors {}",
                errors.iter().map(|e| format!("{e:.4}")).collect::<Vec<_>>().join(", ")
            ),
            &errors.windows(2).map(|pair| Check::below(exact(pair[1] / pair[0]), 1.0)).collect::<Vec<_>>(),
        ),
        Finding::new(
            "Southwell's relaxation, which shoots the most light first, updates fewer elements than Jacobi's iteration.",
            format!("{} updates instead of {}", finest.updates[1], finest.updates[0]),
            &[Check::below(exact(finest.updates[1] as f64 / finest.updates[0] as f64), 1.0)],
        ),
    ];
    let series = |name: &str, style: usize, points: Vec<Point>| Series {
        name: name.into(),
        points,
        style,
        line: Line::Solid,
    };
    let law = PowerLaw::fit(traced.iter().map(|(_, seconds, error)| (*seconds, *error)));
    let plot = Plot {
        title: "Relative RMS error against time".into(),
        x: Axis::log("seconds"),
        y: Axis::log("relative RMS error"),
        series: vec![
            series(
                "radiosity, n × n elements on each face",
                0,
                solved
                    .iter()
                    .zip(&errors)
                    .map(|(radiosity, error)| Point {
                        note: format!("n = {}", radiosity.n),
                        ..Point::new(radiosity.seconds, *error)
                    })
                    .collect(),
            ),
            series(
                &format!("path tracing, slope {}", super::outcome::slope(law)),
                1,
                traced
                    .iter()
                    .map(|(spp, seconds, error)| Point {
                        note: format!("{spp} spp"),
                        ..Point::new(*seconds, *error)
                    })
                    .collect(),
            ),
        ],
    };
    let floor = 1;
    let views = vec![
        (format!("floor, radiosity, {0} × {0} elements", finest.n), &finest_images[floor]),
        (format!("floor, path tracing, {} spp", options.scaled(1024, 16_384)), &truth[floor]),
    ];
    let note = format!(
        "A closed diffuse cube whose ceiling emits on one half. Radiosity computes all faces and both sides of every \
         exchange once, and stores {0} form factors for {1} elements; path tracing stores nothing, and works for all \
         materials. The error of radiosity is compared at the pixels of the reference, {PIXELS} × {PIXELS} for each face. \
         Seconds depend on the machine.",
        finest.radiance.len().pow(2),
        finest.radiance.len()
    );
    let evidence = vec![
        Evidence::Text(note),
        Evidence::Plot(plot),
        Evidence::Viewer(viewer("The floor by finite elements, and by path tracing", views)?),
    ];
    Ok((findings, evidence))
}
