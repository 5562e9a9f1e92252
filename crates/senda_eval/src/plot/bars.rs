//! Rates with their intervals as horizontal bars.

use super::svg::{self, Anchor, px};
use super::{COLOURS, ticks};
use crate::statistics::Rate;
use crate::text;

/// One row of [`RateBars`].
#[derive(Debug, Clone, PartialEq)]
pub struct RateBar {
    /// What the rate is of.
    pub label: String,
    /// The rate.
    pub rate: Rate,
    /// Colour number, modulo [`COLOURS`].
    pub colour: usize,
}

/// Rates (0..100 %) as bars with 95 % intervals as whiskers.
#[derive(Debug, Clone, PartialEq)]
pub struct RateBars {
    /// Accessible name of the figure.
    pub name: String,
    /// What the axis shows: `runs without a loss`.
    pub label: String,
    /// Rows from top to bottom.
    pub rows: Vec<RateBar>,
    /// Width (px).
    pub width_px: f64,
}

impl RateBars {
    /// The figure as an `<svg>` element.
    pub fn svg(&self) -> String {
        const ROW_PX: f64 = 24.0;
        let widest = self
            .rows
            .iter()
            .map(|row| svg::text_width(&row.label))
            .fold(40.0, f64::max);
        let left = (widest + 14.0).min(0.45 * self.width_px);
        let right = self.width_px - 150.0;
        let (top, bottom) = (8.0, 8.0 + ROW_PX * self.rows.len() as f64);
        let height_px = bottom + 40.0;
        // When all rates are high the interesting part is between 90 and 100 %: begin there, and say so by the ticks.
        let lowest = self
            .rows
            .iter()
            .map(|row| row.rate.interval.low)
            .fold(1.0, f64::min);
        let highest = self
            .rows
            .iter()
            .map(|row| row.rate.interval.high)
            .fold(0.0, f64::max);
        let (low, high) = if lowest >= 0.9 {
            (90.0, 100.0)
        } else if highest <= 0.1 {
            (0.0, 10.0)
        } else {
            (0.0, 100.0)
        };
        let to_x = |part: f64| left + (100.0 * part - low) / (high - low) * (right - left);
        let mut out = svg::open(self.width_px, height_px, &self.name, "");
        for (value, label) in ticks(low, high, 5) {
            let x = to_x(value / 100.0);
            out += &svg::line("sp-grid", x, top, x, bottom);
            out += &svg::text(x, bottom + 16.0, Anchor::Middle, "", &label);
        }
        for (i, row) in self.rows.iter().enumerate() {
            let middle = top + ROW_PX * (i as f64 + 0.5);
            let Rate {
                hits,
                count,
                interval,
            } = row.rate;
            let (begin, end) = (to_x(low / 100.0), to_x(interval.value));
            out += &svg::rect(
                &format!("sp-f{}", row.colour % COLOURS),
                begin,
                middle - 6.0,
                end - begin,
                12.0,
            );
            let (a, b) = (to_x(interval.low), to_x(interval.high));
            out += &format!(
                "<path style=\"stroke:var(--ink);stroke-width:1.3;fill:none\" d=\"M{0} {1}v8M{0} {2}H{3}M{3} {1}v8\"/>",
                px(a),
                px(middle - 4.0),
                px(middle),
                px(b)
            );
            out += &svg::text(
                left - 8.0,
                middle + 4.0,
                Anchor::End,
                "sp-strong",
                &shortened(&row.label, left - 14.0),
            );
            let words = format!("{}  ({hits} of {count})", text::percent(interval.value));
            out += &svg::text(right + 10.0, middle + 4.0, Anchor::Start, "", &words);
        }
        out += &svg::line("sp-axis", left, bottom, right, bottom);
        out += &svg::text(
            0.5 * (left + right),
            height_px - 6.0,
            Anchor::Middle,
            "",
            &format!("{} (%)", self.label),
        );
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
    fn bars_show_counts_and_escape_labels() {
        let rows = vec![
            RateBar {
                label: "<b>oval</b>".into(),
                rate: rate(499, 500),
                colour: 0,
            },
            RateBar {
                label: "x".repeat(300),
                rate: rate(0, 0),
                colour: 9,
            },
        ];
        let bars = RateBars {
            name: "rates".into(),
            label: "without a loss".into(),
            rows,
            width_px: 600.0,
        };
        let svg = bars.svg();
        assert!(svg.contains("(499 of 500)") && svg.contains("&lt;b&gt;") && !svg.contains("<b>"));
        assert_eq!(svg, bars.svg());
    }
}
