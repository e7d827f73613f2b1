//! Light tracing, compared with path tracing.

use crate::support::cli::Folder;

/// Returns a folder with the scene that has every kind of emitter, and its texture.
fn folder() -> Folder {
    Folder::of_scene("light-tracing", "lights.xml")
}

/// Camera paths and light paths give the same image with a pinhole, a thin lens and an orthographic camera.
#[test]
fn light_paths_and_camera_paths_agree() {
    let folder = folder();
    for sensor in 0..3 {
        let common = format!("s.xml -q --sampler scene --size 32x24 -s {sensor} --aov variance --spp 1024");
        folder.render(&format!("{common} --integrator path --seed 1 -o path.exr"));
        folder.render(&format!("{common} --integrator ptracer --seed 2 -o light.exr"));
        let run = folder.run("diff path.exr light.exr --z");
        assert_eq!(run.code, 0, "sensor {sensor}: {}{}", run.stdout, run.stderr);
    }
}

/// Camera paths and light paths agree for every kind of emitter, and for the caustics of emitters with an area.
#[test]
fn light_paths_and_camera_paths_agree_on_every_kind_of_emitter() {
    let folder = Folder::of_scene("photon", "emitters.xml");
    let common = "s.xml -q --sampler scene --size 52x28 --aov variance --spp 512";
    folder.render(&format!("{common} --integrator path --seed 1 -o path.exr"));
    folder.render(&format!("{common} --integrator ptracer --seed 2 -o light.exr"));
    let run = folder.run("diff path.exr light.exr --z");
    assert_eq!(run.code, 0, "{}{}", run.stdout, run.stderr);
}

/// Splats are added in the same order by any number of threads, and a crop has exactly the pixels of the whole image.
#[test]
fn splats_do_not_depend_on_threads_or_crops() {
    let folder = folder();
    for threads in [1, 2, 5] {
        folder.render(&format!("s.xml -q --size 32x24 --spp 5 -t {threads} -o {threads}.exr"));
    }
    let read = |name: &str| buffon::image::read(&folder.path(name)).expect("an image");
    let data = ["1.exr", "2.exr", "5.exr"].map(|name| read(name).data);
    assert!(data[0] == data[1] && data[0] == data[2]);
    folder.render("s.xml -q --size 32x24 --spp 5 --crop 8,4,16,16 -o crop.exr");
    let (whole, crop) = (read("1.exr"), read("crop.exr"));
    for y in 0..16 {
        for x in 0..16 {
            for c in 0..3 {
                let at = |image: &buffon::image::Image, x: usize, y: usize| {
                    image.data[(y * image.width + x) * image.channels.len() + c]
                };
                let inside = match crop.width {
                    16 => at(&crop, x, y),
                    _ => at(&crop, x + 8, y + 4),
                };
                assert_eq!(inside, at(&whole, x + 8, y + 4), "{x} {y}");
            }
        }
    }
}

#[test]
fn depths_mean_what_they_mean_to_camera_paths() {
    check_depths(&[2]);
}

#[test]
#[ignore = "takes long: make test-all"]
fn other_depths_mean_what_they_mean_to_camera_paths() {
    check_depths(&[1, 3]);
}

/// `max_depth` has the same meaning as for camera paths.
fn check_depths(depths: &[u32]) {
    let folder = folder();
    for depth in depths {
        let text = String::from_utf8(folder.read("s.xml")).expect("a scene is text");
        let scene =
            text.replace("name=\"max_depth\" value=\"6\"", &format!("name=\"max_depth\" value=\"{depth}\""));
        assert_ne!(scene, text);
        folder.write("d.xml", scene.as_bytes());
        // Rough glass makes the tails of the distribution heavy: with fewer samples, the z-test is not calibrated.
        let common = "d.xml -q --size 24x16 --aov variance --spp 2048";
        folder.render(&format!("{common} --integrator path --seed 1 -o path.exr"));
        folder.render(&format!("{common} --seed 2 -o light.exr"));
        let run = folder.run("diff path.exr light.exr --z");
        assert_eq!(run.code, 0, "depth {depth}: {}{}", run.stdout, run.stderr);
    }
}
