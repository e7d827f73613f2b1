//! The renders and their measurements.

use super::{BenchRow, Combination, Options, Reference};
use crate::accel::AccelKind;
use crate::compare::{DynamicRange, flip, mean_flip};
use crate::error::{Error, Result};
use crate::estimate::metrics;
use crate::image::Image;
use crate::integrator::Settings;
use crate::render::{Progress, Rendered, StopReason, StopRules};
use crate::session::{Choices, Plan, Session};

/// The measurements of one render.
#[derive(Clone, Debug, PartialEq)]
pub struct Measurement {
    /// The seed.
    pub seed: u64,
    /// Wall time of preparation and sampling, in seconds.
    pub seconds: f64,
    /// Samples per pixel.
    pub samples_per_pixel: u64,
    /// relMSE against the reference. It includes the reference's own error.
    pub relmse: f64,
    /// relMSE without the worst 0.1 % of the pixels; NaN for an image of one pixel.
    pub trimmed_relmse: f64,
    /// Mean squared error.
    pub mse: f64,
    /// Mean FLIP error; NaN if an image has NaN or infinite values.
    pub flip: f64,
    /// relMSE as estimated by the render itself, without the reference.
    pub relmse_estimate: Option<f64>,
    /// Queries for the closest hit, and for occlusion.
    pub rays: [u64; 2],
    /// The time of these queries in seconds, summed over the threads.
    pub thread_seconds: [f64; 2],
    /// Samples that were dropped because they were not finite or were negative.
    pub invalid_samples: u64,
}

impl Measurement {
    fn new(rendered: &Rendered, image: &Image, reference: &Image, seed: u64) -> Self {
        let (x, r) = (&image.data, &reference.data);
        let counters = &rendered.counters;
        Measurement {
            seed,
            seconds: (rendered.prepared + rendered.elapsed).as_secs_f64(),
            samples_per_pixel: rendered.samples_per_pixel,
            relmse: metrics::relmse(x, r),
            trimmed_relmse: metrics::trimmed_relmse(x, r, 3),
            mse: metrics::mse(x, r),
            flip: flip(image, reference, DynamicRange::High).map_or(f64::NAN, |map| mean_flip(&map)),
            relmse_estimate: rendered.relmse,
            rays: [counters.closest_rays, counters.occlusion_rays],
            thread_seconds: [counters.closest_time.as_secs_f64(), counters.occlusion_time.as_secs_f64()],
            invalid_samples: rendered.invalid_count,
        }
    }

    /// Returns the rays per second of wall time. The wall time includes all other work of rendering.
    pub fn rays_per_second(&self) -> f64 {
        self.rays.iter().sum::<u64>() as f64 / self.seconds
    }
}

/// A combination with its session and plan, or with the reason why it cannot be rendered.
pub(super) struct Candidate<'a> {
    combination: Combination,
    choices: Choices,
    ready: Result<(&'a Session, Plan), String>,
}

impl<'a> Candidate<'a> {
    /// Plans a combination.
    ///
    /// # Errors
    /// If there is no such integrator.
    pub fn new(accel: AccelKind, session: Result<&'a Session, &String>, choices: Choices) -> Result<Self> {
        let sampler = choices.sampler.unwrap_or_default();
        let session = match session {
            Ok(session) => session,
            Err(reason) => {
                let integrator = choices.integrator.clone().unwrap_or_else(|| "the scene's".into());
                let combination = Combination { integrator, sampler, accel };
                return Ok(Candidate { combination, choices, ready: Err(reason.clone()) });
            }
        };
        let in_the_plural =
            |e: Error| Error { message: e.message.replacen("--integrator", "--integrators", 1), ..e };
        let plan = session.plan(&choices).map_err(in_the_plural)?;
        let integrator =
            plan.decision.as_ref().map_or(plan.integrator.name(), |decision| decision.asked).to_string();
        let sampler = plan.job.sampler.kind();
        let ready = match plan.integrator {
            Settings::Ao(_) => {
                Err("its picture is open fractions: no light, and no error of light".to_string())
            }
            Settings::Depth(_) => {
                Err("its picture is distances: no light, and no error of light".to_string())
            }
            _ => Ok((session, plan)),
        };
        Ok(Candidate { combination: Combination { integrator, sampler, accel }, choices, ready })
    }

    /// Returns the reason why it cannot be rendered, if there is one.
    pub fn failure(&self) -> Option<&String> {
        self.ready.as_ref().err()
    }

    /// Returns the settings of the integrator.
    pub fn integrator(&self) -> Option<&Settings> {
        self.ready.as_ref().ok().map(|(_, plan)| &plan.integrator)
    }

    /// Renders once; returns `None` if the render was interrupted.
    fn render(&self, stop: StopRules, seed: u64, progress: &Progress) -> Result<Option<(Rendered, Image)>> {
        let Ok((session, _)) = &self.ready else { return Ok(None) };
        let plan = session.plan(&Choices { stop, seed, ..self.choices.clone() })?;
        let rendered = session.render(&plan, progress)?;
        let image = picture(&session.image(&plan, &rendered));
        Ok((rendered.stop_reason != StopReason::Interrupted).then_some((rendered, image)))
    }
}

/// Returns the red, green and blue channels without the layers that a scene may add.
pub(super) fn picture(image: &Image) -> Image {
    let mut picture = Image::new(image.width, image.height, &["R", "G", "B"]);
    picture.data = image.colours();
    picture.metadata = image.metadata.clone();
    picture
}

/// Samples per pixel of the first render, which warms up caches and is not measured.
const WARM_UP: u64 = 2;

/// Renders every candidate with every budget, the requested number of times. The candidates take turns.
pub(super) fn measure(
    candidates: Vec<Candidate<'_>>,
    reference: &Reference,
    options: &Options,
    progress: &Progress,
    tell: &dyn Fn(&str),
) -> Result<Vec<BenchRow>> {
    let mut rows: Vec<BenchRow> = candidates
        .iter()
        .map(|c| BenchRow {
            combination: c.combination.clone(),
            failure: c.failure().cloned(),
            cells: vec![Vec::new(); options.budgets.len()],
            image: None,
        })
        .collect();
    let warm_up = StopRules { samples: Some(WARM_UP), ..StopRules::default() };
    for (candidate, row) in candidates.iter().zip(&mut rows).filter(|(c, _)| c.failure().is_none()) {
        row.failure = candidate.render(warm_up, options.seed, progress).err().map(|e| e.to_string());
    }
    for run in 0..options.runs {
        for (b, budget) in options.budgets.iter().enumerate() {
            tell(&format!("run {} of {}, {budget}", run + 1, options.runs));
            let mut order: Vec<usize> = (0..candidates.len()).collect();
            // The order alternates, so that no candidate is always first.
            if run % 2 == 1 {
                order.reverse();
            }
            for i in order {
                let (candidate, row) = (&candidates[i], &mut rows[i]);
                if row.failure.is_some() || progress.is_interrupted() {
                    continue;
                }
                let seed = options.seed.wrapping_add(u64::from(run));
                match candidate.render(budget.stop(), seed, progress) {
                    Ok(Some((rendered, image))) => {
                        row.cells[b].push(Measurement::new(&rendered, &image, &reference.image, seed));
                        if b + 1 == options.budgets.len() && row.image.is_none() {
                            row.image = Some(image);
                        }
                    }
                    Ok(None) => {}
                    Err(error) => row.failure = Some(error.to_string()),
                }
            }
        }
    }
    Ok(rows)
}
