//! Rates with their intervals, one row each: a dot at the rate, a whisker over the interval.
//!
//! Dots, not bars: a bar's length means something only from zero, and good drivers differ between 95 and 100 %.

use super::svg::{self, Anchor, px};
use super::{COLOURS, ticks};
use crate::statistics::Rate;
use crate::text;

/// One row of [`RateRows`].
#[derive(Debug, Clone, PartialEq)]
pub struct RateRow {
    /// What the rate is of.
    pub label: String,
    /// The rate.
    pub rate: Rate,
    /// Colour number, modulo [`COLOURS`].
    pub colour: usize,
}

/// Rates in per cent with 95 % intervals.
#[derive(Debug, Clone, PartialEq)]
pub struct RateRows {
    /// Accessible name of the figure.
    pub name: String,
    /// What the axis shows: `runs without a loss`.
    pub label: String,
    /// Rows from top to bottom.
    pub rows: Vec<RateRow>,
    /// Range of the axis (per cent); `None`: [`RateRows::fitting_range`] of the rows.
    pub range: Option<[f64; 2]>,
    /// Width (px).
    pub width_px: f64,
}

impl RateRows {
    /// The narrowest of a few round ranges (per cent) that holds all intervals, so that figures side by side agree.
    pub fn fitting_range<'a>(rates: impl IntoIterator<Item = &'a Rate>) -> [f64; 2] {
        let (mut lowest, mut highest) = (1.0f64, 0.0f64);
        for rate in rates {
            (lowest, highest) = (lowest.min(rate.interval.low), highest.max(rate.interval.high));
        }
        for low in [99.0, 98.0, 95.0, 90.0, 80.0, 50.0] {
            if 100.0 * lowest >= low {
                return [low, 100.0];
            }
        }
        for high in [1.0, 2.0, 5.0, 10.0, 20.0, 50.0] {
            if 100.0 * highest <= high {
                return [0.0, high];
            }
        }
        [0.0, 100.0]
    }

    /// The figure as an `<svg>` element.
    pub fn svg(&self) -> String {
        const ROW_PX: f64 = 24.0;
        let widest = self
            .rows
            .iter()
            .map(|row| svg::text_width(&row.label))
            .fold(40.0, f64::max);
        let left = (widest + 16.0).min(0.45 * self.width_px);
        let right = self.width_px - 150.0;
        let (top, bottom) = (6.0, 6.0 + ROW_PX * self.rows.len() as f64);
        let height_px = bottom + 40.0;
        let [low, high] = self
            .range
            .unwrap_or_else(|| Self::fitting_range(self.rows.iter().map(|row| &row.rate)));
        let to_x =
            |part: f64| left + (100.0 * part - low).clamp(0.0, high - low) / (high - low) * (right - left);
        let mut out = svg::open(self.width_px, height_px, &self.name, "");
        for (value, label) in ticks(low, high, 5) {
            let x = to_x(value / 100.0);
            out += &svg::line("sp-grid", x, top, x, bottom);
            out += &svg::text(x, bottom + 16.0, Anchor::Middle, "", &label);
        }
        for (i, row) in self.rows.iter().enumerate() {
            let middle = top + ROW_PX * (i as f64 + 0.5);
            let colour = row.colour % COLOURS;
            let Rate {
                hits,
                count,
                interval,
            } = row.rate;
            out += &format!(
                "<path class=\"sp-c{colour}\" style=\"stroke-width:3;opacity:.45;stroke-linecap:round\" d=\"M{} {}H{}\"/>",
                px(to_x(interval.low)),
                px(middle),
                px(to_x(interval.high))
            );
            if count > 0 {
                out += &format!(
                    "<circle class=\"sp-f{colour}\" cx=\"{}\" cy=\"{}\" r=\"5\"/>",
                    px(to_x(interval.value)),
                    px(middle)
                );
            }
            let label = shortened(&row.label, left - 14.0);
            out += &svg::text(left - 10.0, middle + 4.0, Anchor::End, "sp-strong", &label);
            let words = format!("{}  ({hits} of {count})", text::percent(interval.value));
            out += &svg::text(right + 12.0, middle + 4.0, Anchor::Start, "", &words);
        }
        out += &svg::line("sp-axis", left, bottom, right, bottom);
        let label = format!("{} (%)", self.label);
        out += &svg::text(0.5 * (left + right), height_px - 6.0, Anchor::Middle, "", &label);
        out += "</svg>";
        out
    }
}

/// As much of a label as fits into `room` px.
fn shortened(label: &str, room: f64) -> String {
    if svg::text_width(label) <= room {
        return label.to_owned();
    }
    let mut kept = String::new();
    for c in label.chars() {
        if svg::text_width(&kept) + 20.0 > room {
            break;
        }
        kept.push(c);
    }
    kept + "…"
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::statistics::rate;

    #[test]
    fn rows_show_counts_and_escape_labels() {
        let rows = vec![
            RateRow {
                label: "<b>oval</b>".into(),
                rate: rate(499, 500),
                colour: 0,
            },
            RateRow {
                label: "x".repeat(300),
                rate: rate(0, 0),
                colour: 9,
            },
        ];
        let bars = RateRows {
            name: "rates".into(),
            label: "without a loss".into(),
            rows,
            range: None,
            width_px: 600.0,
        };
        let svg = bars.svg();
        assert!(svg.contains("(499 of 500)") && svg.contains("&lt;b&gt;") && !svg.contains("<b>"));
        assert_eq!(svg, bars.svg());
        assert_eq!(RateRows::fitting_range(&[rate(500, 500)]), [99.0, 100.0]);
        assert_eq!(
            RateRows::fitting_range(&[rate(1, 500), rate(400, 500)]),
            [0.0, 100.0]
        );
    }
}
