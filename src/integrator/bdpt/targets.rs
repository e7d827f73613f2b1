//! Light paths that are aimed at the surfaces where caustics begin.
//!
//! Each surface is inside a sphere. A light path chooses an emitter and a sphere. From a point of an emitting surface,
//! it goes in a direction towards the sphere. An emitter that is a smaller sphere has the same directions for all its
//! points. From an emitter at infinity, the path starts at a point of the disk that the sphere presents in the
//! direction of the emitter. The direction or the point on the disk is a point of a unit square. The probabilities of
//! the pairs and the densities on their squares are learned from the contributions of light paths. Camera paths know
//! these densities, too, so the weights of both are exact. [After the projection maps of Jensen 1996]

use crate::emitter::{BoundingSphere, Light, LightRay, distant_ray};
use crate::ids::EmitterId;
use crate::integrator::light_path::EmissionNumbers;
use crate::integrator::photon::guide::PathHistogram;
use crate::math::{Bounds, Frame, Ray, Vec2, Vec3};
use crate::sampling::{Distribution1D, Distribution2D, warp};
use crate::scene::Scene;

/// The most spheres.
const SPHERES: usize = 16;
/// The most pairs of an emitter and a sphere for which densities on squares are learned. Spheres are joined until there
/// are no more.
const PAIRS: usize = 1 << 10;
/// The factor on the radius of a sphere, so that rounding leaves no surface outside.
const MARGIN: f32 = 1.01;
/// The least radius of a sphere, relative to the scene. The square of its inverse is representable.
const LEAST_RADIUS: f32 = 1e-15;
/// The least sine of the half angle of a cone, in which many directions are representable.
const LEAST_SIN: f32 = 1e-4;
/// The least contributions from which a density on a square is learned.
const CONTRIBUTIONS: usize = 16;
/// The share of the light paths that choose a pair, and then a point of its square, as before anything was learned.
const UNLEARNED: f32 = 0.25;

/// The spheres at which light paths are aimed, and the densities of their starts.
#[derive(Clone, Debug)]
pub struct Targets {
    spheres: Vec<BoundingSphere>,
    /// The choice of an emitter and a sphere: all spheres of the first emitter, then those of the next.
    choice: Distribution1D,
    /// The learned density on the square of each pair; `None` if it is uniform. Empty if nothing is learned.
    squares: Vec<Option<Distribution2D>>,
}

/// How a light path starts.
#[derive(Clone, Copy, Debug)]
pub struct TargetChoice {
    /// The index of the pair, and its probability.
    pair: usize,
    probability: f32,
    /// The point on its square, and its density.
    u: Vec2,
    density: f32,
}

/// The directions to a sphere: from a point, or from all points of a smaller sphere that emits.
struct View {
    /// The vector to the centre of the sphere.
    to: Vec3,
    /// The radius, with that of the emitter.
    radius: f32,
    from_sphere: bool,
}

/// A cone of directions.
struct Cone {
    frame: Frame,
    one_minus_cos: f32,
}

impl View {
    /// Creates the view of a sphere from all points of an emitter, if that is a smaller sphere.
    fn from_sphere(light: &Light, sphere: &BoundingSphere) -> Option<Self> {
        let from = light.constant_sphere().filter(|from| from.radius <= sphere.radius)?;
        let grown = BoundingSphere { radius: sphere.radius + from.radius, ..*sphere };
        Some(View { from_sphere: true, ..View::from_point(from.center, &grown) })
    }

    fn from_point(o: Vec3, sphere: &BoundingSphere) -> Self {
        let to = sphere.center - o;
        View { to, radius: sphere.radius.max(LEAST_SIN * to.length()), from_sphere: false }
    }

    fn is_inside(&self) -> bool {
        self.to.length_squared() <= self.radius * self.radius
    }

    fn contains(&self, d: Vec3) -> bool {
        let hits = || self.to.cross(d).length_squared() <= self.radius * self.radius;
        self.is_inside() || (self.to.dot(d) > 0.0 && hits())
    }

