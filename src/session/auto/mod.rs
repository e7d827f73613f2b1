//! The choice of an integrator by measurement: any with `--integrator auto`; whether connections pay with `bdpt`.
//!
//! Each candidate renders a small image of the same view, its pilot. The candidate with the smallest product of error
//! and cost renders the image. Pilots are thrown away. Costs are numbers of rays, weighted by what a ray of the
//! candidate costs as a whole, so the choice is the same on every machine and in every run. Only a time limit makes it
//! depend on the clock.
//!
//! The halves of a pilot show its error, but a pilot that has not found some light does not know that it is missing:
//! before its first firefly, a caustic is a black, exact pixel. So the pilots are compared with each other in blocks of
//! pixels. A block that is darker in one pilot than in another, by more than both know, adds to the error of the darker
//! one. Candidates that are only consistent are biased. The squared bias is measured in pixels, against an unbiased
//! pilot, and scaled to the photon radii of the image. Their noise decreases more slowly than that of others.
//!
//! If the user allows a bias, `irrcache` and `photonmapper` take part, whose bias remains with any number of samples.
//! It is measured in the same blocks, and is part of the error of the image.

mod blocks;
mod candidates;
mod costs;

pub use candidates::Question;
pub use costs::Costs;

use super::plan::{DEFAULT_SPP, connected};
use super::{Choices, Session};
use crate::error::{Error, Result};
use crate::integrator::settings::{AUTO, AutoSettings, HiddenLight, Plugin, WhenPays};
use crate::integrator::{Bdpt, PathIntegrator, Statistic};
use crate::render::{Progress, Sinks, StopRules};
use crate::sensor::Camera;
use crate::util::wording::percent;
use blocks::{Bias, Blocks};
use candidates::{BIASED, Candidate, SECOND};
use std::fmt;
use std::time::{Duration, Instant};

/// Makes the random numbers of pilots whose bias is measured others than those of the pilots beside them.
const OTHER_SEED: u64 = 0x6269_6173;
/// The least cost of the image, in nearest-hit queries, at which candidates with a bias have pilots: the preparation of
/// a pilot costs some 10^7.
const WORTH_A_PREPARATION: f64 = 1e8;
/// The greatest share of the cost of the image that a preparation may take.
const LARGEST_PREPARATION: f64 = 0.5;
/// The samples of each pixel of a pilot.
const SAMPLES: u64 = 16;
/// The share of the samples of the image that the pilot of one candidate takes.
const SHARE: f64 = 0.008;
/// The numbers of pixels of a pilot. Fewer show too little of the image.
const FEWEST_PIXELS: f64 = 3072.0;
const MOST_PIXELS: f64 = 24576.0;
/// The samples per pixel of the image if only its error is given, and the samples of pixels in a second if only its
/// time is. They set the size of the pilots; the clock would make them different in each run.
const USUAL_SAMPLES: f64 = 256.0;
const USUAL_RATE: f64 = 1e6;
/// The rates of candidates whose bias vanishes, whose photon radii have squares in proportion to N^(α - 1) after N
/// passes: their noise decreases as N^-α. [Knaus and Zwicker 2011] This is the α of `sppm`; `vcm` has 0.75.
const ALPHA: f64 = 0.7;
/// The power of the photon radius to which their squared bias is proportional: 1 at edges of light, 4 inside. In five
/// scenes it was 0.1 to 2.7.
const BIAS_OF_RADIUS: f64 = 1.3;
/// The share of a time limit after which no other pilot is begun.
const TIME_OF_PILOTS: f64 = 0.15;
/// The first candidate is kept unless the effort of another one is below this share of its own. So is the best one
/// without a bias that remains, beside those with one.
const CLEARLY: f64 = 0.8;

/// The least number of samples in an image of `bdpt` for which there are pilots: theirs are a fifth.
const WORTH_PILOTS: f64 = 5e5;
/// The samples of `bdpt` that a thread takes in a second, if only the time of the image is given.
const USUAL_RATE_OF_A_THREAD: f64 = 2.5e5;
/// The share of a time limit that the pilot of `bdpt` may take; beyond that there is no other one.
const MOST_TIME: f64 = 0.25;

