//! Hard cases of caches: all photons at one point, records in the sharpest corners, and a wall thinner than the
//! distance between records.

use crate::support::scenes::{add, camera, compiled, diffuse, mean, pixels, render};
use buffon::accel::AccelKind;
use buffon::color::Rgb;
use buffon::emitter::Emitter;
use buffon::integrator::irrcache::IrradianceCache;
use buffon::integrator::photon::kdtree::{EllipsoidMetric, Euclidean, KdTree, NeighbourBuffer, each};
use buffon::integrator::photon::{DensityEstimator, IrradianceMap, Kernel, LookupPoint, Photon, PhotonMap};
use buffon::integrator::settings::{IrrcacheSettings, PathLimits, PhotonmapperSettings};
use buffon::integrator::{Integrator, Preparation, Settings};
use buffon::material::Material;
use buffon::math::{DAffine3, DMat3, DVec3, Vec3};
use buffon::memory::Budget;
use buffon::render::thread_pool;
use buffon::sampling::{Sampler, SamplerKind};
use buffon::scene::{Description, Scene};
use buffon::shape::{Mesh, Shape};
use std::time::Instant;

const PHOTONS: usize = 1_000_000;

/// A tree of a million points at one position can be built. Queries at this point, near it and far from it terminate
/// with the correct results.
#[test]
fn a_million_points_in_one_place_make_a_tree() {
    let place = Vec3::new(0.3, -0.2, 0.1);
    let started = Instant::now();
    let tree = KdTree::build(PHOTONS, |_| place).tree;
    let built = started.elapsed();
    assert!(tree.memory_bytes() < 14 * PHOTONS, "{}", tree.memory_bytes());
    let mut buffer = NeighbourBuffer::default();
    let disc = EllipsoidMetric { normal: Vec3::Z, flatness: 3.0 };
    let started = Instant::now();
    for (at, distance_squared) in [(place, 0.0), (place + Vec3::X, 1.0), (place - Vec3::Z * 2.0, 4.0)] {
        for k in [1, 50, 1000] {
            let found = tree.nearest(at, k, f32::INFINITY, Euclidean, |_, all| all, &mut buffer);
            assert_eq!(found.len(), k);
            assert!(found.iter().all(|n| (n.distance_squared() - distance_squared).abs() < 1e-6));
        }
        // With this metric, points in the plane are nearer than points along the normal.
        assert_eq!(
            tree.nearest(at, 50, 1e-3, disc, |_, all| all, &mut buffer).len(),
            if at == place { 50 } else { 0 }
        );
        // No point is accepted, and then one of a million.
        assert!(tree.nearest(at, 50, f32::INFINITY, disc, |_, _| 0, &mut buffer).is_empty());
        let one = tree.nearest(at, 50, f32::INFINITY, disc, each(|slot| slot == 777_777), &mut buffer);
        assert_eq!(one.iter().map(|n| n.slot()).collect::<Vec<_>>(), [777_777]);
        assert!(tree.nearest_one(at, f32::INFINITY, Euclidean, |_| true).is_some());
        let mut count = 0;
        tree.for_each_within(at, 1.001 * distance_squared + 1e-6, |_, _| count += 1);
        assert_eq!(count, PHOTONS);
        tree.for_each_within(at, 0.999 * distance_squared, |_, _| panic!("nothing is so near"));
    }
    println!(
        "built in {:.3} s, all queries in {:.3} s",
        built.as_secs_f64(),
        started.elapsed().as_secs_f64()
    );
}

