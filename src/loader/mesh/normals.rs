//! Vertex normals of a mesh that has none.

use crate::math::{DAffine3, DVec3, Vec3};
use crate::shape::Mesh;
use rayon::prelude::*;
use wide::f64x4;

/// The number of triangles whose normals are in memory at the same time.
const BLOCK: usize = 1 << 15;
/// The least number of vertices, or of groups of four triangles, in a task.
const LEAST: usize = 1 << 8;
/// A sum of weighted normals with a squared length of at most this has no direction: the normals cancel.
const LEAST_SQUARE: f64 = 1e-60;

/// The contributions of four triangles to their corners: unit normals in world space (x, y, z), and the angle at each
/// corner; zero for a triangle that has no area or is not finite.
type Shares = [[f64; 4]; 6];

/// Returns unit vertex normals in the mesh's own coordinates: at each vertex the mean of its faces' normals, weighted
/// by the angle of each face at the vertex. [Thürmer and Wüthrich 1998]
///
/// Angles and normals are those of the mesh in world space, as in Mitsuba. Vertices without a valid face get (1, 0, 0)
/// in world space. Faces are added in their order, for any number of threads.
pub fn compute(mesh: &Mesh, to_world: &DAffine3) -> Vec<Vec3> {
    let mut sums = vec![DVec3::ZERO; mesh.positions.len()];
    let shares = |block: Option<&[[u32; 3]]>, into: &mut Vec<Shares>| {
        let fours = block.unwrap_or_default().par_chunks(4).with_min_len(LEAST);
        fours.map(|four| shares(mesh, to_world, four)).collect_into_vec(into);
    };
    let (mut ready, mut next) = (Vec::new(), Vec::new());
    let mut blocks = mesh.indices.chunks(BLOCK);
    let mut block = blocks.next();
    shares(block, &mut ready);
    while let Some(triangles) = block {
        let following = blocks.next();
        rayon::join(|| add(triangles, &ready, &mut sums), || shares(following, &mut next));
        std::mem::swap(&mut ready, &mut next);
        block = following;
    }
    // Normals are transformed to world space by the inverse transpose, and back by the transpose.
    let from_world = to_world.matrix3.transpose();
    let own = |sum: &DVec3| {
        let known = sum.length_squared() > LEAST_SQUARE;
        (from_world * if known { *sum } else { DVec3::X }).normalize().as_vec3()
    };
    sums.par_iter().with_min_len(LEAST).map(own).collect()
}

/// Adds the contributions of triangles to their corners.
fn add(triangles: &[[u32; 3]], shares: &[Shares], sums: &mut [DVec3]) {
    for (four, shares) in triangles.chunks(4).zip(shares) {
        for (lane, triangle) in four.iter().enumerate() {
            let [x, y, z, angles @ ..] = shares.map(|values| values[lane]);
            for (vertex, angle) in triangle.iter().zip(angles) {
                sums[*vertex as usize] += DVec3::new(x, y, z) * angle;
            }
        }
    }
}

/// Up to four vectors, one in each lane.
type Vec3x4 = [f64x4; 3];

fn shares(mesh: &Mesh, to_world: &DAffine3, four: &[[u32; 3]]) -> Shares {
    let corners: [Vec3x4; 3] = std::array::from_fn(|corner| {
        let mut lanes = [[0.0; 4]; 3];
        for (lane, triangle) in four.iter().enumerate() {
            let p = mesh.positions[triangle[corner] as usize];
            [lanes[0][lane], lanes[1][lane], lanes[2][lane]] = p.as_dvec3().to_array();
        }
        transform(to_world, lanes.map(f64x4::from))
    });
    let edges: [Vec3x4; 3] = std::array::from_fn(|i| subtract(corners[(i + 1) % 3], corners[i]));
    let squares = edges.map(|edge| dot(edge, edge));
    let (a, b) = (edges[0], edges[2].map(|v| -v));
    let normal = [a[1] * b[2] - b[1] * a[2], a[2] * b[0] - b[2] * a[0], a[0] * b[1] - b[0] * a[1]];
    let reciprocal = f64x4::ONE / dot(normal, normal).sqrt();
    let valid = reciprocal.is_finite() & reciprocal.simd_gt(f64x4::ZERO);
    let keep = |v: f64x4| valid.select(v, f64x4::ZERO).to_array();
    let angle = |i: usize| {
        let last = (i + 2) % 3;
        let cos = -dot(edges[i], edges[last]) / (squares[i] * squares[last]).sqrt();
        cos.max(-f64x4::ONE).min(f64x4::ONE).acos()
    };
    let [x, y, z] = normal.map(|v| keep(v * reciprocal));
    [x, y, z, keep(angle(0)), keep(angle(1)), keep(angle(2))]
}

fn transform(by: &DAffine3, [x, y, z]: Vec3x4) -> Vec3x4 {
    let (m, t) = (by.matrix3, by.translation);
    std::array::from_fn(|i| x * m.x_axis[i] + y * m.y_axis[i] + z * m.z_axis[i] + t[i])
}

fn subtract(a: Vec3x4, b: Vec3x4) -> Vec3x4 {
    std::array::from_fn(|i| a[i] - b[i])
}

