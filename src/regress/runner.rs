//! The test of one scene: loads it, renders it, and compares it with its reference or writes the reference.

use super::judge::{Judgement, Rules, judge};
use super::reference::{Reference, reference_path, variance_path, write_reference};
use super::{FoundScene, Options, REFERENCE_SEED, RegressRow, Status, Update, cross, page};
use crate::compare::{DynamicRange, ZTestOptions, flip, mean_flip, z_test_with};
use crate::error::{Error, Kind, Result, counted};
use crate::film::PixelFormat;
use crate::image::Image;
use crate::integrator::settings::Aov;
use crate::render::output;
use crate::render::{Progress, Rendered, StopRules};
use crate::session::{Choices, Plan, SceneChoices, SceneFile, Session, connected};
use std::time::{Duration, Instant};

/// Samples per pixel if the scene does not specify them.
const DEFAULT_SPP: u64 = 64;
/// The greatest factor on the scene's samples that is used to reach the gain: for a test, and for a reference.
const MOST: [u64; 2] = [16, 64];
/// The least number of samples of a reference, divided by those of a test.
const REFERENCE_SAMPLES: u64 = 16;

/// Samples per pixel of the render from which the time of a reference is forecast.
const PILOT: u64 = 8;
/// The number of samples up to which the time of a reference is not forecast.
const FEW: u64 = 8 * PILOT;
/// The time below which a forecast is not reported.
const SHORT: Duration = Duration::from_secs(10);

/// The settings of a run.
pub(super) struct Runner<'a> {
    pub options: &'a Options,
    pub rules: Rules,
    pub progress: &'a Progress,
}

/// A render to be tested.
pub(super) struct Picture {
    pub image: Image,
    /// The image of each replicate, if pixels share noise.
    pub replicates: Vec<Image>,
    pub samples_per_pixel: u64,
    /// A message about dropped samples, if there are any.
    pub dropped: Option<String>,
    /// Rays to the closest surface per path.
    pub rays_per_sample: f64,
}

/// The result of a test.
pub(super) struct Outcome {
    pub status: Status,
    pub message: String,
    pub samples_per_pixel: u64,
    pub shown: Option<page::Shown>,
}

impl Outcome {
    pub fn new(status: Status, message: impl Into<String>) -> Self {
        Outcome { status, message: message.into(), samples_per_pixel: 0, shown: None }
    }

    fn interrupted() -> Self {
        Outcome::new(Status::NotRun, "interrupted")
    }
}

impl<'a> Runner<'a> {
    pub fn new(options: &'a Options, significance: f64, progress: &'a Progress) -> Self {
        Runner { options, rules: Rules { significance, fail: options.fail }, progress }
    }

    /// Tests a scene.
    pub fn row(&self, scene: &FoundScene) -> RegressRow {
        let started = Instant::now();
        let mut warnings = Vec::new();
        let outcome = if self.progress.is_interrupted() {
            Ok(Outcome::interrupted())
        } else if self.options.cross_accel {
            cross::test(self, scene, &mut warnings)
        } else {
            self.test(scene, &mut warnings)
        };
        let mut outcome = outcome.unwrap_or_else(|error| Outcome::new(Status::Error, error.to_string()));
        let mut shown = None;
        if let (Some(pictures), Some(folder)) = (&outcome.shown, &self.options.output) {
            match pictures.write(folder, &scene.name, &outcome.message) {
                Ok(html) => shown = Some(html),
                Err(error) => {
                    outcome.status = Status::Error;
                    outcome.message = format!("{}; {error}", outcome.message);
                }
            }
        }
        RegressRow {
            name: scene.name.clone(),
            status: outcome.status,
            message: outcome.message,
            samples_per_pixel: outcome.samples_per_pixel,
            elapsed: started.elapsed(),
            warnings,
            shown,
            case: None,
        }
    }

