//! The program from outside: exit codes, sentences, outputs, signals.

use crate::support::cli::{Folder, Run, Running, SCENE, program};
use buffon::image::{Image, Value, read};
use serde_json::Value as Json;
use std::io::{BufRead, Read};
use std::process::{Command, Stdio};

/// Exit code and whole sentence of a run that must fail, print nothing and leave nothing behind.
fn refusal(folder: &Folder, arguments: &str) -> (i32, String) {
    let before = folder.files();
    let Run { code, stdout, stderr } = folder.run(arguments);
    assert_eq!(stdout, "", "{arguments}");
    assert_eq!(folder.files(), before, "{arguments} leaves nothing behind");
    (code, stderr.trim_end().to_string())
}

#[test]
fn refusals_have_an_exit_code_and_a_sentence() {
    let folder = Folder::new();
    for (arguments, code, sentence) in [
        ("render none.xml", 3, "buffon: none.xml: cannot be read: no such file or directory"),
        (
            "render s.xml --integrator pth",
            2,
            "buffon: --integrator: there is no integrator \"pth\" (did you mean \"path\"?); there are auto, path, \
             volpath, direct, ptracer, photonmapper, sppm, whitted, distribution, irrcache, ao, depth, aov, bdpt, \
             vcm and pssmlt",
        ),
        (
            "render s.xml --aov nope",
            2,
            "buffon: --aov: there is no layer \"nope\"; there are albedo, N, geo_normal, P, Z, uv, prim_index, \
             shape_index, material_index, variance, standard_error, block_variance, samples, record_radius",
        ),
        (
            "render s.xml --integrator aov",
            2,
            "buffon: --integrator aov: expected layers in --aov: albedo, N, geo_normal, P, Z, uv, prim_index, \
             shape_index, material_index, variance, standard_error, block_variance, samples, record_radius",
        ),
        ("render s.xml --aov Z,Z", 2, "buffon: --aov: found the layer \"Z\" twice"),
        (
            "render s.xml --aov Z -o s.png",
            2,
            "buffon: --aov: layers need an .exr or .npy, which s.png is not",
        ),
        (
            "render s.xml --crop 30,0,20,5",
            2,
            "buffon: --crop 30,0,20,5: expected a part of the image, which has 40x30 pixels",
        ),
        (
            "render s.xml --crop 4294967295,0,2,5",
            2,
            "buffon: --crop 4294967295,0,2,5: expected a part of the image, which has 40x30 pixels",
        ),
        ("render s.xml --sensor 3", 2, "buffon: --sensor 3: the scene has 1 sensor, counted from 0"),
        (
            "render s.xml --display-server a",
            2,
            "buffon: --display-server a: expected HOST:PORT, such as localhost:14158",
        ),
        (
            "render s.xml -o no/x.exr",
            4,
            "buffon: no/x.exr: cannot be written: the folder \"no\" does not exist",
        ),
        (
            "render s.xml -o .",
            2,
            "buffon: .: expected the extension .exr, .png, .jpg, .jpeg, .pfm or .npy, found none",
        ),
        (
            "render s.xml -o x.tga",
            2,
            "buffon: x.tga: expected the extension .exr, .png, .jpg, .jpeg, .pfm or .npy, found .tga",
        ),
        (
            "render s.xml --stats no/s.json",
            4,
            "buffon: no/s.json: cannot be written: the folder \"no\" does not exist",
        ),
        ("render s.xml -D foo=1 --strict", 5, "buffon: -D foo=1: the scene never uses $foo"),
        ("diff s.exr s.exr", 4, "buffon: s.exr: no such file"),
        ("man bogus", 2, "buffon: expected a subcommand of buffon, found \"bogus\""),
    ] {
        assert_eq!(refusal(&folder, arguments), (code, sentence.to_string()), "{arguments}");
    }
}

