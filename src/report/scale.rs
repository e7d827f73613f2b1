//! Axes: scales, ticks and their labels.

/// The spacing of values along an axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Scale {
    /// Linear.
    Linear,
    /// Logarithmic; only positive values can be shown.
    Log,
}

/// An axis over a range.
#[derive(Clone, Debug)]
pub(super) struct Ticks {
    scale: Scale,
    low: f64,
    high: f64,
    /// Values with a label.
    pub(super) major: Vec<(f64, String)>,
    /// Values with a grid line only.
    pub(super) minor: Vec<f64>,
}

/// The least and greatest number of labels of an axis.
const FEWEST_LABELS: usize = 3;
const MOST_LABELS: f64 = 7.0;
/// The free space at each end, as a fraction of the range.
const MARGIN: f64 = 0.06;

impl Scale {
    /// Returns whether the axis can show a value.
    pub(super) fn holds(self, value: f64) -> bool {
        value.is_finite() && (self == Scale::Linear || value > 0.0)
    }

    fn forward(self, value: f64) -> f64 {
        match self {
            Scale::Linear => value,
            Scale::Log => value.log10(),
        }
    }

    fn back(self, value: f64) -> f64 {
        match self {
            Scale::Linear => value,
            Scale::Log => 10f64.powf(value),
        }
    }

    /// Creates an axis that shows all of the values with a margin; `None` if it can show none of them.
    pub(super) fn ticks(self, values: impl Iterator<Item = f64>) -> Option<Ticks> {
        let (low, high) = values
            .filter(|&v| self.holds(v))
            .map(|v| self.forward(v))
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| (low.min(v), high.max(v)));
        if low > high {
            return None;
        }
        let span = high - low;
        let margin = if span > 1e-9 * low.abs().max(high.abs()) { span * MARGIN } else { 0.2 };
        let mut ticks = Ticks {
            scale: self,
            low: low - margin,
            high: high + margin,
            major: Vec::new(),
            minor: Vec::new(),
        };
        match self {
            Scale::Linear => ticks.label_evenly(),
            Scale::Log => ticks.label_decades(),
        }
        Some(ticks)
    }
}

impl Ticks {
    /// Returns the position of a value: 0 at the start of the axis, 1 at its end.
    pub(super) fn position(&self, value: f64) -> f64 {
        (self.scale.forward(value) - self.low) / (self.high - self.low)
    }

    /// Returns the values at the ends.
    pub(super) fn range(&self) -> (f64, f64) {
        (self.scale.back(self.low), self.scale.back(self.high))
    }

    fn label_evenly(&mut self) {
        let rough = (self.high - self.low) / MOST_LABELS;
        let power = 10f64.powf(rough.log10().floor());
        let step = [1.0, 2.0, 5.0, 10.0].into_iter().map(|m| m * power).find(|&s| s >= rough);
        let step = step.unwrap_or(10.0 * power);
        let first = (self.low / step).ceil() as i64;
        let last = (self.high / step).floor() as i64;
        self.major = (first..=last).map(|i| i as f64 * step).map(|v| (v, number(v))).collect();
    }

    fn label_decades(&mut self) {
        let decades = self.low.floor() as i32..=self.high.ceil() as i32;
        let inside = |v: &f64| (self.low..=self.high).contains(&v.log10());
        let values = |mantissas: &[u32]| -> Vec<f64> {
            let all = decades.clone().flat_map(|d| mantissas.iter().map(move |&m| decimal(m, d)));
            all.filter(inside).collect()
        };
        let choices: [&[u32]; 4] = [&[10], &[10, 30], &[10, 20, 50], &[10, 15, 20, 30, 40, 50, 60, 80]];
        let mut labelled = Vec::new();
        for mantissas in choices {
            labelled = values(mantissas);
            if labelled.len() >= FEWEST_LABELS {
                break;
            }
        }
        // Only every second or third decade is labelled if there are many.
        let every = (labelled.len() as f64 / MOST_LABELS).ceil().max(1.0) as usize;
        let plain = 10f64.powf(self.low) >= 0.9e-3 && 10f64.powf(self.high) <= 1.1e5;
        let label = |v: f64| if plain { number(v) } else { power_of_ten(v) };
        self.minor = values(&[10, 20, 30, 40, 50, 60, 70, 80, 90]);
        if self.high - self.low > MOST_LABELS {
            self.minor = values(&[10]);
        }
        self.major = labelled.into_iter().step_by(every).map(|v| (v, label(v))).collect();
    }
}

