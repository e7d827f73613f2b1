//! Mistakes of the user: the error, the exit code, and an unchanged output file.

use crate::support::cli::Folder;

const SENSOR: &str = "<sensor type='perspective'><film type='hdrfilm'><integer name='width' value='8'/>\
                      <integer name='height' value='8'/></film></sensor>";

/// Returns a scene with a sensor, and the given text from its third line on.
fn scene(text: &str) -> String {
    format!("<scene version='3.0.0'>\n{SENSOR}\n{text}\n</scene>")
}

/// Renders over an older image, which must remain. Returns the exit code and the first line of the error.
fn refused(text: &str, files: &[(&str, &[u8])]) -> (i32, String) {
    let folder = Folder::with(text);
    for (name, bytes) in files {
        folder.write(name, bytes);
    }
    folder.write("out.exr", b"older");
    let before = folder.files();
    let run = folder.run("render s.xml -o out.exr --spp 1 -q --strict");
    assert_eq!(folder.read("out.exr"), b"older", "{text}: the output was touched");
    assert_eq!(folder.files(), before, "{text}: something was left behind");
    let line = run.stderr.lines().find(|line| line.starts_with("buffon: ")).unwrap_or_default();
    (run.code, line.trim_start_matches("buffon: ").to_owned())
}

#[track_caller]
fn expect(text: &str, code: i32, sentence: &str) {
    assert_eq!(refused(text, &[]), (code, sentence.to_owned()), "{text}");
}

#[test]
fn values_and_names() {
    let cases = [
        (
            "<bsdf type='roughconductor'><string name='alpha' value='shiny'/></bsdf>",
            3,
            "s.xml:3:29: <string name=\"alpha\">: expected a number, found a string",
        ),
        (
            "<shape type='sphere'><float name='radius' value='1,5'/></shape>",
            3,
            "s.xml:3:22: <float name=\"radius\">: expected a number, found \"1,5\"",
        ),
        (
            "<bsdf type='roughplastik'/>",
            3,
            "s.xml:3:1: <bsdf type=\"roughplastik\">: unknown bsdf (did you mean \"roughplastic\"?)",
        ),
        (
            "<bsdf type='diffuse'><rgb name='reflectanse' value='1,0,0'/></bsdf>",
            5,
            "s.xml:3:22: <rgb name=\"reflectanse\">: <bsdf type=\"diffuse\"> has no such property (did you mean \
             \"reflectance\"?)",
        ),
        (
            "<bsdf type='roughconductor'><float name='alpha' value='-0.1'/></bsdf>",
            3,
            "s.xml:3:29: <float name=\"alpha\">: expected a number of at least 0, found -0.1",
        ),
        (
            "<bsdf type='diffuse'><rgb name='reflectance' value='1.2'/></bsdf>",
            3,
            "s.xml:3:22: <rgb name=\"reflectance\">: expected values from 0 to 1, found 1.2, 1.2, 1.2",
        ),
        (
            "<emitter type='spot'><float name='cutoff_angle' value='20'/><float name='beam_width' value='30'/></emitter>",
            3,
            "s.xml:3:61: <float name=\"beam_width\">: expected degrees from 0 to the cutoff_angle, 20, found 30",
        ),
        (
            "<bsdf type='principled'><float name='roughness' value='1.5'/></bsdf>",
            3,
            "s.xml:3:25: <float name=\"roughness\">: expected a number from 0 to 1, found 1.5",
        ),
    ];
    for (text, code, sentence) in cases {
        expect(&scene(text), code, sentence);
    }
    expect(
        &scene("").replacen("value='8'", "value='1000000'", 1),
        3,
        "s.xml:2:49: <integer name=\"width\">: expected a whole number from 1 to 65536, found 1000000",
    );
}

#[test]
fn structure() {
    let cases = [
        (
            "<bsdf type='mask' id='a'><ref id='b'/></bsdf><bsdf type='mask' id='b'><ref id='a'/></bsdf>",
            "s.xml:3:46: <bsdf type=\"mask\">: it contains itself: \"b\" contains \"a\" contains \"b\"",
        ),
        (
            "<bsdf type='diffuse' id='wood'/><shape type='sphere'><ref id='woood'/></shape>",
            "s.xml:3:54: <ref id=\"woood\">: no object has the id \"woood\" (did you mean \"wood\"?)",
        ),
        (
            "<shape type='instance'><shape type='cube'/></shape>",
            "s.xml:3:24: <shape type=\"cube\">: expected a shapegroup inside an instance",
        ),
        (
            "<bsdf type='bumpmap'><bsdf type='diffuse'/></bsdf>",
            "s.xml:3:1: <bsdf type=\"bumpmap\">: expected a texture inside it",
        ),
        (
            "<emitter type='constant'/><emitter type='constant'/>",
            "s.xml:3:27: <emitter type=\"constant\">: a scene has room for one environment",
        ),
        (
            "<shape type='shapegroup'><shape type='cube'><emitter type='area'/></shape></shape>",
            "s.xml:3:26: a shape inside a group cannot emit light",
        ),
    ];
    for (text, sentence) in cases {
        expect(&scene(text), 3, sentence);
    }
    let nested = format!(
        "<scene version='3.0.0'>{}{}</scene>",
        "<shape type='cube'>".repeat(3000),
        "</shape>".repeat(3000)
    );
    expect(&nested, 3, "s.xml:1:1905: <shape type=\"cube\">: nested deeper than 100 levels");
    let bomb =
        "<?xml version='1.0'?><!DOCTYPE x [<!ENTITY a 'ha'><!ENTITY b '&a;&a;'>]><scene version='3.0.0'/>";
    expect(bomb, 3, "s.xml:1:22: <!DOCTYPE>: entities are refused");
    expect("width = 5", 3, "s.xml:1:1: malformed XML: unknown token");
    expect(
        "<scene><shape type='cube'/></scene>",
        3,
        "s.xml:1:1: <scene>: the attribute version is missing, e.g. version=\"3.0.0\"",
    );
}

