//! Photon maps, and the integrator that gathers from them.

use crate::support::cli::{Folder, SCENE};
use crate::support::scenes::{add, camera, compiled, diffuse};
use buffon::accel::AccelKind;
use buffon::color::Rgb;
use buffon::emitter::Emitter;
use buffon::image::{Image, read};
use buffon::integrator::photon::boundary::Boundary;
use buffon::integrator::photon::{
    DensityEstimator, IrradianceMap, Kernel, LightPathTracer, LookupPoint, PathLimit, PathSequence, Photon,
    PhotonMap, PhotonPaths, kdtree::NeighbourBuffer,
};
use buffon::math::{DAffine3, DQuat, DVec3, Vec3};
use buffon::render::thread_pool;
use buffon::sampling::{Sampler, SamplerKind};
use buffon::scene::{Description, Scene};
use buffon::shape::Shape;
use std::f64::consts::PI;

/// Returns a floor from −1 to 1 under a point emitter of intensity 1 at a height.
fn lit_floor(height: f32) -> Scene {
    let mut scene = Description::default();
    let up = DAffine3::from_quat(DQuat::from_rotation_x(-PI / 2.0));
    add(&mut scene, Shape::Rectangle, up, diffuse(0.5));
    scene.emitters.push(Emitter::Point { position: Vec3::Y * height, intensity: Rgb::WHITE });
    scene.sensors.push(camera(DVec3::new(0.0, 3.0, 3.0), DVec3::ZERO, 40.0, 8));
    compiled(scene, AccelKind::default())
}

fn map(scene: &Scene, count: u64, threads: usize) -> PhotonMap {
    let pool = thread_pool(threads).expect("the threads start");
    let sampler = Sampler::new(SamplerKind::Sobol, None);
    let tracer = LightPathTracer {
        scene,
        sampler,
        guide: None,
        pool: &pool,
        interrupt: &buffon::integrator::Interrupt::default(),
        time: None,
    };
    let paths = PhotonPaths { max_edges: None, rr_depth: 5, direct: true, indirect: true };
    let sequence = PathSequence { seed: 1, stream: 0, number: 0, first: 0 };
    let cast = tracer.cast(&paths, sequence, PathLimit { paths: u64::MAX, kept: Some(count) }, |d, _| {
        Photon::new(d.p, d.shading_power(), d.wi, d.surface.ng)
    });
    pool.install(|| PhotonMap::new(cast.kept, cast.emitted))
}

const UP: fn(f32) -> LookupPoint = |x| LookupPoint { p: Vec3::new(x, 0.0, 0.0), n: Vec3::Y };

#[test]
fn the_map_alone_knows_the_irradiance_below_a_point_light() {
    let height = 2.0f32;
    let scene = lit_floor(height);
    let photons = map(&scene, 400_000, 2);
    assert_eq!(photons.dropped(), 0);
    for kernel in Kernel::ALL {
        let estimator = DensityEstimator { kernel, lookup_size: 4000, lookup_radius: 0.2 };
        for x in [0.0, 0.3, 0.6] {
            let value = estimator.irradiance(&photons, UP(x), &mut NeighbourBuffer::default()).value.g;
            let expected = height / (height * height + x * x).powf(1.5);
            assert!((value / expected - 1.0).abs() < 0.01, "{kernel} at {x}: {value}, not {expected}");
        }
    }
    let one = map(&scene, 20_000, 1);
    assert!(one.photons().eq(map(&scene, 20_000, 5).photons()), "threads change nothing");
}

