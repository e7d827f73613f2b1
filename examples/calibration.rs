//! Measures the coverage of the intervals of error estimates: `cargo run --release --example calibration -- 100`.
//!
//! Renders each scene with that many seeds. For each integrator, sampler and number of samples it prints the mean
//! relMSE, the mean estimate divided by it, the fraction of images with their error within the 95 % interval, the
//! fraction with their error below its upper end, the geometric means of the factors from the estimate to both ends,
//! and the bias. The error is that of noise alone: the difference from the mean of all other images. The bias is the
//! relMSE of the mean of all images against that of `path`, minus the noise of both. It is printed from the second
//! integrator on.
//!
//! Options: `--integrators LIST` (path,ptracer,sppm,irrcache,photonmapper,auto), `--samplers LIST`, `--spp LIST`,
//! `--target-errors LIST` (renders stop there, not after a number of samples), `--size N`, `--adaptive`, `--path-reuse
//! WHEN`; other arguments are scenes.

use buffon::accel::AccelKind;
use buffon::error::Error;
use buffon::estimate::metrics::RELATIVE_FLOOR;
use buffon::integrator::settings::WhenPays;
use buffon::render::{Progress, Rendered, StopRules};
use buffon::sampling::SamplerKind;
use buffon::session::{Choices, SceneChoices, SceneFile, Session, connected, default_threads};
use std::path::Path;

const SCENES: [&str; 5] = [
    "scenes/error/smooth.xml",
    "scenes/error/noisy.xml",
    "scenes/error/fireflies.xml",
    "scenes/cornell-box/cornell-box.xml",
    "scenes/spheres/spheres.xml",
];

struct Options {
    seeds: u64,
    size: u32,
    adaptive: WhenPays,
    path_reuse: Option<WhenPays>,
    integrators: Vec<String>,
    samplers: Vec<SamplerKind>,
    samples: Vec<u64>,
    /// The greatest errors of images, instead of numbers of samples.
    errors: Vec<f64>,
    scenes: Vec<String>,
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut options = Options {
        seeds: 100,
        size: 48,
        adaptive: WhenPays::Never,
        path_reuse: None,
        integrators: vec!["path".into()],
        samplers: vec![SamplerKind::Independent, SamplerKind::Sobol],
        samples: vec![64, 16],
        errors: Vec::new(),
        scenes: Vec::new(),
    };
    let mut arguments = std::env::args().skip(1);
    while let Some(argument) = arguments.next() {
        let mut list = || arguments.next().ok_or(format!("{argument}: expected a value"));
        match argument.as_str() {
            "--adaptive" => options.adaptive = WhenPays::Always,
            "--path-reuse" => options.path_reuse = Some(list()?.parse()?),
            "--size" => options.size = list()?.parse()?,
            "--integrators" => options.integrators = list()?.split(',').map(String::from).collect(),
            "--samplers" => {
                options.samplers = list()?.split(',').map(str::parse).collect::<Result<_, _>>()?
            }
            "--spp" => options.samples = list()?.split(',').map(str::parse).collect::<Result<_, _>>()?,
            "--target-errors" => {
                options.errors = list()?.split(',').map(str::parse).collect::<Result<_, _>>()?
            }
            number if number.parse::<u64>().is_ok_and(|n| n > 1) => options.seeds = number.parse()?,
            scene => options.scenes.push(scene.into()),
        }
    }
    if options.scenes.is_empty() {
        options.scenes = SCENES.map(String::from).to_vec();
    }
    println!(
        "{:<14} {:<12} {:<11} {:>6} {:>10} {:>9} {:>6} {:>6} {:>8} {:>8} {:>9}",
        "scene",
        "integrator",
        "sampler",
        "until",
        "relMSE",
        "estimate",
        "held",
        "upper",
        "to upper",
        "to lower",
        "bias"
    );
    for file in &options.scenes {
        calibrate(Path::new(file), &options)?;
    }
    Ok(())
}

