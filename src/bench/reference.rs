//! References: given by the user, stored beside the scene, or rendered once and cached.

use super::measure::{Candidate, picture};
use super::{Budget, Options, cache};
use crate::compare;
use crate::error::{Error, Result};
use crate::estimate::metrics::relative_squared;
use crate::image::{self, Image, Value, WriteOptions};
use crate::integrator::{DirectIntegrator, PathIntegrator, Plugin, Settings, VolpathIntegrator};
use crate::render::{Progress, StopRules};
use crate::sampling::SamplerKind;
use crate::session::{Choices, Session};
use crate::util::relative;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// An image that stands for the truth.
#[derive(Clone, Debug)]
pub struct Reference {
    /// The image, with the channels red, green and blue.
    pub image: Image,
    /// The file of the image; `None` if it was rendered.
    pub file: Option<PathBuf>,
    /// A description of how it was made, which follows the path of its file if there is one.
    pub made: String,
    /// Its own relMSE, which is part of every measured relMSE; `None` if it is unknown.
    pub floor: Option<f64>,
}

impl Reference {
    /// Returns the origin of the reference in words. Its path is relative to the folder, or as it was given.
    pub fn origin(&self, folder: Option<&Path>) -> String {
        let file = self.file.as_deref().map(|file| folder.map_or(file.to_owned(), |f| relative(file, f)));
        format!("{}{}", file.map_or_else(String::new, |file| file.display().to_string()), self.made)
    }
}

/// The samples or time of a rendered reference divided by those of the largest budget.
const EFFORT: u32 = 32;
/// The fraction of the requested time from which a cached reference is used. Renders stop before their limit.
const NEARLY: f64 = 0.8;
/// The difference between the seeds of the reference and of the measured images.
const OTHER_SEED: u64 = 0x5851_f42d_4c95_7f2d;