/// At an edge the surface fills half of the disk, at a corner a quarter.
#[test]
#[ignore = "takes long: make test-all"]
fn irradiance_from_beforehand_is_right_up_to_the_edges() {
    let scene = lit_floor(6.0);
    let photons = map(&scene, 4_000_000, 2);
    let estimator = DensityEstimator { kernel: Kernel::Epanechnikov, lookup_size: 400, lookup_radius: 0.2 };
    let boundary = Boundary::new(&scene);
    let [plain, corrected] = [None, Some(&boundary)]
        .map(|boundary| IrradianceMap::new(&photons, &photons, &estimator, 4, boundary));
    let mean = |map: &IrradianceMap, place: &dyn Fn(f32) -> Vec3| {
        let ratio = |t: f32| {
            let p = place(t);
            let expected = 6.0 / (36.0 + p.length_squared()).powf(1.5);
            map.nearest(LookupPoint { p, n: Vec3::Y }).expect("there are points").value.g / expected
        };
        (0..40).map(|i| f64::from(ratio(i as f32 / 40.0 - 0.5))).sum::<f64>() / 40.0
    };
    let inside: &dyn Fn(f32) -> Vec3 = &|t| Vec3::new(t, 0.0, 0.3 * t);
    let edge: &dyn Fn(f32) -> Vec3 = &|t| Vec3::new(t, 0.0, 1.0);
    // Only very few points are near the four corners.
    let corner: &dyn Fn(f32) -> Vec3 = &|t| {
        let quarter = ((t + 0.5) * 4.0) as u32;
        let sign = |bit: u32| if quarter >> bit & 1 == 0 { -1.0 } else { 1.0 };
        Vec3::new(sign(0) * (1.0 - 0.01 * t.abs()), 0.0, sign(1))
    };
    let cases = [(inside, 0.97, 1.03, 0.03), (edge, 0.45, 0.6, 0.1), (corner, 0.2, 0.4, 0.1)];
    for (place, low, high, tolerance) in cases {
        let ratio = mean(&plain, place);
        assert!(low < ratio && ratio < high, "uncorrected: {ratio}");
        let ratio = mean(&corrected, place);
        assert!((ratio - 1.0).abs() < tolerance, "corrected: {ratio}");
    }
}

#[test]
fn light_does_not_pass_below_a_wall() {
    check_below_a_wall(400_000, 40, 0.2);
}

#[test]
#[ignore = "takes long: make test-all"]
fn light_does_not_pass_below_a_wall_with_millions_of_photons() {
    check_below_a_wall(4_000_000, 200, 0.02);
}

/// A wall without thickness stands on a floor. Light of one side does not reach the other side below it. The emitter of
/// one side has the intensity 1, that of the other side `dark`.
fn check_below_a_wall(photons: u64, lookup_size: usize, dark: f32) {
    let mut scene = Description::default();
    let up = DAffine3::from_quat(DQuat::from_rotation_x(-PI / 2.0));
    add(&mut scene, Shape::Rectangle, up, diffuse(0.5));
    let across =
        DAffine3::from_quat(DQuat::from_rotation_y(PI / 2.0)) * DAffine3::from_scale(DVec3::splat(9.0));
    add(&mut scene, Shape::Rectangle, across, diffuse(0.0));
    for (x, intensity) in [(-3.0, 1.0), (3.0, dark)] {
        let position = Vec3::new(x, 4.0, 0.0);
        scene.emitters.push(Emitter::Point { position, intensity: Rgb::splat(intensity) });
    }
    scene.sensors.push(camera(DVec3::new(0.0, 3.0, 3.0), DVec3::ZERO, 40.0, 8));
    let scene = compiled(scene, AccelKind::default());
    let photons = map(&scene, photons, 2);
    let estimator = DensityEstimator { kernel: Kernel::Epanechnikov, lookup_size, lookup_radius: 0.2 };
    let boundary = Boundary::new(&scene);
    let map = IrradianceMap::new(&photons, &photons, &estimator, 1, Some(&boundary));
    for (side, intensity) in [(-1.0, 1.0), (1.0, dark)] {
        let (mut sum, mut known) = (0.0, 0);
        for i in 0..400 {
            let p = Vec3::new(side * 0.002 * (i / 5) as f32, 0.0, 0.2 * (i % 5) as f32 - 0.4);
            let found = map.nearest(LookupPoint { p: p + Vec3::X * side * 0.001, n: Vec3::Y });
            // If the nearest known point is beyond the wall, the lookup must report that the space between is not free.
            let Some(found) = found.filter(|f| f.radius.is_finite() && (f.free || f.at.p.x * side > 0.0))
            else {
                continue;
            };
            let to = Vec3::new(3.0 * side, 4.0, 0.0) - found.at.p;
            sum += f64::from(found.value.g / (intensity * 4.0 / to.length().powi(3)));
            known += 1;
        }
        let mean = sum / f64::from(known);
        assert!(known > 100 && (mean - 1.0).abs() < 0.1, "side {side}: {mean} of {known}");
    }
}

/// A closed scene with an emitter, a mirror, glass, polished metal and coated plastic.
const ROOM: &str = r#"<scene version="3.0.0">
  <default name="integrator" value="path"/>
  <integrator type="$integrator"><integer name="max_depth" value="12"/></integrator>
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
    <bsdf type="$ball"/>
  </shape>
  <shape type="sphere">
    <point name="center" value="1.1,0.4,0"/><float name="radius" value="0.4"/>
    <bsdf type="plastic"><rgb name="diffuse_reflectance" value="0.1,0.3,0.6"/></bsdf>
  </shape>
