//! The safe wrapper of Embree: layouts, padding, panics in callbacks, order of drops.

use buffon::embree::{
    CandidateHit, Coherence, CommittedScene, Device, DeviceOptions, INVALID_ID, Isa, Mask16, RayHit1,
    RayHits16, Rays16, SceneBuilder, SceneOptions, TriangleFilter, UserHit, UserPrimitives, UserRay, WIDTH,
};
use buffon::memory::{Budget, Limit};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;

/// A ray from (0.25, 0.25, 1) in the direction −z.
const DOWN: [f32; 8] = [0.25, 0.25, 1.0, f32::INFINITY, 0.0, 0.0, -1.0, 0.0];

fn device() -> Device {
    Device::new(DeviceOptions::default()).expect("a device")
}

/// Returns a device for each instruction set. Embree has separate code and a packet width for each.
fn devices() -> impl Iterator<Item = Device> {
    let options = |isa| DeviceOptions { threads: 2, max_isa: Some(isa) };
    Isa::ALL.into_iter().map(move |isa| Device::new(options(isa)).expect("a device"))
}

/// Returns whether two numbers are equal, up to the different reciprocals of different CPUs.
fn near(found: f32, expected: f32) -> bool {
    found == expected || (found - expected).abs() < 1e-6 * expected.abs()
}

/// Returns the vertices of one triangle in the plane z = 0, with padding.
fn vertices() -> Arc<Vec<[f32; 3]>> {
    Arc::new(vec![[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0; 3]])
}

fn triangle_scene(device: &Device) -> CommittedScene {
    let mut builder = SceneBuilder::new(device, SceneOptions::default()).expect("a scene");
    builder.add_triangles(7, vertices(), 3, Arc::new(vec![[0, 1, 2]]), None).expect("added");
    builder.commit().expect("built")
}

/// The plane z = 0 as user geometry. It panics for rays with x ≥ 0.5.
struct Trap;

impl UserPrimitives for Trap {
    fn count(&self) -> u32 {
        1
    }

    fn bounds(&self, _: u32) -> ([f32; 3], [f32; 3]) {
        ([-1.0, -1.0, -0.1], [1.0, 1.0, 0.1])
    }

    fn intersect(&self, _: u32, ray: &UserRay) -> Option<UserHit> {
        assert!(ray.origin[0] < 0.5, "the trap is shut");
        let t = -ray.origin[2] / ray.direction[2];
        (t > ray.t_near && t < ray.t_far).then_some(UserHit { t, u: 0.25, v: 0.75, primitive: 0 })
    }
}

fn trap_scene(device: &Device) -> CommittedScene {
    let mut builder = SceneBuilder::new(device, SceneOptions::default()).expect("a scene");
    builder.add_user(3, Arc::new(Trap)).expect("added");
    builder.commit().expect("built")
}

#[test]
fn single_rays_and_packets_report_the_same_hit() {
    for device in devices() {
        let scene = triangle_scene(&device);
        let mut single = RayHit1::new(&DOWN);
        scene.intersect1(&mut single, Coherence::Incoherent);
        assert_eq!((single.geometry, single.primitive, single.instance), (7, 0, INVALID_ID));
        assert!(near(single.t_far, 1.0) && near(single.u, 0.25) && near(single.v, 0.25), "{single:?}");
        assert!(scene.occluded1(&mut RayHit1::new(&DOWN), Coherence::Coherent));

        let mut packet = RayHits16::default();
        let mut rays = [DOWN; WIDTH];
        rays[4][0] = 5.0;
        packet.rays.load(&rays);
        assert_eq!(scene.intersect16(&Mask16::ALL, &mut packet, Coherence::Coherent), Mask16::ALL);
        for i in 0..WIDTH {
            let (geometry, t) = if i == 4 { (INVALID_ID, f32::INFINITY) } else { (7, 1.0) };
            assert_eq!(packet.geometry[i], geometry);
            assert!(near(packet.rays.t_far[i], t), "{}", packet.rays.t_far[i]);
        }
    }
}