/// Finds the reference, or renders and stores it.
pub(super) fn find(
    session: &Session,
    options: &Options,
    key: String,
    candidates: &[Candidate<'_>],
    progress: &Progress,
    tell: &dyn Fn(&str),
) -> Result<Reference> {
    if let Some(path) = &options.reference {
        let reference = read(path)?;
        return match misfit(&reference.image, session) {
            Some(why) => Err(Error::usage(why).in_file(path).about("--reference")),
            None => Ok(reference),
        };
    }
    if let Some(reference) = beside_the_scene(session, options, tell) {
        return Ok(reference);
    }
    let plan = Wanted::new(options);
    let integrator = reference_integrator(session, candidates)?;
    let key = if integrator == PathIntegrator::NAME { key } else { format!("{key}-{integrator}") };
    let cached = cache::file(&session.path, &key);
    if let Some(path) = cached.as_deref().filter(|path| path.exists()) {
        // A file that cannot be read is rendered again.
        if let Some(reference) =
            read(path).ok().filter(|r| plan.is_met_by(&r.image) && misfit(&r.image, session).is_none())
        {
            tell(&format!("{}: the reference is {}", session.path.display(), path.display()));
            return Ok(reference);
        }
    }
    let reference = render(session, options, &plan, integrator, progress, tell)?;
    if let Some(path) = cached.filter(|_| !progress.is_interrupted()) {
        let folder = path.parent().unwrap_or(Path::new("."));
        let kept = std::fs::create_dir_all(folder)
            .map_err(|e| Error::output(format!("cannot be made: {e}")).in_file(folder))
            .and_then(|()| image::write(&path, &reference.image, &WriteOptions::default()));
        if let Err(error) = kept {
            tell(&format!("warning: the reference is not kept: {error}"));
        }
    }
    Ok(reference)
}

/// The effort for a rendered reference.
struct Wanted {
    stop: StopRules,
}

impl Wanted {
    fn new(options: &Options) -> Self {
        let mut stop = StopRules { time: Some(options.reference_time), ..StopRules::default() };
        let samples =
            options.budgets.iter().filter_map(|b| if let Budget::Samples(n) = b { Some(*n) } else { None });
        let times =
            options.budgets.iter().filter_map(|b| if let Budget::Time(t) = b { Some(*t) } else { None });
        match (samples.max(), times.max()) {
            (Some(n), None) => stop.samples = Some(n.saturating_mul(u64::from(EFFORT))),
            (None, Some(t)) => stop.time = Some(t.saturating_mul(EFFORT).min(options.reference_time)),
            // With limits of both kinds, or none, only the time limit applies.
            _ => {}
        }
        Wanted { stop }
    }

    /// Returns whether an image was made with at least this effort.
    fn is_met_by(&self, image: &Image) -> bool {
        let samples = match image.metadata.get("samplesPerPixel") {
            Some(Value::Int(n)) => u64::try_from(*n).unwrap_or(0),
            _ => 0,
        };
        let seconds = match image.metadata.get("renderTimeSeconds") {
            Some(Value::Float(s)) => f64::from(*s),
            _ => 0.0,
        };
        let time = self.stop.time.unwrap_or(Duration::MAX).as_secs_f64();
        self.stop.samples.is_some_and(|n| samples >= n) || seconds >= NEARLY * time
    }
}

/// Returns the name of the integrator of a reference for the candidates. If all compute direct light only, so does it.
///
/// # Errors
/// If some candidates render the media of the scene and others ignore them.
fn reference_integrator(session: &Session, candidates: &[Candidate<'_>]) -> Result<&'static str> {
    let settings: Vec<&Settings> = candidates.iter().filter_map(Candidate::integrator).collect();
    if session.scene.uses_media() {
        let rendering = settings.iter().filter(|settings| settings.renders_media()).count();
        if rendering > 0 && rendering < settings.len() {
            let message =
                "some of the integrators render the scene's media and others ignore them: measure one kind";
            return Err(Error::usage(message).about("--integrators"));
        }
        if rendering > 0 {
            return Ok(VolpathIntegrator::NAME);
        }
    }
    let direct =
        settings.len() == candidates.len() && settings.iter().all(|s| matches!(s, Settings::Direct(_)));
    Ok(if direct { DirectIntegrator::NAME } else { PathIntegrator::NAME })
}

fn render(
    session: &Session,
    options: &Options,
    wanted: &Wanted,
    integrator: &str,
    progress: &Progress,
    tell: &dyn Fn(&str),
) -> Result<Reference> {
    let choices = Choices {
        integrator: Some(integrator.into()),
        sampler: Some(SamplerKind::default()),
        stop: wanted.stop,
        seed: options.seed.wrapping_add(OTHER_SEED),
        ..Choices::default()
    };
    let samples = wanted.stop.samples.map_or_else(String::new, |n| format!("{n} samples per pixel, "));
    let seconds = wanted.stop.time.unwrap_or_default().as_secs_f64();
    tell(&format!(
        "{}: rendering a reference by {integrator}: {samples}{seconds} s at most (--reference-time)",
        session.path.display()
    ));
    let plan = session.plan(&choices)?;
    let rendered = session.render(&plan, progress)?;
    let image = picture(&session.image(&plan, &rendered));
    let made = format!(
        "rendered by {integrator} with {}, {} samples per pixel in {:.1} s",
        SamplerKind::default(),
        rendered.samples_per_pixel,
        rendered.elapsed.as_secs_f64()
    );
    tell(&format!(
        "{}: the reference has {} samples per pixel, its relMSE is about {}",
        session.path.display(),
        rendered.samples_per_pixel,
        rendered.relmse.map_or_else(|| "unknown".into(), |e| format!("{e:.1e}"))
    ));
    Ok(Reference { image, file: None, made, floor: rendered.relmse })
}

/// Returns `refs/<stem>.exr` beside the scene, if it fits the measured image.
fn beside_the_scene(session: &Session, options: &Options, tell: &dyn Fn(&str)) -> Option<Reference> {
    let stem = session.path.file_stem()?.to_string_lossy();
    let path = session.path.parent()?.join("refs").join(format!("{stem}.exr"));
    if !path.exists() {
        return None;
    }
    let choices = &options.choices;
    let reason = if !choices.load.defines.is_empty() || choices.sensor != 0 {
        Err("it is of the scene as its file has it".to_string())
    } else {
        read(&path).map_err(|e| e.to_string()).and_then(|r| match misfit(&r.image, session) {
            Some(why) => Err(why),
            None => Ok(r),
        })
    };
    reason.map_err(|why| tell(&format!("note: {} is no reference here: {why}", path.display()))).ok()
}

/// Returns the reason why an image cannot be compared with those of the session, if there is one.
fn misfit(image: &Image, session: &Session) -> Option<String> {
    let rect = session.camera().film.rect();
    let (width, height) = (rect.width as usize, rect.height as usize);
    let (w, h) = (image.width, image.height);
    let unlike = (w, h) != (width, height);
    unlike.then(|| format!("expected {width}x{height} pixels as the scene has, found {w}x{h}"))
}

/// Reads a reference and, if possible, its error.
fn read(path: &Path) -> Result<Reference> {
    let whole = image::read(path)?;
    let invalid = compare::invalid(&whole);
    if invalid.any() {
        return Err(Error::output(format!("expected numbers, found {invalid}")).in_file(path));
    }
    let Some(rgb) = whole.rgb_channels() else {
        let found = whole.channels.join(", ");
        return Err(Error::output(format!("expected the channels R, G, B or Y, found {found}")).in_file(path));
    };
    let names = rgb.map(|c| whole.channels[c].clone());
    let image = picture(&whole);
    let floor = match whole.metadata.get("buffon:relmse") {
        Some(Value::Float(relmse)) => Some(f64::from(*relmse)),
        _ => variances(&whole, &names, path).map(|v| mean_relative(&v, &image.data)),
    };
    let told = |name| whole.metadata.get(name);
    let made = match (told("samplesPerPixel"), told("buffon:integrator")) {
        (Some(Value::Int(n)), Some(Value::Text(integrator))) => {
            format!(", {n} samples per pixel by {integrator}")
        }
        _ => String::new(),
    };
    Ok(Reference { image, file: Some(path.to_owned()), made, floor })
}

/// Returns the variances of an image's channels, from its layers `variance.*` or from the channels of `<stem>_var.exr`.
fn variances(whole: &Image, names: &[String; 3], path: &Path) -> Option<Vec<f32>> {
    if let Some(layer) = whole.select(&names.each_ref().map(|n| format!("variance.{n}"))) {
        return Some(layer.data);
    }
    let stem = path.file_stem()?.to_string_lossy();
    let beside = image::read(&path.with_file_name(format!("{stem}_var.exr"))).ok()?;
    let fits =
        (beside.width, beside.height) == (whole.width, whole.height) && beside.rgb_channels().is_some();
    fits.then(|| beside.colours())
}

/// Returns the expected relative squared error of values with these variances.
fn mean_relative(variances: &[f32], values: &[f32]) -> f64 {
    let error = |(v, r): (&f32, &f32)| relative_squared(f64::from(r + v.max(0.0).sqrt()), f64::from(*r));
    variances.iter().zip(values).map(error).sum::<f64>() / values.len() as f64
}
