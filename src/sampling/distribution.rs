//! Discrete distributions.

/// A discrete distribution over `0..n`, sampled by inversion.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Distribution1D {
    /// Upper ends of the intervals; the last is 1.
    cdf: Vec<f32>,
    pmf: Vec<f32>,
}

/// A sample of a [`Distribution1D`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DiscreteSample {
    /// The index of the entry.
    pub index: usize,
    /// The probability of the entry.
    pub pmf: f32,
    /// The random number, rescaled to [0, 1) within the entry's interval.
    pub u: f32,
}

/// The number of multiples of 2^-24 in [0, 1), the spacing of random numbers near 1.
const STEPS: f64 = (1u32 << 24) as f64;

impl Distribution1D {
    /// The greatest number of entries with positive weight.
    pub const MAX_ENTRIES: usize = 1 << 23;

    /// Returns the number of weights that are finite and positive.
    pub fn count(weights: &[f64]) -> usize {
        weights.iter().filter(|w| **w > 0.0 && w.is_finite()).count()
    }

    /// Creates the distribution in proportion to `weights`, summed in `f64`. Weights that are not finite and positive
    /// count as zero. If all are zero, the distribution is empty.
    ///
    /// Every entry with a positive weight can be sampled, however small the weight is. The ends of the intervals are
    /// multiples of 2^-24; each of n entries gets one such step, and the remaining steps are distributed by weight.
    /// The probabilities therefore differ from the normalised weights by at most n / 2^24. [`pmf`](Self::pmf) is
    /// exactly the probability of [`sample`](Self::sample).
    ///
    /// # Panics
    /// If more than [`MAX_ENTRIES`](Self::MAX_ENTRIES) entries have a positive weight.
    pub fn new(weights: &[f64]) -> Self {
        let count = Self::count(weights);
        assert!(count <= Self::MAX_ENTRIES, "{count} entries with a weight");
        let clean: Vec<f64> =
            weights.iter().map(|&w| if w > 0.0 && w.is_finite() { w } else { 0.0 }).collect();
        let total: f64 = clean.iter().sum();
        if total <= 0.0 {
            return Distribution1D::default();
        }
        let divided = STEPS - count as f64;
        let (mut sum, mut entries) = (0.0, 0);
        let mut cdf: Vec<f32> = Vec::with_capacity(clean.len());
        for w in &clean {
            sum += w;
            entries += usize::from(*w > 0.0);
            cdf.push((((sum / total * divided).round() + entries as f64) / STEPS) as f32);
        }
        // The cdf is exactly 1 from the last entry with positive weight on.
        if let Some(last) = clean.iter().rposition(|&w| w > 0.0) {
            cdf[last..].iter_mut().for_each(|c| *c = 1.0);
        }
        let pmf = (0..cdf.len()).map(|i| if i == 0 { cdf[0] } else { cdf[i] - cdf[i - 1] }).collect();
        Distribution1D { cdf, pmf }
    }

    /// Returns whether the distribution is empty.
    pub fn is_empty(&self) -> bool {
        self.cdf.is_empty()
    }

    /// Returns the probability of entry `i`.
    #[inline]
    pub fn pmf(&self, i: usize) -> f32 {
        self.pmf.get(i).copied().unwrap_or(0.0)
    }

