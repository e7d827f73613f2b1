//! Instances, motion, filters and analytic surfaces in groups: every traversal has the hits of brute force.
//!
//! Hits are compared in the coordinates of their group, in which they are computed. There the ray has an error up to
//! [`Instance::transform_error`], so analytic surfaces in groups have a tolerance, too.

use crate::meshes::{Mesh, Random, cube, soup, sphere};
use buffon::accel::brute_force::BruteForce;
use buffon::accel::{
    Accel, AccelKind, Assembly, Coherence, Geometry, GeometryFilter, Hit, HitFilter, Instance, NO_INSTANCE,
    Primitive, build, cylinder_frame, ray_id,
};
use buffon::math::{DAffine3, DMat3, DQuat, DVec3, Ray, Vec3};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;

const RAYS: usize = 40_000;
/// Times at the steps of the moving instances and between them.
const TIMES: [f32; 8] = [0.0, 1.0, 0.5, 0.25, 0.1, 0.618, 0.999_999_9, 1e-7];

/// An assembly and its meshes, by geometry.
struct Scene {
    assembly: Assembly,
    meshes: Vec<Option<Mesh>>,
}

/// Returns two groups, each of a mesh and analytic surfaces, and geometry of each kind outside of groups.
fn scene(instances: Vec<Instance>) -> Scene {
    let mut random = Random(3);
    let tube = |a: f32| Primitive::Cylinder {
        p0: Vec3::new(-0.8, a, 0.1),
        p1: Vec3::new(0.6, 0.3, -0.4 * a),
        radius: 0.35,
    };
    let ball = |x: f32| Primitive::Sphere { center: Vec3::new(x, 0.2, -0.3), radius: 0.4 };
    let disk = Primitive::Disk { center: Vec3::Y, du: Vec3::X, dv: Vec3::new(0.3, 0.1, 0.8) };
    let entries = [
        Err(tube(-1.0)),
        Ok(sphere(6, 9)),
        Err(ball(0.9)),
        Ok(soup(40, 0.6, 1.0, &mut random)),
        Ok(cube().map(|p| p * 0.7)),
        Err(disk),
        Err(tube(0.7)),
        Err(ball(-0.6)),
        Ok(soup(30, 0.9, 0.01, &mut random)),
    ];
    let geometry = entries.iter().map(|e| match e {
        Ok(mesh) => mesh.clone().geometry(),
        Err(surface) => Geometry::Analytic(*surface),
    });
    let geometry = geometry.collect();
    let groups = vec![vec![2, 1], vec![8, 6, 4, 5], vec![]];
    let meshes = entries.into_iter().map(Result::ok).collect();
    Scene { assembly: Assembly { geometry, groups, instances, filter: None }, meshes }
}

fn placed(scale: [f64; 3], axis: DVec3, angle: f64, translation: [f64; 3]) -> DAffine3 {
    let rotation = DQuat::from_axis_angle(axis.normalize(), angle);
    DAffine3::from_scale_rotation_translation(scale.into(), rotation, translation.into())
}

fn resting() -> Vec<Instance> {
    let sheared = DAffine3 {
        matrix3: DMat3::from_cols(DVec3::X, DVec3::new(0.8, 1.0, 0.0), DVec3::new(0.1, -0.4, 0.7)),
        translation: DVec3::new(0.0, 0.0, 3.0),
    };
    [
        (0, DAffine3::IDENTITY),
        (1, placed([1.0; 3], DVec3::ONE, 1.0, [3.0, 0.0, 0.0])),
        (0, placed([2.0, 0.3, 1.0], DVec3::Y, 0.4, [0.0, 3.0, 0.5])),
        (2, DAffine3::IDENTITY),
        (1, placed([-1.0, 1.0, 1.0], DVec3::Z, 0.0, [-3.0, 0.0, 0.0])),
        (1, placed([1.0, -0.5, 1.5], DVec3::new(1.0, 2.0, -1.0), 2.0, [0.0, -3.0, 1.0])),
        (0, placed([1.0; 3], DVec3::X, 0.7, [2000.0, -1000.0, 500.0])),
        (1, placed([1e-3; 3], DVec3::X, 0.2, [0.1, 0.2, 1.5])),
        (0, placed([300.0; 3], DVec3::Z, 0.2, [0.0, 0.0, -400.0])),
        (1, sheared),
    ]
    .map(|(group, m)| Instance::new(group, &[m]))
    .into()
}

