//! The error of a render against its time.

use crate::estimate::replicates::ErrorEstimate;
use serde_json::{Value, json};

/// The ratio of the times of two points, which bounds their number.
const RATIO: f64 = 1.04;

/// The relMSE with its interval at growing times.
#[derive(Debug, Default)]
pub struct History {
    points: Vec<(f64, ErrorEstimate)>,
}

impl History {
    /// Adds the estimate after some seconds, unless it is the one before or that is recent.
    pub fn record(&mut self, seconds: f64, error: Option<ErrorEstimate>) {
        let Some(error) = error else { return };
        let is_new = |(before, last): &(f64, ErrorEstimate)| seconds >= RATIO * before && *last != error;
        if seconds > 0.0 && self.points.last().is_none_or(is_new) {
            self.points.push((seconds, error));
        }
    }

    /// Adds the last estimate, instead of the one before if that is recent.
    pub fn finish(&mut self, seconds: f64, error: Option<ErrorEstimate>) {
        if self.points.last().is_some_and(|(before, _)| seconds < RATIO * before) && error.is_some() {
            self.points.pop();
        }
        self.record(seconds, error);
    }

    /// Returns a list of seconds, relMSE, and the ends of its interval.
    pub fn json(&self) -> Value {
        let point = |(seconds, error): &(f64, ErrorEstimate)| {
            let [low, high] = error.interval;
            json!([seconds, error.relmse, low, high])
        };
        self.points.iter().map(point).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_day_has_few_points_and_the_last_is_there() {
        let error = |seconds: f64| {
            Some(ErrorEstimate { relmse: 1.0 / seconds, interval: [0.5 / seconds, 2.0 / seconds] })
        };
        let mut history = History::default();
        history.record(0.05, None);
        for tenths in 1..=864_000 {
            let seconds = f64::from(tenths) / 10.0;
            history.record(seconds, error(seconds));
        }
        let day = 86_400.5;
        history.finish(day, error(day));
        assert!((100..400).contains(&history.points.len()), "{}", history.points.len());
        assert_eq!(history.json()[0], json!([0.1, 10.0, 5.0, 20.0]));
        assert_eq!(history.points.last().map(|(seconds, _)| *seconds), Some(day));
    }
}
