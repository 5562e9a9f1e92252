//! What plots of a lap share: its axis of per cent, and where its hard curves are.

use crate::metrics::Course;
use senda_geom::{Vec2, angle};

/// Values over per cent of the lap as points.
pub fn against_percent(percent: &[f64], values: &[f64]) -> Vec<[f64; 2]> {
    let mut points: Vec<[f64; 2]> = Vec::with_capacity(values.len());
    for (x, y) in percent.iter().zip(values) {
        // From 100 to 0 a new lap begins: no line across.
        if points.last().is_some_and(|last| (last[0] - x).abs() > 50.0) {
            points.push([f64::NAN, f64::NAN]);
        }
        points.push([*x, *y]);
    }
    points
}

/// A hard curve of a course.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HardCurve {
    /// Where it is (per cent of lap).
    pub percent: f64,
    /// What an enlarged map of it shows ([`super::Map::window`]): lower left and upper right corner (m).
    pub window: [Vec2; 2],
}

/// How far apart two curves must be to count as two (m), and how much of the road an enlarged one shows (m): guesses for roads of a
/// kilometre; shorter laps have less.
const APART_M: f64 = 120.0;
const SHOWN_M: f64 = 45.0;
/// What turns by less within the window that is looked at is no curve (rad): 1°, a guess.
const STRAIGHT_RAD: f64 = std::f64::consts::PI / 180.0;

/// The two sharpest curves of a course, the sharpest first; fewer where it has fewer.
pub fn hard_curves(course: &Course) -> Vec<HardCurve> {
    let path = course.path;
    let length_m = path.length_m();
    let (apart_m, half_m) = (APART_M.min(0.2 * length_m), SHOWN_M.min(0.1 * length_m));
    let window_m = 0.25 * half_m;
    let steps = 400;
    let mut turns: Vec<(f64, f64)> = (0..steps)
        .map(|step| {
            let station_m = length_m * f64::from(step) / f64::from(steps);
            let heading = |at_m: f64| path.pose_at(path.normalise_station(at_m)).heading_rad;
            let turned = angle::difference(heading(station_m + window_m), heading(station_m - window_m));
            (turned.abs(), station_m)
        })
        .filter(|(turned_rad, _)| *turned_rad > STRAIGHT_RAD)
        .collect();
    turns.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.total_cmp(&b.1)));
    let between = |one_m: f64, other_m: f64| {
        let gap_m = (one_m - other_m).abs();
        if path.is_closed() {
            gap_m.min(length_m - gap_m)
        } else {
            gap_m
        }
    };
    let mut chosen: Vec<f64> = Vec::new();
    for (_, station_m) in turns {
        if chosen.iter().all(|other| between(station_m, *other) > apart_m) {
            chosen.push(station_m);
        }
        if chosen.len() == 2 {
            break;
        }
    }
    chosen
        .into_iter()
        .map(|station_m| {
            let middle = path.pose_at(station_m).position();
            let half = Vec2::new(1.5 * half_m, half_m);
            HardCurve {
                percent: course.percent_at(station_m),
                window: [middle - half, middle + half],
            }
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use senda_geom::Curve;

    fn curves(points: &[Vec2], closed: bool) -> Vec<HardCurve> {
        let path = Curve::from_points(points, closed).unwrap();
        hard_curves(&Course {
            path: &path,
            corridor_half_width_m: 0.15,
            start_station_m: 0.0,
            laps: Some(1.0),
            open_end_m: 0.0,
        })
    }

    #[test]
    fn the_sharpest_curves_come_first_and_a_straight_has_none() {
        let straight = [Vec2::ZERO, Vec2::new(10.0, 0.0)];
        assert_eq!(curves(&straight, false), []);
        // 10 m ahead, 90° to the left, 10 m, 30° to the right, 10 m.
        let bend = Vec2::new(10.0, 10.0);
        let corners = [
            Vec2::ZERO,
            Vec2::new(10.0, 0.0),
            bend,
            bend + Vec2::new(5.0, 8.66),
        ];
        let found = curves(&corners, false);
        assert_eq!(found.len(), 2);
        for (curve, (percent, corner)) in found.iter().zip([(33.3, corners[1]), (66.7, corners[2])]) {
            assert!((curve.percent - percent).abs() < 5.0, "{}", curve.percent);
            let [low, high] = curve.window;
            assert!(low.cmplt(corner).all() && corner.cmplt(high).all());
        }
    }
}
