//! `buffon render`: a scene in, an image out.

use super::progress::{ProgressKind, Watcher};
use super::stats::{Account, Seconds};
use super::values;
use crate::accel::AccelKind;
use crate::error::{Error, Kind, Result, counted};
use crate::film::PixelRect;
use crate::image::{self, Metadata, Value, WriteOptions};
use crate::integrator::settings::{
    Aov, DirectSettings, DistributionSettings, Layer, PathSettings, PtracerSettings, WhittedSettings,
};
use crate::integrator::{self, Settings};
use crate::loader::{self, LoadOptions, Loaded};
use crate::render::{Job, JobSettings, Progress, Rendered, StopReason, StopRules, output};
use crate::sampling::{Sampler, SamplerKind};
use crate::scene::{CompileOptions, CompileReport, Scene, compile};
use clap::Args;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicI32, Ordering};
use std::time::{Duration, Instant};

/// Render a scene.
///
/// The scene is a Mitsuba 3 XML file (older versions are upgraded), glTF 2.0 (.gltf or .glb), or a bare .obj or .ply
/// mesh. The image's format follows the extension: .exr (linear, layers, metadata), .png and .jpg (sRGB), .pfm (linear).
#[derive(Clone, Debug, Args)]
pub struct RenderArgs {
    /// The scene file
    pub scene: PathBuf,
    /// The image to write [default: the scene's name with .exr]
    #[arg(short, long, visible_alias = "outfile", value_name = "FILE")]
    pub output: Option<PathBuf>,
    /// Stop at N samples per pixel [default: what the scene asks for, if no other rule is given]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    pub spp: Option<u64>,
    /// Stop sampling after this time (90s, 1.5m, 2h)
    #[arg(long, value_name = "TIME", value_parser = values::duration)]
    pub time: Option<Duration>,
    /// Stop when the estimated relMSE of the image is at most this
    #[arg(long, value_name = "RELMSE", value_parser = values::positive)]
    pub target_error: Option<f64>,
    /// Give a default of the scene another value
    #[arg(short = 'D', value_name = "NAME=VALUE", value_parser = values::definition)]
    pub define: Vec<(String, String)>,
    /// The integrator: path, direct, ptracer, whitted, distribution, depth or aov [default: the scene's]
    #[arg(long, value_name = "NAME")]
    pub integrator: Option<String>,
    /// The sampler: independent, stratified or sobol [default: sobol]
    #[arg(long, value_name = "NAME")]
    pub sampler: Option<SamplerKind>,
    /// The ray traversal: embree or obvhs [default: embree, if it is compiled in]
    #[arg(long, value_name = "NAME")]
    pub accel: Option<AccelKind>,
    /// Size of the full image, instead of the scene's (a crop of the scene is dropped)
    #[arg(long, value_name = "WxH", value_parser = values::size)]
    pub size: Option<(u32, u32)>,
    /// Render only this part; its pixels are those of the full image
    #[arg(long, value_name = "X,Y,W,H", value_parser = values::rect)]
    pub crop: Option<PixelRect>,
    /// Seed of all random numbers
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub seed: u64,
    /// Threads; they change the speed, never the pixels [default: all cores]
    #[arg(short, long, visible_alias = "nthreads", value_name = "N", value_parser = clap::value_parser!(u32).range(1..=4096))]
    pub threads: Option<u32>,
    /// Which sensor of the scene, from 0
    #[arg(short, long, value_name = "N", default_value_t = 0)]
    pub sensor: usize,
    /// Folders to look for the scene's files in, besides its own; several are separated by ';'
    #[arg(short = 'a', long, value_name = "DIR", value_delimiter = ';')]
    pub search_path: Vec<PathBuf>,
    /// Layers to add to an EXR: albedo, N, geo_normal, P, Z, uv, prim_index, shape_index, variance, samples
    #[arg(long, value_name = "LIST", value_delimiter = ',')]
    pub aov: Vec<String>,
    /// Write an account of the render as JSON ("-" is standard output)
    #[arg(long, value_name = "FILE")]
    pub stats: Option<PathBuf>,
    /// How to show progress, on standard error
    #[arg(long, value_name = "KIND", value_enum, default_value_t = ProgressKind::Auto)]
    pub progress: ProgressKind,
    /// Say nothing but errors
    #[arg(short, long, conflicts_with = "verbose")]
    pub quiet: bool,
    /// Say more
    #[arg(short, long)]
    pub verbose: bool,
    /// Treat warnings and dropped samples as errors
    #[arg(long)]
    pub strict: bool,
    /// pbrt's live display; Buffon has none
    #[arg(long, value_name = "HOST:PORT", hide = true)]
    pub display_server: Option<String>,
}

