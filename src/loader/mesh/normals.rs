//! Vertex normals of a mesh that has none.

use crate::math::{DAffine3, DVec3, Vec3};
use crate::shape::Mesh;
use rayon::prelude::*;

/// Triangles whose normals are in memory at once.
const BLOCK: usize = 1 << 15;
/// Triangles or vertices that a thread takes at least.
const LEAST: usize = 1 << 10;

/// What a triangle adds to its corners: its unit normal in the world, and its angles.
type Share = Option<(DVec3, [f64; 3])>;

/// Unit vertex normals in the mesh's own coordinates: at each vertex the mean of its faces' normals weighted by the
/// angle that the face spans there. [Thürmer and Wüthrich 1998]
///
/// Angles and normals are those of the mesh in the world, which is where Mitsuba takes them. Vertices without a valid face get
/// (1, 0, 0) in the world. Faces are added in their order, whatever the number of threads.
pub fn compute(mesh: &Mesh, to_world: &DAffine3) -> Vec<Vec3> {
    let mut sums = vec![DVec3::ZERO; mesh.positions.len()];
    let shares = |block: Option<&[[u32; 3]]>, shares: &mut Vec<Share>| {
        let triangles = block.unwrap_or_default().par_iter().with_min_len(LEAST);
        triangles.map(|triangle| share(mesh, to_world, triangle)).collect_into_vec(shares);
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
    // Normals go to the world by the inverse transpose, so they come from there by the transpose.
    let from_world = to_world.matrix3.transpose();
    let own = |sum: &DVec3| (from_world * sum.try_normalize().unwrap_or(DVec3::X)).normalize().as_vec3();
    sums.par_iter().with_min_len(LEAST).map(own).collect()
}

/// Adds what triangles give to their corners.
fn add(triangles: &[[u32; 3]], shares: &[Share], sums: &mut [DVec3]) {
    for (triangle, share) in triangles.iter().zip(shares) {
        let Some((normal, angles)) = share else { continue };
        for (vertex, angle) in triangle.iter().zip(angles) {
            sums[*vertex as usize] += *normal * *angle;
        }
    }
}

fn share(mesh: &Mesh, to_world: &DAffine3, triangle: &[u32; 3]) -> Share {
    let corners = triangle.map(|i| to_world.transform_point3(mesh.positions[i as usize].as_dvec3()));
    let normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]).try_normalize()?;
    let angle = |i: usize| {
        let to_next = corners[(i + 1) % 3] - corners[i];
        let to_last = corners[(i + 2) % 3] - corners[i];
        to_next.angle_between(to_last)
    };
    Some((normal, [angle(0), angle(1), angle(2)]))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A square and a triangle that stands on one of its edges.
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
        // What Mitsuba 3.9.1 computes for this mesh.
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
}