    /// Returns the cone of the directions, which from inside are all directions. Returns `None` if they are not aimed:
    /// from a point inside.
    fn cone(&self) -> Option<Cone> {
        if self.is_inside() {
            return self.from_sphere.then(|| Cone { frame: Frame::from_normal(Vec3::Z), one_minus_cos: 2.0 });
        }
        let sin_squared = self.radius * self.radius / self.to.length_squared();
        let one_minus_cos = sin_squared / (1.0 + (1.0 - sin_squared).max(0.0).sqrt());
        Some(Cone { frame: Frame::from_normal(self.to.normalize()), one_minus_cos })
    }
}

impl Cone {
    /// Returns the direction at a point of the unit square.
    fn direction(&self, u: Vec2) -> Vec3 {
        self.frame.to_world(warp::square_to_cone(u, self.one_minus_cos)).normalize()
    }

    /// Inverts [`direction`](Self::direction).
    fn square(&self, d: Vec3) -> Vec2 {
        warp::cone_to_square(self.frame.to_local(d), self.one_minus_cos)
    }
}

impl Targets {
    /// Creates the targets in a scene. Returns `None` if no surface begins caustics, or no scattered ray can hit an
    /// emitter.
    pub fn new(scene: &Scene) -> Option<Self> {
        let most = (PAIRS / scene.lights.len().max(1)).clamp(1, SPHERES);
        let least = LEAST_RADIUS * scene.bounds.radius();
        let mut casters: Vec<_> =
            scene.casters.iter().filter(|sphere| sphere.radius > least).copied().collect();
        let mut spheres = joined(&mut casters, most);
        spheres.iter_mut().for_each(|sphere| sphere.radius *= MARGIN);
        let targets = Targets { choice: Distribution1D::default(), spheres, squares: Vec::new() };
        let choice = Distribution1D::new(&targets.unlearned(scene));
        (!choice.is_empty()).then_some(Targets { choice, ..targets })
    }

    /// Returns the probabilities of the pairs before anything is learned.
    fn unlearned(&self, scene: &Scene) -> Vec<f64> {
        let count = self.spheres.len();
        let emitters: Vec<f64> = (0..scene.lights.len())
            .map(|i| if scene.lights[i].is_delta() { 0.0 } else { f64::from(scene.light_choice.pmf(i)) })
            .collect();
        let sum: f64 = emitters.iter().sum();
        emitters.iter().flat_map(|pmf| std::iter::repeat_n(pmf / (sum * count as f64), count)).collect()
    }

    /// Chooses the start of light path `i` of those with the given random numbers.
    pub fn choose(&self, scene: &Scene, numbers: &EmissionNumbers, i: usize) -> Option<TargetChoice> {
        let pair = self.choice.sample(numbers.choice[i])?;
        let [point, direction] = numbers.pairs(i);
        let emitter = pair.index / self.spheres.len();
        let u = if scene.lights[emitter].is_distant() { point } else { direction };
        let learned = self.squares.get(pair.index).and_then(Option::as_ref).filter(|_| pair.u >= UNLEARNED);
        let (u, density) = match learned {
            Some(square) => {
                let (u, density) = square.sample(u)?;
                (u.min(Vec2::splat(1f32.next_down())), UNLEARNED + (1.0 - UNLEARNED) * density)
            }
            None => (u, self.density_on_square(pair.index, u)),
        };
        Some(TargetChoice { pair: pair.index, probability: pair.pmf, u, density })
    }

    /// Returns the density on the square of a pair.
    fn density_on_square(&self, pair: usize, u: Vec2) -> f32 {
        let square = self.squares.get(pair).and_then(Option::as_ref);
        square.map_or(1.0, |square| UNLEARNED + (1.0 - UNLEARNED) * square.pdf(u))
    }