fn moving() -> Vec<Instance> {
    let turning: Vec<_> =
        (0..5).map(|i| placed([1.0; 3], DVec3::Z, 0.4 * f64::from(i), [2.0, 0.0, 0.0])).collect();
    let flying = [[-2.0, 0.0, 0.0], [-2.0, 2.0, 1.0]].map(|t| placed([0.7, 0.9, -1.0], DVec3::Y, 0.3, t));
    let growing = [0.5, 1.5, 0.8].map(|s| placed([s, 1.0, s], DVec3::ONE, 0.5 * s, [0.0, -2.0, 4.0 * s]));
    vec![
        Instance::new(0, &turning),
        Instance::new(1, &flying),
        Instance::new(1, &[placed([1.0; 3], DVec3::X, 0.5, [0.0, 3.0, 0.0])]),
        Instance::new(0, &growing),
    ]
}

/// Returns rays between points near an instance, or to vertices and edges. Some are along an axis or bounded.
fn rays(scene: &Scene, seed: u64) -> Vec<Ray> {
    let mut random = Random(seed);
    let instances = &scene.assembly.instances;
    let point = |time: f32, mesh: Option<usize>, random: &mut Random| {
        let local = match mesh.and_then(|m| scene.meshes[m].as_ref()) {
            Some(mesh) => mesh.vertex_or_edge_point(random),
            None => random.cube() * 2.0,
        };
        match random.below(instances.len() + 1).checked_sub(1) {
            None => local,
            Some(i) => instances[i].to_world(time).transform_point3(local.as_dvec3()).as_vec3(),
        }
    };
    let ray = |_| {
        let time = TIMES[random.below(TIMES.len())];
        let o = point(time, None, &mut random);
        let aim = random.below(2 * scene.meshes.len());
        let target = point(time, Some(aim).filter(|&a| a < scene.meshes.len()), &mut random);
        let d = match random.below(8) {
            0 => [Vec3::X, -Vec3::Y, Vec3::Z][random.below(3)],
            1 | 2 => (target - o).normalize_or(Vec3::Z),
            _ => target - o,
        };
        Ray { t_max: if random.below(4) == 0 { 1.0 } else { f32::INFINITY }, time, ..Ray::new(o, d) }
    };
    (0..RAYS).map(ray).collect()
}

/// The tolerance of the distance, and whether the hit is so near to the outline that it may be missed.
struct Tolerance {
    t: f64,
    edge: bool,
}

/// Returns the ray in the coordinates of the hit's group, and the bound on its error there.
fn local(scene: &Scene, ray: &Ray, hit: &Hit) -> (DVec3, DVec3, f64) {
    let (o, d) = (ray.o.as_dvec3(), ray.d.as_dvec3());
    if hit.instance == NO_INSTANCE {
        return (o, d, 0.0);
    }
    let instance = &scene.assembly.instances[hit.instance as usize];
    let inverse = instance.to_world(ray.time).inverse();
    let reach = ray.o.abs() + ray.d.abs() * hit.t;
    let error = instance.transform_error(ray.time, reach).as_dvec3();
    let rows = inverse.matrix3.transpose();
    let off = [rows.x_axis, rows.y_axis, rows.z_axis].map(|row| row.abs().dot(error));
    (inverse.transform_point3(o), inverse.transform_vector3(d), 2.0 * off.into_iter().fold(0.0, f64::max))
}

