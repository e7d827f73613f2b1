//! Path reuse has no bias: its images are those of independent paths, and those known in closed form.

use crate::support::cli::Folder;
use crate::support::scenes::{add, camera, compiled, constant, diffuse, pixels, render, sphere};
use crate::support::statistics::{normal_tail, sidak};
use buffon::accel::AccelKind;
use buffon::color::Rgb;
use buffon::integrator::Settings;
use buffon::integrator::settings::{PathLimits, PathSettings, WhenPays};
use buffon::loader;
use buffon::material::{Diffuse, Material};
use buffon::math::{DAffine3, DVec3};
use buffon::sampling::SamplerKind;
use buffon::scene::{Description, Scene};
use buffon::shape::Shape;
use std::path::Path;

/// The side of the blocks whose means are compared, in pixels.
const BLOCK: usize = 4;

fn path(reuse: WhenPays, limits: PathLimits) -> Settings {
    Settings::Path(PathSettings { reuse, ..PathSettings::independent(limits) })
}

pub fn limited(max_depth: u32) -> PathLimits {
    PathLimits { max_depth: Some(max_depth), ..PathLimits::default() }
}

/// Returns a scene of the repository with a small square image.
pub fn own(name: &str, size: u32) -> Scene {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes").join(name);
    let mut loaded = loader::load(&file, &Default::default()).expect("the scene loads");
    let film = &mut loaded.description.sensors[0].film;
    (film.width, film.height, film.crop) = (size, size, None);
    compiled(loaded.description, AccelKind::default())
}

/// Returns a scene from XML, in a folder of its own.
pub fn from_xml(body: &str, size: u32) -> Scene {
    compiled(described(body, size), AccelKind::default())
}

/// Returns the description of a scene from XML, in a folder of its own.
pub fn described(body: &str, size: u32) -> Description {
    let sensor = "<sensor type='perspective'><float name='fov' value='45'/><transform name='to_world'>\
        <lookat origin='0.4, 1.2, 3.2' target='0, 0.3, 0' up='0, 1, 0'/></transform></sensor>";
    let folder = Folder::with(&format!("<scene version='3.0.0'>{sensor}{body}</scene>"));
    let mut loaded = loader::load(&folder.path("s.xml"), &Default::default()).expect("the scene loads");
    let film = &mut loaded.description.sensors[0].film;
    (film.width, film.height) = (size, size);
    loaded.description
}

/// The sums over blocks of pixels and channels: mean and variance of the mean over several seeds.
pub fn blocks(
    scene: &Scene,
    settings: &Settings,
    size: usize,
    seeds: std::ops::Range<u64>,
    spp: u64,
) -> Vec<[f64; 2]> {
    let side = size / BLOCK;
    let mut sums = vec![[0.0; 2]; 3 * side * side];
    let n = (seeds.end - seeds.start) as f64;
    for seed in seeds {
        let rendered = render(scene, settings, SamplerKind::Sobol, spp, seed);
        assert_eq!(rendered.invalid_count, 0, "{:?}", rendered.invalid.first());
        let mut image = vec![0.0; sums.len()];
        for (i, pixel) in pixels(&rendered).iter().enumerate() {
            let block = (i / size / BLOCK) * side + i % size / BLOCK;
            pixel.iter().enumerate().for_each(|(c, v)| image[3 * block + c] += v / (BLOCK * BLOCK) as f64);
        }
        for (sum, v) in sums.iter_mut().zip(image) {
            *sum = [sum[0] + v / n, sum[1] + v * v / n];
        }
    }
    sums.iter().map(|[mean, square]| [*mean, (square - mean * mean).max(0.0) / (n - 1.0)]).collect()
}

/// Asserts that images with and without reuse have the same expectation: every block, at a significance of 0.001 for
/// all blocks of a scene, and the mean over the image within 4 standard errors.
fn expect_same(name: &str, scene: &Scene, limits: PathLimits, size: usize, spp: u64) {
    let both = [WhenPays::Always, WhenPays::Never].map(|reuse| path(reuse, limits));
    expect_same_of(name, scene, &both, size, spp);
}

