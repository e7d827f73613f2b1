//! `buffon render`: renders a scene to an image.

use super::checkpoint::Checkpointing;
use super::frames;
use super::outputs::{default_output, is_piped, named, refuse, write_piped, written};
use super::photon_notes::photon_notes;
use super::progress::ProgressKind;
use super::sampling::{sample, write_options};
use super::shared::{AutoArgs, DisplayArgs, MethodArgs, SceneArgs, ViewArgs};
use super::signals::{self, EarlyExit};
use super::stats::{Account, Seconds};
use super::summary::{summary, warn, warn_of_values};
use super::values;
use super::watch::Watch;
use crate::error::{Error, Result};
use crate::film::PixelRect;
use crate::image;
use crate::integrator::preparation::CacheFile;
use crate::integrator::settings::{Aov, WhenPays};
use crate::loader::LoadOptions;
use crate::render::{Progress, StopReason, StopRules};
use crate::session::{Choices, SceneChoices, SceneFile, SceneHashes, Session, connected};
use crate::util;
use clap::Args;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Render a scene.
///
/// The scene is a Mitsuba 3 XML file (older versions are upgraded), glTF 2.0 (.gltf or .glb), or a bare .obj or .ply
/// mesh. The image's format follows the extension: .exr (linear, layers, metadata), .png and .jpg (sRGB), .pfm
/// (linear), .npy (a NumPy array of 32-bit floats, height x width x channels, with layers; --stats has the channels'
/// names).
#[derive(Clone, Debug, Args)]
pub struct RenderArgs {
    /// The scene file
    pub scene: PathBuf,
    /// The image to write ("-" is an EXR on standard output); several -o write it in several formats [default: the
    /// scene's name with .exr, in the current directory]
    #[arg(short, long, visible_alias = "outfile", value_name = "FILE")]
    pub output: Vec<PathBuf>,
    /// Stop at N samples per pixel [default: the scene's number, if no other rule is given]
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = values::samples::<1>)]
    pub spp: Option<u64>,
    /// Stop sampling after this time (90s, 1.5m, 2h)
    #[arg(long, value_name = "TIME", value_parser = values::duration)]
    pub time: Option<Duration>,
    /// Stop when the relMSE of the image is at most this, according to the upper end of its 95 % interval
    #[arg(long, value_name = "RELMSE", value_parser = values::positive)]
    pub target_error: Option<f64>,
    /// Whether cells of pixels with a larger error take more samples, with --spp as the average: auto, always, never;
    /// auto: with path, direct and volpath and without --time, if a pilot finds that it pays. It adds no bias
    /// [default: auto; without a value: always]
    #[arg(long, value_name = "WHEN", num_args = 0..=1, require_equals = true, default_value = "auto",
          default_missing_value = "always", hide_default_value = true)]
    pub adaptive: WhenPays,
    /// Whether path reuses the paths of neighbouring pixels: auto, always, never; auto: if a pilot finds that it pays
    /// [default: the scene's, or auto]
    #[arg(long, value_name = "WHEN")]
    pub path_reuse: Option<WhenPays>,
    /// Whether path takes several samples of emitters and directions at the first surface of a camera path: auto,
    /// always, never; auto: if a pilot finds that it pays [default: the scene's, or auto]
    #[arg(long, value_name = "WHEN")]
    pub path_splitting: Option<WhenPays>,
    /// Whether light paths find caustics for path, beside its camera paths: auto, always, never; auto: if a pilot finds
    /// that it pays. It adds no bias [default: the scene's, or auto]
    #[arg(long, value_name = "WHEN")]
    pub path_caustics: Option<WhenPays>,
    /// Let path sample directions from which photons come, which can pay for caustics. It adds no bias
    #[arg(long)]
    pub path_guiding: bool,
    /// What pilots decide.
    #[command(flatten)]
    pub auto: AutoArgs,
    /// Definitions, folders, memory and threads.
    #[command(flatten)]
    pub resources: SceneArgs,
    /// Integrator, sampler, traversal and seed.
    #[command(flatten)]
    pub method: MethodArgs,
    /// Keep the integrator's precomputed data in FILE, and read it from there if the file exists (irrcache,
    /// photonmapper)
    #[arg(long, value_name = "FILE")]
    pub cache: Option<PathBuf>,
    /// Write the sums of the render to FILE regularly, and when it ends or is interrupted; --resume continues from it,
    /// and `buffon merge` adds several
    #[arg(long, value_name = "FILE")]
    pub checkpoint: Option<PathBuf>,
    /// The interval between checkpoints, which bounds the loss of rendering time
    #[arg(long, value_name = "TIME", default_value = "60s", value_parser = values::duration, requires = "checkpoint")]
    pub checkpoint_every: Duration,
    /// Write the image so far regularly, each time after this interval; SIGUSR1 asks for it at any time
    #[arg(long, value_name = "TIME", value_parser = values::duration, conflicts_with = "skip_existing")]
    pub write_every: Option<Duration>,
    /// Continue from the checkpoint if it exists: --spp and --time count from the beginning, and the image is identical
    /// to that of an uninterrupted render
    #[arg(long, requires = "checkpoint")]
    pub resume: bool,
    /// Take only the samples A to B - 1 of each pixel, of the --spp of the whole render; with --checkpoint, `buffon
    /// merge` computes from all ranges an image identical to that of the whole render
    #[arg(long, value_name = "A..B", value_parser = values::range)]
    pub sample_range: Option<Range<u64>>,
    /// Write no image, only the checkpoint
    #[arg(long, requires = "checkpoint", conflicts_with_all = ["output", "write_every", "skip_existing"])]
    pub no_image: bool,
    /// Refuse the scene unless it has this hash, which `buffon plan` writes into tasks: it changes with the scene, its
    /// textures and meshes, and the view
    #[arg(long, value_name = "HASH")]
    pub scene_hash: Option<String>,
    /// Render the frames A to B - 1, or to B with A..=B, of an animation: the number of a frame is the value of the
    /// scene's parameter `frame`, and replaces {frame} in the names of files, with leading zeros {frame:04}
    /// [default output: SCENE.{frame:04}.exr]
    #[arg(long, value_name = "A..B", value_parser = values::frames)]
    pub frames: Option<Range<u64>>,
    /// Render nothing if all output files exist, and write nothing if the render is interrupted: so the same command
    /// goes on with the images or frames that are missing
    #[arg(long)]
    pub skip_existing: bool,
    /// Sensor and size.
    #[command(flatten)]
    pub view: ViewArgs,
    /// Render only this part; its pixels are identical to those of the full image
    #[arg(long, value_name = "X,Y,W,H", value_parser = values::rect)]
    pub crop: Option<PixelRect>,
    /// Layers.
    #[arg(long, value_name = "LIST", value_delimiter = ',', help = format!(
        "Layers to add to an .exr or .npy, separated by commas: {}. With bdpt, strategies adds two layers for each technique: \
         s2_t3.weighted, its part of the image, and s2_t3.alone; each is rendered by itself",
        Aov::NAMES.join(", ")
    ))]
    pub aov: Vec<String>,
    /// Add Cryptomatte layers of objects and materials to an .exr or .npy (crypto_object, crypto_material);
    /// an EXR has their names, too
    #[arg(long)]
    pub cryptomatte: bool,
    /// Exposure and tone curve.
    #[command(flatten)]
    pub display: DisplayArgs,
    /// Write statistics of the render as JSON ("-" is standard output)
    #[arg(long, value_name = "FILE")]
    pub stats: Option<PathBuf>,
    /// The form of the progress output on standard error
    #[arg(long, value_name = "KIND", value_enum, default_value_t = ProgressKind::Auto)]
    pub progress: ProgressKind,
    /// Print only errors
    #[arg(short, long, conflicts_with = "verbose")]
    pub quiet: bool,
    /// Print the time of each step, too
    #[arg(short, long)]
    pub verbose: bool,
    /// Treat warnings, dropped samples, and notes about what is not rendered as the file asks for as errors
    #[arg(long)]
    pub strict: bool,
    /// Show the image so far in a viewer that speaks tev's protocol (tev, HDRView), after each pass, but at most once a
    /// second: the picture, its standard error, and layers. A viewer that is missing or slow changes no pixel; tev
    /// listens at port 14158
    #[arg(long, value_name = "HOST:PORT")]
    pub display_server: Option<String>,
    /// Show the render in a page for a browser on this machine: the picture so far, its error, what is left, and
    /// buttons to stop or to say that it is enough. The address of the page, which has a secret, is printed on standard
    /// error, also with --quiet; :0 finds a free port. No pixel changes. HOST:PORT lets other machines in, without
    /// encryption
    #[arg(long, value_name = ":PORT")]
    pub watch: Option<String>,
}