#[test]
fn masked_rays_are_left_alone() {
    for device in devices() {
        let scene = triangle_scene(&device);
        let mut packet = RayHits16::default();
        packet.rays.load(&[DOWN; WIDTH]);
        scene.intersect16(&Mask16::from_fn(|i| i % 2 == 0), &mut packet, Coherence::Incoherent);
        let hit: Vec<bool> = packet.geometry.iter().map(|&g| g != INVALID_ID).collect();
        assert_eq!(hit, (0..WIDTH).map(|i| i % 2 == 0).collect::<Vec<_>>());
        let mut rays = Rays16::default();
        rays.load(&[DOWN; WIDTH]);
        scene.occluded16(&Mask16::from_fn(|i| i < 3), &mut rays, Coherence::Incoherent);
        assert_eq!(rays.t_far.iter().filter(|&&t| t == f32::NEG_INFINITY).count(), 3);
    }
}

#[test]
fn invalid_rays_do_no_harm_and_hit_nothing() {
    for device in devices() {
        let scene = triangle_scene(&device);
        for (k, value) in (0..7).flat_map(|k| [(k, f32::NAN), (k, f32::NEG_INFINITY), (k, -1e30)]) {
            let mut ray = DOWN;
            ray[k] = value;
            let mut single = RayHit1::new(&ray);
            scene.intersect1(&mut single, Coherence::Incoherent);
            assert_eq!(single.geometry, INVALID_ID, "{ray:?}");
            assert!(!scene.occluded1(&mut RayHit1::new(&ray), Coherence::Incoherent));
            let mut packet = RayHits16::default();
            packet.rays.load(&[ray; WIDTH]);
            let traced = scene.intersect16(&Mask16::ALL, &mut packet, Coherence::Incoherent);
            assert_eq!(
                (traced, packet.geometry),
                (Mask16::from_fn(|_| false), [INVALID_ID; WIDTH]),
                "{ray:?}"
            );
        }
    }
}

#[test]
fn vertices_with_nan_are_left_out() {
    let mut builder = SceneBuilder::new(&device(), SceneOptions::default()).expect("a scene");
    let mut with_nan = Vec::clone(&vertices());
    with_nan.insert(3, [f32::NAN; 3]);
    builder
        .add_triangles(0, Arc::new(with_nan), 4, Arc::new(vec![[0, 1, 3], [0, 1, 2]]), None)
        .expect("added");
    let scene = builder.commit().expect("built");
    let mut ray = RayHit1::new(&DOWN);
    scene.intersect1(&mut ray, Coherence::Incoherent);
    assert_eq!((ray.geometry, ray.primitive), (0, 1));
    assert_eq!(scene.bounds(), ([0.0; 3], [1.0, 1.0, 0.0]));
}

#[test]
fn missing_padding_and_wild_indices_are_refused() {
    let mut builder = SceneBuilder::new(&device(), SceneOptions::default()).expect("a scene");
    let error = builder.add_triangles(0, vertices(), 4, Arc::new(vec![[0, 1, 2]]), None).unwrap_err();
    assert_eq!(error.to_string(), "Embree: expected padding after 4 vertices, found 4 elements");
    let error = builder.add_triangles(0, vertices(), 3, Arc::new(vec![[0, 1, 3]]), None).unwrap_err();
    assert_eq!(error.to_string(), "Embree: expected indices below 3, found 3");
}

#[test]
fn an_id_used_twice_is_an_error_with_embrees_words() {
    let mut builder = SceneBuilder::new(&device(), SceneOptions::default()).expect("a scene");
    let mut add = || builder.add_triangles(0, vertices(), 3, Arc::new(vec![[0, 1, 2]]), None);
    add().expect("once");
    let error = add().unwrap_err().to_string();
    assert!(error.starts_with("Embree: adding a geometry: invalid"), "{error}");
}

