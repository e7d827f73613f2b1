//! Cases: variants of a scene, rendered on every traversal by every integrator that claims them, and compared with
//! known values.

use super::expectation::{Case, Claim, Expectations};
use super::judge::judge;
use super::reference::Reference;
use super::region::{Confidence, Region, figures, rounded, with_interval};
use super::runner::{Picture, Runner};
use super::{FoundScene, REFERENCE_SEED, RegressRow, Status};
use crate::accel::AccelKind;
use crate::error::{Error, Result};
use crate::session::{Plan, Session};
use std::collections::HashSet;
use std::time::Instant;

/// The measurements of a case with one integrator.
#[derive(Clone, Debug)]
pub struct CaseResult {
    /// The scene's name.
    pub scene: String,
    /// The subject of the scene's cases.
    pub about: String,
    /// The case.
    pub case: Case,
    /// The integrator.
    pub integrator: String,
    /// A measurement for each traversal.
    pub measured: Vec<Measured>,
}

/// The measurement on one traversal.
#[derive(Clone, Debug)]
pub struct Measured {
    /// The name of the traversal, such as `embree` or `list+embree`.
    pub accel: String,
    /// The measured part of the image, if it could be measured.
    pub region: Option<Region>,
    /// Rays to the closest surface per sample, which is the mean length of a path.
    pub rays_per_sample: f64,
    /// The faults found.
    pub faults: Vec<String>,
}

impl Measured {
    /// Formats the mean with its interval.
    pub fn text(&self) -> String {
        let Some(region) = &self.region else { return "error".into() };
        let [mean, half] = [region.mean, region.half_width];
        let decimals = |c: usize| with_interval(mean[c], half[c]);
        if region.is_grey() {
            return decimals(0);
        }
        let widest = half.into_iter().fold(0.0, f64::max);
        let values = mean.map(|v| with_interval(v, widest).split(' ').next().unwrap_or_default().to_owned());
        let interval = if widest > 0.0 { format!(" ± {}", rounded(widest, 2)) } else { String::new() };
        values.join("/") + &interval
    }
}

/// Returns whether a scene was refused with the expected message.
fn is_expected(error: &Error, claim: &Claim) -> bool {
    matches!(claim, Claim::Refused(sentence) if error.to_string().contains(sentence))
}

impl CaseResult {
    /// Formats the expected value.
    pub fn expected(&self) -> String {
        let colour = |v: [f64; 3]| {
            if v[0] == v[1] && v[1] == v[2] { rounded(v[0], 6) } else { v.map(|v| rounded(v, 4)).join("/") }
        };
        match &self.case.claim {
            Claim::Value { expected, within: _ } if *expected == [0.0; 3] => "0".into(),
            Claim::Value { expected, within } => {
                format!("{} ± {} %", colour(*expected), figures(100.0 * within))
            }
            Claim::Between { low, high } => format!("{} … {}", colour(*low), colour(*high)),
            Claim::Refused(_) => "refused".into(),
            Claim::SameAs { defines, within } => {
                let defines: Vec<_> =
                    defines.iter().map(|(name, value)| format!("{name} = {value}")).collect();
                format!("as {} ± {} %", defines.join(", "), figures(100.0 * within))
            }
        }
    }
}

/// Returns the greatest number of measurements of a scene's cases. The significance is divided among them.
pub(super) fn measurements(accels: &[AccelKind], expectations: &Expectations) -> usize {
    expectations.cases.iter().map(|case| case.integrators.len().max(1) * accels.len()).sum()
}

