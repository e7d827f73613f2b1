//! Counts the rays that escape from a closed mesh although they start inside it and aim at its vertices and edges,
//! through the raw interface: `cargo run --release -p buffon-embree-sys --example vertex_escapes`.
//!
//! Each row is one way to build and query the scene. The last columns take up to 1000 of the escaped rays and test
//! all triangles one by one, without bounding boxes. They count the rays that no triangle intersects with Embree's
//! edge functions rounded to `f32`, and with edge functions computed in `f64`.
//!
//! With Debian's Embree 3.13.5, every way except the non-robust one loses the same rays, all of them at vertices. The
//! rounded edge functions lose all of these rays too; those in `f64` lose none. The cause is therefore the triangle
//! test, not the traversal, the build or the packets. (Instruction sets without fused multiply-add round differently
//! and lose other rays.)

use buffon_embree_sys::*;
use std::f32::consts::{PI, TAU};
use std::ffi::CStr;

const RAYS: usize = 1_000_000;

type V3 = [f32; 3];

struct Mesh {
    /// The array has one element more than the number of vertices passed to Embree, which reads 16 bytes at the last
    /// vertex.
    positions: Vec<V3>,
    indices: Vec<[u32; 3]>,
}

/// Returns the unit sphere around `center` with 32 × 64 quadrilaterals.
fn sphere(center: V3) -> Mesh {
    let (rings, sectors) = (32, 64);
    let mut positions = vec![[0.0, 0.0, 1.0]];
    for r in 1..rings {
        for s in 0..sectors {
            let (theta, phi) = (PI * r as f32 / rings as f32, TAU * s as f32 / sectors as f32);
            positions.push([theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos()]);
        }
    }
    positions.push([0.0, 0.0, -1.0]);
    let last = positions.len() as u32 - 1;
    let at = |r: u32, s: u32| match r {
        0 => 0,
        r if r == rings => last,
        r => 1 + (r - 1) * sectors + s % sectors,
    };
    let mut indices = Vec::new();
    for (r, s) in (0..rings).flat_map(|r| (0..sectors).map(move |s| (r, s))) {
        if r > 0 {
            indices.push([at(r, s), at(r + 1, s), at(r, s + 1)]);
        }
        if r + 1 < rings {
            indices.push([at(r, s + 1), at(r + 1, s), at(r + 1, s + 1)]);
        }
    }
    positions.push([0.0; 3]);
    positions.iter_mut().for_each(|p| *p = [p[0] + center[0], p[1] + center[1], p[2] + center[2]]);
    Mesh { positions, indices }
}

/// A SplitMix64 generator.
struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    fn unit(&mut self) -> f32 {
        (self.next() >> 40) as f32 / (1u64 << 24) as f32
    }
}

#[derive(Clone, Copy)]
struct Aim {
    o: V3,
    d: V3,
    vertex: bool,
}

/// Returns rays from a box inside the sphere. One third aim at a vertex, the others at a point on an edge.
fn rays(mesh: &Mesh, center: V3) -> Vec<Aim> {
    let mut random = Random(1);
    let aim = |_| {
        let triangle = mesh.indices[(random.next() % mesh.indices.len() as u64) as usize];
        let k = (random.next() % 3) as usize;
        let [p, q] = [triangle[k], triangle[(k + 1) % 3]].map(|i| mesh.positions[i as usize]);
        let vertex = random.next().is_multiple_of(3);
        let s = if vertex { 0.0 } else { random.unit() };
        let o = center.map(|c| c + random.unit() - 0.5);
        Aim { o, d: std::array::from_fn(|i| p[i] + s * (q[i] - p[i]) - o[i]), vertex }
    };
    (0..RAYS).map(aim).collect()
}

#[derive(Clone, Copy)]
enum Query {
    Intersect1,
    Occluded1,
    Intersect4,
    Intersect8,
    Intersect16,
    Occluded16,
    Intersect16Coherent,
}

#[derive(Clone, Copy)]
struct Setup {
    device: &'static CStr,
    flags: RTCSceneFlags,
    quality: RTCBuildQuality,
}

/// A packet of `N` rays: an `RTCRayHitN` with size and alignment for any width.
#[repr(C, align(64))]
struct Packet<const N: usize> {
    /// Origin x y z, tnear, direction x y z, time, tfar.
    floats: [[f32; N]; 9],
    /// Mask, id, flags.
    ids: [[u32; N]; 3],
    hit: [[f32; N]; 5],
    /// Primitive, geometry, instance.
    hit_ids: [[u32; N]; 3],
}

#[repr(C, align(64))]
struct Mask([i32; 16]);

impl<const N: usize> Packet<N> {
    fn new(rays: &[Aim]) -> Self {
        let column = |f: &dyn Fn(&Aim) -> f32| std::array::from_fn(|i| f(&rays[i.min(rays.len() - 1)]));
        Packet {
            floats: [
                column(&|r| r.o[0]),
                column(&|r| r.o[1]),
                column(&|r| r.o[2]),
                [0.0; N],
                column(&|r| r.d[0]),
                column(&|r| r.d[1]),
                column(&|r| r.d[2]),
                [0.0; N],
                [f32::INFINITY; N],
            ],
            ids: [[!0; N], [0; N], [0; N]],
            hit: [[0.0; N]; 5],
            hit_ids: [[!0; N]; 3],
        }
    }
}

