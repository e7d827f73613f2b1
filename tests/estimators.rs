//! Agreement of two estimators of the same image, in scenes in which one of them could easily be wrong.

use crate::support::cli::Folder;
use buffon::compare::z_test;
use buffon::image::{Image, read};
use std::ops::RangeInclusive;

/// The probability that a correct pair of images is rejected.
const SIGNIFICANCE: f64 = 1e-5;
/// Upper bound on the detectable bias of every comparison; a larger one is found with a probability of 0.95.
const FOUND: f64 = 0.05;

/// Returns a scene of 16×16 pixels with a box filter.
fn scene(sensor: &str, things: &str) -> String {
    format!(
        r#"<scene version="3.0.0">
  <default name="filter" value="box"/>
  <integrator type="path"><integer name="max_depth" value="5"/></integrator>
  {sensor}
    <film type="hdrfilm">
      <integer name="width" value="16"/><integer name="height" value="16"/>
      <string name="pixel_format" value="rgb"/><string name="component_format" value="float32"/>
      <rfilter type="$filter"/>
    </film>
  </sensor>
  {things}
</scene>"#
    )
}

/// A camera above a floor.
const SENSOR: &str = r#"<sensor type="perspective">
    <float name="fov" value="45"/>
    <transform name="to_world"><lookat origin="0,1.5,5" target="0,0.7,0" up="0,1,0"/></transform>"#;

const FLOOR: &str = r#"<shape type="rectangle">
    <transform name="to_world"><rotate x="1" angle="-90"/><scale value="4"/></transform>
    <bsdf type="diffuse"><rgb name="reflectance" value="0.8"/></bsdf>
  </shape>"#;

const LAMP: &str = r#"<shape type="rectangle">
    <transform name="to_world"><rotate x="1" angle="90"/><scale value="0.7"/><translate x="0.5" y="3" z="1"/></transform>
    <emitter type="area"><rgb name="radiance" value="4"/></emitter>
  </shape>"#;

/// Renders an image with its variances, once for each folder and options.
fn picture(folder: &Folder, options: &str) -> Image {
    let name = format!("{}.exr", options.replace(|c: char| !c.is_ascii_alphanumeric() && c != '.', "_"));
    if !folder.path(&name).exists() {
        folder.render(&format!("s.xml -q -o {name} --aov variance {options}"));
    }
    read(&folder.path(&name)).expect("an image")
}

fn mean(image: &Image) -> f64 {
    let rgb = image.select(&["R", "G", "B"]).expect("a picture");
    rgb.data.iter().map(|v| f64::from(*v)).sum::<f64>() / rgb.data.len() as f64
}

/// Checks that two renders of the same image differ only by noise, in blocks and in the mean.
#[track_caller]
fn agree(folder: &Folder, one: &str, other: &str) {
    let [a, b] = [format!("--seed 1 {one}"), format!("--seed 2 {other}")].map(|o| picture(folder, &o));
    let test = z_test(&a, &b, None, SIGNIFICANCE).expect("comparable");
    let (a, b) = (mean(&a), mean(&b));
    println!("{one} {a:.5}, {other} {b:.5}, a bias of {:.2} % would be found", 100.0 * test.gain);
    assert!(
        test.rejected == 0 && test.is_unbiased(),
        "{one}: {a}; {other}: {b}; {} blocks rejected (p {:.1e}), bias p {:.1e}",
        test.rejected,
        test.block_probability,
        test.bias_probability
    );
    assert!(test.gain < FOUND, "{one}, {other}: only a bias of {} would be found", test.gain);
}

/// Checks that the mean of an estimator that is biased by design is close to that of an unbiased one.
#[track_caller]
fn nearly_agree(folder: &Folder, one: &str, other: &str, tolerance: f64) {
    let [a, b] = [format!("--seed 1 {one}"), format!("--seed 2 {other}")].map(|o| mean(&picture(folder, &o)));
    println!("{one} {a:.5}, {other} {b:.5}");
    assert!((a / b - 1.0).abs() < tolerance, "{one}: {a}; {other}: {b}");
}

