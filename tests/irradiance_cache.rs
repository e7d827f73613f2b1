//! The irradiance cache: closed forms, agreement with path tracing, files, threads.

use crate::path_reuse::from_xml;
use crate::support::cli::Folder;
use crate::support::scenes::{add, camera, compiled, constant, diffuse, mean, pixels, render, sphere};
use buffon::accel::AccelKind;
use buffon::color::Rgb;
use buffon::integrator::Settings;
use buffon::integrator::settings::{IrrcacheSettings, PathLimits};
use buffon::material::{Dielectric, Diffuse, Input, Interface, Material, TwoSided};
use buffon::math::{DAffine3, DVec3, Vec3};
use buffon::sampling::SamplerKind;
use buffon::scene::Description;
use buffon::shape::Shape;

fn irrcache(quality: f32) -> Settings {
    Settings::Irrcache(IrrcacheSettings { quality, ..IrrcacheSettings::default() })
}

fn path() -> Settings {
    Settings::Path(PathLimits::default().into())
}

/// Adds a rectangle with the given centre, half edges and emission.
fn rectangle(scene: &mut Description, centre: Vec3, x: Vec3, y: Vec3, material: Material, emission: f32) {
    let n = x.cross(y).normalize();
    let matrix = glam::DMat3::from_cols(x.as_dvec3(), y.as_dvec3(), n.as_dvec3());
    let place = DAffine3::from_mat3_translation(matrix, centre.as_dvec3());
    let id = add(scene, Shape::Rectangle, place, material);
    if emission > 0.0 {
        scene.shapes[id].emission = Some(Rgb::splat(emission).into());
    }
}

#[test]
fn furnaces_are_as_bright_as_they_must_be() {
    check_furnace(Shape::Cube);
}

#[test]
#[ignore = "takes long: make test-all"]
fn round_furnaces_are_as_bright_as_they_must_be() {
    check_furnace(sphere(1.0));
}

/// A closed box or sphere with emission 1 and albedo a has the radiance 1/(1 − a).
fn check_furnace(shape: Shape) {
    let albedo = Rgb::new(0.1, 0.5, 0.9);
    let mut scene = Description::default();
    let id =
        add(&mut scene, shape, DAffine3::IDENTITY, Material::Diffuse(Diffuse { reflectance: albedo.into() }));
    scene.shapes[id].emission = Some(Rgb::splat(1.0).into());
    scene.shapes[id].flip_normals = true;
    scene.sensors.push(camera(DVec3::new(0.2, 0.1, -0.3), DVec3::new(-0.3, 0.4, 0.5), 90.0, 64));
    // Ten bounces are noisy and a furnace needs few records, so each record has many rays.
    let settings = IrrcacheSettings { resolution: 32, ..IrrcacheSettings::default() };
    let scene = compiled(scene, AccelKind::default());
    let rendered = render(&scene, &Settings::Irrcache(settings), SamplerKind::Sobol, 32, 1);
    let (mean, _) = mean(&rendered);
    for (mean, exact) in mean.into_iter().zip([1.0 / 0.9, 2.0, 10.0]) {
        assert!((mean / exact - 1.0).abs() < 5e-3, "{mean} instead of {exact}");
    }
}

/// A sphere of albedo 0.5 in a constant environment of 1 has the radiance 0.5.
#[test]
fn a_sphere_in_constant_light_is_its_albedo() {
    let mut scene = Description::default();
    add(&mut scene, sphere(1.0), DAffine3::IDENTITY, diffuse(0.5));
    scene.emitters.push(constant(1.0));
    scene.sensors.push(camera(DVec3::new(0.0, 0.0, 4.0), DVec3::ZERO, 25.0, 64));
    let rendered = render(&compiled(scene, AccelKind::default()), &irrcache(1.0), SamplerKind::Sobol, 64, 1);
    let (mean, _) = mean(&rendered);
    // The sphere covers the image except for its corners, which show the environment. The covered fraction is measured.
    let sphere = pixels(&rendered).iter().filter(|p| p[0] < 0.75).count() as f64 / (64.0 * 64.0);
    let exact = 0.5 * sphere + (1.0 - sphere);
    assert!((mean[0] / exact - 1.0).abs() < 5e-3, "{mean:?} instead of {exact}");
    let centre = pixels(&rendered)[32 * 64 + 32][0];
    assert!((centre / 0.5 - 1.0).abs() < 5e-3, "{centre}");
}