/// Returns which rays escape.
fn escapes(mesh: &Mesh, rays: &[Aim], setup: Setup, query: Query) -> Vec<Aim> {
    let mut escaped = Vec::new();
    let mask = Mask([-1; 16]);
    let coherent = matches!(query, Query::Intersect16Coherent);
    // SAFETY: every handle is live until it is released at the end; the arrays outlive the scene, and an element
    // follows the last vertex; packets and masks have Embree's layout and alignment.
    unsafe {
        let device = rtcNewDevice(setup.device.as_ptr());
        assert!(!device.is_null());
        let scene = rtcNewScene(device);
        rtcSetSceneFlags(scene, setup.flags);
        rtcSetSceneBuildQuality(scene, setup.quality);
        let geometry = rtcNewGeometry(device, RTCGeometryType::RTC_GEOMETRY_TYPE_TRIANGLE);
        rtcSetGeometryBuildQuality(geometry, setup.quality);
        let (vertex, index) = (RTCBufferType::RTC_BUFFER_TYPE_VERTEX, RTCBufferType::RTC_BUFFER_TYPE_INDEX);
        let (v, i) = (mesh.positions.as_ptr().cast(), mesh.indices.as_ptr().cast());
        let (float3, uint3) = (RTCFormat::RTC_FORMAT_FLOAT3, RTCFormat::RTC_FORMAT_UINT3);
        rtcSetSharedGeometryBuffer(geometry, vertex, 0, float3, v, 0, 12, mesh.positions.len() - 1);
        rtcSetSharedGeometryBuffer(geometry, index, 0, uint3, i, 0, 12, mesh.indices.len());
        rtcCommitGeometry(geometry);
        rtcAttachGeometry(scene, geometry);
        rtcReleaseGeometry(geometry);
        rtcCommitScene(scene);
        let mut context: RTCIntersectContext = std::mem::zeroed();
        context.instID = [!0; 1];
        if coherent {
            context.flags = RTCIntersectContextFlags::RTC_INTERSECT_CONTEXT_FLAG_COHERENT;
        }
        let c = &raw mut context;
        let mut trace = |rays: &[Aim]| {
            let (valid, scene) = (mask.0.as_ptr(), scene);
            macro_rules! packet {
                ($n:literal, $trace:expr, $missed:expr) => {{
                    let mut packet = Packet::<$n>::new(rays);
                    #[allow(clippy::redundant_closure_call)]
                    $trace((&raw mut packet).cast());
                    let missed = |i: &usize| -> bool { $missed(&packet, *i) };
                    escaped.extend((0..rays.len()).filter(missed).map(|i| rays[i]));
                }};
            }
            match query {
                Query::Intersect1 => packet!(1, |p| rtcIntersect1(scene, c, p), no_hit),
                Query::Occluded1 => packet!(1, |p| rtcOccluded1(scene, c, p), not_occluded),
                Query::Intersect4 => packet!(4, |p| rtcIntersect4(valid, scene, c, p), no_hit),
                Query::Intersect8 => packet!(8, |p| rtcIntersect8(valid, scene, c, p), no_hit),
                Query::Occluded16 => packet!(16, |p| rtcOccluded16(valid, scene, c, p), not_occluded),
                Query::Intersect16 | Query::Intersect16Coherent => {
                    packet!(16, |p| rtcIntersect16(valid, scene, c, p), no_hit)
                }
            }
        };
        let width = match query {
            Query::Intersect1 | Query::Occluded1 => 1,
            Query::Intersect4 => 4,
            Query::Intersect8 => 8,
            _ => 16,
        };
        rays.chunks(width).for_each(&mut trace);
        rtcReleaseScene(scene);
        rtcReleaseDevice(device);
    }
    escaped
}

fn no_hit<const N: usize>(packet: &Packet<N>, i: usize) -> bool {
    packet.hit_ids[1][i] == !0
}

fn not_occluded<const N: usize>(packet: &Packet<N>, i: usize) -> bool {
    packet.floats[8][i] != f32::NEG_INFINITY
}

/// Returns whether no triangle ahead is hit according to Embree's edge functions. These are Plücker coordinates
/// relative to the origin, rounded to `f32` with fused multiply-add: `(c − a) × (c + a) · d` and the like. All must
/// have one sign to within a rounding of their sum.
fn escapes_rounded(mesh: &Mesh, ray: &Aim) -> bool {
    let cross = |a: V3, b: V3| {
        let minor = |x: usize, y: usize| a[x].mul_add(b[y], -(a[y] * b[x]));
        [minor(1, 2), minor(2, 0), minor(0, 1)]
    };
    let dot = |a: V3, b: V3| a[0].mul_add(b[0], a[1].mul_add(b[1], a[2] * b[2]));
    let edge = |a: V3, b: V3| {
        let (difference, sum) = (std::array::from_fn(|i| a[i] - b[i]), std::array::from_fn(|i| a[i] + b[i]));
        dot(cross(difference, sum), ray.d)
    };
    !ahead(mesh, ray).any(|[a, b, c]| {
        let (u, v, w) = (edge(c, a), edge(a, b), edge(b, c));
        let eps = f32::EPSILON * (u + v + w).abs();
        u.min(v).min(w) >= -eps || u.max(v).max(w) <= eps
    })
}

