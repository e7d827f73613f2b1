//! Elementary functions of sixteen lanes.
//!
//! As everywhere in [lanes](super::lanes), no multiplication is fused with an addition, so the results are the same on
//! every machine. The coefficients of [`exp_x16`] and [`ln_x16`] are those of Cephes. [Moshier 1992]

use super::lanes::f32x16;
use std::f32::consts::{FRAC_PI_2, FRAC_PI_4, LOG2_E, PI, SQRT_2};

/// ln 2 as the sum of a short number, whose multiples are exact, and a remainder. [Cody and Waite 1980]
const LN_2: [f32; 2] = [0.693_359_4, -2.121_944_4e-4];

/// Returns the value of a polynomial; the coefficient of the highest power is the first.
#[inline(always)]
fn polynomial<const N: usize>(x: f32x16, coefficients: [f32; N]) -> f32x16 {
    coefficients.into_iter().map(f32x16::splat).reduce(|sum, c| sum * x + c).expect("there are coefficients")
}

/// Returns `eˣ` for `x ≤ 88`, with a relative error below 3·10⁻⁷. Below −87 the result is about 10⁻³⁸ instead of less.
#[inline(always)]
pub fn exp_x16(x: f32x16) -> f32x16 {
    let x = x.fast_max(f32x16::splat(-87.0));
    let n = (x * f32x16::splat(LOG2_E)).round_ties_even();
    let r = (x - n * f32x16::splat(LN_2[0])) - n * f32x16::splat(LN_2[1]);
    let series = polynomial(r, [1.987_569_1e-4, 1.398_2e-3, 8.333_452e-3, 4.166_579_6e-2, 0.166_666_65, 0.5]);
    // In a float of this size, the lowest bit is a unit.
    let integers = n + f32x16::splat(12_582_912.0 + 127.0);
    let powers = integers.to_array().map(|n| f32::from_bits(n.to_bits() << 23));
    (f32x16::ONE + (r + r * r * series)) * f32x16::new(powers)
}

/// Returns the natural logarithms of positive normal numbers, with an error below 2·10⁻⁷ of the larger of result and 1.
#[inline(always)]
pub fn ln_x16(x: f32x16) -> f32x16 {
    // x = 2ⁿ·(1 + t) with 1 + t in [√½, √2)
    const HALF_ROOT: u32 = (SQRT_2 / 2.0).to_bits();
    let bits = x.to_array().map(f32::to_bits);
    let n = bits.map(|x| (x.wrapping_sub(HALF_ROOT) as i32) >> 23);
    let t = f32x16::new(std::array::from_fn(|i| f32::from_bits(bits[i].wrapping_sub((n[i] << 23) as u32))));
    let (n, t) = (f32x16::new(n.map(|n| n as f32)), t - f32x16::ONE);
    let series = polynomial(
        t,
        [
            7.037_683_6e-2,
            -0.115_146_1,
            0.116_769_99,
            -0.124_201_41,
            0.142_493_23,
            -0.166_680_57,
            0.200_007_15,
            -0.249_999_94,
            0.333_333_3,
        ],
    );
    let t2 = t * t;
    let low = t * t2 * series + n * f32x16::splat(LN_2[1]) - f32x16::HALF * t2;
    (t + low) + n * f32x16::splat(LN_2[0])
}

/// Returns the angles in [0, π] with the given sines and cosines, or multiples of them, with an error below 4·10⁻⁷. The
/// sines are not negative. The coefficients are those of Cephes. [Moshier 1992]
#[inline(always)]
pub fn angle_x16(sin: f32x16, cos: f32x16) -> f32x16 {
    let one = f32x16::ONE;
    let across = cos.abs();
    let steep = sin.simd_gt(across);
    let t = steep.select(across, sin) / steep.select(sin, across);
    // In the upper half of the octant, tan (φ − π/4) = (t − 1)/(t + 1).
    let upper = t.simd_gt(f32x16::splat(SQRT_2 - 1.0));
    let z = upper.select((t - one) / (t + one), t);
    let z2 = z * z;
    let series = polynomial(z2, [8.053_745e-2, -0.138_776_86, 0.199_777_11, -0.333_329_5]);
    let octant = z + z * z2 * series + (f32x16::splat(FRAC_PI_4) & upper);
    let quadrant = steep.select(f32x16::splat(FRAC_PI_2) - octant, octant);
    cos.simd_lt(f32x16::ZERO).select(f32x16::splat(PI) - quadrant, quadrant)
}

