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
        // The mesh of the terrain is not in the repository. It may not have been generated.
        if scene.ends_with("terrain.xml") && !scene.with_file_name("terrain.ply").exists() {
            continue;
        }
        let text = std::fs::read_to_string(&scene).expect("a scene is text");
        for sensor in 0..text.matches("<sensor ").count().max(1) {
            Command::new(env!("CARGO_BIN_EXE_buffon"))
                .args(["render", "--strict", "--size", "24x16", "--spp", "4", "--threads", "2", "-s"])
                .arg(sensor.to_string())
                .arg("-o")
                .arg(folder.path().join("out.exr"))
                .arg(&scene)
                .assert()
                .success();
        }
    }
}