/// How a candidate did in its pilot.
#[derive(Clone, Debug, serde::Serialize)]
pub struct Trial {
    /// The name of the integrator.
    pub integrator: &'static str,
    /// The relMSE of the pilot, with the light that it lacks or never finds. Another bias is not part of it.
    pub relmse: Option<f64>,
    /// The cost of the pilot in nearest-hit queries of `path`, without its preparation.
    pub cost: Option<f64>,
    /// The bias that remains with any number of samples, as a root mean square of relative differences; 0 if there is
    /// none.
    pub bias: Option<f64>,
    /// The error at the same cost, that of the image by the first candidate, relative to the best candidate. Without a
    /// bias it is also the cost to the same error.
    pub effort: Option<f64>,
    /// Why it cannot render the scene, or is not tried.
    pub refused: Option<String>,
}

/// The chosen integrator, and what was tried.
#[derive(Clone, Debug, serde::Serialize)]
pub struct Decision {
    /// The integrator that the user named: `auto` or `bdpt`.
    pub asked: &'static str,
    /// The name of the chosen integrator.
    pub integrator: &'static str,
    /// The mean squared relative bias of the image, if it has one that was measured.
    pub squared_bias: Option<f64>,
    /// All candidates.
    pub trials: Vec<Trial>,
    /// The wall-clock time of the pilots.
    #[serde(skip)]
    pub elapsed: Duration,
}

impl fmt::Display for Decision {
    /// Writes the question and the choice with all efforts: `auto: sppm (error at the same cost: path 3.10, bdpt 4.20,
    /// sppm 1.00)`.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let effort = |t: &Trial| t.effort.map(|effort| format!("{} {effort:.2}", t.integrator));
        let efforts: Vec<String> = self.trials.iter().filter_map(effort).collect();
        write!(f, "{}: ", self.asked)?;
        match self.integrator {
            Bdpt::NAME if self.asked == Bdpt::NAME => f.write_str("connections pay")?,
            name if self.asked == Bdpt::NAME => {
                write!(f, "connections do not pay, {name} renders the image")?
            }
            name => f.write_str(name)?,
        }
        if !efforts.is_empty() {
            write!(f, " (error at the same cost: {})", efforts.join(", "))?;
        }
        if let Some(square) = self.squared_bias {
            write!(f, "; its bias, {}, is part of the error", percent(square.sqrt()))?;
        }
        Ok(())
    }
}

/// A pilot that was rendered.
struct Pilot {
    relmse: Option<f64>,
    /// The cost in nearest-hit queries of `path`, and that of the preparation.
    cost: f64,
    preparation: f64,
    /// The mean squared relative bias that remains.
    squared_bias: f64,
    /// What it finds of hidden light; everything, if the scene has none.
    hidden_light: HiddenLight,
    blocks: Blocks,
    /// The wall-clock time of its samples.
    elapsed: Duration,
}