fn tolerance(scene: &Scene, ray: &Ray, hit: &Hit) -> Tolerance {
    let (o, d, off) = local(scene, ray, hit);
    let eps = 16.0 * f64::from(f32::EPSILON);
    let rounded = 4.0 * f64::from(f32::EPSILON * hit.t);
    let length = d.length();
    match scene.assembly.geometry[hit.geometry as usize] {
        Geometry::Triangles { .. } => {
            let mesh = scene.meshes[hit.geometry as usize].as_ref().expect("a mesh");
            let [a, b, c] = mesh.corners(hit.primitive as usize).map(|p| p.as_dvec3());
            let size = [a, b, c].iter().fold(o.abs().max_element(), |m, p| m.max(p.abs().max_element()));
            let delta = off + eps * size;
            let n = (b - a).cross(c - a);
            let longest = (b - a).length().max((c - a).length()).max((c - b).length());
            let height = n.dot(d).abs() / length / longest;
            let t = delta / n.normalize_or_zero().dot(d).abs() + delta * (1.0 + longest / height) / length;
            let near = |p, q| distance_to_edge(o, d, p, q) <= delta;
            Tolerance { t: t + rounded, edge: near(a, b) || near(b, c) || near(c, a) }
        }
        Geometry::Analytic(surface) => {
            let delta = off + eps * o.abs().max_element();
            let (t, edge) = analytic_tolerance(&surface, o, d, f64::from(hit.t), delta);
            Tolerance { t: t + rounded, edge }
        }
        Geometry::Surfaces(_) => unreachable!("the scenes have none"),
    }
}

/// Returns the error of the distance to an analytic surface for a ray with an error of `delta`, and whether the outline
/// is within this error.
fn analytic_tolerance(surface: &Primitive, o: DVec3, d: DVec3, t: f64, delta: f64) -> (f64, bool) {
    // For a circle of radius r and a ray at the distance b from its centre, half the chord is h = √(r² − b²).
    let circle = |f: DVec3, d: DVec3, r: f64| {
        let b = (f - d * (f.dot(d) / d.length_squared())).length();
        let h2 = (r - b) * (r + b);
        let chord = if h2 > 4.0 * r * delta { 2.0 * r * delta / h2.sqrt() } else { (8.0 * r * delta).sqrt() };
        ((delta + chord) / d.length(), (r - b).abs() <= 2.0 * delta)
    };
    match *surface {
        Primitive::Sphere { center, radius } => circle(o - center.as_dvec3(), d, radius.into()),
        Primitive::Disk { center, du, dv } => {
            let (du, dv) = (du.as_dvec3(), dv.as_dvec3());
            let n = du.cross(dv);
            let t_error = delta / n.normalize().dot(d).abs();
            let p = o + d * t - center.as_dvec3();
            let n2 = n.length_squared();
            let (u, v) = (p.cross(dv).dot(n) / n2, du.cross(p).dot(n) / n2);
            let slack = (delta + t_error * d.length()) * (du.length() + dv.length()) / n.length();
            (t_error, (u.hypot(v) - 1.0).abs() <= slack)
        }
        Primitive::Cylinder { p0, p1, radius } => {
            let axis = cylinder_frame(p0, p1)[2];
            let across = |v: DVec3| v - axis * v.dot(axis);
            let (t_error, silhouette) = circle(across(o - p0.as_dvec3()), across(d), radius.into());
            let height = (o + d * t - p0.as_dvec3()).dot(axis);
            let slack = delta + t_error * d.dot(axis).abs() + 4.0 * f64::from(f32::EPSILON) * t * d.length();
            let whole = p0.as_dvec3().distance(p1.as_dvec3());
            (t_error, silhouette || height.abs() <= slack || (height - whole).abs() <= slack)
        }
        Primitive::RoundCone(_) | Primitive::SdfCell(_) => unreachable!("the scenes have neither"),
    }
}