/// Returns a box with an open front, an emitter, a glass sphere (caustics) and a diffuse sphere.
fn room() -> Description {
    let mut scene = Description::default();
    let (x, y, z) = (Vec3::X, Vec3::Y, Vec3::Z);
    rectangle(&mut scene, -y, z, x, diffuse(0.7), 0.0);
    rectangle(&mut scene, y, x, z, diffuse(0.7), 0.0);
    rectangle(&mut scene, -z, x, y, diffuse(0.6), 0.0);
    rectangle(
        &mut scene,
        -x,
        y,
        z,
        Material::Diffuse(Diffuse { reflectance: Rgb::new(0.6, 0.1, 0.1).into() }),
        0.0,
    );
    rectangle(
        &mut scene,
        x,
        z,
        y,
        Material::Diffuse(Diffuse { reflectance: Rgb::new(0.1, 0.5, 0.1).into() }),
        0.0,
    );
    rectangle(&mut scene, y * 0.98, x * 0.3, z * 0.3, diffuse(0.0), 12.0);
    let interface =
        Interface { int_ior: 1.5, ext_ior: 1.0, specular_reflectance: Input::Constant(Rgb::WHITE) };
    let glass =
        Material::Dielectric(Dielectric { interface, specular_transmittance: Input::Constant(Rgb::WHITE) });
    let at = |p: DVec3| DAffine3::from_translation(p);
    add(&mut scene, sphere(0.35), at(DVec3::new(0.45, -0.65, 0.2)), glass);
    add(&mut scene, sphere(0.35), at(DVec3::new(-0.4, -0.65, -0.3)), diffuse(0.8));
    scene.sensors.push(camera(DVec3::new(0.0, 0.0, 3.2), DVec3::ZERO, 40.0, 64));
    scene
}

/// The cache agrees with path tracing, including caustics and light that is seen through glass.
#[test]
fn a_room_with_glass_is_as_bright_as_by_path_tracing() {
    let scene = compiled(room(), AccelKind::default());
    let reference = render(&scene, &path(), SamplerKind::Sobol, 2048, 7);
    let (wanted, error) = mean(&reference);
    let rendered = render(&scene, &irrcache(1.0), SamplerKind::Sobol, 512, 1);
    assert_eq!(rendered.invalid_count, 0);
    let (found, noise) = mean(&rendered);
    for c in 0..3 {
        let allowed = 0.012 * wanted[c] + 4.0 * error[c].hypot(noise[c]);
        assert!((found[c] - wanted[c]).abs() < allowed, "{found:?} instead of {wanted:?}, ± {error:?}");
    }
}

/// No light passes a wall without thickness between a bright and a dark part with a common floor.
#[test]
fn nothing_leaks_through_a_wall_without_thickness() {
    let mut scene = Description::default();
    let (x, y, z) = (Vec3::X, Vec3::Y, Vec3::Z);
    let two_sided = |scene: &mut Description| {
        let id = buffon::ids::MaterialId::from(scene.materials.len());
        scene.materials.push(diffuse(0.8));
        Material::TwoSided(TwoSided { sides: [id; 2] })
    };
    rectangle(&mut scene, -y, z * 2.0, x * 2.0, diffuse(0.8), 0.0);
    rectangle(&mut scene, y, x * 2.0, z * 2.0, diffuse(0.8), 0.0);
    for wall in [-x * 2.0, x * 2.0, Vec3::ZERO] {
        let material = two_sided(&mut scene);
        rectangle(&mut scene, wall, y, z * 2.0, material, 0.0);
    }
    for wall in [-z * 2.0, z * 2.0] {
        let material = two_sided(&mut scene);
        rectangle(&mut scene, wall, x * 2.0, y, material, 0.0);
    }
    rectangle(&mut scene, x + y * 0.9, x * 0.3, z * 0.3, diffuse(0.0), 10.0);
    // The camera is below the ceiling of the dark part.
    scene.sensors.push(camera(DVec3::new(-0.9, 0.9, 0.0), DVec3::new(-0.9, -1.0, 0.0), 75.0, 48));
    let scene = compiled(scene, AccelKind::default());
    let rendered = render(&scene, &irrcache(1.0), SamplerKind::Sobol, 16, 1);
    let lit = pixels(&rendered).iter().filter(|p| p.iter().any(|c| *c > 0.0)).count();
    assert_eq!(lit, 0, "pixels of the dark side are lit");
}

