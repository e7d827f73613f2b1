//! Scattering near emitters, by equiangular sampling. [Kulla and Fajardo 2012]
//!
//! In a thin medium a flight seldom ends near an emitter, where most of the light is scattered. So a ray draws a second
//! point in the first homogeneous medium that it meets: it chooses an emitter, and a distance such that directions from
//! the emitter to the point have a uniform angle. The point scatters light of that emitter once; the path does not go
//! on from it. Its weight is that of the power heuristic over all techniques that find the same light: this one, the
//! flight with an emitter sample, and the flight with a direction that hits the emitter.

use crate::color::Rgb;
use crate::emitter::{BoundingSphere, LightSelection};
use crate::math::{DVec3, Vec3};
use crate::medium::{FreeFlight, Homogeneous, Segment};
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
}

/// The point of a leg at which a flight ended.
#[derive(Clone, Copy, Debug)]
pub struct LegPoint {
    leg: Leg,
    distance: f64,
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
        self.sigma_t.map(|sigma| (-sigma * distance).exp() as f32).into()
    }

    /// Returns the density per unit length with which flights end at a distance.
    pub fn flight_density(&self, distance: f64) -> f64 {
        (0..3).map(|c| self.choice[c] * self.sigma_t[c] * (-self.sigma_t[c] * distance).exp()).sum()
    }

    /// Returns the density per unit length of points for an emitter at a distance; 0 if it has none.
    pub fn density(&self, emitter: &BoundingSphere, distance: f64) -> f64 {
        self.angles(emitter).map_or(0.0, |angles| angles.density(distance))
    }

    /// Returns the distance of a point for an emitter, and its density per unit length; `None` if the emitter has none.
    pub fn sample(&self, emitter: &BoundingSphere, u: f32) -> Option<(f64, f64)> {
        let angles = self.angles(emitter)?;
        let u = f64::from(u) + f64::from(lower_digits(u, self.origin.as_vec3()));
        let angle = angles.first + u * (angles.last - angles.first);
        let distance = (angles.nearest + angles.apart * angle.tan()).clamp(0.0, self.length);
        Some((distance, angles.density(distance)))
    }

    /// The extinction coefficient of the channel that reaches farthest.
    fn sigma(&self) -> f64 {
        self.sigma_t.into_iter().fold(f64::INFINITY, f64::min)
    }

    fn angles(&self, emitter: &BoundingSphere) -> Option<Angles> {
        let to_center = emitter.center.as_dvec3() - self.origin;
        let nearest = to_center.dot(self.direction);
        // The points of an emitter are as far apart as its radius. Rounding moves them, too.
        let rounding = f64::from(f32::EPSILON) * emitter.center.as_dvec3().length().max(to_center.length());
        let radius = f64::from(emitter.radius).max(rounding);
        let apart = ((to_center - self.direction * nearest).length_squared() + radius * radius).sqrt();
        let on_leg = nearest.clamp(0.0, self.length);
        let least = (apart * apart + (nearest - on_leg) * (nearest - on_leg)).sqrt();
        let is_near = self.sigma() * least < FARTHEST[0] && self.sigma() * on_leg < FARTHEST[1];
        let angle = |distance: f64| ((distance - nearest) / apart).atan();
        let (first, last) = (angle(0.0), angle(self.length));
        (is_near && apart > 0.0 && first < last).then_some(Angles { nearest, apart, first, last })
    }
}

impl LegPoint {
    /// Returns the point of a leg at a distance from its start.
    pub fn new(leg: Leg, distance: f64) -> Self {
        LegPoint { leg, distance }
    }

    /// Returns the factor from the density with which this technique chooses the point and the emitter, to that with
    /// which a flight and the choice among the emitters there do. `pmf` is the probability of that choice.
    pub fn relative_density(
        &self,
        selection: &LightSelection,
        emitter: usize,
        sphere: &BoundingSphere,
        pmf: f32,
    ) -> f32 {
        let density = self.leg.density(sphere, self.distance);
        // An emitter that is never chosen has no density by either.
        if density == 0.0 || pmf <= 0.0 {
            return 0.0;
        }
        let own = f64::from(selection.pmf(emitter, self.leg.reference())) * density;
        (own / (f64::from(pmf) * self.leg.flight_density(self.distance))) as f32
    }
}

/// The angles from an emitter to the points of a leg, from the perpendicular.
struct Angles {
    /// The distance of the nearest point from the start of the ray; negative behind it.
    nearest: f64,
    /// The distance of that point from the emitter.
    apart: f64,
    first: f64,
    last: f64,
}

impl Angles {
    fn density(&self, distance: f64) -> f64 {
        let x = distance - self.nearest;
        self.apart / ((self.last - self.first) * (self.apart * self.apart + x * x))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn leg(sigma: f64, length: f64) -> Leg {
        Leg {
            origin: DVec3::new(0.0, 0.0, 1.0),
            direction: DVec3::X,
            length,
            sigma_t: [sigma; 3],
            choice: [0.5, 0.25, 0.25],
        }
    }

    #[test]
    fn samples_follow_their_density() {
        let leg = leg(0.1, 5.0);
        for (x, radius) in [(-1.0, 0.0), (2.0, 0.0), (2.0, 0.5), (7.0, 0.1)] {
            let sphere = BoundingSphere { center: Vec3::new(x, 0.3, 1.0), radius };
            const N: u32 = 2000;
            let mut sum = 0.0;
            for i in 0..N {
                let (distance, density) = leg.sample(&sphere, (i as f32 + 0.5) / N as f32).expect("a point");
                assert!((0.0..=5.0).contains(&distance) && density == leg.density(&sphere, distance));
                sum += 1.0 / density / f64::from(N);
            }
            // ∫ 1 = the length.
            assert!((sum - 5.0).abs() < 1e-3, "{x} {radius}: {sum}");
        }
    }

    #[test]
    fn far_emitters_have_no_points() {
        let at = |x: f32, y: f32| BoundingSphere { center: Vec3::new(x, y, 1.0), radius: 0.0 };
        assert!(leg(1.0, 50.0).sample(&at(3.0, 0.5), 0.5).is_some());
        assert!(leg(1.0, 50.0).sample(&at(3.0, 1.5), 0.5).is_none());
        assert!(leg(1.0, 50.0).sample(&at(5.0, 0.5), 0.5).is_none());
        // On the ray, and at its start.
        for x in [3.0, 0.0] {
            let (distance, density) = leg(1.0, f64::INFINITY).sample(&at(x, 0.0), 0.5).expect("a point");
            assert!(distance >= 0.0 && density.is_finite());
        }
    }
}
