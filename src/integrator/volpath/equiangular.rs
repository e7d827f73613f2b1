//! Scattering near emitters, by equiangular sampling. [Kulla and Fajardo 2012]
//!
//! In a thin medium a flight seldom ends near an emitter, where most of the light is scattered. So a ray draws a second
//! point in the first homogeneous medium that it meets: it chooses an emitter, and a distance such that directions from
//! the emitter to the point have a uniform angle, among those into which it emits. The point scatters light of that
//! emitter once; the path does not go on from it. Its weight is that of the power heuristic over all techniques that
//! find the same light: this one, the flight with an emitter sample, and the flight with a direction that hits the
//! emitter.

use crate::color::Rgb;
use crate::emitter::{LightSelection, LitRegion};
use crate::math::{DVec3, Vec3};
use crate::medium::{FreeFlight, Homogeneous, Segment, exponentials};
use crate::sampling::hash::lower_digits;

/// The greatest optical distance of an emitter from the ray, and of the nearest point on the ray from its start. Beyond
/// them, flights end where the light is as often.
const FARTHEST: [f64; 2] = [1.0, 4.0];

/// The part of a ray in the first medium that scatters, if that is homogeneous.
#[derive(Clone, Copy, Debug)]
pub struct Leg {
    origin: DVec3,
    direction: DVec3,
    length: f64,
    /// The extinction coefficients, and the probabilities with which a flight is sampled by them.
    sigma_t: [f64; 3],
    choice: [f64; 3],
    /// An emitter, and its angles.
    found: Option<(usize, Option<Angles>)>,
}

/// The point of a leg at which a flight ended.
#[derive(Clone, Copy, Debug)]
pub struct LegPoint {
    /// The leg.
    pub leg: Leg,
    /// The distance of the point from its start.
    pub distance: f64,
}

impl Leg {
    /// Returns the part of a ray on which `flight` begins to be sampled.
    pub fn new(medium: &Homogeneous, segment: &Segment, flight: &FreeFlight) -> Self {
        Leg {
            origin: segment.origin.as_dvec3(),
            direction: segment.direction.as_dvec3(),
            length: segment.length,
            sigma_t: medium.sigma_t.to_array().map(f64::from),
            choice: flight.choice(),
            found: None,
        }
    }

    /// Returns a point for the choice among the emitters: where a flight is likely to end.
    pub fn reference(&self) -> Vec3 {
        let largest = self.sigma_t.into_iter().fold(0.0, f64::max);
        self.at(self.length.min(1.0 / largest) * 0.5)
    }

    /// Returns the point at a distance from the start.
    pub fn at(&self, distance: f64) -> Vec3 {
        (self.origin + self.direction * distance).as_vec3()
    }

    /// Returns the transmittance from the start to a distance.
    pub fn transmittance(&self, distance: f64) -> Rgb {
        exponentials(self.sigma_t.map(|sigma| -sigma * distance)).map(|t| t as f32).into()
    }

    /// Returns the density per unit length with which flights end at a distance.
    pub fn flight_density(&self, distance: f64) -> f64 {
        let transmittance = exponentials(self.sigma_t.map(|sigma| -sigma * distance));
        (0..3).map(|c| self.choice[c] * self.sigma_t[c] * transmittance[c]).sum()
    }

    /// Returns the density per unit length of points for an emitter at a distance; 0 if it has none.
    pub fn density(&self, emitter: usize, region: &LitRegion, distance: f64) -> f64 {
        let angles = match self.found {
            Some((found, angles)) if found == emitter => angles,
            _ => self.angles(region),
        };
        angles.map_or(0.0, |angles| angles.density(distance))
    }

    /// Returns the distance of a point for an emitter, and its density per unit length; `None` if the emitter has none.
    pub fn sample(&mut self, emitter: usize, region: &LitRegion, u: f32) -> Option<(f64, f64)> {
        let angles = self.angles(region);
        self.found = Some((emitter, angles));
        let angles = angles?;
        let u = f64::from(u) + f64::from(lower_digits(u, self.origin.as_vec3()));
        let angle = angles.first + u * (angles.last - angles.first);
        let distance =
            (angles.nearest + angles.apart * angle.tan()).clamp(angles.within[0], angles.within[1]);
        Some((distance, angles.density(distance)))
    }

    /// The extinction coefficient of the channel that reaches farthest.
    fn sigma(&self) -> f64 {
        self.sigma_t.into_iter().fold(f64::INFINITY, f64::min)
    }

