//! Compensated sums, whose results do not depend on the grouping of the numbers.

/// A compensated sum of `f64`s with twice the precision of an `f64`.
///
/// Each addition is error-free [Knuth 1998, The Art of Computer Programming 2, 4.2.2, theorem B]: its rounding error
/// is summed separately. The sum of a million `f32`s whose magnitudes are within a factor of 10^12 of each other is
/// exact, so any order and any grouping gives the same bits. Beyond that range, the numbers that are too small to be
/// represented change the value by less than 10^-30 of it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Sum {
    /// The rounded sum.
    high: f64,
    /// The sum of the rounding errors.
    low: f64,
}

impl Sum {
    /// Creates a sum from the result of [`parts`](Self::parts).
    pub fn from_parts([high, low]: [f64; 2]) -> Self {
        Sum { high, low }
    }

    /// Returns the rounded sum and the sum of the rounding errors.
    pub fn parts(self) -> [f64; 2] {
        [self.high, self.low]
    }

    /// Adds a number.
    #[inline]
    pub fn add(&mut self, x: f64) {
        let high = self.high + x;
        // Separates the parts of the new sum that come from x and from the old sum; the differences are rounding
        // errors.
        let from_x = high - self.high;
        self.low += (self.high - (high - from_x)) + (x - from_x);
        self.high = high;
    }

    /// Adds the numbers of another sum.
    pub fn merge(&mut self, other: Sum) {
        self.add(other.high);
        self.low += other.low;
    }

    /// Returns the sum, rounded once.
    #[inline]
    pub fn value(self) -> f64 {
        self.high + self.low
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn sum(values: &[f32]) -> Sum {
        let mut sum = Sum::default();
        values.iter().for_each(|&v| sum.add(f64::from(v)));
        sum
    }

    #[test]
    fn what_an_f64_loses_is_kept() {
        let mut sum = Sum::default();
        let [large, small] = [60.0f64, -40.0].map(f64::exp2);
        [large, 1.0, small, -large, -1.0].iter().for_each(|&x| sum.add(x));
        assert_eq!(sum.value(), small);
        assert_eq!(Sum::from_parts(sum.parts()), sum);
    }

    proptest! {
        /// Values over twelve orders of magnitude, split at any position and added in any order.
        #[test]
        fn grouping_and_order_change_no_bit(
            logs in prop::collection::vec((-20.0f32..20.0, 0.5f32..1.0), 1..400),
            cut in 0.0f64..1.0,
        ) {
            let values: Vec<f32> = logs.iter().map(|&(e, m)| m * e.exp2()).collect();
            let whole = sum(&values).value();
            let (a, b) = values.split_at((cut * values.len() as f64) as usize);
            let [mut ab, mut ba] = [sum(a), sum(b)];
            ab.merge(sum(b));
            ba.merge(sum(a));
            let reversed: Vec<f32> = values.iter().rev().copied().collect();
            prop_assert_eq!(ab.value().to_bits(), whole.to_bits());
            prop_assert_eq!(ba.value().to_bits(), whole.to_bits());
            prop_assert_eq!(sum(&reversed).value().to_bits(), whole.to_bits());
        }
    }
}