/// Returns a tenth of the mantissa times a power of ten, rounded once.
fn decimal(mantissa: u32, power: i32) -> f64 {
    format!("{mantissa}e{}", power - 1).parse().unwrap_or(f64::NAN)
}

/// Formats a number for a reader: 0.25, 1500, 2·10⁻⁷.
pub fn number(value: f64) -> String {
    let size = value.abs();
    if !value.is_finite() || value == 0.0 || (1e-4..1e6).contains(&size) {
        let digits = if size > 0.0 && size.is_finite() { 3 - size.log10().floor() as i32 } else { 0 };
        let text = format!("{value:.*}", digits.clamp(0, 8) as usize);
        let text = if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.') } else { &text };
        return text.replace('-', "−");
    }
    power_of_ten(value)
}

/// Formats a number as 10⁻³ or 2·10⁻³.
fn power_of_ten(value: f64) -> String {
    let text = format!("{value:.2e}");
    let (mantissa, exponent) = text.split_once('e').unwrap_or((&text, "0"));
    let mantissa = mantissa.trim_end_matches('0').trim_end_matches('.').replace('-', "−");
    let power: String = exponent.chars().map(superscript).collect();
    if mantissa == "1" { format!("10{power}") } else { format!("{mantissa}·10{power}") }
}

fn superscript(digit: char) -> char {
    match digit {
        '-' => '⁻',
        '1' => '¹',
        '2' => '²',
        '3' => '³',
        other => other.to_digit(10).and_then(|d| char::from_u32(0x2070 + d)).unwrap_or(other),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn labels(scale: Scale, values: &[f64]) -> Vec<String> {
        scale.ticks(values.iter().copied()).expect("an axis").major.into_iter().map(|(_, l)| l).collect()
    }

    #[test]
    fn labels_are_round_numbers_and_neither_few_nor_many() {
        assert_eq!(labels(Scale::Log, &[0.1, 10.0]), ["0.1", "1", "10"]);
        assert_eq!(labels(Scale::Log, &[1e-5, 1e-2]), ["10⁻⁵", "10⁻⁴", "10⁻³", "10⁻²"]);
        assert_eq!(labels(Scale::Log, &[1.0, 4.0]), ["1", "1.5", "2", "3", "4"]);
        assert_eq!(labels(Scale::Linear, &[0.0, 30.0]), ["0", "5", "10", "15", "20", "25", "30"]);
        for (low, high) in [(1e-12, 1e9), (0.5, 0.7), (3.0, 3.0), (1.0, 1e5), (2e-6, 9e-6)] {
            for scale in [Scale::Log, Scale::Linear] {
                let n = labels(scale, &[low, high]).len();
                assert!((2..=9).contains(&n), "{low} {high} {scale:?}: {n}");
            }
        }
    }

    #[test]
    fn what_has_no_place_is_passed_over() {
        assert!(Scale::Log.ticks([0.0, -1.0, f64::NAN].into_iter()).is_none());
        let ticks = Scale::Log.ticks([0.0, 1.0, 100.0, f64::INFINITY].into_iter()).expect("an axis");
        assert!(ticks.position(1.0) > 0.0 && ticks.position(100.0) < 1.0);
        assert!((ticks.position(10.0) - 0.5).abs() < 1e-12);
    }

    #[test]
    fn numbers_are_written_as_people_write_them() {
        for (value, text) in [
            (0.0, "0"),
            (0.25, "0.25"),
            (-1.5, "−1.5"),
            (1500.0, "1500"),
            (123_456.0, "123456"),
            (2e-7, "2·10⁻⁷"),
            (1e9, "10⁹"),
            (0.001_234_56, "0.001235"),
            (f64::NAN, "NaN"),
        ] {
            assert_eq!(number(value), text);
        }
    }
}
