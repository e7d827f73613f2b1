//! No ray from inside a closed mesh escapes, even where it is aimed at a vertex or an edge.

use crate::meshes::{Mesh, Random, cube, sphere};
use buffon::accel::{AccelKind, Coherence, build};
use buffon::math::{Ray, Vec3};

const RAYS: usize = 1_000_000;

/// Closed meshes, each with the half-extent of a box around the origin that lies inside.
fn closed_meshes() -> Vec<(&'static str, Mesh, Vec3)> {
    let needles = sphere(4, 800).map(|p| p * Vec3::new(1.0, 1.0, 20.0));
    vec![
        ("sphere", sphere(32, 64), Vec3::splat(0.5)),
        ("cube", cube(), Vec3::splat(0.9)),
        ("needles", needles, Vec3::new(0.3, 0.3, 5.0)),
    ]
}

/// A ray from inside to a vertex or an edge. Some start at the centre, on the mesh's planes of symmetry; the
/// direction is of unit length, or the vector to the target.
fn aimed_ray(mesh: &Mesh, center: Vec3, inside: Vec3, random: &mut Random) -> Ray {
    let target = mesh.vertex_or_edge_point(random);
    let origin = match random.below(4) {
        0 => center,
        _ => center + random.cube() * inside,
    };
    let d = target - origin;
    Ray::new(origin, if random.below(2) == 0 { d.normalize() } else { d })
}

#[test]
fn no_ray_escapes_from_a_closed_mesh_through_vertices_or_edges() {
    let meshes = closed_meshes();
    let rays_each = RAYS / (2 * meshes.len()) + 1;
    for (seed, (name, mesh, inside)) in (1..).zip(&meshes) {
        for center in [Vec3::ZERO, Vec3::new(1e4, -1e4, 1e4)] {
            let mut random = Random(seed);
            let mesh = mesh.clone().map(|p| p + center);
            let rays: Vec<Ray> = (0..rays_each).map(|_| aimed_ray(&mesh, center, *inside, &mut random)).collect();
            for &kind in AccelKind::ALL {
                let accel = build(kind, vec![mesh.clone().geometry()], 0, true).expect("built").accel;
                let mut hits = vec![None; rays.len()];
                accel.intersect_wave(&rays, &mut hits, Coherence::Incoherent);
                let mut occluded = vec![false; rays.len()];
                accel.occluded_wave(&rays, &mut occluded, Coherence::Incoherent);
                let escaped: Vec<usize> = (0..rays.len()).filter(|&i| hits[i].is_none() || !occluded[i]).collect();
                let single = rays.iter().take(rays_each / 10).filter(|r| accel.intersect(r).is_none()).count();
                let example = escaped.first().map(|&i| rays[i]);
                assert_eq!((escaped.len(), single), (0, 0), "{kind}, {name} at {center}: e.g. {example:?}");
            }
        }
    }
}
