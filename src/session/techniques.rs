//! The layers that show what each technique of bidirectional path tracing finds. [Veach 1997, Figure 10.3]

use super::{Plan, Session};
use crate::error::{Error, Result};
use crate::image::Image;
use crate::integrator::Settings;
use crate::integrator::settings::{BdptSettings, Technique, Techniques, techniques_with_edges};
use crate::render::{Progress, StopRules};

/// The most edges of a path, for which there are 43 techniques.
const MAX_EDGES: u32 = 8;

impl Session {
    /// Returns the settings of a plan whose techniques can be rendered one by one.
    ///
    /// # Errors
    /// If the integrator is not `bdpt` with all techniques, its paths may have more than eight edges, or there is not
    /// enough memory.
    pub fn check_techniques<'p>(&self, plan: &'p Plan) -> Result<&'p BdptSettings> {
        let refuse = |message: String| Err(Error::usage(format!("--aov strategies: {message}")));
        match &plan.integrator {
            Settings::Bdpt(settings) if settings.techniques != Techniques::All => {
                refuse("the scene names a technique already; remove it".into())
            }
            Settings::Bdpt(settings) if settings.limits.allows(MAX_EDGES + 1) => refuse(format!(
                "there is a layer for each technique, so max_depth must be at most {MAX_EDGES}"
            )),
            Settings::Bdpt(settings) => {
                let channels = 6 * techniques_within(settings).count();
                let render = 2 * self.render_memory(plan).total();
                drop(self.reserve_layers(plan, render, channels, "the layers of techniques")?);
                Ok(settings)
            }
            other => refuse(format!("{} has no such techniques; use bdpt", other.name())),
        }
    }

    /// Renders each technique of a plan with the given number of samples per pixel, and adds two layers of each to the
    /// image: `s2_t3.weighted`, its part of the image, and `s2_t3.alone`, an estimate of all light that it can sample.
    /// The sum of the parts is the image, if that has the same samples. Returns false, with the image unchanged, if
    /// the render is interrupted.
    ///
    /// # Errors
    /// As for [`check_techniques`](Self::check_techniques) and [`render`](Self::render).
    pub fn add_techniques(
        &self,
        plan: &Plan,
        samples: u64,
        progress: &Progress,
        image: &mut Image,
    ) -> Result<bool> {
        let settings = *self.check_techniques(plan)?;
        let all: Vec<Technique> = techniques_within(&settings).collect();
        let (pixels, width) = (image.width * image.height, 6 * all.len());
        let _reserved = self.reserve_layers(plan, 0, width, "the layers of techniques")?;
        let mut values = vec![0.0; pixels * width];
        let mut names = Vec::with_capacity(width);
        for technique in all {
            let Technique { light, camera } = technique;
            for (kind, techniques) in
                [("weighted", Techniques::Weighted(technique)), ("alone", Techniques::Alone(technique))]
            {
                let mut plan = plan.clone();
                plan.integrator = Settings::Bdpt(BdptSettings { techniques, ..settings });
                plan.job.stop = StopRules { samples: Some(samples), time: None, error: None };
                plan.job.layers.clear();
                let rendered = self.render(&plan, progress)?;
                if progress.is_interrupted() {
                    return Ok(false);
                }
                let part = self.image(&plan, &rendered).colours();
                for (to, from) in values.chunks_exact_mut(width).zip(part.chunks_exact(3)) {
                    to[names.len()..][..3].copy_from_slice(from);
                }
                names.extend(["R", "G", "B"].map(|c| format!("s{light}_t{camera}.{kind}.{c}")));
            }
        }
        image.append(names, &values);
        Ok(true)
    }
}

/// Returns the techniques that sample the paths of an integrator.
fn techniques_within(settings: &BdptSettings) -> impl Iterator<Item = Technique> {
    let limits = settings.limits;
    (1..=MAX_EDGES).filter(move |edges| limits.allows(*edges)).flat_map(techniques_with_edges)
}