/// `independent` in a scene means the default sampler, with a note; other samplers are used as they are.
#[test]
fn independent_sampling_in_a_scene_is_replaced_unless_the_scene_is_to_be_obeyed() {
    let folder = Folder::new();
    folder.write("i.xml", SCENE.replace("\"sobol\"", "\"independent\"").as_bytes());
    folder.write("h.xml", SCENE.replace("\"sobol\"", "\"halton\"").as_bytes());
    for (arguments, sampler, noted) in [
        ("i.xml", "sobol", true),
        ("i.xml --sampler auto", "sobol", true),
        ("i.xml --sampler auto -q", "sobol", false),
        ("i.xml --sampler scene", "independent", false),
        ("i.xml --sampler independent", "independent", false),
        ("h.xml --sampler auto", "halton", false),
    ] {
        let run = folder.run(&format!("render {arguments} --spp 4 -o o.exr --stats s.json"));
        let note = "buffon: note: the sampler sobol replaces the scene's; --sampler scene keeps it\n";
        assert_eq!((run.code, run.stderr.contains(note)), (0, noted), "{arguments}: {}", run.stderr);
        let stats = std::fs::read(folder.path("s.json")).expect("statistics");
        let stats: Json = serde_json::from_slice(&stats).expect("JSON");
        assert_eq!(stats["sampler"], sampler, "{arguments}");
    }
}

/// A scene without a subcommand is rendered, and several outputs are written from one render.
#[test]
fn a_scene_alone_is_rendered_and_several_outputs_are_written() {
    let folder = Folder::new();
    let run = folder.run("s.xml --spp 2 -o a.exr -o b.png --outfile c.pfm");
    assert_eq!(run.code, 0, "{run:?}");
    assert!(run.stderr.contains("a.exr, b.png, c.pfm: 40x30, 2 samples per pixel"), "{run:?}");
    let [exr, png, pfm] = ["a.exr", "b.png", "c.pfm"].map(|name| read(&folder.path(name)).expect("an image"));
    assert_eq!(exr.data, pfm.data);
    assert_eq!((png.width, png.height), (40, 30));
    let same = folder.run("render s.xml --spp 2 -o a.exr -o b.png -o a.exr");
    assert_eq!((same.code, same.stderr.as_str()), (2, "buffon: -o a.exr: this file is named twice\n"));
    for (arguments, text) in [
        ("-o a.exr -o ./a.exr", "-o ./a.exr: this file is named twice"),
        ("--stats s.xml", "--stats s.xml: it is the scene"),
        ("-o a.exr --stats a.exr", "--stats a.exr: it is also the file of -o"),
        ("-o a.exr --checkpoint ./a.exr", "--checkpoint ./a.exr: it is also the file of -o"),
    ] {
        let run = folder.run(&format!("render s.xml --spp 1 {arguments}"));
        assert!(run.code == 2 && run.stderr.contains(text), "{arguments}: {run:?}");
    }
    let other = folder.run("s.xlm");
    assert!(
        other.code == 3 && other.stderr.contains("expected a scene (.xml, .gltf, .glb) or a mesh"),
        "{other:?}"
    );
    let negative = folder.run("s.xml --spp -4");
    assert!(
        negative.code == 2 && negative.stderr.contains("invalid value '-4' for '--spp <N>'"),
        "{negative:?}"
    );
    let missing = folder.run("missing.xml");
    assert_eq!(
        (missing.code, missing.stderr.contains("missing.xml: cannot be read")),
        (3, true),
        "{missing:?}"
    );
}

#[test]
fn an_image_goes_to_standard_output() {
    let folder = Folder::new();
    let command = |options: &str| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_buffon"));
        command.current_dir(folder.path("")).args(["render", "s.xml", "--spp", "2"]).args(options.split(' '));
        command.output().expect("a process")
    };
    let (piped, filed) = (command("-o - --stats s.json -q"), command("-o a.exr -q"));
    assert!(piped.status.success() && filed.status.success() && piped.stderr.is_empty());
    let (piped, filed) = (piped.stdout, std::fs::read(folder.path("a.exr")).expect("a file"));
    assert_eq!((&piped[..4], piped.len()), (&b"\x76\x2f\x31\x01"[..], filed.len()));
    let told = command("-o -").stderr;
    assert!(String::from_utf8_lossy(&told).contains("standard output"), "{told:?}");
    let twice = command("-o - -o -");
    assert!(String::from_utf8_lossy(&twice.stderr).contains("-o -: standard output is named twice"));
    let refused = command("-o - --stats -");
    assert_eq!(refused.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&refused.stderr).contains("only one of them can be standard output"));
}

