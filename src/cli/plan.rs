//! `buffon plan`: splits renders into tasks for a farm.

use super::frames;
use super::render::{Identified, RenderArgs};
use super::values;
use crate::error::{Error, Result, counted};
use crate::farm::{Engine, Farm, SplitImage};
use crate::render::TILE;
use crate::util::named;
use clap::{Args, Parser};
use std::path::PathBuf;

/// Write the files with which an engine renders scenes as many tasks.
///
/// Each image is split into ranges of samples, and into regions if you ask for them. A task renders a range to a
/// checkpoint. If it is stopped or killed and
/// started again, it goes on from there. It refuses a scene that has changed since the plan. When all tasks are done,
/// the checkpoints are merged. The images have the same bits as those of one render.
///
/// The scripts name files relative to the directory in which this command runs. All machines need that directory and
/// the folder of the plan in a shared file system.
#[derive(Clone, Debug, Args)]
pub struct PlanArgs {
    /// The scenes
    #[arg(required = true, value_name = "SCENE")]
    pub scenes: Vec<PathBuf>,
    /// The engine.
    #[arg(long, value_name = "NAME", value_parser = engine, help = format!("The engine: {}", engines()))]
    pub engine: Engine,
    /// The number of tasks for each image; fewer if there are not two samples per pixel for each
    #[arg(long, value_name = "N", default_value_t = 8, value_parser = values::samples::<1>)]
    pub tasks: u64,
    /// The number of regions of each image, bands of at least 16 rows that share the tasks
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = values::samples::<1>)]
    pub regions: u64,
    /// The sensors, an image each: indices from 0 with commas between them, or "all"
    #[arg(long, value_name = "LIST", value_parser = sensors)]
    pub sensors: Option<Sensors>,
    /// The new folder for scripts, checkpoints (parts/) and images (images/)
    #[arg(long, value_name = "DIR")]
    pub dir: PathBuf,
    /// Options of `buffon render`, after "--": those that determine the image, --threads and
    /// --checkpoint-every
    #[arg(last = true, value_name = "OPTIONS", allow_hyphen_values = true)]
    pub options: Vec<String>,
}

/// The sensors of a plan.
#[derive(Clone, Debug)]
pub enum Sensors {
    /// All sensors of the scene.
    All,
    /// Those with these indices.
    Some(Vec<usize>),
}

fn sensors(text: &str) -> Result<Sensors, String> {
    if text == "all" {
        return Ok(Sensors::All);
    }
    let indices = text.split(',').map(|index| index.parse().ok()).collect::<Option<_>>();
    indices.map(Sensors::Some).ok_or_else(|| "expected indices such as 0,2, or all".into())
}

fn engine(name: &str) -> Result<Engine, String> {
    named(&Engine::NAMES, name).ok_or_else(|| format!("expected {}", engines()))
}

fn engines() -> String {
    super::shared::one_of(Engine::NAMES.map(|(name, _)| name))
}

/// The options of a render, parsed alone.
#[derive(Debug, Parser)]
#[command(name = "buffon plan SCENE --", override_usage = "buffon plan SCENE... -- [OPTIONS of render]")]
struct RenderOptions {
    #[command(flatten)]
    render: RenderArgs,
}

/// Writes the plan.
///
/// # Errors
/// If a scene cannot be loaded, an option is not one for all tasks, or the folder cannot be written.
pub fn run(args: &PlanArgs) -> Result<u8> {
    Farm::check_folder(&args.dir)?;
    let mut images = Vec::new();
    for scene in &args.scenes {
        // A checkpoint is what a task writes.
        let words = ["render", &scene.to_string_lossy(), "--checkpoint", "sums"].map(str::to_owned);
        let render = match RenderOptions::try_parse_from(words.iter().chain(&args.options)) {
            Ok(options) => options.render,
            Err(error) => {
                let _ = error.print();
                return Ok(crate::error::Kind::Usage.exit_code());
            }
        };
        refuse(&render, args)?;
        images.extend(split(&render, args)?);
    }
    let farm = Farm { folder: args.dir.clone(), images, tasks: args.tasks };
    let start = farm.write(args.engine)?;
    let (images, tasks) = (farm.images.len() as u64, farm.task_count() as u64);
    let [images, tasks] = [counted(images, "image", "images"), counted(tasks, "task", "tasks")];
    super::print(&format!("{}: {images}, {tasks}; to start: {start}\n", args.dir.display()))
}

