//! Sensors without an image plane: all directions, one ray, and parallel rays from outside the scene.

use crate::support::cli::Folder;
use buffon::image::{Image, read};

/// Returns a scene with a sensor of a type, with `inside` and a film of the given size.
fn scene(sensor: &str, inside: &str, [width, height]: [u32; 2], rest: &str) -> String {
    format!(
        r#"<scene version="3.0.0">
  <integrator type="path"/>
  <sensor type="{sensor}">{inside}
    <film type="hdrfilm"><integer name="width" value="{width}"/><integer name="height" value="{height}"/>
      <string name="pixel_format" value="rgb"/><string name="component_format" value="float32"/><rfilter type="box"/></film>
  </sensor>
  {rest}
</scene>"#
    )
}

fn picture(scene: &str, options: &str) -> Image {
    let folder = Folder::with(scene);
    folder.render(&format!("s.xml -q -o p.exr {options}"));
    read(&folder.path("p.exr")).expect("an image")
}

/// A lamp in the direction of each axis, each with another radiance.
fn lamps() -> String {
    [[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]]
        .iter()
        .enumerate()
        .map(|(i, d)| {
            let [x, y, z] = d.map(|d| 3 * d);
            format!(
                r#"<shape type="sphere"><point name="center" value="{x},{y},{z}"/><float name="radius" value="1"/>
                <emitter type="area"><rgb name="radiance" value="{}"/></emitter></shape>"#,
                i + 1
            )
        })
        .collect()
}

/// The middle of the image is +z, +x is to the left of it, and +y is at the top.
#[test]
fn a_spherical_sensor_sees_all_directions() {
    let image = picture(&scene("spherical", "", [36, 18], &lamps()), "--spp 16");
    let at = |x: usize, y: usize| image.data[(y * 36 + x) * 3];
    let middles = [at(9, 9), at(27, 9), at(17, 0), at(17, 17), at(18, 9), at(0, 9), at(35, 9)];
    assert_eq!(middles, [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 6.0]);
    // Each lamp has the solid angle 2π (1 − cos α), with sin α = 1/3.
    let sum: f64 = (0..18)
        .map(|y| {
            let theta = (f64::from(y) + 0.5) / 18.0 * std::f64::consts::PI;
            (0..36).map(|x| f64::from(at(x, y as usize))).sum::<f64>() * theta.sin()
        })
        .sum();
    let pixel = std::f64::consts::TAU / 36.0 * std::f64::consts::PI / 18.0;
    let expected = 21.0 * std::f64::consts::TAU * (1.0 - (8f64 / 9.0).sqrt());
    assert!((sum * pixel / expected - 1.0).abs() < 0.02, "{} {expected}", sum * pixel);
}

/// Light paths that are connected to a spherical sensor give the image of camera paths.
#[test]
fn integrators_agree_for_a_spherical_sensor() {
    let room = r#"<shape type="cube"><boolean name="flip_normals" value="true"/><transform name="to_world">
        <scale x="2" y="1.2" z="1.5"/></transform><bsdf type="diffuse"/></shape>
        <shape type="rectangle"><transform name="to_world"><scale value="0.4"/><rotate x="1" angle="90"/>
        <translate x="0.5" y="1.1"/></transform><emitter type="area"/></shape>
        <shape type="sphere"><point name="center" value="1,-0.8,0.5"/><float name="radius" value="0.4"/></shape>"#;
    let turned = r#"<transform name="to_world"><rotate x="1" y="2" angle="30"/>
        <translate x="-0.5" y="0.2"/></transform>"#;
    let folder = Folder::with(&scene("spherical", turned, [24, 16], room));
    folder.light_paths_agree(512);
}

