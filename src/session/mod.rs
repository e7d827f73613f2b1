//! Sessions: a scene file is loaded, adjusted to the user's choices, compiled, and rendered to an image.
//!
//! Every command that renders uses the same three steps. A [`SceneFile`] is the content of a file with the user's
//! choices. It is compiled to a [`Session`] for an accelerator. A session renders any number of [`Plan`]s, each with
//! an integrator, a sampler and stop rules.

mod auto;
pub mod checkpoint;
mod cryptomatte;
mod image_description;
mod memory;
mod plan;
mod scene_hashes;
mod techniques;

pub use auto::{Costs, Decision, Question};
pub use image_description::ImageDescription;
pub use memory::RenderMemory;
pub use plan::{Choices, Plan, connected};
pub use scene_hashes::SceneHashes;

use crate::accel::AccelKind;
use crate::error::{Error, Result, counted};
use crate::film::PixelRect;
use crate::image::{Image, Value};
use crate::integrator::settings::{AUTO, Aov, AutoSettings, WhenPays};
use crate::integrator::{Preparation, Settings};
use crate::loader::{self, LoadOptions, Loaded};
use crate::memory::Budget;
use crate::render::{self, Job, Progress, Rates, RenderState, Rendered, Sinks};
use crate::sampling::SamplerKind;
use crate::scene::description::Description;
use crate::scene::{CompileOptions, CompileReport, Scene, compile_within};
use crate::sensor::{Camera, SensorSettings};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// The user's choices that affect the scene.
#[derive(Clone, Debug, Default)]
pub struct SceneChoices {
    /// Values for the scene's `<default>`s, and folders in which files are searched.
    pub load: LoadOptions,
    /// The index of the sensor.
    pub sensor: usize,
    /// The size of the full image, in place of the scene's size. It removes the scene's crop.
    pub size: Option<(u32, u32)>,
    /// The region of the image to render.
    pub crop: Option<PixelRect>,
}

/// What is wrong with a scene that has no sensor and cannot be given one.
pub const NOTHING_TO_SEE: &str = "the scene has neither a sensor nor a shape to look at";

/// A scene file with the user's choices, before compilation.
#[derive(Clone, Debug)]
pub struct SceneFile {
    /// The path of the file.
    pub path: PathBuf,
    /// The content of the scene.
    pub description: Description,
    /// The index of the sensor to render.
    pub sensor: usize,
    /// The settings in the file, which apply unless the user chooses others.
    pub defaults: Defaults,
    /// Elements that were ignored, replaced or upgraded.
    pub warnings: Vec<Error>,
    /// What is not rendered as the file asks for.
    pub approximations: Vec<String>,
    /// Information for the user that requires no change.
    pub notes: Vec<String>,
    /// The files that the scene consists of, besides `path`.
    pub files: Vec<PathBuf>,
    /// The time of loading, in seconds.
    pub load_seconds: f64,
    /// The memory budget.
    pub memory: Budget,
    /// Whether the user chose the size of the image.
    pub sized_by_user: bool,
    /// Whether rays pass thin panes as they pass holes (see [`pass_panes`](Self::pass_panes)).
    passes_panes: bool,
}

/// The render settings of a scene file.
#[derive(Clone, Debug, Default)]
pub struct Defaults {
    /// The integrator. If pilots choose it, its limits count.
    pub integrator: Settings,
    /// How pilots choose the integrator, if the file asks for that.
    pub auto: Option<AutoSettings>,
    /// The sampler; `None` if the file names none.
    pub sampler: Option<SamplerKind>,
    /// Samples per pixel.
    pub samples_per_pixel: Option<u64>,
}

impl Defaults {
    /// Returns the name of the integrator.
    pub fn integrator_name(&self) -> &'static str {
        if self.auto.is_some() { AUTO } else { self.integrator.name() }
    }
}

impl SceneFile {
    /// Returns the content of a scene file, with its first sensor.
    pub fn of(path: &Path, loaded: Loaded) -> Self {
        let Loaded { integrator, auto, sampler, .. } = loaded;
        let samples_per_pixel = loaded.samples_per_pixel.map(u64::from);
        SceneFile {
            path: path.to_owned(),
            description: loaded.description,
            sensor: 0,
            defaults: Defaults { integrator, auto, sampler, samples_per_pixel },
            warnings: loaded.warnings,
            approximations: loaded.approximations,
            notes: loaded.notes,
            files: loaded.files,
            load_seconds: 0.0,
            memory: loaded.memory,
            sized_by_user: false,
            passes_panes: false,
        }
    }