/// The name of a layer in `--aov` for each technique of `bdpt`.
pub(super) const STRATEGIES: &str = "strategies";

/// Renders a scene, or each of its frames until one fails or a signal is caught.
///
/// # Errors
/// If the command line, the scene or the output has an error; under `--strict` also for warnings and dropped samples.
pub fn run(args: &RenderArgs) -> Result<u8> {
    signals::survive_requests()?;
    let watch = args.watch.as_deref().map(Watch::start).transpose()?;
    let result = render_all(args, watch.as_ref());
    if let Some(watch) = watch {
        watch.finish(&result);
    }
    result
}

fn render_all(args: &RenderArgs, watch: Option<&Watch>) -> Result<u8> {
    let Some(frames) = args.frames.clone() else {
        let mut args = args.clone();
        if args.output.is_empty() && !args.no_image {
            args.output = vec![default_output(&args)];
        }
        return render(&args, watch);
    };
    for frame in frames::of(args, frames, &default_output(args))? {
        let code = render(&frame, watch)?;
        if code != 0 {
            return Ok(code);
        }
        if let Some(code) = signals::exit_code() {
            return Ok(code);
        }
    }
    Ok(0)
}

/// Renders the scene, or one of its frames, to `args.output`.
fn render(args: &RenderArgs, watch: Option<&Watch>) -> Result<u8> {
    let started = Instant::now();
    let targets = &args.output;
    if args.skip_existing && targets.iter().all(|target| target.exists()) {
        if !args.quiet {
            let names: Vec<_> = targets.iter().map(|target| target.display().to_string()).collect();
            super::report!("buffon: note: {} exists: nothing is rendered", names.join(", "));
        }
        return Ok(0);
    }
    let named: Vec<PathBuf> = targets.iter().map(|target| named(target).to_owned()).collect();
    refuse(args, &named)?;
    let mut files = targets.iter().filter(|target| !is_piped(target));
    files.try_for_each(|target| image::check_output(target))?;
    if let Some(path) = args.stats.as_deref().filter(|p| *p != Path::new("-")) {
        util::check_replaceable(path)?;
    }
    let (session, origin, mut seconds) = open(args)?;
    let mut choices = choices(args, origin)?;
    let strategies = args.aov.iter().any(|name| name == STRATEGIES);
    if strategies {
        let name = choices.integrator.as_deref().unwrap_or_else(|| session.defaults.integrator_name());
        choices.connections = connected(name).or(choices.connections);
    }
    Checkpointing::keep_integrator(args, &session, &mut choices)?;
    let mut plan = session.plan(&choices)?;
    if let Some(decision) = plan.decision.as_ref().filter(|_| !args.quiet) {
        super::report!("buffon: note: {decision}");
    }
    if strategies {
        session.check_techniques(&plan)?;
    }
    if args.cryptomatte {
        session.check_cryptomatte(&plan)?;
    }
    named.iter().try_for_each(|target| session.check_output(&plan, target))?;
    let kind = plan.job.sampler.kind();
    if session.defaults.sampler.is_some_and(|scenes| scenes != kind)
        && args.method.sampler().is_none()
        && !args.quiet
    {
        super::report!("buffon: note: the sampler {kind} replaces the scene's; --sampler scene keeps it");
    }
    let checkpoint = Checkpointing::open(args, &session, &mut plan, origin)?;
    let notes = kind.advice(plan.job.stop.samples).into_iter().chain(session.missed_light(&plan));
    notes.filter(|_| !args.quiet).for_each(|note| super::report!("buffon: note: {note}"));
    let files = named.iter().chain(args.checkpoint.as_ref().filter(|_| args.no_image));
    let names = files.map(|file| file.display().to_string()).collect::<Vec<_>>().join(", ");
    let progress = Arc::new(Progress::new());
    signals::interrupt(&progress, Some(early_exit(args, &names)))?;
    let rendered = sample(args, &session, &plan, &progress, checkpoint, watch)?;
    let code = match signals::exit_code() {
        Some(_) if args.checkpoint.is_some() && rendered.checkpoint_status.is_ok() => {
            INTERRUPTED_WITH_CHECKPOINT
        }
        code => code.unwrap_or(0),
    };
    if rendered.stop_reason == StopReason::Interrupted && (rendered.counts.most == 0 || args.skip_existing) {
        let when = if rendered.counts.most == 0 { " before the first sample" } else { "" };
        super::report!("buffon: interrupted{when}: {names} is left as it was");
        return rendered.checkpoint_status.map(|()| code);
    }
    let sampled = Instant::now();
    let mut image = session.image(&plan, &rendered);
    let complete = (!strategies
        || session.add_techniques(&plan, rendered.samples_per_pixel, &progress, &mut image)?)
        && (!args.cryptomatte || session.add_cryptomatte(&plan, &progress, &mut image)?);
    if !complete && !args.quiet {
        super::report!("buffon: note: interrupted: {names} lacks the layers that are rendered last");
    }
    seconds.layers = sampled.elapsed().as_secs_f64();
    let written = Instant::now();
    let options = write_options(args, &session);
    let mut clamped_half = 0;
    for target in targets {
        let report = match is_piped(target) {
            true => write_piped(&image, &options)?,
            false => image::write(target, &image, &options)?,
        };
        clamped_half = clamped_half.max(report.clamped_half);
    }
    seconds.write = written.elapsed().as_secs_f64();
    seconds.prepare = rendered.prepared.as_secs_f64();
    seconds.render = rendered.elapsed.as_secs_f64();
    seconds.total = started.elapsed().as_secs_f64();
    if let Some(path) = &args.stats {
        let channels = &image.channels;
        Account { session: &session, plan: &plan, rendered: &rendered, channels, seconds }.write(path)?;
    }
    if !args.quiet {
        super::report!("{}", summary(&names, &rendered));
        if args.verbose {
            let Seconds { load, build, prepare, render, layers, write, total } = seconds;
            super::report!(
                "buffon: note: loading {load:.2} s, building {build:.2} s, preparing {prepare:.2} s, \
                 sampling {render:.2} s, extra layers {layers:.2} s, writing {write:.2} s, total {total:.2} s"
            );
        }
        photon_notes(&rendered.statistics).iter().for_each(|note| super::report!("buffon: note: {note}"));
    }
    warn_of_values(args, &names, &rendered, clamped_half)?;
    rendered.checkpoint_status.map(|()| code)
}

