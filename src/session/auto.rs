//! `--integrator auto`: the choice of an integrator by measurement.
//!
//! Each candidate renders a small image of the same view, its pilot. The candidate with the smallest product of error
//! and cost renders the image. Pilots are thrown away. Costs are numbers of rays, weighted by what a ray of the
//! candidate costs as a whole, so the choice is the same on every machine and in every run.
//!
//! The halves of a pilot show its error, but a pilot that has not found some light does not know that it is missing:
//! before its first firefly, a caustic is a black, exact pixel. So the pilots are compared with each other in blocks of
//! pixels. A block that is darker in one pilot than in another, by more than both know, adds to the error of the darker
//! one. Candidates that are only consistent may be biased. What their blocks differ from those of unbiased candidates,
//! in either direction, adds to their own error, scaled to the photon radii of the image.

use super::{Choices, Session};
use crate::error::Result;
use crate::estimate::metrics::RELATIVE_FLOOR;
use crate::integrator::PathIntegrator;
use crate::integrator::settings::{Plugin, WhenPays};
use crate::render::{Progress, Rendered, Sinks, StopRules};
use crate::sensor::Camera;
use std::fmt;
use std::time::{Duration, Instant};

/// An integrator that may be chosen.
struct Candidate {
    name: &'static str,
    /// What everything costs relative to `path`, for each unit of the cost of the rays.
    cost: f64,
    /// Whether the expected image is exact for any number of samples, and not only in the limit.
    unbiased: bool,
}

/// The candidates. The first one is kept unless another one is clearly better. Those from [`SECOND`] on have a pilot
/// only if it is not kept so far. Costs are means over the scenes of decision 0076.
const CANDIDATES: [Candidate; 4] = [
    Candidate { name: "path", cost: 1.0, unbiased: true },
    Candidate { name: "bdpt", cost: 1.9, unbiased: true },
    Candidate { name: "sppm", cost: 2.1, unbiased: false },
    Candidate { name: "vcm", cost: 2.35, unbiased: false },
];
const SECOND: usize = 3;
/// The candidates for scenes with media that are rendered. The costs are those of decision 0084.
const IN_MEDIA: [Candidate; 2] = [
    Candidate { name: "volpath", cost: 1.0, unbiased: true },
    Candidate { name: "bdpt", cost: 1.1, unbiased: true },
];
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
/// The side of the blocks in which pilots are compared.
const BLOCK: u32 = 8;
/// Another candidate than the first one is chosen if its effort is below this share of the first one's.
const CLEARLY: f64 = 0.8;
/// A block that is brighter by this factor in the pilot of a candidate that may be biased shows that another one lacks
/// light.
const LACKS: f64 = 8.0;
/// The number of standard errors by which a block may be wrong.
const DEVIATIONS: f64 = 2.0;

/// How a candidate did in its pilot.
#[derive(Clone, Debug, serde::Serialize)]
pub struct Trial {
    /// The name of the integrator.
    pub integrator: &'static str,
    /// The relMSE of the pilot, with the light that it lacks, and its bias.
    pub relmse: Option<f64>,
    /// The cost of the pilot in nearest-hit queries of `path`.
    pub cost: Option<f64>,
    /// The cost at which it is expected to reach the error of the best candidate, relative to that candidate.
    pub effort: Option<f64>,
    /// Why it cannot render the scene.
    pub refused: Option<String>,
}

/// The chosen integrator, and what was tried.
#[derive(Clone, Debug, serde::Serialize)]
pub struct Decision {
    /// The name of the integrator.
    pub integrator: &'static str,
    /// All candidates.
    pub trials: Vec<Trial>,
    /// The wall-clock time of the pilots.
    #[serde(skip)]
    pub elapsed: Duration,
}

impl fmt::Display for Decision {
    /// Writes the choice with all efforts: `sppm (effort to the same error: path 3.10, bdpt 4.20, sppm 1.00)`.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let effort = |t: &Trial| t.effort.map(|effort| format!("{} {effort:.2}", t.integrator));
        let efforts: Vec<String> = self.trials.iter().filter_map(effort).collect();
        match efforts.is_empty() {
            true => write!(f, "{}", self.integrator),
            false => write!(f, "{} (effort to the same error: {})", self.integrator, efforts.join(", ")),
        }
    }
}

/// A pilot that was rendered.
struct Pilot {
    relmse: Option<f64>,
    /// The cost in nearest-hit queries of `path`.
    cost: f64,
    blocks: Blocks,
}

/// The blocks of a pilot, by rows: the mean of each channel, and its standard error.
type Blocks = Vec<[[f64; 2]; 3]>;

