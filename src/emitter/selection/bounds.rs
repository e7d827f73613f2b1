//! Bounds on the light of an emitter, or of several. [Conty Estevez and Kulla 2018]

use super::receiver::ReceiverX16;
use crate::math::{Bounds, Vec3, Vec3x16, f32x16};

/// Bounds on the position, the directions and the amount of emitted light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LightBounds {
    /// A box around all points that emit.
    pub bounds: Bounds,
    /// The cone of the normals of the emitting surfaces.
    pub normals: Cone,
    /// The angle to a normal, in radians, beyond which nothing is emitted.
    pub emission_angle: f32,
    /// Radiant intensity along the normals, W·sr⁻¹.
    pub intensity: f32,
    /// The mean position of the light, weighted by intensity.
    pub mean: Vec3,
    /// The mean squared distance of the light from its mean position, weighted by intensity.
    pub variance: f32,
}

/// A cone of directions.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cone {
    /// Unit axis.
    pub axis: Vec3,
    /// Half angle in radians, at most π.
    pub angle: f32,
}

impl Cone {
    /// All directions.
    pub const ALL: Cone = Cone { axis: Vec3::Z, angle: std::f32::consts::PI };

    /// Returns a cone that contains both.
    pub fn union(self, other: Cone) -> Cone {
        let (wide, narrow) = if self.angle >= other.angle { (self, other) } else { (other, self) };
        let between = wide.axis.cross(narrow.axis).length().atan2(wide.axis.dot(narrow.axis));
        if between + narrow.angle <= wide.angle {
            return wide;
        }
        let angle = 0.5 * (wide.angle + between + narrow.angle);
        let turn = wide.axis.cross(narrow.axis).try_normalize();
        match turn {
            Some(turn) if angle < std::f32::consts::PI => {
                let by = angle - wide.angle;
                let axis = wide.axis * by.cos() + turn.cross(wide.axis) * by.sin();
                Cone { axis: axis.normalize(), angle }
            }
            _ => Cone::ALL,
        }
    }

    /// Returns a measure of the directions that surfaces with normals in the cone emit into. [Conty Estevez and Kulla
    /// 2018, eq. 1]
    fn measure(&self, emission_angle: f32) -> f32 {
        let (sin, cos) = self.angle.sin_cos();
        let all = (self.angle + emission_angle).min(std::f32::consts::PI);
        let border = 2.0 * all * sin - (self.angle - 2.0 * all).cos() - 2.0 * self.angle * sin + cos;
        std::f32::consts::TAU * (1.0 - cos) + std::f32::consts::FRAC_PI_2 * border
    }
}

impl LightBounds {
    /// Returns the bounds of an emitter of uniform brightness.
    pub fn new(bounds: Bounds, normals: Cone, emission_angle: f32, intensity: f32) -> LightBounds {
        let variance = bounds.radius() * bounds.radius() / 3.0;
        LightBounds { bounds, normals, emission_angle, intensity, mean: bounds.center(), variance }
    }

    /// Returns bounds of the light of both.
    pub fn union(&self, other: &LightBounds) -> LightBounds {
        let part = self.intensity / (self.intensity + other.intensity);
        // Both intensities may be too small or too large for their sum.
        let part = if part.is_finite() { part } else { 0.5 };
        let mean = self.mean * part + other.mean * (1.0 - part);
        let variance = |light: &LightBounds| light.variance + light.mean.distance_squared(mean);
        LightBounds {
            mean,
            variance: variance(self) * part + variance(other) * (1.0 - part),
            bounds: self.bounds.union(other.bounds),
            normals: self.normals.union(other.normals),
            emission_angle: self.emission_angle.max(other.emission_angle),
            intensity: self.intensity + other.intensity,
        }
    }