fn dot(a: Vec3x4, b: Vec3x4) -> f64x4 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns a square, and a triangle perpendicular to it at one of its edges.
    fn corner() -> Mesh {
        let positions = [[0., 0., 0.], [1., 0., 0.], [1., 1., 0.], [0., 1., 0.], [0., 0., 1.], [5., 5., 5.]];
        let indices = vec![[0, 1, 2], [0, 2, 3], [0, 1, 4]];
        Mesh { positions: positions.map(Vec3::from).to_vec(), indices, ..Mesh::default() }
    }

    #[track_caller]
    fn assert_normals(found: &[Vec3], expected: &[[f32; 3]]) {
        for (n, e) in found.iter().zip(expected) {
            assert!((*n - Vec3::from(*e)).length() < 1e-6, "{n} instead of {e:?}");
        }
    }

    #[test]
    fn normals_are_weighted_by_angle_as_in_mitsuba() {
        // The normals that Mitsuba 3.9.1 computes for this mesh.
        let s = std::f32::consts::FRAC_1_SQRT_2;
        let expected = [
            [0., -s, s],
            [0., -0.4472136, 0.8944272],
            [0., 0., 1.],
            [0., 0., 1.],
            [0., -1., 0.],
            [1., 0., 0.],
        ];
        assert_normals(&compute(&corner(), &DAffine3::IDENTITY), &expected);
    }

    #[test]
    fn normals_are_computed_in_the_world() {
        let to_world =
            DAffine3::from_rotation_x(90f64.to_radians()) * DAffine3::from_scale(DVec3::new(2., 3., 1.));
        let normals = compute(&corner(), &to_world);
        let transform = to_world.matrix3.inverse().transpose();
        let world: Vec<_> =
            normals.iter().map(|n| (transform * n.as_dvec3()).normalize().as_vec3()).collect();
        let s = -std::f32::consts::FRAC_1_SQRT_2;
        assert_normals(
            &world,
            &[[0., s, s], [0., -0.9590926, -0.2830927], [0., -1., 0.], [0., -1., 0.], [0., 0., -1.]],
        );
    }

    #[test]
    fn a_broken_face_leaves_its_neighbours_alone() {
        let mut mesh = corner();
        mesh.positions[4].x = f32::NAN;
        let expected = [[0., 0., 1.], [0., 0., 1.], [0., 0., 1.], [0., 0., 1.], [1., 0., 0.]];
        assert_normals(&compute(&mesh, &DAffine3::IDENTITY), &expected);
    }

    /// Computes normals by the definition, one triangle after the other.
    fn plain(mesh: &Mesh, to_world: &DAffine3) -> Vec<Vec3> {
        let world: Vec<DVec3> =
            mesh.positions.iter().map(|p| to_world.transform_point3(p.as_dvec3())).collect();
        let mut sums = vec![DVec3::ZERO; world.len()];
        for triangle in &mesh.indices {
            let corners = triangle.map(|i| world[i as usize]);
            let normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]);
            let Some(normal) = normal.try_normalize() else { continue };
            for (i, vertex) in triangle.iter().enumerate() {
                let to_next = corners[(i + 1) % 3] - corners[i];
                let to_last = corners[(i + 2) % 3] - corners[i];
                sums[*vertex as usize] += normal * to_next.angle_between(to_last);
            }
        }
        let from_world = to_world.matrix3.transpose();
        let own = |sum: DVec3| (from_world * sum.try_normalize().unwrap_or(DVec3::X)).normalize().as_vec3();
        sums.into_iter().map(own).collect()
    }

    #[test]
    fn many_triangles_are_added_as_one_after_the_other() {
        let mut state = 1u32;
        let mut random = || {
            state = state.wrapping_mul(1664525).wrapping_add(1013904223);
            state >> 8
        };
        let mut mesh = Mesh::default();
        for i in 0..20_000 {
            let p = Vec3::from([random(), random(), random()].map(|v| v as f32 / (1 << 23) as f32 - 1.0));
            mesh.positions.push(match i % 1000 {
                0 => Vec3::NAN,
                1 => Vec3::splat(f32::MAX),
                2 => Vec3::ZERO,
                3 => p * 1e-30,
                _ => p,
            });
        }
        // Some triangles have fewer than three different corners.
        mesh.indices =
            (0..2 * BLOCK + 5).map(|_| [random(), random(), random()].map(|i| i % 20_000)).collect();
        for i in (0..mesh.indices.len()).step_by(77) {
            mesh.indices[i][2] = mesh.indices[i][1];
        }
        let to_world = DAffine3::from_scale(DVec3::new(1.0, -2.0, 0.5));
        let (fast, plain) = (compute(&mesh, &to_world), plain(&mesh, &to_world));
        let off = fast.iter().zip(&plain).map(|(a, b)| (*a - *b).length()).fold(0.0, f32::max);
        assert!(off < 1e-6, "{off}");
        let same = fast.iter().zip(&plain).filter(|(a, b)| a == b).count();
        assert!(same > 19_900, "{same} of 20,000 are the same to the last bit");
    }
}