    /// Learns the densities that minimise the second moment of the contributions of light paths. `paths` are pairs of a
    /// start and the contribution of its path. Returns whether there are any contributions.
    pub fn learn(&mut self, scene: &Scene, paths: &[(TargetChoice, f64)]) -> bool {
        let unlearned = self.unlearned(scene);
        // The contributions as if the pair had its unlearned probability, because emitters of much power are expected
        // to contribute much.
        let relative = |(start, contribution): &(TargetChoice, f64)| {
            contribution * f64::from(start.probability) / unlearned[start.pair]
        };
        let mean = paths.iter().map(|path| relative(path).powi(2)).sum::<f64>() / paths.len().max(1) as f64;
        // One more path for each pair has the mean, because few paths miss light.
        let mut moments = vec![(mean, 1.0); unlearned.len()];
        for path in paths {
            moments[path.0.pair].0 += relative(path).powi(2);
            moments[path.0.pair].1 += 1.0;
        }
        let learned: Vec<f64> =
            unlearned.iter().zip(&moments).map(|(pmf, (sum, count))| pmf * (sum / count).sqrt()).collect();
        let total: f64 = learned.iter().sum();
        if !(total > 0.0 && total.is_finite()) {
            return false;
        }
        if unlearned.len() <= PAIRS {
            let mut of_pairs = vec![Vec::new(); unlearned.len()];
            paths.iter().for_each(|path| of_pairs[path.0.pair].push(path));
            self.squares = of_pairs.iter().map(|paths| learned_square(paths)).collect();
        }
        let share = f64::from(UNLEARNED);
        let mixed = |(pmf, learned): (&f64, &f64)| share * pmf + (1.0 - share) * learned / total;
        self.choice = Distribution1D::new(&unlearned.iter().zip(&learned).map(mixed).collect::<Vec<_>>());
        true
    }

    /// Samples the ray of light path `i` of those with the given random numbers. Returns the emitter beside it, and its
    /// [`density`](Self::density).
    pub fn sample(
        &self,
        scene: &Scene,
        numbers: &EmissionNumbers,
        i: usize,
    ) -> Option<(EmitterId, LightRay, f32)> {
        let TargetChoice { pair, u, density, .. } = self.choose(scene, numbers, i)?;
        let (emitter, sphere) = (pair / self.spheres.len(), &self.spheres[pair % self.spheres.len()]);
        let (light, [u_point, u_direction], time) =
            (&scene.lights[emitter], numbers.pairs(i), numbers.time(i));
        let start = match light.surroundings() {
            Some(_) => {
                let start = light.sample_ray(u_point, u_direction, time)?;
                let aimed = distant_ray(sphere, start.ray.d, u, time);
                LightRay { ray: Ray { o: before(&scene.bounds, aimed.o, aimed.d), ..aimed }, ..start }
            }
            None => match View::from_sphere(light, sphere).and_then(|view| view.cone()) {
                Some(cone) => light.sample_ray_towards(u_point, cone.direction(u), time)?,
                None => {
                    // The middle of the square is the normal.
                    let start = light.sample_ray(u_point, Vec2::splat(0.5), time)?;
                    let (o, n) = (start.ray.o, start.ray.d);
                    let unaimed =
                        || Frame::from_normal(n).to_world(warp::square_to_cosine_hemisphere(u_direction));
                    let cone = View::from_point(o, sphere).cone();
                    let d = cone.map_or_else(unaimed, |cone| cone.direction(u));
                    LightRay { ray: Ray { d, ..start.ray }, cosine: d.dot(n), ..start }
                }
            },
        };
        let ray = (start.ray.o, start.ray.d);
        let density = self.density_knowing(scene, emitter, ray, start.cosine, Some((pair, density)));
        let lit = start.cosine > 0.0 && density > 0.0 && !start.power.is_black();
        let start = LightRay { power: start.power / density, ..start };
        lit.then(|| (EmitterId::from(emitter), start, density))
    }