/// A scene that is ready to be rendered.
struct Prepared {
    scene: Scene,
    report: CompileReport,
    settings: Settings,
    job: JobSettings,
    seconds: Seconds,
}

/// Renders.
///
/// # Errors
/// If the command line, the scene or the output is at fault; under `--strict` also for warnings and dropped samples.
pub fn run(args: &RenderArgs) -> Result<u8> {
    let started = Instant::now();
    let target = args.output.clone().unwrap_or_else(|| args.scene.with_extension("exr"));
    refuse(args, &target)?;
    image::check_output(&target)?;
    if let Some(path) = args.stats.as_deref().filter(|p| *p != Path::new("-")) {
        image::check_replaceable(path)?;
    }
    let mut prepared = prepare(args)?;
    let progress = Arc::new(Progress::new());
    let signal = listen(&progress)?;
    let rendered = sample(args, &prepared, &progress)?;
    let written = Instant::now();
    let image = finished_image(&prepared, &rendered, args);
    let camera = &prepared.scene.sensors[args.sensor];
    let options = WriteOptions { samples: camera.film.component_format.into(), ..WriteOptions::default() };
    let report = image::write(&target, &image, &options)?;
    prepared.seconds.write = written.elapsed().as_secs_f64();
    prepared.seconds.render = rendered.elapsed.as_secs_f64();
    prepared.seconds.total = started.elapsed().as_secs_f64();
    if let Some(path) = &args.stats {
        account(args, &prepared, &rendered).write(path)?;
    }
    if !args.quiet {
        eprintln!("{}", summary(&target, &rendered));
    }
    warn_of_values(args, &target, &rendered, report.clamped_half)?;
    match signal.load(Ordering::Relaxed) {
        0 => Ok(0),
        signal => Ok(u8::try_from(128 + signal).unwrap_or(1)),
    }
}

/// Options that mean nothing here, or not together.
fn refuse(args: &RenderArgs, target: &Path) -> Result<()> {
    if args.display_server.is_some() {
        return Err(Error::usage(
            "--display-server: Buffon has no live display; --progress shows where the render stands",
        ));
    }
    let holds_layers = target.extension().is_some_and(|e| e.eq_ignore_ascii_case("exr"));
    if !args.aov.is_empty() && !holds_layers {
        return Err(Error::usage(format!("--aov: layers need an EXR, which {} is not", target.display())));
    }
    Ok(())
}

