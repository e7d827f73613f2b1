//! Scattering near emitters, by equiangular sampling. [Kulla and Fajardo 2012]
//!
//! In a thin medium a flight seldom ends near an emitter, where most of the light is scattered. So a ray draws a second
//! point in the first homogeneous medium that it meets: it chooses an emitter, and a distance such that directions from
//! the emitter to the point have a uniform angle, among those into which it emits. The point scatters light of that
//! emitter once; the path does not go on from it. Its weight is that of the power heuristic over all techniques that
//! find the same light: this one, the flight with an emitter sample, and the flight with a direction that hits the
//! emitter.

use crate::emitter::{LightSelection, LitRegion};
use crate::integrator::flight::Entries;
use crate::math::Vec3;
use crate::math::functions::angle_x16;
use crate::math::lanes::{LANES, Vec3x16, f32x16, mask_from_bits};
use crate::medium::exponentials;
use crate::sampling::hash::lower_digits_x16;
use crate::sampling::warp::sin_cos_turn_x16;

/// The greatest optical distance of an emitter from the ray, and of the nearest point on the ray from its start. Beyond
/// them, flights end where the light is as often.
const FARTHEST: [f32; 2] = [0.2, 4.0];

/// The part of a ray in the first homogeneous medium that scatters.
#[derive(Clone, Copy, Debug)]
pub struct Leg {
    origin: Vec3,
    direction: Vec3,
    length: f32,
    /// The extinction coefficients, and the probabilities with which a flight is sampled by them.
    sigma_t: [f32; 3],
    choice: [f32; 3],
    /// An emitter, and its angles.
    found: (usize, Option<Angles>),
}

/// The point of a leg at which a flight ended.
#[derive(Clone, Copy, Debug)]
pub struct LegPoint {
    /// The leg.
    pub leg: Leg,
    /// The distance of the point from its start.
    pub distance: f32,
}

/// The parts of sixteen rays in the first homogeneous media that scatter.
pub struct LegsX16 {
    origin: Vec3x16,
    direction: Vec3x16,
    length: f32x16,
    sigma_t: [f32x16; 3],
    choice: [f32x16; 3],
}

/// What emitters light, in sixteen lanes.
#[derive(Default)]
pub struct RegionsX16 {
    center: Vec3x16,
    radius: [f32; LANES],
    axis: Vec3x16,
    cosine: [f32; LANES],
    /// Masks of the emitters that are not at infinity, and of those that light a cone only.
    near: u32,
    cones: u32,
}

impl RegionsX16 {
    /// Sets what the emitter of a lane lights.
    pub fn set_lane(&mut self, i: usize, region: &LitRegion) {
        self.center.set_lane(i, region.sphere.center);
        self.radius[i] = region.sphere.radius;
        self.near |= 1 << i;
        if let Some((axis, cosine)) = region.cone {
            self.axis.set_lane(i, axis.as_vec3());
            self.cosine[i] = cosine as f32;
            self.cones |= 1 << i;
        }
    }
}

impl LegsX16 {
    /// Returns the parts of rays on which flights begin to be sampled.
    pub fn new(entries: &Entries<'_>) -> Self {
        LegsX16 {
            origin: entries.rays.o,
            direction: entries.directions,
            length: entries.lengths,
            sigma_t: entries.coefficients.sigma_t,
            choice: entries.flight.choice,
        }
    }

    /// Returns points for the choice among the emitters: where flights are likely to end.
    pub fn reference(&self) -> Vec3x16 {
        let [r, g, b] = self.sigma_t;
        let likely = f32x16::ONE / r.fast_max(g).fast_max(b);
        self.at(self.length.fast_min(likely) * f32x16::HALF)
    }

    /// Returns the points at distances from the starts.
    pub fn at(&self, distance: f32x16) -> Vec3x16 {
        self.origin + self.direction * distance
    }

    /// Returns the densities per unit length with which flights end at distances, given the transmittances up to there.
    pub fn flight_density(&self, transmittance: &[f32x16; 3]) -> f32x16 {
        let of = |c: usize| self.choice[c] * self.sigma_t[c] * transmittance[c];
        of(0) + of(1) + of(2)
    }

