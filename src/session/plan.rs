//! The settings of a render, from the user's choices and the scene file.

use super::Session;
use super::auto::{Costs, Decision, Question, leaves_room};
use crate::error::{Error, Result, counted};
use crate::integrator::preparation::CacheFile;
use crate::integrator::settings::{
    AUTO, Aov, AovSettings, AutoSettings, BdptSettings, HiddenLight, IrrcacheSettings, Layer, PathSettings,
    Techniques, WhenPays,
};
use crate::integrator::{self, Bdpt, Integrator, Plugin, Settings};
use crate::render::{JobSettings, StopRules};
use crate::sampling::{Sampler, SamplerKind};
use crate::sensor::Camera;
use crate::util::wording::{did_you_mean, percent};
use std::ops::Range;

/// The user's choices for a render. A setting that is not chosen is that of the scene file, or else the default.
#[derive(Clone, Debug, Default)]
pub struct Choices {
    /// The name of the integrator, or `auto`.
    pub integrator: Option<String>,
    /// The greatest root mean square of relative bias of an integrator that `auto` may choose; none if `None`.
    pub allow_bias: Option<f64>,
    /// What a ray of each candidate of `auto` costs; the table of the program if `None`.
    pub costs: Option<Costs>,
    /// The mean squared relative bias of the integrator, if it was measured when the render began.
    pub squared_bias: Option<f64>,
    /// The sampler.
    pub sampler: Option<SamplerKind>,
    /// Whether the default sampler replaces the scene's if that is `independent`, which most exporters write.
    pub replace_independent: bool,
    /// Stop rules; without any, the scene's sample count.
    pub stop: StopRules,
    /// The seed.
    pub seed: u64,
    /// The names of layers in addition to the image.
    pub aov: Vec<String>,
    /// Whether noisier cells of the image get more samples.
    pub adaptive: WhenPays,
    /// Whether paths are reused; `None` leaves it to the scene.
    pub path_reuse: Option<WhenPays>,
    /// Whether paths are split at the first surface; `None` leaves it to the scene.
    pub path_splitting: Option<WhenPays>,
    /// Whether paths are guided, whatever the scene says.
    pub path_guiding: bool,
    /// Whether light paths find caustics for `path`; the scene decides if it is `None`.
    pub path_caustics: Option<WhenPays>,
    /// Whether `bdpt` connects paths; the scene decides if it is `None`.
    pub connections: Option<WhenPays>,
    /// The file that stores the result of the integrator's preparation.
    pub cache: Option<CacheFile>,
    /// The range of samples of each pixel to take, out of those determined by the stop rules; all if `None`.
    pub samples: Option<Range<u64>>,
}

/// Returns the choice of connections with which the integrator of the given name is rendered without pilots.
pub fn connected(integrator: &str) -> Option<WhenPays> {
    (integrator == Bdpt::NAME).then_some(WhenPays::Always)
}

/// The settings of an integrator and a job.
#[derive(Clone, Debug)]
pub struct Plan {
    /// The integrator.
    pub integrator: Settings,
    /// How the integrator was chosen, if there were pilots of several.
    pub decision: Option<Decision>,
    /// Sampler, seed, threads, stop rules and layers.
    pub job: JobSettings,
    /// Whether noisier cells of the image get more samples; [`Never`](WhenPays::Never) if that is impossible.
    pub adaptive: WhenPays,
    /// The file that stores the result of the integrator's preparation.
    pub cache: Option<CacheFile>,
    /// The index of the first sample of each pixel.
    pub first: u64,
    /// The samples per pixel of the complete render, of which this may be a part.
    pub target: Option<u64>,
}

/// Returns whether layers state variances, from which z-tests compute those of blocks of pixels.
pub(super) fn states_variances(layers: &[Layer]) -> bool {
    layers.iter().any(|layer| matches!(layer.aov, Aov::Variance | Aov::BlockVariance))
}

/// The samples per pixel if neither the scene nor the user sets them.
pub(super) const DEFAULT_SPP: u64 = 64;
/// The integrators that need only rays of a camera: neither light paths to it nor the extent of its pixels.
const RAYS_ONLY: [&str; 8] = ["path", "volpath", "direct", "whitted", "distribution", "ao", "depth", "aov"];