#[test]
fn a_panic_in_a_callback_goes_on_after_the_query() {
    let scene = trap_scene(&device());
    let caught = |f: &mut dyn FnMut()| {
        let payload = catch_unwind(AssertUnwindSafe(f)).expect_err("the panic arrives");
        payload.downcast_ref::<&str>().map(|s| s.to_string()).unwrap_or_default()
    };
    let mut beyond = DOWN;
    beyond[0] = 0.75;
    let single = caught(&mut || scene.intersect1(&mut RayHit1::new(&beyond), Coherence::Incoherent));
    assert_eq!(single, "the trap is shut");
    let occluded =
        caught(&mut || assert!(!scene.occluded1(&mut RayHit1::new(&beyond), Coherence::Incoherent)));
    assert_eq!(occluded, "the trap is shut");
    let mut rays = [DOWN; WIDTH];
    rays[9] = beyond;
    let mut packet = RayHits16::default();
    packet.rays.load(&rays);
    let mut trace = || _ = scene.intersect16(&Mask16::ALL, &mut packet, Coherence::Incoherent);
    assert_eq!(caught(&mut trace), "the trap is shut");
    let mut packet = Rays16::default();
    packet.load(&rays);
    let mut trace = || _ = scene.occluded16(&Mask16::ALL, &mut packet, Coherence::Coherent);
    assert_eq!(caught(&mut trace), "the trap is shut");
    // The scene can still be used.
    let mut ray = RayHit1::new(&DOWN);
    scene.intersect1(&mut ray, Coherence::Incoherent);
    assert_eq!((ray.geometry, ray.t_far, ray.u, ray.v), (3, 1.0, 0.25, 0.75));
}

#[test]
fn a_panic_while_bounding_passes_through_the_builder() {
    struct Boundless;
    impl UserPrimitives for Boundless {
        fn count(&self) -> u32 {
            1
        }
        fn bounds(&self, _: u32) -> ([f32; 3], [f32; 3]) {
            panic!("no bounds")
        }
        fn intersect(&self, _: u32, _: &UserRay) -> Option<UserHit> {
            None
        }
    }
    let mut builder = SceneBuilder::new(&device(), SceneOptions::default()).expect("a scene");
    assert!(catch_unwind(AssertUnwindSafe(|| builder.add_user(0, Arc::new(Boundless)))).is_err());
    assert!(builder.commit().is_ok());
}

#[test]
fn handles_may_be_dropped_in_any_order() {
    let device = device();
    let unfinished = SceneBuilder::new(&device, SceneOptions::default()).expect("a scene");
    let scene = triangle_scene(&device);
    let other = trap_scene(&device);
    drop(device);
    drop(unfinished);
    let mut ray = RayHit1::new(&DOWN);
    scene.intersect1(&mut ray, Coherence::Incoherent);
    assert_eq!(ray.geometry, 7);
    drop(scene);
    drop(other);
}

#[test]
fn shared_arrays_live_as_long_as_the_scene_and_no_longer() {
    let (vertices, indices) = (vertices(), Arc::new(vec![[0, 1, 2]]));
    let mut builder = SceneBuilder::new(&device(), SceneOptions::default()).expect("a scene");
    builder.add_triangles(0, Arc::clone(&vertices), 3, Arc::clone(&indices), None).expect("added");
    let scene = builder.commit().expect("built");
    assert_eq!((Arc::strong_count(&vertices), Arc::strong_count(&indices)), (2, 2));
    drop(scene);
    assert_eq!((Arc::strong_count(&vertices), Arc::strong_count(&indices)), (1, 1));
}

#[test]
fn a_scene_is_asked_from_many_threads() {
    let scene = triangle_scene(&device());
    std::thread::scope(|s| {
        for _ in 0..4 {
            s.spawn(|| {
                for _ in 0..1000 {
                    let mut ray = RayHit1::new(&DOWN);
                    scene.intersect1(&mut ray, Coherence::Incoherent);
                    assert_eq!(ray.geometry, 7);
                }
            });
        }
    });
}

