//! Caustics by light paths have no bias, have less noise, and depend neither on threads nor on crops.

use crate::path_reuse::{blocks, expect_same_of, from_xml, limited};
use crate::support::cli::Folder;
use buffon::integrator::Settings;
use buffon::integrator::settings::{PathLimits, PathSettings, WhenPays};

pub const FLOOR: &str = "<shape type='rectangle'>\
    <transform name='to_world'><rotate x='1' angle='-90'/><scale value='2'/></transform>\
    <bsdf type='roughplastic'><float name='alpha' value='0.3'/></bsdf></shape>";
pub const GLASS: &str = "<shape type='sphere'><point name='center' x='0' y='0.7' z='0'/><float name='radius' value='0.4'/>\
    <bsdf type='dielectric'/></shape>";
/// Surfaces with a Dirac delta beside a finite lobe, or a mirror on one side.
pub const OTHERS: &str = "<shape type='sphere'><point name='center' x='-0.8' y='0.3' z='0.3'/>\
    <float name='radius' value='0.3'/><bsdf type='plastic'/></shape>\
    <shape type='rectangle'><transform name='to_world'><scale x='0.5' y='0.4'/><rotate y='1' angle='-60'/>\
    <translate x='1.1' y='0.5'/></transform><bsdf type='twosided'><bsdf type='conductor'/>\
    <bsdf type='diffuse'/></bsdf></shape>\
    <shape type='rectangle'><transform name='to_world'><scale value='0.3'/><translate x='-0.6' y='0.7' z='-0.8'/>\
    </transform><bsdf type='thindielectric'/></shape>";
pub const LAMP: &str = "<shape type='sphere'><point name='center' x='0.3' y='2.4' z='0'/>\
    <float name='radius' value='0.25'/><emitter type='area'><rgb name='radiance' value='20, 15, 10'/></emitter>\
    </shape>";

const SKY: &str = "<emitter type='constant'><rgb name='radiance' value='0.6, 0.7, 0.9'/></emitter>";
/// A sphere and a rectangle that emit inside the balls of glass.
const INSIDE: &str = "<shape type='sphere'><point name='center' x='0.1' y='0.7' z='0'/><float name='radius' value='0.1'/>\
    <emitter type='area'><rgb name='radiance' value='30'/></emitter></shape>\
    <shape type='rectangle'><transform name='to_world'><scale value='0.1'/><rotate x='1' angle='70'/>\
    <translate x='-0.6' y='1' z='0.6'/></transform><emitter type='area'><rgb name='radiance' value='20, 30, 40'/>\
    </emitter></shape>";
/// Two instances of a ball of glass.
const INSTANCES: &str = "<shape type='shapegroup' id='balls'><shape type='sphere'><float name='radius' value='0.2'/>\
    <bsdf type='dielectric'/></shape></shape>\
    <shape type='instance'><ref id='balls'/><transform name='to_world'><translate x='-0.6' y='1' z='0.6'/></transform>\
    </shape><shape type='instance'><ref id='balls'/><transform name='to_world'><scale x='2' y='1' z='1'/>\
    <translate x='0.9' y='0.3' z='0.8'/></transform></shape>";

fn path(reuse: WhenPays, caustics: WhenPays, limits: PathLimits) -> Settings {
    Settings::Path(PathSettings { reuse, caustics, ..PathSettings::independent(limits) })
}

/// Area emitters of two kinds, an environment that is brighter above, and a point light whose caustics no camera path
/// can find: the expectation is that of camera paths.
#[test]
fn light_paths_do_not_change_the_expectation() {
    let small = "<shape type='rectangle'><transform name='to_world'><rotate x='1' angle='90'/><scale value='0.4'/>\
        <translate x='-0.3' y='2.2' z='0.2'/></transform>\
        <emitter type='area'><rgb name='radiance' value='12'/></emitter></shape>";
    let point = "<emitter type='point'><point name='position' x='-1' y='2' z='1'/>\
        <rgb name='intensity' value='6'/></emitter>";
    for (name, emitters) in [
        ("sphere and rectangle", format!("{LAMP}{small}")),
        ("sky", SKY.to_string()),
        ("point and sphere", format!("{point}{LAMP}")),
        ("lamps inside glass and instances", format!("{INSIDE}{INSTANCES}")),
    ] {
        let scene = from_xml(&format!("{FLOOR}{GLASS}{OTHERS}{emitters}"), 16);
        for reuse in [WhenPays::Never, WhenPays::Always] {
            let both = [WhenPays::Always, WhenPays::Never].map(|caustics| path(reuse, caustics, limited(6)));
            expect_same_of(&format!("{name}, reuse {reuse:?}"), &scene, &both, 16, 64);
        }
    }
}

