//! Renders that are interrupted and resumed, or split and merged, have exactly the pixels of a whole render.

use crate::support::cli::{Folder, Run, SCENE};
use buffon::session::checkpoint::file;

/// Returns a folder with the sums of the samples 0..10, 10..13 and 13..24 of the scene in `a`, `b` and `c`, and the
/// image of the whole render in `whole.exr`.
fn parts(options: &str) -> Folder {
    let folder = Folder::new();
    folder.render(&format!("s.xml {options} --spp 24 -q -o whole.exr"));
    for (name, range) in [("a", "0..10"), ("b", "10..13"), ("c", "13..24")] {
        let part = format!("--sample-range {range} --checkpoint {name} -o {name}.exr");
        folder.render(&format!("s.xml {options} --spp 24 -q {part}"));
    }
    folder
}

fn merge(folder: &Folder, arguments: &str) -> Run {
    folder.run(&format!("merge {arguments}"))
}

#[test]
fn merged_ranges_are_the_whole_render_in_any_order() {
    for options in [
        "",
        "--adaptive",
        "--integrator ptracer",
        "--sampler multijitter -t 3",
        "--sampler zsobol --crop 5,3,20,9",
    ] {
        let folder = parts(options);
        folder.render(&format!("s.xml {options} --spp 24 -q -o whole.pfm"));
        let whole = folder.read("whole.pfm");
        for order in ["a b c", "c a b", "b c a"] {
            let run = merge(&folder, &format!("{order} -o m.pfm -q"));
            assert_eq!((run.code, run.stderr.as_str()), (0, ""), "{options}");
            assert!(folder.read("m.pfm") == whole, "{options}: {order}");
        }
        // The result of a merge can be merged again.
        assert_eq!(merge(&folder, "c a --checkpoint ac -q").code, 0);
        assert_eq!(merge(&folder, "ac b -o m.pfm -q").code, 0);
        assert!(folder.read("m.pfm") == whole, "{options}");
    }
}

