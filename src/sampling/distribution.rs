//! Discrete distributions.

/// A discrete distribution over `0..n`, sampled by inversion.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Distribution1D {
    /// Upper ends of the intervals; the last is 1.
    cdf: Vec<f32>,
    pmf: Vec<f32>,
}

/// A draw from a [`Distribution1D`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Choice {
    /// The entry.
    pub index: usize,
    /// Its probability.
    pub pmf: f32,
    /// The random number, stretched to [0, 1) again within the entry's interval.
    pub u: f32,
}

impl Distribution1D {
    /// The most entries that [`covering`](Self::covering) covers.
    pub const MOST_COVERED: usize = 1 << 23;

    /// The distribution in proportion to `weights`, summed in `f64`. Weights that are not finite and positive
    /// count as zero; if all do, the distribution is empty.
    ///
    /// The ends of the entries' intervals are rounded: of entries below 2^-24 some have no probability, and others
    /// have theirs beside their own.
    pub fn new(weights: &[f64]) -> Self {
        Self::of(weights, |share, _| share)
    }

    /// As [`new`](Self::new), but every entry with a weight is drawn, however small its weight is: by at least one of
    /// the 2^24 random numbers k / 2^24. Its probability is exactly the share of those numbers that draw it.
    ///
    /// Of 2^24 numbers each of n entries with a weight gets one, and the others are divided by weight: the probabilities
    /// depart from the weights' by at most n / 2^24. Of more than [`MOST_COVERED`](Self::MOST_COVERED) entries the
    /// distribution is that of [`new`](Self::new).
    pub fn covering(weights: &[f64]) -> Self {
        const NUMBERS: f64 = (1u32 << 24) as f64;
        let count = weights.iter().filter(|w| **w > 0.0 && w.is_finite()).count();
        if count > Self::MOST_COVERED {
            return Self::new(weights);
        }
        let divided = NUMBERS - count as f64;
        Self::of(weights, |share, entries| ((share * divided).round() + entries as f64) / NUMBERS)
    }

    /// `end` makes the end of an entry's interval of the weights' share up to there and of how many entries have any.
    fn of(weights: &[f64], end: impl Fn(f64, usize) -> f64) -> Self {
        let clean: Vec<f64> =
            weights.iter().map(|&w| if w > 0.0 && w.is_finite() { w } else { 0.0 }).collect();
        let total: f64 = clean.iter().sum();
        if total <= 0.0 {
            return Distribution1D::default();
        }
        let (mut sum, mut entries) = (0.0, 0);
        let mut cdf: Vec<f32> = Vec::with_capacity(clean.len());
        for w in &clean {
            sum += w;
            entries += usize::from(*w > 0.0);
            cdf.push(end(sum / total, entries) as f32);
        }
        // From the last entry with weight on the cdf is exactly 1.
        if let Some(last) = clean.iter().rposition(|&w| w > 0.0) {
            cdf[last..].iter_mut().for_each(|c| *c = 1.0);
        }
        // What sampling by inversion really does is the difference of the rounded ends.
        let pmf = (0..cdf.len()).map(|i| if i == 0 { cdf[0] } else { cdf[i] - cdf[i - 1] }).collect();
        Distribution1D { cdf, pmf }
    }

    /// Whether nothing can be drawn.
    pub fn is_empty(&self) -> bool {
        self.cdf.is_empty()
    }

    /// The probability of entry `i`.
    #[inline]
    pub fn pmf(&self, i: usize) -> f32 {
        self.pmf.get(i).copied().unwrap_or(0.0)
    }

    /// The entry for the random number `u` in [0, 1); `None` for the empty distribution.
    #[inline]
    pub fn sample(&self, u: f32) -> Option<Choice> {
        if self.cdf.len() == 1 {
            return Some(Choice { index: 0, pmf: 1.0, u });
        }
        let index = self.cdf.partition_point(|&c| c <= u);
        let pmf = *self.pmf.get(index)?;
        let low = if index == 0 { 0.0 } else { self.cdf[index - 1] };
        let u = ((u - low) / pmf).min(1f32.next_down());
        Some(Choice { index, pmf, u })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn entries_are_drawn_in_proportion_and_u_is_stretched() {
        let d = Distribution1D::new(&[1.0, 0.0, 3.0, 0.0]);
        assert_eq!(d.sample(0.0), Some(Choice { index: 0, pmf: 0.25, u: 0.0 }));
        assert_eq!(d.sample(0.25), Some(Choice { index: 2, pmf: 0.75, u: 0.0 }));
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
        for d in [Distribution1D::new(&weights), Distribution1D::covering(&weights)] {
            let total: f64 = (0..weights.len()).map(|i| f64::from(d.pmf(i))).sum();
            assert!((total - 1.0).abs() < 1e-6);
            assert!((0..100).all(|i| d.sample(i as f32 / 100.0).is_some_and(|c| c.pmf > 0.0)));
        }
    }

    /// Where `new` leaves out what is lighter than the distance of two random numbers, `covering` leaves out nothing.
    #[test]
    fn whatever_has_a_weight_is_covered_and_nothing_else() {
        let weights = [0.0, 1e9, 0.0, 1e-300, 1.0, f64::NAN, 1.0, 0.0];
        let [proportional, covering] = [Distribution1D::new(&weights), Distribution1D::covering(&weights)];
        let step = 1.0 / 16_777_216.0;
        let pmf = |d: &Distribution1D| [0, 1, 2, 3, 4, 5, 6, 7].map(|i| d.pmf(i) / step);
        assert_eq!(pmf(&covering), [0.0, 16_777_213.0, 0.0, 1.0, 1.0, 0.0, 1.0, 0.0]);
        assert_eq!(pmf(&proportional), [0.0, 16_777_216.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
        for (from_end, index) in [(4, 1), (3, 3), (2, 4), (1, 6)] {
            let u = 1.0 - step * from_end as f32;
            assert_eq!(covering.sample(u).map(|c| c.index), Some(index));
        }
        assert_eq!(
            Distribution1D::covering(&[0.0, 7.0]).sample(0.0).map(|c| (c.index, c.pmf)),
            Some((1, 1.0))
        );
        assert!(Distribution1D::covering(&[0.0, -1.0]).is_empty());
    }
}
