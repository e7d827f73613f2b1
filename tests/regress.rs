//! `buffon regress` from outside: what passes, what is found, what is written, and what it says of mistakes.

use crate::support::cli::{Folder, Run, Running, program};
use buffon::image::{Compression, SampleFormat, WriteOptions};
use buffon::image::{Image, Value, read, write};
use std::process::{Command, Stdio};

/// A scene of 32x24 pixels that sees a floor and a ball of a material, lit by two lights.
fn scene(material: &str, radiance: f64, more: &str) -> String {
    format!(
        r#"<scene version="3.0.0">
  <integrator type="path"><integer name="max_depth" value="6"/></integrator>
  <sensor type="perspective">
    <float name="fov" value="45"/>{more}
    <transform name="to_world"><lookat origin="0,1.2,4" target="0,0.5,0" up="0,1,0"/></transform>
    <sampler type="independent"><integer name="sample_count" value="32"/></sampler>
    <film type="hdrfilm"><integer name="width" value="32"/><integer name="height" value="24"/></film>
  </sensor>
  <shape type="rectangle">
    <transform name="to_world"><scale value="3"/><rotate x="1" angle="-90"/></transform>
    <bsdf type="diffuse"><texture type="checkerboard" name="reflectance">
      <transform name="to_uv"><scale x="6" y="6"/></transform></texture></bsdf>
  </shape>
  <shape type="sphere"><point name="center" value="0.3,0.6,0.4"/><float name="radius" value="0.6"/>{material}</shape>
  <shape type="sphere">
    <point name="center" value="-1.5,2.5,1"/><float name="radius" value="0.3"/>
    <emitter type="area"><rgb name="radiance" value="{}"/></emitter>
  </shape>
  <emitter type="constant"><rgb name="radiance" value="{}"/></emitter>
</scene>
"#,
        20.0 * radiance,
        0.5 * radiance
    )
}

const DIFFUSE: &str = r#"<bsdf type="diffuse"/>"#;
const GLASS: &str = r#"<bsdf type="dielectric"/>"#;

/// Light that is seen and never scattered: no noise but that of the edges.
fn flat() -> String {
    scene(DIFFUSE, 1.0, "").replace("\"max_depth\" value=\"6\"", "\"max_depth\" value=\"1\"")
}

/// A folder of three scenes with their references.
fn folder() -> Folder {
    let folder = Folder::with(&scene(DIFFUSE, 1.0, ""));
    folder.write("glass.xml", scene(GLASS, 1.0, "").as_bytes());
    folder.write("flat.xml", flat().as_bytes());
    let run = folder.run("regress . --update");
    assert_eq!((run.code, run.stderr.as_str()), (0, ""), "{run:?}");
    assert_eq!(words(&run), ["WROTE flat.xml", "WROTE glass.xml", "WROTE s.xml"]);
    folder
}

/// The first two words of each line but the last.
fn words(run: &Run) -> Vec<String> {
    let lines: Vec<&str> = run.stdout.lines().collect();
    let rows = lines.iter().take(lines.len().saturating_sub(1));
    rows.map(|line| line.split_whitespace().take(2).collect::<Vec<_>>().join(" ")).collect()
}

/// The line of a scene.
#[track_caller]
fn line<'a>(run: &'a Run, scene: &str) -> &'a str {
    let found = run.stdout.lines().find(|line| line.split_whitespace().nth(1) == Some(scene));
    found.unwrap_or_else(|| panic!("no line of {scene}: {run:?}"))
}

/// Changes a reference.
fn change(folder: &Folder, name: &str, samples: SampleFormat, change: impl FnOnce(&mut Image)) {
    let path = folder.path(name);
    let mut image = read(&path).expect("a reference");
    change(&mut image);
    let options = WriteOptions { samples, compression: Compression::Zip, ..WriteOptions::default() };
    write(&path, &image, &options).map(drop).expect("a reference can be written");
}

#[test]
#[ignore = "takes long: make test-all"]
fn twenty_seeds_pass_and_halves_do_too() {
    let folder = folder();
    for seed in 1..=20 {
        let run = folder.run(&format!("regress . --spp 32 --seed {seed}"));
        assert_eq!(
            (run.code, words(&run)),
            (0, ["flat.xml", "glass.xml", "s.xml"].map(|s| format!("PASS {s}")).to_vec()),
            "{run:?}"
        );
    }
    for name in ["refs/s.exr", "refs/flat.exr"] {
        change(&folder, name, SampleFormat::Half, |_| {});
    }
    for seed in 1..=5 {
        let run = folder.run(&format!("regress . --spp 512 --seed {seed}"));
        assert_eq!(run.code, 0, "{run:?}");
    }
}

