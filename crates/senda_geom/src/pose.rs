//! A position and heading on the floor.

use crate::{Vec2, angle, trig};
use serde::{Deserialize, Serialize};

/// A pose on the floor plane: where a frame stands in its parent frame (m, rad).
///
/// Read as a transform, `world_from_vehicle.transform(point_in_vehicle)` is the point in the world.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Pose2 {
    /// Position along the parent's x axis (m).
    pub x_m: f64,
    /// Position along the parent's y axis (m).
    pub y_m: f64,
    /// Rotation from the parent's x axis (rad, counter-clockwise).
    pub heading_rad: f64,
}

impl Pose2 {
    /// A pose from metres and radians. The heading is kept as given, not wrapped.
    pub fn new(x_m: f64, y_m: f64, heading_rad: f64) -> Self {
        Self {
            x_m,
            y_m,
            heading_rad,
        }
    }

    /// The position (m).
    pub fn position(&self) -> Vec2 {
        Vec2::new(self.x_m, self.y_m)
    }

    /// Unit vector along the heading.
    pub fn forward(&self) -> Vec2 {
        let (sin, cos) = trig::sincos(self.heading_rad);
        Vec2::new(cos, sin)
    }

    /// Unit vector to the left of the heading.
    pub fn left(&self) -> Vec2 {
        self.forward().perp()
    }

    /// A point of this frame, in the parent frame (m).
    pub fn transform(&self, point: Vec2) -> Vec2 {
        let forward = self.forward();
        self.position() + forward * point.x + forward.perp() * point.y
    }

    /// `a_from_b.compose(b_from_c)` is `a_from_c`. The heading is wrapped.
    pub fn compose(&self, child: Pose2) -> Pose2 {
        let position = self.transform(child.position());
        Pose2::new(
            position.x,
            position.y,
            angle::wrap(self.heading_rad + child.heading_rad),
        )
    }

    /// The inverse transform: `world_from_vehicle.inverse()` is `vehicle_from_world`.
    pub fn inverse(&self) -> Pose2 {
        let (sin, cos) = trig::sincos(self.heading_rad);
        Pose2::new(
            -(self.x_m * cos + self.y_m * sin),
            -(-self.x_m * sin + self.y_m * cos),
            angle::wrap(-self.heading_rad),
        )
    }

    /// The pose after `time_s` at constant forward speed and yaw rate: an exact arc, so the size of a step does
    /// not change where a constant command leads.
    pub fn advance(&self, speed_mps: f64, yaw_rate_radps: f64, time_s: f64) -> Pose2 {
        let turn_rad = yaw_rate_radps * time_s;
        let half_rad = 0.5 * turn_rad;
        // The chord of the arc: length v·t·sin(h)/h along heading + h.
        let ratio = if half_rad.abs() < 1e-4 {
            1.0 - half_rad * half_rad / 6.0
        } else {
            trig::sin(half_rad) / half_rad
        };
        let chord_m = speed_mps * time_s * ratio;
        let (sin, cos) = trig::sincos(self.heading_rad + half_rad);
        Pose2::new(
            self.x_m + chord_m * cos,
            self.y_m + chord_m * sin,
            angle::wrap(self.heading_rad + turn_rad),
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn inverse_undoes(x in -9.0..9.0f64, y in -9.0..9.0f64, h in -3.0..3.0f64, px in -9.0..9.0f64, py in -9.0..9.0f64) {
            let pose = Pose2::new(x, y, h);
            let point = Vec2::new(px, py);
            prop_assert!((pose.inverse().transform(pose.transform(point)) - point).length() < 1e-12);
            let identity = pose.compose(pose.inverse());
            prop_assert!(identity.position().length() < 1e-12 && identity.heading_rad.abs() < 1e-12);
        }

        #[test]
        fn two_half_steps_equal_one(v in -2.0..2.0f64, w in -3.0..3.0f64, t in 0.0..1.0f64) {
            let start = Pose2::new(0.3, -0.2, 0.7);
            let once = start.advance(v, w, t);
            let twice = start.advance(v, w, t / 2.0).advance(v, w, t / 2.0);
            prop_assert!((once.position() - twice.position()).length() < 1e-9);
        }
    }

    #[test]
    fn left_is_positive() {
        let pose = Pose2::new(0.0, 0.0, 0.0).advance(1.0, 1.0, 0.5);
        assert!(pose.y_m > 0.0 && pose.heading_rad > 0.0);
    }
}
