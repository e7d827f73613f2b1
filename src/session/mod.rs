//! A scene file that is opened to be rendered: loaded, adjusted to what the user asks for, compiled, rendered to an
//! image.
//!
//! Every command that renders goes through the same three steps. [`SceneFile`] is what a file and the user's choices
//! about it say; compiled for a traversal it is a [`Session`], which makes any number of [`Plan`]s (an integrator, a
//! sampler, stop rules) into renders.

pub mod checkpoint;
mod memory;
pub mod origin;
mod picture;
mod plan;

pub use memory::RenderMemory;
pub use origin::Origin;
pub use picture::Picture;
pub use plan::{Choices, Plan};

use crate::accel::AccelKind;
use crate::error::{Error, Result, counted};
use crate::film::PixelRect;
use crate::image::Image;
use crate::integrator::{self, Preparation, Settings};
use crate::loader::{self, LoadOptions, Loaded};
use crate::memory::Budget;
use crate::render::{self, Job, Keeper, Progress, Rendered, State};
use crate::sampling::SamplerKind;
use crate::scene::description::Description;
use crate::scene::{CompileOptions, CompileReport, Scene, compile_within};
use crate::sensor::{Camera, SensorSettings};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// What the user says of the scene itself.
#[derive(Clone, Debug, Default)]
pub struct SceneChoices {
    /// Values for the scene's `<default>`s, and folders to look for files in.
    pub load: LoadOptions,
    /// Which sensor, from 0.
    pub sensor: usize,
    /// Size of the full image instead of the scene's, whose crop is then dropped.
    pub size: Option<(u32, u32)>,
    /// The part of the image to render.
    pub crop: Option<PixelRect>,
}

/// A scene file with the user's choices, not yet compiled.
#[derive(Clone, Debug)]
pub struct SceneFile {
    /// Where it is.
    pub path: PathBuf,
    /// What is in the scene.
    pub description: Description,
    /// Which sensor is to be rendered.
    pub sensor: usize,
    /// What the file asks for, where the user does not.
    pub defaults: Defaults,
    /// What was ignored, mapped or upgraded.
    pub warnings: Vec<Error>,
    /// What the user should know but need not change.
    pub notes: Vec<String>,
    /// Time to load it.
    pub load_seconds: f64,
    /// What is planned of memory.
    pub memory: Budget,
    /// Whether the user chose the size of the image.
    pub sized_by_user: bool,
}

/// How a scene file wants to be rendered.
#[derive(Clone, Debug, Default)]
pub struct Defaults {
    /// The integrator.
    pub integrator: Settings,
    /// The sampler; `None` where it names none.
    pub sampler: Option<SamplerKind>,
    /// Samples per pixel.
    pub samples_per_pixel: Option<u64>,
}

impl SceneFile {
    /// Loads a scene file and applies the choices.
    ///
    /// # Errors
    /// If it cannot be loaded, has no such sensor, if the crop is no part of the image, or if there is no memory for
    /// the image.
    pub fn load(path: &Path, choices: &SceneChoices) -> Result<Self> {
        let started = Instant::now();
        let Loaded { mut description, integrator, sampler, samples_per_pixel, warnings, notes, memory } =
            loader::load(path, &choices.load)?;
        let load_seconds = started.elapsed().as_secs_f64();
        let sensors = description.sensors.len();
        let Some(sensor) = description.sensors.get_mut(choices.sensor) else {
            return Err(Error::usage(format!(
                "--sensor {}: the scene has {}, counted from 0",
                choices.sensor,
                counted(sensors as u64, "sensor", "sensors")
            )));
        };
        adjust(sensor, choices)?;
        let sized_by_user = choices.size.is_some();
        // Also asked when everything is known; but a scene need not be built for an image that cannot be.
        let least = RenderMemory::least(&sensor.film);
        drop(memory::reserve(path, &sensor.film, sized_by_user, least, &memory)?);
        let samples_per_pixel = samples_per_pixel.map(u64::from);
        let defaults = Defaults { integrator, sampler, samples_per_pixel };
        let path = path.to_owned();
        Ok(SceneFile {
            path,
            description,
            sensor: choices.sensor,
            defaults,
            warnings,
            notes,
            load_seconds,
            memory,
            sized_by_user,
        })
    }