/// A reference that takes too long is announced, and holds what time allows.
#[test]
fn time_bounds_a_reference() {
    let folder = Folder::with(&scene(DIFFUSE, 1.0, ""));
    let run = folder.run("regress . --update --update-spp 1000000 --time 0.3s");
    assert_eq!(run.code, 0, "{run:?}");
    let forecast = "buffon: note: s.xml: the reference takes about ";
    assert!(run.stderr.starts_with(forecast), "{run:?}");
    assert!(
        run.stderr.trim_end().ends_with(" for 1000000 samples per pixel; --time allows 0.3 s"),
        "{run:?}"
    );
    let reference = read(&folder.path("refs/s.exr")).expect("a reference");
    let Some(Value::Int(samples)) = reference.metadata.get("samplesPerPixel") else { panic!("no samples") };
    assert!((2..1_000_000).contains(samples), "{samples}");
    let bounded = format!("; --time allowed {samples} of 1000000 samples per pixel");
    assert!(line(&run, "s.xml").ends_with(&bounded), "{run:?}");
    assert_eq!(folder.run("regress . --seed 1").code, 0);
    let refused = folder.run("regress . --time 1s");
    assert_eq!(refused.code, 2, "{refused:?}");
}

#[test]
fn the_four_faults_are_found() {
    let folder = folder();
    for (name, material) in [("s.xml", DIFFUSE), ("glass.xml", GLASS)] {
        let right = scene(material, 1.0, "");
        let says = |text: &str| {
            folder.write(name, text.as_bytes());
            let run = folder.run(&format!("regress . --filter {name} --seed 3"));
            let line = line(&run, name).to_owned();
            assert_eq!((run.code, line.starts_with("FAIL")), (1, true), "{run:?}");
            line
        };
        let brighter = says(&scene(material, 1.005, ""));
        // Of the glass it is seen in the sky, which has no noise.
        let bias = brighter.contains(" of R is +0.");
        assert!(
            bias || (material == GLASS && brighter.contains(" blocks without variance differ ")),
            "{brighter}"
        );
        let shift = format!("<float name='principal_point_offset_x' value='{}'/>", 1.0 / 32.0);
        let shifted = says(&scene(material, 1.0, &shift));
        assert!(shifted.contains(" blocks rejected (p "), "{shifted}");
        let dark = says(
            &right
                .replace("<emitter type=\"area\">", "<emitter type=\"area\" id=\"off\">")
                .replace("value=\"20\"", "value=\"0\""),
        );
        assert!(dark.contains(" blocks rejected (p ") && dark.contains(" is -"), "{dark}");
        let reference = format!("refs/{}.exr", name.trim_end_matches(".xml"));
        change(&folder, &reference, SampleFormat::Float, |image| image.pixel_mut(5, 7)[1] = f32::NAN);
        let nan = says(&right);
        let expected =
            "the reference holds 1 NaN and 0 infinite values, the first at pixel (5, 7), channel G";
        assert!(nan.ends_with(expected), "{nan}");
    }
}

#[test]
fn references_are_missing_written_and_replaced() {
    let folder = Folder::with(&scene(DIFFUSE, 1.0, ""));
    let run = folder.run("regress . --spp 16");
    assert_eq!(run.code, 1);
    assert!(
        line(&run, "s.xml").starts_with("NEW ") && run.stdout.contains("no ./refs/s.exr; --update writes it"),
        "{run:?}"
    );
    assert!(run.stdout.contains("1 scene: 1 without a reference in "), "{run:?}");
    assert_eq!(folder.run("regress . --spp 16 --update=missing --update-spp 256").code, 0);
    let older = folder.read("refs/s.exr");
    // A scene that fails keeps its reference unless it is asked for, and one that passes always.
    folder.write("s.xml", scene(DIFFUSE, 1.2, "").as_bytes());
    for (update, code, word) in [("=missing", 1, "FAIL"), ("=failed", 0, "WROTE"), ("", 0, "PASS")] {
        let before = folder.read("refs/s.exr");
        let run = folder.run(&format!("regress . --spp 16 --update{update} --update-spp 256"));
        assert_eq!((run.code, words(&run)), (code, vec![format!("{word} s.xml")]), "{run:?}");
        assert_eq!(folder.read("refs/s.exr") == before, word != "WROTE", "{update}");
        assert!(word != "WROTE" || run.stdout.contains("; it was: "), "{run:?}");
    }
    assert_ne!(folder.read("refs/s.exr"), older);
    // What cannot be read is replaced only if all are.
    folder.write("refs/s.exr", b"none");
    let run = folder.run("regress . --spp 16 --update");
    assert_eq!((run.code, words(&run)), (1, vec!["ERROR s.xml".to_owned()]), "{run:?}");
    assert_eq!(folder.read("refs/s.exr"), b"none");
    assert_eq!(folder.run("regress . --spp 16 --update=all --update-spp 64").code, 0);
    assert_eq!(folder.run("regress . --spp 16").code, 0);
    assert_eq!(folder.files(), ["refs", "s.xml"]);
}