/// Returns the function that ends a render before its first sample.
fn early_exit(args: &RenderArgs, names: &str) -> EarlyExit {
    let resumed = args.checkpoint.clone().filter(|file| args.resume && file.exists());
    let names = names.to_owned();
    Box::new(move |signal| {
        super::report!("buffon: interrupted before the first sample: {names} is left as it was");
        match resumed {
            Some(_) => INTERRUPTED_WITH_CHECKPOINT.into(),
            None => 128 + signal,
        }
    })
}

/// The exit code of a render that a signal has stopped and that can be resumed.
const INTERRUPTED_WITH_CHECKPOINT: u8 = 85;

/// Loads a scene with the choices of the command line.
fn load(args: &RenderArgs) -> Result<SceneFile> {
    let load = args.resources.load_options(args.method.integrator.as_deref());
    let choices = SceneChoices {
        load: LoadOptions {
            replaces_sampler: args.method.sampler().is_some(),
            sensor: Some(args.view.sensor),
            ..load
        },
        sensor: args.view.sensor,
        size: args.view.size,
        crop: args.crop,
    };
    SceneFile::load(&args.scene, &choices)
}

/// What a plan has to know of a render.
pub(super) struct Identified {
    /// The hash of the scene and the view.
    pub hash: String,
    /// The number of samples per pixel.
    pub samples: u64,
    /// The region of the image.
    pub rect: PixelRect,
    /// The number of sensors in the scene.
    pub sensors: usize,
}