/// Returns the images of a scene: one for each sensor and frame.
fn split(render: &RenderArgs, args: &PlanArgs) -> Result<Vec<SplitImage>> {
    let stem = render.scene.file_stem().unwrap_or(render.scene.as_os_str()).to_string_lossy();
    let stem: String =
        stem.chars().map(|c| if c.is_alphanumeric() || "._-".contains(c) { c } else { '_' }).collect();
    let all_sensors = match &args.sensors {
        None => vec![None],
        Some(Sensors::Some(indices)) => indices.iter().copied().map(Some).collect(),
        Some(Sensors::All) => (0..super::render::identify(render)?.sensors).map(Some).collect(),
    };
    let all_frames = render.frames.clone().map_or(vec![None], |range| range.map(Some).collect());
    let mut images = Vec::new();
    for sensor in all_sensors {
        for &frame in &all_frames {
            let (mut render, mut name, mut added) = (render.clone(), stem.clone(), Vec::new());
            if let Some(sensor) = sensor {
                render.view.sensor = sensor;
                name += &format!(".sensor{sensor}");
                added.extend(["--sensor".into(), sensor.to_string()]);
            }
            if let Some(frame) = frame {
                let (parameter, value) = frames::parameter(frame);
                name += &format!(".{frame:0width$}", width = frames::DIGITS);
                added.extend(["-D".into(), format!("{parameter}={value}")]);
                render.resources.define.push((parameter, value));
            }
            images.push(image(&render, name, args, added)?);
        }
    }
    Ok(images)
}

/// Returns an image with the options of the plan and others.
fn image(render: &RenderArgs, name: String, args: &PlanArgs, added: Vec<String>) -> Result<SplitImage> {
    let Identified { hash, samples, rect, .. } = super::render::identify(render)?;
    let regions = if args.regions == 1 { Vec::new() } else { rect.bands(args.regions, TILE) };
    // Frames and regions have tasks of their own.
    let own: &[&str] = if regions.is_empty() { &["--frames"] } else { &["--frames", "--crop"] };
    let mut arguments = vec![render.scene.to_string_lossy().into_owned()];
    arguments.extend(without(own, &args.options).into_iter().chain(added));
    if render.spp.is_none() {
        arguments.extend(["--spp".into(), samples.to_string()]);
    }
    Ok(SplitImage { name, arguments, hash, samples, regions })
}

/// Returns options without those of the given names, which have values.
fn without(names: &[&str], options: &[String]) -> Vec<String> {
    let mut kept = Vec::new();
    let mut options = options.iter();
    while let Some(option) = options.next() {
        match option.split_once('=') {
            _ if names.contains(&option.as_str()) => drop(options.next()),
            Some((name, _)) if names.contains(&name) => {}
            _ => kept.push(option.clone()),
        }
    }
    kept
}

/// Returns whether an option is `--sensor`.
fn names_sensor(option: &str) -> bool {
    option.starts_with("--sensor") || option.starts_with("-s")
}

/// Refuses options that a plan sets itself, or that are not the same for a part as for the whole.
fn refuse(render: &RenderArgs, args: &PlanArgs) -> Result<()> {
    let given = [
        ("-o", !render.output.is_empty()),
        ("--time", render.time.is_some()),
        ("--target-error", render.target_error.is_some()),
        ("--cache", render.cache.is_some()),
        ("--resume", render.resume),
        ("--no-image", render.no_image),
        ("--write-every", render.write_every.is_some()),
        ("--display-server", render.display_server.is_some()),
        ("--watch", render.watch.is_some()),
        ("--sample-range", render.sample_range.is_some()),
        ("--skip-existing", render.skip_existing),
        ("--cryptomatte", render.cryptomatte),
        ("--aov strategies", render.aov.iter().any(|name| name == super::render::STRATEGIES)),
        ("--stats", render.stats.is_some()),
        ("--scene-hash", render.scene_hash.is_some()),
    ];
    match given.into_iter().find(|(_, given)| *given) {
        Some((option, _)) => Err(Error::usage(format!("{option}: a plan has no such option for its tasks"))),
        None if render.frames.is_some()
            && render.resources.define.iter().any(|(name, _)| name == frames::PARAMETER) =>
        {
            Err(Error::usage("-D frame: --frames sets it"))
        }
        None if args.sensors.is_some() && args.options.iter().any(|option| names_sensor(option)) => {
            Err(Error::usage("--sensor: --sensors of the plan chooses the sensors"))
        }
        None => Ok(()),
    }
}