</scene>
"#;

/// The beginning of a photon mapper element with few photons.
const FEW: &str = "type=\"photonmapper\"><integer name=\"global_photons\" value=\"20000\"/>\
    <integer name=\"caustic_photons\" value=\"20000\"/>";

/// Replaces the integrator `path` of a scene by a photon mapper with few photons.
fn with_few_photons(scene: &str, path: &str) -> String {
    assert!(scene.contains(path), "the scene has no {path}");
    scene.replacen(path, FEW, 1)
}

fn picture(folder: &Folder, name: &str, arguments: &str) -> Image {
    folder.render(&format!("s.xml -q -o {name}.exr {arguments}"));
    read(&folder.path(&format!("{name}.exr"))).expect("an image")
}

fn mean(image: &Image) -> f64 {
    image.data.iter().map(|v| f64::from(*v)).sum::<f64>() / image.data.len() as f64
}

#[test]
fn the_picture_is_that_of_a_path_tracer_but_for_a_small_bias() {
    check_bias(&["dielectric"]);
}

#[test]
#[ignore = "takes long: make test-all"]
fn the_picture_is_that_of_a_path_tracer_for_other_materials() {
    check_bias(&["diffuse", "roughconductor"]);
}

/// The bias is small, in the mean of the image and in the means of blocks of 6×6 pixels.
fn check_bias(balls: &[&str]) {
    let folder = Folder::with(ROOM);
    for ball in balls {
        let path = picture(&folder, "path", &format!("-D ball={ball} --seed 1 --spp 1024"));
        let options = format!("-D ball={ball} -D integrator=photonmapper --seed 2 --spp 128");
        let mapped = picture(&folder, "mapped", &options);
        let (one, other) = (mean(&path), mean(&mapped));
        assert!((other / one - 1.0).abs() < 0.02, "{ball}: {other}, not {one}");
        for block in 0..12 {
            let (x, y) = (block % 4 * 6, block / 4 * 6);
            let [one, other] = [&path, &mapped].map(|image| mean(&image.crop(x, y, 6, 6).expect("a part")));
            assert!((other / one - 1.0).abs() < 0.08, "{ball}, block {block}: {other}, not {one}");
        }
    }
}

/// Each kind of emitter is in a box of its own. Path tracing and photon mapping agree in each of them.
#[test]
#[ignore = "takes long: make test-all"]
fn every_kind_of_light_is_mapped() {
    let folder = Folder::of_scene("photon", "emitters.xml");
    let path = picture(&folder, "path", "--size 52x28 --seed 1 --spp 4096 --sampler sobol");
    let options = "--size 52x28 --integrator photonmapper --seed 2 --spp 512 --sampler sobol";
    let mapped = picture(&folder, "mapped", options);
    for place in 0..8 {
        let (x, y) = (place % 4 * 13, place / 4 * 14);
        let [one, other] = [&path, &mapped].map(|image| mean(&image.crop(x, y, 13, 14).expect("a part")));
        assert!((other / one - 1.0).abs() < 0.02, "box {place}: {other}, not {one}");
    }
}

#[test]
fn an_irradiance_cache_can_gather_from_photons() {
    check_gathering_from_photons("dielectric");
}

#[test]
#[ignore = "takes long: make test-all"]
fn an_irradiance_cache_can_gather_from_photons_without_caustics() {
    check_gathering_from_photons("diffuse");
}

/// The photon mapper can be the child of an irradiance cache. Caustics are then computed by photons, and paths do not
/// search for them.
fn check_gathering_from_photons(ball: &str) {
    let around = |child: &str| {
        let cached = ROOM.replace(
            "<integrator type=\"$integrator\"><integer name=\"max_depth\" value=\"12\"/></integrator>",
            &format!("<integrator type=\"irrcache\"><integrator type=\"{child}\"/></integrator>"),
        );
        Folder::with(&cached)
    };
    let (photons, paths, plain) = (around("photonmapper"), around("path"), Folder::with(ROOM));
    let path = mean(&picture(&plain, "path", &format!("-D ball={ball} --spp 1024 --sampler sobol")));
    let noise = |folder: &Folder| {
        let cached = picture(folder, "cached", &format!("-D ball={ball} --spp 64 --stats s.json"));
        let cached = mean(&cached);
        assert!((cached / path - 1.0).abs() < 0.03, "{ball}: {cached}, not {path}");
        let stats: serde_json::Value = serde_json::from_slice(&folder.read("s.json")).expect("JSON");
        stats["relmse_estimate"].as_f64().expect("a number")
    };
    let (photons, paths) = (noise(&photons), noise(&paths));
    assert!(ball == "diffuse" || photons < 0.25 * paths, "{photons}, by paths {paths}");
}