/// Loads the scene of a render, to plan it.
///
/// # Errors
/// If the scene cannot be loaded, or nothing says how many samples there are.
pub(super) fn identify(args: &RenderArgs) -> Result<Identified> {
    let mut file = load(args)?;
    let warnings = file.take_warnings(args.strict);
    if args.frames.is_some() {
        frames::check(&warnings)?;
    }
    warn(args, warnings)?;
    let samples = args.spp.or(file.defaults.samples_per_pixel);
    let samples = samples.ok_or_else(|| Error::usage("--spp: expected, because the scene has no number"))?;
    let (rect, sensors) = (file.description.sensors[file.sensor].film.rect(), file.description.sensors.len());
    Ok(Identified { hash: file.origin().to_string(), samples, rect, sensors })
}

/// Loads and compiles the scene, and prints its warnings and notes.
fn open(args: &RenderArgs) -> Result<(Session, Option<SceneHashes>, Seconds)> {
    let mut file = load(args)?;
    if let Some(expected) = &args.scene_hash {
        let found = file.origin().to_string();
        if found != *expected {
            let message =
                format!("--scene-hash {expected}: the scene or one of its files has changed, it has {found}");
            return Err(Error::scene(message).in_file(&args.scene));
        }
    }
    let load = file.load_seconds;
    for (option, output) in written(args) {
        if file.files.iter().any(|part| util::is_same_file(part, output)) {
            return Err(Error::usage(format!("{option} {}: it is a file of the scene", output.display())));
        }
    }
    let warnings = file.take_warnings(args.strict);
    if args.frames.is_some() {
        frames::check(&warnings)?;
    }
    warn(args, warnings)?;
    if !args.quiet {
        file.approximations.iter().chain(&file.notes).for_each(|note| super::report!("buffon: note: {note}"));
    }
    let kept_beyond = args.cache.is_some() || args.checkpoint.is_some();
    let origin = kept_beyond.then(|| file.origin());
    let threads = args.resources.threads();
    image::set_threads(threads);
    file.pass_panes(args.method.integrator.as_deref());
    let mut session = file.compile(args.method.accel.unwrap_or_default(), threads)?;
    warn(args, std::mem::take(&mut session.warnings))?;
    let build = session.report.build_seconds;
    Ok((session, origin, Seconds { load, build, ..Seconds::default() }))
}

/// Returns the choices of the command line.
fn choices(args: &RenderArgs, origin: Option<SceneHashes>) -> Result<Choices> {
    let cache = |(path, SceneHashes { scene, view }): (&PathBuf, SceneHashes)| CacheFile {
        path: path.clone(),
        scene,
        view,
    };
    Ok(Choices {
        integrator: args.method.integrator.clone(),
        allow_bias: args.auto.allow_bias,
        costs: args.auto.costs()?,
        squared_bias: None,
        sampler: args.method.sampler(),
        replace_independent: args.method.replaces_independent(true),
        stop: StopRules { samples: args.spp, time: args.time, error: args.target_error },
        seed: args.method.seed,
        aov: args.aov.iter().filter(|name| *name != STRATEGIES).cloned().collect(),
        adaptive: args.adaptive,
        path_reuse: args.path_reuse,
        path_splitting: args.path_splitting,
        path_guiding: args.path_guiding,
        path_caustics: args.path_caustics,
        connections: args.auto.bdpt_connections,
        cache: args.cache.as_ref().zip(origin).map(cache),
        samples: args.sample_range.clone(),
    })
}