/// Returns a plate that rises by 1 while the shutter is open, seen from above and lit through a mirror above it.
fn rising_plate() -> Folder {
    let sensor = r#"<sensor type="orthographic">
    <float name="shutter_open" value="0"/><float name="shutter_close" value="1"/>
    <transform name="to_world"><lookat origin="0,1.9,0" target="0,0,0.0001" up="0,1,0"/></transform>"#;
    let things = r#"<shape type="rectangle">
    <animation name="to_world">
      <transform time="0"><rotate x="1" angle="-90"/><scale value="3"/></transform>
      <transform time="1"><rotate x="1" angle="-90"/><scale value="3"/><translate y="1"/></transform>
    </animation>
    <bsdf type="diffuse"><rgb name="reflectance" value="0.9"/></bsdf>
  </shape>
  <shape type="rectangle">
    <transform name="to_world"><rotate x="1" angle="90"/><scale value="20"/><translate y="4"/></transform>
    <bsdf type="conductor"/>
  </shape>
  <emitter type="spot">
    <rgb name="intensity" value="100"/><float name="cutoff_angle" value="70"/><float name="beam_width" value="69"/>
    <transform name="to_world"><lookat origin="0,2,0" target="0,3,0" up="0,0,1"/></transform>
  </emitter>"#;
    Folder::with(&scene(sensor, things))
}

#[test]
fn photons_land_where_moving_surfaces_are_when_they_are_gathered() {
    agree(
        &rising_plate(),
        "--integrator ptracer --spp 16384 --sampler sobol",
        "--integrator sppm --spp 4096 --sampler sobol",
    );
}

#[test]
fn maps_and_caches_refuse_motion() {
    let folder = rising_plate();
    for integrator in ["photonmapper", "irrcache"] {
        let run = folder.run(&format!("render s.xml -q -o x.exr --integrator {integrator}"));
        assert!(run.code == 3 && run.stderr.contains("expected a scene without motion"), "{run:?}");
    }
}