    /// Returns the density with which light paths start, relative to that of
    /// [`Light::sample_ray`](crate::emitter::Light::sample_ray), with the probability of the emitter. The ray starts at
    /// the point `o` of an emitting surface with the cosine `cosine`, or passes `o` if its emitter is at infinity; its
    /// unit direction is `d`.
    pub fn density(&self, scene: &Scene, emitter: usize, ray: (Vec3, Vec3), cosine: f32) -> f32 {
        self.density_knowing(scene, emitter, ray, cosine, None)
    }

    /// Computes [`density`](Self::density) for a ray whose density on the square of one pair is `known`.
    fn density_knowing(
        &self,
        scene: &Scene,
        emitter: usize,
        (o, d): (Vec3, Vec3),
        cosine: f32,
        known: Option<(usize, f32)>,
    ) -> f32 {
        let light = &scene.lights[emitter];
        let relative = |pair: usize, sphere: &BoundingSphere| {
            let known = known.filter(|known| known.0 == pair).map(|known| known.1);
            if let Some(around) = light.surroundings() {
                let on_square = known.or_else(|| {
                    let to = sphere.center - o;
                    // Most rays miss most spheres.
                    (to.cross(d).length_squared() <= sphere.radius * sphere.radius).then(|| {
                        let aside = Frame::from_normal(d).to_local(-to).truncate() / sphere.radius;
                        self.density_on_square(pair, warp::disk_to_square(aside))
                    })
                });
                return (around.radius / sphere.radius).powi(2) * on_square.unwrap_or(0.0);
            }
            let view = View::from_sphere(light, sphere).unwrap_or_else(|| View::from_point(o, sphere));
            if known.is_none() && !view.contains(d) {
                return 0.0;
            }
            let Some(cone) = view.cone() else { return 1.0 };
            let on_square = known.unwrap_or_else(|| self.density_on_square(pair, cone.square(d)));
            // That of all directions is 1 / 4π, or cosine / π.
            let unaimed = if view.from_sphere { 0.5 } else { 2.0 * cosine };
            on_square / (cone.one_minus_cos * unaimed)
        };
        let first = emitter * self.spheres.len();
        let of_pair = |(k, sphere)| self.choice.pmf(first + k) * relative(first + k, sphere);
        self.spheres.iter().enumerate().map(of_pair).sum()
    }
}

/// Returns the density on a square that minimises the second moment of the contributions of the paths that start there;
/// `None` if there are too few.
fn learned_square(paths: &[&(TargetChoice, f64)]) -> Option<Distribution2D> {
    if paths.iter().filter(|path| path.1 > 0.0).count() < CONTRIBUTIONS {
        return None;
    }
    let mut histogram = PathHistogram::default();
    for (start, contribution) in paths {
        // As if all paths had chosen the pair with the same probability, and its square with a uniform density.
        histogram.add(start.u, contribution * f64::from(start.probability) * f64::from(start.density));
    }
    histogram.distribution()
}

/// Returns a point on the line through `o` with the direction `d` that is outside a box, and before it. It is no
/// farther from the box than necessary, because the rounding error of the line grows with the distance.
fn before(bounds: &Bounds, o: Vec3, d: Vec3) -> Vec3 {
    let entry = |axis: usize| {
        let near = if d[axis] > 0.0 { bounds.min[axis] } else { bounds.max[axis] };
        if d[axis] == 0.0 { f32::NEG_INFINITY } else { (near - o[axis]) / d[axis] }
    };
    let enters = (0..3).map(entry).fold(f32::NEG_INFINITY, f32::max);
    o + d * (enters.min(0.0) - 1e-3 * bounds.radius())
}