/// Returns the distance of the ray's line from the edge a-b.
fn distance_to_edge(o: DVec3, d: DVec3, a: DVec3, b: DVec3) -> f64 {
    let flat = |p: DVec3| (p - o) - d * ((p - o).dot(d) / d.length_squared());
    let (a, b) = (flat(a), flat(b));
    let e = b - a;
    let s = if e.length_squared() > 0.0 { (-a.dot(e) / e.length_squared()).clamp(0.0, 1.0) } else { 0.0 };
    (a + e * s).length()
}

/// Returns whether two hits are the same within their tolerances, or the nearer one is at an outline or at a bound.
fn equivalent(scene: &Scene, ray: &Ray, a: Option<Hit>, b: Option<Hit>) -> bool {
    let (near, far) = match (a, b) {
        (None, None) => return true,
        (Some(a), Some(b)) if a.t <= b.t => (a, Some(b)),
        (Some(a), None) => (a, None),
        (a, Some(b)) => (b, a),
    };
    let tol = tolerance(scene, ray, &near);
    let close = |far: Hit| f64::from(far.t - near.t) <= tol.t + tolerance(scene, ray, &far).t;
    far.is_some_and(close) || tol.edge || f64::from(near.t).min(f64::from(ray.t_max - near.t)) <= tol.t
}

/// Compares waves, single rays and occlusion of every traversal. Returns the number of rays that hit an instance.
fn compare(name: &str, scene: &Scene, rays: &[Ray]) -> usize {
    let oracle = BruteForce::new(scene.assembly.clone()).expect("built");
    let mut expected = vec![None; rays.len()];
    oracle.intersect_wave(rays, &mut expected, Coherence::Incoherent);
    for &kind in AccelKind::ALL {
        let accel = build(kind, scene.assembly.clone(), 1, true).expect("built").accel;
        assert_eq!(accel.bounds(), oracle.bounds());
        let (mut hits, mut occluded) = (vec![None; rays.len()], vec![false; rays.len()]);
        accel.intersect_wave(rays, &mut hits, Coherence::Coherent);
        accel.occluded_wave(rays, &mut occluded, Coherence::Coherent);
        let (coherent, coherently_occluded) = (hits.clone(), occluded.clone());
        accel.intersect_wave(rays, &mut hits, Coherence::Incoherent);
        accel.occluded_wave(rays, &mut occluded, Coherence::Incoherent);
        assert_eq!(coherently_occluded, occluded);
        let mut differing = 0;
        for (i, ray) in rays.iter().enumerate() {
            assert!(
                equivalent(scene, ray, expected[i], hits[i]),
                "{kind}, {name}: {ray:?}\n  expected {:?}\n  found    {:?}",
                expected[i],
                hits[i]
            );
            assert!(
                equivalent(scene, ray, expected[i], coherent[i]),
                "{kind}, {name}: {ray:?}, {:?}",
                coherent[i]
            );
            let who = |h: &Hit| (h.instance, h.geometry, h.primitive);
            differing += usize::from(expected[i].as_ref().map(who) != hits[i].as_ref().map(who));
            assert_eq!(occluded[i], hits[i].is_some(), "{kind}, {name}: {ray:?}, {:?}", hits[i]);
            if i % 8 == 0 {
                let single = accel.intersect(ray);
                assert!(
                    equivalent(scene, ray, expected[i], single),
                    "{kind}, {name}: single, {ray:?}, {single:?}"
                );
                assert_eq!(accel.occluded(ray), single.is_some(), "{kind}, {name}: single, {ray:?}");
            }
        }
        println!("{kind}, {name}: {differing} of {} rays hit something else, within rounding", rays.len());
        assert!(differing < rays.len() / 10, "{kind}, {name}: {differing}");
    }
    expected.iter().flatten().filter(|h| h.instance != NO_INSTANCE).count()
}

