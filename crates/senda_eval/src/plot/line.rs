//! Line plots and scatter plots.

use super::svg::{self, Anchor, px};
use super::{Axis, COLOURS, ticks};
use crate::text::escape;

/// How a series is drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Stroke {
    /// A solid line.
    #[default]
    Line,
    /// A dashed line.
    Dashed,
    /// A thin solid line, for the less important.
    Thin,
    /// Dots that are not joined: a scatter plot.
    Dots,
}

/// One series of a plot, in the axes' units.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Series {
    /// Name in the legend.
    pub name: String,
    /// Key under which an interactive page finds the values; empty for none.
    pub key: String,
    /// x and y. A value that is not finite interrupts the line.
    pub points: Vec<[f64; 2]>,
    /// Colour number, modulo [`COLOURS`].
    pub colour: usize,
    /// How it is drawn.
    pub stroke: Stroke,
}

/// A shaded range of y, such as the corridor.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Band {
    /// Lower and upper end.
    pub y: [f64; 2],
    /// Name in the legend; empty for none.
    pub name: String,
}

/// A shaded range of x, such as the time outside the corridor.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Span {
    /// Begin and end.
    pub x: [f64; 2],
}

/// A dotted line at a value of y with a label.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Rule {
    /// Where.
    pub y: f64,
    /// What it is.
    pub name: String,
}

/// A plot with axes, grid, legend and any number of series.
#[derive(Debug, Clone, PartialEq)]
pub struct LinePlot {
    /// Title above the plot; empty for none.
    pub title: String,
    /// Accessible name: what a reader who cannot see the figure is told.
    pub name: String,
    /// Horizontal axis.
    pub x: Axis,
    /// Vertical axis.
    pub y: Axis,
    /// What is plotted; later series lie on top.
    pub series: Vec<Series>,
    /// Shaded ranges of y.
    pub bands: Vec<Band>,
    /// Shaded ranges of x, and their common name in the legend.
    pub spans: Vec<Span>,
    /// Name of the spans in the legend; empty for none.
    pub spans_name: String,
    /// Dotted lines.
    pub rules: Vec<Rule>,
    /// Which column of an interactive page runs along x (`time`, `percent`); empty for none.
    pub x_key: String,
    /// Width (px).
    pub width_px: f64,
    /// Height (px).
    pub height_px: f64,
}

impl Default for LinePlot {
    fn default() -> Self {
        Self {
            title: String::new(),
            name: String::new(),
            x: Axis::default(),
            y: Axis::default(),
            series: Vec::new(),
            bands: Vec::new(),
            spans: Vec::new(),
            spans_name: String::new(),
            rules: Vec::new(),
            x_key: String::new(),
            width_px: 560.0,
            height_px: 230.0,
        }
    }
}