/// Returns at most `most` spheres around the given ones: those of neighbours are joined.
fn joined(spheres: &mut [BoundingSphere], most: usize) -> Vec<BoundingSphere> {
    if spheres.len() <= 1 || most <= 1 {
        return around(spheres).into_iter().collect();
    }
    if spheres.len() <= most {
        return spheres.to_vec();
    }
    let extent = Bounds::of(spheres.iter().map(|sphere| sphere.center));
    let axis = (extent.max - extent.min).max_position();
    let middle = spheres.len() / 2;
    spheres.select_nth_unstable_by(middle, |a, b| a.center[axis].total_cmp(&b.center[axis]));
    let (low, high) = spheres.split_at_mut(middle);
    let mut all = joined(low, most / 2);
    all.extend(joined(high, most - most / 2));
    all
}

/// Returns a sphere around spheres.
fn around(spheres: &[BoundingSphere]) -> Option<BoundingSphere> {
    let corners =
        |sphere: &BoundingSphere| [-1.0, 1.0].map(|sign| sphere.center + Vec3::splat(sign * sphere.radius));
    let center = Bounds::of(spheres.iter().flat_map(corners)).center();
    let radius =
        spheres.iter().map(|sphere| sphere.center.distance(center) + sphere.radius).reduce(f32::max)?;
    Some(BoundingSphere { center, radius })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sampling::hash::{pcg3d, to_unit};

    fn numbers(i: u32) -> [f32; 3] {
        pcg3d(i, 1, 2).map(to_unit)
    }

    #[test]
    fn directions_to_a_sphere_are_points_of_its_square() {
        let sphere = BoundingSphere { center: Vec3::new(1.0, -2.0, 0.5), radius: 0.7 };
        for i in 0..200 {
            let o = (Vec3::from(numbers(i)) - 0.5) * 8.0;
            let view = View::from_point(o, &sphere);
            let Some(cone) = view.cone() else {
                assert!(o.distance(sphere.center) <= sphere.radius * 1.001);
                continue;
            };
            let [x, y, _] = numbers(1000 + i);
            let d = cone.direction(Vec2::new(x, 0.999 * y));
            let nearest = (sphere.center - o).cross(d).length();
            assert!(nearest <= sphere.radius && d.dot(sphere.center - o) > 0.0, "{nearest}");
            let u = cone.square(d);
            assert!(u.distance(Vec2::new(x, 0.999 * y)) < 1e-2, "{u} {x} {y}");
            assert!(view.contains(d) && !view.contains(-d));
        }
    }

    #[test]
    fn rays_start_before_a_box() {
        let bounds = Bounds { min: Vec3::new(-1e6, 0.0, -1e6), max: Vec3::new(1e6, 1.0, 1e6) };
        for i in 0..100 {
            let o = Vec3::new(0.3, 0.5, -0.2);
            let d = (Vec3::from(numbers(i)) - Vec3::new(0.5, 1.2, 0.5)).normalize();
            let start = before(&bounds, o, d);
            assert!(start.y > 1.0 && start.distance(o) < 2e4, "{start}");
            assert!((start - o).cross(d).length() < 0.01);
        }
        let outside = before(&Bounds { min: -Vec3::ONE, max: Vec3::ONE }, Vec3::new(0.0, 0.0, 5.0), -Vec3::Z);
        assert!(outside.z >= 5.0, "{outside}");
    }

    #[test]
    fn spheres_are_joined_until_they_are_few() {
        let all: Vec<BoundingSphere> = (0..100)
            .map(|i| BoundingSphere { center: Vec3::from(numbers(i)) * 10.0, radius: 0.1 + numbers(i)[0] })
            .collect();
        for most in [1, 2, 7, 16] {
            let few = joined(&mut all.clone(), most);
            assert_eq!(few.len(), most);
            for sphere in &all {
                let around = |large: &&BoundingSphere| {
                    large.center.distance(sphere.center) + sphere.radius <= large.radius * MARGIN
                };
                assert!(few.iter().any(|large| around(&large)), "{sphere:?}");
            }
        }
        assert_eq!(joined(&mut all.clone(), 100), all);
        assert!(joined(&mut [], 16).is_empty());
    }
}
