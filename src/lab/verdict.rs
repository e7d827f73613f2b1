//! The rule that decides every claim.
//!
//! A claim implies checks: statements that a number lies in a range. A number is measured with a standard error. A
//! check is refuted if Student's t rejects it at the level [`LEVEL`] divided by the number of claims of the laboratory
//! and by the number of checks of the claim (Bonferroni). A run therefore refutes any true claim with a probability of
//! at most [`LEVEL`]. A check is confirmed if the 95 % interval of the number lies in the range. A claim is refuted if
//! one of its checks is refuted, and confirmed if all of them are confirmed. Otherwise it is undecided.

use super::moments::Measured;
use crate::estimate::student::{quantile, tail};

/// The upper bound on the probability that a run refutes any true claim.
pub const LEVEL: f64 = 0.001;
/// The number of claims of all experiments.
pub const CLAIMS: usize = 38;
/// The greatest number of degrees of freedom that is used for a standard error. A small number widens the tails, which
/// allows for the means of skewed values.
const MOST_FREEDOM: f64 = 9.0;
/// The significance of the interval that confirms a claim.
const INTERVAL: f64 = 0.05;

/// The verdict on a claim.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict {
    /// The measurement shows that the claim is true.
    Confirmed,
    /// The measurement is too uncertain.
    Undecided,
    /// The measurement shows that the claim is false.
    Refuted,
}

impl Verdict {
    /// All verdicts.
    pub const ALL: [Verdict; 3] = [Verdict::Confirmed, Verdict::Undecided, Verdict::Refuted];

    /// Returns the word that precedes a claim.
    pub fn word(self) -> &'static str {
        match self {
            Verdict::Confirmed => "confirmed",
            Verdict::Undecided => "undecided",
            Verdict::Refuted => "refuted",
        }
    }

    /// Returns the verdict on a claim that implies these checks.
    pub fn of(checks: &[Check]) -> Verdict {
        let level = LEVEL / (CLAIMS * checks.len().max(1)) as f64;
        if checks.iter().any(|check| check.is_refuted(level)) {
            Verdict::Refuted
        } else if checks.iter().all(Check::is_confirmed) {
            Verdict::Confirmed
        } else {
            Verdict::Undecided
        }
    }
}

/// A statement that a measured number lies in a range.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Check {
    number: Measured,
    low: f64,
    high: f64,
}

impl Check {
    /// Creates the check that a number is at most `bound`.
    pub fn below(number: Measured, bound: f64) -> Self {
        Check { number, low: f64::NEG_INFINITY, high: bound }
    }

    /// Creates the check that a number is at least `bound`.
    pub fn above(number: Measured, bound: f64) -> Self {
        Check { number, low: bound, high: f64::INFINITY }
    }

    /// Creates the check that a number is `expected`, within a tolerance.
    pub fn near(number: Measured, expected: f64, tolerance: f64) -> Self {
        Check { number, low: expected - tolerance, high: expected + tolerance }
    }

    fn freedom(&self) -> f64 {
        self.number.freedom.clamp(1.0, MOST_FREEDOM)
    }

    /// Returns whether the test rejects the check at a level. It is one-sided if the range has one end. A number that
    /// could not be measured refutes nothing.
    fn is_refuted(&self, level: f64) -> bool {
        let Measured { value, error, .. } = self.number;
        let outside = (value - self.high).max(self.low - value);
        let rounding = 1e-12 * value.abs().max(1.0);
        let sides = if self.low.is_finite() && self.high.is_finite() { 1.0 } else { 0.5 };
        outside > rounding && !error.is_nan() && sides * tail(outside / error, self.freedom()) < level
    }

    fn is_confirmed(&self) -> bool {
        let Measured { value, error, .. } = self.number;
        let half = quantile(INTERVAL, self.freedom()) * error;
        let rounding = 1e-12 * value.abs().max(1.0);
        value - half >= self.low - rounding && value + half <= self.high + rounding
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lab::random::Stream;

    fn number(value: f64, error: f64) -> Measured {
        Measured { value, error, freedom: 9.0 }
    }

    /// For 9 degrees of freedom, 2.262 bounds the 95 % interval and 6.9 the one-sided level of 0.001 / 38.
    #[test]
    fn what_is_far_outside_is_refuted_and_what_is_well_inside_confirmed() {
        let below = |value| Verdict::of(&[Check::below(number(value, 1.0), 0.0)]);
        assert_eq!([below(-2.27), below(-2.25)], [Verdict::Confirmed, Verdict::Undecided]);
        assert_eq!([below(6.5), below(7.2)], [Verdict::Undecided, Verdict::Refuted]);
        let both =
            |a, b| Verdict::of(&[Check::below(number(a, 1.0), 0.0), Check::above(number(b, 1.0), 0.0)]);
        assert_eq!(both(-3.0, 3.0), Verdict::Confirmed);
        assert_eq!(both(-3.0, 0.0), Verdict::Undecided);
        assert_eq!(both(-3.0, -9.0), Verdict::Refuted);
        let near = |value, error| Verdict::of(&[Check::near(number(value, error), 1.0, 0.1)]);
        assert_eq!([near(1.05, 0.0), near(1.05, 0.1)], [Verdict::Confirmed, Verdict::Undecided]);
        assert_eq!([near(1.2, 0.0), near(f64::NAN, f64::NAN)], [Verdict::Refuted, Verdict::Undecided]);
    }

    /// The values are means of 100 skewed values, the fourth powers of uniform numbers, whose expectation is the bound
    /// of the claim. None of 10,000 repetitions is refuted.
    #[test]
    fn a_true_claim_is_not_refuted() {
        for run in 0..10_000 {
            let mut stream = Stream::new(3, 0, run);
            let values: Vec<f64> = (0..100).map(|_| stream.uniform().powi(4)).collect();
            let mean = Measured::mean(&values);
            let checks = [Check::below(mean, 0.2), Check::above(mean, 0.2)];
            for check in checks {
                assert_ne!(Verdict::of(&[check]), Verdict::Refuted, "{run}: {check:?}");
            }
        }
    }
}