#[test]
fn variances_may_be_in_a_file_of_their_own_or_missing() {
    let folder = folder();
    let image = read(&folder.path("refs/s.exr")).unwrap();
    let mut variance = image.select(&["variance.R", "variance.G", "variance.B"]).unwrap();
    variance.channels = ["R", "G", "B"].map(String::from).to_vec();
    change(&folder, "refs/s.exr", SampleFormat::Float, |image| {
        *image = image.select(&["R", "G", "B"]).unwrap()
    });
    let run = folder.run("regress . --filter s.xml --spp 64 --fail 0.5");
    assert_eq!(run.code, 0, "{run:?}");
    assert!(line(&run, "s.xml").ends_with(" of 5e-1 (the reference has no variance)"), "{run:?}");
    assert_eq!(folder.run("regress . --filter s.xml --spp 64 --fail 1e-9").code, 1);
    write(&folder.path("refs/s_var.exr"), &variance, &WriteOptions::default()).unwrap();
    let run = folder.run("regress . --filter s.xml --spp 64");
    let passed = line(&run, "s.xml");
    assert!(
        run.code == 0 && passed.contains("; detects a gain of ") && passed.contains(" FLIP 0."),
        "{run:?}"
    );
    folder.write("s.xml", scene(DIFFUSE, 1.1, "").as_bytes());
    assert_eq!(folder.run("regress . --filter s.xml --spp 64").code, 1);
}

#[test]
fn what_is_wrong_with_one_scene_ends_nothing_and_is_reported() {
    let folder = folder();
    folder.write("broken.xml", b"<scene version='3.0.0'>\n<bsdf type='none'/>\n</scene>");
    folder.write("glass.xml", scene(GLASS, 1.1, "").as_bytes());
    folder.write(
        "s.xml",
        scene(DIFFUSE, 1.0, "").replace("\"width\" value=\"32\"", "\"width\" value=\"30\"").as_bytes(),
    );
    folder.write("camera.xml", b"<scene version='3.0.0'/>");
    let run = folder.run("regress . --spp 32 --junit out/junit.xml -o out");
    assert_eq!(run.code, 4, "there is no folder out yet: {run:?}");
    let run = folder.run("regress . --spp 32 --junit junit.xml -o out");
    let expected = ["skip camera.xml:", "skip broken.xml:", "PASS flat.xml", "FAIL glass.xml", "FAIL s.xml"];
    let found = words(&run);
    assert_eq!(run.code, 1);
    assert_eq!(
        found.iter().map(String::as_str).filter(|w| !w.starts_with("skip")).collect::<Vec<_>>(),
        &expected[2..],
        "{run:?}"
    );
    assert!(line(&run, "s.xml").ends_with("the render has 30x24 pixels, its reference 32x24"), "{run:?}");
    let junit = String::from_utf8(folder.read("junit.xml")).unwrap();
    let document = roxmltree::Document::parse(&junit).expect("well-formed");
    assert_eq!(document.descendants().filter(|n| n.has_tag_name("failure")).count(), 2);
    for name in ["glass-render.exr", "glass-reference.exr", "glass-heat.png", "s-render.exr", "index.html"] {
        assert!(folder.path("out").join(name).exists(), "{name}");
    }
    let page = String::from_utf8(folder.read("out/index.html")).unwrap();
    assert!(
        page.contains("<figcaption>glass.xml</figcaption>") && page.contains("3 scenes: 1 passed, 2 failed")
    );
}