/// Records on a floor beside a sheet are dark. They must not reach below the sheet, where the floor is seen and lit
/// only through it.
#[test]
fn records_beside_a_sheet_do_not_reach_below_it() {
    for (gap, size) in [(0.02, 160), (1.0, 160)] {
        let scene = from_xml(
            &format!(
                "<shape type='rectangle'><transform name='to_world'><scale value='6'/><rotate x='1' angle='-90'/>
                    </transform><bsdf type='diffuse'/></shape>
                <shape type='rectangle'><transform name='to_world'><rotate x='1' angle='-90'/>
                    <translate y='{gap}'/></transform>
                    <bsdf type='difftrans'><rgb name='transmittance' value='0.6'/></bsdf></shape>
                <shape type='rectangle'><transform name='to_world'><rotate x='1' angle='90'/><translate y='4'/>
                    </transform><emitter type='area'><rgb name='radiance' value='10'/></emitter></shape>"
            ),
            size,
        );
        let [(wanted, error), (found, noise)] = [(path(), 32), (irrcache(1.0), 16)]
            .map(|(settings, spp)| mean(&render(&scene, &settings, SamplerKind::Sobol, spp, 1)));
        let allowed = 0.05 * wanted[0] + 4.0 * error[0].hypot(noise[0]);
        println!("gap {gap}: {} instead of {}", found[0], wanted[0]);
        assert!((found[0] - wanted[0]).abs() < allowed, "gap {gap}: {} instead of {}", found[0], wanted[0]);
    }
}

const SCENE: &str = r#"<scene version="3.0.0">
  <default name="quality" value="1"/><default name="grey" value="0.6"/><default name="x" value="0"/>
  <integrator type="irrcache"><float name="quality" value="$quality"/></integrator>
  <sensor type="perspective"><float name="fov" value="50"/>
    <transform name="to_world"><lookat origin="$x,1,4" target="0,0.5,0" up="0,1,0"/></transform>
    <film type="hdrfilm"><integer name="width" value="60"/><integer name="height" value="40"/>
      <string name="component_format" value="float32"/></film></sensor>
  <bsdf type="twosided" id="grey"><bsdf type="diffuse"><rgb name="reflectance" value="$grey"/></bsdf></bsdf>
  <shape type="rectangle"><transform name="to_world"><scale value="3"/><rotate x="1" angle="-90"/></transform>
    <ref id="grey"/></shape>
  <shape type="cube"><transform name="to_world"><scale value="0.4"/><translate x="-0.8" y="0.4"/></transform>
    <ref id="grey"/></shape>
  <shape type="sphere"><point name="center" value="0.7,0.5,0"/><float name="radius" value="0.5"/>
    <bsdf type="roughplastic"/></shape>
  <shape type="rectangle"><transform name="to_world"><rotate x="1" angle="90"/><translate y="3"/></transform>
    <emitter type="area"><rgb name="radiance" value="5"/></emitter></shape>
</scene>"#;

