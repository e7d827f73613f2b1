//! Renders that are killed, interrupted, or run out of disk: what was there is whole, and what is lost is found again.

use crate::support::cli::{Folder, SCENE, program, wait_for_file};
use buffon::sampling::hash::combine;
use std::ops::Range;
use std::os::unix::process::ExitStatusExt;
use std::process::{Command, ExitStatus};
use std::time::{Duration, Instant};

/// How long a render lasts that nobody stops.
fn duration(folder: &Folder, arguments: &str) -> Duration {
    let started = Instant::now();
    folder.render(&format!("s.xml -q {arguments}"));
    started.elapsed()
}

/// A number in [0, 1) for a trial of a test.
fn random(test: u32, trial: u32) -> f64 {
    f64::from(combine(combine(7, test), trial)) / f64::from(u32::MAX)
}

/// Runs `buffon render` and sends a signal after some time.
fn killed(folder: &Folder, arguments: &str, signal: i32, after: Duration) -> ExitStatus {
    let child = folder.start_render(arguments);
    std::thread::sleep(after);
    child.signal(signal);
    child.wait()
}

#[test]
fn renders_that_are_killed_at_random_leave_whole_images_or_the_older_ones() {
    kill_at_random(0..20);
}

#[test]
#[ignore = "takes long: make test-all"]
fn a_hundred_renders_are_killed_at_random() {
    kill_at_random(0..100);
}

/// Kills renders of these numbers at a time of their own.
fn kill_at_random(trials: Range<u32>) {
    let folder = Folder::new();
    let short = duration(&folder, "--spp 2");
    let (mut ended, mut stopped, mut replaced, mut left) = (0, 0, 0, 0);
    for trial in trials.clone() {
        let signal = [libc::SIGKILL, libc::SIGTERM, libc::SIGINT][trial as usize % 3];
        let before = folder.read("s.exr");
        // Half of them are short enough to be met while they write.
        let samples = if trial % 2 == 0 { 2 } else { 100_000 };
        let after = short.mul_f64(1.3 * random(0, trial));
        let status = killed(&folder, &format!("--spp {samples}"), signal, after);
        let code = status.code();
        match (code, status.signal()) {
            (Some(0), None) => ended += 1,
            (Some(code), None) if signal != libc::SIGKILL && code == 128 + signal => stopped += 1,
            // Killed, or before the program listened.
            (None, Some(by)) if by == signal => stopped += 1,
            other => panic!("trial {trial}: {other:?} after {signal}"),
        }
        let image = buffon::image::read(&folder.path("s.exr"));
        assert!(image.is_ok_and(|image| image.data.iter().all(|v| v.is_finite())), "trial {trial}: {signal}");
        let changed = folder.read("s.exr") != before;
        replaced += u32::from(changed);
        assert!(
            !(changed && signal == libc::SIGKILL && code.is_none() && samples > 2),
            "a killed render has written"
        );
        left = left.max(folder.files().len() - 2);
    }
    println!(
        "{trials:?}: {ended} ended, {stopped} stopped, {replaced} images replaced, {left} files left at most"
    );
    folder.render("s.xml -q --spp 1");
    assert_eq!(folder.files(), ["s.exr", "s.xml"], "the next render cleans up");
}