#[test]
fn integrators_with_caches_and_photons_are_merged_alike() {
    let few =
        r#"<integer name="global_photons" value="4000"/><integer name="caustic_photons" value="2000"/>"#;
    for (integrator, settings) in [("irrcache", ""), ("photonmapper", few), ("sppm", "")] {
        let path = r#"<integrator type="path"><integer name="max_depth" value="6"/></integrator>"#;
        let chosen = format!(r#"<integrator type="{integrator}">{settings}</integrator>"#);
        let folder = Folder::with(&SCENE.replace(path, &chosen));
        let options = "s.xml --spp 8 -q";
        folder.render(&format!("{options} -o whole.pfm"));
        folder.render(&format!("{options} --sample-range 0..3 --checkpoint a -o a.pfm"));
        folder.render(&format!("{options} --sample-range 3..8 --checkpoint b -o b.pfm"));
        assert_eq!(merge(&folder, "b a -o m.pfm -q").code, 0);
        assert!(folder.read("m.pfm") == folder.read("whole.pfm"), "{integrator}");
    }
}

/// Regions of the image, each a range or several, are joined where they meet. Their edges need not be those of tiles.
#[test]
fn merged_regions_are_the_whole_render() {
    let regions = [("a", "0,0,40,7"), ("b", "0,7,13,23"), ("c", "13,7,27,23")];
    for options in ["", "--adaptive", "--integrator irrcache", "--integrator bdpt"] {
        let folder = Folder::new();
        let options = format!("s.xml {options} --spp 8 --aov albedo -q");
        folder.render(&format!("{options} -o whole.exr"));
        for (name, crop) in regions {
            for (half, range) in [("1", "0..3"), ("2", "3..8")] {
                let part =
                    format!("--sample-range {range} --crop {crop} --checkpoint {name}{half} --no-image");
                folder.render(&format!("{options} {part}"));
            }
        }
        assert_eq!(merge(&folder, "b2 a1 a2 c2 b1 c1 -o m.exr -q").code, 0);
        let [whole, merged] = ["whole.exr", "m.exr"].map(|f| buffon::image::read(&folder.path(f)).unwrap());
        assert!(whole.data == merged.data, "{options}");
        for name in ["samplesPerPixel", "worldToNDC", "buffon:stop", "buffon:relmse", "buffon:relmse_high"] {
            assert_eq!(whole.metadata.get(name), merged.metadata.get(name), "{options}: {name}");
        }
        // Regions can be merged first, and the sum goes on like any checkpoint.
        assert_eq!(merge(&folder, "c1 a1 b1 --checkpoint first -q").code, 0);
        folder.render(&format!("{options} --checkpoint first --resume -o resumed.exr"));
        assert!(buffon::image::read(&folder.path("resumed.exr")).unwrap().data == whole.data, "{options}");
    }
    let folder = Folder::new();
    for (name, crop) in regions.into_iter().chain([("over", "12,7,9,9")]) {
        folder.render(&format!("s.xml --spp 2 -q --crop {crop} --checkpoint {name} --no-image"));
    }
    folder.render("s.xml --spp 2 -q --crop 13,7,27,23 --sample-range 0..1 --checkpoint half --no-image");
    for (arguments, sentence) in [
        ("a c", "merge: the regions have 901 of the 1200 pixels in the rectangle 0,0,40,30 around them"),
        ("a b over", "merge: over has the region 12,7,9,9; b has 0,7,13,23"),
        (
            "a b half",
            "merge: half is of the region 13,7,27,23, which has the samples 0..1; the region 0,0,40,7 has 0..2",
        ),
    ] {
        let run = merge(&folder, &format!("{arguments} -o m.pfm"));
        assert_eq!((run.code, run.stderr.trim_end()), (2, format!("buffon: {sentence}").as_str()));
    }
    let run = folder.run("render s.xml --spp 4 --crop 0,0,40,8 --checkpoint a --resume --no-image");
    let sentence =
        "--resume a: it has the region 0,0,40,7, expected 0,0,40,8; choose another file, or remove it";
    assert!(run.code == 2 && run.stderr.contains(sentence), "{run:?}");
}

#[test]
fn an_exr_of_merged_parts_has_the_whole_ones_layers_and_metadata() {
    let folder = parts("--aov albedo,variance,samples");
    let run = merge(&folder, "a b c -o m.exr");
    assert_eq!((run.code, run.stdout.as_str()), (0, ""), "{run:?}");
    assert!(run.stderr.starts_with("m.exr: samples 0..24, relMSE about "), "{run:?}");
    let [whole, merged] = ["whole.exr", "m.exr"].map(|f| buffon::image::read(&folder.path(f)).unwrap());
    assert_eq!((&whole.channels, &whole.data), (&merged.channels, &merged.data));
    for name in
        ["samplesPerPixel", "worldToNDC", "buffon:seed", "buffon:stop", "buffon:relmse", "buffon:relmse_high"]
    {
        assert!(whole.metadata.get(name).is_some(), "{name}");
        assert_eq!(whole.metadata.get(name), merged.metadata.get(name), "{name}");
    }
}

#[test]
fn mixed_and_overlapping_parts_are_refused() {
    let folder = parts("");
    let other = |name: &str, options: &str| {
        folder.render(&format!("s.xml {options} -q --sample-range 10..13 --checkpoint {name} -o x.exr"));
    };
    other("seed", "--spp 24 --seed 1");
    other("integrator", "--spp 24 --integrator direct");
    other("settings", "--spp 24 --integrator ptracer");
    other("sampler", "--spp 24 --sampler halton");
    other("view", "--spp 24 --size 41x30");
    other("layers", "--spp 24 --aov Z");
    folder.render("s.xml --spp 24 -q --sample-range 12..14 --checkpoint overlap -o x.pfm");
    folder.write("s.xml", SCENE.replace("0.5,0.4,0.3", "0.5,0.4,0.2").as_bytes());
    other("scene", "--spp 24");
    folder.write("text", b"no checkpoint at all, but long enough for one");
    for (arguments, sentence) in [
        ("a seed", "merge: seed has samples of seed 1, expected 0 as in a"),
        ("a integrator", "merge: integrator has samples of the integrator direct, expected path as in a"),
        ("a settings", "merge: settings has samples of the integrator ptracer, expected path as in a"),
        ("a sampler", "merge: sampler has samples of the sampler halton, expected sobol as in a"),
        ("a view", "merge: view has samples of another view of the scene (sensor, size or film) as in a"),
        ("a layers", "merge: layers has the layers Z, expected none as in a"),
        ("a scene", "merge: scene has samples of another scene as in a"),
        ("a b overlap", "merge: overlap has the samples 12..14; b also has 10..13"),
        ("a a", "merge: a has the samples 0..10; a also has 0..10"),
    ] {
        let run = merge(&folder, &format!("{arguments} -o m.pfm"));
        assert_eq!((run.code, run.stderr.trim_end()), (2, format!("buffon: {sentence}").as_str()));
    }
    let run = merge(&folder, "a text -o m.pfm");
    assert_eq!((run.code, run.stderr.trim_end()), (4, "buffon: text: checkpoint: is not a checkpoint"));
    assert!(!folder.files().contains(&"m.pfm".into()));
    let run = merge(&folder, "a c -o m.pfm --strict");
    assert_eq!((run.code, run.stderr.trim_end()), (5, "buffon: of 24 samples per pixel 10..13 are missing"));
    let run = merge(&folder, "a c -o m.pfm");
    assert!(
        run.code == 0 && run.stderr.contains("warning: of 24 samples per pixel 10..13 are missing"),
        "{run:?}"
    );
}

#[test]
fn a_resumed_render_is_the_uninterrupted_one() {
    for options in ["", "--integrator ptracer", "--adaptive", "--aov N,variance --sampler sobol"] {
        let folder = Folder::new();
        folder.render(&format!("s.xml {options} --spp 40 -q -o whole.exr"));
        folder.render(&format!("s.xml {options} --spp 13 -q --checkpoint c -o r.exr"));
        folder.render(&format!("s.xml {options} --spp 40 -q --checkpoint c --resume -o r.exr"));
        let [whole, resumed] = ["whole.exr", "r.exr"].map(|f| buffon::image::read(&folder.path(f)).unwrap());
        assert_eq!((whole.channels, whole.data), (resumed.channels, resumed.data), "{options}");
        assert_eq!(resumed.metadata.get("buffon:relmse"), whole.metadata.get("buffon:relmse"));
        // A complete render takes no more samples.
        let again = folder.render(&format!("s.xml {options} --spp 40 --checkpoint c --resume -o r.exr"));
        assert!(again.stderr.contains("40 samples per pixel"), "{again:?}");
    }
}

/// `auto` distributes no samples with `--time`. A render that `--spp` goes on with keeps to that, and one that `--spp`
/// began keeps its rates with `--time`.
#[test]
fn a_resumed_render_keeps_its_distribution_of_samples() {
    let folder = Folder::of_scene("speed", "boards.xml");
    let adaptive = |options: &str| {
        folder.render(&format!("s.xml --size 200x150 -q -o r.exr --checkpoint c --stats s.json {options}"));
        let stats: serde_json::Value = serde_json::from_slice(&folder.read("s.json")).expect("JSON");
        stats["adaptive"].as_bool().expect("a truth value")
    };
    assert!(!adaptive("--time 0.2s"));
    assert!(!adaptive("--spp 100000 --time 0.3s --resume"));
    std::fs::remove_file(folder.path("c")).expect("the file is there");
    assert!(adaptive("--spp 24"));
    assert!(adaptive("--spp 40 --time 100s --resume"));
    folder.render("s.xml --size 200x150 -q -o whole.exr --spp 40");
    let [whole, resumed] = ["whole.exr", "r.exr"].map(|f| buffon::image::read(&folder.path(f)).unwrap());
    assert_eq!(whole.data, resumed.data);
}

#[test]
fn what_cannot_be_resumed_is_refused_and_left_as_it_is() {
    let folder = Folder::new();
    folder.render("s.xml --spp 8 -q --checkpoint c -o r.pfm");
    folder.render("s.xml --spp 8 -q --sample-range 4..8 --checkpoint range -o r.pfm");
    let before = folder.read("c");
    for (arguments, sentence) in [
        (
            "--spp 16 --checkpoint c",
            "--checkpoint c: it is there already; --resume goes on from it, or remove it",
        ),
        (
            "--spp 4 --checkpoint c --resume",
            "--resume c: it has 8 samples per pixel, more than the requested 4; use --spp 8 to write its image",
        ),
        (
            "--spp 16 --seed 3 --checkpoint c --resume",
            "--resume c: it has samples of seed 0, expected 3; choose another file, or remove it",
        ),
        (
            "--spp 16 --checkpoint c --resume --accel obvhs",
            "--resume c: it has samples of the traversal list, expected obvhs; choose another file, or remove it",
        ),
        (
            "--spp 16 --checkpoint range --resume",
            "--resume range: it holds the samples 4..8, expected them from 0 on",
        ),
        (
            "--spp 4 --sample-range 2..5",
            "--sample-range 2..5: the whole render has 4 samples per pixel; increase it with --spp",
        ),
        (
            "--time 2s --sample-range 2..4",
            "--sample-range 2..4: a range fixes the number of samples and excludes --time and --target-error",
        ),
    ] {
        let run = folder.run(&format!("render s.xml -o x.pfm {arguments}"));
        assert_eq!(
            (run.code, run.stderr.trim_end()),
            (2, format!("buffon: {sentence}").as_str()),
            "{arguments}"
        );
    }
    assert!(
        folder.run("render s.xml --resume").code == 2
            && folder.run("render s.xml --sample-range 4..4").code == 2
    );
    assert!(folder.read("c") == before && !folder.files().contains(&"x.pfm".into()));
    let begins = folder.render("s.xml --spp 2 --checkpoint new --resume -o x.pfm");
    assert!(begins.stderr.contains("note: new does not exist: starting a new render"), "{begins:?}");
}

#[test]
fn ranges_have_pictures_of_their_own_and_info_tells_what_a_checkpoint_holds() {
    let folder = Folder::new();
    folder.render("s.xml --spp 8 -q --sample-range 4..8 --checkpoint c");
    assert_eq!(folder.files(), ["c", "s.4-8.exr", "s.xml"]);
    let info = folder.run("info c");
    assert_eq!(info.code, 0);
    for line in [
        "integrator   path, settings",
        "samples      4..8 of 8 samples per pixel",
        "image        40x30 at (0, 0)",
    ] {
        assert!(info.stdout.contains(line), "{line} in {}", info.stdout);
    }
}

#[test]
fn damaged_checkpoints_are_refused_before_anything_is_allocated() {
    let folder = Folder::new();
    folder.render("s.xml --spp 2 -q --crop 0,0,5,4 --checkpoint c -o x.pfm");
    let good = folder.read("c");
    let refused = |bytes: &[u8]| {
        folder.write("bad", bytes);
        file::load(&folder.path("bad"))
            .map(drop)
            .unwrap_err()
            .to_string()
            .split_once("checkpoint: ")
            .unwrap()
            .1
            .to_string()
    };
    assert_eq!(refused(b""), "is not a checkpoint");
    let with = |at: usize, new: &[u8]| {
        let mut bytes = good.clone();
        bytes[at..at + new.len()].copy_from_slice(new);
        refused(&bytes)
    };
    assert_eq!(with(0, b"X"), "is not a checkpoint");
    assert_eq!(with(8, &[9]), "has version 9, expected 4");
    assert_eq!(with(12, &[255; 4]), "is truncated: its header is incomplete");
    assert!(with(17, b"!").starts_with("is damaged: its header: "));
    let header = String::from_utf8_lossy(&good).into_owned();
    let rect = header.find("\"rect\":[0,0,5,4]").expect("its place in the header");
    assert_eq!(with(rect, b"\"rect\":[0,0,0,4]"), "is damaged: its header has an image of impossible size");
    let larger = with(rect, b"\"rect\":[0,0,9,4]");
    assert!(larger.starts_with("is damaged: it has ") && larger.contains(", expected "), "{larger}");
    // Every changed byte and every truncation is detected.
    for at in (16..good.len()).step_by(7) {
        assert!(with(at, &[good[at] ^ 0x55]).starts_with("is damaged"), "{at}");
    }
    for length in [5, 20, 200, good.len() - 1] {
        refused(&good[..length]);
    }
}
