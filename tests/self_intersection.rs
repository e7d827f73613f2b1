//! Absence of self-intersection: rays that leave a surface point do not hit the surface again at that point.

use crate::meshes::Random;
use crate::support::scenes::{add, compiled, diffuse, sphere};
use buffon::accel::{AccelKind, Coherence, Hit};
use buffon::color::Rgb;
use buffon::emitter::ShadowTarget;
use buffon::math::{DAffine3, DVec3, Frame, Ray, Vec2, Vec3};
use buffon::scene::{Description, Scene};
use buffon::shape::{Mesh, Shape};

/// One surface in a scene of its own, and the target of rays.
struct Surface {
    name: String,
    scene: Scene,
    target: DAffine3,
}

/// Returns a transformed surface. Rays are aimed at the image of the square [−1, 1]².
fn surface(name: String, shape: Shape, to_world: DAffine3, accel: AccelKind) -> Surface {
    let mut description = Description::default();
    add(&mut description, shape, to_world, diffuse(0.5));
    Surface { name: format!("{name}, {accel}"), scene: compiled(description, accel), target: to_world }
}

fn triangle() -> Shape {
    let positions = vec![Vec3::new(-1.0, -1.0, 0.0), Vec3::new(1.0, -1.0, 0.0), Vec3::new(0.0, 1.0, 0.0)];
    Shape::Mesh(Mesh { positions, indices: vec![[0, 1, 2]], ..Mesh::default() })
}

/// Returns surfaces on coordinate planes and rotated, small and large, at the origin and far from it.
fn surfaces(accel: AccelKind) -> Vec<Surface> {
    let mut random = Random(5);
    let mut list = Vec::new();
    let axes = [DVec3::X, DVec3::Y, DVec3::Z];
    for scale in [1e-3, 1.0, 1e4] {
        for distance in [0.0, 1.0, 1e3] {
            for turn in 0..5 {
                let rotation = match turn {
                    0..3 => DAffine3::from_axis_angle(axes[turn], std::f64::consts::FRAC_PI_2),
                    _ => DAffine3::from_axis_angle(random.cube().as_dvec3().normalize(), 1.0 + turn as f64),
                };
                let offset = DVec3::splat(distance) * axes[turn % 3] + 0.7 * distance * axes[(turn + 1) % 3];
                let to_world =
                    DAffine3::from_translation(offset) * rotation * DAffine3::from_scale(DVec3::splat(scale));
                for (kind, shape) in [
                    ("rectangle", Shape::Rectangle),
                    ("triangle", triangle()),
                    ("disk", Shape::Disk),
                    ("sphere", sphere(1.0)),
                ] {
                    list.push(surface(
                        format!("{kind} of size {scale} at {offset}, turn {turn}"),
                        shape,
                        to_world,
                        accel,
                    ));
                }
            }
        }
    }
    list
}

/// Traces rays from all sides to the surface, and returns those with hits.
fn first_hits(surface: &Surface, random: &mut Random, n: usize) -> Vec<(Ray, Hit)> {
    let size = surface.target.matrix3.x_axis.length();
    let rays: Vec<Ray> = (0..n)
        .map(|_| {
            let at = surface.target.transform_point3(random.cube().as_dvec3() * DVec3::new(0.9, 0.9, 0.0));
            let from = at + random.cube().as_dvec3().normalize() * size * 3.0;
            Ray::new(from.as_vec3(), (at - from).as_vec3().normalize())
        })
        .collect();
    let mut hits = vec![None; n];
    surface.scene.accel.intersect_wave(&rays, &mut hits, Coherence::Coherent);
    rays.into_iter().zip(hits).filter_map(|(ray, hit)| Some((ray, hit?))).collect()
}