/// The number of images of each way to render a scene.
const SEEDS: u64 = 48;

/// Asserts the same for two ways to render a scene.
pub fn expect_same_of(name: &str, scene: &Scene, both: &[Settings; 2], size: usize, spp: u64) {
    expect_reference(name, scene, &both[0], &reference(scene, &both[1], size, spp), size, spp);
}

/// Returns the blocks with which [`expect_reference`] compares.
pub fn reference(scene: &Scene, settings: &Settings, size: usize, spp: u64) -> Vec<[f64; 2]> {
    blocks(scene, settings, size, SEEDS..2 * SEEDS, spp)
}

/// Asserts the same for a way to render a scene and a reference.
pub fn expect_reference(
    name: &str,
    scene: &Scene,
    settings: &Settings,
    reference: &[[f64; 2]],
    size: usize,
    spp: u64,
) {
    let tested = blocks(scene, settings, size, 0..SEEDS, spp);
    let (mut difference, mut variance) = (0.0, 0.0);
    let mut largest = 0.0f64;
    for ([a, v], [b, w]) in tested.iter().zip(reference) {
        (difference, variance) = (difference + a - b, variance + v + w);
        if v + w > 0.0 {
            largest = largest.max((a - b).abs() / (v + w + (3e-5 * b).powi(2)).sqrt());
        } else {
            assert!((a - b).abs() <= 1e-5 * b.abs(), "{name}: {a} {b}");
        }
    }
    let total: f64 = reference.iter().map(|[b, _]| b).sum();
    let z = difference / variance.sqrt().max(3e-5 * total);
    println!(
        "{name}: mean {:.5}, difference {:+.2e} of it, z {z:.2}, largest block {largest:.2}",
        total / reference.len() as f64,
        difference / total
    );
    // Student's distribution with about 90 degrees of freedom has heavier tails than the normal distribution.
    assert!(normal_tail(0.92 * largest) > sidak(1e-3, reference.len()), "{name}: block {largest}");
    assert!(z.abs() < 4.0, "{name}: the mean differs by {difference} of {total}, z {z}");
}

/// Every kind of emitter, mirrors, glass and rough glass, plastics, an environment, and pixels that see different
/// surfaces.
#[test]
fn reuse_does_not_change_the_expectation_of_any_scene() {
    for (name, spp) in [
        ("cornell-box/cornell-box.xml", 16),
        ("photon/emitters.xml", 16),
        ("environment/environment.xml", 16),
        ("interior/interior.xml", 16),
        ("spheres/spheres.xml", 16),
    ] {
        let limits = PathLimits { hide_emitters: name.starts_with("cornell-box"), ..PathLimits::default() };
        expect_same(name, &own(name, 24), limits, 24, spp);
    }
}