/// With the least number of edges at which a caustic exists, and with one more than paths may have.
#[test]
fn the_greatest_number_of_edges_counts_for_light_paths_too() {
    let scene = from_xml(&format!("{FLOOR}{GLASS}{OTHERS}{LAMP}"), 16);
    for edges in [2, 3, 4] {
        let both = [WhenPays::Always, WhenPays::Never]
            .map(|caustics| path(WhenPays::Never, caustics, limited(edges)));
        expect_same_of(&format!("{edges} edges"), &scene, &both, 16, 32);
    }
}

/// bdpt finds the caustic of a small lamp with little noise, camera paths hardly at all.
#[test]
fn light_paths_find_the_caustics_of_small_lamps() {
    let lamp = LAMP.replace("'0.25'", "'0.02'").replace("20, 15, 10", "3000, 2500, 1500");
    let scene = from_xml(&format!("{FLOOR}{GLASS}{OTHERS}{lamp}"), 16);
    let bdpt = Settings::by_name("bdpt", limited(4)).expect("it exists");
    // Four edges: the caustics of the lamp on the floor, whose light has not been scattered by another surface.
    let found = path(WhenPays::Never, WhenPays::Always, limited(4));
    expect_same_of("small lamp", &scene, &[found.clone(), bdpt], 16, 64);
    let noise = |settings: &Settings| {
        blocks(&scene, settings, 16, 0..8, 64).iter().map(|[_, variance]| variance).sum::<f64>()
    };
    let camera_paths = path(WhenPays::Never, WhenPays::Never, limited(4));
    let noise = [found, camera_paths].map(|settings| noise(&settings));
    assert!(noise[0] < 0.1 * noise[1], "{noise:?}");
}

const WALL: &str = "<shape type='rectangle'><transform name='to_world'><scale value='2'/><translate y='1.5' z='-1'/>\
    </transform><bsdf type='twosided'><bsdf type='diffuse'/></bsdf></shape>";

/// The caustic on the floor lights the wall, which may light the floor again.
#[test]
fn light_paths_find_surfaces_that_caustics_light() {
    let lamp = LAMP.replace("'0.25'", "'0.02'").replace("20, 15, 10", "3000, 2500, 1500");
    let scene = from_xml(&format!("{FLOOR}{GLASS}{WALL}{lamp}"), 16);
    let bdpt = Settings::by_name("bdpt", limited(6)).expect("it exists");
    let found = path(WhenPays::Never, WhenPays::Always, limited(6));
    expect_same_of("small lamp", &scene, &[found.clone(), bdpt], 16, 64);
    let folder = Folder::with(&format!("<scene version='3.0.0'>{FLOOR}{GLASS}{WALL}{lamp}</scene>"));
    let surfaces =
        |options: &str| prepared(&folder, "s.xml --size 60x40 --spp 8 -o a.pfm", options, "caustic_surfaces");
    assert_eq!(surfaces("--path-reuse never"), 3.0);
    assert_eq!(surfaces("--path-reuse always"), 1.0);
    assert_eq!(surfaces("--path-caustics never"), 0.0);
}

fn scene() -> Folder {
    let lamp = LAMP.replace("'0.25'", "'0.05'").replace("20, 15, 10", "500");
    Folder::with(&format!("<scene version='3.0.0'>{FLOOR}{GLASS}{lamp}</scene>"))
}

fn light_paths(folder: &Folder, options: &str) -> f64 {
    light_paths_in(folder, "s.xml --size 60x40", options)
}

fn light_paths_in(folder: &Folder, scene: &str, options: &str) -> f64 {
    prepared(folder, scene, options, "caustic_light_paths")
}

fn prepared(folder: &Folder, scene: &str, options: &str, name: &str) -> f64 {
    folder.render(&format!("{scene} -q --stats a.json {options}"));
    let stats: serde_json::Value = serde_json::from_slice(&folder.read("a.json")).expect("JSON");
    stats["prepared"][name].as_f64().expect("a number")
}