/// Renders a scene's cases and passes each result to `each`.
pub(super) fn rows(
    runner: &Runner<'_>,
    scene: &FoundScene,
    expectations: &Expectations,
    mut each: impl FnMut(RegressRow),
) {
    let mut said = HashSet::new();
    for case in &expectations.cases {
        let mut warnings = Vec::new();
        let started = Instant::now();
        let variants = Variants::open(runner, scene, case, &mut warnings);
        warnings.retain(|warning: &Error| said.insert(warning.to_string()));
        let integrators = match &variants {
            Ok(variants) => variants.integrators(case, runner.options.choices.integrator.as_deref()),
            Err(_) => vec![case.integrators.first().cloned().unwrap_or_default()],
        };
        let mut opened = started.elapsed();
        for integrator in integrators {
            let started = Instant::now();
            let outcome = match &variants {
                _ if runner.progress.is_interrupted() => Ok(None),
                Ok(variants) => variants.measure(runner, case, &integrator),
                Err(error) => Err(error.clone()),
            };
            let result = |measured| CaseResult {
                scene: scene.name.clone(),
                about: expectations.about.clone(),
                case: case.clone(),
                integrator: integrator.clone(),
                measured,
            };
            let (status, message, samples, measured) = match outcome {
                Ok(Some((samples, measured))) => {
                    let (status, message) = verdict(case, &integrator, &measured);
                    (status, message, samples, measured)
                }
                Ok(None) => (Status::NotRun, "interrupted".to_owned(), 0, Vec::new()),
                Err(error) if is_expected(&error, &case.claim) => {
                    (Status::Pass, error.message.clone(), 0, Vec::new())
                }
                Err(error) => (Status::Error, error.to_string(), 0, Vec::new()),
            };
            each(RegressRow {
                name: format!("{}: {}, {integrator}", scene.name, case.name),
                status,
                message,
                samples_per_pixel: samples,
                elapsed: started.elapsed() + std::mem::take(&mut opened),
                warnings: std::mem::take(&mut warnings),
                shown: None,
                case: Some(result(measured)),
            });
        }
    }
}

/// Returns whether a case holds or fails as it is known to, and a message.
fn verdict(case: &Case, integrator: &str, measured: &[Measured]) -> (Status, String) {
    let known: Vec<_> = case.known.iter().filter(|known| known.is_about(integrator)).collect();
    let failed: Vec<&Measured> = measured.iter().filter(|m| !m.faults.is_empty()).collect();
    let faults: Vec<String> =
        failed.iter().map(|m| format!("{}: {}", m.accel, m.faults.join("; "))).collect();
    let faults = faults.join("; ");
    let needless = known.iter().find(|known| {
        let mut about = measured.iter().filter(|m| known.is_on(&m.accel)).peekable();
        about.peek().is_some() && about.all(|m| m.faults.is_empty())
    });
    if let Some(known) = needless {
        return (Status::Fail, format!("holds, though it is known to fail ({}); {faults}", known.why));
    }
    if failed.is_empty() {
        return (Status::Pass, String::new());
    }
    let reasons: Vec<&str> = known.iter().map(|known| known.why.as_str()).collect();
    if failed.iter().all(|m| known.iter().any(|known| known.is_on(&m.accel))) {
        return (Status::Known, format!("{}; {faults}", reasons.join("; ")));
    }
    (Status::Fail, faults)
}

/// The variants of a case's scene, compiled for each traversal.
struct Variants {
    /// The case's own variant, with the names of the traversals.
    sessions: Vec<(String, Session)>,
    /// The variant that must give the same image, if there is one.
    others: Vec<Session>,
}

impl Variants {
    fn open(
        runner: &Runner<'_>,
        scene: &FoundScene,
        case: &Case,
        warnings: &mut Vec<Error>,
    ) -> Result<Variants> {
        let mut variants = Variants { sessions: Vec::new(), others: Vec::new() };
        let load = |defines: &[(String, String)], warnings: &mut Vec<Error>| {
            let mut file = runner.load(scene, defines, warnings)?;
            file.pass_panes(case.integrators.iter().map(String::as_str));
            Result::Ok(file)
        };
        let file = load(&case.defines, warnings)?;
        let other = match &case.claim {
            Claim::SameAs { defines, .. } => {
                let defines = [case.defines.as_slice(), defines.as_slice()].concat();
                Some(load(&defines, warnings)?)
            }
            _ => None,
        };
        for &kind in &runner.options.case_accels {
            let mut session = file.clone().compile(kind, runner.options.threads)?;
            runner.warn(&mut session.warnings, warnings)?;
            let name = session.scene.accel.name().to_owned();
            // `auto` may select a traversal that is already in the list.
            if variants.sessions.iter().any(|(other, _)| *other == name) {
                continue;
            }
            variants.sessions.push((name, session));
            if let Some(other) = &other {
                variants.others.push(other.clone().compile(kind, runner.options.threads)?);
            }
        }
        Ok(variants)
    }

