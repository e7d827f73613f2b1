//! Curves: files, closed forms, and agreement of integrators.

use crate::support::cli::Folder;
use buffon::image::{Image, read};
use std::fmt::Write;

/// Returns a scene with curves, whose file is `c.txt`, in a constant environment of 1.
fn scene(shape: &str, bsdf: &str, version: &str) -> String {
    format!(
        r#"<scene version="{version}">
  <integrator type="path"/>
  <sensor type="perspective"><float name="fov" value="40"/>
    <transform name="to_world"><lookat origin="0,1,4" target="0,0,0" up="0,1,0"/></transform>
    <film type="hdrfilm"><integer name="width" value="32"/><integer name="height" value="24"/>
      <string name="pixel_format" value="rgb"/><string name="component_format" value="float32"/><rfilter type="box"/></film>
  </sensor>
  <emitter type="constant"/>
  <shape type="{shape}"><string name="filename" value="c.txt"/>
    <transform name="to_world"><rotate y="1" angle="30"/></transform>{bsdf}</shape>
</scene>"#
    )
}

const WHITE: &str = r#"<bsdf type="diffuse"><rgb name="reflectance" value="1"/></bsdf>"#;

/// Returns curves of six points each, with a radius in each line or without.
fn points(radius: Option<f32>) -> String {
    let mut text = String::new();
    for curve in 0..12 {
        for i in 0..6 {
            let (a, t) = (curve as f32 * 2.4, i as f32 * 0.25);
            let (sin, cos) = (a + t).sin_cos();
            write!(text, "{} {} {}", cos * t, 0.6 * t - 0.4, sin * t).expect("a text grows");
            writeln!(text, "{}", radius.map_or(String::new(), |r| format!(" {r}"))).expect("a text grows");
        }
        text.push('\n');
    }
    text
}

fn folder(scene: &str, points: &str) -> Folder {
    let folder = Folder::with(scene);
    folder.write("c.txt", points.as_bytes());
    folder
}

fn picture(folder: &Folder, options: &str) -> Image {
    folder.render(&format!("s.xml -q -o p.exr {options}"));
    read(&folder.path("p.exr")).expect("an image")
}

/// White curves in a white environment are as bright as it.
#[test]
fn white_curves_are_a_furnace() {
    for accel in ["embree", "obvhs"] {
        if accel == "embree" && !cfg!(feature = "embree") {
            continue;
        }
        let image = picture(
            &folder(&scene("linearcurve", WHITE, "3.0.0"), &points(Some(0.1))),
            &format!("--spp 16 --accel {accel}"),
        );
        let mean = image.data.iter().sum::<f32>() / image.data.len() as f32;
        assert!((mean - 1.0).abs() < 2e-3, "{accel}: {mean}");
    }
}

/// Camera paths and light paths agree on straight and smooth curves.
#[test]
fn integrators_agree_on_curves() {
    for shape in ["linearcurve", "bsplinecurve"] {
        let bsdf = r#"<bsdf type="diffuse"><rgb name="reflectance" value="0.6,0.3,0.1"/></bsdf>"#;
        let folder = folder(&scene(shape, bsdf, "3.0.0"), &points(Some(0.12)));
        folder.light_paths_agree(512);
    }
}

/// Hair of version 0.6 is a `linearcurve` with one radius, in text and in binary.
#[test]
fn hair_is_a_curve_with_one_radius() {
    let reference = picture(&folder(&scene("linearcurve", "", "3.0.0"), &points(Some(0.05))), "--spp 4");
    let hair =
        scene("hair", "", "0.6.0").replace("</shape>", "<float name=\"radius\" value=\"0.05\"/></shape>");
    let folder = folder(&hair, &points(None));
    assert!(picture(&folder, "--spp 4").data == reference.data);
    let mut bytes = b"BINARY_HAIR".to_vec();
    let text = points(None);
    let vertices = text.lines().filter(|line| !line.is_empty()).count() as u32;
    bytes.extend(vertices.to_le_bytes());
    for line in text.lines() {
        match line {
            "" => bytes.extend(f32::INFINITY.to_le_bytes()),
            _ => {
                line.split(' ').for_each(|v| bytes.extend(v.parse::<f32>().expect("a number").to_le_bytes()))
            }
        }
    }
    folder.write("c.txt", &bytes);
    assert!(picture(&folder, "--spp 4").data == reference.data);
}

#[test]
fn mistakes_are_told_in_sentences() {
    let refused = |shape: &str, inside: &str, points: &str| {
        let run = folder(&scene(shape, inside, "3.0.0"), points).run("render s.xml -q -o x.exr");
        assert_eq!(run.code, 3, "{run:?}");
        run.stderr
    };
    let lamp = r#"<emitter type="area"/>"#;
    for (shape, inside, points, sentence) in [
        ("linearcurve", "", "0 0 0\n", "c.txt:1:1: expected four numbers: x, y, z and the radius"),
        ("bsplinecurve", "", "0 0 0 1\n1 0 0 1\n", "expected at least 4 control points of a curve, found 2"),
        ("linearcurve", "", "\n", "c.txt: the file has no control points"),
        ("linearcurve", lamp, "0 0 0 1\n1 0 0 1\n", "curves cannot emit light or contain a medium"),
        (
            "linearcurve",
            r#"<boolean name="flip_normals" value="true"/>"#,
            "0 0 0 1\n1 0 0 1\n",
            "the normals of curves always point outwards",
        ),
    ] {
        let stderr = refused(shape, inside, points);
        assert!(stderr.contains(sentence), "{stderr}");
    }
}