#[test]
fn a_pilot_decides_and_threads_crops_and_ranges_do_not_matter() {
    let folder = scene();
    assert!(light_paths(&folder, "--spp 8 -o a.pfm --threads 1") > 0.0);
    assert_eq!(light_paths(&folder, "--spp 8 -o never.pfm --path-caustics never"), 0.0);
    assert!(folder.read("a.pfm") != folder.read("never.pfm"));
    light_paths(&folder, "--spp 8 -o b.pfm --threads 3");
    assert!(folder.read("a.pfm") == folder.read("b.pfm"));
    for range in ["0..4", "4..8"] {
        let name = range.replace("..", "-");
        light_paths(&folder, &format!("--spp 8 -o c.pfm --sample-range {range} --checkpoint {name}.ckpt"));
    }
    let merged = folder.run("merge 0-4.ckpt 4-8.ckpt -o merged.pfm -q");
    assert_eq!(merged.code, 0, "{}", merged.stderr);
    assert!(folder.read("a.pfm") == folder.read("merged.pfm"));
}

/// No light comes through glass if there is none, and none is found that the camera does not see.
#[test]
fn scenes_without_caustics_have_no_light_paths() {
    let folder = Folder::with(&format!("<scene version='3.0.0'>{FLOOR}{LAMP}</scene>"));
    assert_eq!(light_paths(&folder, "--spp 4 -o a.pfm"), 0.0);
    assert_eq!(light_paths(&folder, "--spp 4 -o a.pfm --path-caustics always"), 0.0);
}

/// Light paths that find little are left out: under a uniform sky, the ball of glass makes hardly any caustic.
#[test]
fn light_paths_that_find_little_are_left_out() {
    let folder = Folder::with(&format!("<scene version='3.0.0'>{FLOOR}{GLASS}{SKY}</scene>"));
    for seed in [0, 2, 3] {
        let options = format!("--spp 2 --seed {seed} -o a.pfm");
        assert_eq!(light_paths_in(&folder, "s.xml --size 96x64", &options), 0.0);
    }
}

/// Glass that is too small for a ray to hit leaves the light paths to other glass as they are.
#[test]
fn glass_without_a_size_is_no_target() {
    let point = "<shape type='sphere'><float name='radius' value='1e-20'/><bsdf type='dielectric'/></shape>";
    let triangle =
        "<shape type='obj'><string name='filename' value='point.obj'/><bsdf type='dielectric'/></shape>";
    for small in ["", point, triangle] {
        let folder = Folder::with(&format!("<scene version='3.0.0'>{FLOOR}{GLASS}{small}{SKY}</scene>"));
        folder.write("point.obj", b"v 0 1 0\nv 0 1 0\nv 0 1 0\nf 1 2 3\n");
        assert!(light_paths(&folder, "--spp 4 -o a.pfm --path-caustics always") > 0.0, "{small}");
    }
}

/// A render that began with `--adaptive` is continued without naming it again.
#[test]
fn a_resumed_adaptive_render_has_no_light_paths() {
    let folder = scene();
    assert_eq!(light_paths(&folder, "--spp 12 -o a.pfm --adaptive --checkpoint r.ckpt"), 0.0);
    assert_eq!(light_paths(&folder, "--spp 24 -o a.pfm --checkpoint r.ckpt --resume"), 0.0);
    light_paths(&folder, "--spp 24 -o whole.pfm --adaptive");
    assert!(folder.read("a.pfm") == folder.read("whole.pfm"));
}

/// What needs pixels with independent errors or numbers of samples turns light paths off, and contradicts `always`.
#[test]
fn some_options_exclude_light_paths() {
    let folder = scene();
    for options in ["--path-guiding", "--adaptive", "--aov variance"] {
        let options = format!("--spp 4 -o a.exr {options}");
        assert_eq!(light_paths(&folder, &options), 0.0, "{options}");
        let run = folder.run(&format!("render s.xml -q {options} --path-caustics always"));
        assert_eq!(run.code, 2, "{options}");
        let start = "buffon: path_caustics always: ";
        assert!(run.stderr.starts_with(start) && run.stderr.ends_with("; use auto\n"), "{}", run.stderr);
    }
    let run = folder.run("render s.xml -q -o a.exr --integrator bdpt --path-caustics auto");
    let expected = "buffon: --path-caustics: bdpt has no paths that are added for caustics; use path\n";
    assert_eq!((run.code, run.stderr.as_str()), (2, expected));
}