    /// Loads a scene file and applies the choices.
    ///
    /// # Errors
    /// If the file cannot be loaded, the sensor does not exist, the crop is not inside the image, or the image
    /// exceeds the memory limit.
    pub fn load(path: &Path, choices: &SceneChoices) -> Result<Self> {
        let started = Instant::now();
        let mut file = SceneFile::of(path, loader::load(path, &choices.load)?);
        file.load_seconds = started.elapsed().as_secs_f64();
        let sensors = file.description.sensors.len();
        if sensors == 0 {
            return Err(Error::scene(NOTHING_TO_SEE).in_file(path));
        }
        let Some(sensor) = file.description.sensors.get_mut(choices.sensor) else {
            return Err(Error::usage(format!(
                "--sensor {}: the scene has {}, counted from 0",
                choices.sensor,
                counted(sensors as u64, "sensor", "sensors")
            )));
        };
        adjust(sensor, choices)?;
        file.sensor = choices.sensor;
        file.sized_by_user = choices.size.is_some();
        // This is checked again when all settings are known. The early check avoids building a scene for an image
        // that is too large.
        let film = &sensor.film;
        let least = RenderMemory::least(film);
        drop(memory::reserve(path, film, file.sized_by_user, least, &file.memory)?);
        Ok(file)
    }

    /// Removes the warnings and returns them. If `strict`, the approximations are among them.
    pub fn take_warnings(&mut self, strict: bool) -> Vec<Error> {
        let mut warnings = std::mem::take(&mut self.warnings);
        if strict {
            warnings.extend(self.approximations.iter().map(|text| Error::scene(text).in_file(&self.path)));
        }
        warnings
    }

    /// What renders of it belong to.
    pub fn origin(&self) -> SceneHashes {
        SceneHashes::of(&self.description, self.sensor)
    }

    /// Lets rays pass thin panes as they pass holes, if the integrators that will render the scene allow that: those
    /// with the given names, or that of the file if there are none. Otherwise panes scatter all rays.
    pub fn pass_panes<'a>(&mut self, integrators: impl IntoIterator<Item = &'a str>) {
        let of_file = &self.defaults.integrator;
        let settings = |name| match name {
            AUTO => Some(Settings::Path(of_file.limits().into())),
            _ => Settings::by_name(name, of_file.limits()),
        };
        let mut named = integrators.into_iter().peekable();
        self.passes_panes = match named.peek() {
            None => of_file.passes_panes(),
            Some(_) => named.all(|name| settings(name).is_some_and(|settings| settings.passes_panes())),
        };
    }

    /// Compiles the scene for an accelerator, with the given number of threads.
    ///
    /// # Errors
    /// If the scene cannot be compiled.
    pub fn compile(self, accel: AccelKind, threads: usize) -> Result<Session> {
        let SceneFile { sensor, passes_panes, .. } = self;
        let options = CompileOptions { accel, threads, sensor, passes_panes };
        let (scene, report) = compile_within(self.description, options, &self.memory)?;
        let mut warnings = report.warnings.clone();
        if report.dropped_primitives > 0 {
            let dropped = counted(report.dropped_primitives as u64, "primitive", "primitives");
            warnings.push(Error::scene(format!("{dropped} left out: not finite, or out of range")));
        }
        let SceneFile { path, sensor, defaults, approximations, memory, sized_by_user, .. } = self;
        Ok(Session {
            path,
            scene,
            report,
            sensor,
            defaults,
            threads,
            warnings,
            approximations,
            memory,
            sized_by_user,
        })
    }
}

/// Sets the size and crop of a sensor's film.
fn adjust(sensor: &mut SensorSettings, choices: &SceneChoices) -> Result<()> {
    let film = &mut sensor.film;
    if let Some((width, height)) = choices.size {
        (film.width, film.height, film.crop) = (width, height, None);
    }
    if let Some(crop) = choices.crop {
        let inside =
            |start: u32, length: u32, whole: u32| start.checked_add(length).is_some_and(|end| end <= whole);
        if !inside(crop.x, crop.width, film.width) || !inside(crop.y, crop.height, film.height) {
            return Err(Error::usage(format!(
                "--crop {},{},{},{}: expected a part of the image, which has {}x{} pixels",
                crop.x, crop.y, crop.width, crop.height, film.width, film.height
            )));
        }
        film.crop = Some(crop);
    }
    Ok(())
}

