//! Animated transforms with keys.

use super::{DAffine3, DMat3, DQuat, DVec3};

/// A transform as a function of time. It is interpolated between keys and constant before the first and after the
/// last.
///
/// Between two keys, translation and scale are linear and the rotation has constant angular velocity. [Shoemake 1985]
/// Keys with shear have no such decomposition; their matrices are interpolated linearly.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Motion {
    /// The keys, at least one, by increasing time.
    keys: Vec<Key>,
}

/// The transform at one time.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
struct Key {
    time: f64,
    transform: DAffine3,
}

/// The largest error of a decomposed transform's entries, relative to the transform, for which it counts as free of
/// shear.
const SHEAR: f64 = 1e-6;

impl From<DAffine3> for Motion {
    fn from(transform: DAffine3) -> Self {
        Motion { keys: vec![Key { time: 0.0, transform }] }
    }
}

impl Default for Motion {
    fn default() -> Self {
        DAffine3::IDENTITY.into()
    }
}

impl Motion {
    /// Creates a transform from keys; `None` without keys, or if the times do not increase.
    pub fn new(keys: Vec<(f64, DAffine3)>) -> Option<Self> {
        let increasing = keys.windows(2).all(|pair| pair[0].0 < pair[1].0);
        let finite = keys.iter().all(|key| key.0.is_finite());
        let keys: Vec<Key> = keys.into_iter().map(|(time, transform)| Key { time, transform }).collect();
        (!keys.is_empty() && increasing && finite).then_some(Motion { keys })
    }

    /// Returns the transforms at the keys, by increasing time.
    pub fn keys(&self) -> impl Iterator<Item = DAffine3> {
        self.keys.iter().map(|key| key.transform)
    }

    /// Returns the transform if it is constant.
    pub fn fixed(&self) -> Option<DAffine3> {
        let first = self.keys[0].transform;
        self.keys.iter().all(|key| key.transform == first).then_some(first)
    }

    /// Returns the transform at a time.
    pub fn at(&self, time: f64) -> DAffine3 {
        let after = self.keys.partition_point(|key| key.time <= time);
        let Some(before) = after.checked_sub(1) else { return self.keys[0].transform };
        let a = self.keys[before];
        let Some(b) = self.keys.get(after) else { return a.transform };
        interpolate(a.transform, b.transform, (time - a.time) / (b.time - a.time))
    }

    /// Returns the transforms at equally spaced times from `open` to `close`. There are as many as needed for linear
    /// interpolation to be accurate to `tolerance` times the size of the moving object, but at most `most`.
    pub fn steps(&self, open: f64, close: f64, tolerance: f64, most: usize) -> Vec<DAffine3> {
        if self.fixed().is_some() || open >= close {
            return vec![self.at(open)];
        }
        let at = |n: usize, i: f64| self.at(open + (close - open) * i / n as f64);
        let mut n = 1;
        // Doubling reaches a key inside the interval only if its position is a dyadic fraction. Otherwise the limit
        // on the number of steps bounds the error.
        while 2 * n < most {
            let off = (0..2 * n).map(|i| {
                // Tests at one and three quarters of a step, so that a key in the middle of the step is detected.
                let (i, f) = (i / 2, if i % 2 == 0 { 0.25 } else { 0.5 });
                let (a, b) = (at(n, i as f64), at(n, i as f64 + 1.0));
                difference(lerp(a, b, f), at(n, i as f64 + f))
            });
            if off.fold(0.0, f64::max) <= tolerance {
                break;
            }
            n *= 2;
        }
        (0..=n).map(|i| at(n, i as f64)).collect()
    }
}

/// Returns the largest difference of two transforms for points of the unit cube, relative to the transformed cube's
/// size.
fn difference(a: DAffine3, b: DAffine3) -> f64 {
    let size = a.matrix3.to_cols_array().iter().fold(0.0, |m: f64, v| m.max(v.abs()));
    let matrix = (a.matrix3 - b.matrix3).to_cols_array().iter().fold(0.0, |m: f64, v| m.max(v.abs()));
    (matrix + (a.translation - b.translation).abs().max_element()) / size.max(f64::MIN_POSITIVE)
}