    /// Returns distances of points for emitters.
    ///
    /// From the start, where the tangent of the angle is a, an angle φ further is the distance
    /// apart·sin φ (1 + a²)/(cos φ − a sin φ): nothing cancels. The further half of the angles is measured from the
    /// end, if that is not farther from the nearest point than the start.
    pub fn sample(&self, angles: &AnglesX16, u: f32x16) -> f32x16 {
        let AnglesX16 { apart, nearest, angle, within: [start, end], .. } = *angles;
        let one = f32x16::ONE;
        let lower = lower_digits_x16(u, self.origin);
        let from_end = u.simd_ge(f32x16::HALF) & (end - nearest).simd_le((start - nearest).abs());
        let part = from_end.select((one - u) - lower, u + lower);
        let (sin, cos) = sin_cos_turn_x16(part * angle);
        let a = from_end.select(nearest - end, start - nearest) / apart;
        let way = apart * sin * (one + a * a) / (cos - a * sin);
        // Rounding may move the end beyond all distances.
        let way = (cos - a * sin).simd_gt(f32x16::ZERO).select(way, f32x16::splat(f32::MAX));
        from_end.select(end - way, start + way).fast_max(start).fast_min(end)
    }

    /// Returns the angles from emitters to the points of the legs that they may light.
    pub fn angles(&self, regions: &RegionsX16) -> AnglesX16 {
        let (zero, one) = (f32x16::ZERO, f32x16::ONE);
        let largest = |v: Vec3x16| {
            let v = v.abs();
            v.x.fast_max(v.y).fast_max(v.z)
        };
        let to_center = regions.center - self.origin;
        let nearest = to_center.dot(self.direction);
        // The points of an emitter are as far apart as its radius. Rounding moves them, too.
        let rounding =
            f32x16::splat(2.0 * f32::EPSILON) * largest(regions.center).fast_max(largest(to_center));
        let radius = f32x16::new(regions.radius).fast_max(rounding);
        let foot = self.direction * nearest - to_center;
        let apart = (foot.length_squared() + radius * radius).sqrt();
        let on_leg = nearest.fast_max(zero).fast_min(self.length);
        let least = (apart * apart + (nearest - on_leg) * (nearest - on_leg)).sqrt();
        let [across, along] = FARTHEST.map(f32x16::splat);
        let [r, g, b] = self.sigma_t;
        let clearest = r.fast_min(g).fast_min(b);
        let mut some = mask_from_bits(regions.near)
            & (clearest * least).simd_lt(across)
            & (clearest * on_leg).simd_lt(along)
            & apart.simd_gt(zero);
        let [mut start, mut end] = [zero, self.length];
        let cones = mask_from_bits(regions.cones);
        if (cones & some).any() {
            let cosine = f32x16::new(regions.cosine);
            let (lit, [least, greatest]) =
                lit_tangents_x16((regions.axis, cosine), self.direction, foot / apart);
            some &= lit | !cones;
            start = cones.select((nearest + apart * least).fast_max(start), start);
            end = cones.select((nearest + apart * greatest).fast_min(end), end);
        }
        some &= start.simd_lt(end);
        let (a, b) = ((start - nearest) / apart, (end - nearest) / apart);
        // The squares of greater tangents may be infinite.
        let finite = b.simd_lt(f32x16::splat(1e15));
        let sin = finite.select((end - start) / apart, one);
        let cos = finite.select(one + a * b, a);
        let angle = angle_x16(some.select(sin, one), some.select(cos, zero));
        some &= angle.simd_gt(zero);
        AnglesX16 { some, nearest, apart, angle, within: [start, end] }
    }

    /// Returns the leg of a lane, with the angles of an emitter.
    pub fn lane(&self, i: usize, emitter: usize, angles: &AnglesX16) -> Leg {
        let of = |value: f32x16| value.as_array()[i];
        Leg {
            origin: self.origin.lane(i),
            direction: self.direction.lane(i),
            length: of(self.length),
            sigma_t: self.sigma_t.map(of),
            choice: self.choice.map(of),
            found: (emitter, (angles.some.to_bitmask() >> i & 1 == 1).then(|| angles.lane(i))),
        }
    }
}

impl Leg {
    /// Returns a point for the choice among the emitters: where a flight is likely to end.
    fn reference(&self) -> Vec3 {
        let largest = self.sigma_t.into_iter().fold(0.0, f32::max);
        self.origin + self.direction * (self.length.min(1.0 / largest) * 0.5)
    }

    /// Returns the density per unit length with which flights end at a distance.
    fn flight_density(&self, distance: f32) -> f64 {
        let transmittance = exponentials(self.sigma_t.map(|sigma| f64::from(-sigma * distance)));
        (0..3).map(|c| f64::from(self.choice[c] * self.sigma_t[c]) * transmittance[c]).sum()
    }

    /// Returns the density per unit length of points for an emitter at a distance; 0 if it has none.
    fn density(&self, emitter: usize, region: &LitRegion, distance: f32) -> f32 {
        let angles = match self.found {
            (found, angles) if found == emitter => angles,
            _ => self.angles(region),
        };
        angles.map_or(0.0, |angles| angles.density(distance))
    }