    fn test(&self, scene: &FoundScene, warnings: &mut Vec<Error>) -> Result<Outcome> {
        let update = self.options.update;
        let reference = match Reference::read(&scene.path) {
            Err(_) if update == Some(Update::All) => None,
            read => read?,
        };
        let session = self.open(scene, warnings)?;
        let Some(reference) = reference.filter(|_| update != Some(Update::All)) else {
            return if update.is_some() {
                self.write(scene, &session, "")
            } else {
                let path = reference_path(&scene.path);
                Ok(Outcome::new(Status::New, format!("no {}; --update writes it", path.display())))
            };
        };
        let Some(picture) = self.sample(&session, &reference)? else { return Ok(Outcome::interrupted()) };
        let mut judgement = judge(&picture.image, picture.samples_per_pixel, &reference, &self.rules);
        judgement.faults.extend(picture.dropped.clone());
        if judgement.faults.is_empty() {
            let samples_per_pixel = picture.samples_per_pixel;
            let figures = with_flip(&picture.image, &reference.image, &judgement.figures);
            return Ok(Outcome { samples_per_pixel, ..Outcome::new(Status::Pass, figures) });
        }
        let message = with_flip(&picture.image, &reference.image, &judgement.faults.join("; "));
        if update == Some(Update::Failed) {
            return self.write(scene, &session, &format!("; it was: {message}"));
        }
        let samples_per_pixel = picture.samples_per_pixel;
        let shown = Some(shown(picture.image, reference.image, judgement));
        Ok(Outcome { samples_per_pixel, shown, ..Outcome::new(Status::Fail, message) })
    }

    /// Loads a scene and compiles it for the selected traversal.
    fn open(&self, scene: &FoundScene, warnings: &mut Vec<Error>) -> Result<Session> {
        let mut file = self.load(scene, &[], warnings)?;
        file.pass_panes(self.options.choices.integrator.as_deref());
        let mut session = file.compile(self.options.accel, self.options.threads)?;
        self.warn(&mut session.warnings, warnings)?;
        Ok(session)
    }

    /// Loads a scene with additional definitions; of several with the same name, the last one counts. Its film becomes
    /// linear RGB, with alpha if the scene's film has it.
    pub fn load(
        &self,
        scene: &FoundScene,
        defines: &[(String, String)],
        warnings: &mut Vec<Error>,
    ) -> Result<SceneFile> {
        let mut load = self.options.load.clone();
        for (name, value) in defines {
            load.defines.retain(|(other, _)| other != name);
            load.defines.push((name.clone(), value.clone()));
        }
        let choices = SceneChoices { load, ..SceneChoices::default() };
        let mut file = SceneFile::load(&scene.path, &choices)?;
        self.warn(&mut file.take_warnings(self.options.strict), warnings)?;
        let film = &mut file.description.sensors[file.sensor].film;
        film.pixel_format = if film.pixel_format.has_alpha() { PixelFormat::Rgba } else { PixelFormat::Rgb };
        Ok(file)
    }

    /// Adds warnings to a list, or fails with them if warnings are errors.
    pub fn warn(&self, new: &mut Vec<Error>, warnings: &mut Vec<Error>) -> Result<()> {
        if self.options.strict && !new.is_empty() {
            let first = new.remove(0);
            return Err(Error { kind: Kind::Strict, ..first }.with_others(std::mem::take(new)));
        }
        warnings.append(new);
        Ok(())
    }

    /// Returns the samples per pixel of a test, before any are added.
    pub fn samples(&self, session: &Session) -> u64 {
        // Each half needs one sample.
        self.options.samples.or(session.defaults.samples_per_pixel).unwrap_or(DEFAULT_SPP).max(2)
    }

    /// Plans the render of a scene.
    pub fn plan(&self, session: &Session, samples: u64, seed: u64) -> Result<Plan> {
        self.plan_with(session, self.options.choices.integrator.as_deref(), samples, seed)
    }

    /// Plans the render of a scene with an integrator.
    pub fn plan_with(
        &self,
        session: &Session,
        integrator: Option<&str>,
        samples: u64,
        seed: u64,
    ) -> Result<Plan> {
        let stop = StopRules { samples: Some(samples), ..StopRules::default() };
        let aov = vec!["variance".to_owned()];
        // Cases are claimed by what connects paths.
        let connections = connected(integrator.unwrap_or_else(|| session.defaults.integrator_name()));
        let integrator = integrator.map(str::to_owned);
        let choices = Choices { integrator, connections, stop, aov, seed, ..self.options.choices.clone() };
        let mut plan = session.plan(&choices)?;
        // The reference has another number of samples.
        plan.job.layers.retain(|layer| layer.aov != Aov::Samples);
        Ok(plan)
    }

