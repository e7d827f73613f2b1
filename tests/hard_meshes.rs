//! Hard cases of meshes with every traversal: invalid triangles, slivers and needles, and very many triangles at one
//! position.
//!
//! `BUFFON_HARD_TRIANGLES` sets the number of triangles at one position.

use crate::meshes::{Mesh, Random, cube, soup, sphere};
use crate::support::scenes;
use crate::watertight::{aimed_ray, escaped, passes_a_vertex};
use buffon::accel::brute_force::BruteForce;
use buffon::accel::{Accel, AccelKind, Coherence, Hit, build};
use buffon::color::Rgb;
use buffon::integrator::Settings;
use buffon::integrator::settings::PathLimits;
use buffon::math::{DAffine3, DVec3, Ray, Vec2, Vec3};
use buffon::sampling::SamplerKind;
use buffon::scene::{CompileOptions, Description, compile};
use buffon::shape::{self, Shape};
use std::time::Instant;

/// Number of rays into every mesh.
const RAYS: usize = 40_000;

/// Adds invalid, degenerate and duplicate triangles to a mesh, and returns the number of invalid ones.
fn spoil(mesh: &Mesh, random: &mut Random) -> (Mesh, usize) {
    let mut spoiled = mesh.clone();
    let first = mesh.positions.len() as u32;
    let limit = buffon::accel::COORDINATE_LIMIT;
    spoiled.positions.extend([
        Vec3::NAN,
        Vec3::INFINITY,
        Vec3::new(0.0, f32::NEG_INFINITY, f32::NAN),
        Vec3::Y * limit,
    ]);
    let mut invalid = 0;
    spoiled.indices.clear();
    for (i, &[a, b, c]) in mesh.indices.iter().enumerate() {
        let bad = match i % 8 {
            0 => Some([a, b, first + random.below(4) as u32]),
            1 => Some([first + 4 + random.below(1000) as u32, b, c]),
            2 => Some([u32::MAX, u32::MAX, u32::MAX]),
            _ => None,
        };
        invalid += usize::from(bad.is_some());
        spoiled.indices.extend(bad);
        let degenerate = [[a, a, b], [c, c, c], [b, c, b]][random.below(3)];
        spoiled.indices.extend([degenerate, [a, b, c]]);
        if i % 3 == 0 {
            spoiled.indices.extend([[a, b, c], [c, b, a]]);
        }
    }
    (spoiled, invalid)
}

fn intersect(accel: &dyn Accel, rays: &[Ray]) -> Vec<Option<Hit>> {
    let mut hits = vec![None; rays.len()];
    accel.intersect_wave(rays, &mut hits, Coherence::Incoherent);
    hits
}

/// Returns closed meshes of triangles of various shapes, each with the half-extents of a box inside.
fn closed_meshes() -> Vec<(&'static str, Mesh, Vec3)> {
    let slab = Vec3::new(1e3, 1.0, 1e-3);
    vec![
        ("sphere", sphere(24, 48), Vec3::splat(0.5)),
        ("slab", cube().map(|p| p * slab), slab * 0.9),
        ("fan of needles", sphere(3, 2000), Vec3::splat(0.2)),
        ("needles", sphere(4, 500).map(|p| p * Vec3::new(1.0, 1.0, 1e4)), Vec3::new(0.3, 0.3, 3e3)),
        ("slivers", sphere(2, 3000).map(|p| p * Vec3::new(1.0, 1e-4, 1.0)), Vec3::new(0.3, 3e-5, 0.3)),
    ]
}

/// Invalid triangles are dropped and counted, duplicates are hit once, and a closed mesh stays closed.
#[test]
#[ignore = "takes long: make test-all"]
fn spoiled_meshes_are_as_closed_as_they_were() {
    for (seed, (name, mesh, inside)) in (1..).zip(closed_meshes()) {
        let mut random = Random(seed);
        let (spoiled, invalid) = spoil(&mesh, &mut random);
        let rays: Vec<Ray> = (0..RAYS).map(|_| aimed_ray(&mesh, Vec3::ZERO, inside, &mut random)).collect();
        for &kind in AccelKind::ALL {
            let clean = build(kind, vec![mesh.clone().geometry()], 0, true).expect("built");
            let built = build(kind, vec![spoiled.clone().geometry()], 0, true).expect("built");
            assert_eq!((clean.dropped, built.dropped), (0, invalid), "{kind}, {name}");
            assert_eq!(built.accel.bounds(), clean.accel.bounds(), "{kind}, {name}");
            let escapes = escaped(&*built.accel, &rays);
            println!("{kind}, {name}: {invalid} dropped, {} of {RAYS} rays escape", escapes.len());
            match kind {
                AccelKind::Obvhs => assert_eq!(escapes.first(), None, "{name}: {} escape", escapes.len()),
                _ => {
                    let unexplained = escapes.iter().find(|ray| !passes_a_vertex(&mesh, ray));
                    assert_eq!(unexplained, None, "{kind}, {name}: escapes, and not at a vertex");
                    assert!(escapes.len() <= RAYS / 300, "{kind}, {name}: {}", escapes.len());
                }
            }
            let distances = |accel: &dyn Accel| -> Vec<Option<f32>> {
                intersect(accel, &rays).into_iter().map(|hit| hit.map(|hit| hit.t)).collect()
            };
            // The back of a triangle may be nearer than its front by a rounding error.
            let same = |(a, b): &(Option<f32>, Option<f32>)| match (a, b) {
                (Some(a), Some(b)) => (a / b - 1.0).abs() < 1e-3,
                (a, b) => a == b,
            };
            let pairs = distances(&*clean.accel).into_iter().zip(distances(&*built.accel));
            let differ = pairs.filter(|pair| !same(pair)).count();
            assert!(differ <= 2 * escapes.len() + RAYS / 1000, "{kind}, {name}: {differ} differ");
        }
    }
}

