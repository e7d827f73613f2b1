//! Scenes of mirrors and glass with known radiance, and agreement between estimators.

use crate::support::cli::Folder;
use crate::support::expect::{Means, combinations};
use crate::support::scenes::{add, camera, compiled, constant, diffuse, render, sphere};
use buffon::accel::{AccelKind, Coherence};
use buffon::color::Rgb;
use buffon::integrator::settings::{DirectSettings, PathLimits};
use buffon::integrator::{Radiance, RadianceQuery, Settings, Wave, Worker};
use buffon::loader::{LoadOptions, load};
use buffon::material::{
    Conductor, Dielectric, Distribution, Input, Interface, Material, Metal, RoughConductor, Roughness,
};
use buffon::math::{DAffine3, DVec2, DVec3, Ray, Vec2};
use buffon::sampling::{SampleKey, Sampler, SamplerKind};
use buffon::scene::{Description, Scene};
use buffon::shape::Shape;

fn path(max_depth: Option<u32>) -> Settings {
    Settings::Path(PathLimits { max_depth, ..PathLimits::default() }.into())
}

fn glass(ior: f32) -> Material {
    let interface = Interface { int_ior: ior, ext_ior: 1.0, specular_reflectance: Rgb::WHITE.into() };
    Material::Dielectric(Dielectric { interface, specular_transmittance: Rgb::WHITE.into() })
}

fn metal([eta, k, specular_reflectance]: [Rgb; 3]) -> Metal {
    Metal { eta: eta.into(), k: k.into(), specular_reflectance: specular_reflectance.into() }
}

fn rough_metal(distribution: Distribution, alpha: [f32; 2], colours: [Rgb; 3]) -> Material {
    let roughness = Roughness { distribution, alpha: alpha.map(Input::from), sample_visible: true };
    Material::RoughConductor(RoughConductor { metal: metal(colours), roughness })
}

/// Glass without loss is invisible in a constant environment.
#[test]
fn lossless_glass_vanishes_in_a_constant_environment() {
    let combinations = combinations();
    let group = Means::of_images(3 * combinations.len(), 5e-3);
    for &(accel, sampler) in &combinations {
        for ior in [1.0, 1.5, 2.4] {
            let mut description = Description::default();
            add(&mut description, sphere(1.0), DAffine3::IDENTITY, glass(ior));
            description.emitters.push(constant(0.7));
            description.sensors.push(camera(DVec3::new(0.0, 0.0, 4.0), DVec3::ZERO, 32.0, 12));
            let scene = compiled(description, accel);
            let rendered = render(&scene, &path(None), sampler, 256, 1);
            group.expect(&format!("ior {ior}, {sampler}, {accel}"), &rendered, [f64::from(0.7f32); 3]);
        }
    }
}

/// Returns a floor under an area emitter and an environment, optionally with a sphere between camera and floor.
fn floor_behind(sphere_of: Option<Material>, accel: AccelKind) -> Scene {
    let mut description = Description::default();
    let down = DAffine3::from_translation(DVec3::new(0.5, 0.0, 3.0))
        * DAffine3::from_rotation_y(std::f64::consts::PI);
    add(&mut description, Shape::Rectangle, DAffine3::from_scale(DVec3::splat(5.0)), diffuse(0.6));
    let light = add(&mut description, Shape::Rectangle, down, diffuse(0.0));
    description.shapes[light].emission = Some(Rgb::new(4.0, 3.0, 2.0).into());
    if let Some(material) = sphere_of {
        add(&mut description, sphere(0.8), DAffine3::from_translation(DVec3::new(0.0, 0.0, 1.0)), material);
    }
    description.emitters.push(constant(0.3));
    description.sensors.push(camera(DVec3::new(0.0, 5.0, 2.0), DVec3::new(0.0, 0.0, 0.5), 30.0, 12));
    compiled(description, accel)
}

/// Glass blocks shadow rays but not paths. With an index of 1, paths still carry all of the light.
#[test]
fn glass_of_index_one_changes_nothing() {
    let combinations = combinations();
    let group = Means::of_images(combinations.len(), 0.01);
    for &(accel, sampler) in &combinations {
        let with = render(&floor_behind(Some(glass(1.0)), accel), &path(None), sampler, 256, 2);
        let without = render(&floor_behind(None, accel), &path(None), sampler, 256, 3);
        group.expect_same(&format!("{sampler}, {accel}"), &with, &without);
    }
}