    /// Returns the angles from an emitter to the points of the leg that it may light.
    fn angles(&self, region: &LitRegion) -> Option<Angles> {
        let mut regions = RegionsX16::default();
        regions.set_lane(0, region);
        let splat = Vec3x16::splat;
        let legs = LegsX16 {
            origin: splat(self.origin),
            direction: splat(self.direction),
            length: f32x16::splat(self.length),
            sigma_t: self.sigma_t.map(f32x16::splat),
            choice: self.choice.map(f32x16::splat),
        };
        let angles = legs.angles(&regions);
        (angles.some.to_bitmask() & 1 == 1).then(|| angles.lane(0))
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
        let own = f64::from(selection.pmf(emitter, self.leg.reference())) * f64::from(density);
        (own / (f64::from(pmf) * self.leg.flight_density(self.distance))) as f32
    }
}

/// Returns the bounds of the tangents of the angles at which lines in the directions `d` are in cones, seen from their
/// apexes, and a mask of the lines that are in them somewhere. Angles are from the perpendiculars `foot` to the lines,
/// whose lengths are at most 1: they are the units of distances.
fn lit_tangents_x16((axis, cosine): (Vec3x16, f32x16), d: Vec3x16, foot: Vec3x16) -> (f32x16, [f32x16; 2]) {
    let zero = f32x16::ZERO;
    // At the angle φ, the cosine of the angle to the axis is along·cos φ + across·sin φ = r·cos (φ − middle).
    let (along, across) = (axis.dot(foot), axis.dot(d));
    let r = (along * along + across * across).sqrt();
    let (cos, sin) = (along / r, across / r);
    let half_cos = cosine / r;
    let half_sin = (f32x16::ONE - half_cos * half_cos).fast_max(zero).sqrt();
    let least = [cos * half_cos + sin * half_sin, sin * half_cos - cos * half_sin];
    let greatest = [cos * half_cos - sin * half_sin, sin * half_cos + cos * half_sin];
    // A border with a cosine that is not positive is beyond an end of the line. The cone then contains the end that is
    // on the side of the middle. A line at right angles to the axis is lit as a whole, or nowhere.
    let level = across.simd_eq(zero) & along.simd_gt(zero);
    let tangent = |[cos, sin]: [f32x16; 2], reaches: f32x16, beyond: f32| {
        let before = cos.simd_gt(zero);
        (before | level | reaches, before.select(sin / cos, f32x16::splat(beyond)))
    };
    let (has_least, least) = tangent(least, across.simd_lt(zero), f32::NEG_INFINITY);
    let (has_greatest, greatest) = tangent(greatest, across.simd_gt(zero), f32::INFINITY);
    (r.simd_gt(cosine) & has_least & has_greatest, [least, greatest])
}

/// The angles from sixteen emitters to the points of legs that they may light.
#[derive(Clone, Copy, Debug)]
pub struct AnglesX16 {
    /// A mask of the lanes with such points.
    pub some: f32x16,
    /// The distances of the nearest points from the starts of the rays; negative behind them.
    nearest: f32x16,
    /// The distances of those points from the emitters.
    apart: f32x16,
    /// The differences of the angles of the last and the first point.
    angle: f32x16,
    /// The distances of these points from the starts of the rays.
    within: [f32x16; 2],
}

impl AnglesX16 {
    /// Returns the densities of points at distances of legs.
    pub fn density(&self, distance: f32x16) -> f32x16 {
        let x = distance - self.nearest;
        self.apart / (self.angle * (self.apart * self.apart + x * x))
    }

    fn lane(&self, i: usize) -> Angles {
        let of = |value: f32x16| value.as_array()[i];
        let AnglesX16 { nearest, apart, angle, within, .. } = *self;
        Angles { nearest: of(nearest), apart: of(apart), angle: of(angle), within: within.map(of) }
    }
}

/// [`AnglesX16`] for one emitter.
#[derive(Clone, Copy, Debug)]
struct Angles {
    nearest: f32,
    apart: f32,
    angle: f32,
    within: [f32; 2],
}

