//! Path guiding has no bias, finds caustics, and does not depend on threads.

use crate::path_reuse::{blocks, expect_same_of, from_xml, limited};
use crate::support::cli::Folder;
use buffon::integrator::Settings;
use buffon::integrator::settings::{PathLimits, PathSettings, WhenPays};

/// A small lamp behind a ball of glass and a plastic one, on a diffuse floor: the light through the ball is a caustic.
const CAUSTIC: &str = "<shape type='rectangle'>\
    <transform name='to_world'><rotate x='1' angle='-90'/><scale value='2'/></transform>\
    <bsdf type='diffuse'><rgb name='reflectance' value='0.7, 0.6, 0.5'/></bsdf></shape>\
    <shape type='sphere'><point name='center' x='0' y='0.7' z='0'/><float name='radius' value='0.4'/>\
    <bsdf type='dielectric'/></shape>\
    <shape type='sphere'><point name='center' x='-0.8' y='0.3' z='0.3'/><float name='radius' value='0.3'/>\
    <bsdf type='plastic'/></shape>\
    <shape type='sphere'><point name='center' x='0.3' y='2.4' z='0'/><float name='radius' value='0.25'/>\
    <emitter type='area'><rgb name='radiance' value='20'/></emitter></shape>";

fn path(guided: bool, reuse: WhenPays, limits: PathLimits) -> Settings {
    Settings::Path(PathSettings { reuse, guided, ..PathSettings::independent(limits) })
}

/// With reuse, because guided points and shared points are then side by side.
#[test]
fn guiding_is_unbiased() {
    let scene = from_xml(CAUSTIC, 16);
    // Light paths find the caustic with little noise.
    let bdpt = Settings::by_name("bdpt", limited(6)).expect("it exists");
    expect_same_of("caustic", &scene, &[path(true, WhenPays::Always, limited(6)), bdpt], 16, 32);
}

/// With a smaller lamp of the same power, the sum of the variances of blocks is at most a third.
#[test]
fn guiding_reduces_the_noise_of_caustics() {
    let scene = from_xml(&CAUSTIC.replace("'0.25'", "'0.05'").replace("'20'", "'500'"), 16);
    let [guided, unguided] = [true, false].map(|guided| {
        let blocks = blocks(&scene, &path(guided, WhenPays::Never, limited(6)), 16, 0..8, 64);
        blocks.iter().map(|[_, variance]| variance).sum::<f64>()
    });
    assert!(guided < unguided / 3.0, "{guided} {unguided}");
}

#[test]
fn guiding_is_an_option_of_path_and_does_not_depend_on_threads() {
    let folder = Folder::with(&format!("<scene version='3.0.0'>{CAUSTIC}</scene>"));
    let cells = |options: &str| {
        folder.render(&format!("s.xml --size 40x30 --spp 4 -q --stats a.json {options}"));
        let stats: serde_json::Value = serde_json::from_slice(&folder.read("a.json")).expect("JSON");
        stats["prepared"]["guided_cells"].as_f64().expect("a number")
    };
    assert_eq!(cells("-o a.pfm"), 0.0);
    assert!(cells("-o b.pfm --path-guiding --threads 1") > 0.0);
    assert!(cells("-o c.pfm --path-guiding --threads 3") > 0.0);
    assert!(folder.read("b.pfm") == folder.read("c.pfm"));
    assert!(folder.read("a.pfm") != folder.read("b.pfm"));
    let run = folder.run("render s.xml -q -o d.pfm --integrator ptracer --path-guiding");
    let expected = "buffon: --path-guiding: ptracer has no paths that are guided; use path\n";
    assert_eq!((run.code, run.stderr.as_str()), (2, expected));
}