#[test]
fn the_memory_monitor_counts_what_a_scene_takes_and_gives_back() {
    let device = device();
    let before = device.memory_bytes();
    let n = 100u32;
    let grid: Vec<[f32; 3]> = (0..=n * n).map(|i| [(i % n) as f32, (i / n) as f32, 0.0]).collect();
    let indices: Vec<[u32; 3]> = (0..n * (n - 1) - 1).map(|i| [i, i + 1, i + n]).collect();
    let mut builder = SceneBuilder::new(&device, SceneOptions::default()).expect("a scene");
    builder.add_triangles(0, Arc::new(grid), (n * n) as usize, Arc::new(indices), None).expect("added");
    let scene = builder.commit().expect("built");
    assert!(scene.memory_bytes() > before + 100_000, "{} bytes", scene.memory_bytes());
    drop(scene);
    assert!(device.memory_bytes() < before + 100_000);
}

/// A matrix that scales by 2 and then moves by 3 along x.
const TWICE: [f32; 12] = [2.0, 0.0, 0.0, 0.0, 2.0, 0.0, 0.0, 0.0, 2.0, 3.0, 0.0, 0.0];

/// A square in the plane z = 0 as user geometry.
struct Patch;

impl UserPrimitives for Patch {
    fn count(&self) -> u32 {
        1
    }

    fn bounds(&self, _: u32) -> ([f32; 3], [f32; 3]) {
        ([-1.0, -1.0, -0.1], [1.0, 1.0, 0.1])
    }

    fn intersect(&self, _: u32, ray: &UserRay) -> Option<UserHit> {
        let t = -ray.origin[2] / ray.direction[2];
        let at = |axis: usize| ray.origin[axis] + t * ray.direction[axis];
        let inside = at(0).abs() < 1.0 && at(1).abs() < 1.0 && t > ray.t_near && t < ray.t_far;
        assert!(!inside || ray.instance == 21);
        inside.then_some(UserHit { t, u: at(0), v: at(1), primitive: 5 })
    }
}

fn patch_scene(device: &Device) -> CommittedScene {
    let mut builder = SceneBuilder::new(device, SceneOptions::default()).expect("a scene");
    builder.add_user(3, Arc::new(Patch)).expect("added");
    builder.commit().expect("built")
}

/// Returns instances 20 and 21. Only they own their scenes.
fn instance_scene(device: &Device) -> CommittedScene {
    let mut builder = SceneBuilder::new(device, SceneOptions::default()).expect("a scene");
    let moved = [TWICE, TWICE].map(|m| m.map(|x| if x == 3.0 { -3.0 } else { x }));
    builder.add_instance(20, Arc::new(triangle_scene(device)), &[TWICE]).expect("added");
    builder.add_instance(21, Arc::new(patch_scene(device)), &moved).expect("added");
    builder.commit().expect("built")
}

#[test]
fn instances_report_themselves_singly_and_in_packets() {
    for device in devices() {
        let scene = instance_scene(&device);
        // Both are hit at (0.25, 0.25, 0) of their scene, from a height of 1 in units of the world direction.
        let above = |x: f32| [x + 0.5, 0.5, 1.0, f32::INFINITY, 0.0, 0.0, -0.5, 0.25];
        let rays: [_; WIDTH] = std::array::from_fn(|i| above([3.0, -3.0, 40.0][i % 3]));
        let expected = [(7, 20, 2.0, 0.25), (3, 21, 2.0, 0.25), (INVALID_ID, INVALID_ID, f32::INFINITY, 0.0)];
        let mut packet = RayHits16::default();
        packet.rays.load(&rays);
        for coherence in [Coherence::Incoherent, Coherence::Coherent] {
            packet.clear_hits();
            packet.rays.load(&rays);
            scene.intersect16(&Mask16::ALL, &mut packet, coherence);
            for (i, ray) in rays.iter().enumerate() {
                let (geometry, instance, t, u) = expected[i % 3];
                assert_eq!((packet.geometry[i], packet.instance[i]), (geometry, instance));
                assert!(near(packet.rays.t_far[i], t) && near(packet.u[i], u), "{packet:?}");
                let mut single = RayHit1::new(ray);
                scene.intersect1(&mut single, coherence);
                assert_eq!((single.geometry, single.instance), (geometry, instance));
                assert!(near(single.t_far, t) && near(single.u, u), "{single:?}");
                assert_eq!(scene.occluded1(&mut RayHit1::new(ray), coherence), i % 3 != 2);
            }
        }
    }
}