    fn angles(&self, region: &LitRegion) -> Option<Angles> {
        let emitter = &region.sphere;
        let to_center = emitter.center.as_dvec3() - self.origin;
        let nearest = to_center.dot(self.direction);
        // The points of an emitter are as far apart as its radius. Rounding moves them, too.
        let rounding = f64::from(f32::EPSILON) * emitter.center.as_dvec3().length().max(to_center.length());
        let radius = f64::from(emitter.radius).max(rounding);
        let apart = ((to_center - self.direction * nearest).length_squared() + radius * radius).sqrt();
        let on_leg = nearest.clamp(0.0, self.length);
        let least = (apart * apart + (nearest - on_leg) * (nearest - on_leg)).sqrt();
        let is_near = self.sigma() * least < FARTHEST[0] && self.sigma() * on_leg < FARTHEST[1];
        if !(is_near && apart > 0.0) {
            return None;
        }
        let [mut start, mut end] = [0.0, self.length];
        if let Some(cone) = region.cone {
            let [least, greatest] =
                lit_tangents(cone, self.direction, (self.direction * nearest - to_center) / apart)?;
            start = (nearest + apart * least).max(start);
            end = (nearest + apart * greatest).min(end);
        }
        let angle = |distance: f64| ((distance - nearest) / apart).atan();
        let (first, last) = (angle(start), angle(end));
        (start <= end && first < last).then_some(Angles { nearest, apart, first, last, within: [start, end] })
    }
}

impl LegPoint {
    /// Returns the factor from the density with which this technique chooses the point and the emitter, to that with
    /// which a flight and the choice among the emitters there do. `pmf` is the probability of that choice.
    pub fn relative_density(
        &self,
        selection: &LightSelection,
        emitter: usize,
        region: &LitRegion,
        pmf: f32,
    ) -> f32 {
        let density = self.leg.density(emitter, region, self.distance);
        // An emitter that is never chosen has no density by either.
        if density == 0.0 || pmf <= 0.0 {
            return 0.0;
        }
        let own = f64::from(selection.pmf(emitter, self.leg.reference())) * density;
        (own / (f64::from(pmf) * self.leg.flight_density(self.distance))) as f32
    }
}

/// Returns the bounds of the tangents of the angles at which a line in the direction `d` is in a cone, seen from its
/// apex. Angles are from the perpendicular `foot` to the line, whose length is at most 1: it is the unit of distances.
fn lit_tangents((axis, cosine): (DVec3, f64), d: DVec3, foot: DVec3) -> Option<[f64; 2]> {
    // At the angle φ, the cosine of the angle to the axis is along·cos φ + across·sin φ = r·cos (φ − middle).
    let (along, across) = (axis.dot(foot), axis.dot(d));
    let r = (along * along + across * across).sqrt();
    if r <= cosine {
        return None;
    }
    let (cos, sin) = (along / r, across / r);
    let half_cos = cosine / r;
    let half_sin = (1.0 - half_cos * half_cos).max(0.0).sqrt();
    let least = [cos * half_cos + sin * half_sin, sin * half_cos - cos * half_sin];
    let greatest = [cos * half_cos - sin * half_sin, sin * half_cos + cos * half_sin];
    // A border with a cosine that is not positive is beyond an end of the line. The cone then contains the end that is
    // on the side of the middle. A line at right angles to the axis is lit as a whole, or nowhere.
    let reaches = |beyond: f64| if across == 0.0 { along > 0.0 } else { across * beyond > 0.0 };
    let tangent = |[cos, sin]: [f64; 2], beyond: f64| match cos > 0.0 {
        true => Some(sin / cos),
        false => reaches(beyond).then_some(beyond),
    };
    Some([tangent(least, f64::NEG_INFINITY)?, tangent(greatest, f64::INFINITY)?])
}

/// The angles from an emitter to the points of a leg that it may light, from the perpendicular.
#[derive(Clone, Copy, Debug)]
struct Angles {
    /// The distance of the nearest point from the start of the ray; negative behind it.
    nearest: f64,
    /// The distance of that point from the emitter.
    apart: f64,
    first: f64,
    last: f64,
    /// The distances of these points from the start of the ray.
    within: [f64; 2],
}