/// Returns the complementary error function of `x ≥ 0`, given `exp(−x²)`, with an error below 10⁻⁶. [Abramowitz and
/// Stegun 1964, 7.1.26]
#[inline(always)]
pub fn erfc_x16(x: f32x16, exp: f32x16) -> f32x16 {
    let t = f32x16::ONE / (f32x16::ONE + f32x16::splat(0.327_591_1) * x);
    t * polynomial(t, [1.061_405_4, -1.453_152_1, 1.421_413_8, -0.284_496_74, 0.254_829_6]) * exp
}

/// Returns the inverse error function at `x`, given `w = −ln(1 − x²)`, with a relative error below 10⁻⁶ for `w < 16`.
/// [Giles 2012, single precision]
#[inline(always)]
pub fn erf_inverse_x16(x: f32x16, w: f32x16) -> f32x16 {
    let central = polynomial(
        w - f32x16::splat(2.5),
        [
            2.810_226_3e-8,
            3.432_739_4e-7,
            -3.523_387_7e-6,
            -4.391_506_5e-6,
            2.185_808_7e-4,
            -1.253_725e-3,
            -4.177_681_6e-3,
            0.246_640_73,
            1.501_409_4,
        ],
    );
    let tail = polynomial(
        w.sqrt() - f32x16::splat(3.0),
        [
            -2.002_142_6e-4,
            1.009_505_6e-4,
            1.349_343_2e-3,
            -3.673_428_4e-3,
            5.739_507_7e-3,
            -7.622_461_3e-3,
            9.438_87e-3,
            1.001_674,
            2.832_976_8,
        ],
    );
    w.simd_lt(f32x16::splat(5.0)).select(central, tail) * x
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(f: impl Fn(f32x16) -> f32x16, x: f64) -> f64 {
        f64::from(f(f32x16::splat(x as f32)).as_array()[7])
    }

    #[test]
    fn errors_are_as_stated() {
        for i in -870_000..880_000 {
            let x = f64::from(i as f32 * 1e-4);
            let y = x.exp();
            assert!((of(exp_x16, x) - y).abs() < 3e-7 * y, "exp {x}");
        }
        for i in -870..880 {
            for part in [0.0, 0.3, 0.9] {
                let x = f64::from(((f64::from(i) + part) * 0.1).exp() as f32);
                let y = x.ln();
                assert!((of(ln_x16, x) - y).abs() < 2e-7 * y.abs().max(1.0), "ln {x}: {}", of(ln_x16, x) - y);
            }
        }
        for i in 0..=20_000 {
            let (sin, cos) = (f64::from(i) * (0.000_05 * std::f64::consts::PI)).sin_cos();
            let (sin, cos) = (sin.max(0.0) as f32, cos as f32);
            let found = f64::from(angle_x16(f32x16::splat(sin), f32x16::splat(cos)).as_array()[3]);
            assert!(
                (found - f64::from(sin).atan2(f64::from(cos))).abs() < 4e-7,
                "angle {sin} {cos}: {found}"
            );
        }
        for i in 0..60_000 {
            let x = f64::from(i as f32 * 1e-4);
            let y = libm::erfc(x);
            let found = of(|x| erfc_x16(x, exp_x16(-x * x)), x);
            assert!((found - y).abs() < 1e-6, "erfc {x}: {}", found - y);
            let erf = f64::from(libm::erf(x) as f32);
            let w = f32x16::splat(-((1.0 - erf) * (1.0 + erf)).ln() as f32);
            if erf < 1.0 && *w.as_array().first().unwrap() < 16.0 {
                let back = of(|x| erf_inverse_x16(x, w), erf);
                assert!(
                    (libm::erf(back) - erf).abs() < 1e-6 * (1.0 - erf * erf).max(0.1),
                    "inverse {x} {back}"
                );
            }
        }
    }
}
