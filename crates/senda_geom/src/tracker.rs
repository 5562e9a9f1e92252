//! Follows a moving point along a curve: station, offset and distance travelled, over any number of laps.

use crate::{Curve, Place, Vec2};

/// Remembers where along a curve a moving point is, so that each projection is local and laps are counted.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tracker {
    station_m: f64,
    travelled_m: f64,
    last: Option<Vec2>,
}

/// How far ahead and behind the last station the point is looked for at least (m); twice as far as it moved if that is more.
const WINDOW_M: f64 = 0.5;

impl Tracker {
    /// Begins at a station.
    pub fn new(station_m: f64) -> Self {
        Self {
            station_m,
            travelled_m: 0.0,
            last: None,
        }
    }

    /// Takes the point's next position. `Place::station_m` is within the curve; [`Tracker::travelled_m`] is not wrapped.
    pub fn advance(&mut self, curve: &Curve, point: Vec2) -> Place {
        let moved_m = self.last.map_or(0.0, |last| (point - last).length());
        self.last = Some(point);
        // On the inner side of a bend the station moves faster than the point: hence twice. (`max` ignores a NaN.)
        let window_m = WINDOW_M.max(curve.length_m() * 1e-3).max(2.0 * moved_m);
        let place = curve.project_near(point, self.station_m, window_m);
        let mut step_m = place.station_m - self.station_m;
        if curve.is_closed() {
            let half_m = 0.5 * curve.length_m();
            if step_m > half_m {
                step_m -= curve.length_m();
            } else if step_m < -half_m {
                step_m += curve.length_m();
            }
        }
        self.travelled_m += step_m;
        self.station_m = place.station_m;
        place
    }

    /// Distance along the curve since the beginning (m); driving backwards subtracts.
    pub fn travelled_m(&self) -> f64 {
        self.travelled_m
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Pose2, Segment};

    #[test]
    fn a_fast_car_is_not_left_behind() {
        let curve = Curve::from_points(&[Vec2::ZERO, Vec2::new(900.0, 0.0)], false).unwrap();
        let mut tracker = Tracker::new(0.0);
        // 36 m/s at 14 frames a second.
        for i in 0..300 {
            tracker.advance(&curve, Vec2::new(2.57 * f64::from(i), 0.0));
        }
        assert!((tracker.travelled_m() - 2.57 * 299.0).abs() < 1e-6);
    }

    #[test]
    fn two_laps_forward_and_one_back() {
        let turn = Segment::arc(0.5, 2.0 * std::f64::consts::PI);
        let curve = Curve::from_segments(Pose2::default(), &[turn], 0.01, true).unwrap();
        let mut tracker = Tracker::new(0.0);
        let mut drive = |from: f64, to: f64| {
            let steps = 200;
            for i in 1..=steps {
                let station = from + (to - from) * f64::from(i) / f64::from(steps);
                let pose = curve.pose_at(station);
                tracker.advance(&curve, pose.position() + pose.left() * 0.05);
            }
            tracker.travelled_m()
        };
        let length = curve.length_m();
        assert!((drive(0.0, 2.0 * length) - 2.0 * length).abs() < 1e-6);
        assert!((drive(2.0 * length, length) - length).abs() < 1e-6);
    }
}