/// A floor has as many photons at one point as on the rest. The density is finite everywhere, correct elsewhere, and
/// documented to be zero at the point itself.
#[test]
fn a_million_photons_in_one_point_leave_the_rest_as_it_is() {
    let place = Vec3::new(0.5, 0.5, 0.0);
    let photon = |p: Vec3, power: f32| Photon::new(p, Rgb::splat(power), Vec3::Z, Vec3::Z).expect("a photon");
    let side = 300;
    let each = 1.0 / (side * side) as f32;
    let mut photons: Vec<Photon> = (0..side * side)
        .map(|i| photon(Vec3::new((i % side) as f32 + 0.5, (i / side) as f32 + 0.5, 0.0) / side as f32, each))
        .collect();
    photons.extend((0..PHOTONS).map(|_| photon(place, 1e-6)));
    let started = Instant::now();
    let map = PhotonMap::new(photons, 1);
    let built = started.elapsed();
    let estimator = DensityEstimator { kernel: Kernel::Epanechnikov, lookup_size: 50, lookup_radius: 0.1 };
    let mut buffer = NeighbourBuffer::default();
    let mut at = |p: Vec3| estimator.irradiance(&map, LookupPoint { p, n: Vec3::Z }, &mut buffer);
    let started = Instant::now();
    let mut furthest = 0.0f32;
    for i in 0..10_000 {
        let p = Vec3::new(0.1 + 0.008 * (i % 100) as f32, 0.1 + 0.008 * (i / 100) as f32, 0.0);
        let found = at(p);
        assert!(found.value.is_valid() && found.radius.is_finite(), "{p}: {found:?}");
        if (p - place).length() > 0.1 {
            furthest = furthest.max((found.value.g - 1.0).abs());
        }
    }
    println!(
        "built in {:.3} s, 10000 queries in {:.3} s, the plane off by {furthest:.3}",
        built.as_secs_f64(),
        started.elapsed().as_secs_f64()
    );
    assert!(furthest < 0.15, "{furthest}");
    assert_eq!((at(place).value, at(place).photons), (Rgb::BLACK, 0));
    let beside = at(place + Vec3::X * 1e-4);
    assert!(beside.value.is_valid(), "{beside:?}");
    let started = Instant::now();
    let known = IrradianceMap::new(&map, &map, &estimator, 4, None);
    println!("{} irradiances beforehand in {:.3} s", known.len(), started.elapsed().as_secs_f64());
    let all = (0..100).map(|i| Vec3::new(0.2, 0.006 * i as f32 + 0.2, 0.0));
    for p in all.chain([place]) {
        let known = known.nearest(LookupPoint { p, n: Vec3::Z }).expect("there are points");
        assert!(known.value.is_valid(), "{p}: {:?}", known.value);
    }
}

/// A spot of a thousandth of a degree sends all of its photons to one point. The image has no invalid values.
#[test]
fn a_photon_map_of_a_needle_of_light_renders() {
    for &accel in AccelKind::ALL {
        let mut scene = Description::default();
        for z in [0.0, 2.0] {
            let facing = if z > 0.0 { std::f64::consts::PI } else { 0.0 };
            let place = DAffine3::from_translation(DVec3::Z * z) * DAffine3::from_rotation_x(facing);
            add(&mut scene, Shape::Rectangle, place, diffuse(0.7));
        }
        let down = DAffine3::from_translation(DVec3::new(0.1, 0.1, 1.5))
            * DAffine3::from_rotation_x(std::f64::consts::PI);
        let angle = 1e-3f32.to_radians();
        scene.emitters.push(Emitter::Spot {
            to_world: down,
            intensity: Rgb::splat(1e10),
            texture: None,
            cutoff_angle: angle,
            beam_width: angle,
        });
        scene.sensors.push(camera(DVec3::new(0.0, -3.0, 1.0), DVec3::new(0.0, 0.0, 0.8), 50.0, 12));
        let scene = compiled(scene, accel);
        let settings = Settings::Photonmapper(PhotonmapperSettings::default());
        let rendered = render(&scene, &settings, SamplerKind::Sobol, 4, 1);
        assert_eq!(rendered.invalid_count, 0, "{accel}");
        let (mean, _) = mean(&rendered);
        println!("{accel}: {mean:?}");
        assert!(mean.iter().all(|m| *m > 0.0 && m.is_finite()), "{accel}: {mean:?}");
    }
}

/// Returns all traversals but the default one.
fn others() -> Vec<AccelKind> {
    AccelKind::ALL.iter().copied().filter(|&kind| kind != AccelKind::default()).collect()
}

/// Returns the number of records in the cache of a scene.
fn records(scene: &Scene, settings: &IrrcacheSettings) -> usize {
    let pool = thread_pool(2).expect("the threads start");
    let mut cache = IrradianceCache::new(settings);
    let preparation = Preparation {
        scene,
        camera: &scene.sensors[0],
        sampler: Sampler::new(SamplerKind::Sobol, Some(16)),
        seed: 1,
        pool: &pool,
        interrupt: &buffon::integrator::Interrupt::default(),
        cache: None,
        memory: &Budget::unlimited(),
    };
    cache.prepare(&preparation).expect("nothing is read or written");
    cache.records().iter().map(|records| records.len()).sum()
}