/// Returns Fresnel's reflectance of a conductor for unpolarised light, computed from the complex refraction.
/// [Born and Wolf 1999, section 14.2]
fn conductor_reflectance(eta: f64, k: f64, cos: f64) -> f64 {
    let multiply = |a: [f64; 2], b: [f64; 2]| [a[0] * b[0] - a[1] * b[1], a[0] * b[1] + a[1] * b[0]];
    let squared = |a: [f64; 2]| a[0] * a[0] + a[1] * a[1];
    let ratio = |a: [f64; 2], c: f64, d: [f64; 2], e: f64| {
        squared([a[0] * c - d[0] * e, a[1] * c - d[1] * e])
            / squared([a[0] * c + d[0] * e, a[1] * c + d[1] * e])
    };
    let n = [eta, k];
    let n2 = multiply(n, n);
    // n·cosθt = √(n² − sin²θi)
    let (x, y) = (n2[0] - (1.0 - cos * cos), n2[1]);
    let r = x.hypot(y);
    let root = [((r + x) / 2.0).sqrt(), ((r - x) / 2.0).sqrt()];
    let one = [1.0, 0.0];
    let s = ratio(one, cos, root, 1.0);
    let p = ratio(n2, cos, root, 1.0);
    0.5 * (s + p)
}

#[test]
fn mirrors_reflect_by_fresnels_equations() {
    let (eta, k) = ([0.2, 0.9, 1.5], [3.9, 2.4, 1.9]);
    let combinations = combinations();
    let group = Means::of_images(4 * combinations.len(), 1e-3);
    for &(accel, sampler) in &combinations {
        for angle in [0.0f64, 0.5, 1.2, 1.5] {
            let mut description = Description::default();
            let rgb = |v: [f32; 3]| Rgb::new(v[0], v[1], v[2]);
            let material = Material::Conductor(Conductor { metal: metal([rgb(eta), rgb(k), Rgb::WHITE]) });
            add(&mut description, Shape::Rectangle, DAffine3::from_scale(DVec3::splat(50.0)), material);
            description.emitters.push(constant(2.0));
            let eye = DVec3::new(0.0, angle.sin(), angle.cos()) * 3.0;
            description.sensors.push(camera(eye, DVec3::ZERO, 0.02, 4));
            let scene = compiled(description, accel);
            let exact = [0, 1, 2]
                .map(|c| 2.0 * conductor_reflectance(f64::from(eta[c]), f64::from(k[c]), angle.cos()));
            let rendered = render(&scene, &path(None), sampler, 4, 1);
            group.expect(&format!("{angle} rad, {sampler}, {accel}"), &rendered, exact);
        }
    }
}

/// A lossless rough mirror is never brighter than a constant environment, and almost as bright if it is smooth.
#[test]
fn rough_mirrors_gain_no_light() {
    for accel in AccelKind::CHOICES {
        for distribution in [Distribution::Beckmann, Distribution::Ggx] {
            for (alpha, least) in [([0.01, 0.01], 0.995), ([0.3, 0.3], 0.85), ([0.05, 0.6], 0.72)] {
                let mut description = Description::default();
                let material =
                    rough_metal(distribution, alpha, [Rgb::splat(0.0), Rgb::splat(1e9), Rgb::WHITE]);
                add(&mut description, sphere(1.0), DAffine3::IDENTITY, material);
                description.emitters.push(constant(1.0));
                description.sensors.push(camera(DVec3::new(0.0, 0.0, 4.0), DVec3::ZERO, 12.0, 8));
                let scene = compiled(description, *accel);
                let rendered = render(&scene, &path(None), SamplerKind::Sobol, 128, 1);
                let (mean, error) = crate::support::scenes::mean(&rendered);
                let within = mean[0] > least && mean[0] < 1.0 + 4.0 * error[0] + 1e-5 && error[0] < 0.01;
                assert!(within, "{distribution:?} {alpha:?}, {accel}: {} ± {}", mean[0], error[0]);
            }
        }
    }
}

/// Returns the default scene, which has all kinds of light paths.
fn everything(accel: AccelKind) -> Scene {
    let folder = Folder::new();
    let loaded = load(&folder.path("s.xml"), &LoadOptions::default()).expect("the scene loads");
    compiled(loaded.description, accel)
}

/// All numbers of emitter and BSDF samples have the expected value of paths of two edges.
#[test]
fn direct_light_is_the_same_by_every_technique() {
    check_techniques([(1, 1), (3, 0)]);
}

#[test]
#[ignore = "takes long: make test-all"]
fn direct_light_is_the_same_with_more_samples() {
    check_techniques([(4, 1), (1, 4)]);
}

/// Compares direct light by the given numbers of emitter and BSDF samples with paths of two edges.
fn check_techniques(techniques: [(u32, u32); 2]) {
    let combinations = combinations();
    let group = Means::of_images(techniques.len() * combinations.len(), 0.01);
    for &(accel, sampler) in &combinations {
        let rough = rough_metal(
            Distribution::Ggx,
            [0.3, 0.3],
            [Rgb::splat(0.2), Rgb::splat(3.0), Rgb::new(0.9, 0.6, 0.3)],
        );
        let scene = floor_behind(Some(rough), accel);
        let paths = render(&scene, &path(Some(2)), sampler, 1024, 4);
        for (emitter_samples, bsdf_samples) in techniques {
            let settings = DirectSettings { emitter_samples, bsdf_samples, hide_emitters: false };
            let rendered = render(&scene, &Settings::Direct(settings), sampler, 2048, 5);
            group.expect_same(&format!("{settings:?}, {sampler}, {accel}"), &rendered, &paths);
        }
    }
}

