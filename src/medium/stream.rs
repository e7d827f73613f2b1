//! Random numbers of heterogeneous media: a flight needs an unknown number of them.

use crate::sampling::hash::pcg3d;

/// A stream of independent uniform numbers.
#[derive(Clone, Copy, Debug)]
pub struct Stream {
    seed: [u32; 2],
    count: u32,
}

impl Stream {
    /// Creates a stream. Streams of different seeds are independent.
    pub fn new(seed: [u32; 2]) -> Self {
        Stream { seed, count: 0 }
    }

    /// Returns a stream that is independent of this one and of its numbers so far.
    pub fn other(&self) -> Self {
        Stream::new([!self.seed[0], self.seed[1].wrapping_add(self.count)])
    }

    /// Returns the next number, in (0, 1).
    pub fn uniform(&mut self) -> f64 {
        let [a, b, _] = pcg3d(self.seed[0], self.seed[1], self.count);
        self.count = self.count.wrapping_add(1);
        (f64::from(a) + (f64::from(b >> 12) + 0.5) * 2f64.powi(-20)) * 2f64.powi(-32)
    }
}
