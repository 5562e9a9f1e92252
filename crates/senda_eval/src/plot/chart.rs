//! A state chart as it was walked: a box for each step, an arrow for each transition that was taken.

use super::svg::{self, Anchor, px};

/// Steps in the order in which they were entered first. In a player the box of the present step lights up.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct WalkedChart {
    /// Accessible name of the figure.
    pub name: String,
    /// Name of each step and its spans, from and to (s).
    pub steps: Vec<(String, Vec<[f64; 2]>)>,
    /// Transitions by places in `steps`, each once.
    pub transitions: Vec<[usize; 2]>,
    /// Width of the picture (px); the height follows from the steps.
    pub width_px: f64,
}

/// Boxes of a row; the next row goes back.
const COLUMNS: usize = 4;
const BOX_HEIGHT_PX: f64 = 38.0;
const GAP_PX: [f64; 2] = [26.0, 30.0];
const ARROW_PX: f64 = 5.0;

impl WalkedChart {
    /// The figure as an `<svg>` element. Each step is a group with its times in `data-spans`: `0,4 6,9`.
    pub fn svg(&self) -> String {
        let columns = COLUMNS.min(self.steps.len()).max(1);
        let rows = self.steps.len().div_ceil(columns);
        let size = [
            (self.width_px - GAP_PX[0] * columns as f64) / columns as f64,
            BOX_HEIGHT_PX,
        ];
        let middle = |step: usize| {
            let (row, place) = (step / columns, step % columns);
            let column = if row.is_multiple_of(2) {
                place
            } else {
                columns - 1 - place
            };
            let along = |index: usize, axis: usize| (index as f64 + 0.5) * (size[axis] + GAP_PX[axis]);
            [along(column, 0), along(row, 1)]
        };
        let height_px = rows as f64 * (size[1] + GAP_PX[1]);
        let mut out = svg::open(self.width_px, height_px, &self.name, " data-chart=\"\"");
        for [from, to] in &self.transitions {
            out += &arrow(middle(*from), middle(*to), size, from + 1 == *to);
        }
        for (step, (name, spans)) in self.steps.iter().enumerate() {
            let centre = middle(step);
            let times: Vec<String> = spans
                .iter()
                .map(|[from_s, to_s]| format!("{from_s:.2},{to_s:.2}"))
                .collect();
            let stayed_s: f64 = spans.iter().map(|[from_s, to_s]| to_s - from_s).sum();
            out += &format!("<g class=\"sp-step\" data-spans=\"{}\">", times.join(" "));
            out += &svg::rect(
                "sp-box",
                centre[0] - 0.5 * size[0],
                centre[1] - 0.5 * size[1],
                size[0],
                size[1],
            );
            out += &svg::text(centre[0], centre[1] - 3.0, Anchor::Middle, "sp-strong", name);
            let words = format!("{} s", crate::text::fixed(stayed_s, 1));
            out += &svg::text(centre[0], centre[1] + 12.0, Anchor::Middle, "sp-small", &words);
            out += "</g>";
        }
        out + "</svg>"
    }
}

/// From box to box: straight to the next one, else in a bow that passes beside what lies between.
fn arrow(from: [f64; 2], to: [f64; 2], size: [f64; 2], is_next: bool) -> String {
    let along = [to[0] - from[0], to[1] - from[1]];
    let bow = if is_next { 0.0 } else { 0.18 };
    let over = [
        0.5 * (from[0] + to[0]) - bow * along[1],
        0.5 * (from[1] + to[1]) + bow * along[0],
    ];
    let (start, end) = (edge(from, over, size), edge(to, over, size));
    let back = [over[0] - end[0], over[1] - end[1]];
    let length = (back[0] * back[0] + back[1] * back[1]).sqrt().max(1e-9);
    let unit = back.map(|part| ARROW_PX * part / length);
    let class = if is_next { "sp-axis" } else { "sp-axis sp-dash" };
    format!(
        "<path class=\"{class}\" d=\"M{} {}Q{} {} {} {}\"/><path class=\"sp-axis\" d=\"M{} {}L{} {}L{} {}\"/>",
        px(start[0]),
        px(start[1]),
        px(over[0]),
        px(over[1]),
        px(end[0]),
        px(end[1]),
        px(end[0] + unit[0] - 0.6 * unit[1]),
        px(end[1] + unit[1] + 0.6 * unit[0]),
        px(end[0]),
        px(end[1]),
        px(end[0] + unit[0] + 0.6 * unit[1]),
        px(end[1] + unit[1] - 0.6 * unit[0]),
    )
}

/// Where the way from a box's middle towards a place leaves it.
fn edge(middle: [f64; 2], towards: [f64; 2], size: [f64; 2]) -> [f64; 2] {
    let way = [towards[0] - middle[0], towards[1] - middle[1]];
    let part = (0.5 * size[0] / way[0].abs().max(1e-9)).min(0.5 * size[1] / way[1].abs().max(1e-9));
    [middle[0] + part * way[0], middle[1] + part * way[1]]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn boxes_carry_their_times_and_arrows_end_at_their_edges() {
        let chart = WalkedChart {
            name: "walk".into(),
            steps: ["wait", "drive", "stop", "search", "<go>"]
                .map(|name| (name.to_owned(), vec![[0.0, 4.0], [6.0, 9.5]]))
                .to_vec(),
            transitions: vec![[0, 1], [1, 2], [2, 3], [3, 4], [4, 1]],
            width_px: 560.0,
        };
        let svg = chart.svg();
        assert_eq!(svg.matches("data-spans=\"0.00,4.00 6.00,9.50\"").count(), 5);
        assert_eq!(svg.matches("<rect").count(), 5);
        assert!(svg.contains("&lt;go&gt;") && !svg.contains("NaN"));
        assert_eq!(edge([0.0, 0.0], [10.0, 0.0], [8.0, 4.0]), [4.0, 0.0]);
        assert_eq!(edge([0.0, 0.0], [0.0, -9.0], [8.0, 4.0]), [0.0, -2.0]);
    }

    #[test]
    fn a_chart_without_steps_is_an_empty_figure() {
        assert!(!WalkedChart::default().svg().contains("<rect"));
    }
}