/// Exposure and tone curve change 8-bit images, in `render` as in `convert`. A layer becomes the picture.
#[test]
fn images_are_converted_with_exposure_tone_curve_and_layer() {
    let folder = Folder::new();
    let done = |arguments: &str| {
        let run = folder.run(arguments);
        assert_eq!((run.code, run.stderr.as_str()), (0, ""), "{arguments}");
    };
    done("s.xml -q --spp 2 --exposure -1 --tonemap agx -o a.png -o a.pfm");
    done("convert a.pfm b.png --exposure -1 --tonemap agx");
    done("convert a.pfm plain.png");
    done("convert a.pfm half.png --exposure -1");
    let pixels = |name: &str| read(&folder.path(name)).expect("an image").data;
    assert_eq!(pixels("a.png"), pixels("b.png"));
    assert!(pixels("plain.png") != pixels("half.png") && pixels("half.png") != pixels("b.png"));
    done("render s.xml -q --spp 2 --aov albedo,N,samples -o l.exr");
    done("convert l.exr n.pfm --layer N");
    done("convert l.exr samples.pfm --layer samples");
    done("convert l.exr all.exr");
    let (all, normals) = (read(&folder.path("all.exr")), read(&folder.path("n.pfm")));
    let (all, normals) = (all.expect("an image"), normals.expect("an image"));
    assert_eq!(all.layer("N").expect("the layer").data, normals.data);
    assert!(pixels("samples.pfm").iter().all(|n| *n == 2.0));
    for (arguments, sentence) in [
        ("convert l.exr x.png --layer z", "l.exr: --layer z: there are N, albedo, samples"),
        (
            "convert l.exr x.pfm --exposure 1",
            "--exposure: only .png and .jpg images have it, and no output is one",
        ),
        ("render s.xml --tonemap agx", "--tonemap: only .png and .jpg images have it, and no output is one"),
        (
            "convert l.exr x.tga",
            "x.tga: expected the extension .exr, .png, .jpg, .jpeg, .pfm or .npy, found .tga",
        ),
    ] {
        assert_eq!(refusal(&folder, arguments), (2, format!("buffon: {sentence}")), "{arguments}");
    }
}

#[test]
fn options_that_cannot_be_read_are_usage_errors() {
    let folder = Folder::new();
    let accels = if cfg!(feature = "embree") { "`auto` or `embree` or `obvhs`" } else { "`auto` or `obvhs`" };
    let accel_sentence = format!("invalid value 'bvh' for '--accel <NAME>': expected {accels}, found `bvh`");
    for (arguments, sentence) in [
        ("render s.xml --bogus", "unexpected argument '--bogus' found"),
        ("render", "the following required arguments were not provided:\n  <SCENE>"),
        ("bogus", "unrecognized subcommand 'bogus'"),
        (
            "render s.xml --sampler halten",
            "invalid value 'halten' for '--sampler <NAME>': unknown sampler \"halten\" (did you mean \"halton\"?); \
             there are auto, scene, independent, stratified, multijitter, halton, sobol, zsobol or fixed",
        ),
        ("render s.xml --accel bvh", &accel_sentence),
        ("render s.xml -D foo", "invalid value 'foo' for '-D <NAME=VALUE>': expected name=value"),
        ("render s.xml --spp 0", "invalid value '0' for '--spp <N>': expected a whole number of at least 1"),
        (
            "render s.xml --size 0x4",
            "invalid value '0x4' for '--size <WxH>': expected WIDTHxHEIGHT in pixels, each from 1 to 65535",
        ),
        (
            "render s.xml --time 0",
            "invalid value '0' for '--time <TIME>': expected a positive time such as 90s, 1.5m or 2h",
        ),
        ("render s.xml --target-error -1", "unexpected argument '-1' found"),
        (
            "render s.xml --crop 1,2,3",
            "invalid value '1,2,3' for '--crop <X,Y,W,H>': expected X,Y,WIDTH,HEIGHT in pixels from the top left corner",
        ),
    ] {
        let (code, stderr) = refusal(&folder, arguments);
        let first = stderr.split("\n\n").next().unwrap_or_default();
        assert_eq!((code, first), (2, format!("error: {sentence}").as_str()), "{arguments}");
    }
}