/// Returns two walls, 2 long and 2 high, that meet at the z axis at the given angle. A third wall, floor and ceiling
/// close the scene. All face the inside.
fn wedge(degrees: f64, reflectance: f32, emission: f32) -> Description {
    let (sin, cos) = degrees.to_radians().sin_cos();
    let (a, b) = (DVec3::new(2.0, 0.0, 0.0), DVec3::new(2.0 * cos, 2.0 * sin, 0.0));
    let at = |p: DVec3, z: f64| (p + DVec3::Z * z).as_vec3();
    let positions = [DVec3::ZERO, a, b].into_iter().flat_map(|p| [at(p, 0.0), at(p, 2.0)]).collect();
    // The corners of the floor are 0, 2, 4, those of the ceiling 1, 3, 5.
    let indices =
        vec![[0, 1, 3], [0, 3, 2], [0, 5, 1], [0, 4, 5], [2, 3, 5], [2, 5, 4], [0, 2, 4], [1, 5, 3]];
    let mut scene = Description::default();
    let mesh = Mesh { positions, indices, ..Mesh::default() };
    let id = add(&mut scene, Shape::Mesh(mesh), DAffine3::IDENTITY, diffuse(reflectance));
    scene.shapes[id].emission = (emission > 0.0).then(|| Rgb::splat(emission).into());
    let middle = (a + b) * 0.25 + DVec3::Z;
    // The camera is between the walls and looks into the corner.
    let eye = (a + b) * 0.45 + DVec3::Z;
    scene.sensors.push(camera(eye, middle * 0.2 + DVec3::Z * 0.8, 60.0, 48));
    scene
}

#[test]
fn a_corner_of_one_degree_is_a_furnace_as_any_other() {
    check_furnace_in_a_corner(&[AccelKind::default()]);
}

#[test]
#[ignore = "takes long: make test-all"]
fn a_corner_of_one_degree_is_a_furnace_with_every_traversal() {
    check_furnace_in_a_corner(&others());
}

/// In a closed furnace the radiance is 1/(1 − a) everywhere, also in a corner of one degree. Such a corner does not
/// need more records than a right angle.
fn check_furnace_in_a_corner(accels: &[AccelKind]) {
    for &accel in accels {
        for degrees in [1.0, 90.0] {
            let scene = compiled(wedge(degrees, 0.5, 1.0), accel);
            // Many rays per record, because the test is not about noise.
            let settings =
                IrrcacheSettings { resolution: 24, indirect_only: true, ..IrrcacheSettings::default() };
            let started = Instant::now();
            let count = records(&scene, &settings);
            let seconds = started.elapsed().as_secs_f64();
            let rendered = render(&scene, &Settings::Irrcache(settings), SamplerKind::Sobol, 64, 1);
            assert_eq!(rendered.invalid_count, 0);
            // Of a total of 2, emission is 1 and direct light is 0.5.
            let (mean, _) = mean(&rendered);
            let furthest = pixels(&rendered).iter().map(|p| (p[1] / 0.5 - 1.0).abs()).fold(0.0, f64::max);
            println!(
                "{accel}, {degrees}°: {count} records in {seconds:.2} s, mean {:.4} of 0.5, furthest pixel off by {furthest:.3}",
                mean[1]
            );
            assert!((mean[1] / 0.5 - 1.0).abs() < 1e-2, "{accel}, {degrees}°: {mean:?}");
            assert!(furthest < 0.2, "{accel}, {degrees}°: {furthest}");
            assert!(count < 20_000, "{accel}, {degrees}°: {count} records");
        }
    }
}

#[test]
fn a_corner_of_one_degree_has_the_light_of_path_tracing() {
    check_light_in_a_corner(&[AccelKind::default()]);
}

#[test]
#[ignore = "takes long: make test-all"]
fn a_corner_of_one_degree_has_the_light_of_path_tracing_with_every_traversal() {
    check_light_in_a_corner(&others());
}

/// A corner of one degree with an emitter on its open side, compared with path tracing. The noise of records is shared
/// noise and not part of the error estimate.
fn check_light_in_a_corner(accels: &[AccelKind]) {
    for &accel in accels {
        let mut scene = wedge(1.0, 0.8, 0.0);
        // The third wall is the emitter.
        let Shape::Mesh(mesh) = &mut scene.shapes[0].shape else { panic!("a mesh") };
        let lamp = Mesh {
            positions: mesh.positions.clone(),
            indices: mesh.indices.drain(4..6).collect(),
            ..Mesh::default()
        };
        let id = add(&mut scene, Shape::Mesh(lamp), DAffine3::IDENTITY, diffuse(0.0));
        scene.shapes[id].emission = Some(Rgb::splat(10.0).into());
        let scene = compiled(scene, accel);
        let path = Settings::Path(PathLimits::default().into());
        let reference = render(&scene, &path, SamplerKind::Sobol, 512, 7);
        let cached =
            render(&scene, &Settings::Irrcache(IrrcacheSettings::default()), SamplerKind::Sobol, 32, 1);
        assert_eq!(cached.invalid_count, 0);
        let ((wanted, error), (found, noise)) = (mean(&reference), mean(&cached));
        println!("{accel}: {:.5} instead of {:.5} ± {:.5}", found[1], wanted[1], error[1].hypot(noise[1]));
        let allowed = 0.08 * wanted[1] + 4.0 * error[1].hypot(noise[1]);
        assert!(
            (found[1] - wanted[1]).abs() < allowed,
            "{accel}: {found:?} instead of {wanted:?} ± {error:?}"
        );
    }
}

