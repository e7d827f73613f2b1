//! Isosurfaces of signed distances: closed forms, agreement of integrators and of traversals, and files.

use crate::support::cli::Folder;
use buffon::image::{Image, read};

/// The points of the grid along each axis.
const SIZE: [usize; 3] = [9, 7, 12];

/// Returns the bytes of a file with the distances at the points of [`SIZE`].
fn file(distance: impl Fn([f32; 3]) -> f32) -> Vec<u8> {
    let [nx, ny, nz] = SIZE;
    let mut bytes = b"VOL\x03".to_vec();
    for n in [1, nx, ny, nz, 1] {
        bytes.extend((n as i32).to_le_bytes());
    }
    bytes.extend([0; 24]);
    for i in 0..nx * ny * nz {
        let index = [i % nx, i / nx % ny, i / (nx * ny)];
        let p = [0, 1, 2].map(|axis| index[axis] as f32 / (SIZE[axis] - 1) as f32);
        bytes.extend(distance(p).to_le_bytes());
    }
    bytes
}

/// Returns a scene with `shapes` in a constant environment of 1 and a lamp.
fn scene(lamp: f32, shapes: &str) -> String {
    format!(
        r#"<scene version="3.0.0">
  <integrator type="path"/>
  <sensor type="perspective"><float name="fov" value="40"/>
    <transform name="to_world"><lookat origin="1.5,2,3" target="0.5,0.5,0.5" up="0,1,0"/></transform>
    <film type="hdrfilm"><integer name="width" value="32"/><integer name="height" value="24"/>
      <string name="pixel_format" value="rgb"/><string name="component_format" value="float32"/><rfilter type="box"/></film>
  </sensor>
  <emitter type="constant"/>
  <emitter type="point"><point name="position" value="2,3,1"/><rgb name="intensity" value="{lamp}"/></emitter>
  {shapes}
</scene>"#
    )
}

/// Returns an `sdfgrid` with the file `d.vol`.
fn grid(inside: &str) -> String {
    format!(r#"<shape type="sdfgrid"><string name="filename" value="d.vol"/>{inside}</shape>"#)
}

fn folder(scene: &str, distance: impl Fn([f32; 3]) -> f32) -> Folder {
    let folder = Folder::with(scene);
    folder.write("d.vol", &file(distance));
    folder
}

fn picture(folder: &Folder, options: &str) -> Image {
    folder.render(&format!("s.xml -q -o p.exr {options}"));
    read(&folder.path("p.exr")).expect("an image")
}

fn traversals() -> impl Iterator<Item = &'static str> {
    ["embree", "obvhs"].into_iter().filter(|accel| *accel == "obvhs" || cfg!(feature = "embree"))
}

const GREY: &str = r#"<bsdf type="twosided"><bsdf type="diffuse"/></bsdf>"#;