#[test]
fn a_warning_is_said_and_strict_keeps_the_older_output() {
    let folder = Folder::new();
    folder.write("s.exr", b"older");
    let run = folder.run("render s.xml -D foo=1 --strict");
    assert_eq!((run.code, run.stdout.as_str()), (5, ""));
    assert_eq!(folder.read("s.exr"), b"older");
    let run = folder.render("s.xml -D foo=1");
    let first = run.stderr.lines().next();
    assert_eq!(first, Some("buffon: warning: -D foo=1: the scene never uses $foo"));
    assert_eq!(read(&folder.path("s.exr")).expect("the new image").width, 40);
    assert_eq!(folder.render("s.xml -D foo=1 -q").stderr, "");
    assert_eq!(folder.files(), ["s.exr", "s.xml"]);
}

#[cfg(unix)]
#[test]
fn a_failed_write_keeps_the_older_output() {
    let folder = Folder::new();
    folder.write("old.exr", b"older");
    // A limit on the size of files is reached in the middle of writing.
    let line = format!("ulimit -f 1; trap '' XFSZ; exec {} render s.xml -q -o old.exr", program());
    let scene = SCENE.replace("value=\"40\"", "value=\"200\"");
    folder.write("s.xml", scene.as_bytes());
    let output = Command::new("sh").args(["-c", &line]).current_dir(folder.path("")).output().expect("sh");
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(4), "{stderr}");
    assert!(stderr.starts_with("buffon: old.exr: cannot be written: "), "{stderr}");
    assert_eq!(folder.read("old.exr"), b"older");
    assert_eq!(folder.files(), ["old.exr", "s.xml"]);
}

/// A scene with a point light so strong and so near the floor that its light overflows there.
fn overflowing() -> String {
    let (position, intensity) = ("value=\"2,2,2\"", "value=\"2,3,4\"");
    assert!(SCENE.contains(position) && SCENE.contains(intensity));
    SCENE.replace(position, "value=\"0,0.01,1.5\"").replace(intensity, "value=\"1e37\"")
}

#[test]
fn invalid_samples_are_dropped_counted_located_and_can_be_seen_again() {
    let folder = Folder::with(&overflowing());
    let run = folder.render("s.xml --stats s.json --aov variance");
    let stats: Json = serde_json::from_slice(&folder.read("s.json")).expect("JSON");
    let dropped = stats["invalid_samples"].as_u64().expect("a count");
    assert!(dropped > 20, "{dropped}");
    let warning = run.stderr.lines().last().expect("a warning");
    let start = format!("buffon: warning: {dropped} invalid samples dropped; the first is sample ");
    assert!(warning.starts_with(&start), "{warning}");
    let image = read(&folder.path("s.exr")).expect("the image");
    assert!(image.data.iter().all(|v| v.is_finite()));
    let strict = folder.run("render s.xml --strict -q --aov variance");
    assert_eq!((strict.code, strict.stderr.lines().count()), (5, 2), "{strict:?}");
    let last = strict.stderr.lines().last().expect("a line");
    assert_eq!(last, "--strict: s.exr is written, and holds what there is");
    assert!(strict.stderr.starts_with(&start.replace("warning: ", "")), "{}", strict.stderr);
    // The sentence's own recipe finds the same sample again.
    let (_, recipe) = warning.split_once("To see it again: ").expect("a recipe");
    let (_, place) = warning.split_once("the first is ").expect("a place");
    let (place, _) = place.split_once(". To").expect("a value");
    let again = folder.render(&format!("s.xml {recipe}"));
    assert!(again.stderr.contains(place), "{place}: {}", again.stderr);
}