impl LinePlot {
    /// The plot as an `<svg>` element (see [`super::standalone`]).
    pub fn svg(&self) -> String {
        let all = || self.series.iter().flat_map(|s| s.points.iter());
        let [x_low, x_high] = self.x.fit(all().map(|p| p[0]), false);
        let [y_low, y_high] = self.y.fit(all().filter(|p| p[0].is_finite()).map(|p| p[1]), true);
        let y_ticks = ticks(y_low, y_high, 5);

        let label_px = y_ticks
            .iter()
            .map(|(_, label)| svg::text_width(label))
            .fold(0.0, f64::max);
        let (left, right) = (label_px + 14.0, self.width_px - 12.0);
        let title_px = if self.title.is_empty() { 0.0 } else { 22.0 };
        let (legend, legend_px) = self.legend(left, title_px + 13.0, right, &self.y.name());
        let (top, bottom) = (title_px + legend_px + 10.0, self.height_px - 36.0);
        let to_x = |x: f64| left + (x - x_low) / (x_high - x_low) * (right - left);
        let to_y = |y: f64| bottom - (y - y_low) / (y_high - y_low) * (bottom - top);

        let interactive = if self.x_key.is_empty() {
            String::new()
        } else {
            let frame: Vec<String> = [left, top, right, bottom].iter().map(|v| px(*v)).collect();
            format!(
                " data-x=\"{}\" data-frame=\"{}\" data-range=\"{x_low} {x_high} {y_low} {y_high}\"",
                escape(&self.x_key),
                frame.join(" ")
            )
        };
        let name = if self.name.is_empty() {
            &self.title
        } else {
            &self.name
        };
        let mut out = svg::open(self.width_px, self.height_px, name, &interactive);
        if !self.title.is_empty() {
            out += &svg::text(left, 15.0, Anchor::Start, "sp-title", &self.title);
        }
        out += &legend;
        for band in &self.bands {
            let (low, high) = (band.y[0].clamp(y_low, y_high), band.y[1].clamp(y_low, y_high));
            out += &svg::rect("sp-band", left, to_y(high), right - left, to_y(low) - to_y(high));
        }
        for span in &self.spans {
            let (begin, end) = (
                to_x(span.x[0].clamp(x_low, x_high)),
                to_x(span.x[1].clamp(x_low, x_high)),
            );
            // At least visible, however short.
            let width = (end - begin).max(1.5);
            out += &svg::rect(
                "sp-span",
                begin,
                top,
                width.min(right - begin + 1.5),
                bottom - top,
            );
        }
        let mut grid = String::new();
        for (value, label) in &y_ticks {
            let y = to_y(*value);
            grid += &format!("M{} {}H{}", px(left), px(y), px(right));
            out += &svg::text(left - 6.0, y + 4.0, Anchor::End, "", label);
        }
        let mut marks = String::new();
        let x_count = ((right - left) / 80.0).clamp(2.0, 10.0) as usize;
        for (value, label) in ticks(x_low, x_high, x_count) {
            let x = to_x(value);
            marks += &format!("M{} {}v4", px(x), px(bottom));
            out += &svg::text(x, bottom + 16.0, Anchor::Middle, "", &label);
        }
        out += &format!("<path class=\"sp-grid\" d=\"{grid}\"/>");
        if y_low < 0.0 && y_high > 0.0 {
            out += &svg::line("sp-zero", left, to_y(0.0), right, to_y(0.0));
        }
        out += &format!(
            "<path class=\"sp-axis\" d=\"M{} {}H{}{marks}\"/>",
            px(left),
            px(bottom),
            px(right)
        );
        out += &svg::text(
            0.5 * (left + right),
            self.height_px - 5.0,
            Anchor::Middle,
            "",
            &self.x.name(),
        );
        for rule in self
            .rules
            .iter()
            .filter(|rule| (y_low..=y_high).contains(&rule.y))
        {
            out += &svg::line("sp-rule", left, to_y(rule.y), right, to_y(rule.y));
            out += &svg::text(
                right - 3.0,
                to_y(rule.y) - 4.0,
                Anchor::End,
                "sp-small",
                &rule.name,
            );
        }
        for series in &self.series {
            // Far outside a fixed range a line may run, but not for ever.
            let (reach_x, reach_y) = (20.0 * (x_high - x_low), 20.0 * (y_high - y_low));
            let clipped = |p: &[f64; 2]| {
                [
                    to_x(p[0].clamp(x_low - reach_x, x_high + reach_x)),
                    to_y(p[1].clamp(y_low - reach_y, y_high + reach_y)),
                ]
            };
            let points: Vec<[f64; 2]> = series.points.iter().map(clipped).collect();
            out += &drawn(series, &points, [left, top, right, bottom]);
        }
        out += "<g class=\"sp-cursor\"></g></svg>";
        out
    }

    /// Unit of y and names of the series in rows above the plot, and their height (px).
    fn legend(&self, left: f64, first_y: f64, right: f64, y_name: &str) -> (String, f64) {
        let mut out = svg::text(2.0, first_y, Anchor::Start, "sp-strong", y_name);
        let mut entries: Vec<(String, &str)> = Vec::new();
        if self.series.len() > 1 {
            for series in self.series.iter().filter(|series| !series.name.is_empty()) {
                entries.push((swatch(series), &series.name));
            }
        }
        let square =
            |class: &str| format!("<rect class=\"{class}\" x=\"0\" y=\"-9\" width=\"14\" height=\"10\"/>");
        for band in self.bands.iter().filter(|band| !band.name.is_empty()) {
            entries.push((square("sp-band"), &band.name));
        }
        if !self.spans.is_empty() && !self.spans_name.is_empty() {
            entries.push((square("sp-span"), &self.spans_name));
        }
        let width = |name: &str| svg::text_width(name) + 36.0;
        let total: f64 = entries.iter().map(|(_, name)| width(name)).sum();
        // Beside the axis name when there is room, flush right; else in rows of its own.
        let beside = svg::text_width(y_name) + 24.0 + total <= right;
        let (mut x, mut y) = if beside {
            (right - total + 16.0, first_y)
        } else {
            (left, first_y + 17.0)
        };
        for (picture, name) in &entries {
            if !beside && x > left && x + width(name) > right + 16.0 {
                (x, y) = (left, y + 17.0);
            }
            out += &format!("<g transform=\"translate({} {})\">{picture}", px(x), px(y));
            out += &svg::text(19.0, 0.0, Anchor::Start, "", name);
            out += "</g>";
            x += width(name);
        }
        (out, y - first_y + 15.0)
    }
}

