//! `buffon info`: the content, needs and memory of a scene, and the content of an image, a file of photon maps or a
//! checkpoint.

use super::shared::{SceneArgs, accel_help};
use super::{info_image, print};
use crate::accel::AccelKind;
use crate::error::{Result, counted};
use crate::film::FilmSettings;
use crate::image;
use crate::integrator::photon;
use crate::loader::{self, LoadOptions, Tolerance};
use crate::memory::{Amount, Budget};
use crate::render::Progress;
use crate::scene::Scene;
use crate::sensor::SensorSettings;
use crate::session::checkpoint::{self, Checkpoint, CheckpointLabel};
use crate::session::{Choices, RenderMemory, SceneFile, Session};
use crate::shape::WorldShape;
use crate::util::wording::percent;
use clap::Args;
use std::collections::BTreeMap;
use std::fmt::Write;
use std::mem::take;
use std::path::PathBuf;
use std::time::Duration;

/// Describe the content, needs and cost of a scene, or the content of an image.
///
/// What a scene has and Buffon does not is listed as a problem; the rest is described without it.
#[derive(Clone, Debug, Args)]
pub struct InfoArgs {
    /// A scene (.xml, .gltf, .glb, .obj, .ply), an image (.exr, .png, .jpg, .hdr, .pfm, .npy), a file of photon maps or
    /// a checkpoint
    pub file: PathBuf,
    /// Definitions, folders, memory and threads.
    #[command(flatten)]
    pub resources: SceneArgs,
    /// The ray traversal.
    #[arg(long, value_name = "NAME", help = accel_help())]
    pub accel: Option<AccelKind>,
    /// Render nothing: do not estimate the time of a render.
    #[arg(long)]
    pub no_pilot: bool,
}

/// The greatest width and height of the image from which the time of a render is estimated, pixels.
const PILOT_SIZE: u32 = 128;
/// The time of sampling for that image.
const PILOT_TIME: Duration = Duration::from_millis(300);

/// Prints the description.
///
/// # Errors
/// If the file cannot be read.
pub fn run(args: &InfoArgs) -> Result<u8> {
    let extension = args.file.extension().map(|e| e.to_string_lossy().to_lowercase()).unwrap_or_default();
    if loader::EXTENSIONS.contains(&extension.as_str()) {
        print(&describe_scene(args)?)
    } else if photon::file::is_photon_file(&args.file) {
        print(&describe_photons(&photon::file::read_contents(&args.file)?))
    } else if checkpoint::file::is_checkpoint(&args.file) {
        print(&describe_checkpoint(&checkpoint::file::load(&args.file)?))
    } else {
        print(&info_image::describe(&image::read(&args.file)?))
    }
}

/// Describes a file of photon maps, whose checksum has been verified.
fn describe_photons(contents: &photon::file::PhotonFileContents) -> String {
    let mut text = String::new();
    for (what, hash) in [("scene", contents.origin.scene), ("settings", contents.origin.settings)] {
        let _ = writeln!(text, "{what:<12} {hash:016x}");
    }
    for map in &contents.maps {
        let replicate = map.label.replicate;
        let photons = counted(map.photons, "photon", "photons");
        let paths = counted(map.emitted, "light path", "light paths");
        let mib = map.photons as f64 * photon::PhotonMap::BYTES_PER_PHOTON / (1024.0 * 1024.0);
        let name = map.label.light.name();
        let _ =
            writeln!(text, "{name:<12} {photons} of {paths} for replicate {replicate}, {mib:.1} MiB in use");
    }
    text
}

/// Describes a checkpoint.
fn describe_checkpoint(checkpoint: &Checkpoint) -> String {
    let CheckpointLabel { identity, image_description, samples, target } = &checkpoint.label;
    let rect = image_description.rect;
    let of = target.map_or_else(String::new, |n| format!(" of {}", counted(n, "sample", "samples")));
    let seconds = checkpoint.state.elapsed.as_secs_f64();
    let bias = image_description.squared_bias.map(|square| format!(", bias {}", percent(square.sqrt())));
    let bias = bias.unwrap_or_default();
    let lines = [
        ("made by", format!("Buffon {}", identity.version)),
        ("scene", format!("{:016x}, view {:016x}", identity.scene, identity.view)),
        ("integrator", format!("{}, settings {:016x}{bias}", identity.integrator, identity.settings)),
        ("sampler", format!("{}, seed {}", identity.sampler, identity.seed)),
        ("traversal", identity.accel.clone()),
        ("image", format!("{}x{} at ({}, {})", rect.width, rect.height, rect.x, rect.y)),
        ("samples", format!("{}{of} per pixel", checkpoint::list(samples))),
        ("time", format!("{seconds:.2} s of sampling")),
    ];
    lines.iter().map(|(name, value)| format!("{name:<12} {value}\n")).collect()
}

