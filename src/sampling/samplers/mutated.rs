//! Small mutations of independent numbers, for Markov chains in the space of random numbers. [Kelemen et al. 2002]
//!
//! A state of a chain is a set of accepted steps: bit `j` of the key's index is 1 if step `j` changed the state. The
//! key's scramble gives the numbers of the start, and its replicate gives the steps of the chain. So a state is
//! computed from its key, as every other sample.

use super::SampleKey;
use crate::sampling::hash::{combine, pcg3d, to_unit};

/// The greatest number of steps of a chain.
pub const STEPS: u32 = 32;
/// The greatest change of a number by a step. The cubes below make half of all changes smaller than an eighth of it.
const GREATEST: f32 = 1.0 / 32.0;

/// Returns the change for a uniform random number: symmetric, and mostly small.
fn change(u: f32) -> f32 {
    let v = 2.0 * u - 1.0;
    GREATEST * v * v * v
}

/// Returns a pair of numbers of dimension `d`, on the unit torus.
fn pair(key: &SampleKey, d: u32) -> [f32; 2] {
    let start = pcg3d(key.scramble, 0, d);
    let mut sum = [to_unit(start[0]), to_unit(start[1])];
    let mut steps = key.index;
    while steps != 0 {
        let h = pcg3d(combine(key.scramble, key.replicate), steps.trailing_zeros() + 1, d);
        sum[0] += change(to_unit(h[0]));
        sum[1] += change(to_unit(h[1]));
        steps &= steps - 1;
    }
    sum.map(|x| (x - x.floor()).min(1f32.next_down()))
}

pub fn fill_1d(d: u32, keys: &[SampleKey], out: &mut [f32]) {
    for (key, u) in keys.iter().zip(out) {
        *u = pair(key, d)[0];
    }
}

pub fn fill_2d(d: u32, keys: &[SampleKey], x: &mut [f32], y: &mut [f32]) {
    for ((key, x), y) in keys.iter().zip(x).zip(y) {
        [*x, *y] = pair(key, d);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn key(index: u32) -> SampleKey {
        SampleKey { scramble: 7, index, replicate: 3 }
    }

    /// A step moves every number, by at most its limit on the torus, and a state does not depend on rejected steps.
    #[test]
    fn steps_are_small_and_add_up() {
        for d in 0..2000 {
            for accepted in [0, 1, 0b1011, u32::MAX >> 1] {
                let [before, after] = [accepted, accepted | 1 << 31].map(|steps| pair(&key(steps), d));
                for (x, y) in before.into_iter().zip(after) {
                    assert!((0.0..1.0).contains(&x) && (0.0..1.0).contains(&y));
                    let distance = (x - y).abs();
                    assert!(distance.min(1.0 - distance) <= GREATEST * 1.001, "{x} {y}");
                }
            }
        }
    }

    /// Numbers stay uniform after any number of steps: each step adds an independent number on the torus.
    #[test]
    fn numbers_stay_uniform() {
        for steps in [0, 1, u32::MAX] {
            let mut counts = [0u32; 16];
            for d in 0..16_000 {
                counts[(pair(&key(steps), d)[0] * 16.0) as usize] += 1;
            }
            // Chi-squared with 15 degrees of freedom exceeds 44.3 with a probability of 1e-4.
            let chi2: f64 = counts.iter().map(|n| (f64::from(*n) - 1000.0).powi(2) / 1000.0).sum();
            assert!(chi2 < 44.3, "{steps:b}: {counts:?}");
        }
    }
}
