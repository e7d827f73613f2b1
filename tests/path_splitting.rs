//! Splitting at the first surface has no bias, has less noise where a pilot chooses it, and depends neither on threads
//! nor on crops.

use crate::path_caustics::{FLOOR, GLASS, LAMP, OTHERS};
use crate::path_reuse::{blocks, expect_same_of, from_xml, limited};
use crate::support::cli::Folder;
use buffon::integrator::Settings;
use buffon::integrator::settings::{PathLimits, PathSettings, WhenPays};

const BAR: &str = "<shape type='rectangle'><transform name='to_world'><rotate x='1' angle='90'/>\
    <scale x='1' y='0.2'/><translate y='2'/></transform>\
    <emitter type='area'><rgb name='radiance' value='6, 5, 4'/></emitter></shape>";
const SKY: &str = "<emitter type='constant'><rgb name='radiance' value='0.3, 0.4, 0.5'/></emitter>";
const POINT: &str = "<emitter type='point'><point name='position' x='-1' y='2' z='1'/>\
    <rgb name='intensity' value='6'/></emitter>";

fn path(splitting: WhenPays, caustics: WhenPays, limits: PathLimits) -> Settings {
    Settings::Path(PathSettings { splitting, caustics, ..PathSettings::independent(limits) })
}

/// Emitters of all kinds, and surfaces with and without Dirac deltas, with and without light paths for caustics.
#[test]
fn splitting_does_not_change_the_expectation() {
    for (name, emitters) in [
        ("lamps and sky", format!("{LAMP}{BAR}{SKY}")),
        ("point and sky", format!("{POINT}{SKY}")),
        ("lamp", LAMP.to_string()),
    ] {
        let scene = from_xml(&format!("{FLOOR}{GLASS}{OTHERS}{emitters}"), 16);
        for caustics in [WhenPays::Never, WhenPays::Always] {
            let both = [(WhenPays::Always, caustics), (WhenPays::Never, WhenPays::Never)]
                .map(|(splitting, caustics)| path(splitting, caustics, limited(6)));
            expect_same_of(&format!("{name}, light paths {caustics:?}"), &scene, &both, 16, 32);
        }
    }
}

/// With the least number of edges at which there is something to split, and with Russian roulette at the first surface.
#[test]
fn the_limits_of_paths_hold_for_split_paths() {
    let scene = from_xml(&format!("{FLOOR}{GLASS}{OTHERS}{LAMP}{SKY}"), 16);
    let hidden = PathLimits { hide_emitters: true, ..limited(5) };
    for limits in [limited(1), limited(2), limited(3), PathLimits { rr_depth: 1, ..limited(5) }, hidden] {
        let both =
            [WhenPays::Always, WhenPays::Never].map(|splitting| path(splitting, WhenPays::Never, limits));
        expect_same_of(&format!("{limits:?}"), &scene, &both, 16, 32);
    }
}

/// Two directions would halve the variance if all noise came from the directions.
#[test]
fn split_paths_have_less_noise() {
    let scene = from_xml(&format!("{FLOOR}{SKY}"), 16);
    let noise = |splitting| {
        let settings = path(splitting, WhenPays::Never, limited(3));
        blocks(&scene, &settings, 16, 0..8, 64).iter().map(|[_, variance]| variance).sum::<f64>()
    };
    let noise = [WhenPays::Always, WhenPays::Never].map(noise);
    assert!(noise[0] < 0.6 * noise[1], "{noise:?}");
}

/// A scene under a sky, with other emitters.
fn scene(emitters: &str) -> Folder {
    let cube = "<shape type='cube'><transform name='to_world'><scale value='0.3'/>\
        <translate x='1' y='0.3' z='0.4'/></transform></shape>";
    let sensor = "<sensor type='perspective'><float name='fov' value='45'/><transform name='to_world'>\
        <lookat origin='0, 2, 4' target='0, 0.3, 0' up='0, 1, 0'/></transform></sensor>";
    Folder::with(&format!("<scene version='3.0.0'>{sensor}{FLOOR}{cube}{emitters}{SKY}</scene>"))
}