#[test]
fn the_account_has_every_key() {
    let folder = Folder::new();
    let run =
        folder.run("render s.xml -q --stats - --seed 9 -t 1 --spp 4 --sampler stratified --accel obvhs");
    assert_eq!((run.code, run.stderr.as_str()), (0, ""));
    let stats: Json = serde_json::from_str(&run.stdout).expect("standard output is the account alone");
    let positive = [
        "/seconds/load",
        "/seconds/build",
        "/seconds/render",
        "/seconds/write",
        "/seconds/total",
        "/cpu_seconds",
        "/rays/closest",
        "/rays/occlusion",
        "/peak_memory_bytes",
        "/accel_memory_bytes",
        "/relmse_estimate",
    ];
    for key in positive {
        assert!(stats.pointer(key).and_then(Json::as_f64).is_some_and(|v| v > 0.0), "{key} in {stats}");
    }
    for (key, value) in [
        ("/integrator", Json::from("path")),
        ("/sampler", "stratified".into()),
        ("/accel", "obvhs".into()),
        ("/seed", 9.into()),
        ("/threads", 1.into()),
        ("/width", 40.into()),
        ("/height", 30.into()),
        ("/spp", 4.into()),
        ("/paths", (4 * 40 * 30).into()),
        ("/stop_reason", "samples".into()),
        ("/invalid_samples", 0.into()),
        ("/triangles", 16.into()),
        ("/scene", "s.xml".into()),
        ("/needs/environment", true.into()),
    ] {
        assert_eq!(stats.pointer(key), Some(&value), "{key}");
    }
    assert!(stats["version"].as_str().is_some_and(|v| v.starts_with("0.1.0 (")), "{stats}");
    // The parts of the time make up the whole.
    let seconds = |key: &str| stats["seconds"][key].as_f64().unwrap_or(0.0);
    let parts: f64 = ["load", "build", "prepare", "render", "layers", "write"].into_iter().map(seconds).sum();
    assert!(parts <= seconds("total") && seconds("total") < parts + 1.0, "{stats}");
}

#[test]
fn stop_rules_say_which_one_fired() {
    let folder = Folder::new();
    for (arguments, reason, sentence) in [
        ("--spp 4 --time 1h", "samples", "all samples taken"),
        ("--time 0.1", "time", "time is up"),
        ("--target-error 0.5 --spp 4000", "error", "error reached"),
    ] {
        let run = folder.render(&format!("s.xml {arguments} --progress none"));
        assert!(run.stderr.trim_end().ends_with(sentence), "{arguments}: {}", run.stderr);
        let image = read(&folder.path("s.exr")).expect("the image");
        assert_eq!(image.metadata.get("buffon:stop"), Some(&Value::Text(reason.into())), "{arguments}");
    }
}

#[test]
fn images_carry_metadata_and_layers() {
    let folder = Folder::new();
    let names = "albedo,N,geo_normal,P,Z,uv,prim_index,shape_index,variance,samples";
    folder.render(&format!("s.xml -q --seed 18446744073709551615 --aov {names}"));
    let image = read(&folder.path("s.exr")).expect("the image");
    let text = |name: &str| image.metadata.get(name).map(ToString::to_string);
    assert_eq!(text("Software").as_deref(), Some("Buffon 0.1.0"));
    assert_eq!(image.metadata.get("samplesPerPixel"), Some(&Value::Int(8)));
    assert_eq!(text("buffon:seed").as_deref(), Some("18446744073709551615"));
    assert_eq!(text("buffon:integrator").as_deref(), Some("path"));
    assert_eq!(text("buffon:stop").as_deref(), Some("samples"));
    for name in ["renderTimeSeconds", "buffon:relmse"] {
        let value = image.metadata.get(name);
        assert!(matches!(value, Some(Value::Float(v)) if *v > 0.0), "{name}: {value:?}");
    }
    for name in ["worldToCamera", "worldToNDC"] {
        assert!(matches!(image.metadata.get(name), Some(Value::Matrix(_))), "{name}");
    }
    let layers = [
        ("", "R,G,B"),
        ("albedo.", "R,G,B"),
        ("N.", "X,Y,Z"),
        ("geo_normal.", "X,Y,Z"),
        ("P.", "X,Y,Z"),
        ("Z.", "T"),
        ("uv.", "U,V"),
        ("prim_index.", "I"),
        ("shape_index.", "I"),
        ("variance.", "R,G,B"),
        ("samples.", "N"),
    ];
    for (layer, channels) in layers {
        for channel in channels.split(',') {
            assert!(image.channel(&format!("{layer}{channel}")).is_some(), "{layer}{channel}");
        }
    }
    assert_eq!(image.channels.len(), 24);
    layers_hold_what_they_say(&image);
}