/// A candidate with its pilot, or the reason why there is none.
type Tried = (&'static Candidate, Result<Pilot>);

/// The size of the pilots, and the samples of the image.
#[derive(Clone, Copy)]
struct Scale {
    /// The ratio of the sides of the pilot to those of the image.
    side: f64,
    /// The ratio of the samples of a pixel of the image to those of the pilot.
    samples: f64,
    /// When the image ends.
    stop: StopRules,
}

impl Session {
    /// Returns the names of all candidates, the first of which is the unit of costs, and whether they render media.
    pub fn candidates(&self) -> (Vec<&'static str>, bool) {
        let in_media = self.scene.uses_media();
        let biased: &[Candidate] = if in_media { &[] } else { &BIASED };
        let all = Question::Integrator(AutoSettings::default()).candidates(in_media).iter().chain(biased);
        (all.map(|candidate| candidate.name).collect(), in_media)
    }

    /// Returns the expected number of samples of each pixel. `rate` is the number of samples in a second.
    fn expected_samples(&self, choices: &Choices, rate: f64) -> f64 {
        let StopRules { samples, time, error } = choices.stop;
        let of_scene = || self.defaults.samples_per_pixel.filter(|_| time.is_none() && error.is_none());
        let samples = samples.or_else(of_scene).map(|samples| samples as f64);
        let in_time = time.map(|time| time.as_secs_f64() * rate / self.camera().film.full_area() as f64);
        let usual = if error.is_some() { USUAL_SAMPLES } else { DEFAULT_SPP as f64 };
        samples.into_iter().chain(in_time).reduce(f64::min).unwrap_or(usual)
    }

    /// Returns whether an image has enough samples for the pilots that a question takes.
    pub(super) fn is_worth_pilots(&self, choices: &Choices, question: Question) -> bool {
        let samples = match choices.stop {
            StopRules { samples: None, time: Some(time), .. } => {
                time.as_secs_f64() * self.threads as f64 * USUAL_RATE_OF_A_THREAD
            }
            _ => self.expected_samples(choices, USUAL_RATE) * self.camera().film.full_area() as f64,
        };
        matches!(question, Question::Integrator(_)) || samples >= WORTH_PILOTS
    }

    /// Chooses the integrator for a render with the given choices, whose own integrator does not count. If a bias is
    /// allowed, candidates whose bias is at most that take part, too.
    ///
    /// # Errors
    /// If no candidate can render the scene, or the memory limit is exceeded.
    pub(super) fn decide(&self, choices: &Choices, question: Question) -> Result<Decision> {
        let started = Instant::now();
        let in_media = self.scene.uses_media();
        let film = &self.camera().film;
        // A crop has the integrator of the whole image, so that its pixels are the same.
        let area = film.full_area() as f64;
        let samples = self.expected_samples(choices, USUAL_RATE);
        let pixels = (area * samples * SHARE / SAMPLES as f64).clamp(FEWEST_PIXELS, MOST_PIXELS);
        let side = (pixels / area).sqrt().min(1.0);
        let length = |length: u32| ((f64::from(length) * side).round() as u32).max(1);
        let mut camera = self.camera().with_size(length(film.width), length(film.height));
        camera.film.crop = None;
        // The sides are whole numbers.
        let side = (camera.film.full_area() as f64 / area).sqrt();
        let mut scale = Scale { side, samples: samples / SAMPLES as f64, stop: choices.stop };
        let mut tried: Vec<Tried> = Vec::new();
        let candidates = question.candidates(in_media);
        let most_found = candidates.iter().map(|candidate| candidate.hidden_light).max();
        let most_time = match question {
            Question::Integrator(_) => TIME_OF_PILOTS,
            Question::Connections => MOST_TIME,
        };
        let is_late = || choices.stop.time.is_some_and(|time| started.elapsed() > time.mul_f64(most_time));
        for candidate in candidates {
            if tried.len() == SECOND
                && choose(&tried, &efforts(&tried, scale)).is_some_and(|(chosen, _)| chosen == 0)
            {
                break;
            }
            let pilot = self.pilot(candidate, in_media, choices, &camera);
            // The user of `bdpt` named it. If it cannot render its pilot, it cannot render the image.
            let pilot = if question.asked() == AUTO { pilot } else { Ok(pilot?) };
            let found = pilot.as_ref().ok().map(|pilot| (pilot.hidden_light, pilot.elapsed));
            let is_first = tried.iter().all(|(_, pilot)| pilot.is_err());
            tried.push((candidate, pilot));
            let Some((finds, elapsed)) = found else { continue };
            if is_first && choices.stop.time.is_some() {
                let seconds = elapsed.max(Duration::from_micros(1)).as_secs_f64();
                let rate = (camera.film.full_area() * SAMPLES) as f64 / seconds;
                scale.samples = self.expected_samples(choices, rate) / SAMPLES as f64;
            }
            // Without the pilot of one that finds more, nobody would know that light is missing.
            if is_late() && Some(finds) >= most_found {
                break;
            }
        }
        if let Question::Integrator(AutoSettings { allow_bias: Some(most) }) = question
            && !in_media
        {
            for candidate in &BIASED {
                let pilot = match is_late() {
                    true => Err(Error::scene("the other pilots have taken their share of the time")),
                    false => self.pilot_with_bias(candidate, choices, &camera, most, &tried, scale),
                };
                tried.push((candidate, pilot));
            }
        }
        let efforts = efforts(&tried, scale);
        let Some((chosen, least)) = choose(&tried, &efforts) else {
            let why = tried.into_iter().find_map(|(_, pilot)| pilot.err());
            return Err(why.expect("without a pilot there is an error"));
        };
        let errors = errors(&tried);
        let squared_bias = match &tried[chosen] {
            (Candidate { bias: Bias::Remaining, .. }, Ok(pilot)) => Some(pilot.squared_bias),
            (Candidate { bias: Bias::Vanishing, .. }, Ok(pilot)) => {
                let image = cost_of_image(&tried, scale);
                let bias = exact(&tried, &errors).map(|exact| scale.bias_of_image(pilot, exact, image));
                bias.filter(|bias| scale.allows(*bias))
            }
            _ => None,
        };
        let trial = |(i, (candidate, pilot)): (usize, (&Candidate, Result<Pilot>))| Trial {
            integrator: candidate.name,
            relmse: errors[i].map(|[noise, missing]| noise + missing),
            cost: pilot.as_ref().ok().map(|pilot| pilot.cost),
            bias: pilot.as_ref().ok().map(|pilot| pilot.squared_bias.sqrt()),
            effort: efforts[i].map(|effort| if least > 0.0 { effort / least } else { 1.0 }),
            refused: pilot.err().map(|error| error.message),
        };
        let integrator = tried[chosen].0.name;
        let trials = tried.into_iter().enumerate().map(trial).collect();
        let (asked, elapsed) = (question.asked(), started.elapsed());
        Ok(Decision { asked, integrator, squared_bias, trials, elapsed })
    }

    /// Renders the pilot of a candidate and measures its bias, unless there is a reason not to choose it. `most` is the
    /// greatest bias.
    fn pilot_with_bias(
        &self,
        candidate: &Candidate,
        choices: &Choices,
        camera: &Camera,
        most: f64,
        tried: &[Tried],
        scale: Scale,
    ) -> Result<Pilot> {
        let refuse = |why: String| Err(Error::scene(why));
        if self.scene.passes_panes() {
            return refuse(format!(
                "rays do not pass thin panes with it: choose it by --integrator {}",
                candidate.name
            ));
        }
        let efforts = efforts(tried, scale);
        let unbiased = (0..tried.len()).filter(|&i| tried[i].0.bias == Bias::None);
        let known = unbiased.filter_map(|i| Some((efforts[i]?, tried[i].1.as_ref().ok()?)));
        let Some((_, exact)) = known.min_by(|a, b| a.0.total_cmp(&b.0)) else {
            return refuse("its bias is unknown: no unbiased integrator can render the scene".into());
        };
        let image = cost_of_image(tried, scale);
        if image / (scale.side * scale.side) < WORTH_A_PREPARATION {
            return refuse("the image takes too few rays to pay for a pilot of it".into());
        }
        let choices = Choices { seed: choices.seed ^ OTHER_SEED, ..choices.clone() };
        let pilot = self.pilot(candidate, false, &choices, camera)?;
        let share = scale.preparation(candidate, &pilot) / image;
        if share > LARGEST_PREPARATION {
            return refuse(format!("its preparation costs {:.0} % of the image without it", 100.0 * share));
        }
        let Some([square, error]) = pilot.blocks.squared_bias(&exact.blocks) else {
            return refuse("its bias is unknown: the image has too few pixels".into());
        };
        // What the pilots cannot exclude counts.
        let squared_bias = square.max(0.0) + error;
        let bias = squared_bias.sqrt();
        if bias > most {
            return refuse(format!("its bias is up to {}, and {} is allowed", percent(bias), percent(most)));
        }
        if !scale.allows(squared_bias) {
            return refuse(format!("its squared bias, {squared_bias:.2e}, is too near to the target error"));
        }
        Ok(Pilot { squared_bias, ..pilot })
    }

    /// Renders the pilot of a candidate.
    fn pilot(
        &self,
        candidate: &Candidate,
        in_media: bool,
        choices: &Choices,
        camera: &Camera,
    ) -> Result<Pilot> {
        let of_ray = choices.costs.clone().unwrap_or_default().of(candidate.name, in_media);
        let is_path = candidate.name == PathIntegrator::NAME;
        let choices = Choices {
            integrator: Some(candidate.name.into()),
            allow_bias: None,
            costs: None,
            squared_bias: None,
            stop: StopRules { samples: Some(SAMPLES), ..StopRules::default() },
            adaptive: WhenPays::Never,
            aov: Vec::new(),
            samples: None,
            path_reuse: choices.path_reuse.filter(|_| is_path),
            path_splitting: choices.path_splitting.filter(|_| is_path),
            path_caustics: choices.path_caustics.filter(|_| is_path),
            path_guiding: choices.path_guiding && is_path,
            connections: connected(candidate.name),
            ..choices.clone()
        };
        let plan = self.plan(&choices)?;
        let rendered = self.render_through(camera, &plan, &Progress::new(), None, Sinks::default())?;
        Ok(Pilot {
            relmse: rendered.relmse,
            cost: of_ray * rendered.counters.cost(&self.scene),
            preparation: of_ray * Statistic::rays(&rendered.statistics).cost(&self.scene),
            squared_bias: 0.0,
            hidden_light: match self.scene.has_hidden_light() {
                true => candidate.hidden_light,
                false => HiddenLight::Found,
            },
            blocks: Blocks::of(&rendered),
            elapsed: rendered.elapsed,
        })
    }
}

impl Scale {
    /// Returns the cost of the preparation for the image, for each pixel of the pilot.
    fn preparation(self, candidate: &Candidate, pilot: &Pilot) -> f64 {
        pilot.preparation * self.side.powi(2 - candidate.preparation)
    }

    /// Returns the mean squared relative bias of a candidate whose bias vanishes, in the size of the image and with
    /// `passes` times the passes of its pilot. `exact` is the unbiased pilot to compare with.
    fn vanishing_bias(self, pilot: &Pilot, exact: &Pilot, passes: f64) -> f64 {
        let radius = self.side * passes.powf((ALPHA - 1.0) / 2.0);
        let finds_more = pilot.hidden_light > exact.hidden_light;
        pilot.blocks.squared_bias_of_pixels(&exact.blocks, finds_more) * radius.powf(BIAS_OF_RADIUS)
    }

    /// Returns the [`vanishing_bias`](Self::vanishing_bias) that the image has at its end. In a given time, the
    /// candidate takes as many passes as the cost `image` allows.
    fn bias_of_image(self, pilot: &Pilot, exact: &Pilot, image: f64) -> f64 {
        let passes = if self.stop.time.is_some() { image / pilot.cost } else { self.samples };
        self.vanishing_bias(pilot, exact, passes)
    }

    /// Returns whether a squared bias leaves a part of the target error to noise.
    fn allows(self, squared_bias: f64) -> bool {
        self.stop.error.is_none_or(|target| leaves_room(squared_bias, target))
    }
}

/// Returns the unbiased pilot that finds the most light, and of these the one with the least error.
fn exact<'a>(tried: &'a [Tried], errors: &[Option<[f64; 2]>]) -> Option<&'a Pilot> {
    let unbiased = tried.iter().zip(errors).filter(|((candidate, _), _)| candidate.bias == Bias::None);
    unbiased
        .filter_map(|((_, pilot), error)| Some((pilot.as_ref().ok()?, (*error)?[0])))
        .min_by(|a, b| b.0.hidden_light.cmp(&a.0.hidden_light).then(a.1.total_cmp(&b.1)))
        .map(|(pilot, _)| pilot)
}

