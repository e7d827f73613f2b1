//! Plots of points, as SVG with colours that follow the page's theme.

use super::html::{Html, add, escape};
use super::scale::{Scale, Ticks, number};

/// An axis.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Axis {
    /// The quantity along the axis, with its unit.
    pub label: String,
    /// The spacing of values.
    pub scale: Scale,
}

impl Axis {
    /// Creates a logarithmic axis.
    pub fn log(label: impl Into<String>) -> Self {
        Axis { label: label.into(), scale: Scale::Log }
    }

    /// Creates a linear axis.
    pub fn linear(label: impl Into<String>) -> Self {
        Axis { label: label.into(), scale: Scale::Linear }
    }
}

/// A point of a series.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Point {
    /// The horizontal coordinate.
    pub x: f64,
    /// The vertical coordinate.
    pub y: f64,
    /// The ends of the error bar, if there is one.
    pub interval: Option<[f64; 2]>,
    /// The text of the tooltip besides the coordinates; may be empty.
    pub note: String,
}

impl Point {
    /// Creates a point without an error bar.
    pub fn new(x: f64, y: f64) -> Self {
        Point { x, y, ..Point::default() }
    }
}

/// The line that joins the points of a series.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Line {
    /// A solid line.
    #[default]
    Solid,
    /// A dashed line.
    Dashed,
    /// A dotted line.
    Dotted,
    /// No line.
    None,
    /// A thin line without markers, for a law to compare with. Its points do not widen the axes.
    Guide,
}

/// A series of points.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Series {
    /// Its name in the legend.
    pub name: String,
    /// Its points, in the order of the line. Points that the axes cannot show are left out.
    pub points: Vec<Point>,
    /// Index of the colour and of the marker, each modulo the number of them.
    pub style: usize,
    /// The line that joins the points.
    pub line: Line,
}

/// A plot.
#[derive(Clone, Debug, PartialEq)]
pub struct Plot {
    /// The caption.
    pub title: String,
    /// The horizontal axis.
    pub x: Axis,
    /// The vertical axis.
    pub y: Axis,
    /// The series of points.
    pub series: Vec<Series>,
}

/// The number of colours in the style sheet (`.s0` and so on).
pub(super) const COLOURS: usize = 8;

/// The size of a plot, in units of the SVG. A page shows one or two plots beside each other.
const SIZE: [f64; 2] = [480.0, 340.0];
/// The frame: left, top, right, bottom.
const FRAME: [f64; 4] = [66.0, 10.0, 470.0, 292.0];
/// Half the size of a marker.
const MARKER: f64 = 4.0;

/// Both axes, which map values to positions in the frame.
struct PlotAxes {
    x: Ticks,
    y: Ticks,
}

impl PlotAxes {
    fn x(&self, value: f64) -> f64 {
        FRAME[0] + self.x.position(value) * (FRAME[2] - FRAME[0])
    }

    fn y(&self, value: f64) -> f64 {
        FRAME[3] - self.y.position(value) * (FRAME[3] - FRAME[1])
    }
}

impl Plot {
    /// Returns the figure: caption, plot and legend, or caption and a sentence if there is nothing to plot.
    pub fn html(&self) -> Html {
        let mut text = format!("<figure class=\"plot\">\n<figcaption>{}</figcaption>\n", escape(&self.title));
        match self.svg() {
            Some(svg) => {
                text.push_str(&svg);
                text.push_str("<ul class=\"legend\">\n");
                for series in &self.series {
                    let key = key(series);
                    add(&mut text, format_args!("<li>{key}{}</li>\n", escape(&series.name)));
                }
                text.push_str("</ul>\n");
            }
            None => text.push_str("<p class=\"empty\">There is nothing to plot.</p>\n"),
        }
        text.push_str("</figure>\n");
        Html::raw(text)
    }