/// Adds a rectangle with the given centre and half edges. It faces x × y.
fn rectangle(scene: &mut Description, centre: Vec3, x: Vec3, y: Vec3, material: Material) -> usize {
    let n = x.cross(y).normalize();
    let matrix = DMat3::from_cols(x.as_dvec3(), y.as_dvec3(), n.as_dvec3());
    add(scene, Shape::Rectangle, DAffine3::from_mat3_translation(matrix, centre.as_dvec3()), material)
}

/// Returns a closed box of 4×2×2 with a wall of the given thickness in the middle and an emitter in its right half. The
/// wall ends `gap` below the ceiling.
fn divided_room(thickness: f32, gap: f32) -> Description {
    let mut scene = Description::default();
    let (x, y, z) = (Vec3::X, Vec3::Y, Vec3::Z);
    let grey = || diffuse(0.8);
    rectangle(&mut scene, -y, z, x * 2.0, grey());
    rectangle(&mut scene, y, x * 2.0, z, grey());
    rectangle(&mut scene, -z, x * 2.0, y, grey());
    rectangle(&mut scene, z, y, x * 2.0, grey());
    rectangle(&mut scene, -x * 2.0, y, z, grey());
    rectangle(&mut scene, x * 2.0, z, y, grey());
    let half = 0.5 * thickness;
    let height = 0.5 * (2.0 - gap);
    let middle = y * (height - 1.0);
    rectangle(&mut scene, middle - x * half, z, y * height, grey());
    rectangle(&mut scene, middle + x * half, y * height, z, grey());
    if gap > 0.0 {
        rectangle(&mut scene, y * (1.0 - gap), z, x * half, grey());
    }
    let lamp = rectangle(&mut scene, x + y * 0.9, x * 0.3, z * 0.3, diffuse(0.0));
    scene.shapes[lamp].emission = Some(Rgb::splat(10.0).into());
    scene.sensors.push(camera(DVec3::new(-1.9, 0.3, 0.0), DVec3::new(-0.3, -0.4, 0.0), 85.0, 48));
    scene
}

/// A wall without a gap lets no light through, whatever its thickness.
#[test]
fn nothing_leaks_through_a_wall_thinner_than_the_records_are_apart() {
    for &accel in AccelKind::ALL {
        for thickness in [1e-1, 1e-3, 1e-5, 1e-7] {
            let scene = compiled(divided_room(thickness, 0.0), accel);
            let rendered =
                render(&scene, &Settings::Irrcache(IrrcacheSettings::default()), SamplerKind::Sobol, 8, 1);
            let lit = pixels(&rendered).iter().filter(|p| p.iter().any(|c| *c > 0.0)).count();
            println!("{accel}, {thickness:e}: {lit} lit pixels");
            assert_eq!(lit, 0, "{accel}, thickness {thickness:e}: pixels of the dark side are lit");
        }
    }
}

#[test]
fn a_thin_wall_with_a_gap_has_the_light_of_path_tracing() {
    check_light_above_a_wall(&[AccelKind::default()]);
}

#[test]
#[ignore = "takes long: make test-all"]
fn a_thin_wall_with_a_gap_has_the_light_of_path_tracing_with_every_traversal() {
    check_light_above_a_wall(&others());
}

/// Light above a thin wall with a gap agrees with path tracing, up to the bias of the cache in a scene without direct
/// light. A thick wall gives the same bias.
fn check_light_above_a_wall(accels: &[AccelKind]) {
    for &accel in accels {
        let scene = compiled(divided_room(1e-3, 0.3), accel);
        let reference =
            render(&scene, &Settings::Path(PathLimits::default().into()), SamplerKind::Sobol, 512, 7);
        let cached =
            render(&scene, &Settings::Irrcache(IrrcacheSettings::default()), SamplerKind::Sobol, 32, 1);
        let ((wanted, error), (found, noise)) = (mean(&reference), mean(&cached));
        println!("{accel}: {:.5} instead of {:.5} ± {:.5}", found[1], wanted[1], error[1].hypot(noise[1]));
        let allowed = 0.1 * wanted[1] + 4.0 * error[1].hypot(noise[1]);
        assert!(
            (found[1] - wanted[1]).abs() < allowed,
            "{accel}: {found:?} instead of {wanted:?} ± {error:?}"
        );
    }
}
