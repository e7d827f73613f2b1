//! From what the user chooses, and what the scene file asks for, to the settings of a render.

use super::Session;
use crate::error::{Error, Result, counted};
use crate::integrator::preparation::CacheFile;
use crate::integrator::settings::{Aov, IrrcacheSettings, Layer};
use crate::integrator::{self, Settings};
use crate::render::{JobSettings, StopRules};
use crate::sampling::{Sampler, SamplerKind};
use std::ops::Range;

/// How the user wants a scene rendered. What is not chosen is what the scene file asks for, else the default.
#[derive(Clone, Debug, Default)]
pub struct Choices {
    /// Name of the integrator.
    pub integrator: Option<String>,
    /// The sampler.
    pub sampler: Option<SamplerKind>,
    /// Stop rules; without any, the scene's sample count.
    pub stop: StopRules,
    /// The seed.
    pub seed: u64,
    /// Names of layers beside the image.
    pub aov: Vec<String>,
    /// Whether noisier pixels get more samples.
    pub adaptive: bool,
    /// A file for what the integrator computes beforehand.
    pub cache: Option<CacheFile>,
    /// The samples of each pixel to take, of those that the stop rules speak of; all without it.
    pub samples: Option<Range<u64>>,
}

/// An integrator's settings and a job's.
#[derive(Clone, Debug)]
pub struct Plan {
    /// The integrator.
    pub integrator: Settings,
    /// Sampler, seed, threads, stop rules and layers.
    pub job: JobSettings,
    /// Whether noisier pixels get more samples.
    pub adaptive: bool,
    /// A file for what the integrator computes beforehand.
    pub cache: Option<CacheFile>,
    /// The index of the first sample of each pixel.
    pub first: u64,
    /// How many samples per pixel the whole render is to have, of which this may take a part.
    pub target: Option<u64>,
}

/// Samples per pixel where neither the scene nor the user says anything.
const DEFAULT_SPP: u64 = 64;

impl Session {
    /// The settings of a render.
    ///
    /// # Errors
    /// If there is no such integrator or layer, a layer is there twice, the integrator cannot sample adaptively, or
    /// there is too little memory for the image.
    pub fn plan(&self, choices: &Choices) -> Result<Plan> {
        let integrator = choose_integrator(choices.integrator.as_deref(), self.defaults.integrator.clone())?;
        let mut stop = choices.stop;
        if stop == StopRules::default() {
            stop.samples = Some(self.defaults.samples_per_pixel.unwrap_or(DEFAULT_SPP));
        }
        let kind = choices.sampler.or(self.defaults.sampler).unwrap_or_default();
        let created = integrator::create(&integrator);
        created.check(&self.scene)?;
        let replicates = integrator::replicates(created.as_ref(), kind);
        let sampler = Sampler::with_replicates(kind, stop.samples, replicates);
        let layers = choose_layers(&choices.aov, &integrator, replicates > 2)?;
        let target = stop.samples;
        let first = match &choices.samples {
            Some(range) => restrict(range, &mut stop, choices)?,
            None => 0,
        };
        let job = JobSettings { sampler, seed: choices.seed, threads: self.threads, stop, layers };
        if choices.adaptive && !kind.has_independent_pixels() {
            return Err(Error::usage(format!(
                "--adaptive: the sampler {kind} makes a pixel's samples depend on its neighbours', which decide how many \
                 it gets: the picture would be biased"
            )));
        }
        if choices.adaptive && created.light_tracer().is_some() {
            return Err(Error::usage(format!(
                "--adaptive: {} traces its paths from the lights, and cannot decide which pixels they reach",
                created.name()
            )));
        }
        if choices.adaptive && created.progressive().is_some() {
            return Err(Error::usage(format!(
                "--adaptive: {} traces photons for all pixels at once, and cannot take samples of some pixels alone",
                created.name()
            )));
        }
        if choices.cache.is_some() && !created.supports_cache_file() {
            return Err(Error::usage(format!(
                "--cache: {} computes nothing beforehand that a file could keep",
                created.name()
            )));
        }
        let cache = choices.cache.clone();
        let plan = Plan { integrator, job, adaptive: choices.adaptive, cache, first, target };
        drop(self.reserve(&plan)?);
        Ok(plan)
    }
}