impl Angles {
    fn density(&self, distance: f32) -> f32 {
        if !(self.within[0]..=self.within[1]).contains(&distance) {
            return 0.0;
        }
        let x = distance - self.nearest;
        self.apart / (self.angle * (self.apart * self.apart + x * x))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::emitter::BoundingSphere;
    use crate::math::DVec3;

    /// Rays along the x axis, in all lanes.
    fn legs(sigma: f32, length: f32) -> LegsX16 {
        LegsX16 {
            origin: Vec3x16::splat(Vec3::Z),
            direction: Vec3x16::splat(Vec3::X),
            length: f32x16::splat(length),
            sigma_t: [f32x16::splat(sigma); 3],
            choice: [0.5, 0.25, 0.25].map(f32x16::splat),
        }
    }

    fn region(x: f32, y: f32, radius: f32, cone: Option<(DVec3, f64)>) -> LitRegion {
        LitRegion { sphere: BoundingSphere { center: Vec3::new(x, y, 1.0), radius }, cone }
    }

    /// Returns the angles of an emitter; `None` if it has no points.
    fn angles(legs: &LegsX16, region: &LitRegion) -> Option<AnglesX16> {
        let mut regions = RegionsX16::default();
        (0..LANES).for_each(|i| regions.set_lane(i, region));
        let angles = legs.angles(&regions);
        assert!(angles.some.all() || !angles.some.any());
        angles.some.all().then_some(angles)
    }

    /// Returns the length on which points are found for an emitter, from its samples.
    fn length_with_points(legs: &LegsX16, region: &LitRegion) -> Option<f64> {
        const N: u32 = 2000;
        let angles = angles(legs, region)?;
        let mut sum = 0.0;
        for i in 0..N {
            let distance = legs.sample(&angles, f32x16::splat((i as f32 + 0.5) / N as f32));
            let density = angles.density(distance).as_array()[7];
            let distance = distance.as_array()[7];
            assert!((0.0..=legs.length.as_array()[0]).contains(&distance));
            // The leg of one lane has the same density, whether it has found the emitter before or not.
            for emitter in [0, 1] {
                assert_eq!(density, legs.lane(5, emitter, &angles).density(0, region, distance));
            }
            sum += 1.0 / f64::from(density) / f64::from(N);
        }
        Some(sum)
    }

    #[test]
    fn samples_follow_their_density() {
        for (x, radius) in [(-1.0, 0.0), (2.0, 0.0), (2.0, 0.5), (7.0, 0.1)] {
            // ∫ 1 = the length.
            let found = length_with_points(&legs(0.01, 5.0), &region(x, 0.3, radius, None)).expect("points");
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
            let found = length_with_points(&legs(0.01, 5.0), &region).unwrap_or(0.0);
            assert!((found - expected).abs() < 2e-3, "{x} {axis} {angle}: {found}, expected {expected}");
            let angles = angles(&legs(0.01, 5.0), &region);
            for i in 0..500 {
                let t = (f64::from(i) + 0.5) * 0.01;
                let is_near_border = [-1e-3, 1e-3].iter().any(|d| is_lit(t + d) != is_lit(t));
                let density = angles.as_ref().map_or(0.0, |angles| angles.lane(3).density(t as f32));
                assert!(is_near_border || (density > 0.0) == is_lit(t), "{t}");
            }
        }
    }

    /// Distances are exact for emitters beside the ray by a small part of its length, also from the far end.
    #[test]
    fn distances_have_the_angles_of_their_numbers() {
        for (x, y, length) in [
            (2.0, 1e-3, 5.0),
            (0.5, 1e-4, 5.0),
            (3.0, 0.5, f32::INFINITY),
            (3.0, 0.5, 1e30),
            (-1.0, 0.5, 4.0),
        ] {
            let (legs, region) = (legs(0.01, length), region(x, y, 0.0, None));
            let angles = angles(&legs, &region).expect("points");
            let (x, y) = (f64::from(x), f64::from(y));
            let [first, last] = [0.0, f64::from(length)].map(|end| ((end - x) / y).atan());
            for u in [1e-6f32, 0.01, 0.3, 0.5, 0.7, 0.99, 1.0 - 1e-6] {
                let found = legs.sample(&angles, f32x16::splat(u)).as_array()[2];
                let part = (((f64::from(found) - x) / y).atan() - first) / (last - first);
                // Rounding of the position moves the angle.
                let step = 8.0 * f64::from(f32::EPSILON) * (x.abs() / y + 1.0);
                assert!((part - f64::from(u)).abs() < step, "{x} {y} {u}: {part}");
            }
        }
    }

    #[test]
    fn far_emitters_have_no_points() {
        let has = |sigma: f32, length: f32, x: f32, y: f32| {
            angles(&legs(sigma, length), &region(x, y, 0.0, None)).is_some()
        };
        assert!(has(1.0, 50.0, 3.0, 0.1));
        assert!(!has(1.0, 50.0, 3.0, 0.3));
        assert!(!has(1.0, 50.0, 5.0, 0.1));
        // On the ray, and at its start.
        for x in [3.0, 0.0] {
            let legs = legs(1.0, f32::INFINITY);
            let angles = angles(&legs, &region(x, 0.0, 0.0, None)).expect("points");
            let distance = legs.sample(&angles, f32x16::HALF);
            let (distance, density) = (distance.as_array()[0], angles.density(distance).as_array()[0]);
            assert!(distance >= 0.0 && density.is_finite());
        }
    }
}
