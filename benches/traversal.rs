//! Mray/s of every traversal on the same rays: `cargo bench --bench traversal [-- FILTER]`.
//!
//! Handicaps:
//! * Rays come from 2 threads, each with its own waves. The time of a wave is its shortest over the passes. The
//!   machine's ISA and Embree's packet width are printed.
//! * "robust no" is Embree without watertight edges, which is never used for rendering.
//! * "obvhs' own" is obvhs' CWBVH with its own node test and its own precomputed triangles: single rays, SSE (four
//!   boxes at a time), not watertight, without barycentric coordinates. It is built with the same settings as "bvh",
//!   which traverses the same nodes conservatively with a watertight triangle test.
//! * Neither BVH has packets. Coherent rays are faster there only because of the processor's cache.

use buffon::accel::{Accel, AccelKind, Coherence, Geometry, Hit, build};
use buffon::math::{Ray, Vec3};
use obvhs::BvhBuildParams;
use obvhs::cwbvh::{CwBvh, builder::build_cwbvh_from_tris};
use obvhs::ray::{Ray as ObvhsRay, RayHit};
use obvhs::rt_triangle::RtCompressedTriangle;
use obvhs::triangle::Triangle;
use std::sync::Arc;
use std::time::{Duration, Instant};

const THREADS: usize = 2;
/// Number of rays of a wave, as in the renderer.
const WAVE: usize = 4096;
/// Number of waves of each thread in a pass.
const WAVES: usize = 16;
/// Minimum time of the measurement of a row.
const LEAST_TIME: Duration = Duration::from_millis(600);

/// A mesh to trace.
struct Mesh {
    name: String,
    positions: Vec<Vec3>,
    indices: Vec<[u32; 3]>,
    eye: Vec3,
}

/// A SplitMix64 generator of floats in [0, 1).
struct Random(u64);

impl Random {
    fn unit(&mut self) -> f32 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 40) as f32 / (1u64 << 24) as f32
    }

    fn direction(&mut self) -> Vec3 {
        let z = 1.0 - 2.0 * self.unit();
        let (sin, cos) = (std::f32::consts::TAU * self.unit()).sin_cos();
        let r = (1.0 - z * z).max(0.0).sqrt();
        Vec3::new(r * cos, r * sin, z)
    }
}

/// Adds faces of a box, rotated about y by `angle`, with two triangles each.
fn push_box(mesh: &mut Mesh, center: Vec3, half: Vec3, angle: f32, faces: &[usize]) {
    const FACES: [[u32; 4]; 6] =
        [[0, 2, 6, 4], [1, 5, 7, 3], [0, 4, 5, 1], [2, 3, 7, 6], [0, 1, 3, 2], [4, 6, 7, 5]];
    let base = mesh.positions.len() as u32;
    for i in 0..8u32 {
        let sign = |bit: u32| if i & bit == 0 { -1.0 } else { 1.0 };
        let p = Vec3::new(sign(1), sign(2), sign(4)) * half;
        let (sin, cos) = angle.sin_cos();
        mesh.positions.push(center + Vec3::new(cos * p.x + sin * p.z, p.y, cos * p.z - sin * p.x));
    }
    for f in faces {
        let q = FACES[*f].map(|i| i + base);
        mesh.indices.extend([[q[0], q[1], q[2]], [q[0], q[2], q[3]]]);
    }
}

/// Returns five walls, an emitter and two blocks: 36 triangles.
fn cornell() -> Mesh {
    let eye = Vec3::new(0.0, 0.0, 3.5);
    let mut mesh = Mesh { name: String::new(), positions: Vec::new(), indices: Vec::new(), eye };
    push_box(&mut mesh, Vec3::ZERO, Vec3::ONE, 0.0, &[0, 1, 2, 3, 4]);
    push_box(&mut mesh, Vec3::new(0.0, 0.99, 0.0), Vec3::new(0.25, 0.0, 0.2), 0.0, &[2]);
    push_box(&mut mesh, Vec3::new(-0.35, -0.4, -0.3), Vec3::new(0.3, 0.6, 0.3), 0.3, &[0, 1, 2, 3, 4, 5]);
    push_box(&mut mesh, Vec3::new(0.35, -0.7, 0.3), Vec3::new(0.3, 0.3, 0.3), -0.3, &[0, 1, 2, 3, 4, 5]);
    mesh
}

/// Returns a sphere with bumps: 2·n² triangles.
fn bumpy_sphere(n: u32) -> Mesh {
    let mut positions = Vec::new();
    for i in 0..=n {
        for j in 0..=n {
            let (theta, phi) = (i as f32 / n as f32, j as f32 / n as f32);
            let (theta, phi) = (std::f32::consts::PI * theta, std::f32::consts::TAU * phi);
            let r = 1.0
                + 0.1 * (13.0 * theta).sin() * (17.0 * phi).sin()
                + 0.02 * (97.0 * theta + 89.0 * phi).sin();
            positions.push(Vec3::new(theta.sin() * phi.cos(), theta.cos(), theta.sin() * phi.sin()) * r);
        }
    }
    let at = |i: u32, j: u32| i * (n + 1) + j;
    let cells = (0..n * n).map(|c| (c / n, c % n));
    let indices = cells.flat_map(|(i, j)| {
        [[at(i, j), at(i + 1, j), at(i, j + 1)], [at(i, j + 1), at(i + 1, j), at(i + 1, j + 1)]]
    });
    Mesh { name: String::new(), positions, indices: indices.collect(), eye: Vec3::new(0.0, 0.4, 3.0) }
}