fn prepared(folder: &Folder, options: &str) -> [f64; 2] {
    folder.render(&format!("s.xml --size 60x40 -q --stats a.json --path-reuse never {options}"));
    let stats: serde_json::Value = serde_json::from_slice(&folder.read("a.json")).expect("JSON");
    ["emitter_samples", "directions"].map(|name| stats["prepared"][name].as_f64().expect("a number"))
}

#[test]
fn a_pilot_decides_and_threads_and_ranges_do_not_matter() {
    let folder = scene("");
    let counts = prepared(&folder, "--spp 8 -o a.pfm --threads 1");
    assert!(counts.iter().any(|&count| count > 1.0), "{counts:?}");
    assert_eq!(prepared(&folder, "--spp 8 -o never.pfm --path-splitting never"), [1.0; 2]);
    assert!(folder.read("a.pfm") != folder.read("never.pfm"));
    assert_eq!(prepared(&folder, "--spp 8 -o b.pfm --threads 3"), counts);
    assert!(folder.read("a.pfm") == folder.read("b.pfm"));
    for range in ["0..4", "4..8"] {
        let name = range.replace("..", "-");
        prepared(&folder, &format!("--spp 8 -o c.pfm --sample-range {range} --checkpoint {name}.ckpt"));
    }
    let merged = folder.run("merge 0-4.ckpt 4-8.ckpt -o merged.pfm -q");
    assert_eq!(merged.code, 0, "{}", merged.stderr);
    assert!(folder.read("a.pfm") == folder.read("merged.pfm"));
}

/// Every sampler has a way to split its samples.
#[test]
fn all_samplers_split_their_samples() {
    let bar = "<shape type='rectangle'><transform name='to_world'><rotate x='1' angle='90'/>\
        <scale x='0.2' y='1'/><translate x='-1' y='1.5'/></transform>\
        <emitter type='area'><rgb name='radiance' value='2, 4, 6'/></emitter></shape>";
    let folder = scene(&format!("{BAR}{bar}"));
    let mean = |options: &str| {
        folder.render(&format!("s.xml --size 24x16 -q -o a.pfm --path-reuse never {options}"));
        let image = folder.read("a.pfm");
        let values = image[image.len() - 24 * 16 * 12..].as_chunks::<4>().0;
        values.iter().map(|bytes| f64::from(f32::from_le_bytes(*bytes))).sum::<f64>()
    };
    let expected = mean("--spp 512 --path-splitting never");
    for sampler in ["independent", "stratified", "multijitter", "halton", "sobol", "zsobol", "fixed"] {
        let ratio = mean(&format!("--spp 64 --path-splitting always --sampler {sampler}")) / expected;
        assert!((ratio - 1.0).abs() < 0.01, "{sampler}: {ratio}");
    }
}

#[test]
fn other_integrators_refuse_the_option() {
    let folder = Folder::new();
    let run = folder.run("render s.xml --spp 1 -q -o a.exr --integrator direct --path-splitting auto");
    let expected = "buffon: --path-splitting: direct has no paths that are split; use path\n";
    assert_eq!((run.code, run.stderr.as_str()), (2, expected));
}

/// Surfaces in motion have no reuse, whether a pilot runs or not.
#[test]
fn nothing_is_reused_in_motion() {
    let moving = "<shape type='sphere'><animation name='to_world'><transform time='0'><translate x='0' y='0.5'/>\
        </transform><transform time='1'><translate x='0.5' y='0.5'/></transform></animation></shape>";
    let sensor = "<sensor type='perspective'><float name='shutter_close' value='1'/></sensor>";
    let folder = Folder::with(&format!("<scene version='3.0.0'>{sensor}{FLOOR}{moving}{SKY}</scene>"));
    for splitting in ["never", "auto"] {
        let options = format!("--path-reuse always --path-splitting {splitting} --path-caustics never");
        folder.render(&format!("s.xml --spp 4 --size 32x24 -q -o a.pfm --stats a.json {options}"));
        let stats: serde_json::Value = serde_json::from_slice(&folder.read("a.json")).expect("JSON");
        assert_eq!(stats["prepared"]["path_reuse"], 0.0, "{splitting}");
    }
}