impl Angles {
    fn density(&self, distance: f64) -> f64 {
        if !(self.within[0]..=self.within[1]).contains(&distance) {
            return 0.0;
        }
        let x = distance - self.nearest;
        self.apart / ((self.last - self.first) * (self.apart * self.apart + x * x))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::emitter::BoundingSphere;

    fn leg(sigma: f64, length: f64) -> Leg {
        Leg {
            origin: DVec3::new(0.0, 0.0, 1.0),
            direction: DVec3::X,
            length,
            sigma_t: [sigma; 3],
            choice: [0.5, 0.25, 0.25],
            found: None,
        }
    }

    fn region(x: f32, y: f32, radius: f32, cone: Option<(DVec3, f64)>) -> LitRegion {
        LitRegion { sphere: BoundingSphere { center: Vec3::new(x, y, 1.0), radius }, cone }
    }

    /// Returns the length on which points are found for an emitter, from its samples.
    fn length_with_points(leg: &Leg, region: &LitRegion) -> Option<f64> {
        const N: u32 = 2000;
        let mut sum = 0.0;
        for i in 0..N {
            let mut sampled = *leg;
            let (distance, density) = sampled.sample(0, region, (i as f32 + 0.5) / N as f32)?;
            assert!((0.0..=leg.length).contains(&distance));
            assert!(
                density == leg.density(0, region, distance)
                    && density == sampled.density(0, region, distance)
            );
            sum += 1.0 / density / f64::from(N);
        }
        Some(sum)
    }

    #[test]
    fn samples_follow_their_density() {
        for (x, radius) in [(-1.0, 0.0), (2.0, 0.0), (2.0, 0.5), (7.0, 0.1)] {
            // ∫ 1 = the length.
            let found = length_with_points(&leg(0.1, 5.0), &region(x, 0.3, radius, None)).expect("points");
            assert!((found - 5.0).abs() < 1e-3, "{x} {radius}: {found}");
        }
    }

    #[test]
    fn cones_have_all_of_the_points_in_them() {
        let right = std::f64::consts::FRAC_PI_2;
        for (x, axis, angle, radius) in [
            (2.0, Vec3::NEG_Y, 0.4, 0.0),
            (2.0, Vec3::new(0.6, -0.8, 0.0), 0.3, 0.0),
            (2.0, Vec3::new(-0.6, -0.64, 0.48), 0.7, 0.0),
            (-1.0, Vec3::X, 0.5, 0.0),
            (6.0, Vec3::new(-0.8, -0.6, 0.0), 1.4, 0.0),
            (2.0, Vec3::Y, 0.5, 0.0),
            (2.0, Vec3::new(0.8, 0.6, 0.0), 1.5, 0.0),
            (2.0, Vec3::new(-0.8, 0.6, 0.0), 1.5, 0.0),
            // Half-spaces: the nearest point is in front, behind, and on the border.
            (2.0, Vec3::NEG_Y, right, 0.0),
            (2.0, Vec3::Y, right, 0.0),
            (2.0, Vec3::X, right, 0.0),
            (2.0, Vec3::new(0.6, 0.8, 0.0), right, 0.4),
            (2.0, Vec3::new(-0.6, 0.8, 0.0), right, 0.4),
            (2.0, Vec3::new(0.6, -0.8, 0.0), right, 0.4),
        ] {
            let (axis, cosine) = (axis.as_dvec3(), if angle == right { 0.0 } else { f64::cos(angle) });
            let region = region(x, 0.3, radius, Some((axis, cosine)));
            let is_lit = |t: f64| {
                let from = DVec3::new(t - f64::from(x), -0.3, 0.0);
                from.normalize().dot(axis) >= cosine
            };
            let expected = (0..50_000).filter(|i| is_lit((f64::from(*i) + 0.5) * 1e-4)).count() as f64 * 1e-4;
            let found = length_with_points(&leg(0.1, 5.0), &region).unwrap_or(0.0);
            assert!((found - expected).abs() < 2e-3, "{x} {axis} {angle}: {found}, expected {expected}");
            for i in 0..500 {
                let t = (f64::from(i) + 0.5) * 0.01;
                let is_near_border = [-1e-3, 1e-3].iter().any(|d| is_lit(t + d) != is_lit(t));
                assert!(is_near_border || (leg(0.1, 5.0).density(0, &region, t) > 0.0) == is_lit(t), "{t}");
            }
        }
    }

    #[test]
    fn far_emitters_have_no_points() {
        let sample = |sigma: f64, length: f64, x: f32, y: f32| {
            leg(sigma, length).sample(0, &region(x, y, 0.0, None), 0.5)
        };
        assert!(sample(1.0, 50.0, 3.0, 0.5).is_some());
        assert!(sample(1.0, 50.0, 3.0, 1.5).is_none());
        assert!(sample(1.0, 50.0, 5.0, 0.5).is_none());
        // On the ray, and at its start.
        for x in [3.0, 0.0] {
            let (distance, density) = sample(1.0, f64::INFINITY, x, 0.0).expect("a point");
            assert!(distance >= 0.0 && density.is_finite());
        }
    }
}