/// Returns one sample of every pixel, with only the parts of the query.
fn asked(scene: &Scene, settings: &Settings, query: RadianceQuery) -> Vec<Radiance> {
    let camera = &scene.sensors[0];
    let pixels = (0..camera.film.height).flat_map(|y| (0..camera.film.width).map(move |x| (x, y)));
    let (rays, keys): (Vec<Ray>, Vec<SampleKey>) = pixels
        .map(|(x, y)| {
            (
                camera.ray(DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5), Vec2::ZERO, 0.0),
                SampleKey::new(3, x, y, 0),
            )
        })
        .unzip();
    let mut out = vec![Radiance::NONE; rays.len()];
    let wave = Wave { rays: &rays, keys: &keys, coherence: Coherence::Coherent, groups: &[] };
    settings.create().li(
        scene,
        wave,
        query,
        &mut Worker::new(Sampler::new(SamplerKind::Sobol, None)),
        &mut out,
    );
    out
}

/// For each ray, emitted, direct and indirect light and caustics sum to the whole.
#[test]
fn the_parts_of_a_query_sum_to_the_whole() {
    let none = RadianceQuery { emitted: false, direct: false, indirect: false, caustic: false };
    let parts = [
        RadianceQuery { emitted: true, ..none },
        RadianceQuery { direct: true, ..none },
        RadianceQuery { indirect: true, ..none },
        RadianceQuery { caustic: true, ..none },
    ];
    for &accel in AccelKind::CHOICES {
        let scene = everything(accel);
        for (settings, filled) in
            [(path(None), 4), (path(Some(2)), 3), (Settings::Direct(DirectSettings::default()), 2)]
        {
            let whole = asked(&scene, &settings, RadianceQuery::ALL);
            let parts = parts.map(|query| asked(&scene, &settings, query));
            let brightness = |part: &Vec<Radiance>| part.iter().map(|r| r.value.luminance()).sum::<f32>();
            assert_eq!(parts.iter().filter(|part| brightness(part) > 0.0).count(), filled, "{settings:?}");
            for (i, whole) in whole.iter().enumerate() {
                let sum = parts.iter().fold(Rgb::BLACK, |sum, part| sum + part[i].value);
                for c in 0..3 {
                    let (sum, whole) = (sum[c], whole.value[c]);
                    assert!(
                        (sum - whole).abs() <= 1e-5 * whole.max(1.0),
                        "{settings:?}, ray {i}: {sum} of {whole}"
                    );
                }
                assert!(parts.iter().all(|part| part[i].distance == whole.distance), "{settings:?}, ray {i}");
            }
        }
    }
}

/// A camera looks at a floor through an emitter. A hidden emitter still lights the floor and does not hide it.
#[test]
fn hidden_emitters_shine_without_being_seen() {
    let combinations = combinations();
    let group = Means::of_images(4 * combinations.len(), 0.01);
    for &(accel, sampler) in &combinations {
        let mut description = Description::default();
        add(&mut description, Shape::Rectangle, DAffine3::from_scale(DVec3::splat(10.0)), diffuse(0.5));
        let id = add(&mut description, sphere(0.5), DAffine3::from_translation(DVec3::Z * 1.5), diffuse(0.5));
        description.shapes[id].emission = Some(Rgb::splat(3.0).into());
        description.sensors.push(camera(DVec3::new(0.0, 0.0, 5.0), DVec3::ZERO, 0.02, 8));
        let scene = compiled(description, accel);
        for hide_emitters in [false, true] {
            // The radiance ρL(r/d)² of the floor for paths of two edges.
            let exact = if hide_emitters { 0.5 * 3.0 * (0.5f64 / 1.5).powi(2) } else { 3.0 };
            let direct = Settings::Direct(DirectSettings { hide_emitters, ..DirectSettings::default() });
            let two_edges = PathLimits { max_depth: Some(2), hide_emitters, ..PathLimits::default() };
            for settings in [direct, Settings::Path(two_edges.into())] {
                let rendered = render(&scene, &settings, sampler, 64, 6);
                let distance = asked(&scene, &settings, RadianceQuery::ALL)[0].distance;
                let expected = if hide_emitters { 5.0 } else { 3.0 };
                assert!((distance - expected).abs() < 1e-3, "{settings:?}: {distance}");
                group.expect(&format!("{settings:?}, {sampler}, {accel}"), &rendered, [exact; 3]);
            }
        }
    }
}