fn prepare(args: &RenderArgs) -> Result<Prepared> {
    let mut seconds = Seconds::default();
    let loading = Instant::now();
    let options = LoadOptions { defines: args.define.clone(), search_paths: args.search_path.clone() };
    let Loaded { mut description, integrator, sampler, samples_per_pixel, warnings, notes } =
        loader::load(&args.scene, &options)?;
    seconds.load = loading.elapsed().as_secs_f64();
    warn(args, warnings)?;
    if !args.quiet {
        notes.iter().for_each(|note| eprintln!("buffon: note: {note}"));
    }
    let sensors = description.sensors.len();
    let Some(sensor) = description.sensors.get_mut(args.sensor) else {
        return Err(Error::usage(format!(
            "--sensor {}: the scene has {}, counted from 0",
            args.sensor,
            counted(sensors as u64, "sensor", "sensors")
        )));
    };
    if let Some((width, height)) = args.size {
        (sensor.film.width, sensor.film.height, sensor.film.crop) = (width, height, None);
    }
    if let Some(crop) = args.crop {
        let inside =
            |start: u32, length: u32, whole: u32| start.checked_add(length).is_some_and(|end| end <= whole);
        let film = &mut sensor.film;
        if !inside(crop.x, crop.width, film.width) || !inside(crop.y, crop.height, film.height) {
            return Err(Error::usage(format!(
                "--crop {},{},{},{}: expected a part of the image, which has {}x{} pixels",
                crop.x, crop.y, crop.width, crop.height, film.width, film.height
            )));
        }
        film.crop = Some(crop);
    }
    let threads = args.threads.map_or_else(default_threads, |n| n as usize);
    let accel = args.accel.unwrap_or_default();
    let (scene, report) = compile(description, CompileOptions { accel, threads, sensor: args.sensor })?;
    seconds.build = report.build_seconds;
    warn(args, report.warnings.clone())?;
    if report.dropped_primitives > 0 {
        let dropped = counted(report.dropped_primitives as u64, "primitive", "primitives");
        let message = format!("{dropped} left out: not finite, or out of range");
        warn(args, vec![Error::scene(message)])?;
    }
    let settings = choose_integrator(args.integrator.as_deref(), integrator)?;
    let stop = stop_rules(args, samples_per_pixel);
    let kind = args.sampler.or(sampler).unwrap_or_default();
    let sampler = Sampler::new(kind, stop.samples);
    let layers = layers(args, &settings)?;
    image::set_threads(threads);
    let job = JobSettings { sampler, seed: args.seed, threads, stop, layers };
    Ok(Prepared { scene, report, settings, job, seconds })
}

/// All cores.
pub(super) fn default_threads() -> usize {
    std::thread::available_parallelism().map_or(1, usize::from)
}

/// The rules of the command line; without any, the scene's sample count.
fn stop_rules(args: &RenderArgs, of_scene: Option<u32>) -> StopRules {
    let given = args.spp.is_some() || args.time.is_some() || args.target_error.is_some();
    let samples = if given { args.spp } else { Some(of_scene.map_or(DEFAULT_SPP, u64::from)) };
    StopRules { samples, time: args.time, error: args.target_error }
}

/// Samples per pixel where neither the scene nor the command line says anything.
const DEFAULT_SPP: u64 = 64;

/// The integrator of the command line, else that of the scene. What both have of the lengths of paths and of hidden
/// emitters stays as the scene has it; trees of rays, whose cost is exponential, are no deeper than their default.
fn choose_integrator(name: Option<&str>, of_scene: Settings) -> Result<Settings> {
    let default = PathSettings::default();
    let kept = match &of_scene {
        Settings::Path(path) => *path,
        Settings::Ptracer(PtracerSettings { max_depth, rr_depth, hide_emitters }) => {
            PathSettings { max_depth: *max_depth, rr_depth: *rr_depth, hide_emitters: *hide_emitters }
        }
        Settings::Direct(direct) => PathSettings { hide_emitters: direct.hide_emitters, ..default },
        Settings::Whitted(WhittedSettings { max_depth, hide_emitters })
        | Settings::Distribution(DistributionSettings { max_depth, hide_emitters, .. }) => {
            PathSettings { max_depth: Some(*max_depth), hide_emitters: *hide_emitters, ..default }
        }
        Settings::Depth | Settings::Aov { .. } => default,
    };
    let PathSettings { max_depth, rr_depth, hide_emitters } = kept;
    Ok(match name {
        None => of_scene,
        Some(name) if name == of_scene.name() => of_scene,
        Some("path") => Settings::Path(kept),
        Some("ptracer") => Settings::Ptracer(PtracerSettings { max_depth, rr_depth, hide_emitters }),
        Some("direct") => Settings::Direct(DirectSettings { hide_emitters, ..DirectSettings::default() }),
        Some("whitted") => {
            let default = WhittedSettings::default();
            let max_depth = max_depth.map_or(default.max_depth, |depth| depth.min(default.max_depth));
            Settings::Whitted(WhittedSettings { max_depth, hide_emitters })
        }
        Some("distribution") => {
            let default = DistributionSettings::default();
            let max_depth = max_depth.map_or(default.max_depth, |depth| depth.min(default.max_depth));
            Settings::Distribution(DistributionSettings { max_depth, hide_emitters, ..default })
        }
        Some("depth") => Settings::Depth,
        // Its layers are those of --aov: see `layers`.
        Some("aov") => Settings::Aov { layers: Vec::new(), image: Some(Box::new(of_scene)) },
        Some(other) => {
            return Err(Error::usage(format!(
                "--integrator: there is no integrator \"{other}\"; there are path, direct, ptracer, whitted, \
                 distribution, depth and aov"
            )));
        }
    })
}

