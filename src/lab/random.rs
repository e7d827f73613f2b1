//! Uniform random numbers in double precision. Those of the samplers have 24 bits, which would be visible in the error
//! of a stratified sum of 10⁵ values.

use crate::sampling::hash::{combine, pcg3d};

/// A stream of independent uniform numbers.
#[derive(Clone, Debug)]
pub struct Stream {
    key: [u32; 2],
    drawn: u32,
}

impl Stream {
    /// Creates the stream with the number `run` for a part of an experiment. Streams of different parts, runs and seeds
    /// are independent.
    pub fn new(seed: u64, part: u32, run: u32) -> Self {
        Stream { key: [combine(combine(seed as u32, (seed >> 32) as u32), part), run], drawn: 0 }
    }

    /// Returns the next number in [0, 1).
    #[inline]
    pub fn uniform(&mut self) -> f64 {
        let [a, b, _] = pcg3d(self.drawn, self.key[0], self.key[1]);
        self.drawn = self.drawn.wrapping_add(1);
        let bits = u64::from(a) << 21 ^ u64::from(b >> 11);
        bits as f64 * (1.0 / (1u64 << 53) as f64)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_uniform_and_streams_differ() {
        let n = 100_000;
        let mut stream = Stream::new(7, 1, 2);
        let numbers: Vec<f64> = (0..n).map(|_| stream.uniform()).collect();
        assert!(numbers.iter().all(|u| (0.0..1.0).contains(u)));
        let mean = |k: i32| numbers.iter().map(|u| u.powi(k)).sum::<f64>() / f64::from(n);
        // Five standard errors.
        assert!((mean(1) - 0.5).abs() < 5.0 * (1.0f64 / 12.0 / 1e5).sqrt());
        assert!((mean(2) - 1.0 / 3.0).abs() < 5.0 * (4.0f64 / 45.0 / 1e5).sqrt());
        for (seed, part, run) in [(8, 1, 2), (7, 2, 2), (7, 1, 3), (7 + (1 << 32), 1, 2)] {
            assert_ne!(Stream::new(seed, part, run).uniform(), numbers[0]);
        }
        assert!(numbers.iter().any(|u| (u * (1u64 << 30) as f64).fract() != 0.0), "more than 24 bits");
    }
}
