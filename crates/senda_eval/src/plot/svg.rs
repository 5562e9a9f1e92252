//! Writing SVG: numbers, paths, text.

use crate::text::escape;

/// A coordinate with at most one decimal, as short as possible.
pub(super) fn px(value: f64) -> String {
    // Foreign numbers may be huge; a picture has no use for them.
    let tenths = (value.clamp(-1e6, 1e6) * 10.0).round();
    if tenths.is_nan() {
        return "0".into();
    }
    let tenths = tenths as i64;
    let sign = if tenths < 0 { "-" } else { "" };
    let (whole, part) = (tenths.abs() / 10, tenths.abs() % 10);
    if part == 0 {
        format!("{sign}{whole}")
    } else {
        format!("{sign}{whole}.{part}")
    }
}

/// The opening tag of a figure with its accessible name.
pub(super) fn open(width: f64, height: f64, name: &str, more: &str) -> String {
    format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" class=\"sp\" viewBox=\"0 0 {} {}\" role=\"img\" aria-label=\"{}\"{more}>",
        px(width),
        px(height),
        escape(name)
    )
}

/// Where a text begins relative to its point.
#[derive(Clone, Copy)]
pub(super) enum Anchor {
    Start,
    Middle,
    End,
}

/// One line of text.
pub(super) fn text(x: f64, y: f64, anchor: Anchor, class: &str, words: &str) -> String {
    let anchor = match anchor {
        Anchor::Start => "",
        Anchor::Middle => " text-anchor=\"middle\"",
        Anchor::End => " text-anchor=\"end\"",
    };
    let class = if class.is_empty() {
        String::new()
    } else {
        format!(" class=\"{class}\"")
    };
    format!(
        "<text x=\"{}\" y=\"{}\"{anchor}{class}>{}</text>",
        px(x),
        px(y),
        escape(words)
    )
}

/// A straight line.
pub(super) fn line(class: &str, x1: f64, y1: f64, x2: f64, y2: f64) -> String {
    format!(
        "<path class=\"{class}\" d=\"M{} {}L{} {}\"/>",
        px(x1),
        px(y1),
        px(x2),
        px(y2)
    )
}

/// A rectangle; nothing if it has no area.
pub(super) fn rect(class: &str, x: f64, y: f64, width: f64, height: f64) -> String {
    if !(width > 0.0 && height > 0.0) {
        return String::new();
    }
    format!(
        "<rect class=\"{class}\" x=\"{}\" y=\"{}\" width=\"{}\" height=\"{}\"/>",
        px(x),
        px(y),
        px(width),
        px(height)
    )
}

/// Path data for joined points in pixels, interrupted at points that are not finite, thinned to what can be seen.
pub(super) fn path_data(points: &[[f64; 2]]) -> String {
    let mut data = String::new();
    for run in points.split(|p| !(p[0].is_finite() && p[1].is_finite())) {
        if run.is_empty() {
            continue;
        }
        let kept = thinned(run, 0.15);
        for (i, point) in kept.iter().enumerate() {
            data.push(if i == 0 { 'M' } else { 'L' });
            data.push_str(&px(point[0]));
            data.push(' ');
            data.push_str(&px(point[1]));
        }
        if kept.len() == 1 {
            // A single point: a round cap makes a dot of a line without length.
            data.push_str("h0");
        }
    }
    data
}

/// The points needed so that no other is farther than `tolerance` from the line through them (Ramer 1972, Douglas &
/// Peucker 1973).
pub(crate) fn thinned(points: &[[f64; 2]], tolerance: f64) -> Vec<[f64; 2]> {
    if points.len() < 3 {
        return points.to_vec();
    }
    let mut keep = vec![false; points.len()];
    keep[0] = true;
    keep[points.len() - 1] = true;
    let mut open = vec![(0, points.len() - 1)];
    while let Some((first, last)) = open.pop() {
        let (a, b) = (points[first], points[last]);
        let along = [b[0] - a[0], b[1] - a[1]];
        let length2 = along[0] * along[0] + along[1] * along[1];
        let (mut worst, mut at) = (tolerance * tolerance, None);
        for (i, p) in points.iter().enumerate().take(last).skip(first + 1) {
            let away = [p[0] - a[0], p[1] - a[1]];
            let part = if length2 > 0.0 {
                ((away[0] * along[0] + away[1] * along[1]) / length2).clamp(0.0, 1.0)
            } else {
                0.0
            };
            let (dx, dy) = (away[0] - part * along[0], away[1] - part * along[1]);
            let distance2 = dx * dx + dy * dy;
            if distance2 > worst {
                (worst, at) = (distance2, Some(i));
            }
        }
        if let Some(at) = at {
            keep[at] = true;
            open.push((first, at));
            open.push((at, last));
        }
    }
    points
        .iter()
        .zip(keep)
        .filter(|(_, keep)| *keep)
        .map(|(point, _)| *point)
        .collect()
}

/// Estimated width of a text in the figures' 12 px font (px).
pub(super) fn text_width(words: &str) -> f64 {
    words
        .chars()
        .map(|c| {
            if c.is_uppercase() || c == 'm' || c == 'w' {
                8.6
            } else {
                6.5
            }
        })
        .sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn coordinates_are_short() {
        assert_eq!(
            [px(1.0), px(-0.04), px(-1.26), px(f64::NAN), px(1e300)],
            ["1", "0", "-1.3", "0", "1000000"]
        );
    }

    #[test]
    fn straight_runs_lose_their_inner_points_and_gaps_stay() {
        let points = [
            [0.0, 0.0],
            [1.0, 1.0],
            [2.0, 2.0],
            [f64::NAN, 0.0],
            [3.0, 0.0],
            [4.0, 5.0],
            [5.0, 0.0],
        ];
        assert_eq!(path_data(&points), "M0 0L2 2M3 0L4 5L5 0");
        assert_eq!(path_data(&[[1.0, 2.0]]), "M1 2h0");
    }
}