/// Returns the error of each pilot, with the light that it lacks, and the squared light that it can never find.
fn errors(tried: &[Tried]) -> Vec<Option<[f64; 2]>> {
    let all = || tried.iter().filter_map(|(c, pilot)| Some((pilot.as_ref().ok()?, c.bias)));
    let error = |(candidate, pilot): &Tried| {
        let pilot = pilot.as_ref().ok()?;
        let unknown =
            all().map(|(other, bias)| pilot.blocks.unknown_error(candidate.bias, (&other.blocks, bias)));
        let more =
            all().filter(|(other, bias)| other.hidden_light > pilot.hidden_light && *bias != Bias::Remaining);
        let missing = more.map(|(other, _)| pilot.blocks.missing_light(&other.blocks));
        Some([pilot.relmse? + unknown.fold(0.0, f64::max), missing.fold(0.0, f64::max)])
    };
    tried.iter().map(error).collect()
}

/// Returns the cost of the image by the first candidate, to the scale of the pilots.
fn cost_of_image(tried: &[Tried], scale: Scale) -> f64 {
    let first = tried.iter().find_map(|(_, pilot)| pilot.as_ref().ok());
    first.map_or(0.0, |pilot| pilot.cost * scale.samples)
}

/// Returns whether a squared bias leaves a part of a target error to noise.
pub fn leaves_room(squared_bias: f64, target: f64) -> bool {
    squared_bias <= target / 2.0
}

