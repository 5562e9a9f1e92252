//! Where the vehicle stands relative to the remembered path: parabolas fitted to pieces of it.

use super::{PathMemory, TrackOptions};
use crate::follow::LineState;
use senda_geom::{Pose2, Vec2, angle, trig};

/// A parabola η = a + b·ξ + c·ξ² on axes through `origin`.
pub(super) struct Parabola {
    origin: Vec2,
    direction: Vec2,
    a: f64,
    b: f64,
    c: f64,
}

/// Directions further than this from the vehicle's are no path for it (rad).
const BACKWARDS_RAD: f64 = 1.9;
/// Expected size of curvatures (1/m, one standard deviation): keeps short or far pieces from bending wildly.
const CURVATURE_PRIOR_PER_M: f64 = 12.0;

impl PathMemory {
    /// The state relative to the path of a vehicle that stands at `vehicle` (in the present vehicle frame), with the
    /// curvature `preview_m` further on.
    pub(crate) fn state(&self, vehicle: Pose2, preview_m: f64, options: &TrackOptions) -> Option<LineState> {
        let place = self.locate(vehicle.position())?;
        let parabola = self.fit(place.station_m, options.window_m)?;
        let (d_m, theta_rad) = parabola.state(vehicle);
        // A path that leads backwards was pieced together from wrong sightings.
        if theta_rad.abs() > BACKWARDS_RAD {
            return None;
        }
        let ahead = self.fit(place.station_m + preview_m, options.window_m)?;
        Some(LineState {
            d_m,
            theta_rad,
            curvature_per_m: ahead.curvature(),
        })
    }

    /// The sharpest curvature between the vehicle and `reach_m` ahead (1/m, with its sign).
    pub(crate) fn sharpest_ahead(&self, reach_m: f64, options: &TrackOptions) -> f64 {
        let Some(place) = self.locate(Vec2::ZERO) else {
            return 0.0;
        };
        let end_m = self.length_m().min(place.station_m + reach_m);
        let mut sharpest: f64 = 0.0;
        let mut station_m = place.station_m.max(0.0);
        loop {
            if let Some(parabola) = self.fit(station_m, options.window_m) {
                let curvature = parabola.curvature();
                if curvature.abs() > sharpest.abs() {
                    sharpest = curvature;
                }
            }
            station_m += options.window_m.max(0.5 * reach_m / 8.0);
            if station_m > end_m {
                return sharpest;
            }
        }
    }

    /// Weighted parabola through the nodes around a station.
    pub(super) fn fit(&self, station_m: f64, window_m: f64) -> Option<Parabola> {
        let length_m = self.length_m();
        if self.is_empty() || length_m < 1e-6 {
            return None;
        }
        // At the ends the window slides inwards, so that it always covers its whole length if the memory does.
        let centre_m = station_m
            .max(window_m)
            .min((length_m - window_m).max(0.5 * length_m))
            .max(0.0);
        let (from_m, to_m) = (centre_m - window_m - 1e-9, centre_m + window_m + 1e-9);
        let mut first = self.nodes.partition_point(|node| node.station_m < from_m);
        let mut last = self.nodes.partition_point(|node| node.station_m <= to_m);
        // In a gap (between dashes) the nodes at its ends must do.
        while last - first < 3 && (first > 0 || last < self.nodes.len()) {
            first = first.saturating_sub(1);
            last = (last + 1).min(self.nodes.len());
        }
        let nodes = &self.nodes[first..last];
        let direction = (nodes[nodes.len() - 1].at - nodes[0].at).try_normalize()?;
        let total: f64 = nodes.iter().map(|node| node.weight).sum();
        if !(total > 0.0) {
            return None;
        }
        let origin = nodes.iter().map(|node| node.at * node.weight).sum::<Vec2>() / total;
        let mut matrix = [[0.0; 3]; 3];
        let mut right = [0.0; 3];
        for node in nodes {
            let away = node.at - origin;
            let (along, aside) = (away.dot(direction), away.dot(direction.perp()));
            let row = [1.0, along, along * along];
            // Old and new errors of neighbours hang together: a few millimetres stay, whatever the weights say.
            let weight = 1.0 / (1.0 / node.weight + 4e-6);
            for i in 0..3 {
                for j in 0..3 {
                    matrix[i][j] += weight * row[i] * row[j];
                }
                right[i] += weight * row[i] * aside;
            }
        }
        matrix[2][2] += 4.0 / (CURVATURE_PRIOR_PER_M * CURVATURE_PRIOR_PER_M);
        let [a, b, c] = solve(matrix, right)?;
        Some(Parabola {
            origin,
            direction,
            a,
            b,
            c,
        })
    }
}