/// A distance that is linear is interpolated exactly: the surface is a rectangle.
#[test]
fn a_linear_distance_is_a_rectangle() {
    let rectangle = format!(
        r#"<shape type="rectangle"><transform name="to_world"><scale value="0.5"/>
        <rotate x="1" angle="-90"/><translate x="0.5" y="0.3" z="0.5"/></transform>{GREY}</shape>"#
    );
    let expected = picture(&Folder::with(&scene(5.0, &rectangle)), "--spp 16");
    for (normals, accel) in ["smooth", "analytic"].into_iter().flat_map(|n| traversals().map(move |a| (n, a)))
    {
        let grid = grid(&format!(r#"<string name="normals" value="{normals}"/>{GREY}"#));
        let found =
            picture(&folder(&scene(5.0, &grid), |[_, y, _]| y - 0.3), &format!("--spp 16 --accel {accel}"));
        for (found, expected) in found.data.iter().zip(&expected.data) {
            assert!((found - expected).abs() <= 2e-4 * expected, "{normals} {accel}: {found} {expected}");
        }
    }
}

/// A white body in a white environment is as bright as it, whatever its form.
#[test]
fn white_isosurfaces_are_a_furnace() {
    let white =
        r#"<bsdf type="twosided"><bsdf type="diffuse"><rgb name="reflectance" value="1"/></bsdf></bsdf>"#;
    let waves = |p: [f32; 3]| p.map(|x| (9.0 * x).sin()).iter().sum::<f32>() - 0.4;
    for accel in traversals() {
        let grid = grid(&format!(r#"<string name="normals" value="analytic"/>{white}"#));
        let image = picture(&folder(&scene(0.0, &grid), waves), &format!("--spp 64 --accel {accel}"));
        let mean = image.data.iter().sum::<f32>() / image.data.len() as f32;
        assert!((mean - 1.0).abs() < 2e-3, "{accel}: {mean}");
    }
}

/// A sphere of distances looks like a sphere, also if it is scaled, or rotated as an instance.
#[test]
fn a_round_distance_is_nearly_a_sphere() {
    let distance = |p: [f32; 3]| p.map(|x| (x - 0.5) * (x - 0.5)).iter().sum::<f32>().sqrt() - 0.4;
    let sphere = r#"<shape type="sphere"><point name="center" value="0.5,0.5,0.5"/>
        <float name="radius" value="0.4"/><bsdf type="diffuse"/></shape>"#;
    let expected = picture(&Folder::with(&scene(5.0, sphere)), "--spp 64");
    let rotated = format!(
        r#"<shape type="shapegroup" id="g">{}</shape><shape type="instance"><ref id="g"/>
        <transform name="to_world"><translate value="-0.5"/><rotate x="1" y="0.5" angle="70"/>
        <translate value="0.5"/></transform></shape>"#,
        grid(r#"<bsdf type="diffuse"/>"#)
    );
    for shape in [grid(r#"<bsdf type="diffuse"/>"#), rotated] {
        let found = picture(&folder(&scene(5.0, &shape), distance), "--spp 64");
        let error: f32 = found.data.iter().zip(&expected.data).map(|(a, b)| (a - b).abs()).sum();
        let relative = error / expected.data.iter().sum::<f32>();
        assert!(relative < 0.03, "{relative}");
    }
}

/// Camera paths and light paths agree.
#[test]
fn integrators_agree_on_isosurfaces() {
    let waves = |p: [f32; 3]| p.map(|x| (7.0 * x).sin()).iter().sum::<f32>() - 0.4;
    let grid = grid(r#"<bsdf type="twosided"><bsdf type="diffuse"/></bsdf>"#);
    let folder = folder(&scene(0.0, &grid), waves);
    folder.light_paths_agree(256);
}

#[test]
fn mistakes_are_told_in_sentences() {
    let plane = |[_, y, _]: [f32; 3]| y - 0.3;
    let everywhere = |_: [f32; 3]| 1.0;
    let refused = |inside: &str, bytes: Vec<u8>| {
        let folder = Folder::with(&scene(1.0, &grid(inside)));
        folder.write("d.vol", &bytes);
        let run = folder.run("render s.xml -q -o x.exr");
        assert_eq!(run.code, 3, "{run:?}");
        run.stderr
    };
    let rotated = r#"<transform name="to_world"><rotate x="1" angle="30"/></transform>"#;
    let channels = |n: i32| {
        let mut bytes = file(plane);
        bytes[20..24].copy_from_slice(&n.to_le_bytes());
        bytes.extend(vec![0; (n as usize - 1) * 4 * SIZE.iter().product::<usize>()]);
        bytes
    };
    for (inside, bytes, sentence) in [
        ("", file(everywhere), "d.vol: expected distances of both signs in some cell, found none"),
        ("", file(|_| f32::NAN), "d.vol: expected finite distances, found NaN"),
        ("", channels(3), "d.vol: expected one distance for each point, found 3 values"),
        (r#"<string name="normals" value="flat"/>"#, file(plane), "expected one of smooth, analytic"),
        (
            rotated,
            file(plane),
            "an sdfgrid cannot be rotated: put it into a shapegroup, and rotate the instance",
        ),
        (r#"<emitter type="area"/>"#, file(plane), "an sdfgrid cannot emit light"),
        (r#"<boolean name="flip_normals" value="true"/>"#, file(plane), "so they cannot be flipped"),
    ] {
        let stderr = refused(inside, bytes);
        assert!(stderr.contains(sentence), "{stderr}");
    }
}
