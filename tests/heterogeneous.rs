//! Media with coefficients that depend on the point: closed forms, energy, and agreement with homogeneous media.
//!
//! Each group of comparisons has a significance of 1 % with fixed seeds.

use crate::support::cli::Folder;
use crate::support::expect::Means;
use crate::support::scenes::{add, camera, compiled, constant, diffuse, render, sphere};
use buffon::accel::AccelKind;
use buffon::color::Rgb;
use buffon::emitter::Emitter;
use buffon::image::read;
use buffon::integrator::Settings;
use buffon::integrator::settings::PathLimits;
use buffon::material::{Material, Null};
use buffon::math::{DAffine3, DVec3, Vec3};
use buffon::medium::{Grid, Heterogeneous, Homogeneous, Medium, MediumBoundary, Phase, Volume};
use buffon::sampling::SamplerKind;
use buffon::scene::Description;
use buffon::shape::Shape;
use buffon::texture::{FilterType, WrapMode};
use std::sync::Arc;

const HG: Phase = Phase::HenyeyGreenstein { g: 0.6 };

fn volpath(max_depth: Option<u32>) -> Settings {
    Settings::Volpath(PathLimits { max_depth, ..PathLimits::default() })
}

/// Returns a grid over the cube from −1 to 1.
fn grid(size: [usize; 3], channels: usize, values: Vec<f32>, filter: FilterType) -> Volume {
    let grid = Grid::new(size, channels, values, filter, WrapMode::Clamp).expect("a grid");
    let to_world = DAffine3::from_translation(DVec3::splat(-1.0)) * DAffine3::from_scale(DVec3::splat(2.0));
    Volume::grid(Arc::new(grid), to_world).expect("an invertible transformation")
}

fn albedo(value: f32) -> Volume {
    Volume::constant(Rgb::splat(value), DAffine3::IDENTITY).expect("a volume")
}

/// Returns a scene whose camera looks along −z at the box of the medium, before a uniform environment.
fn filled(medium: Medium, angle: f64) -> Description {
    let mut scene = Description { emitters: vec![constant(1.0)], ..Description::default() };
    scene.sensors.push(camera(DVec3::new(0.1, 0.2, 5.0), DVec3::new(0.1, 0.2, 0.0), angle, 8));
    scene.media.push(medium);
    let id = add(&mut scene, Shape::Cube, DAffine3::from_scale(DVec3::splat(1.5)), Material::Null(Null));
    scene.shapes[id].boundary = MediumBoundary { interior: Some(0.into()), exterior: None };
    scene
}

fn heterogeneous(sigma_t: Volume, albedo: Volume, scale: f32, phase: Phase) -> Medium {
    Medium::Heterogeneous(Box::new(Heterogeneous::new(sigma_t, albedo, scale, phase)))
}

/// The camera's ray crosses the cells of the z axis at their centres in x and y. Its optical depth is the integral of
/// the interpolated values over the box of side 2; around the box, inside the boundary, there is vacuum.
#[test]
fn transmittance_is_that_of_the_integral_along_the_ray() {
    let values = [0.0f32, 2.0, 0.5, 40.0, 0.0, 1.0, 0.25];
    let n = values.len();
    // The value of a cell counts on its width; at the two ends, the outer halves are those of the ends themselves.
    let depth: f64 = values.iter().map(|v| f64::from(*v) * 2.0 / n as f64).sum();
    let channels = |v: f32| [v, 0.5 * v, 0.1 * v];
    let colours = values.iter().flat_map(|v| channels(*v)).collect::<Vec<_>>();
    let cases = [
        ("grey, linear", grid([1, 1, n], 1, values.to_vec(), FilterType::Bilinear), [1.0; 3]),
        ("grey, nearest", grid([1, 1, n], 1, values.to_vec(), FilterType::Nearest), [1.0; 3]),
        ("colours", grid([1, 1, n], 3, colours, FilterType::Bilinear), [1.0, 0.5, 0.1]),
    ];
    let group = Means::of_images(cases.len() * AccelKind::CHOICES.len() * 2, 2e-2);
    for (name, sigma_t, factors) in cases {
        // With albedo 0, and at a depth at which scattered light is lost.
        for (white, limit) in [(0.0, None), (0.9, Some(1))] {
            let scene = filled(heterogeneous(sigma_t.clone(), albedo(white), 0.2, HG), 1e-3);
            let exact = factors.map(|factor| (-0.2 * depth * factor).exp());
            for &accel in AccelKind::CHOICES {
                let rendered =
                    render(&compiled(scene.clone(), accel), &volpath(limit), SamplerKind::Sobol, 1024, 1);
                group.expect(&format!("{name}, {accel}, albedo {white}"), &rendered, exact);
            }
        }
    }
}

