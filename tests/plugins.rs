//! The scenes under `scenes/plugins`, at least one for each plugin, compared with references of many samples.
//!
//! The references are Buffon's own. They were stored after the scene was verified as described in docs/plugins.md. To
//! render missing ones: `buffon regress scenes/plugins --update=missing --update-spp 2048`.

use buffon::regress::{Options, Status, discover, run};
use buffon::render::Progress;
use buffon::session::Choices;
use std::path::Path;

#[test]
fn every_fourth_plugin_renders_its_reference() {
    check_references(|number| number % 4 == 0);
}

#[test]
#[ignore = "takes long: make test-all"]
fn the_other_plugins_render_their_references() {
    check_references(|number| number % 4 != 0);
}

/// Compares the scenes whose numbers are selected with their references.
fn check_references(selected: impl Fn(usize) -> bool) {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/plugins");
    let found = discover(&root, None).expect("there are scenes");
    assert!(found.scenes.len() >= 90, "{} scenes", found.scenes.len());
    let options = Options {
        // All seeds are fixed, so the result is always the same.
        significance: 0.01,
        choices: Choices { seed: 2, ..Choices::default() },
        samples: Some(64),
        output: Some(Path::new(env!("CARGO_TARGET_TMPDIR")).join("plugins")),
        ..Options::default()
    };
    let (_, scenes): (Vec<_>, Vec<_>) =
        found.scenes.into_iter().enumerate().filter(|(number, _)| selected(*number)).unzip();
    let report = run(&scenes, &options, &Progress::new(), |_| {});
    let faults = report.rows.iter().filter(|row| row.status != Status::Pass || !row.warnings.is_empty());
    let faults: Vec<String> =
        faults.map(|row| format!("{}: {} {:?}", row.name, row.message, row.warnings)).collect();
    assert!(faults.is_empty(), "{} of {} scenes:\n{}", faults.len(), report.rows.len(), faults.join("\n"));
}
