//! How often the interval of an error estimate holds the true error: `cargo run --release --example calibration -- 300`.
//!
//! Renders each scene with that many seeds and prints, for each sampler and number of samples: the mean true relMSE, the
//! mean estimate over it, how often the 95 % interval held the true error of its own image and how often its upper
//! end did, and the geometric mean of the factors from the estimate to either end. The truth is the mean of all other
//! images of the most samples. `--adaptive` asks the same of adaptive sampling, `--size N` of larger images; other
//! arguments are scenes.

use buffon::accel::AccelKind;
use buffon::integrator;
use buffon::loader::{LoadOptions, load};
use buffon::render::{Job, JobSettings, Progress, Rendered, StopRules};
use buffon::sampling::{Sampler, SamplerKind};
use buffon::scene::{CompileOptions, Scene, compile};
use std::path::Path;

const SCENES: [&str; 5] = [
    "scenes/error/smooth.xml",
    "scenes/error/noisy.xml",
    "scenes/error/fireflies.xml",
    "scenes/cornell-box/cornell-box.xml",
    "scenes/spheres/spheres.xml",
];
const SAMPLES: [u64; 3] = [64, 16, 4];

struct Options {
    seeds: u64,
    size: u32,
    adaptive: bool,
    scenes: Vec<String>,
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut options = Options { seeds: 100, size: 48, adaptive: false, scenes: Vec::new() };
    let mut arguments = std::env::args().skip(1);
    while let Some(argument) = arguments.next() {
        match argument.as_str() {
            "--adaptive" => options.adaptive = true,
            "--size" => options.size = arguments.next().ok_or("--size: expected a number")?.parse()?,
            number if number.parse::<u64>().is_ok_and(|n| n > 1) => options.seeds = number.parse()?,
            scene => options.scenes.push(scene.into()),
        }
    }
    if options.scenes.is_empty() {
        options.scenes = SCENES.map(String::from).to_vec();
    }
    println!(
        "{:<12} {:<12} {:>4} {:>10} {:>9} {:>6} {:>6} {:>8} {:>8}",
        "scene", "sampler", "spp", "relMSE", "estimate", "held", "upper", "to upper", "to lower"
    );
    for file in &options.scenes {
        calibrate(Path::new(file), &options)?;
    }
    Ok(())
}

fn calibrate(file: &Path, options: &Options) -> Result<(), Box<dyn std::error::Error>> {
    let mut loaded = load(file, &LoadOptions::default())?;
    for sensor in &mut loaded.description.sensors {
        (sensor.film.width, sensor.film.height, sensor.film.crop) = (options.size, options.size, None);
    }
    let compiling = CompileOptions { accel: AccelKind::default(), threads: threads(), sensor: 0 };
    let scene = compile(loaded.description, compiling)?.0;
    let integrator = integrator::create(&loaded.integrator);
    let name = file.file_stem().unwrap_or_default().to_string_lossy();
    for kind in [SamplerKind::Independent, SamplerKind::Sobol] {
        let mut mean: Option<Vec<f64>> = None;
        for samples in SAMPLES {
            let renders = (0..options.seeds)
                .map(|seed| render(&scene, integrator.as_ref(), kind, samples, seed, options.adaptive))
                .collect::<Result<Vec<_>, _>>()?;
            let images: Vec<Vec<f64>> = renders.iter().map(values).collect();
            let truths = match &mean {
                Some(mean) => images.iter().map(|image| relmse(image, |i| mean[i])).collect(),
                None => {
                    let n = options.seeds as f64;
                    let sums: Vec<f64> =
                        (0..images[0].len()).map(|i| images.iter().map(|image| image[i]).sum()).collect();
                    let others = |image: &Vec<f64>| relmse(image, |i| (sums[i] - image[i]) / (n - 1.0));
                    // The others' mean has an error of its own: one part in n.
                    let truths: Vec<f64> = images.iter().map(|image| others(image) * (n - 1.0) / n).collect();
                    mean = Some(sums.iter().map(|sum| sum / n).collect());
                    truths
                }
            };
            print_row(&format!("{name:<12} {:<12} {samples:>4}", kind.name()), &renders, &truths);
        }
    }
    Ok(())
}

fn print_row(name: &str, renders: &[Rendered], truths: &[f64]) {
    let n = truths.len() as f64;
    let [mut estimate, mut held, mut upper, mut to_upper, mut to_lower] = [0.0; 5];
    for (render, &truth) in renders.iter().zip(truths) {
        let (Some(relmse), Some([low, high])) = (render.relmse, render.relmse_interval) else { continue };
        estimate += relmse / n;
        held += f64::from(u8::from((low..=high).contains(&truth))) / n;
        upper += f64::from(u8::from(truth <= high)) / n;
        to_upper += (high / relmse).ln() / n;
        to_lower += (relmse / low).ln() / n;
    }
    let truth = truths.iter().sum::<f64>() / n;
    println!(
        "{name} {truth:>10.3e} {:>9.3} {held:>6.3} {upper:>6.3} {:>8.3} {:>8.3}",
        estimate / truth,
        to_upper.exp(),
        to_lower.exp()
    );
}

fn render(
    scene: &Scene,
    integrator: &dyn integrator::Integrator,
    kind: SamplerKind,
    samples: u64,
    seed: u64,
    adaptive: bool,
) -> Result<Rendered, buffon::error::Error> {
    let stop = StopRules { samples: Some(samples), ..StopRules::default() };
    let sampler = Sampler::new(kind, stop.samples);
    let settings = JobSettings { sampler, seed, threads: threads(), stop, layers: Vec::new() };
    let progress = Progress::new();
    Job::new(scene, integrator, &scene.sensors[0], settings, &progress).with_adaptive(adaptive).run()
}

fn threads() -> usize {
    std::thread::available_parallelism().map_or(1, usize::from)
}

/// All values of an image, in the order of its tiles.
fn values(rendered: &Rendered) -> Vec<f64> {
    let pixels = rendered.tiles.iter().flat_map(|tile| (0..tile.pixel_count()).map(move |i| (tile, i)));
    pixels.flat_map(|(tile, i)| [0, 1, 2].map(|c| tile.estimate(i, c).mean)).collect()
}

fn relmse(image: &[f64], truth: impl Fn(usize) -> f64) -> f64 {
    let errors = image.iter().enumerate().map(|(i, x)| {
        let r = truth(i);
        (x - r) * (x - r) / (r * r + buffon::estimate::metrics::RELATIVE_FLOOR)
    });
    errors.sum::<f64>() / image.len() as f64
}
