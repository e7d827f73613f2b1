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
    let note = format!("buffon: note: auto: {name} (error at the same cost: path ");
    assert!(run.stderr.contains(&note), "{run:?}");
}

#[test]
fn light_through_glass_is_left_to_light_paths_and_a_diffuse_room_to_camera_paths() {
    let (name, trials) = decide("caustics/glass-sphere.xml", "--size 64x48 --spp 64");
    assert_ne!(name, "path", "{trials}");
    let (name, trials) = decide("cornell-box/cornell-box.xml", "--size 64x64 --spp 64");
    assert_eq!(name, "path", "{trials}");
}

/// A slab of glass over a floor, with a spot, and a sky that lights the floor, too. `path` and `bdpt` never find the
/// light of the spot on the floor under the glass.
const SLAB: &str = r#"<scene version="3.0.0">
    <integrator type="path"/>
    <sensor type="perspective">
        <float name="fov" value="45"/>
        <transform name="to_world"><lookat origin="0, 3, 5" target="0, 0.5, 0" up="0, 1, 0"/></transform>
        <film type="hdrfilm">
            <integer name="width" value="64"/>
            <integer name="height" value="64"/>
            <rfilter type="box"/>
        </film>
    </sensor>
    <shape type="rectangle">
        <transform name="to_world"><scale value="4"/><rotate x="1" angle="-90"/></transform>
        <bsdf type="diffuse"/>
    </shape>
    <shape type="cube">
        <transform name="to_world"><scale x="1.5" y="0.3" z="1.5"/><translate y="0.6"/></transform>
        <bsdf type="dielectric"/>
    </shape>
    <emitter type="spot">
        <transform name="to_world"><lookat origin="0, 4, 0" target="0, 0, 0.01" up="0, 0, 1"/></transform>
        <rgb name="intensity" value="20, 20, 20"/>
        <float name="cutoff_angle" value="40"/>
    </emitter>
    <emitter type="constant"><rgb name="radiance" value="0.1, 0.1, 0.1"/></emitter>
</scene>"#;