/// The layers of the scene's `aov` integrator and of the command line.
fn layers(args: &RenderArgs, settings: &Settings) -> Result<Vec<Layer>> {
    let mut layers = match settings {
        Settings::Aov { layers, .. } => layers.clone(),
        _ => Vec::new(),
    };
    if layers.is_empty() && args.aov.is_empty() && matches!(settings, Settings::Aov { .. }) {
        return Err(Error::usage(format!(
            "--integrator aov: expected layers in --aov: {}",
            Aov::NAMES.join(", ")
        )));
    }
    for (i, name) in args.aov.iter().enumerate() {
        let aov = Aov::by_name(name).ok_or_else(|| {
            Error::usage(format!("--aov: there is no layer \"{name}\"; there are {}", Aov::NAMES.join(", ")))
        })?;
        // `moment` brings its variance along.
        if layers.iter().any(|l| l.name == *name && l.aov == aov) && !args.aov[..i].contains(name) {
            continue;
        }
        if layers.iter().any(|l| l.name == *name) {
            return Err(Error::usage(format!("--aov: the layer \"{name}\" is there twice")));
        }
        layers.push(Layer { name: name.clone(), aov });
    }
    Ok(layers)
}

/// Prints warnings, or fails with them under `--strict`.
fn warn(args: &RenderArgs, mut warnings: Vec<Error>) -> Result<()> {
    if warnings.is_empty() {
        return Ok(());
    }
    if args.strict {
        let first = warnings.remove(0);
        return Err(Error { kind: Kind::Strict, ..first }.with_others(warnings));
    }
    if !args.quiet {
        warnings.iter().for_each(|w| eprintln!("buffon: warning: {w}"));
    }
    Ok(())
}

/// Turns the first SIGINT or SIGTERM into an interruption of the render, and the second into an exit.
fn listen(progress: &Arc<Progress>) -> Result<Arc<AtomicI32>> {
    let caught = Arc::new(AtomicI32::new(0));
    let mut signals = signal_hook::iterator::Signals::new([libc::SIGINT, libc::SIGTERM])
        .map_err(|e| Error::internal(format!("cannot listen for signals: {e}")))?;
    let (progress, result) = (progress.clone(), caught.clone());
    std::thread::spawn(move || {
        for signal in signals.forever() {
            if caught.swap(signal, Ordering::Relaxed) != 0 {
                std::process::exit(128 + signal);
            }
            progress.interrupt();
        }
    });
    Ok(result)
}

fn sample(args: &RenderArgs, prepared: &Prepared, progress: &Arc<Progress>) -> Result<Rendered> {
    let integrator = integrator::create(&prepared.settings);
    let camera = &prepared.scene.sensors[args.sensor];
    let job = Job::new(&prepared.scene, integrator.as_ref(), camera, prepared.job.clone(), progress);
    let kind = if args.quiet { ProgressKind::None } else { args.progress };
    let watcher = Watcher::start(kind, progress.clone(), camera.film.rect().area(), prepared.job.stop);
    let rendered = job.run();
    watcher.finish();
    rendered
}

