//! Horizontal bars with their values beside them.

use super::html::{Html, add, escape};
use super::plot::COLOURS;
use super::scale::number;

/// A bar.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Bar {
    /// The name, above the bar.
    pub name: String,
    /// The length; NaN and values below 0 are shown as 0.
    pub value: f64,
    /// The least and greatest of the values that the bar represents, if there are several.
    pub range: Option<[f64; 2]>,
    /// Index of the colour, modulo the number of colours.
    pub style: usize,
}

/// Bars with a common unit, starting at zero.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Bars {
    /// The caption.
    pub title: String,
    /// The unit, after each value.
    pub unit: String,
    /// The bars, from the top.
    pub bars: Vec<Bar>,
}

const WIDTH: f64 = 480.0;
/// The space for the value beside the longest bar.
const ROOM: f64 = 110.0;
const ROW: f64 = 42.0;

impl Bars {
    /// Returns the figure.
    pub fn html(&self) -> Html {
        let height = ROW * self.bars.len() as f64;
        let (title, unit) = (escape(&self.title), escape(&self.unit));
        let longest = self
            .bars
            .iter()
            .flat_map(|b| [b.value].into_iter().chain(b.range.into_iter().flatten()))
            .filter(|v| v.is_finite())
            .fold(f64::MIN_POSITIVE, f64::max);
        let length = |v: f64| if v > 0.0 { v / longest * (WIDTH - ROOM) } else { 0.0 };
        let mut text = format!(
            "<figure class=\"plot bars\">\n<figcaption>{title}</figcaption>\n\
             <svg viewBox=\"0 0 {WIDTH} {height}\" role=\"img\" aria-label=\"{title}\">\n"
        );
        for (i, bar) in self.bars.iter().enumerate() {
            let (y, end) = (ROW * i as f64, length(bar.value));
            let [name, value] = [escape(&bar.name), number(bar.value)];
            add(
                &mut text,
                format_args!(
                    "<g class=\"s{}\"><text x=\"0\" y=\"{}\">{name}</text>\
                     <rect class=\"fill\" x=\"0\" y=\"{}\" width=\"{end:.1}\" height=\"16\" rx=\"2\"/>",
                    bar.style % COLOURS,
                    y + 13.0,
                    y + 18.0
                ),
            );
            let mut after = end;
            if let Some(range) = bar.range {
                let ([a, b], middle) = (range.map(length), y + 26.0);
                after = after.max(b);
                add(
                    &mut text,
                    format_args!(
                        "<path class=\"spread\" d=\"M{a:.1} {middle}H{b:.1}M{a:.1} {0}v6M{b:.1} {0}v6\"/>",
                        middle - 3.0
                    ),
                );
            }
            add(
                &mut text,
                format_args!(
                    "<text class=\"value\" x=\"{:.1}\" y=\"{}\">{value} {unit}</text></g>\n",
                    after + 7.0,
                    y + 31.0
                ),
            );
        }
        text.push_str("</svg>\n</figure>\n");
        Html::raw(text)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_longest_bar_sets_the_scale_and_nonsense_has_no_length() {
        let bar = |value| Bar { name: "<b>".into(), value, ..Bar::default() };
        let bars = Bars {
            title: "t".into(),
            unit: "Mray/s".into(),
            bars: vec![bar(10.0), Bar { range: Some([4.0, 6.0]), ..bar(5.0) }, bar(f64::NAN), bar(-1.0)],
        };
        let html = bars.html();
        let document = roxmltree::Document::parse(html.as_str()).expect("well-formed");
        let widths: Vec<&str> = document
            .descendants()
            .filter(|n| n.has_tag_name("rect"))
            .flat_map(|n| n.attribute("width"))
            .collect();
        assert_eq!(widths, ["370.0", "185.0", "0.0", "0.0"]);
        assert!(html.as_str().contains("10 Mray/s"));
    }
}
