//! Vectors of sixteen values, for shading waves.
//!
//! Sixteen is the width of Embree's packets and of AVX-512. On machines with narrower registers, two halves hide the
//! latency of instructions. Every operation rounds as its scalar counterpart does (no approximate reciprocals, no
//! fused multiply-add), so the value of a lane does not depend on the machine.

use glam::Vec3;
use std::ops::{Add, Div, Mul, Neg, Sub};
pub use wide::f32x16;

/// The number of lanes of a vector.
pub const LANES: usize = 16;

/// Sixteen three-dimensional vectors.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Vec3x16 {
    /// The x components.
    pub x: f32x16,
    /// The y components.
    pub y: f32x16,
    /// The z components.
    pub z: f32x16,
}

impl Vec3x16 {
    /// Creates vectors from their components.
    #[inline(always)]
    pub fn new(x: f32x16, y: f32x16, z: f32x16) -> Self {
        Vec3x16 { x, y, z }
    }

    /// Creates vectors that are equal in every lane.
    #[inline(always)]
    pub fn splat(v: Vec3) -> Self {
        Vec3x16::new(f32x16::splat(v.x), f32x16::splat(v.y), f32x16::splat(v.z))
    }

    /// Returns the vector of one lane.
    #[inline]
    pub fn lane(&self, i: usize) -> Vec3 {
        Vec3::new(self.x.as_array()[i], self.y.as_array()[i], self.z.as_array()[i])
    }

    /// Replaces the vector of one lane.
    #[inline]
    pub fn set_lane(&mut self, i: usize, v: Vec3) {
        self.x.as_mut_array()[i] = v.x;
        self.y.as_mut_array()[i] = v.y;
        self.z.as_mut_array()[i] = v.z;
    }

    /// Returns the inner products.
    #[inline(always)]
    pub fn dot(self, o: Self) -> f32x16 {
        self.x * o.x + self.y * o.y + self.z * o.z
    }

    /// Returns the cross products.
    #[inline(always)]
    pub fn cross(self, o: Self) -> Self {
        Vec3x16::new(self.y * o.z - o.y * self.z, self.z * o.x - o.z * self.x, self.x * o.y - o.x * self.y)
    }

    /// Returns the squared lengths.
    #[inline(always)]
    pub fn length_squared(self) -> f32x16 {
        self.dot(self)
    }

    /// Returns unit vectors; zero if the length or its reciprocal is not a positive finite number.
    #[inline(always)]
    pub fn normalize_or_zero(self) -> Self {
        let r = f32x16::ONE / self.length_squared().sqrt();
        let usable = r.simd_gt(f32x16::ZERO) & r.simd_lt(f32x16::splat(f32::INFINITY));
        let v = self * r;
        Vec3x16::new(v.x & usable, v.y & usable, v.z & usable)
    }

    /// Returns componentwise absolute values.
    #[inline(always)]
    pub fn abs(self) -> Self {
        Vec3x16::new(self.x.abs(), self.y.abs(), self.z.abs())
    }

    /// Returns componentwise maxima; NaN is not supported.
    #[inline(always)]
    pub fn max(self, o: Self) -> Self {
        Vec3x16::new(self.x.fast_max(o.x), self.y.fast_max(o.y), self.z.fast_max(o.z))
    }

    /// Returns `if_true` in the lanes where `mask` is set, otherwise `if_false`.
    #[inline(always)]
    pub fn select(mask: f32x16, if_true: Self, if_false: Self) -> Self {
        Vec3x16::new(
            mask.select(if_true.x, if_false.x),
            mask.select(if_true.y, if_false.y),
            mask.select(if_true.z, if_false.z),
        )
    }
}

impl Add for Vec3x16 {
    type Output = Self;
    #[inline(always)]
    fn add(self, o: Self) -> Self {
        Vec3x16::new(self.x + o.x, self.y + o.y, self.z + o.z)
    }
}

impl Sub for Vec3x16 {
    type Output = Self;
    #[inline(always)]
    fn sub(self, o: Self) -> Self {
        Vec3x16::new(self.x - o.x, self.y - o.y, self.z - o.z)
    }
}