/// Where the camera sees light that [`HiddenLight::Direct`] does not find.
const SEEN_BY_DELTAS: &str = " where the camera sees it in a mirror or through glass";

impl Plan {
    /// Sets whether noisier cells get more samples, as in the render that is continued.
    pub fn keep_adaptive(&mut self, adaptive: WhenPays) {
        self.adaptive = adaptive;
        if let Some(path) = self.integrator.path_mut().filter(|_| adaptive == WhenPays::Always) {
            // Light paths cannot choose the pixels that need more samples.
            path.caustics = WhenPays::Never;
        }
    }
}

impl Session {
    /// Returns the settings of a render.
    ///
    /// # Errors
    /// If the integrator or a layer does not exist, a layer occurs twice, the integrator does not support adaptive
    /// sampling, or the image exceeds the memory limit.
    pub fn plan(&self, choices: &Choices) -> Result<Plan> {
        let question = self.question(choices)?.filter(|question| self.is_worth_pilots(choices, *question));
        let decision = question.map(|question| self.decide(choices, question)).transpose()?;
        let name = decision.as_ref().map(|decision| decision.integrator).or(choices.integrator.as_deref());
        let mut integrator = choose_integrator(name, self.defaults.integrator.clone())?;
        choose_connections(&mut integrator, choices, decision.is_some())?;
        let mut stop = choices.stop;
        if stop == StopRules::default() {
            stop.samples = Some(self.defaults.samples_per_pixel.unwrap_or(DEFAULT_SPP));
        }
        let usable = |kind: &SamplerKind| !choices.replace_independent || *kind != SamplerKind::Independent;
        let kind = choices.sampler.or(self.defaults.sampler.filter(usable)).unwrap_or_default();
        let replicates = integrator::replicates(integrator.create().as_ref(), kind);
        let sampler = Sampler::with_replicates(kind, stop.samples, replicates);
        let layers = choose_layers(&choices.aov, &integrator, replicates > 2)?;
        self.choose_paths(&mut integrator, choices, &layers)?;
        let created = integrator.create();
        created.check(&self.scene)?;
        if self.scene.uses_media() {
            integrator.check_media()?;
        }
        if let Some(why) = obstacle_to_camera(created.as_ref(), self.camera()) {
            return Err(Error::scene(why));
        }
        let target = stop.samples;
        let first = match &choices.samples {
            Some(range) => restrict(range, &mut stop)?,
            None => 0,
        };
        let squared_bias = match &decision {
            Some(decision) => decision.squared_bias,
            None => choices.squared_bias,
        };
        if let (Some(squared_bias), Some(target)) = (squared_bias, stop.error)
            && !leaves_room(squared_bias, target)
        {
            let bias = percent(squared_bias.sqrt());
            return Err(Error::usage(format!(
                "--target-error {target}: {} has a bias of {bias}; its square is more than half of this target",
                integrator.name()
            )));
        }
        let job =
            JobSettings { sampler, seed: choices.seed, threads: self.threads, stop, layers, squared_bias };
        let adaptive = match (choices.adaptive, obstacle_to_rates(created.as_ref(), kind)) {
            (WhenPays::Always, Some(why)) => return Err(Error::usage(format!("--adaptive: {why}"))),
            (WhenPays::Auto, None) if created.adapts() && !kind.is_grid() && stop.time.is_none() => {
                WhenPays::Auto
            }
            (WhenPays::Always, None) => WhenPays::Always,
            _ => WhenPays::Never,
        };
        if choices.cache.is_some() && !created.supports_cache_file() {
            return Err(Error::usage(format!(
                "--cache: {} has no preparation that a file could store",
                created.name()
            )));
        }
        let cache = choices.cache.clone();
        let plan = Plan { integrator, decision, job, adaptive, cache, first, target };
        drop(self.reserve(&plan)?);
        Ok(plan)
    }