/// A soup of slivers, down to a width below the rounding of their corners. Hits agree with brute force in `f64`, except
/// for rays within rounding of an outline.
#[test]
fn slivers_of_every_width_are_hit_alike() {
    for (seed, thin) in (1..).zip([1e-2f32, 1e-4, 1e-6, 1e-8]) {
        let mut random = Random(seed);
        let mesh = soup(300, 1.0, thin, &mut random);
        let rays: Vec<Ray> = (0..20_000)
            .map(|_| {
                let target = mesh.corners(random.below(300));
                let (u, v) = (random.unit(), random.unit());
                let weights = if u + v > 1.0 { [1.0 - u, 1.0 - v] } else { [u, v] };
                let p = target[0] * (1.0 - weights[0] - weights[1])
                    + target[1] * weights[0]
                    + target[2] * weights[1];
                let o = random.cube() * 3.0;
                Ray::new(o, p - o)
            })
            .collect();
        let reference = BruteForce::new(vec![mesh.clone().geometry()]).expect("built");
        let expected = intersect(&reference, &rays);
        for &kind in AccelKind::ALL {
            let built = build(kind, vec![mesh.clone().geometry()], 0, true).expect("built");
            assert_eq!(built.dropped, 0);
            let found = intersect(&*built.accel, &rays);
            let same = |(a, b): &(&Option<Hit>, &Option<Hit>)| match (a, b) {
                (Some(a), Some(b)) => (a.t - b.t).abs() <= 1e-3,
                (a, b) => a.is_none() == b.is_none(),
            };
            let differ = expected.iter().zip(&found).filter(|pair| !same(pair)).count();
            let hits = found.iter().flatten().count();
            println!("{kind}, width {thin:e}: {hits} hits, {differ} of {} differ from f64", rays.len());
            assert!(found.iter().flatten().all(|h| h.t.is_finite() && h.u.is_finite() && h.v.is_finite()));
            if thin >= 1e-4 {
                assert!(differ < rays.len() / 20, "{kind}, width {thin:e}: {differ} differ");
            }
        }
    }
}

/// Returns meshes of many triangles at one position.
fn crowds(count: usize) -> Vec<(&'static str, Mesh)> {
    let center = Vec3::new(0.3, -0.2, 0.1);
    let corners = [Vec3::new(-0.01, -0.01, 0.0), Vec3::new(0.02, -0.01, 0.0), Vec3::new(-0.01, 0.02, 0.0)];
    let one = |indices: [u32; 3]| vec![indices; count];
    let equal = || corners.map(|p| p + center).to_vec();
    let mut fan: Vec<Vec3> = vec![center];
    let turn = |i: usize| (i as f64 / count as f64 * std::f64::consts::TAU).sin_cos();
    fan.extend((0..count).map(|i| center + Vec3::new(turn(i).1 as f32, turn(i).0 as f32, 0.0)));
    let spokes = (0..count as u32).map(|i| [0, i + 1, (i + 1) % count as u32 + 1]).collect();
    let rings = (0..count).flat_map(|i| corners.map(|p| center + p * (1.0 + i as f32 / count as f32)));
    let rings: Vec<Vec3> = rings.collect();
    let in_order = (0..count as u32).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
    vec![
        ("points", Mesh { positions: vec![center], indices: one([0, 0, 0]) }),
        ("equal triangles", Mesh { positions: equal(), indices: one([0, 1, 2]) }),
        ("a fan around a point", Mesh { positions: fan, indices: spokes }),
        ("nested triangles", Mesh { positions: rings, indices: in_order }),
    ]
}

/// Upper bound on the bytes of an acceleration structure per triangle.
const MOST_BYTES: usize = 400;