fn swatch(series: &Series) -> String {
    let colour = series.colour % COLOURS;
    match series.stroke {
        Stroke::Dots => format!("<circle class=\"sp-dot sp-f{colour}\" cx=\"7\" cy=\"-4\" r=\"3\"/>"),
        stroke => format!("<path class=\"{}\" d=\"M0 -4H14\"/>", line_class(stroke, colour)),
    }
}

fn line_class(stroke: Stroke, colour: usize) -> String {
    match stroke {
        Stroke::Line | Stroke::Dots => format!("sp-line sp-c{colour}"),
        Stroke::Dashed => format!("sp-line sp-dash sp-c{colour}"),
        Stroke::Thin => format!("sp-line sp-thin sp-c{colour}"),
    }
}

/// The series itself; `points` in pixels.
fn drawn(series: &Series, points: &[[f64; 2]], [left, top, right, bottom]: [f64; 4]) -> String {
    let colour = series.colour % COLOURS;
    let key = if series.key.is_empty() {
        String::new()
    } else {
        format!(
            " data-key=\"{}\" data-colour=\"{colour}\" data-name=\"{}\"",
            escape(&series.key),
            escape(&series.name)
        )
    };
    if series.stroke == Stroke::Dots {
        let inside = |p: &&[f64; 2]| {
            (left - 1.0..=right + 1.0).contains(&p[0]) && (top - 1.0..=bottom + 1.0).contains(&p[1])
        };
        let dots: String = points
            .iter()
            .filter(inside)
            .map(|p| format!("<circle cx=\"{}\" cy=\"{}\" r=\"2.2\"/>", px(p[0]), px(p[1])))
            .collect();
        return format!("<g class=\"sp-dot sp-f{colour}\"{key}>{dots}</g>");
    }
    // What leaves a fixed range is cut off at the frame.
    let overflows = points
        .iter()
        .any(|p| p[0] < left - 0.5 || p[0] > right + 0.5 || p[1] < top - 0.5 || p[1] > bottom + 0.5);
    let clip = if overflows {
        format!(
            " style=\"clip-path:polygon({0}px {1}px,{2}px {1}px,{2}px {3}px,{0}px {3}px)\"",
            px(left),
            px(top),
            px(right),
            px(bottom)
        )
    } else {
        String::new()
    };
    format!(
        "<path class=\"{}\"{key}{clip} d=\"{}\"/>",
        line_class(series.stroke, colour),
        svg::path_data(points)
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plot() -> LinePlot {
        let wave = |scale: f64| {
            (0..100)
                .map(|i| [f64::from(i), scale * f64::from(i % 17)])
                .collect()
        };
        LinePlot {
            title: "Lane <error>".into(),
            x: Axis::new("time", "s"),
            y: Axis::new("lane error", "cm").including(0.0),
            series: vec![
                Series {
                    name: "a&b".into(),
                    points: wave(1.0),
                    ..Series::default()
                },
                Series {
                    name: "c".into(),
                    points: wave(-0.5),
                    colour: 1,
                    stroke: Stroke::Dots,
                    ..Series::default()
                },
            ],
            bands: vec![Band {
                y: [-1.0, 1.0],
                name: "corridor".into(),
            }],
            spans: vec![Span { x: [10.0, 12.0] }],
            rules: vec![Rule {
                y: 3.0,
                name: "limit".into(),
            }],
            ..LinePlot::default()
        }
    }

    #[test]
    fn the_same_input_gives_the_same_bytes_and_foreign_names_stay_text() {
        let svg = plot().svg();
        assert_eq!(svg, plot().svg());
        assert!(svg.contains("Lane &lt;error&gt;") && svg.contains("a&amp;b") && !svg.contains("<error>"));
    }

    #[test]
    fn nothing_to_plot_is_still_a_figure() {
        for points in [
            vec![],
            vec![[f64::NAN, f64::NAN]],
            vec![[f64::INFINITY, 1.0], [0.0, 1e300]],
        ] {
            let series = vec![Series {
                points,
                ..Series::default()
            }];
            let svg = LinePlot {
                series,
                ..LinePlot::default()
            }
            .svg();
            assert!(svg.starts_with("<svg") && svg.ends_with("</svg>"));
            assert!(!svg.contains("NaN") && !svg.contains("inf"), "{svg}");
        }
    }
}