fn calibrate(file: &Path, options: &Options) -> Result<(), Error> {
    let size = Some((options.size, options.size));
    let choices = SceneChoices { size, ..SceneChoices::default() };
    let session = SceneFile::load(file, &choices)?.compile(AccelKind::default(), default_threads())?;
    let name = file.file_stem().unwrap_or_default().to_string_lossy();
    let mut reference: Option<Seeds> = None;
    let until_error = |&error| (format!("{error}"), StopRules { error: Some(error), ..StopRules::default() });
    let until_samples =
        |&samples| (format!("{samples}"), StopRules { samples: Some(samples), ..StopRules::default() });
    let stops: Vec<(String, StopRules)> = match options.errors.is_empty() {
        true => options.samples.iter().map(until_samples).collect(),
        false => options.errors.iter().map(until_error).collect(),
    };
    for integrator in &options.integrators {
        for &sampler in &options.samplers {
            for (until, stop) in &stops {
                let seeds = Seeds::render(&session, integrator, sampler, *stop, options)?;
                let bias = reference.as_ref().map(|reference| seeds.bias(reference));
                let name = format!("{name:<14} {integrator:<12} {:<11} {until:>6}", sampler.name());
                seeds.print(&name, bias);
                // The first renders are the reference: those of the first number of samples or target error.
                reference.get_or_insert(seeds);
            }
        }
    }
    Ok(())
}

/// Renders that differ only by their seeds.
struct Seeds {
    renders: Vec<Rendered>,
    /// The values of the images, in the order of their tiles.
    images: Vec<Vec<f64>>,
    mean: Vec<f64>,
}

impl Seeds {
    fn render(
        session: &Session,
        integrator: &str,
        sampler: SamplerKind,
        stop: StopRules,
        options: &Options,
    ) -> Result<Self, Error> {
        let render = |seed| {
            let connections = connected(integrator);
            let (integrator, sampler) = (Some(integrator.to_string()), Some(sampler));
            let Options { adaptive, path_reuse, .. } = *options;
            let choices = Choices {
                integrator,
                connections,
                sampler,
                stop,
                seed,
                adaptive,
                path_reuse,
                ..Choices::default()
            };
            session.render(&session.plan(&choices)?, &Progress::new())
        };
        let renders = (0..options.seeds).map(render).collect::<Result<Vec<_>, _>>()?;
        let images: Vec<Vec<f64>> = renders.iter().map(values).collect();
        let mean = (0..images[0].len())
            .map(|i| images.iter().map(|image| image[i]).sum::<f64>() / images.len() as f64);
        let mean = mean.collect();
        Ok(Seeds { renders, images, mean })
    }

    /// Returns the error of each image against the mean of the others, corrected for the error of that mean.
    fn errors(&self) -> Vec<f64> {
        let n = self.images.len() as f64;
        let others = |image: &[f64], i: usize| (n * self.mean[i] - image[i]) / (n - 1.0);
        self.images.iter().map(|image| relmse(image, |i| others(image, i)) * (n - 1.0) / n).collect()
    }

    fn mean_error(&self) -> f64 {
        self.errors().iter().sum::<f64>() / self.images.len() as f64
    }

    /// Returns the relMSE of the mean image against that of other renders, minus the expected noise of both.
    fn bias(&self, reference: &Seeds) -> f64 {
        let noise = |seeds: &Seeds| seeds.mean_error() / seeds.images.len() as f64;
        relmse(&self.mean, |i| reference.mean[i]) - noise(self) - noise(reference)
    }

    fn print(&self, name: &str, bias: Option<f64>) {
        let errors = self.errors();
        let n = errors.len() as f64;
        let [mut estimate, mut held, mut upper, mut to_upper, mut to_lower] = [0.0; 5];
        for (render, &error) in self.renders.iter().zip(&errors) {
            let (Some(relmse), Some([low, high])) = (render.relmse, render.relmse_interval) else { continue };
            estimate += relmse / n;
            held += f64::from(u8::from((low..=high).contains(&error))) / n;
            upper += f64::from(u8::from(error <= high)) / n;
            to_upper += (high / relmse).ln() / n;
            to_lower += (relmse / low).ln() / n;
        }
        let error = self.mean_error();
        println!(
            "{name} {error:>10.3e} {:>9.3} {held:>6.3} {upper:>6.3} {:>8.3} {:>8.3} {:>9}",
            estimate / error,
            to_upper.exp(),
            to_lower.exp(),
            bias.map_or(String::new(), |bias| format!("{bias:.1e}"))
        );
    }
}

/// Returns all values of an image, in the order of its tiles.
fn values(rendered: &Rendered) -> Vec<f64> {
    let pixels = rendered.tiles.iter().flat_map(|tile| (0..tile.pixel_count()).map(move |i| (tile, i)));
    pixels.flat_map(|(tile, i)| [0, 1, 2].map(|c| tile.estimate(i, c).mean)).collect()
}

fn relmse(image: &[f64], truth: impl Fn(usize) -> f64) -> f64 {
    let errors = image.iter().enumerate().map(|(i, x)| {
        let r = truth(i);
        (x - r) * (x - r) / (r * r + RELATIVE_FLOOR)
    });
    errors.sum::<f64>() / image.len() as f64
}