    /// Returns the cost of sampling from this cluster instead of from its parts, in arbitrary units. [Conty Estevez
    /// and Kulla 2018, 4.4]
    pub fn cost(&self) -> f32 {
        let size = self.bounds.max - self.bounds.min;
        let area = size.x * size.y + size.y * size.z + size.z * size.x;
        // A cluster on a line has no area.
        let extent = area + 1e-3 * size.length_squared();
        self.intensity * extent * self.normals.measure(self.emission_angle)
    }
}

/// The cosine of a cone of all directions: less than any cosine.
const ALL_DIRECTIONS: f32 = -2.0;

/// Sixteen [`LightBounds`], prepared for [`importance`](Self::importance).
#[derive(Clone, Copy, Debug)]
pub struct LightBoundsX16 {
    center: Vec3x16,
    radius_squared: f32x16,
    axis: Vec3x16,
    cos_normals: f32x16,
    sin_normals: f32x16,
    cos_emission: f32x16,
    intensity: f32x16,
    mean: Vec3x16,
    variance: f32x16,
}

impl LightBoundsX16 {
    /// Bounds without light.
    pub fn none() -> Self {
        LightBoundsX16 {
            center: Vec3x16::default(),
            radius_squared: f32x16::ZERO,
            axis: Vec3x16::default(),
            cos_normals: f32x16::splat(ALL_DIRECTIONS),
            sin_normals: f32x16::ZERO,
            cos_emission: f32x16::ZERO,
            intensity: f32x16::ZERO,
            mean: Vec3x16::default(),
            variance: f32x16::ZERO,
        }
    }

    /// Sets the bounds of one lane.
    pub fn set_lane(&mut self, i: usize, light: &LightBounds) {
        let half = (light.bounds.max - light.bounds.min) * 0.5;
        self.center.set_lane(i, light.bounds.min + half);
        self.axis.set_lane(i, light.normals.axis);
        self.mean.set_lane(i, light.mean);
        let (sin, cos) = light.normals.angle.sin_cos();
        // The cosine of the greatest angle at which light may be emitted is rounded down.
        let cos_emission = light.emission_angle.cos() - 1e-5;
        let cos_emission = if light.emission_angle < 3.1 { cos_emission } else { ALL_DIRECTIONS };
        for (lanes, value) in [
            (&mut self.radius_squared, half.length_squared()),
            (&mut self.cos_normals, if light.normals.angle < 3.1 { cos } else { ALL_DIRECTIONS }),
            (&mut self.sin_normals, sin),
            (&mut self.cos_emission, cos_emission),
            (&mut self.intensity, light.intensity.min(f32::MAX)),
            (&mut self.variance, light.variance),
        ] {
            lanes.as_mut_array()[i] = value;
        }
    }

    /// Returns the bounds of one lane in every lane.
    #[inline]
    pub fn splat_lane(&self, i: usize) -> Self {
        let all = |lanes: &f32x16| f32x16::splat(lanes.as_array()[i]);
        LightBoundsX16 {
            center: Vec3x16::splat(self.center.lane(i)),
            radius_squared: all(&self.radius_squared),
            axis: Vec3x16::splat(self.axis.lane(i)),
            cos_normals: all(&self.cos_normals),
            sin_normals: all(&self.sin_normals),
            cos_emission: all(&self.cos_emission),
            intensity: all(&self.intensity),
            mean: Vec3x16::splat(self.mean.lane(i)),
            variance: all(&self.variance),
        }
    }

    /// Returns an estimate of the irradiance that surfaces at the receiver, which face the light, receive in each lane
    /// if nothing is in between, times the gain of its glossy lobe: never negative, at most 1e30, and 0 where no light
    /// is emitted towards it. [Conty Estevez and Kulla 2018, eq. 3, without the receiver's normal]
    #[inline(always)]
    pub fn importance(&self, receiver: &ReceiverX16) -> f32x16 {
        let p = receiver.p;
        let to = p - self.center;
        let distance_squared = to.length_squared();
        let gain = receiver.gain(-to, distance_squared, self.radius_squared);
        // The angles do not matter to lights with normals in all directions, such as spheres.
        let cos_least = match self.cos_normals.simd_eq(f32x16::splat(ALL_DIRECTIONS)).all() {
            true => f32x16::ONE,
            false => self.cos_least(to, distance_squared),
        };
        let distance_squared = (p - self.mean).length_squared() + self.variance;
        let distance_squared = distance_squared.max(f32x16::splat(f32::MIN_POSITIVE));
        let importance = self.intensity * cos_least / distance_squared;
        let importance = gain.map_or(importance, |gain| importance * gain);
        importance.min(f32x16::splat(1e30))
    }