impl Mul<f32x16> for Vec3x16 {
    type Output = Self;
    #[inline(always)]
    fn mul(self, s: f32x16) -> Self {
        Vec3x16::new(self.x * s, self.y * s, self.z * s)
    }
}

impl Div<f32x16> for Vec3x16 {
    type Output = Self;
    #[inline(always)]
    fn div(self, s: f32x16) -> Self {
        Vec3x16::new(self.x / s, self.y / s, self.z / s)
    }
}

impl Neg for Vec3x16 {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        Vec3x16::new(-self.x, -self.y, -self.z)
    }
}

/// Returns `magnitude`, which is not negative, with the signs of `sign`.
#[inline(always)]
pub fn with_sign(magnitude: f32x16, sign: f32x16) -> f32x16 {
    magnitude | (sign & f32x16::splat(-0.0))
}

/// Returns the values `first..first + 16`, with zeros beyond the end.
#[inline(always)]
pub fn load(values: &[f32], first: usize) -> f32x16 {
    match values[first..].first_chunk::<LANES>() {
        Some(chunk) => f32x16::new(*chunk),
        None => load_tail(&values[first..]),
    }
}

#[cold]
fn load_tail(tail: &[f32]) -> f32x16 {
    let mut padded = [0.0; LANES];
    padded[..tail.len()].copy_from_slice(tail);
    f32x16::new(padded)
}

/// Converts a bit mask to a lane mask.
#[inline]
pub fn mask_from_bits(bits: u32) -> f32x16 {
    let lane = |i: u32| f32::from_bits(if bits >> i & 1 == 1 { u32::MAX } else { 0 });
    f32x16::new(std::array::from_fn(|i| lane(i as u32)))
}

/// Returns a value for each lane. It is inlined more reliably than `std::array::from_fn`.
#[inline(always)]
pub fn each_lane<T: Copy>(value: impl Fn(usize) -> T) -> [T; LANES] {
    let mut values = [value(0); LANES];
    for (i, to) in values.iter_mut().enumerate().skip(1) {
        *to = value(i);
    }
    values
}

/// Iterates over the indices of the set bits, from the lowest.
#[inline]
pub fn bits(mut bits: u32) -> impl Iterator<Item = usize> {
    std::iter::from_fn(move || {
        let i = bits.trailing_zeros();
        bits &= bits.wrapping_sub(1);
        (i < u32::BITS).then_some(i as usize)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lanes_compute_what_vectors_do() {
        let (a, b) = (Vec3::new(0.3, -2.0, 5.0), Vec3::new(-1.5, 0.25, 7.0));
        let (mut va, vb) = (Vec3x16::splat(b), Vec3x16::splat(b));
        va.set_lane(3, a);
        assert_eq!(va.cross(vb).lane(3), a.cross(b));
        assert_eq!(va.dot(vb).as_array()[3], a.dot(b));
        assert_eq!(va.normalize_or_zero().lane(3), a.normalize_or_zero());
        assert_eq!((va - va).normalize_or_zero().lane(3), Vec3::ZERO);
        assert_eq!((va / f32x16::splat(0.0)).normalize_or_zero().lane(3), Vec3::ZERO);
        assert_eq!((va * f32x16::splat(1e30)).normalize_or_zero().lane(3), Vec3::ZERO);
        assert_eq!(with_sign(f32x16::splat(2.0), va.y).as_array()[3], -2.0);
    }

    #[test]
    fn masks_and_tails() {
        assert_eq!(bits(0b1000_0101).collect::<Vec<_>>(), [0, 2, 7]);
        assert_eq!(mask_from_bits(0b1000_0101).to_bitmask(), 0b1000_0101);
        let values: Vec<f32> = (0..19).map(|i| i as f32).collect();
        assert_eq!(load(&values, 16).to_array()[..4], [16.0, 17.0, 18.0, 0.0]);
        assert_eq!(load(&values, 3).to_array()[..], values[3..]);
    }
}