    /// Returns what pilots decide for an image of any size, if the user or else the scene asks for that.
    ///
    /// # Errors
    /// If there is no such integrator, or an option belongs to another one.
    pub fn question(&self, choices: &Choices) -> Result<Option<Question>> {
        if let Some(auto) = self.auto(choices)? {
            return match choices.connections {
                None => Ok(Some(Question::Integrator(auto))),
                Some(_) => {
                    Err(Error::usage("--bdpt-connections: auto tries bdpt with connections; remove it"))
                }
            };
        }
        let integrator = choose_integrator(choices.integrator.as_deref(), self.defaults.integrator.clone())?;
        Ok(match &integrator {
            Settings::Bdpt(bdpt) if self.asks_for_connections(choices, bdpt) => Some(Question::Connections),
            _ => None,
        })
    }

    /// Returns whether pilots decide if connections of `bdpt` pay. Options of `path` and all that `bdpt` cannot render
    /// are left to [`plan`](Self::plan), which refuses them. Layers of variances differ between integrators, so `bdpt`
    /// makes them itself.
    fn asks_for_connections(&self, choices: &Choices, bdpt: &BdptSettings) -> bool {
        let of_path = choices.path_reuse.is_some()
            || choices.path_splitting.is_some()
            || choices.path_caustics.is_some()
            || choices.path_guiding
            || choices.adaptive == WhenPays::Always;
        let variances = [Aov::Variance, Aov::BlockVariance].map(|layer| layer.name());
        let created = Settings::Bdpt(*bdpt).create();
        choices.connections.unwrap_or(bdpt.connections) == WhenPays::Auto
            && bdpt.techniques == Techniques::All
            && !of_path
            && !choices.aov.iter().any(|name| variances.contains(&name.as_str()))
            && created.check(&self.scene).is_ok()
            && obstacle_to_camera(created.as_ref(), self.camera()).is_none()
            && !self.scene.has_hidden_light()
    }

    /// Returns what the integrator of a plan never finds, if mirrors or smooth glass send much of it.
    pub fn missed_light(&self, plan: &Plan) -> Option<String> {
        let integrator = match &plan.integrator {
            Settings::Aov(AovSettings { image: Some(image), .. }) => image,
            own => own,
        };
        let (where_seen, others) = match integrator.hidden_light() {
            HiddenLight::Found => return None,
            HiddenLight::Missed if self.scene.uses_media() => ("", "; bdpt finds a part of it"),
            HiddenLight::Missed => ("", "; sppm does"),
            HiddenLight::Direct if self.scene.uses_media() => (SEEN_BY_DELTAS, ""),
            HiddenLight::Direct => (SEEN_BY_DELTAS, "; sppm does"),
        };
        self.scene.has_much_hidden_light().then(|| {
            let name = integrator.name();
            format!("{name} does not find light that mirrors and glass send from points, spots and parallel lights{where_seen}{others}")
        })
    }

    /// Returns how pilots choose the integrator, if the user or else the scene asks for that.
    fn auto(&self, choices: &Choices) -> Result<Option<AutoSettings>> {
        let of_scene = self.defaults.auto;
        let auto = match choices.integrator.as_deref() {
            None => of_scene,
            Some(AUTO) => Some(of_scene.unwrap_or_default()),
            Some(_) => None,
        };
        let Some(auto) = auto else {
            return match choices {
                Choices { allow_bias: Some(_), .. } => {
                    Err(Error::usage("--allow-bias: only --integrator auto measures a bias"))
                }
                Choices { costs: Some(_), .. } => {
                    Err(Error::usage("--auto-costs: only --integrator auto compares costs"))
                }
                _ => Ok(None),
            };
        };
        if choices.cache.is_some() {
            return Err(Error::usage("--cache: expected the name of an integrator, found auto"));
        }
        Ok(Some(AutoSettings { allow_bias: choices.allow_bias.or(auto.allow_bias) }))
    }