impl Session {
    /// Chooses the integrator for a render with the given choices, whose own integrator does not count.
    ///
    /// # Errors
    /// If no candidate can render the scene, or the memory limit is exceeded.
    pub fn decide(&self, choices: &Choices) -> Result<Decision> {
        let started = Instant::now();
        let renders_media = self.scene.media.is_some() && self.defaults.integrator.renders_media();
        let candidates: &[Candidate] = if renders_media { &IN_MEDIA } else { &CANDIDATES };
        let film = &self.camera().film;
        // A crop has the integrator of the whole image, so that its pixels are the same.
        let area = film.full_area() as f64;
        let StopRules { samples, time, error } = choices.stop;
        let of_scene = || self.defaults.samples_per_pixel.filter(|_| time.is_none() && error.is_none());
        let samples = match (samples.or_else(of_scene), time) {
            (Some(samples), _) => samples as f64,
            (None, Some(time)) => time.as_secs_f64() * USUAL_RATE / area,
            (None, None) => USUAL_SAMPLES,
        };
        let pixels = (area * samples * SHARE / SAMPLES as f64).clamp(FEWEST_PIXELS, MOST_PIXELS);
        let scale = (pixels / area).sqrt().min(1.0);
        let side = |length: u32| ((f64::from(length) * scale).round() as u32).max(1);
        let mut camera = self.camera().with_size(side(film.width), side(film.height));
        camera.film.crop = None;
        // The square of the error of a density estimate within a radius is proportional to the fourth power of that.
        let bias = scale.powi(4);
        let mut pilots = Vec::new();
        for candidate in candidates {
            if pilots.len() == SECOND
                && choose(&efforts(&pilots, candidates, bias)).is_some_and(|(chosen, _)| chosen == 0)
            {
                break;
            }
            pilots.push(self.pilot(candidate, choices, &camera));
        }
        let efforts = efforts(&pilots, candidates, bias);
        let Some((chosen, least)) = choose(&efforts) else {
            return Err(pilots.into_iter().find_map(Result::err).expect("without a pilot there is an error"));
        };
        let trial = |((pilot, effort), candidate): ((Result<Pilot>, Option<f64>), &Candidate)| Trial {
            integrator: candidate.name,
            relmse: pilot.as_ref().ok().and_then(|pilot| Some(effort? / pilot.cost)),
            cost: pilot.as_ref().ok().map(|pilot| pilot.cost),
            effort: effort.map(|effort| if least > 0.0 { effort / least } else { 1.0 }),
            refused: pilot.err().map(|error| error.message),
        };
        let trials = pilots.into_iter().zip(efforts).zip(candidates).map(trial).collect();
        Ok(Decision { integrator: candidates[chosen].name, trials, elapsed: started.elapsed() })
    }

    /// Renders the pilot of a candidate.
    fn pilot(&self, candidate: &Candidate, choices: &Choices, camera: &Camera) -> Result<Pilot> {
        let choices = Choices {
            integrator: Some(candidate.name.into()),
            stop: StopRules { samples: Some(SAMPLES), ..StopRules::default() },
            adaptive: WhenPays::Never,
            aov: Vec::new(),
            cache: None,
            samples: None,
            path_reuse: choices.path_reuse.filter(|_| candidate.name == PathIntegrator::NAME),
            path_splitting: choices.path_splitting.filter(|_| candidate.name == PathIntegrator::NAME),
            path_caustics: choices.path_caustics.filter(|_| candidate.name == PathIntegrator::NAME),
            path_guiding: choices.path_guiding && candidate.name == PathIntegrator::NAME,
            ..choices.clone()
        };
        let plan = self.plan(&choices)?;
        let rendered = self.render_through(camera, &plan, &Progress::new(), None, Sinks::default())?;
        let cost = candidate.cost * rendered.counters.cost(&self.scene);
        Ok(Pilot { relmse: rendered.relmse, cost, blocks: blocks_of(&rendered) })
    }
}

/// Returns the product of error and cost of each pilot. `bias` scales the squared biases to those of the image.
fn efforts(pilots: &[Result<Pilot>], candidates: &[Candidate], bias: f64) -> Vec<Option<f64>> {
    let all =
        || pilots.iter().zip(candidates).filter_map(|(p, c)| Some((&p.as_ref().ok()?.blocks, c.unbiased)));
    let effort = |(pilot, candidate): (&Result<Pilot>, &Candidate)| {
        let pilot = pilot.as_ref().ok()?;
        let unknown = all().map(|other| unknown_error((&pilot.blocks, candidate.unbiased), other, bias));
        Some((pilot.relmse? + unknown.fold(0.0, f64::max)) * pilot.cost)
    };
    pilots.iter().zip(candidates).map(effort).collect()
}

/// Returns the index of the chosen candidate, and the least effort; `None` if all efforts are unknown.
fn choose(efforts: &[Option<f64>]) -> Option<(usize, f64)> {
    let known = efforts.iter().enumerate().filter_map(|(i, effort)| Some((i, (*effort)?)));
    let (best, least) = known.min_by(|a, b| a.1.total_cmp(&b.1))?;
    Some((if efforts[0].is_some_and(|first| least >= CLEARLY * first) { 0 } else { best }, least))
}

