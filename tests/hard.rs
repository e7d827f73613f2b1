//! The hard cases under `scenes/hard`: each passes, or fails as expected, with every traversal.
//!
//! The table in `docs/hard-cases.md` lists them.

mod formulas;
mod many_lights;

use buffon::accel::AccelKind;
use buffon::regress::{Options, Report, Status, discover, run};
use buffon::render::Progress;
use std::path::{Path, PathBuf};

/// Returns the folder of the cases.
fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/hard")
}

/// Runs the cases of a folder.
fn report(folder: &Path) -> Report {
    let found = discover(folder, None).expect("there are scenes");
    let options = Options { threads: 2, ..Options::default() };
    run(&found.scenes, &options, &Progress::new(), |_| {})
}

/// Checks that all rows are as expected, and returns the number of expected failures.
#[track_caller]
fn expect_known(report: &Report) -> usize {
    let faults = report.rows.iter().filter(|row| !row.status.is_known());
    let faults: Vec<String> = faults.map(|row| format!("{}: {}", row.name, row.message)).collect();
    assert!(faults.is_empty(), "{} of {} cases:\n{}", faults.len(), report.rows.len(), faults.join("\n"));
    report.count(Status::Known)
}

/// The cases of rounding, which are fast.
#[test]
fn hard_cases_of_intersection_hold_or_fail_as_they_are_known_to() {
    expect_known(&report(&root().join("intersection")));
}

#[test]
#[ignore = "takes long: make test-all"]
fn hard_cases_hold_or_fail_as_they_are_known_to() {
    let report = report(&root());
    let known = expect_known(&report);
    assert!(report.rows.len() > 180, "{} cases", report.rows.len());
    assert!(known * 10 < report.rows.len(), "{known} of {} cases are known to fail", report.rows.len());
    for kind in AccelKind::ALL {
        let name = kind.to_string();
        let on_it = |row: &&buffon::regress::RegressRow| {
            row.case.as_ref().is_some_and(|case| case.measured.iter().any(|m| m.accel == name))
        };
        assert!(report.rows.iter().filter(on_it).count() > 180, "{name}");
    }
}