/// A compiled scene, ready to render.
pub struct Session {
    /// The scene file.
    pub path: PathBuf,
    /// The scene.
    pub scene: Scene,
    /// The diagnostics of compilation.
    pub report: CompileReport,
    /// The index of the sensor.
    pub sensor: usize,
    /// The settings in the file, which apply unless the user chooses others.
    pub defaults: Defaults,
    /// The number of threads; it affects the speed but not the pixels.
    pub threads: usize,
    /// Problems that the user should fix.
    pub warnings: Vec<Error>,
    /// What is not rendered as the file asks for.
    pub approximations: Vec<String>,
    /// The memory budget.
    pub memory: Budget,
    /// Whether the user chose the size of the image.
    sized_by_user: bool,
}

impl Session {
    /// Returns the sensor.
    pub fn camera(&self) -> &Camera {
        &self.scene.sensors[self.sensor]
    }

    /// Renders a plan until a stop rule applies or the progress is interrupted.
    ///
    /// # Errors
    /// If threads cannot be started, the integrator cannot prepare, or the memory limit is exceeded.
    pub fn render(&self, plan: &Plan, progress: &Progress) -> Result<Rendered> {
        self.render_on(plan, progress, None, Sinks::default())
    }

    /// Computes [`render`](Self::render), optionally as the continuation of an earlier state, and with
    /// receivers of its states.
    ///
    /// # Errors
    /// As [`render`](Self::render).
    pub fn render_on(
        &self,
        plan: &Plan,
        progress: &Progress,
        resumed: Option<RenderState>,
        sinks: Sinks<'_>,
    ) -> Result<Rendered> {
        self.render_through(self.camera(), plan, progress, resumed, sinks)
    }

    /// Computes [`render_on`](Self::render_on) with another camera. The memory plan does not count its image.
    fn render_through(
        &self,
        camera: &Camera,
        plan: &Plan,
        progress: &Progress,
        resumed: Option<RenderState>,
        sinks: Sinks<'_>,
    ) -> Result<Rendered> {
        let _reserved = self.reserve(plan)?;
        let mut integrator = plan.integrator.create();
        let pool = render::thread_pool(self.threads)?;
        let started = Instant::now();
        let preparation = Preparation {
            scene: &self.scene,
            camera,
            sampler: plan.job.sampler,
            seed: plan.job.seed,
            pool: &pool,
            interrupt: progress.interrupt_flag(),
            cache: plan.cache.clone(),
            memory: &self.memory,
        };
        integrator.prepare(&preparation)?;
        let _copy = self.reserve_copy(plan, integrator.as_ref())?;
        let rates = Rates::measure(integrator.as_ref(), &preparation, plan.adaptive, plan.job.stop.samples);
        // Without a preparation the time is exactly zero, not the few nanoseconds of the call.
        let prepared = if integrator.prepares() || plan.adaptive != WhenPays::Never {
            started.elapsed()
        } else {
            Duration::ZERO
        };
        let prepared = prepared + plan.decision.as_ref().map_or(Duration::ZERO, |decision| decision.elapsed);
        let mut settings = plan.job.clone();
        settings.stop.time = settings.stop.time.map(|limit| limit.saturating_sub(prepared));
        let rendered = Job::new(&self.scene, integrator.as_ref(), camera, settings, progress)
            .with_rates(rates)
            .with_first(plan.first)
            .resumed_from(resumed)
            .with_sinks(sinks)
            .prepared_in(prepared)
            .run_with(pool);
        Ok(Rendered { statistics: integrator.statistics(), ..rendered })
    }

    /// Returns the image of a render, with layers and metadata. If a layer shows indices of shapes or materials, their
    /// names are in the metadata, as a list in JSON.
    pub fn image(&self, plan: &Plan, rendered: &Rendered) -> Image {
        let mut image = self.image_description(plan).image(rendered);
        if let Some(decision) = &plan.decision {
            image.metadata.set("buffon:auto", Value::Text(decision.to_string()));
        }
        if !self.approximations.is_empty() {
            image.metadata.set("buffon:approximations", Value::Text(self.approximations.join("\n")));
        }
        let names = &self.scene.names;
        for (aov, name, list) in [
            (Aov::ShapeIndex, "buffon:shapes", &names.shapes),
            (Aov::MaterialIndex, "buffon:materials", &names.materials),
        ] {
            if plan.job.layers.iter().any(|layer| layer.aov == aov) {
                let list = serde_json::to_string(list).unwrap_or_default();
                image.metadata.set(name, Value::Text(list));
            }
        }
        image
    }
}

/// Returns the number of cores.
pub fn default_threads() -> usize {
    std::thread::available_parallelism().map_or(1, usize::from)
}
