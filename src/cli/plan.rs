//! `buffon plan`: splits renders into tasks for a farm.

use super::frames;
use super::render::RenderArgs;
use super::values;
use crate::error::{Error, Result, counted};
use crate::farm::{Engine, Farm, SplitImage};
use crate::util::named;
use clap::{Args, Parser};
use std::path::PathBuf;

/// Write the files with which an engine renders scenes as many tasks.
///
/// Each image is split into ranges of samples. A task renders a range to a checkpoint. If it is stopped or killed and
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
    /// The new folder for scripts, checkpoints (parts/) and images (images/)
    #[arg(long, value_name = "DIR")]
    pub dir: PathBuf,
    /// Options of `buffon render`, after "--": those that determine the image, --threads and
    /// --checkpoint-every
    #[arg(last = true, value_name = "OPTIONS", allow_hyphen_values = true)]
    pub options: Vec<String>,
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
        refuse(&render)?;
        images.extend(split(&render, &args.options)?);
    }
    let farm = Farm { folder: args.dir.clone(), images, tasks: args.tasks };
    let start = farm.write(args.engine)?;
    let (images, tasks) = (farm.images.len() as u64, farm.task_count() as u64);
    let [images, tasks] = [counted(images, "image", "images"), counted(tasks, "task", "tasks")];
    super::print(&format!("{}: {images}, {tasks}; to start: {start}\n", args.dir.display()))
}

/// Returns the images of a scene: one, or one for each frame.
fn split(render: &RenderArgs, options: &[String]) -> Result<Vec<SplitImage>> {
    let stem = render.scene.file_stem().unwrap_or(render.scene.as_os_str()).to_string_lossy();
    let stem: String =
        stem.chars().map(|c| if c.is_alphanumeric() || "._-".contains(c) { c } else { '_' }).collect();
    let image = |render: &RenderArgs, name: String, definition: Option<String>| {
        let mut arguments = vec![render.scene.to_string_lossy().into_owned()];
        arguments.extend(without_frames(options));
        arguments.extend(definition.into_iter().flat_map(|definition| ["-D".into(), definition]));
        let (hash, samples) = super::render::identify(render)?;
        if render.spp.is_none() {
            arguments.extend(["--spp".into(), samples.to_string()]);
        }
        Ok(SplitImage { name, arguments, hash, samples })
    };
    match render.frames.clone() {
        None => Ok(vec![image(render, stem, None)?]),
        Some(range) => range
            .map(|frame| {
                let mut render = render.clone();
                let (name, value) = frames::parameter(frame);
                let definition = format!("{name}={value}");
                render.resources.define.push((name, value));
                image(&render, format!("{stem}.{frame:0width$}", width = frames::DIGITS), Some(definition))
            })
            .collect(),
    }
}

/// Returns the options without `--frames`: each frame has tasks of its own.
fn without_frames(options: &[String]) -> Vec<String> {
    let mut kept = Vec::new();
    let mut options = options.iter();
    while let Some(option) = options.next() {
        match option.as_str() {
            "--frames" => drop(options.next()),
            joined if joined.starts_with("--frames=") => {}
            _ => kept.push(option.clone()),
        }
    }
    kept
}

/// Refuses options that a plan sets itself, or that are not the same for a part as for the whole.
fn refuse(render: &RenderArgs) -> Result<()> {
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
        None => Ok(()),
    }
}