#[test]
fn very_many_triangles_in_one_place_build_and_are_found() {
    let count = std::env::var("BUFFON_HARD_TRIANGLES").ok().and_then(|n| n.parse().ok()).unwrap_or(100_000);
    for (name, mesh) in crowds(count) {
        let geometry = mesh.geometry();
        for &kind in AccelKind::ALL {
            let started = Instant::now();
            let built = build(kind, vec![geometry.clone()], 0, true).expect("built");
            let seconds = started.elapsed().as_secs_f64();
            let bytes = built.accel.memory_bytes();
            assert_eq!(built.dropped, 0);
            let started = Instant::now();
            let at = |x: f32, y: f32| built.accel.intersect(&Ray::new(Vec3::new(x, y, 2.0), -Vec3::Z));
            // One ray inside the triangles and one outside.
            let (hit, miss) = (at(0.301, -0.199), at(0.3, 1.5));
            println!(
                "{kind}, {count} {name}: built in {seconds:.2} s, {:.0} bytes each; two rays in {:.1} ms",
                bytes as f64 / count as f64,
                started.elapsed().as_secs_f64() * 1e3
            );
            assert_eq!(miss, None, "{kind}, {name}");
            match name {
                "points" => assert_eq!(hit, None, "{kind}"),
                _ => {
                    let t = hit.unwrap_or_else(|| panic!("{kind}, {name}: no hit")).t;
                    assert!((t - 1.9).abs() < 1e-6, "{kind}, {name}: {t}");
                }
            }
            assert!(bytes < MOST_BYTES * count, "{kind}, {name}: {bytes} bytes");
        }
    }
}

/// An emitter and a floor with invalid triangles: these are counted, and have no influence on emission and reflection.
#[test]
fn a_scene_of_spoiled_meshes_renders_as_the_clean_one() {
    let square = Mesh {
        positions: [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]]
            .map(|[x, y]| Vec3::new(x, y, 0.0))
            .to_vec(),
        indices: vec![[0, 1, 2], [2, 3, 0]],
    };
    let add = |scene: &mut Description, mesh: Mesh, place: DAffine3, radiance: f32| {
        let mesh = shape::Mesh { positions: mesh.positions, indices: mesh.indices, ..shape::Mesh::default() };
        let id = scenes::add(scene, Shape::Mesh(mesh), place, scenes::diffuse(0.5));
        scene.shapes[id].emission = (radiance > 0.0).then(|| Rgb::splat(radiance).into());
    };
    for &accel in AccelKind::ALL {
        let picture = |spoiled: bool| {
            let mut random = Random(5);
            let (mut scene, mut invalid) = (Description::default(), 0);
            let down =
                DAffine3::from_translation(DVec3::Z * 2.0) * DAffine3::from_rotation_x(std::f64::consts::PI);
            for (place, radiance) in [(DAffine3::from_scale(DVec3::splat(3.0)), 0.0), (down, 4.0)] {
                let mut mesh = square.clone();
                if spoiled {
                    let (bad, count) = spoil(&mesh, &mut random);
                    // Duplicates are removed, because two emitters at one position both emit.
                    let mut indices = bad.indices.clone();
                    indices.sort_unstable();
                    indices.dedup();
                    indices.retain(|t| *t != [2, 1, 0] && *t != [0, 3, 2]);
                    (mesh, invalid) = (Mesh { indices, ..bad }, invalid + count);
                }
                add(&mut scene, mesh, place, radiance);
            }
            scene.sensors.push(scenes::camera(DVec3::new(0.0, -5.0, 1.5), DVec3::Z * 0.5, 40.0, 16));
            let options = CompileOptions { accel, threads: 1, sensor: 0, passes_panes: false };
            let (scene, report) = compile(scene, options).expect("it compiles");
            assert_eq!(report.dropped_primitives, invalid, "{accel}");
            for from in [Vec3::ZERO, Vec3::new(0.5, 0.5, 1.0)] {
                let s = scene
                    .sample_emitter(&scene.light_selection, from, Vec2::new(0.3, 0.6), 0.0)
                    .expect("the lamp shines");
                assert!(s.pdf > 0.0 && s.wi.is_finite() && s.radiance == Rgb::splat(4.0));
                let centre = scene.lights[0].sample_centre(from, 0.0).expect("its middle shines");
                assert!(centre.wi.is_finite() && centre.radiance.is_valid());
            }
            let path = Settings::Path(PathLimits::default().into());
            let rendered = scenes::render(&scene, &path, SamplerKind::Sobol, 512, 1);
            assert_eq!(rendered.invalid_count, 0);
            scenes::mean(&rendered).0[1]
        };
        let (clean, spoiled) = (picture(false), picture(true));
        println!("{accel}: {clean} clean, {spoiled} spoiled");
        assert!((spoiled / clean - 1.0).abs() < 1e-2, "{accel}: {spoiled} instead of {clean}");
    }
}
