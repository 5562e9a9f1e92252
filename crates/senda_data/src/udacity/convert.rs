//! The Udacity simulator's signs and units, and ours: the only place where they meet.
//!
//! Theirs: steering -1 full **left** to +1 full right of 25°, throttle 0..1, brake 0..1, miles an hour.

use crate::Step;
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

/// Steering, throttle and brake of a row for a step, within their ranges. A vehicle without pedals that obeys in m/s has the
/// part of its top speed there.
pub fn log_from_step(body: &Body, step: &Step) -> (f64, f64, f64) {
    let steering = unlimited_steering(body, &step.command);
    let pedal = step.pedal().unwrap_or(if body.speed_limit_mps > 0.0 {
        body.speed_of(&step.command) / body.speed_limit_mps
    } else {
        0.0
    });
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

    /// 8 of 13.4 m/s stood there as a throttle of 0.6, and no brake ever.
    #[test]
    fn what_a_speed_control_presses_is_the_pedal() {
        let body = Body {
            name: "sedan".into(),
            steering: senda_core::Steering::Ackermann {
                wheelbase_m: 2.87,
                steering_limit_rad: FULL_STEERING_RAD,
            },
            width_m: 2.1,
            length_m: 4.8,
            speed_limit_mps: 16.0,
            yaw_rate_limit_radps: 2.0,
            period_s: 0.07,
            encoders: None,
            cameras: vec![],
        };
        let mut step = Step {
            stamp: senda_core::Stamp::default(),
            frames: vec![],
            speed_mps: None,
            wheels: None,
            battery_v: None,
            command: Command::steering(0.0, 8.0),
            truth: None,
            explanation: senda_core::Explanation::default(),
        };
        assert_eq!(log_from_step(&body, &step), (0.0, 0.5, 0.0), "it says no more");
        step.explanation.signal(senda_core::Explanation::PEDAL, 0.04);
        assert_eq!(log_from_step(&body, &step), (0.0, 0.04, 0.0));
        step.explanation.signal(senda_core::Explanation::PEDAL, -1.0);
        assert_eq!(log_from_step(&body, &step), (0.0, 0.0, 1.0));
    }
}
