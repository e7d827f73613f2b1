//! `buffon check`, and scenes that are rendered without what is unknown.

use crate::support::cli::Folder;

/// A scene with an unknown plugin of every class, an unknown element and two wrong values.
const STRANGE: &str = r#"<scene version="3.0.0">
  <integrator type="wavelets"><integer name="max_depth" value="3"/></integrator>
  <mode type="final"/>
  <sensor type="perspective"><transform name="to_world"><lookat origin="0,0,4" target="0,0,0" up="0,1,0"/></transform>
    <sampler type="dice"/>
    <film type="cloud_film"><integer name="width" value="8"/><integer name="height" value="6"/><rfilter type="star"/></film>
  </sensor>
  <sensor type="telescope"/>
  <bsdf type="mirror" id="shiny"/>
  <texture type="marble" id="veins"/>
  <bsdf type="diffuse" id="stone"><ref name="reflectance" id="veins"/></bsdf>
  <shape type="sphere"><ref id="shiny"/></shape>
  <shape type="teapot"/>
  <shape type="rectangle"><ref id="stone"/></shape>
  <emitter type="aurora"/>
  <emitter type="constant"/>
</scene>"#;

const FOUND: [&str; 11] = [
    r#"s.xml:2:3: <integrator type="wavelets">: unknown integrator: replaced by path"#,
    r#"s.xml:3:3: <mode type="final">: unknown element: left out"#,
    r#"s.xml:5:5: <sampler type="dice">: unknown sampler: replaced by the default"#,
    r#"s.xml:6:5: <film type="cloud_film">: unknown film: read as hdrfilm"#,
    r#"s.xml:6:96: <rfilter type="star">: unknown rfilter: replaced by the default"#,
    r#"s.xml:8:3: <sensor type="telescope">: unknown sensor: left out"#,
    r#"s.xml:9:3: <bsdf type="mirror">: unknown bsdf: rendered as grey diffuse"#,
    r#"s.xml:10:3: <texture type="marble">: unknown texture: rendered as grey"#,
    r#"s.xml:13:3: <shape type="teapot">: unknown shape: left out"#,
    r#"s.xml:15:3: <emitter type="aurora">: unknown emitter: left out"#,
    "s.xml: does not load (10 problems, 0 warnings, 0 notes)",
];

fn without_excerpts(text: &str) -> Vec<&str> {
    text.lines().filter(|line| !line.starts_with("  |")).collect()
}

#[test]
fn everything_unknown_is_listed_at_once() {
    let folder = Folder::with(STRANGE);
    let run = folder.run("check s.xml");
    assert_eq!(run.code, 3, "{run:?}");
    assert_eq!(without_excerpts(&run.stdout), FOUND);
    // With the option, the same scene loads.
    let run = folder.run("check s.xml --skip-unknown");
    assert_eq!(
        (run.code, without_excerpts(&run.stdout).pop()),
        (0, Some("s.xml: loads (10 problems, 0 warnings, 0 notes)"))
    );
}

#[test]
fn scenes_are_rendered_without_what_is_unknown() {
    let folder = Folder::with(STRANGE);
    let run = folder.run("render s.xml --spp 1 -o a.pfm");
    assert!(run.code == 3 && run.stderr.contains("unknown element"), "{run:?}");
    let run = folder.run("render s.xml --spp 1 -o a.pfm --skip-unknown");
    assert_eq!(run.code, 0, "{run:?}");
    assert!(
        run.stderr.contains("buffon: note: <bsdf type=\"mirror\">: unknown bsdf: rendered as grey diffuse")
    );
    assert!(folder.read("a.pfm").starts_with(b"PF\n8 6\n"));
    // A wrong value is an error all the same.
    let wrong = STRANGE.replace("\"3\"", "\"three\"");
    let folder = Folder::with(&wrong);
    let run = folder.run("render s.xml --spp 1 -o a.pfm --skip-unknown");
    assert!(run.code == 3 && run.stderr.contains("expected a whole number"), "{run:?}");
}

#[test]
fn wrong_values_and_missing_files_are_listed_too() {
    let scene = r#"<scene version="3.0.0">
  <sensor type="perspective"/>
  <bsdf type="diffuse" id="a"><rgb name="reflectance" value="1,x,1"/></bsdf>
  <shape type="sphere"><float name="radius" value="-1"/></shape>
  <shape type="obj"><string name="filename" value="missing.obj"/></shape>
  <shape type="sphere"><float name="radios" value="1"/></shape>
  <integrator type="mlt"/>
</scene>"#;
    let folder = Folder::with(scene);
    let run = folder.run("check s.xml --skip-unknown");
    let lines = without_excerpts(&run.stdout);
    assert_eq!(run.code, 3, "{run:?}");
    for expected in [
        "s.xml:3:",
        "s.xml:4:",
        "there is no file \"missing.obj\"",
        "warning: s.xml:6:",
        "note: the integrator mlt",
    ] {
        assert!(lines.iter().any(|line| line.contains(expected)), "{expected}: {lines:#?}");
    }
    assert_eq!(lines.last(), Some(&"s.xml: does not load (3 problems, 1 warning, 1 note)"));
}

#[test]
fn a_folder_is_checked_and_printed_as_json() {
    let folder = Folder::with("<scene version='3.0.0'><shape type='sphere'/></scene>");
    folder.write("b.xml", STRANGE.as_bytes());
    folder.write("c.xml", b"<scene");
    let run = folder.run("check --corpus .");
    assert_eq!(run.code, 3);
    assert_eq!(run.stdout.lines().last(), Some("1 of 3 scenes load (33.3 %)"), "{}", run.stdout);
    let run = folder.run("check s.xml b.xml --json --integrator path");
    let json: serde_json::Value = serde_json::from_str(&run.stdout).unwrap();
    assert_eq!((json[0]["loads"].as_bool(), json[1]["loads"].as_bool()), (Some(true), Some(false)));
    let problems = json[1]["problems"].as_array().unwrap();
    // The replaced integrator is a note.
    assert_eq!(problems.len(), 9);
    assert_eq!(problems[0]["line"], 3);
    assert_eq!(problems[0]["skippable"], true);
    let run = folder.run("check");
    assert_eq!(run.code, 2, "{run:?}");
    let run = folder.run("check --corpus nowhere");
    assert!(run.code == 3 && run.stderr.contains("nowhere: cannot be read"), "{run:?}");
}

/// An unknown id hides no other problem.
#[test]
fn dangling_references_are_listed_with_all_others() {
    let folder = Folder::with(
        "<scene version='3.0.0'>\n<sensor type='perspective'/>\n<shape type='sphere'><ref id='nobody'/></shape>\n\
         <shape type='teapot'/>\n<shape type='cube'><float name='radios' value='1'/></shape>\n</scene>",
    );
    let run = folder.run("check s.xml");
    let lines = without_excerpts(&run.stdout);
    assert_eq!(run.code, 3, "{run:?}");
    for text in ["<ref id=\"nobody\">: no object has the id \"nobody\": left out", "unknown shape", "radios"]
    {
        assert!(lines.iter().any(|line| line.contains(text)), "{text} in {lines:?}");
    }
    let run = folder.run("info s.xml");
    assert!(run.code == 0 && run.stdout.contains("shapes       1 mesh, 1 sphere"), "{run:?}");
    // A scene of which nothing can be seen does not load.
    folder.write("empty.xml", b"<scene version='3.0.0'/>");
    let run = folder.run("check empty.xml");
    assert!(run.code == 3 && run.stdout.contains("neither a sensor nor a shape to look at"), "{run:?}");
}