    /// Sets whether paths are reused, split and guided, and whether light paths find caustics. Pixels with
    /// variances for z-tests keep independent errors.
    fn choose_paths(&self, integrator: &mut Settings, choices: &Choices, layers: &[Layer]) -> Result<()> {
        let name = integrator.name();
        let Some(path) = integrator.path_mut() else {
            let refuse = |option, done| {
                Err(Error::usage(format!("{option}: {name} has no paths that are {done}; use path")))
            };
            return match choices {
                Choices { path_reuse: Some(_), .. } => refuse("--path-reuse", "reused"),
                Choices { path_splitting: Some(_), .. } => refuse("--path-splitting", "split"),
                Choices { path_guiding: true, .. } => refuse("--path-guiding", "guided"),
                Choices { path_caustics: Some(_), .. } => refuse("--path-caustics", "added for caustics"),
                _ => Ok(()),
            };
        };
        path.guided |= choices.path_guiding;
        path.reuse = choices.path_reuse.unwrap_or(path.reuse);
        path.splitting = choices.path_splitting.unwrap_or(path.splitting);
        path.caustics = choices.path_caustics.unwrap_or(path.caustics);
        if states_variances(layers) {
            if path.reuse == WhenPays::Always {
                return Err(Error::usage(
                    "path_reuse always: found a layer of variances, which needs pixels with independent \
                     errors; use auto",
                ));
            }
            path.reuse = WhenPays::Never;
        }
        let adapts = choices.adaptive == WhenPays::Always;
        if let Some(why) = obstacle_to_light_paths(path, adapts, layers, self.camera()) {
            if path.caustics == WhenPays::Always {
                return Err(Error::usage(format!("path_caustics always: {why}; use auto")));
            }
            path.caustics = WhenPays::Never;
        }
        if self.scene.needs.deltas == 0 {
            path.caustics = WhenPays::Never;
        }
        Ok(())
    }
}

/// Returns why light paths cannot find caustics beside paths from a camera, if they cannot.
fn obstacle_to_light_paths(
    path: &PathSettings,
    adapts: bool,
    layers: &[Layer],
    camera: &Camera,
) -> Option<&'static str> {
    if path.guided {
        Some("paths that are guided cannot be weighted against light paths")
    } else if adapts {
        Some("light paths cannot choose the pixels that need more samples")
    } else if states_variances(layers) {
        Some("found a layer of variances, which needs pixels with independent errors")
    } else if camera.is_meter() {
        Some("light paths cannot be connected to a radiancemeter, irradiancemeter or distant sensor")
    } else {
        spherical_with_wide_filter(camera).then_some("a spherical sensor needs the filter box")
    }
}

/// Returns whether light paths that reach one border of the image would have to count at the opposite one.
fn spherical_with_wide_filter(camera: &Camera) -> bool {
    camera.is_spherical() && camera.film.filter.radius() > 0.5
}

/// Returns why an integrator cannot render the image of a camera, if it cannot.
fn obstacle_to_camera(integrator: &dyn Integrator, camera: &Camera) -> Option<String> {
    let name = integrator.name();
    if camera.is_meter() && !RAYS_ONLY.contains(&name) {
        let list = RAYS_ONLY.join(", ");
        return Some(format!(
            "{name} cannot render a radiancemeter, irradiancemeter or distant sensor: expected one of {list}"
        ));
    }
    (spherical_with_wide_filter(camera) && integrator.traces_light_paths()).then(|| {
        format!(
            "{name} needs the filter box for a spherical sensor: light paths that reach one border of the image \
             do not count at the opposite one"
        )
    })
}

/// Returns why cells cannot have different numbers of samples, if they cannot.
fn obstacle_to_rates(integrator: &dyn Integrator, sampler: SamplerKind) -> Option<String> {
    let name = integrator.name();
    if !sampler.has_independent_pixels() {
        return Some(format!(
            "with the sampler {sampler}, the samples of neighbouring pixels are correlated, and all must be taken; \
             use another sampler"
        ));
    }
    if integrator.light_tracer().is_some() {
        return Some(format!(
            "{name} traces paths from the emitters and cannot choose the pixels that they contribute to"
        ));
    }
    let progressive = integrator.progressive().is_some();
    progressive
        .then(|| format!("{name} traces paths for all pixels together and cannot sample some of the pixels"))
}

/// Limits the stop rules to a range of samples; returns the first sample of the range.
fn restrict(range: &Range<u64>, stop: &mut StopRules) -> Result<u64> {
    let Range { start, end } = *range;
    let refuse = |why: String| Err(Error::usage(format!("--sample-range {start}..{end}: {why}")));
    if stop.error.is_some() || stop.time.is_some() {
        return refuse("a range fixes the number of samples and excludes --time and --target-error".into());
    }
    let total = stop.samples.unwrap_or(0);
    if end > total {
        let samples = counted(total, "sample", "samples");
        return refuse(format!("the whole render has {samples} per pixel; increase it with --spp"));
    }
    stop.samples = Some(end);
    Ok(start)
}

