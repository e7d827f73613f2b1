//! Frames of an animation, and renders that go on with what is missing.

use crate::support::cli::{Folder, SCENE, wait_for_file};
use std::time::Duration;

/// A scene with a light whose radiance is the number of the frame.
fn animation() -> Folder {
    let text = SCENE.replace("\"radiance\" value=\"0.2\"", "\"radiance\" value=\"$frame\"");
    Folder::with(&text.replace("<integrator", "<default name=\"frame\" value=\"0\"/><integrator"))
}

#[test]
fn each_frame_is_a_render_with_its_number() {
    let folder = animation();
    folder.render("s.xml -q --spp 1 --frames 9..=10 -o f{frame:02}.pfm -o {frame}.png --stats {frame}.json");
    folder.render("s.xml -q --spp 1 -D frame=10 -o ten.pfm");
    let files = ["10.json", "10.png", "9.json", "9.png", "f09.pfm", "f10.pfm", "s.xml", "ten.pfm"];
    assert_eq!(folder.files(), files);
    assert!(
        folder.read("f10.pfm") == folder.read("ten.pfm") && folder.read("f09.pfm") != folder.read("f10.pfm")
    );
    // The default name.
    folder.render("s.xml -q --spp 1 --frames 3..4");
    assert!(folder.files().contains(&"s.0003.exr".to_owned()), "{:?}", folder.files());
}

#[test]
fn frames_need_names_of_their_own() {
    let folder = animation();
    for (arguments, text) in [
        ("--frames 1..3 -o a.exr", "-o a.exr: with --frames, expected {frame} in the name"),
        ("--frames 1..3 --stats a.json", "--stats a.json: with --frames, expected {frame} in the name"),
        ("--frames 1..3 --checkpoint c", "--checkpoint c: with --frames, expected {frame} in the name"),
        (
            "--frames 1..3 -o {frame:4}.exr",
            "{frame:4}.exr: expected {frame} or, with leading zeros, {frame:04}",
        ),
        ("--frames 3..1", "expected A..B or A..=B, whole numbers"),
    ] {
        let run = folder.run(&format!("render s.xml -q {arguments}"));
        assert!(run.code == 2 && run.stderr.contains(text), "{arguments}: {run:?}");
    }
    let run = Folder::new().run("render s.xml -q --frames 1..3");
    assert!(run.code == 3 && run.stderr.contains("--frames: the scene never uses $frame"), "{run:?}");
    assert_eq!(folder.files(), ["s.xml"]);
}

#[test]
fn existing_images_are_skipped() {
    let folder = animation();
    folder.write("1.pfm", b"older");
    let run = folder.render("s.xml --spp 1 --frames 1..3 -o {frame}.pfm --skip-existing");
    assert!(run.stderr.contains("note: 1.pfm exists: nothing is rendered"), "{run:?}");
    assert!(folder.read("1.pfm") == b"older" && folder.files() == ["1.pfm", "2.pfm", "s.xml"]);
    // One of two images is missing.
    folder.render("s.xml -q --spp 1 -o 1.pfm -o 1.png --skip-existing");
    assert!(folder.read("1.pfm") != b"older");
}

/// An interrupted frame is the last one. It is not written, so that the same command renders it again.
#[test]
fn a_signal_ends_the_frames() {
    let folder = animation();
    let child = folder.start_render("--time 0.3s --frames 1..1000 -o {frame}.pfm --skip-existing");
    wait_for_file(&folder.path("2.pfm"));
    std::thread::sleep(Duration::from_millis(100));
    child.signal(libc::SIGINT);
    assert_eq!(child.wait().code(), Some(130));
    let files = folder.files();
    assert!((3..6).contains(&files.len()), "{files:?}");
    // Every frame that was written is complete.
    for (i, file) in files.iter().filter(|file| file.ends_with(".pfm")).enumerate() {
        assert_eq!(*file, format!("{}.pfm", i + 1));
    }
}