    /// Returns the cosine of the least angle between a normal of the lights and the direction to a receiver, which is
    /// in the direction `to` from the center; 0 where no light is emitted towards it.
    #[inline(always)]
    fn cos_least(&self, to: Vec3x16, distance_squared: f32x16) -> f32x16 {
        let inside = distance_squared.simd_lt(self.radius_squared);
        // The angle between the axis and the direction to the receiver, less that of the cone of normals.
        let cos = to.dot(self.axis) / distance_squared.sqrt();
        let sin = (f32x16::ONE - cos * cos).max(f32x16::ZERO).sqrt();
        let (cos_beyond, sin_beyond) = beyond(cos, sin, self.cos_normals, self.sin_normals);
        // Less the half angle of the sphere around the light; within the sphere, it grows from 90° to 180°.
        let sin_sphere_squared =
            inside.select(distance_squared / self.radius_squared, self.radius_squared / distance_squared);
        let sin_sphere = sin_sphere_squared.sqrt();
        let cos_sphere = (f32x16::ONE - sin_sphere_squared).max(f32x16::ZERO).sqrt();
        let cos_sphere = inside.select(-cos_sphere, cos_sphere);
        let (cos_least, _) = beyond(cos_beyond, sin_beyond, cos_sphere, sin_sphere);
        let emitted = cos_least.simd_gt(self.cos_emission) & cos_least.simd_gt(f32x16::ZERO);
        cos_least & emitted
    }
}

/// Returns the cosine and sine of an angle less another one, and those of 0 if the other angle is greater.
#[inline(always)]
fn beyond(cos: f32x16, sin: f32x16, cos_less: f32x16, sin_less: f32x16) -> (f32x16, f32x16) {
    let outside = cos.simd_lt(cos_less);
    let cos_difference = cos * cos_less + sin * sin_less;
    let sin_difference = sin * cos_less - cos * sin_less;
    (outside.select(cos_difference, f32x16::ONE), sin_difference & outside)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Whether the angles are left out depends on all lanes, so it must not change a bit of any lane.
    #[test]
    fn lights_in_all_directions_have_the_same_importance_without_their_angles() {
        let light = |i: usize| {
            let corner = Vec3::new(i as f32, 0.5 * i as f32, -1.0);
            let bounds = Bounds { min: corner, max: corner + Vec3::new(1.0, 0.0, 2.0) };
            LightBounds::new(bounds, Cone::ALL, std::f32::consts::FRAC_PI_2, 1.0 + i as f32)
        };
        let mut all = LightBoundsX16::none();
        (0..15).for_each(|i| all.set_lane(i, &light(i)));
        let mut others = all;
        others.set_lane(15, &LightBounds { normals: Cone { axis: Vec3::Z, angle: 0.5 }, ..light(15) });
        // Far away, inside of some bounds, and at the center of one.
        for p in [Vec3::new(50.0, -3.0, 7.0), Vec3::new(2.2, 1.0, 0.1), light(3).bounds.center()] {
            let at = ReceiverX16::from(Vec3x16::splat(p));
            let [all, others] = [all, others].map(|bounds| bounds.importance(&at));
            assert!(all.as_array()[..15].iter().all(|importance| *importance > 0.0));
            assert_eq!(all.as_array()[..15], others.as_array()[..15], "{p}");
            assert_eq!(all.as_array()[15], 0.0);
        }
    }
}