    /// Renders; returns `None` if it was interrupted.
    pub fn render(&self, session: &Session, plan: &Plan) -> Result<Option<Picture>> {
        let rendered = session.render(plan, self.progress)?;
        if self.progress.is_interrupted() {
            return Ok(None);
        }
        let image = session.image(plan, &rendered);
        let samples_per_pixel = rendered.samples_per_pixel;
        let counters = &rendered.counters;
        let rays_per_sample = counters.closest_rays as f64 / counters.paths.max(1) as f64;
        let replicates = match plan.job.sampler.replicates() {
            2 => Vec::new(),
            _ => output::replicate_images(&rendered),
        };
        let dropped = dropped(&rendered);
        Ok(Some(Picture { image, replicates, samples_per_pixel, dropped, rays_per_sample }))
    }

    /// Renders a scene with as many samples as its test needs.
    fn sample(&self, session: &Session, reference: &Reference) -> Result<Option<Picture>> {
        // More samples do not reduce the noise of the reference.
        let limit = self.options.gain.max(1.5 * gain_of_reference(reference, &self.rules));
        let gain = |picture: &Picture| {
            judge(&picture.image, picture.samples_per_pixel, reference, &self.rules).gain.unwrap_or(0.0)
        };
        let seed = self.options.choices.seed;
        let first = self.samples(session);
        let most = if self.options.samples.is_some() { first } else { first.saturating_mul(MOST[0]) };
        self.render_until(session, seed, [first, most], None, limit, gain)
    }

    /// Renders with at least twice the samples each time, until the gain is at most `limit`, the number of samples is
    /// `most`, or the deadline is near. Only the last render is tested, because each additional test would increase the
    /// probability of a failure by chance.
    fn render_until(
        &self,
        session: &Session,
        seed: u64,
        [first, most]: [u64; 2],
        deadline: Option<Instant>,
        limit: f64,
        gain: impl Fn(&Picture) -> f64,
    ) -> Result<Option<Picture>> {
        let mut samples = first;
        loop {
            let mut plan = self.plan(session, samples, seed)?;
            let started = Instant::now();
            plan.job.stop.time = deadline.map(|deadline| deadline.saturating_duration_since(started));
            let Some(picture) = self.render(session, &plan)? else { return Ok(None) };
            let gain = gain(&picture);
            let done = picture.samples_per_pixel;
            if samples >= most || done < samples || gain <= limit || !gain.is_finite() {
                return Ok(Some(picture));
            }
            let left = deadline.map(|deadline| deadline.saturating_duration_since(Instant::now()));
            if left.is_some_and(|left| left < 2 * started.elapsed()) {
                return Ok(Some(picture));
            }
            // Variances decrease at least in inverse proportion to the number of samples.
            let doublings = (2.0 * (gain / limit).log2()).ceil().clamp(1.0, 20.0) as u32;
            samples = samples.saturating_mul(1 << doublings).min(most);
        }
    }

    /// Reports the time that a reference will take if it is long or exceeds the limit. The forecast comes from a render
    /// of a few samples.
    fn forecast(&self, scene: &FoundScene, session: &Session, [first, most]: [u64; 2]) -> Result<()> {
        if first <= FEW {
            return Ok(());
        }
        let plan = self.plan(session, PILOT, REFERENCE_SEED)?;
        let pilot = session.render(&plan, self.progress)?;
        let taken = pilot.samples_per_pixel.max(1) as f64;
        let time = |samples: u64| pilot.prepared + pilot.elapsed.mul_f64(samples as f64 / taken);
        let limit = self.options.update_time;
        if self.progress.is_interrupted() || time(first) < limit.map_or(SHORT, |limit| limit.min(SHORT)) {
            return Ok(());
        }
        let more = match most > first && limit.is_none_or(|limit| time(first) < limit) {
            true => format!(", and up to {} for {most}", duration(time(most))),
            false => String::new(),
        };
        let allowed = limit.map_or_else(String::new, |limit| format!("; --time allows {}", duration(limit)));
        let time = duration(time(first));
        (self.options.note)(&format!(
            "{}: the reference takes about {time} for {first} samples per pixel{more}{allowed}",
            scene.name
        ));
        Ok(())
    }

