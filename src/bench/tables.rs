//! The measurements as tables.

use super::{BenchRow, Combination, Report, SceneReport};
use crate::report::{Align, Table};
use std::path::Path;

/// Returns all tables as text for a terminal.
pub fn text(report: &Report) -> String {
    let mut text = String::new();
    for scene in &report.scenes {
        let [width, height] = scene.size;
        text.push_str(&format!("{} ({width}x{height}): {}\n", scene.name(), reference(scene, None)));
        text.push_str(&figures(report, scene).text());
        unknown_slopes(scene).iter().for_each(|reason| text.push_str(&format!("{reason}\n")));
        text.push('\n');
    }
    if report.scenes.iter().any(any_near_floor) {
        text.push_str(NEAR_FLOOR);
        text.push('\n');
    }
    text
}

/// The meaning of a star.
pub(super) const NEAR_FLOOR: &str =
    "* less than ten times the reference's own relMSE: too near to it to be told apart, and not in the slope";

/// Describes the reference of the scene and its error.
pub(super) fn reference(scene: &SceneReport, folder: Option<&Path>) -> String {
    let floor = scene.reference.floor.map_or_else(|| "unknown".into(), |f| format!("about {f:.1e}"));
    format!("the reference is {}; its own relMSE is {floor}", scene.reference.origin(folder))
}

/// Returns whether any error is too close to the reference's own error.
pub(super) fn any_near_floor(scene: &SceneReport) -> bool {
    let medians = scene.rows.iter().flat_map(BenchRow::medians).flatten();
    medians.into_iter().any(|m| m.is_near_floor(&scene.reference))
}

/// Returns the measurements of a scene: a line for each combination and budget.
pub(super) fn figures(report: &Report, scene: &SceneReport) -> Table {
    let left = ["integrator", "sampler", "accel", "budget"].map(|t| (t, Align::Left));
    let right =
        ["spp", "seconds", "relMSE", "trimmed", "MSE", "FLIP", "efficiency", "Mray/s", "slope (95 %)"];
    let mut table = Table::new(left.into_iter().chain(right.map(|t| (t, Align::Right))));
    for row in &scene.rows {
        let c = &row.combination;
        let names = [c.integrator.clone(), c.sampler.to_string(), c.accel.to_string()];
        if let Some(reason) = &row.failure {
            table.remark(names, reason);
            continue;
        }
        for (budget, median) in report.options.budgets.iter().zip(row.medians()) {
            let names = names.iter().cloned().chain([budget.to_string()]);
            let Some(m) = median else {
                table.remark(names, "interrupted before it was measured");
                continue;
            };
            let star = if m.is_near_floor(&scene.reference) { "*" } else { "" };
            let last = report.options.budgets.last() == Some(budget);
            let slope = if last { slope(row, scene) } else { String::new() };
            table.row(names.chain([
                format!("{}", m.samples_per_pixel),
                format!("{:.3}", m.seconds),
                format!("{:.3e}{star}", m.relmse),
                format!("{:.3e}", m.trimmed_relmse),
                format!("{:.3e}", m.mse),
                format!("{:.4}", m.flip),
                format!("{:.1}", m.efficiency),
                format!("{:.2}", m.mrays_per_second),
                slope,
            ]));
        }
    }
    table
}

/// Formats the slope with its interval, such as "−1.02 [−1.10, −0.94]".
fn slope(row: &BenchRow, scene: &SceneReport) -> String {
    row.slope(&scene.reference).map_or_else(
        |_| "not known".into(),
        |law| format!("{:.2} [{:.2}, {:.2}]", law.exponent, law.interval[0], law.interval[1]),
    )
}

/// Returns the reason why a slope is unknown, as a sentence for each combination without one.
pub(super) fn unknown_slopes(scene: &SceneReport) -> Vec<String> {
    let measured = scene.rows.iter().filter(|row| row.cells.iter().any(|runs| !runs.is_empty()));
    let reason = |row: &BenchRow| {
        let Combination { integrator, sampler, accel } = &row.combination;
        let reason = row.slope(&scene.reference).err()?;
        Some(format!("the slope of {integrator}, {sampler}, {accel} is not known: {reason}"))
    };
    measured.filter_map(reason).collect()
}