/// Materials of every kind as first and as second surfaces, in a lit corner.
#[test]
fn reuse_is_unbiased_for_all_materials() {
    let rough = "<float name='alpha' value='0.2'/>";
    let materials = [
        ("roughconductor", format!("<bsdf type='roughconductor'>{rough}</bsdf>")),
        ("roughdielectric", format!("<bsdf type='roughdielectric'>{rough}</bsdf>")),
        ("plastic", "<bsdf type='plastic'/>".into()),
        ("roughplastic", format!("<bsdf type='twosided'><bsdf type='roughplastic'>{rough}</bsdf></bsdf>")),
        ("principled", "<bsdf type='principled'><float name='roughness' value='0.3'/>\
            <float name='metallic' value='0.5'/><float name='clearcoat' value='0.8'/></bsdf>".into()),
        ("mask", "<bsdf type='mask'><float name='opacity' value='0.5'/><bsdf type='twosided'>\
            <bsdf type='diffuse'/></bsdf></bsdf>".into()),
        ("blend", "<bsdf type='blendbsdf'><float name='weight' value='0.4'/><bsdf type='diffuse'/>\
            <bsdf type='dielectric'/></bsdf>".into()),
        ("bumps", "<bsdf type='twosided'><bsdf type='bumpmap'><texture type='checkerboard'>\
            <transform name='to_uv'><scale value='3'/></transform></texture><float name='scale' value='0.1'/>\
            <bsdf type='diffuse'/></bsdf></bsdf>".into()),
        // One-sided black surfaces beside white ones: their paths end, but the points that they find are used.
        ("black", "<bsdf type='diffuse'><texture type='checkerboard' name='reflectance'><transform name='to_uv'>\
            <scale value='9'/></transform><rgb name='color0' value='0'/><rgb name='color1' value='0.9'/></texture>\
            </bsdf>".into()),
    ];
    for (name, material) in materials {
        let body = format!(
            "<shape type='rectangle'><transform name='to_world'>\
             <rotate x='1' angle='-90'/><scale value='3'/></transform>\
             {material}</shape>\
             <shape type='rectangle'><transform name='to_world'><scale value='3'/><translate z='-1.2'/></transform>\
             <bsdf type='twosided'><bsdf type='diffuse'/></bsdf></shape>\
             <shape type='sphere'><point name='center' value='-0.5, 0.51, 0'/>\
             <float name='radius' value='0.5'/>{material}</shape>\
             <shape type='cube'><transform name='to_world'><scale value='0.3'/><rotate y='1' angle='30'/>\
             <translate x='0.6' y='0.301' z='0.3'/></transform>{material}</shape>\
             <shape type='rectangle'><transform name='to_world'><scale value='0.7'/><rotate x='1' angle='90'/>\
             <translate y='2.2'/></transform>\
             <emitter type='area'><rgb name='radiance' value='6, 5, 4'/></emitter></shape>\
             <emitter type='constant'><rgb name='radiance' value='0.2, 0.3, 0.4'/></emitter>"
        );
        expect_same(name, &from_xml(&body, 16), limited(6), 16, 16);
    }
}

/// With Le = 1/2 and Kd = 1/2, paths of k edges contribute 2^−k, and each pixel is 1 − 2^−n for at most n edges.
#[test]
fn furnaces_are_exact_with_reuse() {
    for (shape, name) in [(sphere(1.0), "sphere"), (Shape::Cube, "cube")] {
        let mut scene = Description::default();
        let grey = Material::Diffuse(Diffuse { reflectance: Rgb::splat(0.5).into() });
        let id = add(&mut scene, shape, DAffine3::IDENTITY, grey);
        scene.shapes[id].emission = Some(Rgb::splat(0.5).into());
        scene.shapes[id].flip_normals = true;
        scene.sensors.push(camera(DVec3::new(0.2, 0.1, -0.3), DVec3::new(-0.3, 0.4, 0.5), 90.0, 12));
        let scene = compiled(scene, AccelKind::default());
        for edges in [1, 2, 3, 4, 8] {
            let rendered =
                render(&scene, &path(WhenPays::Always, limited(edges)), SamplerKind::Sobol, 256, 1);
            let exact = 1.0 - 0.5f64.powi(edges as i32);
            let pixels = pixels(&rendered);
            let mean = pixels.iter().map(|p| p[0]).sum::<f64>() / pixels.len() as f64;
            assert!((mean / exact - 1.0).abs() < 2e-3, "{name}, {edges} edges: {mean}, expected {exact}");
        }
    }
}

/// A convex diffuse body in a uniform environment reflects its albedo times the radiance. The environment is found by
/// directions that the group shares.
#[test]
fn a_convex_body_reflects_the_environment_with_reuse() {
    let mut scene = Description::default();
    add(&mut scene, Shape::Cube, DAffine3::IDENTITY, diffuse(0.6));
    scene.emitters.push(constant(2.0));
    scene.sensors.push(camera(DVec3::new(2.0, 3.0, 4.0), DVec3::ZERO, 15.0, 16));
    let scene = compiled(scene, AccelKind::default());
    let rendered = render(&scene, &path(WhenPays::Always, limited(8)), SamplerKind::Sobol, 64, 3);
    // Pixels of several faces are in one group, so single pixels have noise.
    let pixels = pixels(&rendered);
    assert!(pixels.iter().all(|pixel| (pixel[0] / 1.2 - 1.0).abs() < 0.2), "{pixels:?}");
    let mean = pixels.iter().map(|pixel| pixel[0]).sum::<f64>() / pixels.len() as f64;
    assert!((mean / 1.2 - 1.0).abs() < 1e-3, "{mean}");
}

