//! Stop rules; the first one that applies ends the render.

use crate::estimate::replicates::ErrorEstimate;
use std::fmt;
use std::time::Duration;

/// The stop rules. Without any rule, a render continues until it is interrupted.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct StopRules {
    /// Samples per pixel.
    pub samples: Option<u64>,
    /// Time limit of sampling.
    pub time: Option<Duration>,
    /// The target relMSE, which is reached when the upper end of the estimate's interval is at most this value.
    pub error: Option<f64>,
}

/// The rule that ended a render.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StopReason {
    /// All samples were taken.
    Samples,
    /// The next pass would exceed the time limit.
    Time,
    /// The upper end of the estimated error's interval reached the target.
    Error,
    /// The user said that the samples so far are enough: the image is finished.
    Enough,
    /// The user or the system stopped the render before its end.
    Interrupted,
}

impl fmt::Display for StopReason {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            StopReason::Samples => "samples",
            StopReason::Time => "time",
            StopReason::Error => "error",
            StopReason::Enough => "enough",
            StopReason::Interrupted => "interrupted",
        })
    }
}

/// The greatest number of samples per pixel of a pass. Estimates and stop rules are evaluated once per pass.
const LARGEST_PASS: u64 = 64;
/// The least number of samples per pixel with which an error estimate may stop a render. Calibration shows that the
/// intervals are reliable from here on.
const FEWEST_FOR_ERROR: u64 = 16;
/// The fraction of the missing samples that the next pass takes if many are missing. The error of low-discrepancy
/// samplers decreases faster than one over the number of samples.
const CAUTION: f64 = 0.75;
/// The ratio of missing to completed samples above which many are missing.
const MANY: f64 = 0.125;

impl StopRules {
    /// Returns the reason to stop after `done` samples per pixel, if a rule applies. `elapsed` is the time so far,
    /// `error` the estimated relMSE.
    pub fn reached(&self, done: u64, elapsed: Duration, error: Option<ErrorEstimate>) -> Option<StopReason> {
        if self.samples.is_some_and(|n| done >= n) {
            return Some(StopReason::Samples);
        }
        if done >= FEWEST_FOR_ERROR
            && let (Some(target), Some(error)) = (self.error, error)
            && error.interval[1] <= target
        {
            return Some(StopReason::Error);
        }
        (done > 0 && self.time.is_some_and(|_| self.pass_within_time(done, elapsed) == 0))
            .then_some(StopReason::Time)
    }

    /// Returns the samples per pixel of the next pass: the number so far, limited by the maximum, by the rules, and
    /// by the estimated need for the target.
    pub fn next_pass(&self, done: u64, elapsed: Duration, error: Option<ErrorEstimate>) -> u64 {
        let pass = done.clamp(2, LARGEST_PASS);
        let left = self.samples.map_or(u64::MAX, |n| n - done.min(n));
        let in_time =
            if done > 0 && self.time.is_some() { self.pass_within_time(done, elapsed) } else { u64::MAX };
        pass.min(left).min(in_time).min(self.pass_to_target(done, error))
    }

    /// Returns an estimate of the samples per pixel that are missing for the target; an even number.
    fn pass_to_target(&self, done: u64, error: Option<ErrorEstimate>) -> u64 {
        let (Some(target), Some(error)) = (self.error, error) else { return u64::MAX };
        if done < FEWEST_FOR_ERROR {
            return FEWEST_FOR_ERROR - done;
        }
        // The error is about proportional to one over the number of samples.
        let missing = (error.interval[1] / target - 1.0).max(0.0) * done as f64;
        let pass = if missing > MANY * done as f64 { CAUTION * missing } else { missing };
        (pass.ceil() as u64).saturating_add(1).max(2) & !1
    }

    /// Returns the samples per pixel that fit the time limit at the speed so far; an even number, which keeps the
    /// halves equal.
    fn pass_within_time(&self, done: u64, elapsed: Duration) -> u64 {
        let Some(time) = self.time else { return u64::MAX };
        let left = time.saturating_sub(elapsed).as_secs_f64();
        let per_sample = elapsed.as_secs_f64().max(1e-9) / done as f64;
        ((left / per_sample) as u64) & !1
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SECOND: Duration = Duration::from_secs(1);

    #[test]
    fn passes_double_and_end_at_the_sample_count() {
        let rules = StopRules { samples: Some(77), ..StopRules::default() };
        let mut done = 0;
        let mut passes = Vec::new();
        while rules.reached(done, SECOND, None).is_none() {
            passes.push(rules.next_pass(done, SECOND, None));
            done += passes[passes.len() - 1];
        }
        assert_eq!(passes, [2, 2, 4, 8, 16, 32, 13]);
        assert_eq!(rules.reached(done, SECOND, None), Some(StopReason::Samples));
    }

    #[test]
    fn time_allows_what_fits_and_always_one_pass() {
        let rules = StopRules { time: Some(10 * SECOND), ..StopRules::default() };
        assert_eq!(rules.reached(0, 20 * SECOND, None), None);
        assert_eq!(rules.next_pass(32, 8 * SECOND, None), 8);
        assert_eq!(rules.reached(32, 10 * SECOND, None), Some(StopReason::Time));
    }

    /// Returns an estimate with an interval of ±10 %.
    fn about(relmse: f64) -> Option<ErrorEstimate> {
        Some(ErrorEstimate { relmse, interval: [relmse / 1.1, relmse * 1.1] })
    }

    #[test]
    fn the_error_rule_waits_for_enough_samples_and_for_the_upper_end() {
        let rules = StopRules { error: Some(1e-3), ..StopRules::default() };
        assert_eq!(rules.reached(8, SECOND, about(1e-4)), None);
        assert_eq!(rules.reached(16, SECOND, about(1e-4)), Some(StopReason::Error));
        assert_eq!(rules.reached(16, SECOND, about(0.95e-3)), None);
        assert_eq!(rules.reached(16, SECOND, None), None);
    }

    #[test]
    fn passes_towards_a_target_do_not_overshoot() {
        let rules = StopRules { error: Some(1e-3), ..StopRules::default() };
        for per_sample in [1e-3, 0.07, 0.0801, 0.3, 2.2] {
            let mut done = 0;
            while rules.reached(done, SECOND, about(per_sample / done as f64)).is_none() {
                let pass = rules.next_pass(done, SECOND, about(per_sample / done.max(1) as f64));
                assert!(pass.is_multiple_of(2) && pass > 0, "{pass}");
                done += pass;
            }
            let needed = (1.1 * per_sample / 1e-3).max(16.0);
            assert!(done as f64 <= needed + 4.0, "{done} instead of {needed}");
        }
    }
}
