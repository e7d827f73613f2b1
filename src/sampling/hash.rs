//! Integer hashes: the only source of randomness.

/// A bijective mix of 32 bits in which every input bit reaches every output bit. [Wellons 2018, lowbias32]
#[inline(always)]
pub const fn mix(mut x: u32) -> u32 {
    x ^= x >> 16;
    x = x.wrapping_mul(0x21f0_aaad);
    x ^= x >> 15;
    x = x.wrapping_mul(0xd35a_2d97);
    x ^ (x >> 15)
}

/// Folds `value` into the hash `h`.
#[inline(always)]
pub const fn combine(h: u32, value: u32) -> u32 {
    mix(h ^ value.wrapping_mul(0x9e37_79b9).wrapping_add(0x7f4a_7c15))
}

/// Three hashes of three words. [Jarzynski and Olano 2020, pcg3d]
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

/// The 24 high bits of `h` as a number in [0, 1).
#[inline(always)]
pub fn to_unit(h: u32) -> f32 {
    (h >> 8) as f32 * (1.0 / 16_777_216.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn unit_numbers_stay_below_one() {
        assert_eq!(to_unit(0), 0.0);
        assert!(to_unit(u32::MAX) < 1.0);
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
