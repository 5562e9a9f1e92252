//! From straight pieces of edges to two lines and a servo angle, as document A's follower does it (A4 in SPEC).

use senda_geom::trig;
use senda_vision::Segment;
use serde::{Deserialize, Serialize};

/// How a segment is given to the lane's left or right line.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Sides {
    /// By where its middle lies: in the left or in the right part of the picture ([`side_part`]: a third). A4.
    ///
    /// [`side_part`]: crate::HoughDriverOptions::side_part
    #[default]
    Place,
    /// By how it leans: one that rises to the right is of the left line, one that falls to the right is of the right line.
    /// Only the opposite side's part of the picture is closed to it. In a curve the outer line crosses the thirds; this
    /// rule keeps it.
    Lean,
}

/// A line of the lane in the picture: where it meets the lowest row and the highest row that is looked at (px).
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct ScreenLine {
    /// Column in the lowest row.
    pub(crate) near_px: f64,
    /// Column in the first row below the crop.
    pub(crate) far_px: f64,
}

/// The part of the picture that is looked at (px).
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct View {
    pub(crate) width_px: f64,
    /// First row that is looked at.
    pub(crate) top_px: f64,
    /// The picture's lower edge.
    pub(crate) bottom_px: f64,
}

/// What a frame showed.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct ScreenLane {
    pub(crate) left: Option<ScreenLine>,
    pub(crate) right: Option<ScreenLine>,
}

/// Segments flatter than this are no lane lines (rows, for one column): extended to the lowest row they would end
/// anywhere. A guess.
const FLATTEST: f64 = 0.1;

impl ScreenLane {
    /// The lane of a frame: every segment is extended to the rows where the view begins and ends, and the ends of each
    /// side are averaged, long segments counting more. (The document averages slope and intercept, which has no answer
    /// for upright segments.)
    pub(crate) fn from_segments(segments: &[Segment], view: View, sides: Sides, side_part: f64) -> Self {
        let mut left = Mean::default();
        let mut right = Mean::default();
        for segment in segments {
            let [[u, v], [other_u, other_v]] =
                [segment.from, segment.to].map(|end| end.map(|px| f64::from(px) + 0.5));
            let (across, down) = (other_u - u, other_v - v);
            if down.abs() <= FLATTEST * across.abs() {
                continue;
            }
            let columns_per_row = across / down;
            let at = |row: f64| (u + (row - v) * columns_per_row).clamp(-view.width_px, 2.0 * view.width_px);
            let line = ScreenLine {
                near_px: at(view.bottom_px),
                far_px: at(view.top_px),
            };
            let side_px = side_part * view.width_px;
            let (is_left, is_right) = match sides {
                Sides::Place => {
                    let middle = 0.5 * (u + other_u);
                    (middle < side_px, middle > view.width_px - side_px)
                }
                Sides::Lean => (
                    columns_per_row < 0.0 && u.max(other_u) < view.width_px - side_px,
                    columns_per_row > 0.0 && u.min(other_u) > side_px,
                ),
            };
            let weight = trig::hypot(across, down);
            if is_left {
                left.add(line, weight);
            } else if is_right {
                right.add(line, weight);
            }
        }
        Self {
            left: left.line(),
            right: right.line(),
        }
    }

    /// How many of the two lines are there.
    pub(crate) fn lines(&self) -> usize {
        [self.left, self.right].iter().flatten().count()
    }

    /// The servo angle that the lane asks for (°; 90 straight ahead, smaller to the left): towards the middle between
    /// both lines at the far row, or as a single line leans.
    pub(crate) fn servo_angle_deg(&self, view: View) -> Option<f64> {
        let across_px = match (self.left, self.right) {
            (None, None) => return None,
            (Some(one), None) | (None, Some(one)) => one.far_px - one.near_px,
            (Some(left), Some(right)) => 0.5 * (left.far_px + right.far_px) - 0.5 * view.width_px,
        };
        let up_px = (view.bottom_px - view.top_px).max(1.0);
        Some(SERVO_STRAIGHT_DEG + trig::atan(across_px / up_px).to_degrees())
    }
}

/// The servo angle of wheels that point straight ahead (°). A2.
pub(crate) const SERVO_STRAIGHT_DEG: f64 = 90.0;