    /// What renders of it belong to.
    pub fn origin(&self) -> Origin {
        Origin::of(&self.description, self.sensor)
    }

    /// Compiles the scene for a traversal, with so many threads.
    ///
    /// # Errors
    /// If the scene cannot be compiled.
    pub fn compile(self, accel: AccelKind, threads: usize) -> Result<Session> {
        let options = CompileOptions { accel, threads, sensor: self.sensor };
        let (scene, report) = compile_within(self.description, options, &self.memory)?;
        let mut warnings = report.warnings.clone();
        if report.dropped_primitives > 0 {
            let dropped = counted(report.dropped_primitives as u64, "primitive", "primitives");
            warnings.push(Error::scene(format!("{dropped} left out: not finite, or out of range")));
        }
        let SceneFile { path, sensor, defaults, memory, sized_by_user, .. } = self;
        Ok(Session { path, scene, report, sensor, defaults, threads, warnings, memory, sized_by_user })
    }
}

/// Sets size and crop of a sensor's film.
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

/// A compiled scene that is ready to be rendered.
pub struct Session {
    /// The scene file.
    pub path: PathBuf,
    /// The scene.
    pub scene: Scene,
    /// What compiling found.
    pub report: CompileReport,
    /// Which sensor is rendered.
    pub sensor: usize,
    /// What the file asks for, where the user does not.
    pub defaults: Defaults,
    /// Threads; they change the speed, never the pixels.
    pub threads: usize,
    /// What the user should change.
    pub warnings: Vec<Error>,
    /// What is planned of memory.
    pub memory: Budget,
    /// Whether the user chose the size of the image.
    sized_by_user: bool,
}

impl Session {
    /// The sensor that is rendered.
    pub fn camera(&self) -> &Camera {
        &self.scene.sensors[self.sensor]
    }

    /// Renders as planned, until a stop rule fires or the progress is interrupted.
    ///
    /// # Errors
    /// If the threads cannot be started, the integrator cannot prepare, or there is too little memory.
    pub fn render(&self, plan: &Plan, progress: &Progress) -> Result<Rendered> {
        self.render_on(plan, progress, None, None)
    }

    /// As [`render`](Self::render), going on from the state of an earlier render, if there is one, and with somebody
    /// who keeps the states of this one.
    ///
    /// # Errors
    /// As those of [`render`](Self::render).
    pub fn render_on(
        &self,
        plan: &Plan,
        progress: &Progress,
        begin: Option<State>,
        keeper: Option<Keeper<'_>>,
    ) -> Result<Rendered> {
        let _reserved = self.reserve(plan)?;
        let mut integrator = integrator::create(&plan.integrator);
        let pool = render::thread_pool(self.threads)?;
        let started = Instant::now();
        integrator.prepare(&Preparation {
            scene: &self.scene,
            camera: self.camera(),
            sampler: plan.job.sampler,
            seed: plan.job.seed,
            pool: &pool,
            interrupt: progress.interrupt_flag(),
            cache: plan.cache.clone(),
            memory: &self.memory,
        })?;
        // What has nothing to prepare takes no time, not the nanoseconds of saying so.
        let prepared = if integrator.prepares() { started.elapsed() } else { Duration::ZERO };
        let mut settings = plan.job.clone();
        settings.stop.time = settings.stop.time.map(|limit| limit.saturating_sub(prepared));
        let rendered = Job::new(&self.scene, integrator.as_ref(), self.camera(), settings, progress)
            .with_adaptive(plan.adaptive)
            .with_first(plan.first)
            .with_begin(begin)
            .with_keeper(keeper)
            .run_with(pool);
        Ok(Rendered { prepared, statistics: integrator.statistics(), ..rendered })
    }

    /// The image of a render, with layers and metadata.
    pub fn image(&self, plan: &Plan, rendered: &Rendered) -> Image {
        self.picture(plan).image(rendered)
    }
}

/// All cores.
pub fn default_threads() -> usize {
    std::thread::available_parallelism().map_or(1, usize::from)
}
