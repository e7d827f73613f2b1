//! The table of cases, as Markdown and as JSON.

use super::{CaseResult, Measured, RegressRow, Report, Status};
use crate::error::{Error, Result};
use serde_json::{Map, Value, json};
use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

/// The measurements of the same cases with another renderer: a column of the table.
#[derive(Clone, Debug, PartialEq)]
pub struct Beside {
    /// The column's title.
    pub title: String,
    /// The measurements, by the names of the rows.
    cells: BTreeMap<String, String>,
}

impl Beside {
    /// Reads a column: a JSON object with the names of the rows as keys and texts as values.
    ///
    /// # Errors
    /// If the file cannot be read or has another structure.
    pub fn read(title: &str, path: &Path) -> Result<Beside> {
        let text = fs::read_to_string(path)
            .map_err(|e| Error::scene(format!("cannot be read: {e}")).in_file(path))?;
        let expected = "expected a JSON object of texts, by the names of rows";
        let cells = serde_json::from_str(&text)
            .map_err(|e| Error::scene(format!("{expected}: {e}")).in_file(path))?;
        Ok(Beside { title: title.to_owned(), cells })
    }
}

/// Returns the names of the traversals on which any case was measured, in order of appearance.
fn traversals(report: &Report) -> Vec<&str> {
    let mut names: Vec<&str> = Vec::new();
    for measured in report.rows.iter().filter_map(|row| row.case.as_ref()).flat_map(|case| &case.measured) {
        if !names.contains(&measured.accel.as_str()) {
            names.push(&measured.accel);
        }
    }
    names
}

/// Returns the cases as Markdown tables: a heading for each scene, and a line for each case and integrator. The known
/// failures and their causes are below the table.
pub fn markdown(report: &Report, beside: &[Beside]) -> String {
    let traversals = traversals(report);
    let mut titles = vec!["case", "integrator", "expected"];
    titles.extend(&traversals);
    titles.extend(beside.iter().map(|column| column.title.as_str()));
    titles.extend(["rays", "verdict"]);
    let mut text = String::new();
    let mut scene = "";
    let mut notes = Vec::new();
    for (row, case) in report.rows.iter().filter_map(|row| Some((row, row.case.as_ref()?))) {
        if case.scene != scene {
            text.extend(notes.drain(..));
            scene = &case.scene;
            let about = escape(&case.about);
            text.push_str(&format!("\n### `{scene}`\n\n{about}\n\n"));
            text.push_str(&format!("| {} |\n|{}\n", titles.join(" | "), " --- |".repeat(titles.len())));
        }
        let mut cells = vec![escape(&case.case.name), case.integrator.clone(), case.expected()];
        let on = |name: &str| case.measured.iter().find(|m| m.accel == name);
        cells.extend(traversals.iter().map(|name| on(name).map_or_else(|| "–".into(), Measured::text)));
        cells.extend(
            beside.iter().map(|column| column.cells.get(&row.name).map_or_else(|| "–".into(), |c| escape(c))),
        );
        cells.extend([rays(case), verdict(row.status).into()]);
        text.push_str(&format!("| {} |\n", cells.join(" | ")));
        if !row.status.is_good() {
            let message = escape(&row.message);
            let (name, integrator) = (escape(&case.case.name), &case.integrator);
            if notes.is_empty() {
                notes.push("\n".to_owned());
            }
            notes.push(format!("- {} {name}, {integrator}: {message}\n", verdict(row.status)));
        }
    }
    text.extend(notes);
    text.trim_start().to_owned()
}

/// Returns the mean number of rays per path, on the first traversal.
fn rays(case: &CaseResult) -> String {
    case.measured.first().map_or_else(|| "–".into(), |m| super::region::figures(m.rays_per_sample))
}

/// Returns a status as the table shows it.
fn verdict(status: Status) -> &'static str {
    match status {
        Status::Pass => "pass",
        Status::Fail => "**FAIL**",
        Status::Known => "**KNOWN**",
        other => other.word(),
    }
}

/// Escapes text for a cell, which `|` and line breaks would end.
fn escape(text: &str) -> String {
    text.replace('|', "\\|").replace('\n', " ")
}

/// Returns the cases as JSON, with everything that another renderer needs to measure them, and the measurements.
pub fn json(report: &Report) -> Value {
    let rows = report.rows.iter().filter_map(|row| Some(row_json(row, row.case.as_ref()?)));
    json!({
        "significance_each": report.significance_each,
        "seconds": report.elapsed.as_secs_f64(),
        "rows": rows.collect::<Vec<_>>(),
    })
}

fn row_json(row: &RegressRow, result: &CaseResult) -> Value {
    let case = &result.case;
    let table = |pairs: &[(String, String)]| -> Map<String, Value> {
        pairs.iter().map(|(name, value)| (name.clone(), Value::from(value.as_str()))).collect()
    };
    let mut claim = Map::new();
    match &case.claim {
        super::Claim::Value { expected, within } => {
            claim.insert("expected".into(), json!(expected));
            claim.insert("within".into(), json!(within));
        }
        super::Claim::Between { low, high } => {
            claim.insert("between".into(), json!([low, high]));
        }
        super::Claim::Refused(sentence) => {
            claim.insert("refused".into(), json!(sentence));
        }
        super::Claim::SameAs { defines, within } => {
            claim.insert("same_as".into(), Value::Object(table(defines)));
            claim.insert("within".into(), json!(within));
        }
    }
    json!({
        "name": row.name,
        "scene": result.scene,
        "case": case.name,
        "why": case.why,
        "define": table(&case.defines),
        "integrator": result.integrator,
        "samples": row.samples_per_pixel,
        "pixels": case.pixels.map(|r| [r.x, r.y, r.width, r.height]),
        "claim": claim,
        "measured": result.measured.iter().map(measured_json).collect::<Vec<_>>(),
        "status": row.status.word(),
        "message": row.message,
        "seconds": row.elapsed.as_secs_f64(),
    })
}

fn measured_json(measured: &Measured) -> Value {
    json!({
        "accel": measured.accel,
        "mean": measured.region.as_ref().map(|region| region.mean),
        "half_width": measured.region.as_ref().map(|region| region.half_width),
        "rays_per_sample": measured.rays_per_sample,
        "faults": measured.faults,
    })
}