#[test]
fn mistakes_are_said_in_sentences() {
    let folder = Folder::with(&scene(DIFFUSE, 1.0, ""));
    std::fs::create_dir(folder.path("empty")).unwrap();
    let cases = [
        ("nothing", 3, "buffon: nothing: no such folder\n"),
        ("s.xml", 3, "buffon: s.xml: expected a folder of scenes, found a file\n"),
        ("empty", 3, "buffon: empty: expected scenes (.xml, .gltf, .glb) in it, found none\n"),
        (". --filter other", 3, "buffon: .: none of its 1 scene has a name with \"other\"\n"),
        (
            ". --junit none/j.xml",
            4,
            "buffon: none/j.xml: cannot be written: the folder \"none\" does not exist\n",
        ),
    ];
    for (arguments, code, sentence) in cases {
        let run = folder.run(&format!("regress {arguments}"));
        assert_eq!((run.code, run.stderr.as_str(), run.stdout.as_str()), (code, sentence, ""), "{arguments}");
    }
    for arguments in [
        "--spp 1",
        "--significance 1",
        "--gain 0",
        "--update=some",
        "--update --cross-accel",
        "--update-spp 8",
    ] {
        assert_eq!(folder.run(&format!("regress . {arguments}")).code, 2, "{arguments}");
    }
    folder.write("broken.xml", b"<scene version='3.0.0'>\n<sensor/>\n</scene>");
    std::fs::create_dir(folder.path("refs")).unwrap();
    folder.write("refs/s.exr", b"none");
    let run = folder.run("regress . --spp 4");
    assert!(run.code == 1 && run.stdout.contains("2 scenes: 2 with an error in "), "{run:?}");
    let broken = line(&run, "broken.xml");
    assert!(broken.starts_with("ERROR") && broken.contains("broken.xml:2:1: <sensor>"), "{broken}");
    let unreadable = "./refs/s.exr: expected an image (OpenEXR, PNG, JPEG, BMP, TGA, Radiance HDR, PFM or a NumPy array), found something else";
    assert!(line(&run, "s.xml").ends_with(unreadable), "{run:?}");
    folder.write("s.gltf", b"{}");
    let run = folder.run("regress . --filter s. --spp 4");
    let clash =
        "s.xml has the same reference, ./refs/s.exr: expected names that differ in more than the extension";
    assert!(line(&run, "s.gltf").ends_with(clash), "{run:?}");
}

#[test]
fn the_default_traversal_and_embree_are_compared_with_obvhs() {
    let folder = Folder::new();
    let run = folder.run("regress . --cross-accel --spp 16");
    assert_eq!((run.code, words(&run)), (0, vec!["PASS s.xml".to_owned()]), "{run:?}");
    let shown = line(&run, "s.xml");
    assert!(shown.contains("list: relMSE "), "{run:?}");
    assert_eq!(shown.contains("embree: relMSE "), cfg!(feature = "embree"), "{run:?}");
    assert_eq!(folder.files(), ["s.xml"]);
}

#[cfg(unix)]
#[test]
fn an_interrupted_run_sums_up_what_was_done() {
    use std::io::{BufRead, Read};
    let folder = folder();
    folder.write(
        "t.xml",
        scene(DIFFUSE, 1.0, "").replace("\"width\" value=\"32\"", "\"width\" value=\"2000\"").as_bytes(),
    );
    std::fs::copy(folder.path("refs/s.exr"), folder.path("refs/t.exr")).unwrap();
    folder.write("u.xml", scene(DIFFUSE, 1.0, "").as_bytes());
    let mut command = Command::new(program());
    command
        .args([
            "regress",
            ".",
            "--update",
            "--update-spp",
            "1000000000",
            "--junit",
            "junit.xml",
            "--spp",
            "32",
        ])
        .current_dir(folder.path(""))
        .stdout(Stdio::piped());
    let mut child = Running::start(&mut command);
    let mut out = child.stdout();
    let mut line = String::new();
    while !line.contains(" s.xml ") {
        line.clear();
        assert!(out.read_line(&mut line).expect("a line") > 0, "the program ended");
    }
    child.signal(libc::SIGINT);
    let status = child.wait();
    let mut rest = String::new();
    out.read_to_string(&mut rest).expect("text");
    assert_eq!(status.code(), Some(130), "{rest}");
    assert!(rest.contains("5 scenes: 3 passed, 2 not run in "), "{rest}");
    let junit = String::from_utf8(folder.read("junit.xml")).unwrap();
    assert_eq!(junit.matches("<skipped").count(), 2, "{junit}");
    assert_eq!(folder.read("refs/t.exr"), folder.read("refs/s.exr"));
}
