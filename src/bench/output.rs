//! The measurements for other programs: CSV with a line for each render, and JSON with everything.

use super::{BenchRow, Budget, Measurement, Median, Report, SceneReport};
use crate::error::{Error, Result};
use crate::report::machine;
use serde_json::{Map, Value, json};

/// The columns of the CSV. An empty field is an unknown value.
const COLUMNS: [&str; 23] = [
    "scene",
    "integrator",
    "sampler",
    "accel",
    "budget",
    "run",
    "seed",
    "seconds",
    "spp",
    "relmse",
    "trimmed_relmse",
    "mse",
    "flip",
    "reference_relmse",
    "relmse_estimate",
    "efficiency",
    "mrays_per_second",
    "closest_rays",
    "occlusion_rays",
    "closest_thread_seconds",
    "occlusion_thread_seconds",
    "invalid_samples",
    "failure",
];

/// Returns the renders as CSV: a line for each render, and one for each combination that failed.
///
/// # Errors
/// If it cannot be encoded.
pub fn csv(report: &Report) -> Result<Vec<u8>> {
    let fail = |e: csv::Error| Error::internal(format!("cannot encode CSV: {e}"));
    let mut writer = csv::Writer::from_writer(Vec::new());
    writer.write_record(COLUMNS).map_err(fail)?;
    for scene in &report.scenes {
        for row in &scene.rows {
            if row.failure.is_some() {
                writer.write_record(line(scene, row, None)).map_err(fail)?;
            }
            for (budget, runs) in report.options.budgets.iter().zip(&row.cells) {
                for (run, measurement) in runs.iter().enumerate() {
                    let line = line(scene, row, Some((*budget, run, measurement)));
                    writer.write_record(line).map_err(fail)?;
                }
            }
        }
    }
    writer.into_inner().map_err(|e| Error::internal(format!("cannot encode CSV: {}", e.error())))
}

/// Returns the fields of a render or of a failure.
fn line(scene: &SceneReport, row: &BenchRow, render: Option<(Budget, usize, &Measurement)>) -> Vec<String> {
    let c = &row.combination;
    let known = |value: Option<f64>| value.map_or_else(String::new, |v| v.to_string());
    let mut fields = vec![scene.name(), c.integrator.clone(), c.sampler.to_string(), c.accel.to_string()];
    match render {
        Some((budget, run, m)) => fields.extend([
            budget.to_string(),
            run.to_string(),
            m.seed.to_string(),
            m.seconds.to_string(),
            m.samples_per_pixel.to_string(),
            m.relmse.to_string(),
            known(Some(m.trimmed_relmse).filter(|v| !v.is_nan())),
            m.mse.to_string(),
            known(Some(m.flip).filter(|v| !v.is_nan())),
            known(scene.reference.floor),
            known(m.relmse_estimate),
            (1.0 / (m.relmse * m.seconds)).to_string(),
            (m.rays_per_second() * 1e-6).to_string(),
            m.rays[0].to_string(),
            m.rays[1].to_string(),
            m.thread_seconds[0].to_string(),
            m.thread_seconds[1].to_string(),
            m.invalid_samples.to_string(),
            String::new(),
        ]),
        None => {
            fields.resize(COLUMNS.len() - 1, String::new());
            fields.push(row.failure.clone().unwrap_or_default());
        }
    }
    fields
}

/// Returns everything as JSON.
pub fn json(report: &Report) -> Value {
    let options = &report.options;
    let circumstances: Map<String, Value> = machine::facts()
        .into_iter()
        .map(|(name, value)| (name.to_ascii_lowercase(), Value::from(value)))
        .collect();
    json!({
        "circumstances": circumstances,
        "threads": options.threads,
        "runs": options.runs,
        "seed": options.seed,
        "budgets": options.budgets.iter().map(Budget::to_string).collect::<Vec<_>>(),
        "scenes": report.scenes.iter().map(|scene| scene_json(report, scene)).collect::<Vec<_>>(),
    })
}

fn scene_json(report: &Report, scene: &SceneReport) -> Value {
    let traversal = |t: &super::Traversal| {
        json!({
            "accel": t.accel.to_string(),
            "build_seconds": t.build_seconds,
            "memory_bytes": t.memory_bytes,
            "handicaps": super::handicaps::of(t.accel, report.options.threads),
        })
    };
    json!({
        "scene": scene.name(),
        "file": scene.path.display().to_string(),
        "width": scene.size[0],
        "height": scene.size[1],
        "triangles": scene.triangles,
        "reference": { "origin": scene.reference.origin(None), "relmse": scene.reference.floor },
        "traversals": scene.traversals.iter().map(traversal).collect::<Vec<_>>(),
        "rows": scene.rows.iter().map(|row| row_json(report, scene, row)).collect::<Vec<_>>(),
    })
}

fn row_json(report: &Report, scene: &SceneReport, row: &BenchRow) -> Value {
    let c = &row.combination;
    let budgets = report.options.budgets.iter().zip(&row.cells);
    let law = row.slope(&scene.reference);
    let slope = law
        .as_ref()
        .ok()
        .map(|law| json!({ "exponent": law.exponent, "low": law.interval[0], "high": law.interval[1] }));
    let [closest, occlusion] = row.mrays_per_thread_second();
    json!({
        "integrator": c.integrator,
        "sampler": c.sampler.name(),
        "accel": c.accel.to_string(),
        "failure": row.failure,
        "slope": slope,
        "slope_unknown": law.err(),
        "mrays_per_thread_second": { "closest": closest, "occlusion": occlusion },
        "budgets": budgets.map(|(budget, runs)| {
            let near = |m: &Median| m.is_near_floor(&scene.reference);
            json!({
                "budget": budget.to_string(),
                "median": Median::of(runs).as_ref().map(|m| json!({
                    "seconds": m.seconds,
                    "spp": m.samples_per_pixel,
                    "relmse": m.relmse,
                    "relmse_near_floor": near(m),
                    "trimmed_relmse": m.trimmed_relmse,
                    "mse": m.mse,
                    "flip": m.flip,
                    "efficiency": m.efficiency,
                    "mrays_per_second": m.mrays_per_second,
                })),
                "runs": runs.iter().map(run_json).collect::<Vec<_>>(),
            })
        }).collect::<Vec<_>>(),
    })
}

fn run_json(m: &Measurement) -> Value {
    json!({
        "seed": m.seed,
        "seconds": m.seconds,
        "spp": m.samples_per_pixel,
        "relmse": m.relmse,
        "trimmed_relmse": m.trimmed_relmse,
        "mse": m.mse,
        "flip": m.flip,
        "relmse_estimate": m.relmse_estimate,
        "rays": { "closest": m.rays[0], "occlusion": m.rays[1] },
        "accel_thread_seconds": { "closest": m.thread_seconds[0], "occlusion": m.thread_seconds[1] },
        "invalid_samples": m.invalid_samples,
    })
}