impl Parabola {
    pub(super) fn curvature(&self) -> f64 {
        let slope = 1.0 + self.b * self.b;
        2.0 * self.c / (slope * slope.sqrt())
    }

    /// Distance to the left and relative direction of the nearest point, seen from a vehicle.
    fn state(&self, vehicle: Pose2) -> (f64, f64) {
        let away = vehicle.position() - self.origin;
        let (x, y) = (away.dot(self.direction), away.dot(self.direction.perp()));
        let mut along = x;
        for _ in 0..4 {
            let (height, slope) = (
                self.a + along * (self.b + self.c * along),
                self.b + 2.0 * self.c * along,
            );
            let value = (along - x) + (height - y) * slope;
            let change = 1.0 + slope * slope + (height - y) * 2.0 * self.c;
            along -= value / change.max(0.3);
        }
        let (height, slope) = (
            self.a + along * (self.b + self.c * along),
            self.b + 2.0 * self.c * along,
        );
        let tangent = self.direction + self.direction.perp() * slope;
        let towards = self.direction * (along - x) + self.direction.perp() * (height - y);
        let distance = towards.length();
        let d_m = if tangent.perp_dot(towards) >= 0.0 {
            distance
        } else {
            -distance
        };
        let heading = trig::atan2(tangent.y, tangent.x);
        (d_m, angle::difference(heading, vehicle.heading_rad))
    }
}

/// Solves a symmetric 3x3 system by elimination with pivoting.
pub(super) fn solve(mut matrix: [[f64; 3]; 3], mut right: [f64; 3]) -> Option<[f64; 3]> {
    for column in 0..3 {
        let mut pivot = column;
        for row in column + 1..3 {
            if matrix[row][column].abs() > matrix[pivot][column].abs() {
                pivot = row;
            }
        }
        if !(matrix[pivot][column].abs() > 1e-300) {
            return None;
        }
        matrix.swap(column, pivot);
        right.swap(column, pivot);
        for row in column + 1..3 {
            let factor = matrix[row][column] / matrix[column][column];
            for k in column..3 {
                matrix[row][k] -= factor * matrix[column][k];
            }
            right[row] -= factor * right[column];
        }
    }
    let mut solution = [0.0; 3];
    for row in (0..3).rev() {
        let mut value = right[row];
        for k in row + 1..3 {
            value -= matrix[row][k] * solution[k];
        }
        solution[row] = value / matrix[row][row];
    }
    solution.iter().all(|value| value.is_finite()).then_some(solution)
}

#[cfg(test)]
mod tests {
    use super::super::tests::{circle, points};
    use super::*;

    #[test]
    fn a_circle_seen_ahead_is_continued_to_the_axle() {
        let mut memory = PathMemory::default();
        memory.update(&points(circle, 0.1, 0.4), &TrackOptions::default(), |_| true);
        let state = memory
            .state(Pose2::default(), 0.0, &TrackOptions::default())
            .unwrap();
        assert!(
            state.d_m.abs() < 0.006 && state.theta_rad.abs() < 0.08,
            "{state:?}"
        );
        assert!((state.curvature_per_m - 2.0).abs() < 0.3, "{state:?}");
    }

    #[test]
    fn equations_are_solved() {
        let solution = solve(
            [[2.0, 1.0, 0.0], [1.0, 3.0, 1.0], [0.0, 1.0, 4.0]],
            [4.0, 10.0, 14.0],
        )
        .unwrap();
        for (value, expected) in solution.iter().zip([1.0, 2.0, 3.0]) {
            assert!((value - expected).abs() < 1e-12);
        }
        assert!(solve([[0.0; 3]; 3], [1.0; 3]).is_none());
    }
}