fn finished_image(prepared: &Prepared, rendered: &Rendered, args: &RenderArgs) -> image::Image {
    let camera = &prepared.scene.sensors[args.sensor];
    let mut metadata = Metadata::new()
        .with("Software", Value::Text(format!("Buffon {}", env!("CARGO_PKG_VERSION"))))
        .with("samplesPerPixel", Value::Int(i32::try_from(rendered.samples_per_pixel).unwrap_or(i32::MAX)))
        .with("renderTimeSeconds", Value::Float(rendered.elapsed.as_secs_f32()))
        .with("buffon:seed", Value::Text(args.seed.to_string()))
        .with("buffon:integrator", Value::Text(prepared.settings.name().into()))
        .with("buffon:stop", Value::Text(rendered.stop_reason.to_string()));
    if let Some(relmse) = rendered.relmse {
        metadata.set("buffon:relmse", Value::Float(relmse as f32));
    }
    for (name, value) in output::camera_metadata(camera) {
        metadata.set(name, value);
    }
    output::to_image(rendered, camera.film.pixel_format, metadata)
}

fn account<'a>(args: &'a RenderArgs, prepared: &'a Prepared, rendered: &'a Rendered) -> Account<'a> {
    Account {
        scene_file: &args.scene,
        scene: &prepared.scene,
        report: &prepared.report,
        integrator: prepared.settings.name(),
        sampler: prepared.job.sampler.kind(),
        seed: args.seed,
        threads: prepared.job.threads,
        rendered,
        seconds: prepared.seconds,
    }
}

fn summary(target: &Path, rendered: &Rendered) -> String {
    let reason = match rendered.stop_reason {
        StopReason::Samples => "all samples taken",
        StopReason::Time => "time is up",
        StopReason::Error => "error reached",
        StopReason::Interrupted => "interrupted",
    };
    let error = rendered.relmse.map_or_else(String::new, |e| format!(", relMSE about {e:.2e}"));
    let rate = rendered.counters.paths as f64 / rendered.elapsed.as_secs_f64().max(1e-9) * 1e-6;
    format!(
        "{}: {}x{}, {} per pixel in {:.2} s ({rate:.2} M samples/s){error}; {reason}",
        target.display(),
        rendered.rect.width,
        rendered.rect.height,
        counted(rendered.samples_per_pixel, "sample", "samples"),
        rendered.elapsed.as_secs_f64(),
    )
}

/// Says which samples were dropped and how to see them again, and how many values the file cannot hold. Under
/// `--strict` these are errors, but the image is there: hours of rendering are not thrown away.
fn warn_of_values(args: &RenderArgs, target: &Path, rendered: &Rendered, clamped: usize) -> Result<()> {
    let mut messages = Vec::new();
    if let Some(first) = rendered.invalid.first() {
        messages.push(format!(
            "{} dropped; the first is sample {} of pixel ({}, {}): {:?}. To see it again: --crop {},{},1,1 \
             --seed {} --spp {}",
            counted(rendered.invalid_count, "invalid sample", "invalid samples"),
            first.sample,
            first.x,
            first.y,
            first.value,
            first.x,
            first.y,
            args.seed,
            first.sample + 1
        ));
    }
    if clamped > 0 {
        messages.push(format!(
            "{} clamped to the range of half floats; component_format float32 keeps them",
            counted(clamped as u64, "value", "values")
        ));
    }
    if args.strict && !messages.is_empty() {
        messages.push(format!("--strict: {} is written, and holds what there is", target.display()));
    }
    warn(args, messages.into_iter().map(|message| Error::new(Kind::Strict, message)).collect())
}
