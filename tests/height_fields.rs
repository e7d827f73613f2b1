//! Height fields: images as surfaces.

use crate::support::cli::Folder;
use buffon::image::{Image, read};

/// Returns the bytes of an image in the format PFM, whose last row is the first in the file.
fn heights(width: usize, height: usize, value: impl Fn(f32, f32) -> f32) -> Vec<u8> {
    let mut bytes = format!("PF\n{width} {height}\n-1\n").into_bytes();
    for y in (0..height).rev() {
        for x in 0..width {
            let h = value(x as f32 / (width - 1) as f32, y as f32 / (height - 1) as f32);
            bytes.extend([h; 3].map(f32::to_le_bytes).concat());
        }
    }
    bytes
}

/// Returns a scene seen from above, with x to the right and y upwards.
fn scene(inside: &str) -> String {
    format!(
        r#"<scene version="0.6.0">
  <sensor type="orthographic">
    <transform name="toWorld"><lookAt origin="0,0,9" target="0,0,0" up="0,1,0"/></transform>
    <film type="hdrfilm"><integer name="width" value="40"/><integer name="height" value="40"/>
      <string name="pixelFormat" value="rgb"/><string name="componentFormat" value="float32"/>
      <rfilter type="box"/></film>
  </sensor>
  <shape type="heightfield">{inside}</shape>
</scene>"#
    )
}

const FILE: &str = r#"<string name="filename" value="h.pfm"/>"#;

/// Returns the layers of the pixel at a position in [−1, 1]².
fn at(image: &Image, x: f32, y: f32) -> &[f32] {
    let pixel = |v: f32| (v * 20.0 + 20.0) as usize;
    &image.data[(pixel(-y) * 40 + pixel(x)) * image.channels.len()..][..image.channels.len()]
}

/// A plane of pixels is a plane, and texture coordinates grow with the columns and rows of the image.
#[test]
fn a_ramp_is_a_plane() {
    for inside in [
        FILE.to_owned() + r#"<float name="scale" value="2"/>"#,
        format!(r#"<texture type="bitmap">{FILE}</texture><float name="scale" value="2"/>"#),
        FILE.to_owned() + r#"<float name="scale" value="2"/><boolean name="shadingNormals" value="false"/>"#,
    ] {
        let folder = Folder::with(&scene(&inside));
        folder.write("h.pfm", &heights(9, 5, |u, v| 0.25 * u + 0.5 * v));
        folder.render("s.xml -q --integrator depth --aov P,N,uv --spp 16 -o p.exr");
        let image = read(&folder.path("p.exr")).expect("an image");
        // The height is 2 (u/4 + v/2), with u = (x + 1)/2 and v = (y + 1)/2.
        let n = [-0.25, -0.5, 1.0].map(|v| v / (1.0f32 + 0.25 + 0.0625).sqrt());
        for (x, y) in [(-0.625, -0.625), (0.325, -0.475), (0.825, 0.775)] {
            let (u, v) = (0.5 * x + 0.5, 0.5 * y + 0.5);
            let layers = &at(&image, x, y)[3..];
            let expected = [n[0], n[1], n[2], x, y, 0.5 * u + v, u, v];
            for (i, (seen, expected)) in layers.iter().zip(expected).enumerate() {
                assert!((seen - expected).abs() < 0.02, "{inside} {i} {layers:?} {expected:?}");
            }
        }
    }
}

/// A texture that is also that of a material has no unused parameters.
#[test]
fn a_shared_texture_gives_no_warning() {
    let shared = format!(
        r#"<texture type="bitmap" id="t">{FILE}<string name="wrapMode" value="clamp"/></texture>
        <bsdf type="diffuse"><ref id="t" name="reflectance"/></bsdf>"#
    );
    let folder = Folder::with(&scene(&shared));
    folder.write("h.pfm", &heights(3, 3, |u, _| u));
    let run = folder.render("s.xml --spp 1 -o p.exr");
    assert!(run.stderr.contains("note: ") && !run.stderr.contains("warning: "), "{run:?}");
}

/// Near a point of the grid, shading normals are those of a paraboloid, and those of the triangles are not.
#[test]
fn smooth_normals_are_those_of_the_surface() {
    let paraboloid = heights(9, 9, |u, v| (2.0 * u - 1.0).powi(2) + (2.0 * v - 1.0).powi(2));
    // The middle of a pixel beside the point (0.5, -0.25).
    let (x, y) = (0.525f32, -0.275f32);
    let expected = [-2.0 * x, -2.0 * y, 1.0].map(|v| v / (4.0 * (x * x + y * y) + 1.0).sqrt());
    let error = |inside: &str| {
        let folder = Folder::with(&scene(inside));
        folder.write("h.pfm", &paraboloid);
        folder.render("s.xml -q --integrator depth --aov N --spp 64 -o p.exr");
        let image = read(&folder.path("p.exr")).expect("an image");
        let n = &at(&image, x, y)[3..6];
        expected.iter().zip(n).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
    };
    let smooth = error(FILE);
    let faceted = error(&format!(r#"{FILE}<boolean name="shadingNormals" value="false"/>"#));
    assert!(smooth < 0.02 && faceted > 0.05, "{smooth} {faceted}");
}

#[test]
fn mistakes_are_told_in_sentences() {
    let checkerboard = r#"<texture type="checkerboard"/>"#;
    for (inside, size, sentence) in [
        (FILE.to_owned(), [1, 5], "expected at least 2 x 2 heights, found 1 x 5"),
        (String::new(), [3, 3], "the property filename is missing"),
        (checkerboard.to_owned(), [3, 3], "expected a bitmap: its pixels are the heights"),
        (
            format!(r#"{FILE}<texture type="bitmap">{FILE}</texture>"#),
            [3, 3],
            "expected either a filename or a texture",
        ),
        (r#"<string name="filename" value="gone.pfm"/>"#.to_owned(), [3, 3], "there is no file \"gone.pfm\""),
        (format!(r#"{FILE}<float name="scale" value="1e39"/>"#), [3, 3], "expected finite heights"),
    ] {
        let folder = Folder::with(&scene(&inside));
        folder.write("h.pfm", &heights(size[0], size[1], |u, _| u));
        let run = folder.run("render s.xml -q -o x.exr");
        assert_eq!(run.code, 3, "{inside} {run:?}");
        assert!(run.stderr.contains(sentence), "{inside} {}", run.stderr);
    }
}