    /// Returns the plot alone; its colours are classes of the style sheet. `None` if the axes can show no point.
    fn svg(&self) -> Option<String> {
        let points =
            || self.series.iter().filter(|s| s.line != Line::Guide).flat_map(|s| self.placed(&s.points));
        let heights = points().flat_map(|p| [p.y].into_iter().chain(p.interval.into_iter().flatten()));
        let axes = PlotAxes {
            x: self.x.scale.ticks(points().map(|p| p.x))?,
            y: self.y.scale.ticks(heights.collect::<Vec<_>>().into_iter())?,
        };
        let mut svg = format!(
            "<svg viewBox=\"0 0 {} {}\" role=\"img\" aria-label=\"{}\">\n",
            SIZE[0],
            SIZE[1],
            escape(&self.title)
        );
        self.draw_axes(&mut svg, &axes);
        // An SVG element inside the SVG clips its contents and needs no id for that.
        let [left, top, right, bottom] = FRAME;
        let (width, height) = (right - left, bottom - top);
        add(
            &mut svg,
            format_args!(
                "<svg x=\"{left}\" y=\"{top}\" width=\"{width}\" height=\"{height}\" \
                 viewBox=\"{left} {top} {width} {height}\">\n"
            ),
        );
        let (guides, others): (Vec<&Series>, Vec<&Series>) =
            self.series.iter().partition(|s| s.line == Line::Guide);
        for series in guides.into_iter().chain(others) {
            self.draw_series(&mut svg, series, &axes);
        }
        svg.push_str("</svg>\n</svg>\n");
        Some(svg)
    }

    fn placed<'a>(&self, points: &'a [Point]) -> impl Iterator<Item = &'a Point> + use<'a> {
        let (x, y) = (self.x.scale, self.y.scale);
        points.iter().filter(move |p| x.holds(p.x) && y.holds(p.y))
    }

    fn draw_axes(&self, svg: &mut String, axes: &PlotAxes) {
        let [left, top, right, bottom] = FRAME;
        let mut grid = |class: &str, values: &mut dyn Iterator<Item = [f64; 4]>| {
            add(svg, format_args!("<path class=\"{class}\" d=\""));
            for [x0, y0, x1, y1] in values {
                add(svg, format_args!("M{x0:.1} {y0:.1}L{x1:.1} {y1:.1}"));
            }
            svg.push_str("\"/>\n");
        };
        let column = |v: f64| [axes.x(v), top, axes.x(v), bottom];
        let row = |v: f64| [left, axes.y(v), right, axes.y(v)];
        let minor = axes.x.minor.iter().map(|&v| column(v)).chain(axes.y.minor.iter().map(|&v| row(v)));
        grid("grid minor", &mut minor.into_iter());
        let major = axes.x.major.iter().map(|t| column(t.0)).chain(axes.y.major.iter().map(|t| row(t.0)));
        grid("grid", &mut major.into_iter());
        for (value, label) in &axes.x.major {
            let (x, y) = (axes.x(*value), bottom + 17.0);
            add(svg, format_args!("<text x=\"{x:.1}\" y=\"{y:.1}\" text-anchor=\"middle\">{label}</text>\n"));
        }
        for (value, label) in &axes.y.major {
            let (x, y) = (left - 7.0, axes.y(*value) + 4.5);
            add(svg, format_args!("<text x=\"{x:.1}\" y=\"{y:.1}\" text-anchor=\"end\">{label}</text>\n"));
        }
        let (x, y) = (f64::midpoint(left, right), f64::midpoint(top, bottom));
        let [across, along] = [&self.x.label, &self.y.label].map(|l| escape(l));
        add(
            svg,
            format_args!(
                "<text class=\"label\" x=\"{x}\" y=\"{}\" text-anchor=\"middle\">{across}</text>\n\
                 <text class=\"label\" transform=\"translate(14 {y}) rotate(-90)\" \
                 text-anchor=\"middle\">{along}</text>\n",
                SIZE[1] - 8.0
            ),
        );
    }

    fn draw_series(&self, svg: &mut String, series: &Series, axes: &PlotAxes) {
        add(svg, format_args!("<g class=\"{}\">\n", class(series)));
        let points: Vec<&Point> = self.placed(&series.points).collect();
        if series.line != Line::None {
            svg.push_str("<path class=\"line\" d=\"");
            for (i, p) in points.iter().enumerate() {
                let step = if i == 0 { 'M' } else { 'L' };
                add(svg, format_args!("{step}{:.1} {:.1}", axes.x(p.x), axes.y(p.y)));
            }
            svg.push_str("\"/>\n");
        }
        if series.line == Line::Guide {
            svg.push_str("</g>\n");
            return;
        }
        for p in points {
            let (x, y) = (axes.x(p.x), axes.y(p.y));
            if let Some(ends) = p.interval {
                let (low, high) = axes.y.range();
                let [a, b] = ends.map(|v| axes.y(v.clamp(low, high)));
                add(
                    svg,
                    format_args!(
                        "<path class=\"bar\" d=\"M{x:.1} {a:.1}V{b:.1}M{:.1} {a:.1}h6M{:.1} {b:.1}h6\"/>\n",
                        x - 3.0,
                        x - 3.0
                    ),
                );
            }
            let note = if p.note.is_empty() { String::new() } else { format!("\n{}", escape(&p.note)) };
            let (name, x_label, y_label) =
                (escape(&series.name), escape(&self.x.label), escape(&self.y.label));
            add(
                svg,
                format_args!(
                    "<path class=\"marker\" d=\"{}\"><title>{name}\n{x_label}: {}\n{y_label}: {}{note}</title></path>\n",
                    marker(series.style, x, y),
                    number(p.x),
                    number(p.y)
                ),
            );
        }
        svg.push_str("</g>\n");
    }
}

