//! Every traversal has the hits of brute force in double precision, for a million rays.
//!
//! Each difference must belong to one of these classes. The bounds are in terms of δ, a few roundings of the largest
//! coordinate of the ray and its hits:
//! * `same`: the same primitive, at the same distance within δ times the condition of the triangle (the angle of
//!   incidence and the ratio of its length to its height);
//! * `tie`: two primitives at the same distance, within the same bound;
//! * `edge`: the nearer hit is within δ of the outline of its triangle (also if it is seen edge-on), and the other
//!   traversal misses it;
//! * `bound`: the nearer hit is within that bound of 0 or of `t_max`.
//!
//! Analytic surfaces have no tolerance, because every traversal calls the same function.

use crate::meshes::{Mesh, Random, cube, soup, sphere, terrain};
use buffon::accel::brute_force::BruteForce;
use buffon::accel::{Accel, AccelKind, Coherence, CurveSegments, Geometry, Hit, Primitive, build};
use buffon::math::{DAffine3, DQuat, DVec3, Ray, Vec3};
use buffon::shape::{SdfGrid, SdfNormals, WorldSdfGrid};
use std::sync::Arc;

const RAYS_PER_SCENE: usize = 200_000;

/// A list of geometries and their meshes, by index.
struct Scene {
    name: &'static str,
    geometry: Vec<Geometry>,
    meshes: Vec<Option<Mesh>>,
}

impl Scene {
    fn new(name: &'static str, meshes: Vec<Mesh>, surfaces: Vec<Primitive>) -> Scene {
        let geometry = meshes.iter().cloned().map(Mesh::geometry);
        let geometry = geometry.chain(surfaces.iter().map(|s| Geometry::Analytic(*s))).collect();
        let meshes = meshes.into_iter().map(Some).chain(surfaces.iter().map(|_| None)).collect();
        Scene { name, geometry, meshes }
    }
}

fn scenes() -> Vec<Scene> {
    let mut random = Random(11);
    let surfaces = (0..40).map(|i| {
        let center = random.cube();
        match i % 2 {
            0 => Primitive::Sphere { center, radius: 0.02 + 0.3 * random.unit() },
            _ => Primitive::Disk { center, du: random.cube() * 0.4, dv: random.cube() * 0.4 },
        }
    });
    let surfaces: Vec<_> = surfaces.collect();
    let boxes = |random: &mut Random| {
        let (p, s) = ((random.cube() * 8.0).round() / 8.0, (random.cube().abs() * 4.0).ceil() / 16.0);
        cube().map(move |q| p + q * s)
    };
    vec![
        Scene::new("random", vec![soup(150, 0.4, 1.0, &mut random), soup(50, 1.5, 1.0, &mut random)], vec![]),
        Scene::new("slivers", vec![soup(200, 1.5, 1e-4, &mut random)], vec![]),
        Scene::new("axis-aligned", (0..16).map(|_| boxes(&mut random)).collect(), vec![]),
        Scene::new("shared edges", vec![sphere(8, 12), terrain(5).map(|p| p * 0.8)], vec![]),
        Scene::new("few boxes", (0..6).map(|_| boxes(&mut random)).collect(), vec![]),
        Scene::new("few", vec![soup(30, 0.5, 1.0, &mut random)], surfaces[..8].to_vec()),
        Scene::new("analytic", vec![soup(60, 0.5, 1.0, &mut random)], surfaces),
        // Embree traces waves one ray at a time if there are fewer triangles than other primitives, else in packets.
        curves("curves", 20, &mut random),
        isosurface("isosurface", 20, &mut random),
        curves("curves among triangles", 200, &mut random),
        isosurface("isosurface among triangles", 300, &mut random),
    ]
}

/// Returns the isosurface of random distances.
fn isosurface(name: &'static str, triangles: u32, random: &mut Random) -> Scene {
    let mut scene = Scene::new(name, vec![soup(triangles, 0.5, 1.0, random)], vec![]);
    let distances = (0..6 * 5 * 7).map(|_| random.unit() - 0.5).collect();
    let grid = SdfGrid::new([6, 5, 7], distances, SdfNormals::Smooth).expect("a grid");
    let to_world = DAffine3::from_scale_rotation_translation(
        DVec3::new(2.0, -1.8, 1.9),
        DQuat::IDENTITY,
        DVec3::new(-1.0, 0.9, -1.0),
    );
    let placed = WorldSdfGrid::new(grid, &to_world).expect("a placed grid");
    scene.geometry.push(Geometry::Surfaces(placed.cells));
    scene.meshes.push(None);
    scene
}