#[test]
fn the_scene_of_an_instance_lives_as_long_as_the_instance() {
    let device = device();
    let vertices = vertices();
    let mut group = SceneBuilder::new(&device, SceneOptions::default()).expect("a scene");
    group.add_triangles(7, Arc::clone(&vertices), 3, Arc::new(vec![[0, 1, 2]]), None).expect("added");
    let group = Arc::new(group.commit().expect("built"));
    let mut builder = SceneBuilder::new(&device, SceneOptions::default()).expect("a scene");
    builder.add_instance(0, Arc::clone(&group), &[TWICE]).expect("added");
    drop(device);
    drop(group);
    let scene = builder.commit().expect("built");
    let mut ray = RayHit1::new(&[3.5, 0.5, 1.0, f32::INFINITY, 0.0, 0.0, -1.0, 0.0]);
    scene.intersect1(&mut ray, Coherence::Incoherent);
    assert_eq!((ray.geometry, ray.instance), (7, 0));
    assert_eq!(Arc::strong_count(&vertices), 2);
    drop(scene);
    assert_eq!(Arc::strong_count(&vertices), 1);
}

#[test]
fn instances_of_another_device_and_without_numbers_are_refused() {
    let device = device();
    let mut builder = SceneBuilder::new(&device, SceneOptions::default()).expect("a scene");
    let other = Arc::new(triangle_scene(&Device::new(DeviceOptions::default()).expect("a device")));
    let error = builder.add_instance(0, other, &[TWICE]).unwrap_err();
    assert_eq!(error.to_string(), "Embree: expected a scene of the same device");
    let group = Arc::new(triangle_scene(&device));
    let error = builder.add_instance(0, Arc::clone(&group), &[TWICE, [f32::NAN; 12]]).unwrap_err();
    assert!(error.to_string().starts_with("Embree: expected a finite transform"), "{error}");
    for wrong in [0, 130] {
        let error = builder.add_instance(0, Arc::clone(&group), &vec![TWICE; wrong]).unwrap_err();
        assert_eq!(error.to_string(), format!("Embree: expected 1 to 129 transforms, found {wrong}"));
    }
    builder.add_instance(0, group, &[TWICE; 129]).expect("added");
}

/// Accepts the hits of rays with an even number. Panics for the number 99.
struct Even;

impl TriangleFilter for Even {
    fn accepts(&self, ray: &UserRay, hit: &CandidateHit) -> bool {
        assert!(ray.id != 99, "the filter is shut");
        assert_eq!((ray.instance, hit.primitive, ray.origin), (20, 0, [0.25, 0.25, 0.5]));
        assert!(near(hit.u, 0.25) && near(hit.t, 1.0), "{hit:?}");
        ray.id.is_multiple_of(2)
    }
}