#[test]
fn threads_change_no_bit_of_picture_and_cache() {
    let folder = Folder::with(SCENE);
    for threads in [1, 2, 5] {
        folder.render(&format!("s.xml --spp 4 -q -t {threads} -o {threads}.pfm --cache {threads}.cache"));
    }
    for name in ["pfm", "cache"] {
        let one = folder.read(&format!("1.{name}"));
        for threads in [2, 5] {
            assert!(folder.read(&format!("{threads}.{name}")) == one, "{threads} threads: {name}");
        }
    }
}

#[test]
fn a_kept_cache_gives_the_same_picture_and_grows_with_new_views() {
    let folder = Folder::with(SCENE);
    folder.render("s.xml --spp 4 -q -o a.pfm --cache c");
    let first = folder.read("c");
    folder.render("s.xml --spp 4 -q -o b.pfm --cache c");
    assert!(folder.read("a.pfm") == folder.read("b.pfm"));
    assert!(folder.read("c") == first);
    folder.render("s.xml --spp 4 -q -D x=2 -o d.pfm --cache c");
    let grown = folder.read("c");
    assert!(grown.len() > first.len(), "{} bytes", grown.len());
    folder.render("s.xml --spp 4 -q -D x=2 -o e.pfm --cache c");
    assert!(folder.read("d.pfm") == folder.read("e.pfm"));
}

#[test]
fn stale_and_foreign_caches_are_refused_and_kept() {
    let folder = Folder::with(SCENE);
    folder.render("s.xml --spp 2 -q -o a.pfm --cache c");
    let (cache, picture) = (folder.read("c"), folder.read("a.pfm"));
    folder.write("foreign", b"a picture of a cat");
    for (arguments, said) in [
        ("-D grey=0.5 --cache c", "holds records of another scene"),
        ("-D quality=2 --cache c", "holds records of other settings"),
        ("--cache foreign", "is not a file of irradiance records"),
        ("--integrator path --cache c", "path has no preparation that a file could store"),
        ("--integrator path --aov record_radius", "has no irradiance records"),
    ] {
        let run = folder.run(&format!("render s.xml --spp 2 -q -o a.exr {arguments}"));
        assert!(run.code != 0 && run.stderr.contains(said), "{arguments}: {run:?}");
    }
    assert!(folder.read("c") == cache && folder.read("a.pfm") == picture);
    assert_eq!(folder.read("foreign"), b"a picture of a cat");
}

#[test]
fn mistakes_in_the_scene_are_told() {
    for (from, to, said) in [
        ("</integrator>", "<integrator type=\"direct\"/></integrator>", "any number of bounces"),
        ("</integrator>", "<integer name=\"resolution\" value=\"1\"/></integrator>", "resolution"),
        ("</integrator>", "<float name=\"quality_adjustment\" value=\"1.5\"/></integrator>", "at most 1"),
        (
            "</integrator>",
            "<boolean name=\"overture\" value=\"false\"/></integrator>",
            "expected --cache FILE",
        ),
    ] {
        let folder = Folder::with(&SCENE.replacen(from, to, 1));
        let run = folder.run("render s.xml --spp 2 -q -o a.pfm");
        assert!(run.code == 3 && run.stderr.contains(said), "{to}: {run:?}");
    }
}

/// The debug image shows records as dots, and the layer contains their radii.
#[test]
fn debugging_shows_records() {
    let folder = Folder::with(&SCENE.replacen(
        "</integrator>",
        "<boolean name=\"debug\" value=\"true\"/></integrator>",
        1,
    ));
    folder.render("s.xml --spp 16 -q -o a.exr");
    let image = buffon::image::read(&folder.path("a.exr")).expect("the image");
    let layer = image.channel("record_radius.R").expect("the layer");
    let pixels: Vec<_> =
        (0..image.width * image.height).map(|i| image.pixel(i % image.width, i / image.width)).collect();
    let radii = pixels.iter().filter(|p| p[layer] > 0.0).count();
    assert!(radii > pixels.len() / 4, "{radii} of {}", pixels.len());
    let yellow = pixels.iter().filter(|p| p[0] > 0.5 && p[1] > 0.45 && p[2] < 0.3 * p[0]);
    assert!(yellow.count() > 5);
}
