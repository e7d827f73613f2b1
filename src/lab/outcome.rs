//! The result of an experiment, as text for a terminal and as a section of a page.

use crate::estimate::convergence::PowerLaw;
use crate::lab::moments::Measured;
use crate::lab::verdict::{Check, Verdict};
use crate::report::{Html, Picture, Plot, Table, gallery};

/// A claim and the verdict on it.
#[derive(Clone, Debug, PartialEq)]
pub struct Finding {
    /// The claim, in one sentence.
    pub claim: String,
    /// The measured number with its interval.
    pub measured: String,
    /// The verdict on the claim.
    pub verdict: Verdict,
}

impl Finding {
    /// Creates a finding; the verdict on the claim comes from the checks that it implies.
    pub fn new(claim: impl Into<String>, measured: impl Into<String>, checks: &[Check]) -> Self {
        Finding { claim: claim.into(), measured: measured.into(), verdict: Verdict::of(checks) }
    }
}

/// A piece of evidence.
#[derive(Clone, Debug)]
pub enum Evidence {
    /// Sentences.
    Text(String),
    /// A table with its title.
    Table(String, Table),
    /// A plot, which only the page shows.
    Plot(Plot),
    /// Small images with their title, which only the page shows.
    Pictures(String, Vec<Picture>),
    /// Images side by side, which only the page shows.
    Viewer(Html),
}

impl Evidence {
    fn html(&self) -> Html {
        match self {
            Evidence::Text(sentences) => Html::paragraph(sentences),
            Evidence::Table(title, table) => titled(title, &table.html()),
            Evidence::Plot(plot) => plot.html(),
            Evidence::Pictures(title, pictures) => titled(title, &gallery(pictures)),
            Evidence::Viewer(viewer) => viewer.clone(),
        }
    }
}

/// Returns mark-up under a heading.
fn titled(title: &str, content: &Html) -> Html {
    let mut html = Html::element("h3", "", &Html::text(title));
    html.push(content);
    html
}

/// The result of an experiment.
#[derive(Clone, Debug)]
pub struct Outcome {
    /// The experiment's name on the command line.
    pub name: &'static str,
    /// Its title.
    pub title: &'static str,
    /// The claims.
    pub findings: Vec<Finding>,
    /// The evidence for the claims.
    pub evidence: Vec<Evidence>,
}

impl Outcome {
    /// Returns the text for a terminal.
    pub fn text(&self) -> String {
        let mut text = format!("{}: {}\n", self.name, self.title);
        for Finding { claim, measured, verdict } in &self.findings {
            let word = format!("{}:", verdict.word());
            text.push_str(&format!("  {word:<10} {claim}\n             {measured}\n"));
        }
        for evidence in &self.evidence {
            match evidence {
                Evidence::Text(sentences) => text.push_str(&format!("\n  {sentences}\n")),
                Evidence::Table(title, table) => {
                    text.push_str(&format!("\n  {title}\n"));
                    table.text().lines().for_each(|line| text.push_str(&format!("    {line}\n")));
                }
                Evidence::Plot(_) | Evidence::Pictures(..) | Evidence::Viewer(_) => {}
            }
        }
        text
    }

    /// Returns the section of a page.
    pub fn html(&self) -> Html {
        let mut html = Html::default();
        let mut list = Html::default();
        for Finding { claim, measured, verdict } in &self.findings {
            let mut item = Html::element("b", "", &Html::text(&format!("{}:", verdict.word())));
            item.push(&Html::text(&format!("{claim} ")));
            item.push(&Html::element("em", "", &Html::text(measured)));
            list.push(&Html::element("li", "", &item));
        }
        html.push(&Html::element("ul", "findings", &list));
        // Consecutive plots are placed side by side if there is space.
        let is_plot = |evidence: &Evidence| matches!(evidence, Evidence::Plot(_));
        for group in self.evidence.chunk_by(|a, b| is_plot(a) && is_plot(b)) {
            let mut content = Html::default();
            group.iter().for_each(|evidence| content.push(&evidence.html()));
            html.push(&match is_plot(&group[0]) {
                true => Html::element("div", "figures", &content),
                false => content,
            });
        }
        html
    }
}

/// Formats an exponent as `-0.501 [-0.503, -0.499]`, or as a dash if there is no law.
pub fn slope(law: Option<PowerLaw>) -> String {
    law.map_or_else(
        || "–".to_owned(),
        |law| format!("{:.3} [{:.3}, {:.3}]", law.exponent, law.interval[0], law.interval[1]),
    )
}

/// Formats a value as `1.778 ± 0.004`, with the half width of its 95 % interval.
pub fn plus_minus(measured: Measured) -> String {
    let half = 1.96 * measured.error;
    // The interval has two significant digits.
    let digits = if half > 0.0 && half.is_finite() {
        (1.0 - half.log10().floor()).clamp(0.0, 9.0) as usize
    } else {
        4
    };
    format!("{:.digits$} ± {half:.digits$}", measured.value)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn intervals_have_two_digits() {
        let number = |value, error| Measured { value, error, freedom: 9.0 };
        assert_eq!(plus_minus(number(1.77777, 0.01)), "1.778 ± 0.020");
        assert_eq!(plus_minus(number(1235.6, 20.0)), "1236 ± 39");
        assert_eq!(plus_minus(number(0.5, 0.0)), "0.5000 ± 0.0000");
        assert_eq!(slope(None), "–");
    }

    #[test]
    fn text_and_page_tell_the_verdict() {
        let outcome = Outcome {
            name: "x",
            title: "an experiment",
            findings: [("Up is up.", "1 ± 0", Verdict::Confirmed), ("Down < up.", "2", Verdict::Refuted)]
                .map(|(claim, measured, verdict)| Finding {
                    claim: claim.into(),
                    measured: measured.into(),
                    verdict,
                })
                .into(),
            evidence: vec![Evidence::Text("Because.".into())],
        };
        assert_eq!(
            outcome.text(),
            "x: an experiment\n  confirmed: Up is up.\n             1 ± 0\n  refuted:   \
             Down < up.\n             2\n\n  Because.\n"
        );
        assert!(outcome.html().as_str().contains("<b>refuted:</b>"));
        assert!(outcome.html().as_str().contains("Down &lt; up."));
    }
}
