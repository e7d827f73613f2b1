//! Progressive photon mapping, compared with path tracing and light tracing.

use crate::support::cli::{Folder, SCENE};

/// Returns a folder with a scene of the repository as `s.xml`. In `sppm.xml` it has radii so small that their blur is
/// below the noise of a small image.
fn own_scene(topic: &str, name: &str) -> Folder {
    let folder = Folder::of_scene(topic, name);
    let text = String::from_utf8(folder.read("s.xml")).expect("text");
    folder.write("sppm.xml", with_photons(&text).as_bytes());
    folder
}

/// Replaces the integrator of a scene by `sppm`.
fn with_photons(scene: &str) -> String {
    let start = scene.find("<integrator type=").expect("an integrator");
    let end = start + scene[start..].find('>').expect("its tag ends") + 1;
    let sppm = "<integrator type=\"sppm\"><float name=\"initial_radius\" value=\"$radius\"/>\
                <integer name=\"photon_count\" value=\"$count\"/><boolean name=\"guided\" value=\"$guided\"/>";
    let defaults = "<default name=\"radius\" value=\"0.02\"/><default name=\"count\" value=\"10000\"/>\
                    <default name=\"guided\" value=\"true\"/>";
    format!("{}{defaults}{sppm}{}", &scene[..start], &scene[end..])
}

/// A scene in which path tracing finds all light: a large emitter, a mirror, polished metal, coated plastic.
const ROOM: &str = r#"<scene version="3.0.0">
  <integrator type="path"><integer name="max_depth" value="7"/></integrator>
  <sensor type="perspective">
    <float name="fov" value="60"/>
    <transform name="to_world"><lookat origin="0,1.2,3.4" target="0,0.7,0" up="0,1,0"/></transform>
    <film type="hdrfilm">
      <integer name="width" value="24"/><integer name="height" value="18"/>
      <string name="component_format" value="float32"/><rfilter type="box"/>
    </film>
  </sensor>
  <shape type="cube">
    <transform name="to_world"><scale x="2" y="1.5" z="4"/><translate y="1.5"/></transform>
    <bsdf type="twosided"><bsdf type="diffuse"><rgb name="reflectance" value="0.7,0.6,0.5"/></bsdf></bsdf>
  </shape>
  <shape type="rectangle">
    <transform name="to_world"><rotate x="1" angle="90"/><scale value="0.9"/><translate y="2.9"/></transform>
    <emitter type="area"><rgb name="radiance" value="4"/></emitter>
  </shape>
  <shape type="rectangle">
    <transform name="to_world"><rotate y="1" angle="35"/><translate x="-0.9" y="1" z="-0.8"/></transform>
    <bsdf type="twosided"><bsdf type="conductor"/></bsdf>
  </shape>
  <shape type="sphere">
    <point name="center" value="0.3,0.4,0.4"/><float name="radius" value="0.4"/>
    <bsdf type="roughconductor"><float name="alpha" value="0.1"/></bsdf>
  </shape>
  <shape type="sphere">
    <point name="center" value="1.1,0.4,0"/><float name="radius" value="0.4"/>
    <bsdf type="plastic"><rgb name="diffuse_reflectance" value="0.1,0.3,0.6"/></bsdf>
  </shape>
</scene>
"#;

fn agree(folder: &Folder, one: &str, other: &str) {
    let run = folder.run(&format!("diff {one} {other} --z"));
    assert_eq!(run.code, 0, "{one} and {other}: {}{}", run.stdout, run.stderr);
}

/// Camera paths, light paths and photons give the same image.
#[test]
#[ignore = "takes long: make test-all"]
fn three_integrators_agree_on_every_kind_of_light() {
    for (topic, name, size) in [("photon", "emitters.xml", "52x28"), ("light-tracing", "lights.xml", "32x24")]
    {
        let folder = own_scene(topic, name);
        let common = format!("-q --size {size} --aov variance");
        folder.render(&format!("s.xml {common} --integrator path --seed 1 --spp 1024 -o path.exr"));
        folder.render(&format!("s.xml {common} --integrator ptracer --seed 2 --spp 1024 -o light.exr"));
        folder.render(&format!("sppm.xml {common} --seed 4 --spp 192 -o sppm.exr"));
        agree(&folder, "path.exr", "sppm.exr");
        agree(&folder, "light.exr", "sppm.exr");
    }
}