#[test]
fn renders_that_are_killed_again_and_again_end_as_if_they_had_not_been() {
    for integrator in ["path", "ptracer", "bdpt", "vcm", "pssmlt", "sppm"] {
        let folder = Folder::new();
        let samples = if ["vcm", "pssmlt", "sppm"].contains(&integrator) { 60 } else { 600 };
        let options = format!("--integrator {integrator} --spp {samples} --sampler sobol");
        folder.render(&format!("s.xml -q {options} -o whole.pfm"));
        let resume = format!("{options} --checkpoint c --checkpoint-every 0.02s --resume -o r.pfm");
        let mut kills = 0;
        // It comes to its end: more checkpoints are written before each kill.
        for trial in 0.. {
            let signal = [libc::SIGKILL, libc::SIGINT][trial as usize % 2];
            let mut child = folder.start_render(&resume);
            if (0..=trial).all(|_| child.wait_for_change(&folder.path("c"))) {
                child.signal(signal);
            }
            let status = child.wait();
            match (status.code(), status.signal()) {
                (Some(0), None) => break,
                (Some(85 | 130), None) | (None, Some(2 | 9)) => kills += 1,
                other => panic!("{integrator}, trial {trial}: {other:?}"),
            }
        }
        assert!(folder.read("r.pfm") == folder.read("whole.pfm"), "{integrator} after {kills} kills");
        println!("{integrator}: the very picture after {kills} kills");
        folder.render(&format!("s.xml -q {resume}"));
        assert_eq!(folder.files(), ["c", "r.pfm", "s.xml", "whole.pfm"]);
    }
}

#[test]
fn a_signal_with_a_checkpoint_has_an_exit_code_of_its_own() {
    let folder = Folder::new();
    for signal in [libc::SIGINT, libc::SIGTERM] {
        let _ = std::fs::remove_file(folder.path("c"));
        let child = folder.start_render("--spp 1000000000 --checkpoint c --checkpoint-every 0.02s --resume");
        wait_for_file(&folder.path("c"));
        child.signal(signal);
        assert_eq!(child.wait().code(), Some(85), "{signal}");
    }
    assert_eq!(folder.files(), ["c", "s.exr", "s.xml"]);
}

/// Runs `buffon` where files may have so many blocks of 512 bytes.
fn limited(folder: &Folder, blocks: u32, arguments: &str) -> (Option<i32>, String) {
    let output = Command::new("sh")
        .args(["-c", &format!("trap '' XFSZ; ulimit -f {blocks}; exec \"$0\" {arguments}"), program()])
        .current_dir(folder.path(""))
        .output()
        .expect("a shell");
    (output.status.code(), String::from_utf8(output.stderr).expect("text"))
}

#[test]
fn a_full_disk_costs_nothing_that_was_there() {
    let folder = Folder::new();
    folder.render("s.xml -q --spp 1 --checkpoint c -o s.exr");
    let [image, checkpoint] = ["s.exr", "c"].map(|name| folder.read(name));
    // No room for the image.
    let (code, message) = limited(&folder, 8, "render s.xml -q --spp 3 -o s.exr");
    assert_eq!((code, message.trim_end()), (Some(4), "buffon: s.exr: cannot be written: file too large"));
    assert!(folder.read("s.exr") == image);
    // Room for the image, none for the checkpoint, which is tried again and again.
    let arguments =
        "render s.xml --progress none --spp 3 --checkpoint c --resume --checkpoint-every 0.001s -o s.exr";
    let (code, message) = limited(&folder, 100, arguments);
    assert_eq!(code, Some(4), "{message}");
    assert!(message.contains("buffon: warning: c: cannot be written: file too large"), "{message}");
    assert!(message.ends_with("buffon: c: cannot be written: file too large\n"), "{message}");
    assert!(folder.read("c") == checkpoint && folder.read("s.exr") != image, "the picture is there");
    assert_eq!(folder.files(), ["c", "s.exr", "s.xml"]);
}

#[test]
fn a_folder_that_cannot_be_written_to_is_found_before_the_render() {
    use std::os::unix::fs::PermissionsExt;
    let folder = Folder::with(SCENE);
    std::fs::create_dir(folder.path("no")).unwrap();
    std::fs::set_permissions(folder.path("no"), std::fs::Permissions::from_mode(0o555)).unwrap();
    if std::fs::write(folder.path("no/test"), "").is_ok() {
        println!("permissions do not bind this user: nothing was tested");
        return;
    }
    for arguments in ["-o no/s.exr", "--checkpoint no/c -o s.exr"] {
        let run = folder.run(&format!("render s.xml --spp 100000000 {arguments}"));
        assert!(run.code == 4 && run.stderr.contains("cannot be written: "), "{run:?}");
    }
}