/// Describes a scene: all that loads, and the problems of the rest.
fn describe_scene(args: &InfoArgs) -> Result<String> {
    let options = LoadOptions { tolerance: Tolerance::Everything, ..args.resources.load_options(None) };
    let mut loaded = loader::load(&args.file, &options)?;
    let mut problems = take(&mut loaded.tolerated);
    let settings = loaded.description.sensors.clone();
    let mut file = SceneFile::of(&args.file, loaded);
    let mut warnings = take(&mut file.warnings);
    let notes = [take(&mut file.approximations), take(&mut file.notes)].concat();
    if let Some(sensor) = file.description.sensors.first_mut() {
        let film = &mut sensor.film;
        let scale = f64::from(film.width.max(film.height)) / f64::from(PILOT_SIZE);
        let smaller = |n: u32| (f64::from(n) / scale.max(1.0)).ceil() as u32;
        (film.width, film.height, film.crop) = (smaller(film.width), smaller(film.height), None);
    }
    let mut lines = vec![("integrator", file.defaults.integrator_name().to_owned())];
    lines.extend(settings.iter().map(|sensor| ("sensor", describe_sensor(sensor))));
    match file.compile(args.accel.unwrap_or_default(), args.resources.threads()) {
        Ok(mut session) => {
            warnings.append(&mut session.warnings);
            lines.extend(describe_compiled(&session, &settings, args.no_pilot));
        }
        Err(error) => problems.push(error),
    }
    lines.extend(problems.iter().map(|problem| ("problem", problem.to_string())));
    lines.extend(warnings.iter().map(|warning| ("warning", warning.to_string())));
    lines.extend(notes.into_iter().map(|note| ("note", note)));
    Ok(lines.iter().map(|(name, value)| format!("{name:<12} {value}\n")).collect())
}

fn describe_sensor(sensor: &SensorSettings) -> String {
    let film = &sensor.film;
    let pixels = counted(film.rect().area(), "pixel", "pixels");
    format!("{}, {}x{}, {pixels} to render", sensor.kind(), film.width, film.height)
}

/// Describes what a scene is when it is rendered, and what that needs with its sensors.
fn describe_compiled(
    session: &Session,
    sensors: &[SensorSettings],
    no_pilot: bool,
) -> Vec<(&'static str, String)> {
    let Session { scene, report, defaults, .. } = session;
    let mut lines = vec![
        ("shapes", count(scene.shapes.iter().map(|s| shape_kind(&s.world)))),
        ("triangles", scene.triangle_count().to_string()),
        ("materials", count(scene.materials.iter().map(|m| m.kind()))),
        ("emitters", count(scene.lights.iter().map(|l| l.kind()))),
        ("needs", scene.needs.to_string()),
        ("memory", memory(scene, &session.memory)),
    ];
    if scene.bounds.min.is_finite() {
        lines.push(("bounds", format!("{} to {}", scene.bounds.min, scene.bounds.max)));
    }
    for sensor in sensors {
        lines.push(("to render", to_render(&RenderMemory::least(&sensor.film), &session.memory)));
    }
    lines.push(("build", format!("{:.3} s ({})", report.build_seconds, scene.accel.name())));
    if let Some(spp) = defaults.samples_per_pixel {
        lines.push(("samples", format!("{spp} per pixel")));
    }
    if let Some(sensor) = sensors.first().filter(|_| !no_pilot) {
        let time = time(session, &sensor.film).unwrap_or_else(|e| format!("unknown: {}", e.message));
        lines.push(("time", time));
    }
    lines
}

/// Estimates the time of a render with the settings of the file, from a pilot with a smaller image.
fn time(session: &Session, film: &FilmSettings) -> Result<String> {
    let mut plan = session.plan(&Choices { replace_independent: true, ..Choices::default() })?;
    let samples = plan.job.stop.samples.unwrap_or_default();
    plan.job.stop.time = Some(PILOT_TIME);
    let pilot = session.render(&plan, &Progress::new())?;
    let all = film.rect().area() as f64 * samples as f64;
    let taken = pilot.rect.area() as f64 * pilot.samples_per_pixel as f64;
    let seconds = pilot.prepared.as_secs_f64() + pilot.elapsed.as_secs_f64() * all / taken;
    let threads = counted(session.threads as u64, "thread", "threads");
    Ok(format!(
        "about {seconds:.2} s for {samples} samples per pixel with {threads}, estimated from a small image"
    ))
}

/// Describes the memory of the scene.
fn memory(scene: &Scene, memory: &Budget) -> String {
    let [meshes, accel] = [scene.mesh_bytes(), scene.accel.memory_bytes()].map(|n| Amount(n as u64));
    let all = Amount(memory.planned());
    format!("meshes {meshes}, acceleration structure {accel}; {all} with textures and the program itself")
}

/// Describes the additional memory for a render with a sensor, and the memory left.
fn to_render(needed: &RenderMemory, memory: &Budget) -> String {
    let [film, image, left] = [needed.film, needed.image, memory.left()].map(Amount);
    let there = match memory.limit() {
        None => String::new(),
        Some(_) if needed.total() > memory.left() => format!("; too much: {left} are left"),
        Some(limit) => format!("; {left} of {} are left", Amount(limit)),
    };
    format!("film {film}, image {image}{there}")
}

/// Formats a list of kinds as "2 cube, 1 sphere".
fn count(kinds: impl Iterator<Item = &'static str>) -> String {
    let mut counts = BTreeMap::<&str, usize>::new();
    kinds.for_each(|kind| *counts.entry(kind).or_default() += 1);
    if counts.is_empty() {
        return "none".into();
    }
    counts.iter().map(|(kind, n)| format!("{n} {kind}")).collect::<Vec<_>>().join(", ")
}

fn shape_kind(shape: &WorldShape) -> &'static str {
    match shape {
        WorldShape::Mesh(_) => "mesh",
        WorldShape::Rectangle { .. } => "rectangle",
        WorldShape::Sphere { .. } => "sphere",
        WorldShape::Disk { .. } => "disk",
        WorldShape::Cylinder { .. } => "cylinder",
        WorldShape::Curves(_) => "curves",
        WorldShape::SdfGrid(_) => "sdfgrid",
    }
}