/// Returns the blocks of a pilot, by rows.
fn blocks_of(pilot: &Rendered) -> Blocks {
    let columns = pilot.rect.width.div_ceil(BLOCK) as usize;
    let rows = pilot.rect.height.div_ceil(BLOCK) as usize;
    // Sums of means and of the differences of halves.
    let mut blocks = vec![[[0.0; 2]; 3]; columns * rows];
    let mut pixels = vec![0.0; columns * rows];
    for tile in &pilot.tiles {
        for i in 0..tile.pixel_count() {
            let (x, y) = tile.position(i);
            let (x, y) = ((x - pilot.rect.x) / BLOCK, (y - pilot.rect.y) / BLOCK);
            let block = y as usize * columns + x as usize;
            pixels[block] += 1.0;
            for (c, sums) in blocks[block].iter_mut().enumerate() {
                let [mean, difference] = tile.halves(i, c);
                sums[0] += mean;
                sums[1] += difference;
            }
        }
    }
    for (block, pixels) in blocks.iter_mut().zip(pixels) {
        *block = block.map(|[mean, difference]| [mean / pixels, (difference / pixels).abs()]);
    }
    blocks
}

/// Returns the relMSE that the halves of a pilot do not show but another pilot does. Each is given by its blocks and
/// whether it is unbiased.
fn unknown_error(
    (own, unbiased): (&Blocks, bool),
    (other, other_is_unbiased): (&Blocks, bool),
    bias: f64,
) -> f64 {
    // No sample of a block has found the light, or too few. If pixels are independent, the variance of a pixel is that
    // of the block times their number. The photons of a block are the same for all of its pixels.
    let of_light = if unbiased { f64::from(BLOCK * BLOCK) } else { 1.0 };
    let mut sum = 0.0;
    for (mine, theirs) in own.iter().flatten().zip(other.iter().flatten()) {
        let ([mine, my_error], [theirs, their_error]) = (mine, theirs);
        let gap = ((theirs - mine).abs() - DEVIATIONS * (my_error + their_error)).max(0.0);
        let square = gap * gap / (theirs * theirs + RELATIVE_FLOOR);
        sum += if *theirs > LACKS * (mine + my_error) {
            square * of_light
        } else if unbiased && other_is_unbiased {
            // Noise has either sign.
            square * of_light * (theirs - mine).signum()
        } else if other_is_unbiased {
            square * bias
        } else {
            0.0
        };
    }
    (sum / (3 * own.len()) as f64).max(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns the unknown error of grey blocks, given by means and standard errors of the means.
    fn unknown(own: &[[f64; 2]], unbiased: bool, other: &[[f64; 2]], other_is_unbiased: bool) -> f64 {
        let grey = |values: &[[f64; 2]]| values.iter().map(|&value| [value; 3]).collect::<Blocks>();
        unknown_error((&grey(own), unbiased), (&grey(other), other_is_unbiased), 0.25)
    }

    #[test]
    fn light_that_only_others_find_is_an_error_of_all_pixels_of_a_block() {
        let dark = [[1.0, 0.0], [0.0, 0.0]];
        let bright = [[1.0, 0.0], [1.0, 0.1]];
        let expected = 0.5 * 0.64 / 1.01;
        for (unbiased, other, pixels) in [(true, true, 64.0), (true, false, 64.0), (false, true, 1.0)] {
            let found = unknown(&dark, unbiased, &bright, other);
            assert!((found / (pixels * expected) - 1.0).abs() < 1e-9, "{found}");
            assert_eq!(unknown(&bright, true, &dark, other), 0.0);
        }
    }

    #[test]
    fn what_halves_do_not_share_and_what_has_either_sign_is_noise() {
        assert_eq!(unknown(&[[0.0, 0.0]], true, &[[5.0, 2.5]], true), 0.0);
        let (own, other) = ([[1.2, 0.0], [1.0, 0.0]], [[1.0, 0.0], [1.2, 0.0]]);
        assert_eq!(unknown(&own, true, &other, true), 0.0);
    }

    #[test]
    fn a_bias_counts_in_both_directions_but_only_against_exact_images() {
        let (biased, exact) = ([[1.1, 0.0], [0.9, 0.0]], [[1.0, 0.0], [1.0, 0.0]]);
        let found = unknown(&biased, false, &exact, true);
        assert!((found - 0.25 * 0.01 / 1.01).abs() < 1e-9, "{found}");
        assert_eq!(unknown(&exact, true, &biased, false), 0.0);
        assert_eq!(unknown(&biased, false, &exact, false), 0.0);
    }
}
