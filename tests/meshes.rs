//! Meshes and random numbers of the traversal tests. Everything is a function of a fixed seed.

use buffon::accel::Geometry;
use buffon::math::Vec3;
use std::f32::consts::{PI, TAU};
use std::sync::Arc;

/// A SplitMix64 generator.
pub struct Random(pub u64);

impl Random {
    pub fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// Uniform in [0, 1).
    pub fn unit(&mut self) -> f32 {
        (self.next() >> 40) as f32 / (1u64 << 24) as f32
    }

    /// Uniform in [-1, 1)³.
    pub fn cube(&mut self) -> Vec3 {
        Vec3::new(self.unit(), self.unit(), self.unit()) * 2.0 - 1.0
    }

    pub fn below(&mut self, n: usize) -> usize {
        (self.next() % n as u64) as usize
    }
}

/// Positions and triangles.
#[derive(Clone)]
pub struct Mesh {
    pub positions: Vec<Vec3>,
    pub indices: Vec<[u32; 3]>,
}

impl Mesh {
    pub fn map(mut self, f: impl Fn(Vec3) -> Vec3) -> Mesh {
        self.positions.iter_mut().for_each(|p| *p = f(*p));
        self
    }

    pub fn geometry(self) -> Geometry {
        Geometry::Triangles { positions: Arc::new(self.positions.into()), indices: Arc::new(self.indices) }
    }

    pub fn corners(&self, triangle: usize) -> [Vec3; 3] {
        self.indices[triangle].map(|i| self.positions[i as usize])
    }

    /// A vertex, or a point on an edge.
    pub fn vertex_or_edge_point(&self, random: &mut Random) -> Vec3 {
        let corners = self.corners(random.below(self.indices.len()));
        let k = random.below(3);
        match random.below(3) {
            0 => corners[k],
            _ => corners[k].lerp(corners[(k + 1) % 3], random.unit()),
        }
    }
}

/// The unit sphere in `rings` × `sectors` faces. Closed: poles and seam share their vertices.
pub fn sphere(rings: u32, sectors: u32) -> Mesh {
    let mut positions = vec![Vec3::Z];
    for r in 1..rings {
        for s in 0..sectors {
            let (theta, phi) = (PI * r as f32 / rings as f32, TAU * s as f32 / sectors as f32);
            positions.push(Vec3::new(theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos()));
        }
    }
    positions.push(-Vec3::Z);
    let last = positions.len() as u32 - 1;
    let at = |r: u32, s: u32| match r {
        0 => 0,
        r if r == rings => last,
        r => 1 + (r - 1) * sectors + s % sectors,
    };
    let mut indices = Vec::new();
    for r in 0..rings {
        for s in 0..sectors {
            if r > 0 {
                indices.push([at(r, s), at(r + 1, s), at(r, s + 1)]);
            }
            if r + 1 < rings {
                indices.push([at(r, s + 1), at(r + 1, s), at(r + 1, s + 1)]);
            }
        }
    }
    Mesh { positions, indices }
}

/// The cube [-1, 1]³ in 12 triangles.
pub fn cube() -> Mesh {
    let sign = |i: u32, bit: u32| if i & bit == 0 { -1.0 } else { 1.0 };
    let positions = (0..8).map(|i| Vec3::new(sign(i, 1), sign(i, 2), sign(i, 4))).collect();
    let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    let indices = quads.iter().flat_map(|q| [[q[0], q[1], q[2]], [q[0], q[2], q[3]]]).collect();
    Mesh { positions, indices }
}

/// A height field over [-1, 1]² with `n`² squares.
pub fn terrain(n: u32) -> Mesh {
    let height =
        |x: f32, y: f32| 0.2 * (7.0 * x).sin() * (5.0 * y).cos() + 0.05 * (31.0 * x + 17.0 * y).sin();
    let coordinate = |i: u32| 2.0 * i as f32 / n as f32 - 1.0;
    let at = |i: u32| (coordinate(i % (n + 1)), coordinate(i / (n + 1)));
    let positions =
        (0..(n + 1) * (n + 1)).map(|i| Vec3::new(at(i).0, at(i).1, height(at(i).0, at(i).1))).collect();
    let squares = (0..n * n).map(|i| (i / n) * (n + 1) + i % n);
    let indices = squares.flat_map(|a| [[a, a + 1, a + n + 1], [a + 1, a + n + 2, a + n + 1]]).collect();
    Mesh { positions, indices }
}

/// `count` triangles of about `size`, each with its own corners; `thin` scales one of their edges.
pub fn soup(count: u32, size: f32, thin: f32, random: &mut Random) -> Mesh {
    let mut positions = Vec::new();
    for _ in 0..count {
        let p = random.cube();
        positions.extend([p, p + random.cube() * size, p + random.cube() * size * thin]);
    }
    Mesh { positions, indices: (0..count).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect() }
}
