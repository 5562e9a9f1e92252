//! What is printed on the sheet, once, for both file formats.

use super::Sheet;

/// A mark on the page. Places in mm from the page's upper left corner, x right, y down; the vehicle drives upwards.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Mark {
    /// A filled rectangle; ink from 0 (white) to 1 (black).
    Box {
        /// Left, top, width, height (mm).
        bounds: [f64; 4],
        /// 0 white to 1 black.
        ink: f64,
    },
    /// A straight stroke.
    Line {
        /// x, y of the start (mm).
        from: [f64; 2],
        /// x, y of the end (mm).
        to: [f64; 2],
        /// Width of the stroke (mm).
        width: f64,
    },
    /// A line of plain ASCII text.
    Text {
        /// x, y of the left end of its base line (mm).
        at: [f64; 2],
        /// Height of the font (mm).
        size: f64,
        /// The words.
        words: String,
    },
}

/// Everything on the page.
pub(super) fn marks(sheet: &Sheet) -> Vec<Mark> {
    let mut marks = Vec::new();
    let (width, length) = (sheet.page_width_m * 1e3, sheet.page_length_m * 1e3);
    let middle = width / 2.0;
    // From metres ahead of the axle to mm below the page's upper edge.
    let down = |x_m: f64| (sheet.page_end_m() - x_m) * 1e3;
    let side = sheet.square_side_m * 1e3;
    for start in [sheet.near_square_m, sheet.far_square_m] {
        let top = down(start + sheet.square_side_m);
        let bounds = [middle - side / 2.0, top, side, side];
        marks.push(Mark::Box { bounds, ink: 1.0 });
    }
    // Everything else stays below or well beside the near square, so that the camera sees white paper around the squares.
    let near = down(sheet.near_square_m);
    marks.push(line(
        [middle, (near + 0.24 * side).min(length - 4.0)],
        [middle, length - 4.0],
    ));
    let mut rows = vec![
        "senda calibration sheet".to_owned(),
        "Print at 100 %, not fitted to the page;".to_owned(),
        "check the 10 cm against a real ruler.".to_owned(),
        format!(
            "Squares {side:.1} mm; they begin {:.1} and",
            sheet.near_square_m * 1e3
        ),
        format!("{:.1} mm ahead of the axle.", sheet.far_square_m * 1e3),
    ];
    if sheet.carries_wheels() {
        wheel_marks(&mut marks, sheet, middle, down(0.0));
        rows.push("Stand the wheels on the marks, the axle on".to_owned());
        rows.push("the cross line, the vehicle's middle on the".to_owned());
        rows.push("middle line, looking at the squares.".to_owned());
    } else {
        let start = sheet.page_start_m * 1e3;
        rows.push(format!("Lay this edge {start:.1} mm ahead of the axle,"));
        rows.push("the middle line in line with the vehicle's".to_owned());
        rows.push("middle, the squares away from the vehicle.".to_owned());
    }
    let left = 8.0;
    let text_high = ROW * rows.len() as f64;
    // The ruler stands upright at the left where there is room, else it lies along the lower edge.
    let ruler_top = near + 14.0;
    let (text_left, text_top) = if ruler_top + 100.0 < length - 6.0 {
        ruler(&mut marks, [left + 4.0, ruler_top], [0.0, 1.0], [1.0, 0.0]);
        (left + 20.0, near + 20.0)
    } else {
        ruler(&mut marks, [left, length - 6.0], [1.0, 0.0], [0.0, -1.0]);
        (left, (near + 12.0).min(length - 18.0 - text_high))
    };
    for (index, words) in rows.into_iter().enumerate() {
        let at = [text_left, text_top + ROW * (index + 1) as f64];
        marks.push(Mark::Text { at, size: 2.8, words });
    }
    marks
}

/// Distance between lines of text (mm).
const ROW: f64 = 4.4;

/// Both wheels' outlines and the line below the axle.
fn wheel_marks(marks: &mut Vec<Mark>, sheet: &Sheet, middle: f64, axle: f64) {
    let low = sheet.page_length_m * 1e3 - 3.0;
    let (half_track, tyre) = (sheet.track_m * 500.0, sheet.wheel_width_m * 1e3);
    let reach = half_track + tyre / 2.0 + 4.0;
    marks.push(line([middle - reach, axle], [middle + reach, axle]));
    for centre in [middle - half_track, middle + half_track] {
        for edge in [centre - tyre / 2.0, centre + tyre / 2.0] {
            marks.push(line([edge, axle - 10.0], [edge, (axle + 10.0).min(low)]));
        }
    }
}

fn line(from: [f64; 2], to: [f64; 2]) -> Mark {
    Mark::Line { from, to, width: 0.3 }
}

/// 10 cm with a stroke at every cm, along `along`, strokes towards `across`.
fn ruler(marks: &mut Vec<Mark>, start: [f64; 2], along: [f64; 2], across: [f64; 2]) {
    let place = |a: f64, c: f64| {
        [
            start[0] + along[0] * a + across[0] * c,
            start[1] + along[1] * a + across[1] * c,
        ]
    };
    marks.push(line(place(0.0, 0.0), place(100.0, 0.0)));
    for centimetre in 0..=10 {
        let high = if centimetre % 5 == 0 { 4.0 } else { 2.0 };
        let a = f64::from(centimetre) * 10.0;
        marks.push(line(place(a, 0.0), place(a, high)));
    }
    // Upright, words stand below their stroke; lying, the last one ends at the ruler's end.
    let last = if across[0] > 0.0 { 101.0 } else { 91.0 };
    for (a, words) in [(1.0, "0"), (last, "10 cm")] {
        let at = place(a, 5.0);
        let words = words.to_owned();
        marks.push(Mark::Text { at, size: 3.0, words });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_marks_stay_on_the_page_and_clear_of_the_squares() {
        for sheet in [
            Sheet::a4_portrait(),
            Sheet::a4_landscape(),
            Sheet::default().moved(0.3),
            Sheet::a3_portrait().moved(0.2),
            Sheet::a3_landscape(),
        ] {
            let near = (sheet.page_end_m() - sheet.near_square_m) * 1e3;
            let side = sheet.square_side_m * 1e3;
            let inside = |[x, y]: [f64; 2]| {
                assert!(x > 0.0 && x < sheet.page_width_m * 1e3, "{x}");
                assert!(y > 0.0 && y < sheet.page_length_m * 1e3, "{y}");
                let beside = (x - sheet.page_width_m * 500.0).abs() - side / 2.0;
                assert!(y > near + 0.2 * side || beside > 0.5 * side, "{x} {y}");
            };
            for mark in marks(&sheet) {
                match mark {
                    Mark::Box { .. } => {}
                    Mark::Line { from, to, .. } => {
                        inside(from);
                        inside(to);
                    }
                    Mark::Text { at, size, words } => {
                        inside([at[0], at[1] - size]);
                        inside(at);
                        // Helvetica is on average about half as wide as high.
                        let right = at[0] + 0.52 * size * words.len() as f64;
                        inside([right, at[1]]);
                        assert!(
                            right < sheet.page_width_m * 500.0,
                            "{words} crosses the middle line"
                        );
                    }
                }
            }
        }
    }
}
