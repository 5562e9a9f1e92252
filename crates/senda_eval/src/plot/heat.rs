//! A grid of values as shaded cells with the values written in.

use super::svg::{self, Anchor};

/// Values by two properties, such as failures by floor and light.
#[derive(Debug, Clone, PartialEq)]
pub struct HeatGrid {
    /// Accessible name of the figure.
    pub name: String,
    /// Names of the rows, top to bottom.
    pub rows: Vec<String>,
    /// Names of the columns, left to right.
    pub columns: Vec<String>,
    /// `values[row][column]` with the text to show; `None` where there is nothing.
    pub values: Vec<Vec<Option<(f64, String)>>>,
    /// Value of an empty and of a full cell.
    pub range: [f64; 2],
    /// Whether full means bad: drawn in the alarm colour.
    pub full_is_bad: bool,
}

impl HeatGrid {
    /// The figure as an `<svg>` element.
    pub fn svg(&self) -> String {
        const CELL: [f64; 2] = [92.0, 30.0];
        let left = self
            .rows
            .iter()
            .map(|row| svg::text_width(row))
            .fold(30.0, f64::max)
            .min(260.0)
            + 14.0;
        let top = 26.0;
        let width_px = left + CELL[0] * self.columns.len() as f64 + 4.0;
        let height_px = top + CELL[1] * self.rows.len() as f64 + 4.0;
        let mut out = svg::open(
            width_px,
            height_px,
            &self.name,
            &format!(" style=\"max-width:{width_px:.0}px\""),
        );
        for (j, column) in self.columns.iter().enumerate() {
            let x = left + CELL[0] * (j as f64 + 0.5);
            out += &svg::text(x, top - 9.0, Anchor::Middle, "sp-strong", column);
        }
        for (i, row) in self.rows.iter().enumerate() {
            let y = top + CELL[1] * i as f64;
            out += &svg::text(left - 8.0, y + 19.0, Anchor::End, "sp-strong", row);
            for j in 0..self.columns.len() {
                let x = left + CELL[0] * j as f64;
                let Some((value, label)) = self.values.get(i).and_then(|r| r.get(j)).and_then(Option::as_ref)
                else {
                    continue;
                };
                let part = ((value - self.range[0]) / (self.range[1] - self.range[0])).clamp(0.0, 1.0);
                let part = if part.is_nan() { 0.0 } else { part };
                let colour = if self.full_is_bad { "sp-falarm" } else { "sp-f0" };
                out += &format!(
                    "<g fill-opacity=\"{:.2}\">{}</g>",
                    0.06 + 0.6 * part,
                    svg::rect(colour, x + 1.0, y + 1.0, CELL[0] - 2.0, CELL[1] - 2.0)
                );
                out += &svg::text(x + 0.5 * CELL[0], y + 19.0, Anchor::Middle, "sp-strong", label);
            }
        }
        out + "</svg>"
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn missing_cells_and_rows_are_left_empty() {
        let grid = HeatGrid {
            name: "g".into(),
            rows: vec!["a".into(), "b".into()],
            columns: vec!["<x>".into()],
            values: vec![vec![Some((f64::NAN, "?".into()))]],
            range: [0.0, 0.0],
            full_is_bad: true,
        };
        let svg = grid.svg();
        assert!(svg.contains("&lt;x&gt;") && !svg.contains("NaN"));
    }
}