/// Lets the stop rules end with a range of samples; returns the first of them.
fn restrict(range: &Range<u64>, stop: &mut StopRules, choices: &Choices) -> Result<u64> {
    let Range { start, end } = *range;
    let refuse = |why: String| Err(Error::usage(format!("--sample-range {start}..{end}: {why}")));
    if choices.adaptive {
        return refuse(
            "--adaptive decides from the first samples of a pixel where to take more, and needs them all"
                .into(),
        );
    }
    if stop.error.is_some() || stop.time.is_some() {
        return refuse(
            "a range says how many samples there are; --time and --target-error say otherwise".into(),
        );
    }
    let total = stop.samples.unwrap_or(0);
    if end > total {
        let samples = counted(total, "sample", "samples");
        return refuse(format!("the whole render has {samples} per pixel; --spp makes it more"));
    }
    stop.samples = Some(end);
    Ok(start)
}

/// The integrator that the user names, else that of the scene. What both have of the lengths of paths and of hidden
/// emitters stays as the scene has it; trees of rays, whose cost is exponential, are no deeper than their default.
fn choose_integrator(name: Option<&str>, of_scene: Settings) -> Result<Settings> {
    Ok(match name {
        None => of_scene,
        Some(name) if name == of_scene.name() => of_scene,
        // Its layers are those of --aov: see `choose_layers`.
        Some("aov") => Settings::Aov { layers: Vec::new(), image: Some(Box::new(of_scene)) },
        Some(name) => Settings::by_name(name, of_scene.limits()).ok_or_else(|| {
            let (last, others) = Settings::NAMES.split_last().expect("there are integrators");
            let list = others.join(", ");
            Error::usage(format!(
                "--integrator: there is no integrator \"{name}\"; there are {list} and {last}"
            ))
        })?,
    })
}

/// The layers of the scene's `aov` integrator and those that the user names.
///
/// Where pixels share noise, the variances of blocks go along with those of pixels.
fn choose_layers(names: &[String], settings: &Settings, shared: bool) -> Result<Vec<Layer>> {
    let mut layers = match settings {
        Settings::Aov { layers, .. } => layers.clone(),
        Settings::Irrcache(IrrcacheSettings { debug: true, .. }) => {
            vec![Layer { name: "record_radius".into(), aov: Aov::RecordRadius }]
        }
        _ => Vec::new(),
    };
    if layers.is_empty() && names.is_empty() && matches!(settings, Settings::Aov { .. }) {
        return Err(Error::usage(format!(
            "--integrator aov: expected layers in --aov: {}",
            Aov::NAMES.join(", ")
        )));
    }
    for (i, name) in names.iter().enumerate() {
        let aov = Aov::by_name(name).ok_or_else(|| {
            Error::usage(format!("--aov: there is no layer \"{name}\"; there are {}", Aov::NAMES.join(", ")))
        })?;
        let cached = match settings {
            Settings::Aov { image: Some(image), .. } => image.as_ref(),
            other => other,
        };
        if aov == Aov::RecordRadius && !matches!(cached, Settings::Irrcache(_)) {
            return Err(Error::usage(format!(
                "--aov record_radius: {} has no records; irrcache has",
                settings.name()
            )));
        }
        // `moment` brings its variance along.
        if layers.iter().any(|l| l.name == *name && l.aov == aov) && !names[..i].contains(name) {
            continue;
        }
        if layers.iter().any(|l| l.name == *name) {
            return Err(Error::usage(format!("--aov: the layer \"{name}\" is there twice")));
        }
        layers.push(Layer { name: name.clone(), aov });
    }
    let has = |aov| layers.iter().any(|layer| layer.aov == aov);
    if shared && has(Aov::Variance) && !has(Aov::BlockVariance) {
        layers.push(Layer { name: Aov::BlockVariance.name().into(), aov: Aov::BlockVariance });
    }
    Ok(layers)
}
