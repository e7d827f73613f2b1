//! The scenes of this repository: each loads without warnings and renders without invalid samples, with each of its
//! cameras.

use assert_cmd::Command;
use std::path::{Path, PathBuf};

fn scenes() -> Vec<PathBuf> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes");
    let mut list = Vec::new();
    for topic in
        std::fs::read_dir(root).expect("there is a folder of scenes").flatten().filter(|e| e.path().is_dir())
    {
        let files =
            std::fs::read_dir(topic.path()).expect("a folder can be read").flatten().map(|e| e.path());
        list.extend(files.filter(|p| p.extension().is_some_and(|e| e == "xml")));
    }
    list.sort();
    list
}

#[test]
fn every_scene_renders_under_strict() {
    let scenes = scenes();
    assert!(scenes.len() >= 5, "{scenes:?}");
    for scene in scenes {
        let folder = tempfile::tempdir().expect("a temporary folder");
        // The files of these scenes are not in the repository. They may not have been generated.
        let generated = |folder: &str, file: &str| {
            scene.parent().is_some_and(|parent| parent.ends_with(folder))
                && !scene.with_file_name(file).exists()
        };
        if generated("scenes/terrain", "terrain.ply") || generated("scenes/speed", "lights-10000.xml") {
            continue;
        }
        let text = std::fs::read_to_string(&scene).expect("a scene is text");
        for sensor in 0..text.matches("<sensor ").count().max(1) {
            let assert = Command::new(env!("CARGO_BIN_EXE_buffon"))
                .args(["render", "--strict", "--size", "24x16", "--spp", "4", "--threads", "2", "-s"])
                .arg(sensor.to_string())
                .arg("-o")
                .arg(folder.path().join("out.exr"))
                .arg(&scene)
                .assert()
                .success();
            let stderr = String::from_utf8_lossy(&assert.get_output().stderr);
            assert!(!stderr.contains("is mapped to"), "{}: {stderr}", scene.display());
        }
    }
}