/// With mirrors, glossy and coated surfaces, every part of the light is counted once. With short paths, photons and
/// camera paths share the edges.
#[test]
fn no_light_is_counted_twice_or_lost() {
    for depth in [3, 4, 7] {
        let room = ROOM.replace("value=\"7\"", &format!("value=\"{depth}\""));
        let folder = Folder::with(&room);
        folder.write("sppm.xml", with_photons(&room).as_bytes());
        folder.render("s.xml -q --aov variance --seed 1 --spp 1024 -o path.exr");
        folder.render("sppm.xml -q --aov variance -D radius=0.06 --seed 2 --spp 128 -o sppm.exr");
        agree(&folder, "path.exr", "sppm.exr");
    }
}

/// The guide depends on the view, but the expected image does not.
#[test]
fn guided_and_unguided_paths_make_one_picture() {
    let folder = Folder::with(&with_photons(ROOM));
    for (guided, seed) in [("true", 1), ("false", 2)] {
        folder.render(&format!(
            "s.xml -q --aov variance -D guided={guided} -D radius=0.2 -D count=1000 --seed {seed} --spp 256 -o {guided}.exr"
        ));
    }
    agree(&folder, "true.exr", "false.exr");
    assert_ne!(folder.read("true.exr"), folder.read("false.exr"));
}

/// Values do not depend on threads or crops.
#[test]
fn pixels_do_not_depend_on_threads_or_crops() {
    let folder = Folder::new();
    let picture = |name: &str, options: &str| {
        folder.render(&format!("s.xml -q --integrator sppm --spp 7 -o {name}.exr {options}"));
        buffon::image::read(&folder.path(&format!("{name}.exr"))).expect("an image")
    };
    let once = picture("1", "-t 1");
    assert!(once.data.iter().any(|v| *v > 0.0));
    for threads in [2, 5] {
        assert!(picture("again", &format!("-t {threads}")).data == once.data, "{threads} threads");
    }
    let crop = picture("crop", "--crop 7,5,20,19");
    assert!(crop.data == once.crop(7, 5, 20, 19).expect("the crop is inside").data);
    assert!(picture("seed", "--seed 1").data != once.data);
}

/// A point emitter and glass give a caustic that no camera path finds.
#[test]
fn caustics_of_point_lights_are_there() {
    let light =
        SCENE.find("<shape type=\"rectangle\">\n    <transform name=\"to_world\"><rotate").expect("a lamp");
    let after = light + SCENE[light..].find("</shape>").expect("its end") + "</shape>".len();
    let scene = format!("{}{}", &SCENE[..light], &SCENE[after..]);
    let folder = Folder::with(
        &scene.replace("<emitter type=\"constant\"><rgb name=\"radiance\" value=\"0.2\"/></emitter>", ""),
    );
    let mean = |integrator: &str| {
        let file = format!("{integrator}.exr");
        folder.render(&format!("s.xml -q --integrator {integrator} --spp 64 -o {file}"));
        let image = buffon::image::read(&folder.path(&file)).expect("an image");
        image.data.iter().map(|v| f64::from(*v)).sum::<f64>() / image.data.len() as f64
    };
    let (path, sppm) = (mean("path"), mean("sppm"));
    assert!(sppm > 1.01 * path, "{sppm} {path}");
}

/// Invalid parameters are refused, and the error names them.
#[test]
fn mistakes_are_named() {
    let folder = Folder::new();
    let with = |text: &str| {
        let scene = SCENE.replace(
            "<integrator type=\"path\"><integer name=\"max_depth\" value=\"6\"/></integrator>",
            &format!("<integrator type=\"sppm\">{text}</integrator>"),
        );
        assert_ne!(scene, SCENE);
        folder.write("s.xml", scene.as_bytes());
        folder.run("render s.xml -q --spp 2 -o o.exr")
    };
    for (text, part) in [
        ("<float name=\"alpha\" value=\"0\"/>", "expected a number above 0 and at most 1, found 0"),
        ("<float name=\"alpha\" value=\"1.5\"/>", "expected a number above 0 and at most 1, found 1.5"),
        ("<float name=\"initial_radius\" value=\"-1\"/>", "or 0 for three widths of a pixel, found -1"),
        ("<integer name=\"photon_count\" value=\"-5\"/>", "photon_count"),
    ] {
        let run = with(text);
        assert!(run.code == 3 && run.stderr.contains(part), "{text}: {} {}", run.code, run.stderr);
    }
    let run =
        with("<integer name=\"granularity\" value=\"100\"/><integer name=\"photon_count\" value=\"1000\"/>");
    assert_eq!(run.code, 0, "{}", run.stderr);
    let run = folder.run("render s.xml -q --spp 2 --adaptive -o o.exr");
    assert!(
        run.code == 2 && run.stderr.contains("--adaptive: sppm traces paths for all pixels"),
        "{}",
        run.stderr
    );
}
