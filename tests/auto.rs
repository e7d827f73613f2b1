//! `--integrator auto` chooses by measurement, and then renders as the chosen integrator does.

use crate::bidirectional_media::glass_in_fog;
use crate::support::cli::Folder;
use buffon::image;
use serde_json::Value;

/// Renders a scene of `scenes` with the automatic choice; returns the name of the integrator and the trials.
fn decide(scene: &str, options: &str) -> (String, Value) {
    let folder = Folder::new();
    decide_in(&folder, &format!("{}/scenes/{scene}", env!("CARGO_MANIFEST_DIR")), options)
}

/// Renders a scene into a folder.
fn decide_in(folder: &Folder, scene: &str, options: &str) -> (String, Value) {
    folder.render(&format!("{scene} --integrator auto {options} -q -o auto.exr --stats s.json"));
    let stats: Value = serde_json::from_slice(&folder.read("s.json")).expect("JSON");
    let name = stats["integrator"].as_str().expect("a name").to_owned();
    assert_eq!(stats["auto"]["integrator"], name.as_str());
    (name, stats["auto"]["trials"].clone())
}

#[test]
fn the_image_is_that_of_the_chosen_integrator_for_all_threads() {
    let folder = Folder::new();
    let (name, trials) = decide_in(&folder, "s.xml", "--spp 16 -t 1");
    let whole = image::read(&folder.path("auto.exr")).expect("an image");
    folder.render(&format!("s.xml --integrator {name} --spp 16 -q -o chosen.exr"));
    let chosen = image::read(&folder.path("chosen.exr")).expect("an image");
    assert!(whole.data == chosen.data);
    assert_eq!(decide_in(&folder, "s.xml", "--spp 16 -t 3"), (name.clone(), trials));
    let run = folder.render("s.xml --integrator auto --spp 16 -o auto.exr");
    let note = format!("buffon: note: auto: {name} (effort to the same error: path ");
    assert!(run.stderr.contains(&note), "{run:?}");
}

#[test]
fn light_through_glass_is_left_to_light_paths_and_a_diffuse_room_to_camera_paths() {
    let (name, trials) = decide("caustics/glass-sphere.xml", "--size 64x48 --spp 64");
    assert_ne!(name, "path", "{trials}");
    let (name, trials) = decide("cornell-box/cornell-box.xml", "--size 64x64 --spp 64");
    assert_eq!(name, "path", "{trials}");
}

#[test]
fn resumed_and_merged_renders_keep_the_choice() {
    let folder = Folder::of_scene("caustics", "glass-sphere.xml");
    let options = "s.xml --integrator auto --size 48x36 -q";
    folder.render(&format!("{options} --spp 16 -o whole.pfm"));
    let whole = folder.read("whole.pfm");
    for (name, range) in [("a", "0..6"), ("b", "6..16")] {
        folder
            .render(&format!("{options} --spp 16 --sample-range {range} --checkpoint {name} -o {name}.pfm"));
    }
    assert_eq!(folder.run("merge a b -o merged.pfm -q").code, 0);
    assert!(folder.read("merged.pfm") == whole);
    // A resumed render has no pilots: it keeps even what they would not choose.
    folder.render(
        "s.xml --integrator path --size 48x36 -q --spp 8 --checkpoint c -o c.pfm --sampler independent",
    );
    folder.render(&format!(
        "{options} --spp 16 --checkpoint c --resume -o c.pfm --sampler independent --stats s.json"
    ));
    let stats: Value = serde_json::from_slice(&folder.read("s.json")).expect("JSON");
    assert_eq!(stats["integrator"], "path");
}

#[test]
fn what_cannot_render_the_scene_is_no_candidate() {
    let (name, trials) = decide("plugins/sensor/irradiancemeter.xml", "--spp 16");
    assert_eq!(name, "path", "{trials}");
    let refused = trials.as_array().expect("trials").iter().filter(|trial| trial["refused"].is_string());
    assert_eq!(refused.count(), trials.as_array().expect("trials").len() - 1, "{trials}");
}

/// A lamp behind glass in fog is left to light paths.
#[test]
fn media_are_left_to_camera_paths_or_to_both_ends() {
    let (name, trials) = decide("plugins/medium/homogeneous.xml", "--spp 4 --size 16x16");
    let names: Vec<&Value> =
        trials.as_array().expect("trials").iter().map(|trial| &trial["integrator"]).collect();
    assert_eq!((name.as_str(), names), ("volpath", vec![&"volpath".into(), &"bdpt".into()]));
    let folder = Folder::with(&glass_in_fog("<integrator type='volpath'/>"));
    assert_eq!(decide_in(&folder, "s.xml", "--spp 64 --size 64x64").0, "bdpt");
}
