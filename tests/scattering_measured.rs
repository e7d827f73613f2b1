//! Measured materials: densities, a closed form, agreement of integrators, and files.

use crate::support::bsdfs::{check_bsdf, directions};
use crate::support::cli::Folder;
use buffon::bsdf::measured::{Table, Tables};
use buffon::bsdf::{Bsdf, Measured};
use buffon::math::Vec3;
use std::f32::consts::PI;

/// The points of a slice along each axis.
const SIDE: usize = 8;
/// The angles of the viewers with the normal.
const THETA: [f32; 4] = [0.0, 0.4, 0.9, 1.5];

/// The arrays of a file: names, shapes and values.
struct Arrays(Vec<(&'static str, Vec<usize>, Vec<f32>)>);

impl Arrays {
    /// Returns smooth arrays for viewers with the azimuths `phi`.
    fn new(phi: &[f32]) -> Self {
        let slice = |value: &dyn Fn(f32, f32) -> f32| -> Vec<f32> {
            let at = |i: usize| i as f32 / (SIDE - 1) as f32;
            (0..SIDE * SIDE).map(|i| value(at(i % SIDE), at(i / SIDE))).collect()
        };
        let viewers: Vec<(f32, f32)> = phi.iter().flat_map(|p| THETA.map(|t| (*p, t))).collect();
        let of_all = |value: &dyn Fn(f32, f32, f32, f32) -> f32| -> Vec<f32> {
            viewers.iter().flat_map(|(p, t)| slice(&|u, v| value(*p, *t, u, v))).collect()
        };
        let channels = viewers.iter().flat_map(|(p, t)| {
            (0..3).flat_map(move |c| {
                let c = c as f32;
                (0..SIDE * SIDE).map(move |i| {
                    let (u, v) = ((i % SIDE) as f32 / 7.0, (i / SIDE) as f32 / 7.0);
                    0.3 + 0.2 * (3.0 * u + c + p).cos() + 0.1 * (v + t).sin()
                })
            })
        });
        let of_viewers = |more: &[usize]| [&[phi.len(), THETA.len()], more].concat();
        Arrays(vec![
            ("phi_i", vec![phi.len()], phi.to_vec()),
            ("theta_i", vec![THETA.len()], THETA.to_vec()),
            ("ndf", vec![SIDE, SIDE], slice(&|u, v| 2.0 - u + 0.3 * (6.3 * v).sin())),
            ("sigma", vec![SIDE, SIDE], slice(&|u, _| 1.0 - 0.8 * u)),
            // The density of normals vanishes at the pole, so that the density of directions does not have one there.
            (
                "vndf",
                of_viewers(&[SIDE, SIDE]),
                of_all(&|p, t, u, v| u.powi(3) * (1.1 - u) * (1.0 + 0.5 * (6.3 * v + p).cos() * t)),
            ),
            ("luminance", of_viewers(&[SIDE, SIDE]), of_all(&|_, t, u, v| 0.4 + 0.3 * u * v + 0.1 * t)),
            ("rgb", of_viewers(&[3, SIDE, SIDE]), channels.collect()),
        ])
    }

    /// Replaces the values of an array by a constant.
    fn constant(mut self, name: &str, value: f32) -> Self {
        self.0.iter_mut().filter(|a| a.0 == name).for_each(|a| a.2.fill(value));
        self
    }

    fn tables(&self, jacobian: bool) -> Tables {
        let find = |name: &str| self.0.iter().find(|a| a.0 == name).expect("an array");
        let table = |name: &str| {
            let (_, shape, values) = find(name);
            let slices = shape[..shape.len() - 2].iter().product();
            Table::new(SIDE, SIDE, slices, values.clone()).expect("a table")
        };
        Tables {
            phi: find("phi_i").2.clone(),
            theta: find("theta_i").2.clone(),
            ndf: table("ndf"),
            sigma: table("sigma"),
            vndf: table("vndf"),
            luminance: table("luminance"),
            channels: table("rgb"),
            jacobian,
        }
    }

    /// Returns the bytes of a file, without the arrays that `wanted` rejects.
    fn file(&self, wanted: impl Fn(&str) -> bool) -> Vec<u8> {
        let mut arrays: Vec<(&str, u8, Vec<usize>, Vec<u8>)> = vec![("jacobian", 1, vec![1], vec![1])];
        for (name, shape, values) in &self.0 {
            arrays.push((name, 10, shape.clone(), values.iter().flat_map(|v| v.to_le_bytes()).collect()));
        }
        arrays.retain(|a| wanted(a.0));
        let header: usize = 18 + arrays.iter().map(|a| 2 + a.0.len() + 3 + 8 + 8 * a.2.len()).sum::<usize>();
        let mut bytes = b"tensor_file\0\x01\x00".to_vec();
        bytes.extend((arrays.len() as u32).to_le_bytes());
        let mut offset = header;
        for (name, kind, shape, data) in &arrays {
            bytes.extend((name.len() as u16).to_le_bytes());
            bytes.extend(name.as_bytes());
            bytes.extend((shape.len() as u16).to_le_bytes());
            bytes.push(*kind);
            bytes.extend((offset as u64).to_le_bytes());
            shape.iter().for_each(|n| bytes.extend((*n as u64).to_le_bytes()));
            offset += data.len();
        }
        arrays.iter().for_each(|a| bytes.extend(&a.3));
        bytes
    }
}

/// The azimuths of an isotropic material, and of anisotropic ones with different symmetries.
fn azimuths() -> [Vec<f32>; 4] {
    let over = |angle: f32| (0..5).map(|i| -PI + angle * i as f32 / 4.0).collect();
    [vec![0.0], over(2.0 * PI), over(PI), over(0.5 * PI)]
}

#[test]
fn samples_follow_their_density() {
    let mut views = directions();
    views.extend(
        [Vec3::new(-0.3, 0.5, 0.6), Vec3::new(0.2, -0.7, 0.3), Vec3::new(-0.6, -0.1, 0.7)]
            .map(Vec3::normalize),
    );
    for phi in azimuths() {
        let measured = Measured::new(Arrays::new(&phi).tables(true)).expect("a material");
        for &wo in &views {
            check_bsdf(
                &format!("measured, {} azimuths", phi.len()),
                4 * views.len(),
                &Bsdf::Measured(&measured),
                wo,
            );
        }
    }
}

/// With constant tables, f·cosθ is their product.
#[test]
fn constant_tables_have_a_closed_form() {
    for (phi, jacobian) in azimuths().into_iter().flat_map(|phi| [(phi.clone(), false), (phi, true)]) {
        let arrays = Arrays::new(&phi).constant("ndf", 3.0).constant("sigma", 0.5).constant("rgb", 0.2);
        let measured = Measured::new(arrays.tables(jacobian)).expect("a material");
        let expected = if jacobian { 0.2 * 3.0 / (4.0 * 0.5) } else { 0.2 };
        for (wo, wi) in
            directions().into_iter().flat_map(|wo| directions().into_iter().map(move |wi| (wo, wi)))
        {
            let found = measured.eval(wo, wi).f * wi.z;
            assert!((found.g / expected - 1.0).abs() < 1e-5, "{wo} {wi}: {found:?}");
            assert_eq!(measured.eval(wo, -wi).f.g, 0.0);
        }
    }
}

/// A scene with a measured floor, whose file is `m.bsdf`.
const SCENE: &str = r#"<scene version="3.0.0">
  <integrator type="path"><integer name="max_depth" value="4"/></integrator>
  <sensor type="perspective"><transform name="to_world"><lookat origin="0,3,3" target="0,0,0" up="0,1,0"/></transform>
    <film type="hdrfilm"><integer name="width" value="24"/><integer name="height" value="16"/>
    <string name="component_format" value="float32"/><rfilter type="box"/></film></sensor>
  <shape type="rectangle"><transform name="to_world"><scale value="2"/><rotate x="1" angle="-90"/></transform>
    <bsdf type="measured"><string name="filename" value="m.bsdf"/></bsdf></shape>
  <shape type="sphere"><point name="center" value="0.5,0.6,0"/><float name="radius" value="0.5"/></shape>
  <shape type="rectangle"><transform name="to_world"><rotate x="1" angle="90"/><translate x="-1" y="2.5"/></transform>
    <emitter type="area"/></shape>
</scene>"#;

/// Measured values are not symmetric in both directions, and light paths use them as camera paths do.
#[test]
fn integrators_agree_on_measured_materials() {
    let folder = Folder::with(SCENE);
    folder.write("m.bsdf", &Arrays::new(&azimuths()[1]).file(|_| true));
    folder.light_paths_agree(512);
}

#[test]
fn mistakes_are_told_in_sentences() {
    let arrays = || Arrays::new(&[0.0]);
    let mut spectral = arrays();
    spectral.0.iter_mut().filter(|a| a.0 == "rgb").for_each(|a| a.0 = "spectra");
    let whole = arrays().file(|_| true);
    let mut unordered = arrays();
    unordered.0[1].2[1] = -1.0;
    // The first array is the field jacobian; its type follows its name.
    let mut untyped = whole.clone();
    untyped[18 + 2 + 8 + 2] = 2;
    let mut few = arrays();
    few.0[0] = ("phi_i", vec![3], vec![0.0, 1.0, 2.0]);
    for (bytes, sentence) in [
        (b"ply".to_vec(), "expected a file that begins with tensor_file and the version 1.0"),
        (whole[..40].to_vec(), "the list of fields ends early"),
        (
            whole[..whole.len() - 4].to_vec(),
            "expected the field rgb to be an array of float32 with 5 dimensions",
        ),
        (arrays().file(|name| name != "sigma"), "the field sigma is missing"),
        (spectral.file(|_| true), "the file has spectra and no channels of RGB"),
        (
            arrays().constant("vndf", -1.0).file(|_| true),
            "vndf: expected finite values of at least 0, found -1",
        ),
        (
            arrays().constant("luminance", 0.0).file(|_| true),
            "expected densities with a positive sum for each viewer",
        ),
        (unordered.file(|_| true), "expected finite angles in increasing order"),
        (few.file(|_| true), "expected tables for 12 viewers"),
        (untyped, "expected the field jacobian to be an array of one uint8"),
        (
            arrays().constant("theta_i", f32::INFINITY).file(|_| true),
            "expected finite angles in increasing order",
        ),
        (arrays().constant("sigma", 0.0).file(|_| true), "expected some projected area of the microfacets"),
    ] {
        let folder = Folder::with(SCENE);
        folder.write("m.bsdf", &bytes);
        let run = folder.run("render s.xml -q -o x.exr");
        assert_eq!(run.code, 3, "{run:?}");
        assert!(run.stderr.contains(&format!("m.bsdf: {sentence}")), "{}", run.stderr);
    }
    let run = Folder::with(SCENE).run("render s.xml -q -o x.exr");
    assert!(run.code == 3 && run.stderr.contains("there is no file \"m.bsdf\""), "{run:?}");
}