fn class(series: &Series) -> String {
    let line = match series.line {
        Line::Solid | Line::None => "",
        Line::Dashed => " dashed",
        Line::Dotted => " dotted",
        Line::Guide => return "guide".into(),
    };
    format!("s{}{line}", series.style % COLOURS)
}

/// Returns the sample of a series in the legend.
fn key(series: &Series) -> String {
    let line = if series.line == Line::None { "" } else { "<path class=\"line\" d=\"M1 7H33\"/>" };
    let marker = if series.line == Line::Guide {
        String::new()
    } else {
        format!("<path class=\"marker\" d=\"{}\"/>", marker(series.style, 17.0, 7.0))
    };
    format!(
        "<svg class=\"key\" viewBox=\"0 0 34 14\" aria-hidden=\"true\"><g class=\"{}\">{line}{marker}</g></svg>",
        class(series)
    )
}

/// Returns the outline of a marker.
fn marker(style: usize, x: f64, y: f64) -> String {
    let r = MARKER;
    let polygon = |corners: &[[f64; 2]]| {
        let mut d = String::new();
        for (i, [dx, dy]) in corners.iter().enumerate() {
            let step = if i == 0 { 'M' } else { 'L' };
            add(&mut d, format_args!("{step}{:.1} {:.1}", x + dx * r, y + dy * r));
        }
        d + "Z"
    };
    match style % 6 {
        0 => format!("M{:.1} {y:.1}a{r} {r} 0 1 0 {1} 0a{r} {r} 0 1 0 -{1} 0Z", x - r, 2.0 * r),
        1 => polygon(&[[-0.9, -0.9], [0.9, -0.9], [0.9, 0.9], [-0.9, 0.9]]),
        2 => polygon(&[[0.0, -1.3], [1.3, 0.0], [0.0, 1.3], [-1.3, 0.0]]),
        3 => polygon(&[[0.0, -1.2], [1.2, 0.9], [-1.2, 0.9]]),
        4 => polygon(&[[0.0, 1.2], [1.2, -0.9], [-1.2, -0.9]]),
        _ => polygon(&[
            [-0.4, -1.2],
            [0.4, -1.2],
            [0.4, -0.4],
            [1.2, -0.4],
            [1.2, 0.4],
            [0.4, 0.4],
            [0.4, 1.2],
            [-0.4, 1.2],
            [-0.4, 0.4],
            [-1.2, 0.4],
            [-1.2, -0.4],
            [-0.4, -0.4],
        ]),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plot(points: Vec<Point>) -> Plot {
        Plot {
            title: "a < b".into(),
            x: Axis::log("seconds"),
            y: Axis::log("relMSE"),
            series: vec![Series { name: "x & y".into(), points, ..Series::default() }],
        }
    }

    #[test]
    fn a_plot_is_well_formed_and_has_its_points() {
        let interval = Some([0.05, 0.0]);
        let points = vec![
            Point { interval, ..Point::new(1.0, 0.1) },
            Point::new(2.0, 0.0),
            Point::new(4.0, 0.025),
            Point::new(f64::NAN, 1.0),
        ];
        let mut plot = plot(points);
        let guide = vec![Point::new(1e-9, 1e9), Point::new(1e9, 1e-9)];
        plot.series.push(Series { points: guide, line: Line::Guide, ..Series::default() });
        let html = plot.html();
        let document = roxmltree::Document::parse(html.as_str()).expect("well-formed");
        let count = |class: &str| {
            document
                .descendants()
                .filter(|n| n.attribute("class") == Some(class) && n.ancestors().any(|a| a.has_tag_name("g")))
                .count()
        };
        // The axes show two points, and the legend has one more marker. Series and guide have a line in the plot and
        // one in the legend.
        assert_eq!((count("marker"), count("bar"), count("line")), (3, 1, 4));
    }

    #[test]
    fn nothing_to_plot_is_said() {
        assert!(plot(vec![Point::new(0.0, 1.0)]).html().as_str().contains("There is nothing to plot."));
    }
}