/// A `radiancemeter` has the radiance of one ray. A `distant` sensor has that of a point, or the mean over the cross
/// section of the scene's bounding sphere.
#[test]
fn meters_have_the_radiance_of_their_rays() {
    let one = [1, 1];
    let sphere = r#"<shape type="sphere"><point name="center" value="1,2,3"/><float name="radius" value="0.5"/>
        <emitter type="area"><rgb name="radiance" value="2"/></emitter></shape>"#;
    let down = r#"<vector name="direction" value="0,-1,0"/>"#;
    let value = |sensor: &str, inside: String, spp: u32| {
        picture(&scene(sensor, &inside, one, sphere), &format!("--spp {spp}")).data[0]
    };
    let point = |name: &str, p: &str| format!(r#"{down}<point name="{name}" value="{p}"/>"#);
    assert_eq!(value("radiancemeter", point("origin", "1.3,9,3"), 4), 2.0);
    assert_eq!(value("radiancemeter", point("origin", "1.6,9,3"), 4), 0.0);
    assert_eq!(value("radiancemeter", point("origin", "1.3,1,3"), 4), 0.0);
    assert_eq!(value("distant", point("target", "1.3,0,3"), 4), 2.0);
    assert_eq!(value("distant", point("target", "1.6,0,3"), 4), 0.0);
    // The bounding sphere is that of the box around the sphere: √3 times as wide.
    let mean = value("distant", down.into(), 4096);
    assert!((mean - 2.0 / 3.0).abs() < 2e-3, "{mean}");
}

/// Returns a scene of a shape with an `irradiancemeter` inside it.
fn metered(shape: &str, inside: &str, [width, height]: [u32; 2], rest: &str) -> String {
    let scene = scene("irradiancemeter", "", [width, height], "");
    let sensor = &scene[scene.find("<sensor").expect("a sensor")..scene.find("</scene>").expect("an end")];
    format!(
        r#"<scene version="3.0.0"><integrator type="path"/>
        <shape type="{shape}">{inside}{sensor}</shape>{rest}</scene>"#
    )
}

/// The irradiance of a small surface by a sphere of the radius r at the distance d is π·L·(r/d)²·cos θ. That of any
/// convex surface under uniform light is π·L.
#[test]
fn an_irradiancemeter_has_the_irradiance_of_its_surface() {
    let small = r#"<transform name="to_world"><scale value="0.001"/><rotate x="1" angle="-30"/></transform>"#;
    let lamp = r#"<shape type="sphere"><point name="center" value="0.4,1,2"/><float name="radius" value="0.6"/>
        <emitter type="area"><rgb name="radiance" value="5"/></emitter></shape>"#;
    let (sin, cos) = 30f64.to_radians().sin_cos();
    let expected = 5.0 * std::f64::consts::PI * 0.36 * (sin + 2.0 * cos) / 5.16f64.powf(1.5);
    for shape in ["rectangle", "disk"] {
        let seen = f64::from(picture(&metered(shape, small, [1, 1], lamp), "--spp 16384").data[0]);
        assert!((seen / expected - 1.0).abs() < 5e-3, "{shape} {seen} {expected}");
    }
    let sky = r#"<emitter type="constant"><rgb name="radiance" value="0.5"/></emitter>"#;
    let stretched = r#"<transform name="to_world"><scale x="3" y="0.2"/></transform>"#;
    for (shape, inside) in
        [("rectangle", stretched), ("disk", stretched), ("sphere", ""), ("cube", stretched)]
    {
        let image = picture(&metered(shape, inside, [3, 2], sky), "--spp 64");
        let expected = 0.5 * std::f32::consts::PI;
        // The points of a mesh have different weights.
        let tolerance = if shape == "cube" { 0.3 } else { 1e-5 };
        assert!(
            image.data.iter().all(|v| (v / expected - 1.0).abs() < tolerance),
            "{shape} {:?}",
            image.data
        );
    }
    // Half of a rectangle is below a roof, and pixels are parts of it.
    let roof = r#"<shape type="rectangle"><transform name="to_world"><scale x="0.5"/>
        <translate x="-0.5" z="0.0001"/></transform></shape>"#;
    let image = picture(&metered("rectangle", "", [2, 1], &format!("{roof}{sky}")), "--spp 1024");
    let [dark, light] = [image.data[0], image.data[3]].map(|v| v / (0.5 * std::f32::consts::PI));
    assert!(dark < 0.01 && (light - 1.0).abs() < 0.01, "{dark} {light}");
}

/// The triangles of a mesh count by their areas.
#[test]
fn an_irradiancemeter_weights_triangles_by_area() {
    let folder = Folder::with(&metered(
        "obj",
        r#"<string name="filename" value="m.obj"/><boolean name="face_normals" value="true"/>"#,
        [1, 1],
        r#"<emitter type="constant"><rgb name="radiance" value="1"/></emitter>
        <shape type="rectangle"><transform name="to_world"><translate x="1" y="1" z="0.0001"/></transform></shape>"#,
    ));
    // A triangle of the area 1/2 under the roof, and one of the area 2 beside it.
    folder.write(
        "m.obj",
        b"v 0.1 0.1 0\nv 1.1 0.1 0\nv 0.1 1.1 0\nv -2 -2 0\nv 0 -2 0\nv -2 0 0\nf 1 2 3\nf 4 5 6\n",
    );
    folder.render("s.xml -q -o p.exr --spp 16384");
    let seen = read(&folder.path("p.exr")).expect("an image").data[0] / std::f32::consts::PI;
    assert!((seen - 0.8).abs() < 8e-3, "{seen}");
}

#[test]
fn mistakes_are_told_in_sentences() {
    let floor = r#"<shape type="rectangle"/><emitter type="constant"/>"#;
    let both = r#"<vector name="direction" value="0,0,1"/><transform name="to_world"><translate x="1"/></transform>"#;
    let moving = r#"<animation name="to_world"><transform time="0"/>
        <transform time="1"><rotate x="1" angle="9"/></transform></animation>"#;
    let sheared = r#"<transform name="to_world"><rotate x="1" angle="45"/><scale y="1.5"/></transform>"#;
    for (sensor, inside, size, options, sentence) in [
        ("distant", moving, [1, 1], "", "it cannot move"),
        ("spherical", sheared, [4, 2], "", "a camera cannot be scaled"),
        ("radiancemeter", both, [1, 1], "", "expected either a direction or to_world, found both"),
        ("radiancemeter", r#"<vector name="direction" value="0,0,0"/>"#, [1, 1], "", "expected a direction"),
        (
            "radiancemeter",
            r#"<point name="origin" value="0,0,1"/>"#,
            [1, 1],
            "",
            "expected an origin and a direction",
        ),
        ("distant", r#"<shape type="sphere"/>"#, [1, 1], "", "<shape type=\"sphere\">"),
        (
            "distant",
            "",
            [1, 1],
            "--integrator bdpt",
            "bdpt cannot render a radiancemeter, irradiancemeter or distant sensor",
        ),
        (
            "spherical",
            "",
            [4, 2],
            "--integrator ptracer",
            "ptracer needs the filter box for a spherical sensor",
        ),
    ] {
        let scene = scene(sensor, inside, size, floor);
        let scene =
            if sensor == "spherical" { scene.replace("type=\"box\"", "type=\"tent\"") } else { scene };
        let run = Folder::with(&scene).run(&format!("render s.xml -q -o x.exr {options}"));
        assert_eq!(run.code, 3, "{run:?}");
        assert!(run.stderr.contains(sentence), "{}", run.stderr);
    }
}

#[test]
fn an_irradiancemeter_needs_a_surface() {
    let (box_of, size) = (|sensor: &str| format!(r#"<shape type="rectangle">{sensor}</shape>"#), [1, 1]);
    let alone = scene("irradiancemeter", "", size, "");
    let camera = box_of(r#"<sensor type="perspective"/>"#);
    let moving = r#"<animation name="to_world"><transform time="0"/>
        <transform time="1"><translate x="1"/></transform></animation>"#;
    let hairs = r#"<string name="filename" value="h.txt"/>"#;
    let merged = metered("merge", r#"<shape type="rectangle"/>"#, size, "");
    let line = r#"<string name="filename" value="line.obj"/>"#;
    let grouped = metered("rectangle", "", size, "").replace("<shape", "<shape type=\"shapegroup\"><shape");
    let grouped = grouped.replace("</shape>", "</shape></shape>");
    for (scene, options, sentence) in [
        (alone, "", "expected the irradiancemeter inside the shape whose irradiance it measures"),
        (format!("<scene version=\"3.0.0\">{camera}</scene>"), "", "no other sensor can be inside a shape"),
        (metered("rectangle", moving, size, ""), "", "a shape that moves cannot have a sensor"),
        (metered("obj", line, size, ""), "", "an irradiancemeter needs a rectangle, disk, sphere"),
        (metered("linearcurve", hairs, size, ""), "", "only a rectangle, disk, sphere, cylinder or mesh can"),
        (merged, "", "expected it inside a shape, found it inside <shape type=\"merge\">"),
        (grouped, "", "a shape inside a group cannot have a sensor"),
        (metered("rectangle", "", size, ""), "--integrator bdpt", "bdpt cannot render a radiancemeter"),
    ] {
        let folder = Folder::with(&scene);
        folder.write("h.txt", b"0 0 0 0.1\n0 0 1 0.1\n");
        folder.write("line.obj", b"v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n");
        let run = folder.run(&format!("render s.xml -q -o x.exr {options}"));
        assert_eq!(run.code, 3, "{scene} {run:?}");
        assert!(run.stderr.contains(sentence), "{scene} {}", run.stderr);
    }
}