fn lerp(a: DAffine3, b: DAffine3, f: f64) -> DAffine3 {
    DAffine3 {
        matrix3: a.matrix3 * (1.0 - f) + b.matrix3 * f,
        translation: a.translation.lerp(b.translation, f),
    }
}

fn interpolate(a: DAffine3, b: DAffine3, f: f64) -> DAffine3 {
    let (Some(p), Some(q)) = (ScaleRotation::of(a), ScaleRotation::of(b)) else { return lerp(a, b, f) };
    // A rotation has two quaternions of opposite sign; the interpolation uses the nearer one.
    let rotation = p.rotation.slerp(q.rotation, f);
    DAffine3::from_scale_rotation_translation(
        p.scale.lerp(q.scale, f),
        rotation,
        a.translation.lerp(b.translation, f),
    )
}

/// A linear map as a scale along the coordinate axes followed by a rotation.
struct ScaleRotation {
    scale: DVec3,
    rotation: DQuat,
}

impl ScaleRotation {
    /// Decomposes a transform; `None` if it has shear.
    fn of(transform: DAffine3) -> Option<Self> {
        let (scale, rotation, _) = transform.to_scale_rotation_translation();
        let again = DMat3::from_quat(rotation) * DMat3::from_diagonal(scale);
        let off = difference(transform, DAffine3 { matrix3: again, ..transform });
        (off <= SHEAR).then_some(ScaleRotation { scale, rotation })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::PI;

    fn turn(degrees: f64) -> DAffine3 {
        DAffine3::from_rotation_z(degrees.to_radians())
    }

    #[test]
    fn rotations_turn_at_constant_speed_and_ends_are_constant() {
        let motion = Motion::new(vec![(1.0, turn(0.0)), (3.0, turn(90.0))]).unwrap();
        assert_eq!(motion.at(0.0), turn(0.0));
        assert!(difference(motion.at(2.0), turn(45.0)) < 1e-12);
        assert!(difference(motion.at(1.5), turn(22.5)) < 1e-12);
        assert!(difference(motion.at(9.0), turn(90.0)) < 1e-12);
        assert_eq!(motion.fixed(), None);
        assert_eq!(Motion::from(turn(10.0)).fixed(), Some(turn(10.0)));
    }

    #[test]
    fn shear_is_interpolated_by_entries() {
        let shear = DAffine3::from_mat3(DMat3::from_cols(DVec3::X, DVec3::new(1.0, 1.0, 0.0), DVec3::Z));
        let motion = Motion::new(vec![(0.0, DAffine3::IDENTITY), (1.0, shear)]).unwrap();
        assert!((motion.at(0.5).matrix3.y_axis.x - 0.5).abs() < 1e-12);
    }

    #[test]
    fn steps_are_as_many_as_the_motion_needs() {
        let translation = |x| DAffine3::from_translation(DVec3::new(x, 0.0, 0.0));
        let straight = Motion::new(vec![(0.0, translation(0.0)), (1.0, translation(2.0))]).unwrap();
        assert_eq!(straight.steps(0.0, 1.0, 1e-4, 129).len(), 2);
        assert_eq!(straight.steps(0.25, 0.25, 1e-4, 129), [translation(0.5)]);
        let turning = Motion::new(vec![(0.0, turn(0.0)), (1.0, turn(120.0))]).unwrap();
        let steps = turning.steps(0.0, 1.0, 1e-3, 129);
        let angle = 120f64.to_radians() / (steps.len() - 1) as f64;
        assert!(1.0 - (0.5 * angle).cos() < 1.5e-3, "{}", steps.len());
        assert!(steps.len() < 129 && angle < PI);
    }

    #[test]
    fn times_must_increase() {
        assert_eq!(Motion::new(Vec::new()), None);
        assert_eq!(Motion::new(vec![(1.0, turn(0.0)), (1.0, turn(1.0))]), None);
    }
}