#[test]
fn light_that_is_never_found_is_no_bias_of_those_that_find_it() {
    let folder = Folder::with(SLAB);
    let finds_all = |options: &str| {
        let (name, trials) = decide_in(&folder, "s.xml", options);
        assert!(["sppm", "vcm"].contains(&name.as_str()), "{options}: {name}, {trials}");
    };
    // A part of a long render, and a limit that the first pilot exceeds.
    finds_all("--spp 65536 --sample-range 0..2");
    finds_all("--time 0.01s");
    // An integrator that the user names says so.
    let run = folder.render("s.xml --integrator path --spp 2 -o path.pfm");
    let note = "does not find light that mirrors and glass send from points, spots and parallel lights";
    assert!(run.stderr.contains(&format!("note: path {note}; sppm does\n")), "{run:?}");
    let run = folder.render("s.xml --integrator bdpt --spp 2 -o bdpt.pfm");
    assert!(
        run.stderr.contains(&format!("note: bdpt {note} where the camera sees it in a mirror")),
        "{run:?}"
    );
    let run = folder.render("s.xml --integrator sppm --spp 2 -o sppm.pfm");
    assert!(!run.stderr.contains("does not find"), "{run:?}");
    // Smooth plastic sends little, and `null` nothing.
    for other in ["plastic", "null"] {
        folder.write("other.xml", SLAB.replace("dielectric", other).as_bytes());
        let run = folder.render("other.xml --integrator path --spp 2 -o other.pfm");
        assert!(!run.stderr.contains("does not find"), "{run:?}");
    }
    // With an emitter that rays can hit, the first pilot may be the only one.
    let spot = SLAB.find("<emitter type=\"spot\">").expect("a spot");
    let sky = SLAB.find("<emitter type=\"constant\">").expect("a sky");
    folder.write("sky.xml", format!("{}{}", &SLAB[..spot], &SLAB[sky..]).as_bytes());
    let (_, trials) = decide_in(&folder, "sky.xml", "--time 0.01s");
    assert_eq!(trials.as_array().map(Vec::len), Some(1), "{trials}");
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

/// The Cornell box.
const CORNELL_BOX: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/scenes/cornell-box/cornell-box.xml");
/// A part of an image of 10^6 samples, and of one of a quarter of these.
const PART: &str = "--size 128x128 --crop 60,60,16,16 --spp 64";
const FEW: &str = "--size 128x128 --crop 60,60,16,16 --spp 16";

/// Renders a scene with `bdpt`; returns the name of the integrator, and what was decided.
fn bdpt(folder: &Folder, scene: &str, options: &str) -> (String, Value) {
    folder.render(&format!("{scene} --integrator bdpt {options} -q -o bdpt.pfm --stats s.json"));
    let stats: Value = serde_json::from_slice(&folder.read("s.json")).expect("JSON");
    (stats["integrator"].as_str().expect("a name").to_owned(), stats["auto"].clone())
}

#[test]
fn connections_that_do_not_pay_are_left_out() {
    let folder = Folder::new();
    let (name, decision) = bdpt(&folder, CORNELL_BOX, PART);
    let names = decision["trials"].as_array().expect("trials").iter().map(|trial| &trial["integrator"]);
    assert_eq!((name.as_str(), &decision["asked"]), ("path", &"bdpt".into()), "{decision}");
    assert_eq!(names.collect::<Vec<_>>(), ["bdpt", "path"]);
    let pixels = folder.read("bdpt.pfm");
    folder.render(&format!("{CORNELL_BOX} --integrator path {PART} -q -o path.pfm"));
    assert!(folder.read("path.pfm") == pixels);
    let run = folder.render(&format!("{CORNELL_BOX} --integrator bdpt {PART} -o a.exr -t 1"));
    let note = "note: bdpt: connections do not pay, path renders the image (error at the same cost: bdpt ";
    assert!(run.stderr.contains(note), "{run:?}");
    // A resumed render and the parts of one keep the choice.
    let sampler = "--sampler independent --seed 1";
    bdpt(&folder, CORNELL_BOX, &format!("{PART} {sampler}"));
    let pixels = folder.read("bdpt.pfm");
    let first = format!("{PART} {sampler} --sample-range 0..8 --checkpoint c");
    assert_eq!(bdpt(&folder, CORNELL_BOX, &first).0, "path");
    let (name, decision) = bdpt(&folder, CORNELL_BOX, &format!("{PART} {sampler} --checkpoint c --resume"));
    assert_eq!((name.as_str(), decision), ("path", Value::Null));
    assert!(folder.read("bdpt.pfm") == pixels);
    // So does one that goes on to fewer samples than are worth pilots.
    assert_eq!(bdpt(&folder, CORNELL_BOX, &first.replace("checkpoint c", "checkpoint d")).0, "path");
    let further = format!("{FEW} {sampler} --checkpoint d --resume");
    assert_eq!(bdpt(&folder, CORNELL_BOX, &further).0, "path");
}

/// Pilots are left out where they would cost too much, where the user wants connections, and where camera paths would
/// not find all light.
#[test]
fn connections_are_kept_where_nothing_else_is_possible() {
    let folder = Folder::new();
    let lights = concat!(env!("CARGO_MANIFEST_DIR"), "/scenes/photon/emitters.xml");
    for (scene, options) in
        [(CORNELL_BOX, FEW), (CORNELL_BOX, &format!("{PART} --bdpt-connections always")), (lights, PART)]
    {
        assert_eq!(bdpt(&folder, scene, options), ("bdpt".into(), Value::Null), "{scene} {options}");
    }
    // Layers of variances are those of bdpt.
    let variances =
        format!("render {CORNELL_BOX} --integrator bdpt {PART} --aov variance -q -o a.exr --stats s.json");
    assert_eq!(folder.run(&variances).code, 0);
    let stats: Value = serde_json::from_slice(&folder.read("s.json")).expect("JSON");
    assert_eq!((&stats["integrator"], &stats["auto"]), (&"bdpt".into(), &Value::Null));
    // Camera paths rarely find the caustics below waves.
    let water = concat!(env!("CARGO_MANIFEST_DIR"), "/scenes/caustics/water.xml");
    let (name, decision) = bdpt(&folder, water, PART);
    assert_eq!(name, "bdpt", "{decision}");
    for (options, expected) in [
        ("--bdpt-connections never", "expected auto or always; without connections, bdpt is path or volpath"),
        ("--integrator path --bdpt-connections always", "--bdpt-connections: expected bdpt, found path"),
        (
            "--integrator auto --bdpt-connections always",
            "--bdpt-connections: auto tries bdpt with connections",
        ),
        (
            "--integrator bdpt --path-reuse never --spp 1024",
            "--path-reuse: bdpt has no paths that are reused; use path",
        ),
        ("--integrator bdpt --adaptive --spp 1024", "--adaptive: bdpt traces paths from the emitters"),
    ] {
        let run = folder.run(&format!("render {CORNELL_BOX} {options} -o a.exr"));
        assert!(run.code == 2 && run.stderr.contains(expected), "{options}: {run:?}");
    }
}

/// A room whose image takes 10^8 rays. Only a corner of it is rendered.
const ROOM: &str = "--integrator auto --size 640x640 --crop 312,312,16,16 --spp 64 --sample-range 0..32 -q";

#[test]
#[ignore = "takes long: make test-all"]
fn a_bias_that_is_allowed_is_measured_and_part_of_the_error() {
    let (folder, scene) = (Folder::new(), CORNELL_BOX);
    let trials = |options: &str| {
        folder.render(&format!("{scene} {ROOM} {options} -o a.exr --stats s.json"));
        let stats: Value = serde_json::from_slice(&folder.read("s.json")).expect("JSON");
        (stats["auto"]["trials"].clone(), stats)
    };
    let (all, _) = trials("--allow-bias 0.1");
    let irrcache = all.as_array().expect("trials").iter().find(|trial| trial["integrator"] == "irrcache");
    let bias = irrcache.expect("a trial")["bias"].as_f64().expect("a bias");
    assert!(bias > 0.0 && bias < 0.05, "{all}");
    assert_eq!(all[0]["bias"], 0.0);
    // Below that it is refused.
    let (all, stats) = trials(&format!("--allow-bias {}", 0.5 * bias));
    assert!(all.to_string().contains("is allowed"), "{all}");
    assert_eq!((&stats["integrator"], &stats["bias"]), (&"path".into(), &Value::Null));
    // If its rays cost little, it is chosen.
    folder.write("costs.json", br#"{"surfaces": {"irrcache": 0.01}}"#);
    let options = "--allow-bias 0.1 --auto-costs costs.json --checkpoint c";
    let (_, stats) = trials(options);
    assert_eq!(stats["integrator"], "irrcache", "{stats}");
    let stated = stats["bias"].as_f64().expect("a bias");
    assert!((stated / bias - 1.0).abs() < 1e-12, "{stated} {bias}");
    let error = |stats: &Value| stats["relmse_interval"][1].as_f64().expect("an error");
    folder.render(&format!("{scene} {} -o b.exr --stats s.json", ROOM.replace("auto", "irrcache")));
    let without: Value = serde_json::from_slice(&folder.read("s.json")).expect("JSON");
    assert_eq!(without["bias"], Value::Null);
    assert!((error(&stats) - error(&without) - stated * stated).abs() < 1e-9, "{stats} {without}");
    let [a, b] = ["a.exr", "b.exr"].map(|name| image::read(&folder.path(name)).expect("an image"));
    assert!(a.data == b.data);
    // Resumed and merged renders know it.
    let (_, resumed) = trials(&format!("{options} --resume"));
    assert_eq!((&resumed["auto"], &resumed["bias"]), (&Value::Null, &stats["bias"]));
    assert_eq!(folder.run("merge c -o merged.exr -q").code, 0);
    let merged = image::read(&folder.path("merged.exr")).expect("an image");
    let known = |image: &image::Image| image.metadata.get("buffon:bias").cloned();
    assert!(known(&merged).is_some() && known(&merged) == known(&a) && known(&b).is_none());
    assert!(folder.run("info c").stdout.contains(", bias "));
    let whole = ROOM.replace("--sample-range 0..32", "--target-error 1e-9");
    let target = folder.run(&format!("render {scene} {whole} --checkpoint c --resume -o d.exr"));
    assert!(target.code == 2 && target.stderr.contains("is more than half of this target"), "{target:?}");
    // A part whose bias nobody has measured does not hide that of the other.
    let other = ROOM.replace("auto", "irrcache").replace("0..32", "32..64");
    folder.render(&format!("{scene} {other} --checkpoint e -o e.exr"));
    for order in ["c e", "e c"] {
        assert_eq!(folder.run(&format!("merge {order} -o both.exr -q")).code, 0);
        assert_eq!(known(&image::read(&folder.path("both.exr")).expect("an image")), known(&a), "{order}");
    }
}

#[test]
fn the_blur_of_photons_is_part_of_the_error() {
    let folder = Folder::of_scene("caustics", "glass-sphere.xml");
    folder.write("costs.json", br#"{"surfaces": {"sppm": 0.01}}"#);
    let render = |integrator: &str| -> Value {
        folder.render(&format!(
            "s.xml --integrator {integrator} --size 48x36 --spp 16 -q -o a.exr --stats s.json"
        ));
        serde_json::from_slice(&folder.read("s.json")).expect("JSON")
    };
    let [chosen, named] = ["auto --auto-costs costs.json", "sppm"].map(render);
    assert_eq!(chosen["integrator"], "sppm", "{chosen}");
    let bias = chosen["bias"].as_f64().expect("a bias");
    assert!(bias > 0.0 && named["bias"].is_null(), "{chosen} {named}");
    let upper = |stats: &Value| stats["relmse_interval"][1].as_f64().expect("an error");
    assert!((upper(&chosen) - upper(&named) - bias * bias).abs() < 1e-9, "{chosen} {named}");
    // It may be half of a target error.
    let target = 1.9 * bias * bias;
    let other = render(&format!("auto --auto-costs costs.json --target-error {target}"));
    assert_ne!(other["integrator"], "sppm", "{other}");
}

/// Rays pass panes with other candidates.
#[test]
fn behind_panes_nothing_with_a_bias_is_chosen() {
    let pane = r#"<shape type="rectangle"><transform name="to_world"><translate z="1"/></transform>
        <bsdf type="thindielectric"/></shape></scene>"#;
    let scene = crate::support::cli::SCENE;
    let emitter = scene.find("<emitter type=\"point\">").expect("a point emitter");
    let end = emitter + scene[emitter..].find("</emitter>").expect("its end") + "</emitter>".len();
    let scene = format!("{}{}", &scene[..emitter], &scene[end..]).replace(r#"value="6""#, r#"value="32""#);
    let folder = Folder::with(&scene.replace("</scene>", pane));
    let (name, trials) = decide_in(&folder, "s.xml", "--allow-bias 0.5 --spp 65536 --sample-range 0..2");
    assert!(!["irrcache", "photonmapper"].contains(&name.as_str()));
    assert_eq!(trials.to_string().matches("do not pass thin panes").count(), 2, "{trials}");
}

#[test]
fn a_scene_may_ask_for_the_choice() {
    let scene = crate::support::cli::SCENE;
    let auto = |parameters: &str| {
        scene.replace(
            r#"<integrator type="path"><integer name="max_depth" value="6"/></integrator>"#,
            &format!(
                r#"<integrator type="auto"><integer name="max_depth" value="6"/>{parameters}</integrator>"#
            ),
        )
    };
    let folder = Folder::with(&auto(r#"<float name="allow_bias" value="0.01"/>"#));
    folder.write("path.xml", scene.as_bytes());
    folder.render("s.xml -q -o a.exr --stats s.json");
    folder.render("path.xml --integrator auto --allow-bias 0.01 -q -o b.exr");
    folder.render("s.xml --integrator path -q -o c.exr");
    folder.render("path.xml -q -o d.exr");
    let [a, b, c, d] = ["a", "b", "c", "d"]
        .map(|name| image::read(&folder.path(&format!("{name}.exr"))).expect("an image").data);
    assert!(a == b && c == d);
    let stats: Value = serde_json::from_slice(&folder.read("s.json")).expect("JSON");
    let refused = "the image takes too few rays to pay for a pilot of it";
    assert_eq!(stats["auto"]["trials"].to_string().matches(refused).count(), 2, "{stats}");
    assert!(folder.run("info s.xml --no-pilot").stdout.contains("auto"));
    for (parameters, sentence) in [
        (r#"<float name="allow_bias" value="2"/>"#, "expected a number between 0 and 1"),
        (r#"<float name="alow_bias" value=".1"/>"#, "did you mean \"allow_bias\"?"),
    ] {
        folder.write("wrong.xml", auto(parameters).as_bytes());
        let run = folder.run("render wrong.xml -o e.exr --strict");
        assert!(run.code != 0 && run.stderr.contains(sentence), "{run:?}");
    }
    let nested = auto("")
        .replace("type=\"auto\"", "type=\"moment\"")
        .replace("<integer name=\"max_depth\" value=\"6\"/>", "<integrator type=\"auto\"/>");
    folder.write("wrong.xml", nested.as_bytes());
    let run = folder.run("render wrong.xml -o e.exr");
    assert!(run.code != 0 && run.stderr.contains("is not inside another one"), "{run:?}");
}

#[test]
fn wrong_options_of_the_choice_are_explained() {
    let folder = Folder::new();
    for (name, text) in [
        ("text.json", "path 1"),
        ("name.json", r#"{"surfaces": {"pth": 1}}"#),
        ("zero.json", r#"{"media": {"bdpt": 0}}"#),
        ("table.json", r#"{"surface": {}}"#),
        ("unit.json", r#"{"surfaces": {"path": 2}}"#),
        ("empty.json", "{}"),
    ] {
        folder.write(name, text.as_bytes());
    }
    for (options, sentence) in [
        ("--allow-bias 0.01", "--allow-bias: only --integrator auto measures a bias"),
        ("--integrator irrcache --allow-bias 0.01", "--allow-bias: only --integrator auto measures a bias"),
        ("--integrator auto --allow-bias 1", "expected a number between 0 and 1"),
        ("--integrator auto --cache c", "--cache: expected the name of an integrator, found auto"),
        ("--integrator auto --allow-bias -0.1", "expected a number between 0 and 1"),
        ("--integrator path --auto-costs empty.json", "--auto-costs: only --integrator auto compares costs"),
        ("--integrator auto --auto-costs unit.json", "of path, which is the unit: expected 1"),
        ("--integrator auto --auto-costs none.json", "none.json: cannot be read"),
        ("--integrator auto --auto-costs text.json", "text.json: is no table of costs"),
        ("--integrator auto --auto-costs name.json", "never chosen (did you mean \"path\"?)"),
        ("--integrator auto --auto-costs zero.json", "expected a positive number"),
        ("--integrator auto --auto-costs table.json", "is no table of costs"),
    ] {
        let run = folder.run(&format!("render s.xml -o a.exr {options}"));
        assert!(run.code == 2 && run.stderr.contains(sentence), "{options}: {run:?}");
    }
}