/// A leaf seen from behind: perturbed normals inside `twosided`, inside a mask.
#[test]
fn the_back_of_a_leaf_has_the_normals_of_its_front() {
    let leaf = |before: &str, after: &str| {
        let things = format!(
            r#"{FLOOR}
  {LAMP}
  <emitter type="constant"><rgb name="radiance" value="0.6,0.7,0.9"/></emitter>
  <shape type="rectangle">
    <transform name="to_world"><rotate y="1" angle="120"/><translate y="1.2"/></transform>
    {before}<bsdf type="twosided"><bsdf type="normalmap">
      <texture name="normalmap" type="checkerboard">
        <rgb name="color0" value="0.85,0.5,0.85"/><rgb name="color1" value="0.5,0.2,0.9"/>
      </texture>
      <bsdf type="diffuse"><rgb name="reflectance" value="0.8,0.3,0.2"/></bsdf>
    </bsdf></bsdf>{after}
  </shape>"#
        );
        picture(&Folder::with(&scene(SENSOR, &things)), "--spp 1024 --sampler sobol")
    };
    let plain = leaf("", "");
    for (before, after) in [
        (r#"<bsdf type="mask"><float name="opacity" value="0.9999"/>"#, "</bsdf>"),
        (
            r#"<bsdf type="blendbsdf"><float name="weight" value="0.0001"/>"#,
            r#"<bsdf type="twosided"><bsdf type="diffuse"/></bsdf></bsdf>"#,
        ),
    ] {
        let test = z_test(&leaf(before, after), &plain, None, SIGNIFICANCE).expect("comparable");
        assert!(test.rejected == 0 && test.gain < FOUND, "{before}: {} blocks rejected", test.rejected);
    }
}

/// Returns a floor under an emitter, with a larger rectangle of `bsdf` between them.
fn below_a_lamp(bsdf: &str) -> Folder {
    let things = format!(
        r#"{FLOOR}
  {LAMP}
  <shape type="rectangle">
    <transform name="to_world"><rotate x="1" angle="90"/><scale value="3"/><translate y="2"/></transform>
    {bsdf}
  </shape>"#
    );
    Folder::with(&scene(SENSOR, &things))
}

#[test]
fn photons_and_caches_see_through_whatever_lets_light_pass() {
    check_transmission(&[
        r#"<bsdf type="roughdielectric"><float name="int_ior" value="1.3"/><float name="ext_ior" value="1.3"/></bsdf>"#,
    ]);
}

#[test]
#[ignore = "takes long: make test-all"]
fn photons_and_caches_see_through_emitters_with_holes() {
    check_transmission(&[
        r#"<bsdf type="mask"><float name="opacity" value="0.1"/><bsdf type="twosided"><bsdf type="diffuse"/></bsdf></bsdf>
           <emitter type="area"><rgb name="radiance" value="0.0001"/></emitter>"#,
        r#"<bsdf type="null"/><emitter type="area"><rgb name="radiance" value="0.0001"/></emitter>"#,
    ]);
}

/// Photons and the rays of caches pass through every surface that transmits light in a straight line, also one that is
/// neither a hole nor smooth glass.
fn check_transmission(bsdfs: &[&str]) {
    for bsdf in bsdfs {
        let folder = below_a_lamp(bsdf);
        let path = "--integrator path --spp 4096 --sampler sobol";
        agree(&folder, path, "--integrator ptracer --spp 4096 --sampler sobol");
        nearly_agree(&folder, "--integrator sppm --spp 128 --sampler sobol", path, 0.03);
        nearly_agree(&folder, "--integrator photonmapper --spp 64 --sampler sobol", path, 0.03);
        nearly_agree(&folder, "--integrator irrcache --spp 1024 --sampler sobol", path, 0.05);
    }
}

/// Light that passes through a surface arrives at the next one just behind it. It counts once on each of them, although
/// they are parallel and nearer to each other than the photons.
#[test]
fn photons_of_a_sheet_are_not_those_of_the_surface_behind_it() {
    let sensor = r#"<sensor type="perspective">
    <float name="fov" value="40"/>
    <transform name="to_world"><lookat origin="0,3,4" target="0,0,0" up="0,1,0"/></transform>"#;
    let rough = r#"<bsdf type="roughdielectric"><float name="alpha" value="0.3"/></bsdf>"#;
    let translucent = r#"<bsdf type="principledthin"><float name="diff_trans" value="1.2"/></bsdf>"#;
    let sheet = ("rectangle", r#"<rotate x="1" angle="-90"/><scale value="2.5"/><translate y="0.02"/>"#);
    let pane = ("cube", r#"<scale x="2.5" y="0.01" z="2.5"/><translate y="0.5"/>"#);
    let block = ("cube", r#"<scale x="2.5" y="0.3" z="2.5"/><translate y="0.31"/>"#);
    for (material, (shape, place)) in [
        (r#"<bsdf type="mask"><bsdf type="twosided"><bsdf type="diffuse"/></bsdf></bsdf>"#, sheet),
        (translucent, sheet),
        (translucent, pane),
        (rough, pane),
        (rough, block),
    ] {
        let things = format!(
            r#"{FLOOR}
  <shape type="rectangle">
    <transform name="to_world"><rotate x="1" angle="90"/><scale value="3"/><translate y="4"/></transform>
    <emitter type="area"><rgb name="radiance" value="1"/></emitter>
  </shape>
  <shape type="{shape}">
    <transform name="to_world">{place}</transform>
    {material}
  </shape>"#
        );
        // With a limit, photonmapper traces longer paths through glass than the others do.
        let unlimited =
            scene(sensor, &things).replace(r#""max_depth" value="5""#, r#""max_depth" value="-1""#);
        let folder = Folder::with(&unlimited);
        for integrator in ["sppm", "vcm", "photonmapper"] {
            let photons = format!("--integrator {integrator} --spp 64 --sampler sobol");
            nearly_agree(&folder, &photons, "--integrator path --spp 256 --sampler sobol", 0.05);
        }
    }
}

/// A perturbed normal is turned to the viewer. On a light path the viewer is not in the direction of the light.
#[test]
fn light_paths_see_bent_normals_as_viewers_do() {
    for flip in ["true", "false"] {
        let things = format!(
            r#"{FLOOR}
  {LAMP}
  <shape type="sphere">
    <transform name="to_world"><translate y="1"/></transform>
    <bsdf type="normalmap">
      <boolean name="flip_invalid_normals" value="{flip}"/>
      <texture name="normalmap" type="checkerboard">
        <rgb name="color0" value="0.9,0.5,0.8"/><rgb name="color1" value="0.4,0.1,0.8"/>
        <transform name="to_uv"><scale x="8" y="8"/></transform>
      </texture>
      <bsdf type="diffuse"><rgb name="reflectance" value="0.8"/></bsdf>
    </bsdf>
  </shape>"#
        );
        let folder = Folder::with(&scene(SENSOR, &things));
        let path = "--integrator path --spp 1024 --sampler sobol";
        agree(&folder, path, "--integrator ptracer --spp 4096 --sampler sobol");
        nearly_agree(&folder, "--integrator sppm --spp 128 --sampler sobol", path, 0.03);
    }
}

/// Returns an opaque horizontal plane with perturbed normals.
fn bent_sheet(flip: &str, colors: [&str; 2], size_and_place: &str) -> String {
    let [first, second] = colors;
    format!(
        r#"<shape type="rectangle">
    <transform name="to_world"><rotate x="1" angle="-90"/>{size_and_place}</transform>
    <bsdf type="twosided"><bsdf type="normalmap">
      <boolean name="flip_invalid_normals" value="{flip}"/>
      <texture name="normalmap" type="checkerboard">
        <rgb name="color0" value="{first}"/><rgb name="color1" value="{second}"/>
      </texture>
      <bsdf type="diffuse"/>
    </bsdf></bsdf>
  </shape>"#
    )
}

/// Light from below an opaque plane does not reach its upper side, whatever its perturbed normals are.
#[test]
fn no_light_passes_a_two_sided_sheet_with_bent_normals() {
    for flip in ["true", "false"] {
        let sheet = bent_sheet(flip, ["0.54,0.34,0.57", "0.28,0.5,0.93"], r#"<scale value="4"/>"#);
        let folder = Folder::with(&scene(SENSOR, &format!("{sheet}\n<emitter type=\"constant\"/>")));
        let path = "--integrator path --spp 1024 --sampler sobol";
        agree(&folder, path, "--integrator ptracer --spp 4096 --sampler sobol");
    }
}

/// Below an opaque plane with perturbed normals, with all emitters above it, the radiance is zero.
#[test]
fn no_light_path_goes_on_through_a_two_sided_wall() {
    let place = r#"<scale value="50"/><translate y="2"/>"#;
    let sheet = bent_sheet("false", ["0.9,0.5,0.6", "0.1,0.5,0.6"], place);
    let folder = Folder::with(&scene(SENSOR, &format!("{FLOOR}\n{LAMP}\n{sheet}")));
    for integrator in ["path", "ptracer", "bdpt", "vcm", "pssmlt", "sppm"] {
        let lit = mean(&picture(&folder, &format!("--integrator {integrator} --spp 64")));
        assert!(lit == 0.0, "{integrator}: {lit}");
    }
}

#[test]
fn surfaces_with_holes_are_lit_by_photons_as_others_are() {
    check_holes("0.2");
}

#[test]
#[ignore = "takes long: make test-all"]
fn surfaces_with_smaller_holes_are_lit_by_photons_as_others_are() {
    check_holes("0.6");
}

/// Photons and camera rays both hit a surface with the probability of its opacity. The opacity is not counted twice.
fn check_holes(opacity: &str) {
    let things = format!(
        r#"{FLOOR}
  <emitter type="point"><point name="position" value="0,1.2,0"/><rgb name="intensity" value="3"/></emitter>
  <shape type="rectangle">
    <transform name="to_world"><rotate x="1" angle="90"/><scale value="1.5"/><translate y="2.6"/></transform>
    <bsdf type="mask"><float name="opacity" value="{opacity}"/>
      <bsdf type="diffuse"><rgb name="reflectance" value="0.8"/></bsdf></bsdf>
  </shape>"#
    );
    let text = scene(SENSOR, &things)
        .replace("origin=\"0,1.5,5\" target=\"0,0.7,0\"", "origin=\"0,1.5,5\" target=\"0,2,0\"");
    let folder = Folder::with(&text);
    let path = "--integrator path --spp 1024 --sampler sobol";
    agree(&folder, path, "--integrator ptracer --spp 4096 --sampler sobol");
    nearly_agree(&folder, "--integrator sppm --spp 256 --sampler sobol", path, 0.03);
    nearly_agree(&folder, "--integrator photonmapper --spp 64 --sampler sobol", path, 0.03);
}

/// Clipping planes of an orthographic camera with a scale in its transform.
#[test]
fn light_paths_are_clipped_where_camera_rays_are() {
    let sensor = r#"<sensor type="orthographic">
    <float name="near_clip" value="1.2"/><float name="far_clip" value="3.1"/>
    <transform name="to_world"><scale value="2"/><lookat origin="0,1,5" target="0,0.7,0" up="0,1,0"/></transform>"#;
    let ball = r#"<shape type="sphere"><point name="center" value="0.5,1,1"/><float name="radius" value="0.8"/></shape>"#;
    let folder = Folder::with(&scene(sensor, &format!("{FLOOR}\n{LAMP}\n{ball}")));
    agree(
        &folder,
        "--integrator path --spp 1024 --sampler sobol",
        "--integrator ptracer --spp 8192 --sampler sobol",
    );
}

const OCTAHEDRON: &str = "v 1 0 0\nv -1 0 0\nv 0 1 0\nv 0 -1 0\nv 0 0 1\nv 0 0 -1\n\
    vn 1 0 0\nvn -1 0 0\nvn 0 1 0\nvn 0 -1 0\nvn 0 0 1\nvn 0 0 -1\n\
    f 1//1 3//3 5//5\nf 3//3 2//2 5//5\nf 2//2 4//4 5//5\nf 4//4 1//1 5//5\n\
    f 3//3 1//1 6//6\nf 2//2 3//3 6//6\nf 4//4 2//2 6//6\nf 1//1 4//4 6//6\n";

/// Returns a floor below an emitter that is a mesh.
fn lit_by(mesh: &str, place: &str) -> Folder {
    let things = format!(
        r#"{FLOOR}
  <shape type="obj">
    <string name="filename" value="lamp.obj"/>
    <transform name="to_world">{place}</transform>
    <emitter type="area"><rgb name="radiance" value="4"/></emitter>
  </shape>"#
    );
    let folder = Folder::with(&scene(SENSOR, &things));
    folder.write("lamp.obj", mesh.as_bytes());
    folder
}

/// Renders with `direct` and the given numbers of emitter and BSDF samples. The options are written to a scene file.
fn direct(folder: &Folder, emitter_samples: u32, bsdf_samples: u32) -> Image {
    let integrator = format!(
        r#"<integrator type="direct"><integer name="emitter_samples" value="{emitter_samples}"/>
           <integer name="bsdf_samples" value="{bsdf_samples}"/><boolean name="hide_emitters" value="true"/></integrator>"#
    );
    let text = String::from_utf8(folder.read("s.xml")).expect("text");
    let path = r#"<integrator type="path"><integer name="max_depth" value="5"/></integrator>"#;
    folder.write("direct.xml", text.replace(path, &integrator).as_bytes());
    folder.render(&format!(
        "direct.xml -q -o p.exr --aov variance --spp 4096 --sampler sobol --seed {emitter_samples}"
    ));
    read(&folder.path("p.exr")).expect("an image")
}

#[test]
fn lamps_with_smooth_normals_have_one_front() {
    let folder = lit_by(
        OCTAHEDRON,
        r#"<rotate x="1" angle="20"/><rotate y="1" angle="15"/><scale value="0.7"/><translate y="1"/>"#,
    );
    let (by_emitter, by_bsdf, by_both) =
        (direct(&folder, 1, 0), direct(&folder, 0, 1), direct(&folder, 1, 1));
    for image in [&by_bsdf, &by_both] {
        let test = z_test(&by_emitter, image, None, SIGNIFICANCE).expect("comparable");
        assert!(test.rejected == 0 && test.is_unbiased() && test.gain < FOUND, "{test:?}");
    }
    agree(
        &folder,
        "--integrator path --spp 1024 --sampler sobol",
        "--integrator ptracer --spp 4096 --sampler sobol",
    );
}

/// One emitter of a square of area 1 and a triangle of area 8·10^10 that faces away.
#[test]
fn small_triangles_beside_huge_ones_are_drawn() {
    let mesh = "v -0.5 0 -0.5\nv 0.5 0 -0.5\nv 0.5 0 0.5\nv -0.5 0 0.5\n\
        v -200000 50 -200000\nv 200000 50 -200000\nv 0 50 200000\nf 1 2 3\nf 1 3 4\nf 5 7 6\n";
    let folder = lit_by(mesh, r#"<translate y="2"/>"#);
    let (by_emitter, by_bsdf) = (direct(&folder, 1, 0), direct(&folder, 0, 1));
    let [e, b] = [&by_emitter, &by_bsdf].map(mean);
    assert!((e / b - 1.0).abs() < 0.1, "by emitter samples {e}, by BSDF samples {b}");
    agree(
        &folder,
        "--integrator path --spp 1024 --sampler sobol",
        "--integrator ptracer --spp 16384 --sampler sobol",
    );
}

/// An emitter that is hidden from the camera does not block light paths either.
#[test]
fn hidden_lamps_do_not_stand_in_the_way_of_light() {
    let things = r#"<shape type="rectangle"><transform name="to_world"><scale value="3"/></transform><bsdf type="diffuse"/></shape>
  <shape type="rectangle">
    <transform name="to_world"><rotate y="1" angle="180"/><scale value="1.2"/><translate z="2"/></transform>
    <emitter type="area"><rgb name="radiance" value="4"/></emitter>
  </shape>"#;
    let sensor = r#"<sensor type="perspective"><float name="fov" value="40"/>
    <transform name="to_world"><lookat origin="0,0,5" target="0,0,0" up="0,1,0"/></transform>"#;
    let text = scene(sensor, things).replace(
        r#"<integrator type="path"><integer name="max_depth" value="5"/>"#,
        r#"<default name="integrator" value="path"/><integrator type="$integrator">
           <boolean name="hide_emitters" value="true"/><integer name="max_depth" value="2"/>"#,
    );
    let folder = Folder::with(&text);
    let path = "-D integrator=path --spp 1024 --sampler sobol";
    agree(&folder, path, "-D integrator=ptracer --spp 4096 --sampler sobol");
    nearly_agree(&folder, "-D integrator=sppm --spp 64 --sampler sobol", path, 0.03);
}

/// In a film 65,536 pixels wide with a box filter, positions are precise and no light counts for two pixels.
#[test]
fn light_paths_find_the_pixels_of_wide_films() {
    let sensor = r#"<sensor type="orthographic">
    <transform name="to_world"><scale x="3" y="49152"/><lookat origin="0,2,0" target="0,0,0" up="0,0,1"/></transform>"#;
    let folder = Folder::with(
        &scene(sensor, &format!("{FLOOR}\n{LAMP}"))
            .replace(r#""width" value="16""#, r#""width" value="65536""#)
            .replace(r#""height" value="16""#, r#""height" value="4""#),
    );
    let path = mean(&picture(&folder, "--integrator path --spp 4 --sampler sobol"));
    let light = mean(&picture(&folder, "--integrator ptracer --spp 32 --sampler sobol"));
    // The standard error of the sum over a quarter of a million pixels is 0.05 %.
    assert!((light / path - 1.0).abs() < 1.5e-3, "{light}, by paths {path}");
}

/// Ray trees have the requested depth and terminate.
#[test]
fn trees_of_rays_are_as_deep_as_they_are_asked_to_be() {
    let furnace = r#"<shape type="sphere"><boolean name="flip_normals" value="true"/>
    <bsdf type="conductor"><string name="material" value="none"/><rgb name="specular_reflectance" value="0.9"/></bsdf>
    <emitter type="area"><rgb name="radiance" value="0.1"/></emitter></shape>"#;
    let sensor = r#"<sensor type="perspective"><transform name="to_world"><lookat origin="0,0,0.3" target="0,0,0" up="0,1,0"/></transform>"#;
    let integrator = |kind: &str, depth: u32| {
        format!(r#"<integrator type="{kind}"><integer name="max_depth" value="{depth}"/>"#)
    };
    let path = integrator("path", 5);
    let deep = Folder::with(&scene(sensor, furnace).replace(
        &path,
        &(integrator("distribution", 300_000) + r#"<integer name="bsdf_samples" value="1"/>"#),
    ));
    let image = picture(&deep, "--spp 1 --size 2x2");
    assert!(image.data.iter().take(4).all(|v| v.is_finite()), "{:?}", image.data);
    let balls = r#"<emitter type="constant"/>
  <shape type="sphere"><bsdf type="dielectric"/></shape>
  <shape type="sphere"><point name="center" value="0.6,0,0"/><float name="radius" value="0.5"/><bsdf type="dielectric"/></shape>"#;
    let glass = scene(SENSOR, balls);
    let distribution =
        Folder::with(&glass.replace(
            &path,
            &(integrator("distribution", 60) + r#"<integer name="bsdf_samples" value="1"/>"#),
        ));
    let image = picture(&distribution, "--spp 1 --size 8x8");
    assert!((mean(&image) - 1.0).abs() < 0.05, "{}", mean(&image));
    let whitted = Folder::with(&glass.replace(&path, &integrator("whitted", 60)));
    let run = whitted.run("render s.xml -q -o x.exr --size 8x8");
    assert!(run.code != 0 && run.stderr.contains("max_depth"), "{run:?}");
}

#[test]
fn pictures_that_differ_by_their_seeds_alone_are_the_same() {
    check_seeds(1..=2);
}

#[test]
#[ignore = "takes long: make test-all"]
fn pictures_of_more_seeds_are_the_same() {
    check_seeds(3..=8);
}

/// Images that differ only by their seeds are rejected with the probability of the test's significance, also with
/// shared noise.
fn check_seeds(seeds: RangeInclusive<u32>) {
    let folder = Folder::with(&scene(SENSOR, &format!("{FLOOR}\n{LAMP}\n{}", BALL)));
    for (integrator, filter) in [
        ("path", "box"),
        ("ptracer", "gaussian"),
        ("bdpt", "gaussian"),
        ("vcm", "gaussian"),
        ("pssmlt", "gaussian"),
        ("sppm", "box"),
        ("irrcache", "box"),
        ("photonmapper", "box"),
    ] {
        let images: Vec<Image> = seeds
            .clone()
            .map(|seed| {
                let options =
                    format!("--integrator {integrator} -D filter={filter} --spp 32 --sampler sobol");
                picture(&folder, &format!("{options} --seed {seed}"))
            })
            .collect();
        for pair in images.chunks_exact(2) {
            let test = z_test(&pair[0], &pair[1], None, SIGNIFICANCE).expect("comparable");
            assert!(
                test.rejected == 0 && test.is_unbiased(),
                "{integrator}: {} blocks rejected (p {:.1e}), bias p {:.1e}",
                test.rejected,
                test.block_probability,
                test.bias_probability
            );
        }
    }
}

const BALL: &str = r#"<shape type="sphere"><point name="center" value="0.5,0.6,0.5"/><float name="radius" value="0.6"/>
    <bsdf type="twosided"><bsdf type="diffuse"><rgb name="reflectance" value="0.7,0.5,0.3"/></bsdf></bsdf></shape>"#;