/// A box of which pixels see inner walls that reflect each other has less noise with reuse.
#[test]
fn reuse_reduces_the_noise_of_indirect_light() {
    let scene = own("cornell-box/cornell-box.xml", 64);
    // At the edges of the emitter, the noise is that of the filter.
    let limits = PathLimits { hide_emitters: true, ..PathLimits::default() };
    let error = |reuse| {
        let images: Vec<_> =
            (0..4).map(|seed| render(&scene, &path(reuse, limits), SamplerKind::Sobol, 16, seed)).collect();
        images.iter().map(|image| image.relmse.expect("two halves")).sum::<f64>() / 4.0
    };
    let (reused, independent) = (error(WhenPays::Always), error(WhenPays::Never));
    assert!(reused < 0.5 * independent, "{reused} {independent}");
}

/// The pixels of a crop whose edges are inside cells are those of the whole image.
#[test]
fn crops_have_the_pixels_of_the_whole_image() {
    let mut scene = own("cornell-box/cornell-box.xml", 40);
    let settings = path(WhenPays::Always, PathLimits::default());
    let whole = pixels(&render(&scene, &settings, SamplerKind::Sobol, 4, 1));
    let rect = buffon::film::PixelRect { x: 11, y: 5, width: 23, height: 18 };
    scene.sensors[0].film.crop = Some(rect);
    let crop = render(&scene, &settings, SamplerKind::Sobol, 4, 1);
    assert_eq!(crop.rect, rect);
    let mut compared = 0;
    for tile in &crop.tiles {
        for i in 0..tile.pixel_count() {
            let (x, y) = tile.position(i);
            let pixel = [0, 1, 2].map(|c| tile.estimate(i, c).mean);
            assert_eq!(pixel, whole[(y * 40 + x) as usize], "({x}, {y})");
            compared += 1;
        }
    }
    assert_eq!(compared, 23 * 18);
}

/// Options that need independent pixels turn reuse off, and contradict `always`.
#[test]
fn independent_pixels_exclude_reuse() {
    let folder = Folder::new();
    let used = |options: &str| {
        folder.render(&format!("s.xml --spp 16 -q -o a.exr --stats a.json {options}"));
        let stats: serde_json::Value = serde_json::from_slice(&folder.read("a.json")).expect("JSON");
        let reuses = stats["prepared"]["path_reuse"].as_f64().expect("a number");
        // Only pilots take time.
        let prepared = stats["seconds"]["prepare"].as_f64().expect("a number");
        if options.contains("--path-splitting never") {
            assert_eq!(prepared, 0.0, "{options}");
        }
        reuses
    };
    assert_eq!(used("--path-reuse never"), 0.0);
    assert_eq!(used("--path-reuse never --adaptive=never --path-splitting never --path-caustics never"), 0.0);
    assert!([4.0, 8.0].contains(&used("--path-reuse always")));
    assert_eq!(used("--aov variance"), 0.0);
    assert!([4.0, 8.0].contains(&used("--path-reuse always --adaptive")));
    for (options, expected) in [
        ("--path-reuse always --aov variance", ALWAYS),
        (
            "--integrator ptracer --path-reuse auto",
            "buffon: --path-reuse: ptracer has no paths that are reused; use path\n",
        ),
    ] {
        let run = folder.run(&format!("render s.xml --spp 16 -q -o b.exr {options}"));
        assert_eq!((run.code, run.stderr.as_str()), (2, expected), "{options}");
    }
}

const ALWAYS: &str = "buffon: path_reuse always: found a layer of variances, which needs pixels with \
    independent errors; use auto\n";
