//! The Udacity simulator's signs and units, and ours: the only place where they meet.
//!
//! Theirs: steering -1 full **left** to +1 full right of 25°, throttle 0..1, brake 0..1, miles an hour.

use senda_core::{Body, Command, Drive, Turn};

/// Angle of the front wheels at full steering (rad): 25°.
pub const FULL_STEERING_RAD: f64 = 25.0 * std::f64::consts::PI / 180.0;
/// Metres a second in a mile an hour.
pub const MPS_PER_MPH: f64 = 0.447_04;

/// The command that a row of the log means. A brake is a negative throttle.
pub fn command_from_log(steering: f64, throttle: f64, brake: f64) -> Command {
    Command {
        turn: Turn::SteeringRad(-steering * FULL_STEERING_RAD),
        drive: Drive::Throttle(throttle - brake),
    }
}

/// Steering of a row for a command, whatever their range.
pub fn unlimited_steering(body: &Body, command: &Command) -> f64 {
    -body.steering_of(command.turn, body.speed_of(command)) / FULL_STEERING_RAD
}

/// Steering, throttle and brake of a row for a command, within their ranges.
pub fn log_from_command(body: &Body, command: &Command) -> (f64, f64, f64) {
    let speed_mps = body.speed_of(command);
    let steering = unlimited_steering(body, command);
    let pedal = match command.drive {
        Drive::Throttle(pedal) => pedal,
        Drive::SpeedMps(_) if body.speed_limit_mps > 0.0 => speed_mps / body.speed_limit_mps,
        Drive::SpeedMps(_) => 0.0,
    };
    // `+ 0.0` turns -0.0 into 0.0.
    (
        steering.clamp(-1.0, 1.0) + 0.0,
        pedal.clamp(0.0, 1.0) + 0.0,
        (-pedal).clamp(0.0, 1.0) + 0.0,
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn their_minus_one_is_25_degrees_left_and_ours_is_positive() {
        let Turn::SteeringRad(left) = command_from_log(-1.0, 0.0, 0.0).turn else {
            panic!("steering stays steering");
        };
        assert!((left.to_degrees() - 25.0).abs() < 1e-12);
        assert_eq!(command_from_log(0.0, 0.2, 0.5).drive, Drive::Throttle(-0.3));
    }
}
