//! The budget of a render.

use crate::render::StopRules;
use std::fmt;
use std::time::Duration;

/// A limit in time or samples.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Budget {
    /// Time for sampling: the render stops before the pass that would exceed it.
    Time(Duration),
    /// Samples per pixel.
    Samples(u64),
}

impl Budget {
    /// Parses a list such as `1s,2s,4s` or `16,64,256` (samples per pixel). Returns the budgets in ascending order
    /// without duplicates.
    ///
    /// # Errors
    /// Describes the first word that is neither a time nor a number of samples.
    pub fn list(text: &str) -> Result<Vec<Budget>, String> {
        let mut budgets =
            text.split(',').map(|word| Budget::parse(word.trim())).collect::<Result<Vec<_>, _>>()?;
        budgets.sort();
        budgets.dedup();
        Ok(budgets)
    }

    fn parse(word: &str) -> Result<Budget, String> {
        let expected = || {
            let found = if word.is_empty() { "nothing".into() } else { format!("\"{word}\"") };
            format!(
                "expected times (1s, 500ms, 2m) or samples per pixel (64), separated by commas; found {found}"
            )
        };
        let split = word.find(|c: char| c.is_ascii_alphabetic()).unwrap_or(word.len());
        let (number, unit) = word.split_at(split);
        let factor = match unit.trim() {
            "" | "spp" => {
                let samples =
                    number.trim().parse().ok().filter(|n: &u64| (1..=u64::from(u32::MAX)).contains(n));
                return samples.map(Budget::Samples).ok_or_else(expected);
            }
            "ms" => 1e-3,
            "s" => 1.0,
            "m" => 60.0,
            "h" => 3600.0,
            _ => return Err(expected()),
        };
        let seconds = number.trim().parse::<f64>().map_err(|_| expected())? * factor;
        if seconds > 0.0 && seconds < 1e7 {
            Ok(Budget::Time(Duration::from_secs_f64(seconds)))
        } else {
            Err(expected())
        }
    }

    /// Returns the stop rule.
    pub(super) fn stop(self) -> StopRules {
        match self {
            Budget::Time(time) => StopRules { time: Some(time), ..StopRules::default() },
            Budget::Samples(n) => StopRules { samples: Some(n), ..StopRules::default() },
        }
    }
}

impl fmt::Display for Budget {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Budget::Time(time) => write!(f, "{} s", time.as_secs_f64()),
            Budget::Samples(n) => write!(f, "{n} spp"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn budgets_are_times_or_samples() {
        let time = |s| Budget::Time(Duration::from_secs_f64(s));
        assert_eq!(Budget::list("4s, 1s,2s,1s"), Ok(vec![time(1.0), time(2.0), time(4.0)]));
        assert_eq!(Budget::list("64,16spp"), Ok(vec![Budget::Samples(16), Budget::Samples(64)]));
        assert_eq!(Budget::list("500ms,1.5m"), Ok(vec![time(0.5), time(90.0)]));
        assert_eq!(Budget::list("16,1s"), Ok(vec![time(1.0), Budget::Samples(16)]));
        assert_eq!([time(0.5), Budget::Samples(16)].map(|b| b.to_string()), ["0.5 s", "16 spp"]);
    }

    #[test]
    fn anything_else_is_refused_with_a_sentence() {
        let sentence = |found| {
            format!(
                "expected times (1s, 500ms, 2m) or samples per pixel (64), separated by commas; found {found}"
            )
        };
        for (text, found) in [
            ("", "nothing"),
            ("1s,,2s", "nothing"),
            ("0", "\"0\""),
            ("1.5", "\"1.5\""),
            ("-1s", "\"-1s\""),
            ("infs", "\"infs\""),
            ("1d", "\"1d\""),
            ("1e30h", "\"1e30h\""),
        ] {
            assert_eq!(Budget::list(text), Err(sentence(found)), "{text}");
        }
    }
}