/// Emitters are hidden from the camera, not from records. If the camera sees none, nothing changes.
#[test]
fn hidden_emitters_light_an_irradiance_cache_as_others_do() {
    let folder = Folder::with(&ROOM.replace(
        "<integrator type=\"$integrator\"><integer name=\"max_depth\" value=\"12\"/></integrator>",
        &format!(
            "<integrator type=\"irrcache\"><integrator {FEW}\
         <boolean name=\"hide_emitters\" value=\"$hide\"/></integrator></integrator>"
        ),
    ));
    let of = |hide: &str| picture(&folder, hide, &format!("-D ball=diffuse -D hide={hide} --spp 4"));
    assert!(of("true").data == of("false").data);
}

#[test]
fn pixels_do_not_depend_on_threads_or_crops() {
    let folder = Folder::with(&with_few_photons(SCENE, "type=\"path\">"));
    let picture = |name: &str, options: &str| {
        let small = "-D spp=4";
        picture(&folder, name, &format!("{small} {options}"))
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

#[test]
fn maps_are_kept_in_files_that_know_where_they_belong() {
    let folder = Folder::with(&with_few_photons(SCENE, "type=\"path\">"));
    let plain = picture(&folder, "plain", "--spp 4");
    assert!(picture(&folder, "written", "--spp 4 --cache photons.bpm").data == plain.data);
    assert!(picture(&folder, "read", "--spp 4 --cache photons.bpm").data == plain.data);
    let info = folder.run("info photons.bpm");
    assert_eq!(info.code, 0, "{}", info.stderr);
    let lines: Vec<&str> = info.stdout.lines().map(|line| line.split(' ').next().unwrap_or("")).collect();
    let expected = [&["scene", "settings"][..], &["global"; 8], &["caustic"; 8]].concat();
    assert_eq!(lines, expected, "{}", info.stdout);
    let other = folder.run("render s.xml -q --seed 1 -o x.exr --cache photons.bpm");
    assert_eq!(
        (other.code, other.stderr.trim_end()),
        (
            4,
            "buffon: photons.bpm: photon map: it holds photons of other settings (integrator, sampler or seed); \
             remove it, or name another file"
        )
    );
    folder.write(
        "s.xml",
        with_few_photons(SCENE, "type=\"path\">").replace("0.7,0.5,0", "0.7,0.6,0").as_bytes(),
    );
    let other = folder.run("render s.xml -q -o x.exr --cache photons.bpm");
    assert_eq!(
        other.stderr.trim_end(),
        "buffon: photons.bpm: photon map: it holds photons of another scene; remove it, or name another file"
    );
}

/// Only the maps that a scene needs are created.
#[test]
fn maps_are_made_where_they_are_needed() {
    let photons = |scene: &str, arguments: &str| {
        let folder = Folder::with(&with_few_photons(scene, "type=\"$integrator\">"));
        let options = "--spp 1 --size 8x8 --stats s.json -o x.exr";
        folder.render(&format!("s.xml -q {arguments} {options}"));
        let stats: serde_json::Value = serde_json::from_slice(&folder.read("s.json")).expect("JSON");
        ["global_photons", "caustic_photons"]
            .map(|name| stats["prepared"][name].as_f64().expect("a number") > 0.0)
    };
    assert_eq!(photons(ROOM, "-D ball=dielectric"), [true, true]);
    let matt = ROOM.replace("\"conductor\"", "\"diffuse\"").replace("\"plastic\"", "\"roughplastic\"");
    assert_eq!(photons(&matt, "-D ball=diffuse"), [true, false]);
    let polished =
        matt.replace("type=\"diffuse\"", "type=\"roughconductor\"").replace("roughplastic", "roughconductor");
    assert_eq!(photons(&polished, "-D ball=dielectric"), [false, true]);
    assert_eq!(photons(&ROOM.replace("value=\"12\"", "value=\"2\""), "-D ball=dielectric"), [false, false]);
}
