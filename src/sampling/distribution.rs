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
    /// The distribution in proportion to `weights`, summed in `f64`. Weights that are not finite and positive
    /// count as zero; if all do, the distribution is empty.
    pub fn new(weights: &[f64]) -> Self {
        let clean: Vec<f64> =
            weights.iter().map(|&w| if w > 0.0 && w.is_finite() { w } else { 0.0 }).collect();
        let total: f64 = clean.iter().sum();
        if total <= 0.0 {
            return Distribution1D::default();
        }
        let mut sum = 0.0;
        let mut cdf: Vec<f32> = Vec::with_capacity(clean.len());
        for w in &clean {
            sum += w;
            cdf.push((sum / total) as f32);
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
        let d = Distribution1D::new(&weights);
        let total: f64 = (0..weights.len()).map(|i| f64::from(d.pmf(i))).sum();
        assert!((total - 1.0).abs() < 1e-6);
        assert!((0..100).all(|i| d.sample(i as f32 / 100.0).is_some_and(|c| c.pmf > 0.0)));
    }
}