#[test]
fn a_filter_sees_the_ray_in_its_instance_and_its_panic_goes_on_after_the_query() {
    for device in devices() {
        let mut group = SceneBuilder::new(&device, SceneOptions::default()).expect("a scene");
        group
            .add_triangles(7, vertices(), 3, Arc::new(vec![[0, 1, 2]]), Some(Arc::new(Even)))
            .expect("added");
        let mut builder = SceneBuilder::new(&device, SceneOptions::default()).expect("a scene");
        builder.add_instance(20, Arc::new(group.commit().expect("built")), &[TWICE]).expect("added");
        let scene = builder.commit().expect("built");
        let ray = [3.5, 0.5, 1.0, f32::INFINITY, 0.0, 0.0, -1.0, 0.0];
        let single = |id| {
            let mut single = RayHit1::new(&ray);
            single.id = id;
            single
        };
        let mut packet = RayHits16::default();
        packet.rays.load(&[ray; WIDTH]);
        packet.rays.id = std::array::from_fn(|i| i as u32);
        let packet_of_rays = packet;
        for coherence in [Coherence::Incoherent, Coherence::Coherent] {
            let (mut packet, mut shadows) = (packet_of_rays, packet_of_rays.rays);
            scene.intersect16(&Mask16::ALL, &mut packet, coherence);
            scene.occluded16(&Mask16::ALL, &mut shadows, coherence);
            for i in 0..WIDTH {
                let accepted = i % 2 == 0;
                assert_eq!((packet.geometry[i] == 7, packet.instance[i] == 20), (accepted, accepted));
                assert_eq!(shadows.t_far[i] == f32::NEG_INFINITY, accepted);
                let mut alone = single(i as u32);
                scene.intersect1(&mut alone, coherence);
                assert_eq!(alone.geometry == 7, accepted);
                assert_eq!(scene.occluded1(&mut single(i as u32), coherence), accepted);
            }
        }
        let caught = |f: &mut dyn FnMut()| {
            let payload = catch_unwind(AssertUnwindSafe(f)).expect_err("the panic arrives");
            assert_eq!(payload.downcast_ref::<&str>(), Some(&"the filter is shut"));
        };
        caught(&mut || scene.intersect1(&mut single(99), Coherence::Incoherent));
        caught(&mut || _ = scene.occluded1(&mut single(99), Coherence::Incoherent));
        packet.rays.load(&[ray; WIDTH]);
        packet.rays.id[11] = 99;
        let mut shadows = packet.rays;
        caught(&mut || _ = scene.intersect16(&Mask16::ALL, &mut packet, Coherence::Incoherent));
        caught(&mut || _ = scene.occluded16(&Mask16::ALL, &mut shadows, Coherence::Coherent));
    }
}

/// Builds a grid of `n` × `n` vertices with triangles between them.
fn grid_scene(device: &Device, n: u32) -> Result<CommittedScene, buffon::error::Error> {
    let vertices: Vec<[f32; 3]> = (0..=n * n).map(|i| [(i % n) as f32, (i / n) as f32, 0.0]).collect();
    let indices: Vec<[u32; 3]> = (0..n * (n - 1) - 1).map(|i| [i, i + 1, i + n]).collect();
    let mut builder = SceneBuilder::new(device, SceneOptions::default())?;
    builder.add_triangles(0, Arc::new(vertices), (n * n) as usize, Arc::new(indices), None)?;
    builder.commit()
}

/// A budget that is exhausted at any point of a build gives an error, and all memory is returned.
#[test]
fn a_budget_that_is_too_small_stops_the_build_and_gets_everything_back() {
    let options = || DeviceOptions { threads: 2, ..DeviceOptions::default() };
    let (mut refused, mut built) = (0, 0);
    for kib in [1u64, 100, 200, 400, 800, 1600, 2400, 3200, 4800, 6400, 12_800, 1 << 20] {
        let budget = Budget::open(Limit::Bytes(0));
        let budget = Budget::open(Limit::Bytes(budget.planned() + (64 << 10) + (kib << 10)));
        let before = budget.planned();
        let device = Device::within(options(), budget.clone()).expect("a device");
        match grid_scene(&device, 150) {
            Ok(scene) => {
                built += 1;
                let mut ray = RayHit1::new(&[10.25, 10.25, 1.0, f32::INFINITY, 0.0, 0.0, -1.0, 0.0]);
                scene.intersect1(&mut ray, Coherence::Incoherent);
                assert!(near(ray.t_far, 1.0));
                assert!(budget.planned() >= before + scene.memory_bytes() as u64);
            }
            Err(error) => {
                refused += 1;
                assert_eq!(error.kind, buffon::error::Kind::Scene);
                let text = error.to_string();
                let start = "Embree: one more part of the acceleration structure would take ";
                assert!(
                    text.starts_with(start) && text.contains("(--memory-limit): use fewer triangles"),
                    "{text}"
                );
            }
        }
        drop(device);
        assert_eq!(budget.planned(), before, "{kib} KiB");
    }
    assert!(refused >= 4 && built >= 1, "{refused} refused, {built} built");
}