    /// Samples an entry with the random number `u` in [0, 1); `None` for the empty distribution.
    #[inline]
    pub fn sample(&self, u: f32) -> Option<DiscreteSample> {
        if self.cdf.len() == 1 {
            return Some(DiscreteSample { index: 0, pmf: 1.0, u });
        }
        let index = self.cdf.partition_point(|&c| c <= u);
        let pmf = *self.pmf.get(index)?;
        let low = if index == 0 { 0.0 } else { self.cdf[index - 1] };
        let u = ((u - low) / pmf).min(1f32.next_down());
        Some(DiscreteSample { index, pmf, u })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sampling::hash::to_unit;

    #[test]
    fn entries_are_drawn_in_proportion_and_u_is_stretched() {
        let d = Distribution1D::new(&[1.0, 0.0, 3.0, 0.0]);
        // Each of the two entries gets one step of 2^-24 before the others are distributed.
        let quarter = 0.25 + 2f32.powi(-25);
        assert!((d.pmf(0) - quarter).abs() <= 2f32.powi(-24), "{}", d.pmf(0));
        assert_eq!(d.sample(0.0), Some(DiscreteSample { index: 0, pmf: d.pmf(0), u: 0.0 }));
        assert_eq!(d.sample(d.pmf(0)), Some(DiscreteSample { index: 2, pmf: 1.0 - d.pmf(0), u: 0.0 }));
        assert_eq!(d.sample(1f32.next_down()).unwrap().index, 2);
        assert_eq!(d.pmf(1), 0.0);
        assert_eq!(d.pmf(9), 0.0);
    }

    #[test]
    fn hopeless_weights_give_an_empty_distribution() {
        assert!(Distribution1D::new(&[0.0, f64::NAN, -1.0]).is_empty());
        assert_eq!(Distribution1D::new(&[]).sample(0.5), None);
        assert_eq!(Distribution1D::new(&[0.0]).sample(0.5), None);
    }

    #[test]
    fn ratios_of_a_billion_among_100_000_entries_still_add_up() {
        let weights: Vec<f64> = (0..100_000).map(|i| if i == 777 { 1e9 } else { 1.0 }).collect();
        let d = Distribution1D::new(&weights);
        let total: f64 = (0..weights.len()).map(|i| f64::from(d.pmf(i))).sum();
        assert!((total - 1.0).abs() < 1e-6);
        assert!((0..100).all(|i| d.sample(i as f32 / 100.0).is_some_and(|c| c.pmf > 0.0)));
    }

    #[test]
    fn whatever_has_a_weight_is_drawn_and_nothing_else() {
        let weights = [0.0, 1e9, 0.0, 1e-300, 1.0, f64::NAN, 1.0, 0.0];
        let d = Distribution1D::new(&weights);
        let step = 1.0 / 16_777_216.0;
        let pmf = [0, 1, 2, 3, 4, 5, 6, 7].map(|i| d.pmf(i) / step);
        assert_eq!(pmf, [0.0, 16_777_213.0, 0.0, 1.0, 1.0, 0.0, 1.0, 0.0]);
        for (from_end, index) in [(4, 1), (3, 3), (2, 4), (1, 6)] {
            let u = 1.0 - step * from_end as f32;
            assert_eq!(d.sample(u).map(|c| c.index), Some(index));
        }
        assert_eq!(Distribution1D::new(&[0.0, 7.0]).sample(0.0).map(|c| (c.index, c.pmf)), Some((1, 1.0)));
        assert!(Distribution1D::new(&[0.0, -1.0]).is_empty());
    }

    /// The fraction of hashes that select an entry is equal to its probability, for every position of its interval.
    #[test]
    fn probabilities_are_those_of_the_random_numbers() {
        let weights: Vec<f64> = (0..1000).map(|i| [1e-9, 1.0, 1e-3][i % 3]).collect();
        let d = Distribution1D::new(&weights);
        // The first hash whose number selects the entry.
        let first = |index: usize| {
            let (mut low, mut high) = (0u64, 1u64 << 32);
            while low < high {
                let middle = (low + high) / 2;
                let below = d.sample(to_unit(middle as u32)).is_some_and(|c| c.index < index);
                if below { low = middle + 1 } else { high = middle }
            }
            low as f64
        };
        for i in [0, 1, 2, 3, 300, 501, 502, 503, 996, 997, 998] {
            let share = (first(i + 1) - first(i)) / 2f64.powi(32);
            assert_eq!(share, f64::from(d.pmf(i)), "entry {i}");
        }
    }

    #[test]
    #[should_panic(expected = "entries with a weight")]
    fn more_entries_than_random_numbers_are_refused() {
        Distribution1D::new(&vec![1.0; Distribution1D::MAX_ENTRIES + 1]);
    }
}
