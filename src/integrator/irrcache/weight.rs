//! The weight of a record at a point.
//!
//! The weight is 1 − max(εₚ, εₙ). It falls linearly to zero as the position or the normal reaches the record's limit,
//! so the interpolated irradiance is continuous. [Tabellion and Lamorlette 2004, 4.2] εₚ is the distance divided by
//! the record's radius. Distance along the normal counts three times, so that a record does not reach the other side
//! of a wall or the next step of stairs. εₙ is the square root of (1 − n·n′)/(1 − cos α).

use super::record::Record;
use crate::math::Vec3;
use crate::math::lanes::{LANES, Vec3x16, f32x16};

/// The factor on the squared distance along the normal, minus 1.
const ALONG_NORMAL: f32 = 8.0;
/// The extent of a record along its normal, relative to its radius.
pub const THICKNESS: f32 = 1.0 / 3.0;
/// 1 / (1 − cos α), where α = 20° is the angle between normals at which the weight becomes zero.
const PER_ANGLE: f32 = 16.581_72;

/// Returns the weight, in [0, 1], of a record at the point `p` of a surface with the normal `n`.
pub fn weight(record: &Record, p: Vec3, n: Vec3) -> f32 {
    let to = p - record.p;
    let along = to.dot(record.n);
    let distance = (to.length_squared() + ALONG_NORMAL * along * along) / (record.radius * record.radius);
    let turn = (1.0 - n.dot(record.n)) * PER_ANGLE;
    (1.0 - distance.max(turn).max(0.0).sqrt()).max(0.0)
}

/// The positions, normals and radii of sixteen records. Inactive lanes have a reciprocal radius of infinity.
#[derive(Clone, Copy, Debug)]
pub struct RecordsX16 {
    p: Vec3x16,
    n: Vec3x16,
    per_radius: f32x16,
}

impl RecordsX16 {
    /// Stores up to sixteen records.
    pub fn new<'a>(records: impl IntoIterator<Item = &'a Record>) -> Self {
        let mut points = RecordsX16 {
            p: Vec3x16::default(),
            n: Vec3x16::default(),
            per_radius: f32x16::splat(f32::INFINITY),
        };
        for (i, record) in records.into_iter().take(LANES).enumerate() {
            points.p.set_lane(i, record.p);
            points.n.set_lane(i, record.n);
            points.per_radius.as_mut_array()[i] = 1.0 / record.radius;
        }
        points
    }

    /// Computes [`weight`] for all records.
    #[inline(always)]
    pub fn weights(&self, p: Vec3x16, n: Vec3x16) -> f32x16 {
        let to = p - self.p;
        let along = to.dot(self.n);
        let distance = (to.length_squared() + f32x16::splat(ALONG_NORMAL) * along * along)
            * (self.per_radius * self.per_radius);
        let turn = (f32x16::ONE - n.dot(self.n)) * f32x16::splat(PER_ANGLE);
        let used = self.per_radius.simd_lt(f32x16::splat(f32::INFINITY));
        let far = distance.fast_max(turn).fast_max(f32x16::ZERO);
        (f32x16::ONE - far.sqrt()).fast_max(f32x16::ZERO) & used
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn record() -> Record {
        Record { p: Vec3::new(1.0, 2.0, 3.0), n: Vec3::Z, radius: 0.5, ..Record::default() }
    }

    #[test]
    fn the_weight_falls_to_zero_at_the_radius_and_at_the_angle() {
        let record = record();
        let at = |offset: Vec3, n: Vec3| weight(&record, record.p + offset, n);
        assert_eq!(at(Vec3::ZERO, Vec3::Z), 1.0);
        assert!((at(Vec3::X * 0.25, Vec3::Z) - 0.5).abs() < 1e-6);
        assert_eq!(at(Vec3::X * 0.51, Vec3::Z), 0.0);
        assert_eq!(at(Vec3::Z * (0.5 * THICKNESS + 1e-3), Vec3::Z), 0.0);
        assert_eq!(at(Vec3::ZERO, -Vec3::Z), 0.0);
        let (sin, cos) = 19.9f32.to_radians().sin_cos();
        assert!(at(Vec3::ZERO, Vec3::new(sin, 0.0, cos)) > 0.0);
        let (sin, cos) = 20.1f32.to_radians().sin_cos();
        assert_eq!(at(Vec3::ZERO, Vec3::new(sin, 0.0, cos)), 0.0);
    }

    #[test]
    fn sixteen_weights_are_those_of_the_records() {
        let records: Vec<Record> =
            (0..5).map(|i| Record { radius: 0.2 + 0.1 * i as f32, ..record() }).collect();
        let points = RecordsX16::new(&records);
        let (p, n) = (Vec3::new(1.2, 2.1, 3.05), Vec3::new(0.1, 0.0, 0.995));
        let weights = points.weights(Vec3x16::splat(p), Vec3x16::splat(n)).to_array();
        for (i, w) in weights.into_iter().enumerate() {
            let expected = records.get(i).map_or(0.0, |record| weight(record, p, n));
            assert!((w - expected).abs() < 1e-6, "lane {i}: {w} instead of {expected}");
        }
    }
}
