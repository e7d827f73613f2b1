//! The cases of `buffon regress`: their lines on the terminal, and the files of their tables.

use crate::error::{Error, Result};
use crate::regress::{Beside, CaseResult, Measured, RegressRow, Report, json, markdown};
use crate::util;
use std::path::PathBuf;

/// Widths of the columns: case, integrator, expected value, and the measurement on each traversal.
const WIDTHS: [usize; 4] = [34, 12, 18, 22];

/// The lines of the cases, with a title above the cases of each scene.
#[derive(Default)]
pub(super) struct CaseLines {
    scene: String,
}

impl CaseLines {
    /// Returns the line of a case; `None` for any other row.
    pub fn line(&mut self, row: &RegressRow) -> Option<String> {
        let case = row.case.as_ref()?;
        let mut text = String::new();
        if self.scene != case.scene {
            self.scene.clone_from(&case.scene);
            text.push_str(&title(case));
        }
        let name = format!("{:<5}  {:<width$}", row.status.word(), case.case.name, width = WIDTHS[0]);
        let cells = case.measured.iter().map(Measured::text);
        text.push_str(&columns(&name, &case.integrator, &case.expected(), cells));
        text.push_str(&format!("  {:.2} s\n", row.elapsed.as_secs_f64()));
        if !row.message.is_empty() {
            text.push_str(&format!("       {}\n", row.message.replace('\n', "\n       ")));
        }
        Some(text)
    }
}

/// Returns the scene's name, the subject of its cases, and the titles of the columns.
fn title(case: &CaseResult) -> String {
    let accels = case.measured.iter().map(|m| m.accel.clone());
    let name = format!("{:<5}  {:<width$}", "", "case", width = WIDTHS[0]);
    let titles = columns(&name, "integrator", "expected", accels);
    format!("{}: {}\n{}\n", case.scene, case.about, titles.trim_end())
}

fn columns(name: &str, integrator: &str, expected: &str, cells: impl Iterator<Item = String>) -> String {
    let [_, of_integrator, of_expected, of_cell] = WIDTHS;
    let mut text = format!("{name}  {integrator:<of_integrator$}  {expected:<of_expected$}");
    cells.for_each(|cell| text.push_str(&format!("  {cell:<of_cell$}")));
    text
}

/// The files of the table, and the columns for other renderers.
pub(super) struct Tables<'a> {
    files: &'a [PathBuf],
    beside: Vec<Beside>,
}

impl<'a> Tables<'a> {
    /// Checks the file names and reads the columns, before anything is rendered.
    ///
    /// # Errors
    /// If the format of a file is unknown, or a column cannot be read.
    pub fn new(files: &'a [PathBuf], beside: &[(String, String)]) -> Result<Self> {
        let known = |path: &PathBuf| path.extension().is_some_and(|e| e == "md" || e == "json");
        if let Some(path) = files.iter().find(|path| !known(path)) {
            let path = path.display();
            return Err(Error::usage(format!("--table: expected the extension .md or .json, found {path}")));
        }
        let beside = beside.iter().map(|(title, path)| Beside::read(title, path.as_ref()));
        Ok(Tables { files, beside: beside.collect::<Result<_>>()? })
    }

    /// Writes the files.
    ///
    /// # Errors
    /// If one cannot be written.
    pub fn write(&self, report: &Report) -> Result<()> {
        for path in self.files {
            let text = if path.extension().is_some_and(|e| e == "md") {
                markdown(report, &self.beside)
            } else {
                format!("{:#}\n", json(report))
            };
            util::replace(path, text.as_bytes())?;
        }
        Ok(())
    }
}