    /// Returns the integrators that claim a case, or only the chosen one if the user chose one.
    fn integrators(&self, case: &Case, chosen: Option<&str>) -> Vec<String> {
        let mut names = case.integrators.clone();
        if let Some((_, session)) = self.sessions.first().filter(|_| names.is_empty()) {
            names.push(session.defaults.integrator_name().to_owned());
        }
        names.retain(|name| chosen.is_none_or(|chosen| chosen == name));
        names
    }

    /// Renders and measures a case; returns `None` if it was interrupted.
    fn measure(
        &self,
        runner: &Runner<'_>,
        case: &Case,
        integrator: &str,
    ) -> Result<Option<(u64, Vec<Measured>)>> {
        let mut all = Vec::new();
        let mut samples = 0;
        for (i, (accel, session)) in self.sessions.iter().enumerate() {
            let plan = plan(runner, case, session, integrator, runner.options.choices.seed)?;
            let Some(picture) = runner.render(session, &plan)? else { return Ok(None) };
            samples = picture.samples_per_pixel;
            let mut measured = measured(runner, case, &picture);
            measured.accel.clone_from(accel);
            if let Some(other) = self.others.get(i) {
                let plan = self::plan(runner, case, other, integrator, REFERENCE_SEED)?;
                let Some(reference) = runner.render(other, &plan)? else { return Ok(None) };
                measured.faults.extend(differences(runner, case, &picture, reference));
            }
            all.push(measured);
        }
        Ok(Some((samples, all)))
    }
}

fn plan(runner: &Runner<'_>, case: &Case, session: &Session, integrator: &str, seed: u64) -> Result<Plan> {
    let samples = runner.options.samples.or(case.samples).unwrap_or_else(|| runner.samples(session));
    runner.plan_with(session, Some(integrator), samples, seed)
}

/// Measures an image.
fn measured(runner: &Runner<'_>, case: &Case, picture: &Picture) -> Measured {
    let confidence = Confidence { significance: runner.rules.significance, replicates: &picture.replicates };
    let mut faults: Vec<String> = picture.dropped.iter().cloned().collect();
    if let Claim::Refused(sentence) = &case.claim {
        faults.push(format!("the scene was expected to be refused: \"{sentence}\""));
    }
    let region = match Region::measure(&picture.image, case.pixels, confidence) {
        Ok(region) => {
            faults.extend(region.faults(&case.claim, case.pixels_within));
            Some(region)
        }
        Err(fault) => {
            faults.push(fault);
            None
        }
    };
    Measured { accel: String::new(), region, rays_per_sample: picture.rays_per_sample, faults }
}

/// Returns the faults found by comparing an image with that of another variant.
fn differences(runner: &Runner<'_>, case: &Case, picture: &Picture, reference: Picture) -> Vec<String> {
    let reference = Reference { image: reference.image, variance: None };
    let judgement = judge(&picture.image, picture.samples_per_pixel, &reference, &runner.rules);
    let mut faults = judgement.faults;
    if let (Claim::SameAs { within, .. }, Some(gain)) = (&case.claim, judgement.gain)
        && gain.is_finite()
        && gain > *within
    {
        faults.push(format!(
            "too noisy: only a gain of {} % would be found, expected {} %",
            figures(100.0 * gain),
            figures(100.0 * within)
        ));
    }
    faults
}
