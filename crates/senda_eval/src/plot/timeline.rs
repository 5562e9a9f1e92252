//! What was going on when: one row for each thing, a bar for each time that it was.

use super::svg::{self, Anchor};
use super::{COLOURS, ticks};

/// Rows of bars along a common axis of time.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Timeline {
    /// Accessible name of the figure.
    pub name: String,
    /// Label of each row and its spans, from and to (s).
    pub rows: Vec<(String, Vec<[f64; 2]>)>,
    /// End of the axis (s).
    pub end_s: f64,
    /// Width of the picture (px); the height follows from the rows.
    pub width_px: f64,
}

impl Timeline {
    /// The figure as an `<svg>` element.
    pub fn svg(&self) -> String {
        const ROW_PX: f64 = 20.0;
        let widest = self
            .rows
            .iter()
            .map(|(label, _)| svg::text_width(label))
            .fold(40.0, f64::max);
        let left = (widest + 16.0).min(0.4 * self.width_px);
        let right = self.width_px - 12.0;
        let (top, bottom) = (6.0, 6.0 + ROW_PX * self.rows.len() as f64);
        let height_px = bottom + 38.0;
        let end_s = self.end_s.max(1e-3);
        let to_x = |time_s: f64| left + (time_s / end_s).clamp(0.0, 1.0) * (right - left);
        let mut out = svg::open(self.width_px, height_px, &self.name, "");
        for (value, label) in ticks(0.0, end_s, 8) {
            let x = to_x(value);
            out += &svg::line("sp-grid", x, top, x, bottom);
            out += &svg::text(x, bottom + 15.0, Anchor::Middle, "", &label);
        }
        for (i, (label, spans)) in self.rows.iter().enumerate() {
            let y = top + ROW_PX * i as f64;
            out += &svg::text(left - 8.0, y + 14.0, Anchor::End, "sp-strong", label);
            for [from_s, to_s] in spans {
                let x = to_x(*from_s);
                // However short, it can be seen.
                let width = (to_x(*to_s) - x).max(1.5);
                out += &svg::rect(&format!("sp-f{}", i % COLOURS), x, y + 4.0, width, ROW_PX - 8.0);
            }
        }
        out += &svg::line("sp-axis", left, bottom, right, bottom);
        out += &svg::text(
            0.5 * (left + right),
            height_px - 5.0,
            Anchor::Middle,
            "",
            "time (s)",
        );
        out + "</svg>"
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_span_is_drawn_and_labels_are_escaped() {
        let timeline = Timeline {
            name: "steps".into(),
            rows: vec![
                ("<wait>".into(), vec![[0.0, 2.0], [5.0, 5.0]]),
                ("drive".into(), vec![[2.0, 1e300]]),
            ],
            end_s: 10.0,
            width_px: 500.0,
        };
        let svg = timeline.svg();
        assert_eq!(svg.matches("<rect").count(), 3);
        assert!(svg.contains("&lt;wait&gt;") && !svg.contains("NaN"));
    }
}