    /// Renders and writes the reference of a scene.
    fn write(&self, scene: &FoundScene, session: &Session, why: &str) -> Result<Outcome> {
        let first = self.samples(session).saturating_mul(REFERENCE_SAMPLES);
        let [first, most] = match self.options.update_samples {
            Some(samples) => [samples; 2],
            None => [first, self.samples(session).saturating_mul(MOST[1])],
        };
        let gain = |picture: &Picture| {
            let reference = Reference { image: picture.image.clone(), variance: None };
            gain_of_reference(&reference, &self.rules)
        };
        let limit = 0.5 * self.options.gain;
        let deadline = self.options.update_time.map(|time| Instant::now() + time);
        self.forecast(scene, session, [first, most])?;
        let picture = self.render_until(session, REFERENCE_SEED, [first, most], deadline, limit, gain)?;
        let Some(picture) = picture else { return Ok(Outcome::interrupted()) };
        if let Some(dropped) = picture.dropped {
            return Err(Error::scene(format!("the reference was not written: {dropped}")));
        }
        let path = write_reference(&scene.path, &picture.image)?;
        let stale = variance_path(&scene.path);
        let stale = if stale.exists() {
            format!("; {} is not used any more", stale.display())
        } else {
            String::new()
        };
        let samples_per_pixel = picture.samples_per_pixel;
        let bounded = if samples_per_pixel < first {
            format!("; --time allowed {samples_per_pixel} of {first} samples per pixel")
        } else {
            String::new()
        };
        let message = format!("{}{bounded}{stale}{why}", path.display());
        Ok(Outcome { samples_per_pixel, ..Outcome::new(Status::Wrote, message) })
    }
}

/// Returns a message after the FLIP error, which says what a viewer sees and decides nothing. Images that cannot be
/// compared have none.
fn with_flip(image: &Image, reference: &Image, message: &str) -> String {
    match flip(image, reference, DynamicRange::High) {
        Ok(map) => format!("FLIP {:.4}; {message}", mean_flip(&map)),
        Err(_) => message.to_owned(),
    }
}

/// Formats a time as `5.9 s`, `12 min` or `3.4 h`.
fn duration(time: Duration) -> String {
    let seconds = time.as_secs_f64();
    let (number, unit) = match seconds {
        s if s < 120.0 => (s, "s"),
        s if s < 7200.0 => (s / 60.0, "min"),
        s => (s / 3600.0, "h"),
    };
    if number < 10.0 { format!("{number:.1} {unit}") } else { format!("{number:.0} {unit}") }
}

/// Returns the detectable gain of a test whose render has no noise; 0 if the noise is unknown.
fn gain_of_reference(reference: &Reference, rules: &Rules) -> f64 {
    let variance_of_b = reference.variance.as_ref();
    let options = ZTestOptions { variance_of_b, significance: 0.5 * rules.significance, sample_ratio: None };
    let gain = z_test_with(&reference.image, &reference.image, &options).map_or(0.0, |test| test.gain);
    // The test adds the variances of both images. The reference is both images here, so its variance is counted twice
    // unless it is in a separate file.
    if variance_of_b.is_some() { gain } else { gain / f64::sqrt(2.0) }
}

/// Returns a message about dropped samples.
fn dropped(rendered: &Rendered) -> Option<String> {
    let count = counted(rendered.invalid_count, "invalid sample", "invalid samples");
    (rendered.invalid_count > 0).then(|| match rendered.invalid.first() {
        Some(s) => format!(
            "{count} dropped, the first is sample {} of pixel ({}, {}): {:?}",
            s.sample, s.x, s.y, s.value
        ),
        None => format!("{count} dropped"),
    })
}

/// Returns the images of a failed test.
fn shown(image: Image, reference: Image, judgement: Judgement) -> page::Shown {
    page::Shown {
        names: ["render".into(), "reference".into()],
        images: [image, reference],
        scores: judgement.scores,
    }
}