/// Where the heading line of a servo angle (°) meets the far row (px); it begins at the middle of the lowest row.
pub(crate) fn heading_px(view: View, servo_angle_deg: f64) -> f64 {
    let aside = trig::tan((servo_angle_deg - SERVO_STRAIGHT_DEG).to_radians());
    0.5 * view.width_px + (view.bottom_px - view.top_px) * aside
}

/// A mean of lines.
#[derive(Default)]
struct Mean {
    near: f64,
    far: f64,
    weight: f64,
}

impl Mean {
    fn add(&mut self, line: ScreenLine, weight: f64) {
        self.near += weight * line.near_px;
        self.far += weight * line.far_px;
        self.weight += weight;
    }

    fn line(&self) -> Option<ScreenLine> {
        (self.weight > 0.0).then(|| ScreenLine {
            near_px: self.near / self.weight,
            far_px: self.far / self.weight,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const VIEW: View = View {
        width_px: 320.0,
        top_px: 120.0,
        bottom_px: 240.0,
    };

    fn segment(from: [u32; 2], to: [u32; 2]) -> Segment {
        Segment { from, to }
    }

    fn lane(segments: &[Segment], sides: Sides) -> ScreenLane {
        ScreenLane::from_segments(segments, VIEW, sides, 1.0 / 3.0)
    }

    #[test]
    fn thirds_tell_the_sides_and_the_middle_third_counts_for_nobody() {
        let left = segment([40, 230], [90, 130]);
        let right = segment([280, 230], [230, 130]);
        let between = segment([150, 230], [160, 130]);
        let seen = lane(&[left, between, right], Sides::Place);
        assert_eq!(seen, lane(&[left, right], Sides::Place));
        assert_eq!(seen.lines(), 2);
        assert!(lane(&[between], Sides::Place).servo_angle_deg(VIEW).is_none());
    }

    #[test]
    fn a_lane_in_the_middle_asks_for_straight_ahead_and_one_to_the_left_for_less_than_90() {
        let angle = |shift: u32| {
            let left = segment([10 + shift, 230], [60 + shift, 130]);
            let right = segment([250 + shift, 230], [200 + shift, 130]);
            lane(&[left, right], Sides::Lean).servo_angle_deg(VIEW).unwrap()
        };
        // Pixel centres lie half a pixel further right.
        assert!((angle(30) - 90.24).abs() < 0.01, "{}", angle(30));
        assert!(angle(5) < 80.0 && angle(55) > 100.0);
    }

    #[test]
    fn one_line_is_followed_as_it_leans() {
        let right = lane(&[segment([300, 230], [230, 130])], Sides::Place);
        assert_eq!((right.left, right.lines()), (None, 1));
        // 70 columns in 100 rows: 35° to the left.
        assert!((right.servo_angle_deg(VIEW).unwrap() - (90.0 - 34.992)).abs() < 0.01);
        let left = lane(&[segment([30, 230], [100, 130])], Sides::Place);
        assert!((left.servo_angle_deg(VIEW).unwrap() - (90.0 + 34.992)).abs() < 0.01);
    }

    #[test]
    fn both_edges_of_a_line_become_its_middle() {
        let seen = lane(
            &[segment([40, 230], [90, 130]), segment([60, 230], [110, 130])],
            Sides::Place,
        );
        let line = seen.left.unwrap();
        assert!(
            (line.near_px - 45.75).abs() < 0.01 && (line.far_px - 105.75).abs() < 0.01,
            "{line:?}"
        );
    }

    #[test]
    fn leaning_tells_the_sides_where_thirds_do_not() {
        // The outer line of a curve to the left, far into the middle.
        let outer = segment([300, 220], [120, 125]);
        assert_eq!(lane(&[outer], Sides::Place).lines(), 0);
        assert!(lane(&[outer], Sides::Lean).right.is_some());
    }

    #[test]
    fn flat_and_upright_segments_do_no_harm() {
        let flat = segment([10, 200], [90, 200]);
        let upright = segment([50, 130], [50, 230]);
        let dot = segment([50, 130], [50, 130]);
        assert_eq!(lane(&[flat, dot], Sides::Place).lines(), 0);
        let line = lane(&[upright], Sides::Place).left.unwrap();
        assert_eq!((line.near_px, line.far_px), (50.5, 50.5));
    }

    #[test]
    fn the_heading_line_points_where_the_angle_says() {
        assert_eq!(heading_px(VIEW, 90.0), 160.0);
        assert!((heading_px(VIEW, 45.0) - 40.0).abs() < 1e-9);
    }
}
