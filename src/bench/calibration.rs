//! `buffon bench --calibrate`: what a ray of each integrator costs on this machine.

use super::{Options, load, warn};
use crate::accel::AccelKind;
use crate::error::{Error, Result};
use crate::integrator::settings::AUTO;
use crate::render::{Progress, StopReason};
use crate::session::{Choices, Costs, Session, connected};
use crate::util::is_same_file;
use std::collections::BTreeMap;
use std::path::Path;

/// The costs for each ray in one scene.
pub struct SceneCosts {
    /// The scene's name.
    name: String,
    /// Whether its media are rendered.
    in_media: bool,
    /// The seconds for each nearest-hit query by the first candidate.
    seconds: f64,
    /// The names of the candidates, and their costs relative to that of the first one.
    relative: Vec<(&'static str, f64)>,
}

/// What was measured.
pub struct Calibration {
    /// The costs in each scene.
    scenes: Vec<SceneCosts>,
    /// The geometric means over the scenes. What no scene has shown is as in the table of the program.
    pub costs: Costs,
}

/// Renders each scene by each candidate of `auto` with the first budget, the requested number of times in turns;
/// returns `None` if interrupted. Only the time of sampling counts.
///
/// # Errors
/// If a scene cannot be loaded or compiled, or `output` is one of its files.
pub fn calibrate(
    options: &Options,
    output: &Path,
    progress: &Progress,
    tell: &dyn Fn(&str),
) -> Result<Option<Calibration>> {
    // An error in the last scene is reported at the start.
    for path in &options.scenes {
        let file = load(path, options)?;
        if file.files.iter().chain([path]).any(|part| is_same_file(part, output)) {
            return Err(Error::usage(format!("--calibrate {}: it is a file of a scene", output.display())));
        }
    }
    let mut scenes = Vec::new();
    for path in &options.scenes {
        let mut file = load(path, options)?;
        file.pass_panes([AUTO]);
        warn(&file, tell);
        tell(&format!("{}: calibrating", path.display()));
        let session = file.compile(AccelKind::Auto, options.threads)?;
        session.warnings.iter().for_each(|w| tell(&format!("warning: {w}")));
        let name = super::name_of(path);
        let Some(scene) = measure(name, &session, options, progress)? else { return Ok(None) };
        scenes.push(scene);
    }
    let mut costs = Costs::default();
    for (table, in_media) in [(&mut costs.surfaces, false), (&mut costs.media, true)] {
        let mut logarithms: BTreeMap<&str, Vec<f64>> = BTreeMap::new();
        for (name, cost) in scenes.iter().filter(|scene| scene.in_media == in_media).flat_map(|s| &s.relative)
        {
            logarithms.entry(name).or_default().push(cost.ln());
        }
        for (name, logarithms) in logarithms {
            let mean = logarithms.iter().sum::<f64>() / logarithms.len() as f64;
            table.insert(name.to_owned(), mean.exp());
        }
    }
    Ok(Some(Calibration { scenes, costs }))
}

/// Measures one scene. A candidate that cannot render it is left out, unless it is the first one, the unit of costs.
fn measure(
    name: String,
    session: &Session,
    options: &Options,
    progress: &Progress,
) -> Result<Option<SceneCosts>> {
    let (names, in_media) = session.candidates();
    let mut all: Vec<(&'static str, Vec<f64>)> = names.into_iter().map(|name| (name, Vec::new())).collect();
    for run in 0..options.runs {
        for (name, found) in &mut all {
            let choices = Choices {
                integrator: Some((*name).into()),
                replace_independent: true,
                connections: connected(name),
                stop: options.budgets[0].stop(),
                seed: options.seed.wrapping_add(run.into()),
                ..Choices::default()
            };
            let Ok(plan) = session.plan(&choices) else { continue };
            let Ok(rendered) = session.render(&plan, progress) else { continue };
            if rendered.stop_reason == StopReason::Interrupted {
                return Ok(None);
            }
            found.push(rendered.elapsed.as_secs_f64() / rendered.counters.cost(&session.scene));
        }
    }
    let median = |(name, mut found): (&'static str, Vec<f64>)| {
        found.sort_by(f64::total_cmp);
        Some((name, *found.get(found.len() / 2)?))
    };
    let unit = all[0].0;
    let medians: Vec<_> = all.into_iter().filter_map(median).filter(|(_, cost)| *cost > 0.0).collect();
    let Some(&(_, seconds)) = medians.first().filter(|(name, _)| *name == unit) else {
        return Err(Error::scene(format!("--calibrate: {unit}, the unit of costs, cannot render it"))
            .in_file(&session.path));
    };
    let relative = medians.into_iter().map(|(name, cost)| (name, cost / seconds)).collect();
    Ok(Some(SceneCosts { name, in_media, seconds, relative }))
}

/// Returns the measurements as text: a line for each scene.
pub fn text(calibration: &Calibration) -> String {
    let mut text = String::new();
    for SceneCosts { name, seconds, relative, .. } in &calibration.scenes {
        let costs: Vec<String> = relative.iter().map(|(name, cost)| format!("{name} {cost:.2}")).collect();
        let nanoseconds = 1e9 * seconds;
        text +=
            &format!("{name}: {nanoseconds:.0} ns for each ray, relative to that: {}\n", costs.join(", "));
    }
    text
}