/// The pixel in the middle of the lowest row sees the floor, y = 0, from (0, 1, 4).
fn layers_hold_what_they_say(image: &Image) {
    let pixel = image.pixel(20, 29);
    let value = |name: &str| pixel[image.channel(name).expect("the layer is there")];
    assert_eq!((value("samples.N"), value("shape_index.I")), (8.0, 0.0));
    assert_eq!((value("N.X"), value("N.Y"), value("geo_normal.Y")), (0.0, 1.0, 1.0));
    assert!((value("albedo.R") - 0.5).abs() < 1e-6 && (value("albedo.B") - 0.3).abs() < 1e-6);
    assert!(value("P.Y").abs() < 1e-5 && value("variance.R") > 0.0);
    let distance =
        ((value("P.Y") - 1.0).powi(2) + (value("P.Z") - 4.0).powi(2) + value("P.X").powi(2)).sqrt();
    // Depth counts from the near clipping plane, at 0.01 along the axis.
    assert!((value("Z.T") + 0.01 - distance).abs() < 0.01, "{} {distance}", value("Z.T"));
    // The rectangle's uv runs over its 6 units; y of the rectangle is −z of the world.
    assert!((value("uv.U") - (value("P.X") + 3.0) / 6.0).abs() < 1e-4);
    assert!((value("uv.V") - (3.0 - value("P.Z")) / 6.0).abs() < 1e-4);
}

#[test]
fn formats_follow_the_extension() {
    let folder = Folder::new();
    for name in ["a.png", "a.jpg", "a.pfm", "a.exr"] {
        folder.render(&format!("s.xml -q -o {name}"));
        let image = read(&folder.path(name)).expect("the image");
        assert_eq!((image.width, image.height, image.channels.len()), (40, 30, 3), "{name}");
        assert!(image.data.iter().any(|v| *v > 0.1), "{name}");
    }
    assert!(folder.read("a.png").starts_with(b"\x89PNG"));
    assert!(folder.read("a.jpg").starts_with(b"\xff\xd8"));
    assert_eq!(folder.run("diff a.exr a.pfm").code, 0);
    folder.render("s.xml -q --size 17x9 --integrator depth");
    let image = read(&folder.path("s.exr")).expect("the image");
    assert_eq!((image.width, image.height), (17, 9));
}

#[test]
fn diff_answers_by_exit_code() {
    let folder = Folder::new();
    folder.render("s.xml -q -o a.exr --spp 64 --aov variance");
    folder.render("s.xml -q -o b.exr --spp 64 --aov variance --seed 1");
    folder.render("s.xml -q -o small.exr --size 20x15");
    for (arguments, code) in [
        ("a.exr a.exr", 0),
        ("a.exr b.exr", 1),
        ("a.exr b.exr --fail 0.5", 0),
        ("a.exr b.exr --fail 1e-9 -o heat.png", 1),
        ("a.exr a.exr --z", 0),
        ("a.exr small.exr", 3),
        ("a.exr none.exr", 4),
        ("a.exr s.xml", 4),
        ("a.exr b.exr --metric nope", 2),
        ("a.exr", 2),
    ] {
        let run = folder.run(&format!("diff {arguments}"));
        assert_eq!(run.code, code, "{arguments}: {run:?}");
        assert_eq!(run.stdout.is_empty(), matches!(code, 2 | 4), "{arguments}: {run:?}");
    }
    let same = folder.run("diff a.exr b.exr --json --fail 0.5");
    let json: Json = serde_json::from_str(&same.stdout).expect("JSON");
    assert_eq!(json["result"], "same");
    assert!(folder.files().contains(&"heat.png".to_string()));
}

