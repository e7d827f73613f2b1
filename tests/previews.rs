//! The image so far: `--write-every` and SIGUSR1.

use crate::support::cli::{Folder, wait_for_file};
use buffon::image::{Value, read};
use std::time::Duration;

const LONG: &str = "--size 200x150 --spp 1000000000";

/// Returns the samples per pixel of an image that is not finished.
fn samples(folder: &Folder) -> i32 {
    let image = read(&folder.path("r.exr")).expect("a whole image");
    assert_eq!(image.metadata.get("buffon:stop"), Some(&Value::Text("interrupted".into())));
    match image.metadata.get("samplesPerPixel") {
        Some(Value::Int(samples)) => *samples,
        other => panic!("{other:?}"),
    }
}

#[test]
fn the_image_so_far_is_written_regularly() {
    let folder = Folder::new();
    let child = folder.start_render(&format!("{LONG} -o r.exr --write-every 0.2s"));
    wait_for_file(&folder.path("r.exr"));
    let first = samples(&folder);
    while samples(&folder) <= first {
        std::thread::sleep(Duration::from_millis(50));
    }
    child.signal(libc::SIGINT);
    assert_eq!(child.wait().code(), Some(130));
    assert_eq!(folder.files(), ["r.exr", "s.xml"]);
}

#[cfg(unix)]
#[test]
fn a_signal_asks_for_the_image_so_far() {
    let folder = Folder::new();
    for options in ["", "--integrator bdpt", "--checkpoint r.sums"] {
        let child = folder.start_render(&format!("{LONG} -o r.exr {options}"));
        // Signals before the render, and before its first sample, lose nothing.
        while !folder.path("r.exr").exists() {
            std::thread::sleep(Duration::from_millis(200));
            child.signal(libc::SIGUSR1);
        }
        assert!(samples(&folder) > 0);
        child.signal(libc::SIGKILL);
        child.wait();
        std::fs::remove_file(folder.path("r.exr")).expect("it exists");
    }
}

/// Previews change no bit, also if every part has one and with all sums in use.
#[test]
fn the_final_image_does_not_depend_on_previews() {
    let folder = Folder::new();
    for options in ["", "--adaptive", "--integrator ptracer", "--integrator sppm", "--sample-range 2..9"] {
        folder.render(&format!("s.xml -q --spp 12 -o a.pfm {options}"));
        folder.render(&format!("s.xml -q --spp 12 -o b.pfm --write-every 0.000001s {options}"));
        assert!(folder.read("a.pfm") == folder.read("b.pfm"), "{options}");
    }
    for (options, expected) in [
        ("-o -", "buffon: --write-every: standard output is written once; name a file with -o\n"),
        ("-o a.pfm --skip-existing", "cannot be used with"),
    ] {
        let run = folder.run(&format!("render s.xml -q --spp 1 --write-every 1s {options}"));
        assert!(run.code == 2 && run.stderr.contains(expected), "{run:?}");
    }
}