/// Returns curves with corners and smooth ones.
fn curves(name: &'static str, triangles: u32, random: &mut Random) -> Scene {
    let mut scene = Scene::new(name, vec![soup(triangles, 0.5, 1.0, random)], vec![]);
    for smooth in [false, true] {
        let points = (0..60).map(|_| (random.cube(), 0.02 + 0.1 * random.unit())).collect();
        let first_points = (0..59).filter(|i| i % 6 != 5).collect();
        let tangents = if smooth { (0..60).map(|_| random.cube().normalize()).collect() } else { Vec::new() };
        scene.geometry.push(Geometry::Surfaces(Arc::new(CurveSegments { points, first_points, tangents })));
        scene.meshes.push(None);
    }
    scene
}

/// Returns a ray: between random points, to a vertex or edge, along an axis, from a surface, or a shadow ray.
fn ray(scene: &Scene, random: &mut Random) -> Ray {
    let mesh = scene.meshes[random.below(scene.meshes.iter().flatten().count())]
        .as_ref()
        .expect("meshes come first");
    let origin = match random.below(4) {
        0 => random.cube() * 4.0,
        1 => (random.cube() * 8.0).round() / 8.0,
        2 => mesh.vertex_or_edge_point(random),
        _ => random.cube(),
    };
    let target = if random.below(2) == 0 { mesh.vertex_or_edge_point(random) } else { random.cube() };
    let d = match random.below(4) {
        0 => [Vec3::X, Vec3::Y, Vec3::Z, -Vec3::X, -Vec3::Y, -Vec3::Z][random.below(6)],
        1 => (target - origin).normalize_or(Vec3::X),
        _ => target - origin,
    };
    Ray { t_max: if random.below(3) == 0 { 1.0 } else { f32::INFINITY }, ..Ray::new(origin, d) }
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Class {
    Same,
    Tie,
    Edge,
    Bound,
}

/// δ and the tolerances of t and of the point given by u and v. In a triangle of length `length` and projected height
/// `height`, u and v have an error of δ / height.
struct Tolerance {
    delta: f64,
    t: f64,
    coordinates: f64,
    corners: Option<[DVec3; 3]>,
}

fn tolerance(scene: &Scene, ray: &Ray, hit: &Hit) -> Tolerance {
    let Some(mesh) = &scene.meshes[hit.geometry as usize] else {
        return Tolerance { delta: 0.0, t: 0.0, coordinates: 0.0, corners: None };
    };
    let corners = mesh.corners(hit.primitive as usize);
    let size = corners.iter().fold(ray.o.abs().max_element(), |m, p| m.max(p.abs().max_element()));
    let delta = 16.0 * f64::from(f32::EPSILON * size);
    let [a, b, c] = corners.map(|p| p.as_dvec3());
    let length = (b - a).length().max((c - a).length()).max((c - b).length());
    let (n, d) = ((b - a).cross(c - a), ray.d.as_dvec3());
    let height = n.dot(d.normalize()).abs() / length;
    let coordinates = delta * (1.0 + length / height);
    let plane = delta / n.normalize_or_zero().dot(d).abs();
    let t = plane + coordinates / d.length() + 4.0 * f64::from(f32::EPSILON * hit.t);
    Tolerance { delta, t, coordinates, corners: Some([a, b, c]) }
}

/// Returns the distance of the ray's line from the edge a-b.
fn distance_to_edge(o: DVec3, d: DVec3, a: DVec3, b: DVec3) -> f64 {
    // In the projection along the ray, this is the distance of the origin from a segment.
    let flat = |p: DVec3| (p - o) - d * ((p - o).dot(d) / d.length_squared());
    let (a, b) = (flat(a), flat(b));
    let e = b - a;
    let s = if e.length_squared() > 0.0 { (-a.dot(e) / e.length_squared()).clamp(0.0, 1.0) } else { 0.0 };
    (a + e * s).length()
}

/// Returns the class of the difference, or `None` if the hits are not equivalent.
fn classify(scene: &Scene, ray: &Ray, a: Option<Hit>, b: Option<Hit>) -> Option<Class> {
    let (near, far) = match (a, b) {
        (None, None) => return Some(Class::Same),
        (Some(a), Some(b)) if a.t <= b.t => (a, Some(b)),
        (Some(a), b) if b.is_none() => (a, None),
        (a, b) => (b?, a),
    };
    let tol = tolerance(scene, ray, &near);
    if let Some(far) = far {
        let close = f64::from(far.t - near.t) <= tol.t + tolerance(scene, ray, &far).t;
        let same = (near.geometry, near.primitive) == (far.geometry, far.primitive);
        if close {
            return Some(if same { Class::Same } else { Class::Tie });
        }
    }
    if let Some([p, q, r]) = tol.corners {
        let (o, d) = (ray.o.as_dvec3(), ray.d.as_dvec3());
        let edge = |a, b| distance_to_edge(o, d, a, b) <= tol.delta;
        if edge(p, q) || edge(q, r) || edge(r, p) {
            return Some(Class::Edge);
        }
    }
    let from_bound = f64::from(near.t).min(f64::from(ray.t_max - near.t));
    (from_bound <= tol.t).then_some(Class::Bound)
}

/// Returns whether u and v of a hit give the same point as its distance.
fn coordinates_agree(scene: &Scene, ray: &Ray, hit: &Hit) -> bool {
    let tol = tolerance(scene, ray, hit);
    let Some([a, b, c]) = tol.corners else { return true };
    let p = a + (b - a) * f64::from(hit.u) + (c - a) * f64::from(hit.v);
    let along = ray.o.as_dvec3() + ray.d.as_dvec3() * f64::from(hit.t);
    (p - along).length() <= 4.0 * (tol.coordinates + tol.t * f64::from(ray.d.length()))
}

#[derive(Debug, Default)]
struct Tally {
    same: usize,
    tie: usize,
    edge: usize,
    bound: usize,
}

fn compare(scene: &Scene, who: &str, rays: &[Ray], expected: &[Option<Hit>], found: &[Option<Hit>]) -> Tally {
    let mut tally = Tally::default();
    for ((ray, expected), found) in rays.iter().zip(expected).zip(found) {
        match classify(scene, ray, *expected, *found) {
            Some(Class::Same) => tally.same += 1,
            Some(Class::Tie) => tally.tie += 1,
            Some(Class::Edge) => tally.edge += 1,
            Some(Class::Bound) => tally.bound += 1,
            None => panic!("{who}, {}: {ray:?}\n  expected {expected:?}\n  found    {found:?}", scene.name),
        }
        if let Some(hit) = found {
            assert!(coordinates_agree(scene, ray, hit), "{who}, {}: {ray:?}: u and v of {hit:?}", scene.name);
        }
    }
    tally
}

#[test]
fn every_back_end_finds_what_brute_force_finds() {
    for (seed, scene) in (100..).zip(scenes()) {
        let mut random = Random(seed);
        let rays: Vec<Ray> = (0..RAYS_PER_SCENE).map(|_| ray(&scene, &mut random)).collect();
        let oracle = BruteForce::new(scene.geometry.clone()).expect("built");
        let mut expected = vec![None; rays.len()];
        std::thread::scope(|s| {
            for (rays, expected) in rays.chunks(50_000).zip(expected.chunks_mut(50_000)) {
                let oracle = &oracle;
                s.spawn(move || oracle.intersect_wave(rays, expected, Coherence::Incoherent));
            }
        });
        for &kind in AccelKind::CHOICES {
            let built = build(kind, scene.geometry.clone(), 0, true).expect("built");
            assert_eq!(built.dropped, 0);
            assert_eq!(built.accel.bounds(), oracle.bounds());
            let mut wave = vec![None; rays.len()];
            built.accel.intersect_wave(&rays, &mut wave, Coherence::Incoherent);
            let tally = compare(&scene, &format!("{kind} wave"), &rays, &expected, &wave);
            println!("{kind}, {}: {tally:?}", scene.name);
            let single: Vec<_> = rays.iter().take(20_000).map(|ray| built.accel.intersect(ray)).collect();
            compare(&scene, &format!("{kind} single"), &rays[..20_000], &expected, &single);
            compare_occlusion(&scene, kind, &*built.accel, &rays, &wave);
        }
    }
}

/// Checks that a ray is occluded if and only if it has a hit.
fn compare_occlusion(scene: &Scene, kind: AccelKind, accel: &dyn Accel, rays: &[Ray], hits: &[Option<Hit>]) {
    let mut occluded = vec![false; rays.len()];
    accel.occluded_wave(rays, &mut occluded, Coherence::Incoherent);
    for (i, ray) in rays.iter().enumerate() {
        assert_eq!(occluded[i], hits[i].is_some(), "{kind}, {}: {ray:?}, {:?}", scene.name, hits[i]);
        if i % 10 == 0 {
            assert_eq!(accel.occluded(ray), occluded[i], "{kind}, {}: single, {ray:?}", scene.name);
        }
    }
}

#[test]
fn the_number_of_building_threads_does_not_change_a_hit() {
    let mesh = terrain(120);
    let mut random = Random(5);
    let aimed = |_| {
        let o = Vec3::new(0.3, 0.2, 2.0) + random.cube();
        Ray::new(o, mesh.vertex_or_edge_point(&mut random) - o)
    };
    let rays: Vec<Ray> = (0..100_000).map(aimed).collect();
    for &kind in AccelKind::ALL {
        let hits = [1, 2, 5].map(|threads| {
            let accel = build(kind, vec![mesh.clone().geometry()], threads, true).expect("built").accel;
            let mut hits = vec![None; rays.len()];
            accel.intersect_wave(&rays, &mut hits, Coherence::Incoherent);
            hits
        });
        assert!(hits[0] == hits[1] && hits[0] == hits[2], "{kind}");
    }
}

#[test]
fn invalid_primitives_are_dropped_and_counted_alike() {
    let mut mesh = cube();
    mesh.positions.extend([Vec3::NAN, Vec3::splat(f32::INFINITY), Vec3::splat(2e18)]);
    mesh.indices.extend([[0, 1, 8], [0, 1, 9], [0, 1, 10], [0, 1, 11]]);
    let nothing = Mesh { positions: Vec::new(), indices: vec![[0, 1, 2]] };
    let bad_sphere = Geometry::Analytic(Primitive::Sphere { center: Vec3::ZERO, radius: f32::NAN });
    let good_sphere = Geometry::Analytic(Primitive::Sphere { center: Vec3::ZERO, radius: 0.5 });
    for &kind in AccelKind::ALL {
        let list = vec![
            nothing.clone().geometry(),
            bad_sphere.clone(),
            mesh.clone().geometry(),
            good_sphere.clone(),
        ];
        let built = build(kind, list, 0, true).expect("built");
        assert_eq!(built.dropped, 6, "{kind}");
        assert_eq!((built.accel.bounds().min, built.accel.bounds().max), (-Vec3::ONE, Vec3::ONE));
        let at = |x: f32| built.accel.intersect(&Ray::new(Vec3::new(x, 0.1, 0.2), Vec3::X)).expect("a hit");
        assert_eq!((at(-3.0).geometry, at(-0.9).geometry, at(-0.9).primitive), (2, 3, 0), "{kind}");
    }
}

#[test]
fn invalid_rays_hit_nothing_and_disturb_no_neighbour() {
    let good = Ray::new(Vec3::new(0.1, 0.2, 3.0), -Vec3::Z);
    let bad = [
        Ray { o: Vec3::NAN, ..good },
        Ray { d: Vec3::new(0.0, f32::NAN, 1.0), ..good },
        Ray { d: Vec3::ZERO, ..good },
        Ray { d: Vec3::INFINITY, ..good },
        Ray { t_max: f32::NAN, ..good },
        Ray { t_max: 0.0, ..good },
        Ray { t_max: f32::NEG_INFINITY, ..good },
    ];
    let rays: Vec<Ray> = bad.iter().flat_map(|b| [*b, good, good]).collect();
    for &kind in AccelKind::ALL {
        let accel = build(kind, vec![cube().geometry()], 0, true).expect("built").accel;
        let (mut hits, mut occluded) = (vec![None; rays.len()], vec![false; rays.len()]);
        accel.intersect_wave(&rays, &mut hits, Coherence::Incoherent);
        accel.occluded_wave(&rays, &mut occluded, Coherence::Coherent);
        for (i, ray) in rays.iter().enumerate() {
            let valid = i % 3 != 0;
            let single = accel.intersect(ray);
            assert_eq!(
                (hits[i].is_some(), occluded[i], single.is_some()),
                (valid, valid, valid),
                "{kind}: {ray:?}"
            );
            assert!(hits[i].is_none_or(|hit| near(kind, hit.t, 2.0)), "{kind}: {:?}", hits[i]);
        }
    }
}

/// Returns whether a distance is exact. That of Embree may be rounded: it divides by an approximate reciprocal, whose
/// last bits differ among makers of CPUs.
fn near(kind: AccelKind, t: f32, exact: f32) -> bool {
    let rounding = if kind == AccelKind::Obvhs { 0.0 } else { 2.0 * f32::EPSILON };
    (t - exact).abs() <= rounding * exact
}

#[test]
fn many_equal_triangles_build_and_the_first_is_hit() {
    let positions = vec![Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::ONE];
    for pattern in [vec![[0, 1, 2]], vec![[0, 1, 2], [1, 3, 2], [0, 3, 1], [1, 1, 1]]] {
        let indices = pattern.iter().copied().cycle().take(100_000).collect();
        let mesh = Mesh { positions: positions.clone(), indices };
        for &kind in AccelKind::ALL {
            let accel = build(kind, vec![mesh.clone().geometry()], 0, true).expect("built").accel;
            let hit = accel.intersect(&Ray::new(Vec3::new(0.125, 0.25, 1.0), -Vec3::Z)).expect("a hit");
            assert!(near(kind, hit.t, 1.0), "{kind}: {}", hit.t);
            assert_eq!(hit.primitive as usize % pattern.len(), 0);
            if kind == AccelKind::Obvhs {
                assert_eq!(hit.primitive, 0);
            }
        }
    }
}

/// A ray that starts exactly in the plane of a triangle does not hit it, with any traversal, singly or in waves.
#[test]
fn a_ray_that_starts_in_a_plane_through_the_origin_does_not_hit_it() {
    use buffon::accel::{AccelKind, Coherence, Geometry, VertexBuffer, build};
    use buffon::math::{Ray, Vec3};
    use std::sync::Arc;
    let corners = [(-50.0, -50.0), (50.0, -50.0), (50.0, 50.0), (-50.0, 50.0)];
    for &kind in AccelKind::ALL {
        let positions: VertexBuffer = corners.iter().map(|&(x, z)| Vec3::new(x, 0.0, z)).collect();
        let indices = Arc::new(vec![[0, 1, 2], [2, 3, 0]]);
        let geometry = vec![Geometry::Triangles { positions: Arc::new(positions), indices }];
        let accel = build(kind, geometry, 1, true).expect("two triangles build").accel;
        let rays: Vec<Ray> = (0..1000)
            .map(|i| {
                let t = i as f32 * 0.618;
                let o = Vec3::new((t * 7.3).sin() * 40.0, 0.0, (t * 3.1).cos() * 40.0);
                Ray::new(o, Vec3::new(t.sin(), if i % 2 == 0 { 0.5 } else { -0.5 }, t.cos()))
            })
            .collect();
        let (mut hits, mut occluded) = (vec![None; rays.len()], vec![true; rays.len()]);
        accel.intersect_wave(&rays, &mut hits, Coherence::Incoherent);
        accel.occluded_wave(&rays, &mut occluded, Coherence::Incoherent);
        for (i, ray) in rays.iter().enumerate() {
            assert_eq!((accel.intersect(ray), hits[i]), (None, None), "{kind}: {ray:?}");
            assert!(!accel.occluded(ray) && !occluded[i], "{kind}: {ray:?}");
        }
    }
}