#[test]
fn instances_at_rest_are_hit_alike() {
    let scene = scene(resting());
    let hits = compare("at rest", &scene, &rays(&scene, 1));
    assert!(hits > RAYS / 4, "{hits}");
}

#[test]
fn moving_instances_are_hit_alike_at_all_times() {
    let scene = scene(moving());
    let hits = compare("moving", &scene, &rays(&scene, 2));
    assert!(hits > RAYS / 4, "{hits}");
}

/// Accepts a fraction of the hits, by a hash of the ray's number, the geometry and the primitive.
struct ByChance(u32);

impl HitFilter for ByChance {
    fn accepts(&self, id: u32, _: &Ray, hit: &Hit) -> bool {
        let o = Vec3::new(f32::from_bits(id >> 2), hit.geometry as f32, hit.primitive as f32);
        ray_id(&Ray::new(o, Vec3::ZERO)) >> 16 < self.0
    }
}

fn filtered(mut scene: Scene, filter: impl HitFilter + 'static, marked: impl Fn(usize) -> bool) -> Scene {
    let geometry = (0..scene.assembly.geometry.len()).map(marked).collect();
    scene.assembly.filter = Some(GeometryFilter { filter: Arc::new(filter), geometry });
    scene
}

#[test]
fn a_filter_by_chance_leaves_the_same_hits_on_every_back_end() {
    for (name, instances) in [("filtered", resting()), ("filtered and moving", moving())] {
        for marked in [|_: usize| true, |i: usize| i % 3 == 1] {
            let scene = filtered(scene(instances.clone()), ByChance(1 << 15), marked);
            assert!(compare(name, &scene, &rays(&scene, 4)) > RAYS / 8);
        }
    }
}

#[test]
fn a_filter_that_refuses_everything_leaves_only_what_is_not_marked() {
    let scene = filtered(scene(moving()), ByChance(0), |i| i != 6);
    let rays = rays(&scene, 5);
    compare("refused", &scene, &rays);
    for &kind in AccelKind::ALL {
        let accel = build(kind, scene.assembly.clone(), 1, true).expect("built").accel;
        let hits: Vec<Hit> = rays.iter().filter_map(|ray| accel.intersect(ray)).collect();
        assert!(!hits.is_empty() && hits.iter().all(|hit| hit.geometry == 6), "{kind}");
    }
}

/// Accepts hits from inside.
struct FromInside;

impl HitFilter for FromInside {
    fn accepts(&self, _: u32, ray: &Ray, hit: &Hit) -> bool {
        assert_eq!(ray.t_max, hit.t);
        ray.at(hit.t).dot(ray.d) > 0.0
    }
}

#[test]
fn the_far_side_is_hit_where_the_near_side_is_refused_and_the_filter_sees_the_groups_coordinates() {
    let (p0, p1) = (-Vec3::Z, Vec3::Z);
    for surface in
        [Primitive::Sphere { center: Vec3::ZERO, radius: 1.0 }, Primitive::Cylinder { p0, p1, radius: 1.0 }]
    {
        let assembly = Assembly {
            geometry: vec![Geometry::Analytic(surface), sphere(40, 80).geometry()],
            groups: vec![vec![0], vec![1]],
            instances: vec![
                Instance::new(0, &[placed([2.0; 3], DVec3::Z, 0.0, [10.0, 0.0, 0.0])]),
                Instance::new(1, &[placed([2.0; 3], DVec3::Z, 0.0, [100.0, 0.0, 0.0])]),
            ],
            filter: Some(GeometryFilter { filter: Arc::new(FromInside), geometry: vec![true; 2] }),
        };
        let mut accels = vec![Box::new(BruteForce::new(assembly.clone()).expect("built")) as Box<dyn Accel>];
        accels.extend(
            AccelKind::ALL.iter().map(|&kind| build(kind, assembly.clone(), 1, true).expect("built").accel),
        );
        for accel in accels {
            let ray = Ray::new(Vec3::new(0.0, 0.01, 0.01), Vec3::X * 2.0);
            let rays = [ray, Ray { o: Vec3::new(90.0, 0.01, 0.01), ..ray }];
            let mut hits = [None; 2];
            accel.intersect_wave(&rays, &mut hits, Coherence::Incoherent);
            for (i, hit) in hits.into_iter().enumerate() {
                let hit = hit.expect("the far side");
                assert_eq!((hit.geometry, hit.instance), (i as u32, i as u32), "{}", accel.name());
                assert!((hit.t - 6.0).abs() < 0.01, "{}: {hit:?}", accel.name());
            }
            assert_eq!(accel.intersect(&ray), hits[0]);
            assert!(
                !accel.occluded(&Ray { t_max: 5.5, ..ray }) && accel.occluded(&Ray { t_max: 6.5, ..ray })
            );
        }
    }
}