/// A message that cannot be written does not stop the work.
#[test]
fn a_full_standard_error_loses_messages_only() {
    let folder = Folder::new();
    for arguments in ["render s.xml -o a.exr --spp 1 --progress json", "render none.xml"] {
        let full = std::fs::File::options().write(true).open("/dev/full").expect("Linux has it");
        let status = Command::new(program())
            .args(arguments.split(' '))
            .current_dir(folder.path(""))
            .stderr(full)
            .status()
            .expect("it runs");
        assert_eq!(status.code(), Some(if arguments.contains("none") { 3 } else { 0 }), "{arguments}");
    }
    assert!(folder.files().contains(&"a.exr".to_string()));
}

#[test]
fn info_tells_about_scenes_and_images() {
    let folder = Folder::new();
    let scene = folder.run("info s.xml");
    assert_eq!((scene.code, scene.stderr.as_str()), (0, ""));
    for line in [
        "integrator   path",
        "sensor       perspective, 40x30, 1200 pixels to render",
        "shapes       1 disk, 1 mesh, 2 rectangle, 1 sphere",
        "triangles    16",
        "materials    1 conductor, 1 dielectric, 2 diffuse, 1 roughconductor",
        "emitters     1 area, 1 constant, 1 point",
        "needs        lights that are sampled, lights that paths can hit, lights at points or with parallel rays, \
         an environment, diffuse or glossy surfaces, surfaces that only mirror or refract, mirrors or smooth glass, \
         materials of several parts, \
         glossy surfaces and several lights",
        "samples      8 per pixel",
    ] {
        assert!(scene.stdout.lines().any(|l| l == line), "{line} in\n{}", scene.stdout);
    }
    let time = scene.stdout.lines().find_map(|line| line.strip_prefix("time"));
    let time = time.unwrap_or_else(|| panic!("{}", scene.stdout)).trim();
    assert!(time.starts_with("about ") && time.contains(" s for 8 samples per pixel with "), "{time}");
    assert!(!folder.run("info s.xml --no-pilot").stdout.contains("\ntime"));
    // What is unknown or wrong is listed, and the rest is described.
    folder.write(
        "strange.xml",
        b"<scene version='3.0.0'><sensor type='telescope'/><shape type='sphere'/><shape type='teapot'/>
          <shape type='cube'><bsdf type='roughconductor'><float name='alpha' value='-1'/></bsdf></shape></scene>",
    );
    let strange = folder.run("info strange.xml");
    assert_eq!(strange.code, 0, "{strange:?}");
    for text in ["shapes       1 mesh, 1 sphere", "unknown shape", "unknown sensor", "name=\"alpha\""] {
        assert!(strange.stdout.contains(text), "{text} in\n{}", strange.stdout);
    }
    folder.render("s.xml -q");
    let image = folder.run("info s.exr");
    assert!(image.stdout.starts_with("40x30 pixels, 3 channels\n"), "{}", image.stdout);
    assert!(image.stdout.contains("\nsamplesPerPixel: 8\n"), "{}", image.stdout);
    assert_eq!((folder.run("info none.exr").code, folder.run("info none.xml").code), (4, 3));
}