/// Returns camera rays in tiles of 4 × 4, or rays from surface points in all directions.
fn rays(mesh: &Mesh, accel: &dyn Accel, coherence: Coherence, count: usize) -> Vec<Ray> {
    let mut random = Random(7);
    let side = (count as f32).sqrt() as usize / 4 * 4;
    let camera = |x: f32, y: f32| Ray::new(mesh.eye, Vec3::new(x * 0.7, y * 0.7, -mesh.eye.z).normalize());
    let mut result = Vec::with_capacity(count);
    while result.len() < count {
        let i = result.len();
        if coherence == Coherence::Coherent {
            let (tile, lane) = (i / 16, i % 16);
            let (x, y) = (tile % (side / 4) * 4 + lane % 4, tile / (side / 4) % (side / 4) * 4 + lane / 4);
            let place = |k: usize| 2.0 * (k as f32 + 0.5) / side as f32 - 1.0;
            result.push(camera(place(x), place(y)));
        } else {
            let ray = camera(2.0 * random.unit() - 1.0, 2.0 * random.unit() - 1.0);
            if let Some(hit) = accel.intersect(&ray) {
                let d = random.direction();
                result.push(Ray::new(ray.at(hit.t * 0.999), if d.dot(ray.d) > 0.0 { -d } else { d }));
            }
        }
    }
    result
}

/// Returns the Mray/s of `f`, called by every thread for its own waves. The time of a wave is its shortest over the
/// passes, which excludes other activity of the machine.
fn measure(rays: &[Ray], f: impl Fn(&[Ray], &mut Vec<Option<Hit>>, &mut Vec<bool>) + Sync) -> f64 {
    let run = |share: &[Ray]| {
        let (mut hits, mut occluded) = (vec![None; WAVE], vec![false; WAVE]);
        let mut shortest = [f64::INFINITY; WAVES];
        let start = Instant::now();
        let mut passes = 0;
        while passes < 5 || start.elapsed() < LEAST_TIME {
            for (wave, shortest) in share.chunks_exact(WAVE).zip(&mut shortest) {
                let start = Instant::now();
                f(wave, &mut hits, &mut occluded);
                *shortest = shortest.min(start.elapsed().as_secs_f64());
            }
            passes += 1;
        }
        share.len() as f64 / shortest.iter().sum::<f64>()
    };
    std::thread::scope(|scope| {
        let shares = rays.chunks_exact(WAVE * WAVES);
        let threads: Vec<_> = shares.map(|share| scope.spawn(|| run(share))).collect();
        threads.into_iter().map(|t| t.join().expect("no panic")).sum::<f64>() * 1e-6
    })
}

/// Prints the rows of one traversal: single rays and, if `waves`, waves.
fn rows(label: &str, accel: &dyn Accel, sets: &[(Coherence, Vec<Ray>)], waves: bool) {
    for mode in if waves { &["single", "wave"][..] } else { &["single"] } {
        let mut figures = Vec::new();
        for (coherence, rays) in sets {
            let wave = *mode == "wave";
            figures.push(measure(rays, |rays, hits, _| match wave {
                true => accel.intersect_wave(rays, hits, *coherence),
                false => rays.iter().zip(hits).for_each(|(r, h)| *h = accel.intersect(r)),
            }));
            figures.push(measure(rays, |rays, _, occluded| match wave {
                true => accel.occluded_wave(rays, occluded, *coherence),
                false => rays.iter().zip(occluded).for_each(|(r, o)| *o = accel.occluded(r)),
            }));
        }
        print_row(label, mode, &figures);
    }
}

fn print_row(label: &str, mode: &str, f: &[f64]) {
    println!("  {label:<22} {mode:<7} {:>9.1} {:>9.1} {:>9.1} {:>9.1}", f[0], f[1], f[2], f[3]);
}