#[test]
fn transforms() {
    let cases = [
        (
            "<shape type='cube'><transform name='to_world'><matrix value='1 0 0 0 0 1 0 0 0 0 0 0 0 0 0 1'/>\
             </transform></shape>",
            "s.xml:3:47: <matrix>: the transformation is singular: it flattens space",
        ),
        (
            "<shape type='cube'><transform name='to_world'><matrix value='1 0 0 0'/></transform></shape>",
            "s.xml:3:47: <matrix>: expected 9 or 16 numbers, found 4",
        ),
        (
            "<shape type='sphere'><transform name='to_world'><scale x='2'/></transform></shape>",
            "s.xml:3:22: <transform name=\"to_world\">: a sphere cannot be scaled differently along different axes",
        ),
        (
            "<shape type='cube'><animation name='to_world'><transform time='1'/><transform time='0'/></animation></shape>",
            "s.xml:3:68: <transform>: expected times that increase",
        ),
    ];
    for (text, sentence) in cases {
        expect(&scene(text), 3, sentence);
    }
}

#[test]
fn files() {
    let mesh = |name: &str| {
        scene(&format!(
            "<shape type='{}'><string name='filename' value='{name}'/></shape>",
            &name[name.len() - 3..]
        ))
    };
    let (code, sentence) = refused(
        &scene(
            "<shape type='ply'><string name='filename' value='a.ply'/></shape>\
             <emitter type='envmap'><string name='filename' value='sky.exr'/></emitter>",
        ),
        &[],
    );
    assert_eq!((code, sentence.contains("there is no file \"sky.exr\"")), (3, true), "{sentence}");
    let nan = b"v 0 0 0\nv 1 0 0\nv nan 1 0\nf 1 2 3\n";
    assert_eq!(
        refused(&mesh("nan.obj"), &[("nan.obj", nan)]),
        (5, "nan.obj: 1 of 3 vertices: not finite; their faces are dropped".to_owned())
    );
    let range = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 4\n";
    assert_eq!(
        refused(&mesh("range.obj"), &[("range.obj", range)]),
        (3, "range.obj:4:1: there is no vertex 4; the file has 3".to_owned())
    );
    let short = b"ply\nformat binary_little_endian 1.0\nelement vertex 1000\nproperty float x\nproperty float y\n\
                  property float z\nelement face 10\nproperty list uchar int vertex_indices\nend_header\n0000000000";
    assert_eq!(
        refused(&mesh("short.ply"), &[("short.ply", short)]),
        (3, "short.ply: malformed PLY file: the file is too short for 1000 of element vertex".to_owned())
    );
    let texture = scene(
        "<bsdf type='diffuse'><texture type='bitmap' name='reflectance'>\
         <string name='filename' value='short.png'/></texture></bsdf>",
    );
    let (code, sentence) = refused(&texture, &[("short.png", b"\x89PNG\r\n\x1a\n\0\0")]);
    assert_eq!((code, sentence.starts_with("short.png: ")), (3, true), "{sentence}");
}

/// An emitter that cannot emit gives a warning, and a choice between several cameras a note.
#[test]
fn warnings_and_notes() {
    let lamp = scene(
        "<shape type='rectangle'><transform name='to_world'><scale x='1e-30' y='1e-30'/></transform>\
         <emitter type='area'/></shape>",
    );
    assert_eq!(refused(&lamp, &[]), (5, "s.xml:3:1: the emitter has no area and emits no light".to_owned()));
    let folder = Folder::with(&scene(SENSOR));
    let run = folder.run("render s.xml -o out.exr --spp 1");
    assert_eq!(run.code, 0);
    assert!(
        run.stderr.contains("the scene has 2 sensors: --sensor chooses, the first is number 0"),
        "{}",
        run.stderr
    );
}

/// What is not rendered as the file asks for is a note, is in the metadata, and is an error under `--strict`.
#[test]
fn approximations_are_noted_recorded_and_refused_under_strict() {
    let folder = Folder::with(&scene("<shape type='rectangle'><bsdf type='polarizer'/></shape>"));
    let note = "polarizer: light is not polarised, so the filter dims it evenly";
    let run = folder.run("render s.xml -o out.exr --spp 1");
    assert!(run.code == 0 && run.stderr.contains(&format!("note: {note}")), "{run:?}");
    let run = folder.run("info out.exr");
    assert!(run.stdout.contains("buffon:approximations") && run.stdout.contains(note), "{run:?}");
    let run = folder.run("render s.xml -o strict.exr --spp 1 --strict");
    assert!(run.code == 5 && run.stderr.contains(note), "{run:?}");
}
