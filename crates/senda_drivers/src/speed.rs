//! Speed that follows the curve (C17).

use crate::options::{DriverError, check};
use serde::{Deserialize, Serialize};

/// How fast to go, and what makes it slower.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SpeedOptions {
    /// Speed on a straight (m/s). C16: 0.13 on a line, 0.16 on a lane.
    pub cruise_mps: f64,
    /// Curves are taken so that v²·κ stays below this (m/s²); 0 switches it off.
    pub lateral_acceleration_mps2: f64,
    /// Curves are taken so that v·κ stays below this (rad/s); 0 switches it off.
    pub curve_yaw_rate_radps: f64,
    /// Never slower than this part of the cruising speed while a line is known, 0..=1.
    pub slowest_part: f64,
    /// How fast the speed may rise (m/s²). Braking is not limited: the vehicle's own limits do that.
    pub acceleration_mps2: f64,
}

impl Default for SpeedOptions {
    fn default() -> Self {
        Self {
            cruise_mps: 0.13,
            lateral_acceleration_mps2: 1.0,
            curve_yaw_rate_radps: 1.5,
            slowest_part: 0.4,
            acceleration_mps2: 1.0,
        }
    }
}

impl SpeedOptions {
    /// Constant speed, as in the document.
    pub fn constant(cruise_mps: f64) -> Self {
        Self {
            cruise_mps,
            lateral_acceleration_mps2: 0.0,
            curve_yaw_rate_radps: 0.0,
            slowest_part: 1.0,
            acceleration_mps2: 0.0,
        }
    }

    /// Refuses what makes no sense.
    pub fn validate(&self) -> Result<(), DriverError> {
        check("speed.cruise_mps", self.cruise_mps, 0.0, 100.0)?;
        check(
            "speed.lateral_acceleration_mps2",
            self.lateral_acceleration_mps2,
            0.0,
            100.0,
        )?;
        check(
            "speed.curve_yaw_rate_radps",
            self.curve_yaw_rate_radps,
            0.0,
            100.0,
        )?;
        check("speed.slowest_part", self.slowest_part, 0.0, 1.0)?;
        check("speed.acceleration_mps2", self.acceleration_mps2, 0.0, 1e3)
    }

    /// The speed (m/s) for the sharpest curvature ahead (1/m), ignoring where it was before.
    pub fn for_curvature(&self, curvature_per_m: f64) -> f64 {
        let sharpness = curvature_per_m.abs();
        let mut speed_mps = self.cruise_mps;
        if self.lateral_acceleration_mps2 > 0.0 && sharpness > 1e-9 {
            speed_mps = speed_mps.min((self.lateral_acceleration_mps2 / sharpness).sqrt());
        }
        if self.curve_yaw_rate_radps > 0.0 && sharpness > 1e-9 {
            speed_mps = speed_mps.min(self.curve_yaw_rate_radps / sharpness);
        }
        speed_mps.max(self.slowest_part * self.cruise_mps)
    }

    /// The speed (m/s) after `dt_s`, rising from `last_mps` no faster than allowed.
    pub fn next(&self, last_mps: f64, curvature_per_m: f64, dt_s: f64) -> f64 {
        let wanted_mps = self.for_curvature(curvature_per_m);
        if self.acceleration_mps2 <= 0.0 {
            return wanted_mps;
        }
        // Standing still it must be able to begin, whatever the time step.
        let highest_mps = last_mps.max(0.2 * self.cruise_mps) + self.acceleration_mps2 * dt_s.max(0.0);
        wanted_mps.min(highest_mps)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sharp_curves_are_slower_and_never_slower_than_the_least() {
        let options = SpeedOptions {
            cruise_mps: 1.0,
            lateral_acceleration_mps2: 0.5,
            curve_yaw_rate_radps: 1.0,
            slowest_part: 0.3,
            acceleration_mps2: 0.0,
        };
        assert_eq!(options.for_curvature(0.0), 1.0);
        assert!((options.for_curvature(2.0) - 0.5).abs() < 1e-12); // v²κ and v·κ agree here
        assert!((options.for_curvature(-2.5) - 0.4).abs() < 1e-12);
        assert!((options.for_curvature(50.0) - 0.3).abs() < 1e-12);
    }

    #[test]
    fn constant_speed_ignores_curves() {
        assert_eq!(SpeedOptions::constant(0.13).next(0.0, 9.0, 0.05), 0.13);
    }

    #[test]
    fn speed_rises_slowly_and_falls_at_once() {
        let options = SpeedOptions {
            cruise_mps: 1.0,
            acceleration_mps2: 1.0,
            ..SpeedOptions::default()
        };
        assert!((options.next(0.5, 0.0, 0.1) - 0.6).abs() < 1e-12);
        assert!(options.next(1.0, 3.0, 0.1) < 0.6);
    }
}