/// Returns values without any symmetry, of which some are zero and one is large.
fn clumps(size: [usize; 3], channels: usize) -> Vec<f32> {
    let value = |i: usize| match i % 7 {
        0 | 3 => 0.0,
        k => (k * (i % 5)) as f32 * 0.2,
    };
    let mut values: Vec<f32> = (0..size.iter().product::<usize>() * channels).map(value).collect();
    values[5] = 60.0;
    values
}

/// In a uniform environment, a medium that absorbs nothing is invisible, however its extinction varies.
#[test]
fn clouds_without_absorption_conserve_energy() {
    let size = [9, 17, 5];
    let cases = [("grey", 1, Phase::Isotropic), ("grey, forward", 1, HG), ("colours", 3, HG)];
    let group = Means::of_images(cases.len() * AccelKind::CHOICES.len(), 2e-2);
    for (name, channels, phase) in cases {
        let sigma_t = grid(size, channels, clumps(size, channels), FilterType::Bilinear);
        let scene = filled(heterogeneous(sigma_t, albedo(1.0), 2.0, phase), 30.0);
        for &accel in AccelKind::CHOICES {
            let rendered =
                render(&compiled(scene.clone(), accel), &volpath(None), SamplerKind::Sobol, 256, 3);
            group.expect(&format!("{name}, {accel}"), &rendered, [1.0; 3]);
        }
    }
}

/// A grid with the same value everywhere is a homogeneous medium in the same box, also if the bounds of the extinction
/// are far above it: a cell elsewhere in the box is a hundred times denser.
#[test]
fn equal_cells_are_a_homogeneous_medium() {
    let group = Means::of_images(2, 2e-2);
    let sigma = Rgb::new(0.6, 1.2, 0.3);
    for spike in [false, true] {
        let size = [4, 4, 40];
        let mut values: Vec<f32> = (0..4 * 4 * 40).flat_map(|_| sigma.to_array()).collect();
        if spike {
            // Beyond the reach of rays: the camera sees the lower cells in z, and only single scattering counts.
            values[..3].fill(120.0);
        }
        let medium =
            heterogeneous(grid(size, 3, values, FilterType::Nearest), albedo(0.8), 1.0, Phase::Isotropic);
        let lit = |mut scene: Description| {
            scene.emitters =
                vec![Emitter::Point { position: Vec3::new(0.3, 0.5, 3.0), intensity: Rgb::splat(9.0) }];
            let wall = DAffine3::from_translation(DVec3::Z * -3.0) * DAffine3::from_scale(DVec3::splat(4.0));
            add(&mut scene, Shape::Rectangle, wall, diffuse(0.5));
            compiled(scene, AccelKind::Auto)
        };
        let mut same = filled(
            Medium::Homogeneous(Homogeneous {
                sigma_t: sigma,
                sigma_s: sigma * 0.8,
                phase: Phase::Isotropic,
            }),
            8.0,
        );
        same.shapes[0].to_world = DAffine3::IDENTITY.into();
        let [varying, same] = [filled(medium, 8.0), same].map(lit);
        let [a, b] = [(&varying, 1), (&same, 2)]
            .map(|(scene, seed)| render(scene, &volpath(Some(2)), SamplerKind::Sobol, 1024, seed));
        group.expect_same(&format!("spike {spike}"), &a, &b);
    }
}

