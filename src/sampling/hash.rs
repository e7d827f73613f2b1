//! Integer hashes, the only source of randomness.

use crate::math::{Vec3, Vec3x16, f32x16};

/// A bijective 32-bit hash in which every input bit affects every output bit. [Wellons 2018, lowbias32]
#[inline(always)]
pub const fn mix(mut x: u32) -> u32 {
    x ^= x >> 16;
    x = x.wrapping_mul(0x21f0_aaad);
    x ^= x >> 15;
    x = x.wrapping_mul(0xd35a_2d97);
    x ^ (x >> 15)
}

/// Adds `value` to the hash `h`.
#[inline(always)]
pub const fn combine(h: u32, value: u32) -> u32 {
    mix(h ^ value.wrapping_mul(0x9e37_79b9).wrapping_add(0x7f4a_7c15))
}

/// Returns three hashes of three words. [Jarzynski and Olano 2020, pcg3d]
#[inline(always)]
pub const fn pcg3d(x: u32, y: u32, z: u32) -> [u32; 3] {
    const A: u32 = 1_664_525;
    const C: u32 = 1_013_904_223;
    let mut x = x.wrapping_mul(A).wrapping_add(C);
    let mut y = y.wrapping_mul(A).wrapping_add(C);
    let mut z = z.wrapping_mul(A).wrapping_add(C);
    x = x.wrapping_add(y.wrapping_mul(z));
    y = y.wrapping_add(z.wrapping_mul(x));
    z = z.wrapping_add(x.wrapping_mul(y));
    x ^= x >> 16;
    y ^= y >> 16;
    z ^= z >> 16;
    x = x.wrapping_add(y.wrapping_mul(z));
    y = y.wrapping_add(z.wrapping_mul(x));
    z = z.wrapping_add(x.wrapping_mul(y));
    [x, y, z]
}

/// Numbers below it are multiples of 2^-32, others of 2^-24.
const FINE: f32 = 1.0 / 256.0;

/// Converts a hash to a number in [0, 1): the 24 high bits of `h` as a multiple of 2^-24, but for numbers below 2^-8
/// all bits of `h` as a multiple of 2^-32. There is no rounding, so the probability of an interval between two
/// multiples of 2^-24 is exactly its length.
#[inline(always)]
pub fn to_unit(h: u32) -> f32 {
    let (k, step) = if h < 1 << 24 { (h, 1.0 / 4_294_967_296.0) } else { (h >> 8, 1.0 / 16_777_216.0) };
    k as i32 as f32 * step
}

/// Returns digits below those of a random number `u` of [`to_unit`]: a hash of the number and a point, less than the
/// step of the number.
#[inline(always)]
pub fn lower_digits(u: f32, p: Vec3) -> f32 {
    let place = combine(p.x.to_bits() ^ p.y.to_bits().rotate_left(11), p.z.to_bits());
    digits_below(u, combine(place, u.to_bits()))
}

/// Returns digits below those of a random number `u` of [`to_unit`], from another hash.
#[inline(always)]
pub fn digits_below(u: f32, h: u32) -> f32 {
    let step = if u < FINE { 1.0 / 4_294_967_296.0 } else { 1.0 / 16_777_216.0 };
    (h >> 8) as i32 as f32 * (1.0 / 16_777_216.0) * step
}

/// Computes [`lower_digits`] in each lane.
#[inline(always)]
pub fn lower_digits_x16(u: f32x16, p: Vec3x16) -> f32x16 {
    let [u, x, y, z] = [u, p.x, p.y, p.z].map(|v| v.to_array());
    f32x16::new(std::array::from_fn(|i| lower_digits(u[i], Vec3::new(x[i], y[i], z[i]))))
}

/// Returns the probability that [`to_unit`] of a uniform hash is below `p`, which is in [0, 1]: `p`, rounded up to
/// the next representable number. A decision `u < p` has this probability instead of `p`.
#[inline(always)]
pub fn probability_below(p: f32) -> f32 {
    let steps = if p < FINE { 4_294_967_296.0 } else { 16_777_216.0 };
    (p * steps).ceil() / steps
}

/// Computes [`probability_below`] for sixteen values.
#[inline(always)]
pub fn probability_below_x16(p: f32x16) -> f32x16 {
    let [fine, coarse] = [4_294_967_296.0, 16_777_216.0].map(f32x16::splat);
    let steps = p.simd_lt(f32x16::splat(FINE)).select(fine, coarse);
    (p * steps).ceil() / steps
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn unit_numbers_stay_below_one_and_rise_with_their_hashes() {
        assert_eq!(to_unit(0), 0.0);
        assert_eq!(to_unit(u32::MAX), 1f32.next_down());
        for h in [1, 77, (1 << 24) - 1, 1 << 24, 0x1234_5600] {
            assert_eq!(f64::from(to_unit(h)), f64::from(h) / 2f64.powi(32));
            assert!(to_unit(h - 1) <= to_unit(h));
        }
    }

    /// Counts the hashes whose number is below `p` by bisection.
    #[test]
    fn probabilities_are_those_of_the_comparison() {
        for p in [0.0, 1e-12, 1e-10, 1e-9, 1e-8, 1e-6, 3.3e-5, 0.01, 0.3, 0.5, 0.999, 1f32.next_down(), 1.0] {
            let (mut low, mut high) = (0u64, 1u64 << 32);
            while low < high {
                let middle = (low + high) / 2;
                if to_unit(middle as u32) < p { low = middle + 1 } else { high = middle }
            }
            let counted = low as f64 / 2f64.powi(32);
            assert_eq!(f64::from(probability_below(p)), counted, "{p}");
            assert_eq!(probability_below_x16(f32x16::splat(p)).as_array()[3], probability_below(p));
        }
    }

    #[test]
    fn flipping_any_input_bit_flips_about_half_of_the_output() {
        for bit in 0..32 {
            let flipped: u32 = (0..1000u32)
                .map(|i| (combine(7, i * 77) ^ combine(7, (i * 77) ^ (1 << bit))).count_ones())
                .sum();
            assert!((15_000..17_000).contains(&flipped), "bit {bit}: {flipped}");
        }
    }
}