/// Returns the result of the same test in `f64`, without a tolerance.
fn escapes_exact(mesh: &Mesh, ray: &Aim) -> bool {
    let d = ray.d.map(f64::from);
    let edge = |p: V3, q: V3| {
        let (p, q) = (p.map(f64::from), q.map(f64::from));
        let minor = |x: usize, y: usize| p[x] * q[y] - p[y] * q[x];
        minor(1, 2) * d[0] + minor(2, 0) * d[1] + minor(0, 1) * d[2]
    };
    !ahead(mesh, ray).any(|[a, b, c]| {
        let (u, v, w) = (edge(c, a), edge(a, b), edge(b, c));
        u.min(v).min(w) >= 0.0 || u.max(v).max(w) <= 0.0
    })
}

/// Returns the triangles with a corner ahead of the ray's start, relative to it. A ray aimed at a vertex or an edge
/// can hit no others.
fn ahead<'a>(mesh: &'a Mesh, ray: &'a Aim) -> impl Iterator<Item = [V3; 3]> + 'a {
    let relative = |i: u32| {
        let p = mesh.positions[i as usize];
        std::array::from_fn(|k| p[k] - ray.o[k])
    };
    let is_ahead = |p: &V3| p[0] * ray.d[0] + p[1] * ray.d[1] + p[2] * ray.d[2] > 0.0;
    mesh.indices.iter().map(move |t| t.map(relative)).filter(move |t| t.iter().any(is_ahead))
}

fn main() {
    use Query::*;
    let (robust, none) = (RTCSceneFlags::RTC_SCENE_FLAG_ROBUST, RTCSceneFlags::RTC_SCENE_FLAG_NONE);
    let compact = RTCSceneFlags(robust.0 | RTCSceneFlags::RTC_SCENE_FLAG_COMPACT.0);
    let (low, medium, high) = (
        RTCBuildQuality::RTC_BUILD_QUALITY_LOW,
        RTCBuildQuality::RTC_BUILD_QUALITY_MEDIUM,
        RTCBuildQuality::RTC_BUILD_QUALITY_HIGH,
    );
    let usual = Setup { device: c"threads=1", flags: robust, quality: medium };
    let rows = [
        ("not robust, single", Setup { flags: none, ..usual }, Intersect1),
        ("not robust, 16", Setup { flags: none, ..usual }, Intersect16),
        ("robust, single", usual, Intersect1),
        ("robust, single, occlusion", usual, Occluded1),
        ("robust, 4", usual, Intersect4),
        ("robust, 8", usual, Intersect8),
        ("robust, 16", usual, Intersect16),
        ("robust, 16, occlusion", usual, Occluded16),
        ("robust, 16, coherent", usual, Intersect16Coherent),
        ("robust, single, compact", Setup { flags: compact, ..usual }, Intersect1),
        ("robust, 16, compact", Setup { flags: compact, ..usual }, Intersect16),
        ("robust, 16, low quality", Setup { quality: low, ..usual }, Intersect16),
        ("robust, 16, high quality", Setup { quality: high, ..usual }, Intersect16),
        ("robust, single, SSE2", Setup { device: c"threads=1,isa=sse2", ..usual }, Intersect1),
        ("robust, single, AVX", Setup { device: c"threads=1,isa=avx", ..usual }, Intersect1),
        ("robust, single, AVX2", Setup { device: c"threads=1,isa=avx2", ..usual }, Intersect1),
    ];
    for center in [[0.0; 3], [1e4, -1e4, 1e4]] {
        let mesh = sphere(center);
        let rays = rays(&mesh, center);
        let vertices = rays.iter().filter(|r| r.vertex).count();
        println!("sphere at {center:?}: {RAYS} rays, {vertices} at vertices");
        println!("{:28} {:>9} {:>9} {:>8} {:>8}", "", "at vertex", "at edge", "in f32", "in f64");
        for (name, setup, query) in rows {
            let escaped = escapes(&mesh, &rays, setup, query);
            let at_vertices = escaped.iter().filter(|r| r.vertex).count();
            let sample = &escaped[..escaped.len().min(1000)];
            let rounded = sample.iter().filter(|r| escapes_rounded(&mesh, r)).count();
            let exact = sample.iter().filter(|r| escapes_exact(&mesh, r)).count();
            println!("{name:28} {at_vertices:9} {:9} {rounded:8} {exact:8}", escaped.len() - at_vertices);
        }
    }
}