/// A ray that goes from fog into a grid of the same medium, or from there into fog, finds the light that it would find
/// in fog alone. The emitter is near the rays: in the grid, in the fog before it, and in the fog behind it.
#[test]
fn rays_pass_between_fog_and_a_grid() {
    let [grid_medium, fog_medium] = [0, 1];
    // The height of the camera, its medium, and the position of the emitter.
    let cases = [
        (5.0, fog_medium, Vec3::new(0.3, 0.4, 0.2)),
        (5.0, fog_medium, Vec3::new(0.1, 0.5, 2.5)),
        (0.9, grid_medium, Vec3::new(0.1, 0.5, -2.5)),
    ];
    let group = Means::of_images(2 * cases.len(), 2e-2);
    let sigma = Rgb::new(0.1, 0.2, 0.05);
    let fog = Homogeneous { sigma_t: sigma, sigma_s: sigma * 0.8, phase: Phase::Isotropic };
    for (height, start, position) in cases {
        let lit = |mut scene: Description| {
            scene.emitters = vec![Emitter::Point { position, intensity: Rgb::splat(9.0) }];
            scene.media.push(Medium::Homogeneous(fog.clone()));
            scene.sensors[0] = camera(DVec3::new(0.1, 0.2, height), DVec3::new(0.1, 0.2, -1.0), 8.0, 8);
            scene.sensors[0].medium = Some(start.into());
            scene.shapes[0].to_world = DAffine3::IDENTITY.into();
            scene.shapes[0].boundary.exterior = Some(fog_medium.into());
            compiled(scene, AccelKind::Auto)
        };
        let values = (0..4 * 4 * 4).flat_map(|_| sigma.to_array()).collect();
        let cells = grid([4, 4, 4], 3, values, FilterType::Nearest);
        let varying = lit(filled(heterogeneous(cells, albedo(0.8), 1.0, Phase::Isotropic), 8.0));
        let same = lit(filled(Medium::Homogeneous(fog.clone()), 8.0));
        for max_depth in [Some(2), Some(4)] {
            let [a, b] = [(&varying, 1), (&same, 2)]
                .map(|(scene, seed)| render(scene, &volpath(max_depth), SamplerKind::Sobol, 4096, seed));
            group.expect_same(&format!("{position}, {max_depth:?}"), &a, &b);
        }
    }
}

/// The aligned box of a needle that is rotated is 10^6 times as wide as the needle. Its bounds are found all the same.
#[test]
fn a_rotated_needle_fills_its_box() {
    let grid =
        Grid::new([16, 2, 2], 1, vec![0.5; 64], FilterType::Bilinear, WrapMode::Clamp).expect("a grid");
    let to_world = DAffine3::from_axis_angle(DVec3::new(1.0, 2.0, 3.0).normalize(), 0.7)
        * DAffine3::from_scale(DVec3::new(2.0, 2e-6, 2e-6))
        * DAffine3::from_translation(DVec3::splat(-0.5));
    let sigma_t = Volume::grid(Arc::new(grid), to_world).expect("an invertible transformation");
    let [low, high] = sigma_t.world_box();
    let mut scene = filled(heterogeneous(sigma_t, albedo(0.0), 1.0, HG), 1e-3);
    // The camera looks along x through the middle of the box.
    scene.sensors[0] = camera(DVec3::X * 5.0, DVec3::ZERO, 1e-3, 4);
    let exact = [(-0.5 * (high.x - low.x)).exp(); 3];
    let rendered = render(&compiled(scene, AccelKind::Auto), &volpath(None), SamplerKind::Sobol, 4096, 1);
    Means::of_images(1, 2e-2).expect("a needle", &rendered, exact);
}

/// A sensor and a surface inside the medium, and the walls of a furnace: the radiance is 1.
#[test]
fn clouds_in_a_furnace_are_invisible() {
    let size = [6, 5, 12];
    let group = Means::of_images(AccelKind::CHOICES.len(), 1e-2);
    let mut scene = Description::default();
    let room = add(&mut scene, sphere(0.9), DAffine3::IDENTITY, diffuse(0.5));
    scene.shapes[room].emission = Some(Rgb::splat(0.5).into());
    scene.shapes[room].flip_normals = true;
    let sigma_t = grid(size, 1, clumps(size, 1), FilterType::Bilinear);
    scene.media.push(heterogeneous(sigma_t, albedo(1.0), 0.5, HG));
    scene.shapes[room].boundary.exterior = Some(0.into());
    scene.sensors.push(camera(DVec3::new(0.2, 0.1, -0.3), DVec3::new(-0.3, 0.4, 0.5), 90.0, 12));
    scene.sensors[0].medium = Some(0.into());
    for &accel in AccelKind::CHOICES {
        let rendered = render(&compiled(scene.clone(), accel), &volpath(None), SamplerKind::Sobol, 128, 3);
        group.expect(&format!("{accel}"), &rendered, [1.0; 3]);
    }
}