/// Sets that `bdpt` connects paths. Pilots have decided so, or there are none.
///
/// # Errors
/// If the user chooses connections of another integrator, which no pilot chose.
fn choose_connections(integrator: &mut Settings, choices: &Choices, is_decided: bool) -> Result<()> {
    match integrator {
        Settings::Bdpt(bdpt) => bdpt.connections = WhenPays::Always,
        Settings::Aov(AovSettings { image: Some(image), .. }) => {
            return choose_connections(image, choices, is_decided);
        }
        other if choices.connections.is_some() && !is_decided => {
            let name = other.name();
            return Err(Error::usage(format!("--bdpt-connections: expected bdpt, found {name}")));
        }
        _ => {}
    }
    Ok(())
}

/// Returns the integrator named by the user, or else that of the scene. Path lengths and hidden emitters are taken
/// from the scene if both integrators have them. The depth of ray trees, whose cost is exponential, is at most their
/// default.
fn choose_integrator(name: Option<&str>, of_scene: Settings) -> Result<Settings> {
    Ok(match name {
        None => of_scene,
        Some(name) if name == of_scene.name() => of_scene,
        // Its layers are those of --aov: see `choose_layers`.
        Some("aov") => Settings::Aov(AovSettings { layers: Vec::new(), image: Some(Box::new(of_scene)) }),
        Some(name) => Settings::by_name(name, of_scene.limits()).ok_or_else(|| {
            let (last, others) = Settings::NAMES.split_last().expect("there are integrators");
            let list = others.join(", ");
            let near = did_you_mean(name, std::iter::once(AUTO).chain(Settings::NAMES.iter().copied()));
            Error::usage(format!(
                "--integrator: there is no integrator \"{name}\"{near}; there are {AUTO}, {list} and {last}"
            ))
        })?,
    })
}

/// Returns the layers of the scene's `aov` integrator and those named by the user.
///
/// If pixels share noise, variances of blocks are added to those of pixels.
fn choose_layers(names: &[String], settings: &Settings, shared: bool) -> Result<Vec<Layer>> {
    let mut layers = match settings {
        Settings::Aov(aov) => aov.layers.clone(),
        Settings::Irrcache(IrrcacheSettings { debug: true, .. }) => {
            vec![Layer { name: "record_radius".into(), aov: Aov::RecordRadius }]
        }
        _ => Vec::new(),
    };
    if layers.is_empty() && names.is_empty() && matches!(settings, Settings::Aov(_)) {
        return Err(Error::usage(format!(
            "--integrator aov: expected layers in --aov: {}",
            Aov::NAMES.join(", ")
        )));
    }
    for (i, name) in names.iter().enumerate() {
        let aov = Aov::by_name(name).ok_or_else(|| {
            let near = did_you_mean(name, Aov::NAMES.iter().copied());
            Error::usage(format!(
                "--aov: there is no layer \"{name}\"{near}; there are {}",
                Aov::NAMES.join(", ")
            ))
        })?;
        let cached = match settings {
            Settings::Aov(AovSettings { image: Some(image), .. }) => image.as_ref(),
            other => other,
        };
        if aov == Aov::RecordRadius && !matches!(cached, Settings::Irrcache(_)) {
            return Err(Error::usage(format!(
                "--aov record_radius: {} has no irradiance records; use irrcache",
                settings.name()
            )));
        }
        // `moment` adds its variance.
        if layers.iter().any(|l| l.name == *name && l.aov == aov) && !names[..i].contains(name) {
            continue;
        }
        if layers.iter().any(|l| l.name == *name) {
            return Err(Error::usage(format!("--aov: found the layer \"{name}\" twice")));
        }
        layers.push(Layer { name: name.clone(), aov });
    }
    let has = |aov| layers.iter().any(|layer| layer.aov == aov);
    if shared && has(Aov::Variance) && !has(Aov::BlockVariance) {
        layers.push(Layer { name: Aov::BlockVariance.name().into(), aov: Aov::BlockVariance });
    }
    Ok(layers)
}