#[test]
fn flat_and_convex_surfaces_do_not_shadow_themselves() {
    for &accel in AccelKind::CHOICES {
        for surface in surfaces(accel) {
            let mut random = Random(9);
            let hits = first_hits(&surface, &mut random, 400);
            assert!(hits.len() > 60, "{}: {} hits", surface.name, hits.len());
            let leaving: Vec<Ray> =
                hits.iter().map(|(ray, hit)| leave(&surface.scene, ray, hit, &mut random)).collect();
            let mut again = vec![None; leaving.len()];
            surface.scene.accel.intersect_wave(&leaving, &mut again, Coherence::Incoherent);
            let mut occluded = vec![false; leaving.len()];
            surface.scene.accel.occluded_wave(&leaving, &mut occluded, Coherence::Incoherent);
            let wrong =
                again.iter().filter(|hit| hit.is_some()).count() + occluded.iter().filter(|&&o| o).count();
            let singly = leaving.iter().filter(|ray| surface.scene.accel.occluded(ray)).count();
            let example = leaving.iter().zip(&again).find_map(|(ray, hit)| Some((ray, (*hit)?)));
            assert_eq!((wrong, singly), (0, 0), "{} of {} rays: {example:?}", surface.name, leaving.len());
        }
    }
}

/// Returns a ray from a hit in any direction on the side of the incoming ray.
fn leave(scene: &Scene, ray: &Ray, hit: &Hit, random: &mut Random) -> Ray {
    let at = scene.interaction(ray, hit);
    let side = if at.ng.dot(ray.d) < 0.0 { at.ng } else { -at.ng };
    // Half of the directions are within a few degrees of the surface.
    let flatten = if random.unit() < 0.5 { 0.02 } else { 1.0 };
    let local = random.cube();
    let local = Vec3::new(local.x, local.y, local.z.abs() * flatten + 1e-3).normalize();
    scene.spawn_ray(&at, Frame::from_normal(side).to_world(local), 0.0)
}

/// An emitter does not block its own light. All front points of a single convex emitter are visible from any point
/// before it, at any angle.
#[test]
fn lamps_do_not_shadow_themselves() {
    for accel in AccelKind::CHOICES {
        for surface in lamps(*accel) {
            let Surface { name, scene, target } = surface;
            let size = target.matrix3.x_axis.length();
            let mut random = Random(11);
            let (mut blocked, mut samples) = (0, 0);
            for _ in 0..20_000 {
                let away =
                    random.cube().as_dvec3().normalize() * size * 10f64.powf(random.unit() as f64 * 3.0);
                let from = (target.translation + away * 1.8).as_vec3();
                let u = Vec2::new(random.unit(), random.unit());
                let Some(sample) = scene.sample_emitter(&scene.light_selection, from, u, 0.0) else {
                    continue;
                };
                let ShadowTarget::Point(end) = sample.target else { panic!("a lamp is somewhere") };
                samples += 1;
                blocked +=
                    usize::from(scene.accel.occluded(&Ray { t_max: 1.0, ..Ray::new(from, end - from) }));
            }
            assert!(samples > 2000, "{name}: {samples}");
            assert_eq!(blocked, 0, "{name}: of {samples}");
        }
    }
}

/// Returns emitters on coordinate planes and rotated, at the origin and beside it.
fn lamps(accel: AccelKind) -> Vec<Surface> {
    let mut list = Vec::new();
    for offset in [DVec3::ZERO, DVec3::new(0.3, 1.75, 0.2), DVec3::new(-40.0, 3.0, 7.0)] {
        for turn in [0.0, 0.5, std::f64::consts::FRAC_PI_2] {
            let to_world = DAffine3::from_translation(offset)
                * DAffine3::from_rotation_x(turn)
                * DAffine3::from_scale(DVec3::splat(0.4));
            for (kind, shape) in [
                ("cube", Shape::Cube),
                ("rectangle", Shape::Rectangle),
                ("triangle", triangle()),
                ("disk", Shape::Disk),
                ("sphere", sphere(1.0)),
            ] {
                let mut description = Description::default();
                let id = add(&mut description, shape, to_world, diffuse(0.5));
                description.shapes[id].emission = Some(Rgb::WHITE.into());
                let name = format!("{kind} at {offset}, turned {turn}, {accel}");
                list.push(Surface { name, scene: compiled(description, accel), target: to_world });
            }
        }
    }
    list
}