/// Returns the product of error and cost of each candidate at the cost of the image by the first one, to the scale of
/// the pilots. A preparation takes a part of that cost, and a bias does not decrease with it. There is no effort if a
/// bias leaves no room for noise, and an unbiased candidate finds the same light.
fn efforts(tried: &[Tried], scale: Scale) -> Vec<Option<f64>> {
    let image = cost_of_image(tried, scale);
    let errors = errors(tried);
    let exact = exact(tried, &errors);
    let effort = |((candidate, pilot), error): (&Tried, &Option<[f64; 2]>)| {
        let (pilot, [error, missing]) = (pilot.as_ref().ok()?, (*error)?);
        let noise = error * pilot.cost;
        Some(match candidate.bias {
            Bias::None => noise + missing * image,
            Bias::Vanishing => {
                // The ratio of the passes of the image to those of the pilot.
                let passes = image / pilot.cost;
                let noise = noise * passes.powf(1.0 - ALPHA);
                let Some(exact) = exact else { return Some(noise) };
                let is_needed = pilot.hidden_light > exact.hidden_light;
                if !is_needed && !scale.allows(scale.bias_of_image(pilot, exact, image)) {
                    return None;
                }
                noise + scale.vanishing_bias(pilot, exact, passes) * image
            }
            Bias::Remaining => {
                let left = 1.0 - scale.preparation(candidate, pilot) / image;
                noise / left + pilot.squared_bias * image
            }
        })
    };
    tried.iter().zip(&errors).map(effort).collect()
}

/// Returns the index of the chosen candidate, and the least effort; `None` if all efforts are unknown. The first
/// candidate, and those without a bias that remains, are preferred.
fn choose(tried: &[Tried], efforts: &[Option<f64>]) -> Option<(usize, f64)> {
    let best = |of: &dyn Fn(usize) -> bool| {
        let known = (0..tried.len()).filter(|&i| of(i)).filter_map(|i| Some((i, efforts[i]?)));
        known.min_by(|a, b| a.1.total_cmp(&b.1))
    };
    let (all, least) = best(&|_| true)?;
    let preferred: [&dyn Fn(usize) -> bool; 2] = [&|i| i == 0, &|i| tried[i].0.bias != Bias::Remaining];
    let kept = preferred.into_iter().filter_map(best).find(|(_, effort)| least >= CLEARLY * effort);
    Some((kept.map_or(all, |(i, _)| i), least))
}
