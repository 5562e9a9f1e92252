//! Donkeycar's signs and units, and ours: the only place where they meet.
//!
//! Theirs: angle -1 full **left** to +1 full right, throttle -1..1. Ours: left positive, radians.

use senda_core::{Body, Command, Drive, Steering, Turn};

/// The command that a tub's angle and throttle mean for a body. Full lock is the body's own: the front wheels' limit, or
/// the largest yaw rate where there are no front wheels.
pub fn command_from_tub(body: &Body, angle: f64, throttle: f64) -> Command {
    Command {
        turn: match body.steering {
            Steering::Ackermann {
                steering_limit_rad, ..
            } => Turn::SteeringRad(-angle * steering_limit_rad),
            Steering::Differential { .. } => Turn::YawRateRadps(-angle * body.yaw_rate_limit_radps),
        },
        drive: Drive::Throttle(throttle),
    }
}

/// Angle and throttle that a tub holds for a command, both limited to -1..1.
pub fn tub_from_command(body: &Body, command: &Command) -> (f64, f64) {
    let speed_mps = body.speed_of(command);
    let (asked, limit) = match body.steering {
        Steering::Ackermann {
            steering_limit_rad, ..
        } => (body.steering_of(command.turn, speed_mps), steering_limit_rad),
        Steering::Differential { .. } => (
            body.yaw_rate_of(command.turn, speed_mps),
            body.yaw_rate_limit_radps,
        ),
    };
    let throttle = match command.drive {
        Drive::Throttle(throttle) => throttle,
        Drive::SpeedMps(_) if body.speed_limit_mps > 0.0 => speed_mps / body.speed_limit_mps,
        Drive::SpeedMps(_) => 0.0,
    };
    let angle = if limit > 0.0 { -asked / limit } else { 0.0 };
    // `+ 0.0` turns -0.0 into 0.0.
    (angle.clamp(-1.0, 1.0) + 0.0, throttle.clamp(-1.0, 1.0) + 0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn body(steering: Steering) -> Body {
        Body {
            name: "car".into(),
            steering,
            width_m: 0.2,
            length_m: 0.3,
            speed_limit_mps: 2.0,
            yaw_rate_limit_radps: 4.0,
            period_s: 0.05,
            encoders: None,
            cameras: vec![],
        }
    }

    #[test]
    fn their_plus_one_is_full_right_and_ours_is_negative() {
        let car = body(Steering::Ackermann {
            wheelbase_m: 0.17,
            steering_limit_rad: 0.4,
        });
        assert_eq!(command_from_tub(&car, 1.0, 0.5).turn, Turn::SteeringRad(-0.4));
        assert_eq!(command_from_tub(&car, -1.0, 0.5).turn, Turn::SteeringRad(0.4));
        assert_eq!(command_from_tub(&car, 0.5, -0.25).drive, Drive::Throttle(-0.25));
        let robot = body(Steering::Differential { track_m: 0.1 });
        assert_eq!(command_from_tub(&robot, -0.5, 1.0).turn, Turn::YawRateRadps(2.0));
    }

    #[test]
    fn there_and_back() {
        for steering in [
            Steering::Ackermann {
                wheelbase_m: 0.17,
                steering_limit_rad: 0.4,
            },
            Steering::Differential { track_m: 0.1 },
        ] {
            let body = body(steering);
            for (angle, throttle) in [(0.0, 0.0), (0.3, 0.5), (-1.0, 1.0), (0.857, -0.2)] {
                let (back_angle, back_throttle) =
                    tub_from_command(&body, &command_from_tub(&body, angle, throttle));
                assert!((back_angle - angle).abs() < 1e-12 && back_throttle == throttle);
            }
        }
    }

    #[test]
    fn commands_in_other_forms_become_the_same_path() {
        let car = body(Steering::Ackermann {
            wheelbase_m: 0.17,
            steering_limit_rad: 0.4,
        });
        let (angle, throttle) = tub_from_command(&car, &Command::curvature(-1.0, 1.0));
        assert!(angle > 0.0 && angle < 1.0, "right is positive in a tub: {angle}");
        assert_eq!(throttle, 0.5);
        assert_eq!(tub_from_command(&car, &Command::curvature(1e6, 1.0)).0, -1.0);
    }
}