/// Prints the rows of obvhs' own traversal with its own triangles.
fn obvhs_rows(mesh: &Mesh, sets: &[(Coherence, Vec<Ray>)]) {
    let triangle = |t: &[u32; 3]| {
        let [v0, v1, v2] = t.map(|i| mesh.positions[i as usize].into());
        Triangle { v0, v1, v2 }
    };
    let triangles: Vec<Triangle> = mesh.indices.iter().map(triangle).collect();
    let start = Instant::now();
    let bvh: CwBvh =
        build_cwbvh_from_tris(&triangles, BvhBuildParams::medium_build(), &mut Duration::default());
    let seconds = start.elapsed().as_secs_f64();
    let ordered: Vec<RtCompressedTriangle> =
        bvh.primitive_indices.iter().map(|&i| (&triangles[i as usize]).into()).collect();
    let bytes =
        size_of_val(&bvh.nodes[..]) + size_of_val(&ordered[..]) + size_of_val(&bvh.primitive_indices[..]);
    print_build("obvhs' own", seconds, bytes, mesh.indices.len());
    let query = |ray: &Ray| ObvhsRay::new(ray.o.into(), ray.d.into(), 0.0, ray.t_max);
    let mut figures = Vec::new();
    for (_, rays) in sets {
        figures.push(measure(rays, |rays, hits, _| {
            for (ray, hit) in rays.iter().zip(hits) {
                let mut found = RayHit::none();
                let any = bvh.ray_traverse(query(ray), &mut found, |ray, i| ordered[i].intersect(ray));
                let primitive = found.primitive_id;
                *hit = any.then_some(Hit { t: found.t, u: 0.0, v: 0.0, geometry: 0, primitive, instance: 0 });
            }
        }));
        figures.push(measure(rays, |rays, _, occluded| {
            for (ray, occluded) in rays.iter().zip(occluded) {
                *occluded = !bvh.ray_traverse_miss(query(ray), |ray, i| ordered[i].intersect(ray));
            }
        }));
    }
    print_row("obvhs' own", "single", &figures);
}

fn print_build(label: &str, seconds: f64, bytes: usize, triangles: usize) {
    println!(
        "  {label:<22} built in {seconds:>6.3} s, {:>6.1} bytes a triangle",
        bytes as f64 / triangles as f64
    );
}

fn bench(mesh: Mesh) {
    println!("\n{}: {} triangles; Mray/s from {THREADS} threads", mesh.name, mesh.indices.len());
    println!("  {:<30} {:>19} {:>19}", "", "coherent", "incoherent");
    println!("  {:<30} {:>9} {:>9} {:>9} {:>9}", "", "intersect", "occluded", "intersect", "occluded");
    let (positions, indices) = (Arc::new(mesh.positions.clone().into()), Arc::new(mesh.indices.clone()));
    let geometry =
        || vec![Geometry::Triangles { positions: Arc::clone(&positions), indices: Arc::clone(&indices) }];
    let mut sets = Vec::new();
    for &kind in AccelKind::CHOICES.iter().rev() {
        let in_rust = matches!(kind, AccelKind::Auto | AccelKind::Obvhs);
        let robustness: &[bool] = if in_rust { &[true] } else { &[true, false] };
        for &robust in robustness {
            let start = Instant::now();
            let accel = build(kind, geometry(), THREADS, robust).expect("built").accel;
            let seconds = start.elapsed().as_secs_f64();
            if kind == AccelKind::Auto && accel.name() != "list" {
                continue;
            }
            if sets.is_empty() {
                let count = THREADS * WAVE * WAVES;
                sets = [Coherence::Coherent, Coherence::Incoherent]
                    .map(|coherence| (coherence, rays(&mesh, &*accel, coherence, count)))
                    .to_vec();
            }
            let label = match (kind, robust) {
                (AccelKind::Auto, _) => "list".to_string(),
                (AccelKind::Obvhs, _) => "bvh".to_string(),
                #[cfg(feature = "embree")]
                (AccelKind::Embree, true) => format!("{kind}, robust"),
                #[cfg(feature = "embree")]
                (AccelKind::Embree, false) => format!("{kind}, robust no"),
            };
            print_build(&label, seconds, accel.memory_bytes(), mesh.indices.len());
            rows(&label, &*accel, &sets, kind != AccelKind::Obvhs);
        }
    }
    obvhs_rows(&mesh, &sets);
}

fn print_machine() {
    #[cfg(target_arch = "x86_64")]
    {
        let has = |name, there| if there { name } else { "" };
        let avx512 = has(" AVX-512", is_x86_feature_detected!("avx512f"));
        println!("CPU:{}{avx512}", has(" AVX2", is_x86_feature_detected!("avx2")));
        println!("Buffon's code: {}", if cfg!(target_feature = "avx2") { "x86-64-v3" } else { "baseline" });
    }
    #[cfg(feature = "embree")]
    {
        let device = buffon::embree::Device::new(Default::default()).expect("a device");
        let native = if device.has_native_packets16() { "16" } else { "less than 16" };
        println!("Embree {}: {native} wide", buffon::embree::version());
    }
}

fn main() {
    let filter: Vec<String> = std::env::args().skip(1).filter(|a| !a.starts_with('-')).collect();
    print_machine();
    let meshes = [("box", cornell()), ("sphere 100k", bumpy_sphere(224)), ("sphere 1M", bumpy_sphere(720))];
    for (name, mesh) in meshes {
        if filter.is_empty() || filter.iter().any(|f| name.contains(f.as_str())) {
            bench(Mesh { name: name.to_string(), ..mesh });
        }
    }
}