#[test]
fn a_panic_of_a_filter_reaches_the_caller() {
    struct Trap;
    impl HitFilter for Trap {
        fn accepts(&self, _: u32, _: &Ray, _: &Hit) -> bool {
            panic!("the trap is shut")
        }
    }
    for marked in [1, 2, 5, 8] {
        let scene = filtered(scene(resting()), Trap, |i| i == marked);
        let rays = rays(&scene, 6);
        for &kind in AccelKind::ALL {
            let accel = build(kind, scene.assembly.clone(), 1, true).expect("built").accel;
            let (mut hits, mut occluded) = (vec![None; rays.len()], vec![false; rays.len()]);
            let caught = |f: &mut dyn FnMut()| {
                let payload = catch_unwind(AssertUnwindSafe(f)).expect_err("the panic arrives");
                assert_eq!(payload.downcast_ref::<&str>(), Some(&"the trap is shut"), "{kind}");
            };
            caught(&mut || accel.intersect_wave(&rays, &mut hits, Coherence::Incoherent));
            caught(&mut || accel.occluded_wave(&rays, &mut occluded, Coherence::Incoherent));
            caught(&mut || {
                assert!(rays.iter().all(|ray| accel.intersect(ray).is_none_or(|hit| hit.t > 0.0)))
            });
            caught(&mut || assert!(rays.iter().all(|ray| usize::from(accel.occluded(ray)) < 2)));
        }
    }
}

/// The inverse of a small instance moves a distant ray out of the range of a traversal.
#[test]
fn rays_from_beyond_an_instances_reach_and_odd_times_hit_nothing() {
    let small = placed([1e-6; 3], DVec3::Z, 0.3, [0.0; 3]);
    let scene = scene(vec![Instance::new(1, &[small]), Instance::new(0, &[small, small])]);
    let near = Ray::new(Vec3::new(0.0, 0.0, 5.0), -Vec3::Z);
    let odd = [
        Ray::new(Vec3::new(0.0, 0.0, 1e18), -Vec3::Z),
        Ray::new(Vec3::new(0.0, 0.0, 1.0), Vec3::splat(-1e18)),
        Ray { time: -0.1, ..near },
        Ray { time: 1.1, ..near },
        Ray { time: f32::NAN, ..near },
    ];
    for &kind in AccelKind::ALL {
        let accel = build(kind, scene.assembly.clone(), 1, true).expect("built").accel;
        for ray in odd {
            assert_eq!((accel.intersect(&ray), accel.occluded(&ray)), (None, false), "{kind}: {ray:?}");
            let mut hits = [None; 20];
            accel.intersect_wave(&[ray; 20], &mut hits, Coherence::Incoherent);
            assert_eq!(hits, [None; 20]);
        }
        // A direction that is zero, or almost zero, in the coordinates of the group.
        for length in [1e-30, 1e-38, 1e-44] {
            let _ = accel.intersect(&Ray { d: -Vec3::Z * length, ..near });
        }
        assert!(accel.intersect(&near).is_some());
    }
}