#[test]
fn shells_and_manuals_are_served() {
    let folder = Folder::new();
    for shell in ["bash", "zsh", "fish"] {
        let run = folder.run(&format!("completions {shell}"));
        assert_eq!((run.code, run.stderr.as_str()), (0, ""));
        assert!(run.stdout.contains("buffon") && run.stdout.contains("target-error"), "{shell}");
    }
    for (arguments, title) in [("man", ".TH buffon 1"), ("man render", ".TH buffon-render 1")] {
        let run = folder.run(arguments);
        assert!(run.code == 0 && run.stdout.contains(title), "{arguments}: {}", run.stdout);
    }
    // Every page that the program's page refers to is installed beside it.
    assert_eq!(folder.run("man --dir pages/man1").code, 0);
    let page = String::from_utf8(folder.read("pages/man1/buffon.1")).expect("UTF-8");
    let references: Vec<&str> = page.lines().filter_map(|line| line.strip_suffix("(1)")).collect();
    assert_eq!(references.len(), 13, "{page}");
    for name in references {
        let name = name.replace('\\', "");
        let text = String::from_utf8(folder.read(&format!("pages/man1/{name}.1"))).expect("UTF-8");
        assert!(text.contains(&format!(".TH {name} 1")), "{name}: {text}");
    }
    assert_eq!((folder.run("man none").code, folder.run("man --dir s.xml").code), (2, 4));
    for arguments in ["--help", "--version", "render --help", "-V"] {
        let run = folder.run(arguments);
        assert!(run.code == 0 && run.stderr.is_empty() && !run.stdout.is_empty(), "{arguments}");
    }
}

#[test]
fn progress_goes_to_standard_error() {
    let folder = Folder::new();
    // The line of progress that `fits` comes after some seconds; the render ends with the test.
    let line = |kind: &str, fits: &dyn Fn(&str) -> bool| {
        let mut command = Command::new(program());
        command.args(["render", "s.xml", "--time", "10m", "-t", "1", "--progress", kind]);
        let mut child = Running::start(command.current_dir(folder.path("")).stderr(Stdio::piped()));
        let mut lines = child.stderr().lines().map(|line| line.expect("a line"));
        lines.find(|line| !line.starts_with("buffon: ") && fits(line)).expect("a line of progress")
    };
    let line_of_json =
        line("json", &|line| !line.contains("\"samples\":0,") && !line.contains("\"relmse_estimate\":null"));
    let json: Json = serde_json::from_str(&line_of_json).expect("a JSON object on a line");
    assert!(json["samples"].as_u64().is_some_and(|n| n > 0), "{json}");
    assert!(json["share"].as_f64().is_some_and(|s| s > 0.0 && s < 1.0), "{json}");
    for key in ["seconds", "seconds_left", "samples_per_pixel", "relmse_estimate"] {
        assert!(json.get(key).is_some(), "{key} in {json}");
    }
    let line = line("plain", &|line| line.contains("relMSE"));
    for part in [" %, ", " samples per pixel, ", " s of 600 s, relMSE ", " M samples/s, ", " s left"] {
        assert!(line.contains(part), "{part} in {line}");
    }
}

#[cfg(unix)]
#[test]
fn an_interrupted_render_writes_what_there_is() {
    for (signal, code) in [(libc::SIGINT, 130), (libc::SIGTERM, 143)] {
        let folder = Folder::new();
        let mut command = Command::new(program());
        command.args(["render", "s.xml", "--spp", "1000000000", "--progress", "json"]);
        command.current_dir(folder.path("")).stdout(Stdio::piped()).stderr(Stdio::piped());
        let mut child = Running::start(&mut command);
        let (mut stderr, mut out) = (child.stderr(), child.stdout());
        // The first line of progress: the render is under way.
        let mut line = String::new();
        while !line.starts_with('{') {
            line.clear();
            assert!(stderr.read_line(&mut line).expect("a line") > 0, "no progress");
        }
        child.signal(signal);
        let status = child.wait();
        let mut rest = String::new();
        stderr.read_to_string(&mut rest).expect("text");
        let mut stdout = String::new();
        out.read_to_string(&mut stdout).expect("text");
        assert_eq!((status.code(), stdout.as_str()), (Some(code), ""), "{signal}: {rest}");
        assert!(rest.trim_end().ends_with("interrupted"), "{rest}");
        let image = read(&folder.path("s.exr")).expect("what there is was written");
        assert_eq!(image.metadata.get("buffon:stop"), Some(&Value::Text("interrupted".into())));
        assert!(image.data.iter().all(|v| v.is_finite()) && image.data.iter().any(|v| *v > 0.0));
        assert_eq!(folder.files(), ["s.exr", "s.xml"]);
    }
}