/// Returns the bytes of a volume file.
fn file(size: [i32; 3], channels: i32, values: &[f32]) -> Vec<u8> {
    let mut bytes = b"VOL\x03".to_vec();
    for n in [1, size[0], size[1], size[2], channels] {
        bytes.extend(n.to_le_bytes());
    }
    for x in [-1.0f32, -1.0, -1.0, 1.0, 1.0, 1.0].iter().chain(values) {
        bytes.extend(x.to_le_bytes());
    }
    bytes
}

fn scene(medium: &str) -> String {
    format!(
        "<scene version='3.0.0'><integrator type='volpath'/><emitter type='constant'/>
         <sensor type='perspective'><transform name='to_world'><translate z='-5'/></transform><film type='hdrfilm'><integer name='width' value='4'/>
         <integer name='height' value='4'/></film></sensor>
         <shape type='cube'><bsdf type='null'/><medium type='heterogeneous' name='interior'>{medium}</medium></shape>
         </scene>"
    )
}

fn grid_element(more: &str) -> String {
    format!("<volume type='gridvolume' name='sigma_t'><string name='filename' value='a.vol'/>{more}</volume>")
}

/// A volume is placed by the box of its file or not, and always in Mitsuba 0.6.
#[test]
fn volumes_are_read() {
    let in_box = grid_element("<boolean name='use_grid_bbox' value='true'/>");
    let old = grid_element("").replace("sigma_t", "density");
    let old = format!("{old}<string name='method' value='woodcock'/>");
    let [a, b, c] = [in_box, old, grid_element("")].map(|medium| {
        let folder = Folder::with(&scene(&medium));
        folder.write("a.vol", &file([2, 1, 1], 1, &[0.5, 1.5]));
        folder.render("s.xml -q -o a.exr --spp 4");
        read(&folder.path("a.exr")).expect("an image").data
    });
    assert!(a == b && a != c);
}

#[test]
fn mistakes_of_volumes_are_told_in_sentences() {
    let folder = Folder::with(&scene(&grid_element("")));
    let told = |bytes: &[u8]| {
        folder.write("a.vol", bytes);
        let run = folder.run("render s.xml -o c.exr --spp 1");
        assert_eq!(run.code, 3, "{}", run.stderr);
        run.stderr
    };
    let whole = file([2, 1, 1], 1, &[0.5, 1.5]);
    let changed = |i: usize, byte: u8| {
        let mut bytes = whole.clone();
        bytes[i] = byte;
        bytes
    };
    for (bytes, message) in [
        (b"VOLUME".to_vec(), "expected a file that begins with VOL and the version 3"),
        (changed(3, 2), "expected a file that begins with VOL and the version 3"),
        (whole[..30].to_vec(), "expected a header of 48 bytes, found 30 bytes"),
        (changed(4, 3), "expected the encoding 1, which is float32, found 3"),
        (
            whole[..52].to_vec(),
            "expected 2 x 1 x 1 cells of 1 float32 values after the header, found 4 bytes",
        ),
        (
            file([-2, 1, 1], 1, &[]),
            "expected -2 x 1 x 1 cells of 1 float32 values after the header, found 0 bytes",
        ),
        (file([1, 1, 1], 2, &[1.0; 2]), "expected one or three values for each cell, found 2"),
        (file([1, 1, 1], 1, &[-1.0]), "expected finite values of at least 0, found -1"),
        (file([1, 1, 1], 1, &[f32::NAN]), "expected finite values of at least 0, found NaN"),
    ] {
        let told = told(&bytes);
        assert!(told.contains(message) && told.contains("a.vol"), "{told}");
    }
    let medium = grid_element("") + "<float name='scale' value='10'/>";
    folder.write("s.xml", scene(&medium).as_bytes());
    let told = told(&file([1, 1, 1], 1, &[3e38]));
    assert!(told.contains("for which the coefficients are finite"), "{told}");
}
