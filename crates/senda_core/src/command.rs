//! What a driver asks of a vehicle.

use serde::{Deserialize, Serialize};

/// How to turn. Left positive in every form.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Turn {
    /// Curvature of the path (1/m): independent of speed and of the kind of vehicle.
    CurvaturePerM(f64),
    /// Yaw rate (rad/s): unicycles, turning in place.
    YawRateRadps(f64),
    /// Angle of the front wheels (rad): cars.
    SteeringRad(f64),
}

/// How fast to go.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Drive {
    /// Forward speed (m/s); the vehicle's own controller holds it.
    SpeedMps(f64),
    /// Pedal -1..1: positive accelerates, negative brakes.
    Throttle(f64),
}

/// One command: how to turn and how fast to go. Every vehicle understands every combination through its [`crate::Body`].
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Command {
    /// How to turn.
    pub turn: Turn,
    /// How fast to go.
    pub drive: Drive,
}

impl Command {
    /// Stand still.
    pub const STOP: Command = Command {
        turn: Turn::CurvaturePerM(0.0),
        drive: Drive::SpeedMps(0.0),
    };

    /// Follow a curvature (1/m, left positive) at a speed (m/s).
    pub fn curvature(curvature_per_m: f64, speed_mps: f64) -> Self {
        Self {
            turn: Turn::CurvaturePerM(curvature_per_m),
            drive: Drive::SpeedMps(speed_mps),
        }
    }

    /// Turn at a rate (rad/s, left positive) while going at a speed (m/s).
    pub fn yaw_rate(yaw_rate_radps: f64, speed_mps: f64) -> Self {
        Self {
            turn: Turn::YawRateRadps(yaw_rate_radps),
            drive: Drive::SpeedMps(speed_mps),
        }
    }

    /// Steer the front wheels (rad, left positive) at a speed (m/s).
    pub fn steering(steering_rad: f64, speed_mps: f64) -> Self {
        Self {
            turn: Turn::SteeringRad(steering_rad),
            drive: Drive::SpeedMps(speed_mps),
        }
    }

    /// Whether no number in it is NaN or infinite.
    pub fn is_finite(&self) -> bool {
        let (Turn::CurvaturePerM(turn) | Turn::YawRateRadps(turn) | Turn::SteeringRad(turn)) = self.turn;
        let (Drive::SpeedMps(drive) | Drive::Throttle(drive)) = self.drive;
        turn.is_finite() && drive.is_finite()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_number_counts_for_finiteness() {
        assert!(Command::STOP.is_finite());
        assert!(!Command::curvature(f64::NAN, 0.1).is_finite());
        assert!(!Command::yaw_rate(0.1, f64::INFINITY).is_finite());
        assert!(
            !Command {
                drive: Drive::Throttle(f64::NAN),
                ..Command::steering(0.1, 0.1)
            }
            .is_finite()
        );
    }
}
