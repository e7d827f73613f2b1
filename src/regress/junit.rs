//! JUnit XML, which continuous integration systems read.

use super::{RegressRow, Report, Status};
use crate::error::{Error, Result};
use quick_junit::{NonSuccessKind, TestCase, TestCaseStatus, TestSuite};
use std::collections::BTreeMap;

/// Returns the report as JUnit XML: a test suite for each folder, and a test case for each scene or for each of its
/// cases and integrators. A scene that fails or has no reference is a failure. A scene that cannot be rendered is an
/// error. A scene that was not run or is known to fail is skipped.
///
/// # Errors
/// Of kind [`Internal`](crate::error::Kind::Internal), if it cannot be written.
pub fn junit(report: &Report) -> Result<String> {
    let mut xml = quick_junit::Report::new("buffon regress");
    xml.set_time(report.elapsed);
    let mut folders: BTreeMap<&str, Vec<&RegressRow>> = BTreeMap::new();
    for row in &report.rows {
        folders.entry(folder_of(row)).or_default().push(row);
    }
    for (folder, rows) in folders {
        let mut suite = TestSuite::new(folder);
        suite.set_time(rows.iter().map(|row| row.elapsed).sum());
        suite.add_test_cases(rows.iter().map(|row| case(row, folder)));
        xml.add_test_suite(suite);
    }
    xml.to_string().map_err(|e| Error::internal(format!("cannot write JUnit XML: {e}")))
}

/// Returns the folder of a scene; "." for the folder of the run.
fn folder_of(row: &RegressRow) -> &str {
    scene_of(row).rsplit_once('/').map_or(".", |(folder, _)| folder)
}

/// Returns the scene's name.
fn scene_of(row: &RegressRow) -> &str {
    row.case.as_ref().map_or(&row.name, |result| &result.scene)
}

fn case(row: &RegressRow, folder: &str) -> TestCase {
    let failure = |kind, what: &str| {
        let mut status = TestCaseStatus::non_success(kind);
        status.set_message(row.message.as_str()).set_type(what);
        status
    };
    let status = match row.status {
        Status::Pass | Status::Wrote => TestCaseStatus::success(),
        Status::Fail => failure(NonSuccessKind::Failure, "different"),
        Status::New => failure(NonSuccessKind::Failure, "no reference"),
        Status::Error => failure(NonSuccessKind::Error, "error"),
        Status::NotRun => TestCaseStatus::skipped(),
        Status::Known => {
            let mut status = TestCaseStatus::skipped();
            status.set_message(format!("known to fail: {}", row.message));
            status
        }
    };
    // The name without its folder. The name of a case may contain a `/`.
    let name = row.name.strip_prefix(folder).unwrap_or(&row.name).trim_start_matches('/');
    let mut case = TestCase::new(name, status);
    case.set_classname(folder).set_time(row.elapsed);
    if let Some(result) = &row.case {
        let measured = result.measured.iter().map(|m| format!("{} {}", m.accel, m.text()));
        let measured: Vec<String> = measured.collect();
        case.set_system_out(format!("expected {}: {}", result.expected(), measured.join(", ")));
    } else if row.status.is_good() {
        case.set_system_out(row.message.as_str());
    }
    case
}

#[cfg(test)]
mod tests {
    use super::*;
    use roxmltree::{Document, Node};
    use std::time::Duration;

    #[test]
    fn every_scene_is_a_test_case_with_its_time_and_what_is_wrong() {
        let row = |name: &str, status, message: &str| RegressRow {
            name: name.into(),
            status,
            message: message.into(),
            samples_per_pixel: 64,
            elapsed: Duration::from_millis(1500),
            warnings: Vec::new(),
            shown: None,
            case: None,
        };
        let rows = vec![
            row("a.xml", Status::Pass, "p 0.5"),
            row("b/c.xml", Status::Fail, "<R> & \"G\" \u{1} off"),
            row("b/d.xml", Status::New, "no reference"),
            row("b/e.xml", Status::Error, "line one\nline two"),
            row("b/f.xml", Status::NotRun, "interrupted"),
        ];
        let report = Report { rows, significance_each: 1e-4, elapsed: Duration::from_secs(6) };
        let text = junit(&report).unwrap();
        let document = Document::parse(&text).expect("well-formed");
        let root = document.root_element();
        let counts = |node: Node<'_, '_>| {
            ["tests", "failures", "errors"].map(|a| node.attribute(a).unwrap_or_default().to_owned())
        };
        assert_eq!((root.tag_name().name(), counts(root)), ("testsuites", ["5", "2", "1"].map(String::from)));
        let suites: Vec<_> = root.children().filter(|n| n.has_tag_name("testsuite")).collect();
        let names: Vec<_> = suites.iter().filter_map(|s| s.attribute("name")).collect();
        assert_eq!(names, [".", "b"]);
        assert_eq!(counts(suites[1]), ["4", "2", "1"].map(String::from));
        let cases: Vec<_> = document.descendants().filter(|n| n.has_tag_name("testcase")).collect();
        assert!(cases.iter().all(|c| c.attribute("time") == Some("1.500")), "{text}");
        assert_eq!((cases[1].attribute("classname"), cases[1].attribute("name")), (Some("b"), Some("c.xml")));
        let inside: Vec<_> = cases
            .iter()
            .map(|c| c.children().find(|n| n.is_element()).map(|n| n.tag_name().name()))
            .collect();
        let expected = ["system-out", "failure", "failure", "error", "skipped"].map(Some);
        assert_eq!(inside, expected);
        let message = cases[1].children().find_map(|n| n.attribute("message"));
        assert_eq!(message, Some("<R> & \"G\"  off"));
    }
}
