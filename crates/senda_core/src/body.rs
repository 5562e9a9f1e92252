//! What a driver may know about the vehicle it drives: shape, limits and cameras.

use crate::{Command, Drive, Turn};
use senda_geom::{Camera, trig};
use serde::{Deserialize, Serialize};

/// How the vehicle turns.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "kebab-case", deny_unknown_fields)]
pub enum Steering {
    /// Two driven wheels (or two driven sides) with different speeds; can turn in place.
    Differential {
        /// Distance between the wheels' contact points (m).
        track_m: f64,
    },
    /// Steered front wheels.
    Ackermann {
        /// Distance between the axles (m).
        wheelbase_m: f64,
        /// Largest angle of the front wheels to either side (rad).
        steering_limit_rad: f64,
    },
}

/// Encoders on both driven wheels: what makes metres of their ticks.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Encoders {
    /// What a wheel rolls from one tick to the next (m).
    pub tick_m: f64,
    /// Distance between the wheels that they count on (m).
    pub track_m: f64,
    /// Whether they tell forwards from backwards. The GoPiGo's count up only.
    pub signed: bool,
}

/// The vehicle as its driver knows it: kinematics, limits, cameras. Origin on the floor below the (rear) axle's centre.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Body {
    /// Name of the vehicle, such as `gopigo`.
    pub name: String,
    /// How it turns.
    pub steering: Steering,
    /// Overall width (m).
    pub width_m: f64,
    /// Overall length (m).
    pub length_m: f64,
    /// Top speed (m/s).
    pub speed_limit_mps: f64,
    /// Largest yaw rate that it can reach (rad/s).
    pub yaw_rate_limit_radps: f64,
    /// Nominal time between observations (s).
    pub period_s: f64,
    /// Encoders on the driven wheels, where it has any.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub encoders: Option<Encoders>,
    /// Cameras; the first is the one that single-camera drivers use.
    pub cameras: Vec<Camera>,
}

impl Body {
    /// The tightest curvature the vehicle can drive (1/m); infinite for one that turns in place.
    pub fn curvature_limit_per_m(&self) -> f64 {
        match self.steering {
            Steering::Differential { .. } => f64::INFINITY,
            Steering::Ackermann {
                wheelbase_m,
                steering_limit_rad,
            } => trig::tan(steering_limit_rad) / wheelbase_m,
        }
    }

    /// Yaw rate (rad/s) that a turn asks for at a speed (m/s), unlimited.
    pub fn yaw_rate_of(&self, turn: Turn, speed_mps: f64) -> f64 {
        match turn {
            Turn::YawRateRadps(rate) => rate,
            Turn::CurvaturePerM(curvature) => curvature * speed_mps,
            Turn::SteeringRad(angle) => trig::tan(angle) / self.lever_m() * speed_mps,
        }
    }

    /// Front-wheel angle (rad) that a turn asks for at a speed (m/s), unlimited. A vehicle without front wheels
    /// answers with the angle of a car as long as its track is wide, so that networks trained on one fit the other.
    pub fn steering_of(&self, turn: Turn, speed_mps: f64) -> f64 {
        match turn {
            Turn::SteeringRad(angle) => angle,
            Turn::CurvaturePerM(curvature) => trig::atan(curvature * self.lever_m()),
            // Below walking pace of a toy a yaw rate has no steering angle: divide by at least 1 cm/s.
            Turn::YawRateRadps(rate) => {
                let speed = if speed_mps < 0.0 {
                    speed_mps.min(-0.01)
                } else {
                    speed_mps.max(0.01)
                };
                trig::atan(rate / speed * self.lever_m())
            }
        }
    }

    /// Curvature (1/m) that a turn asks for at a speed (m/s), unlimited.
    pub fn curvature_of(&self, turn: Turn, speed_mps: f64) -> f64 {
        match turn {
            Turn::CurvaturePerM(curvature) => curvature,
            other => trig::tan(self.steering_of(other, speed_mps)) / self.lever_m(),
        }
    }

    /// Speed (m/s) that a command asks for; a throttle counts as that part of top speed.
    pub fn speed_of(&self, command: &Command) -> f64 {
        match command.drive {
            Drive::SpeedMps(speed) => speed,
            Drive::Throttle(part) => part.max(0.0) * self.speed_limit_mps,
        }
    }

    fn lever_m(&self) -> f64 {
        match self.steering {
            Steering::Differential { track_m } => track_m,
            Steering::Ackermann { wheelbase_m, .. } => wheelbase_m,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn body(steering: Steering) -> Body {
        Body {
            name: "vehicle".into(),
            steering,
            width_m: 0.1,
            length_m: 0.3,
            speed_limit_mps: 1.0,
            yaw_rate_limit_radps: 5.0,
            period_s: 0.05,
            encoders: None,
            cameras: vec![],
        }
    }

    const CAR: Steering = Steering::Ackermann {
        wheelbase_m: 0.2,
        steering_limit_rad: 0.5,
    };
    const UNICYCLE: Steering = Steering::Differential { track_m: 0.11 };

    #[test]
    fn every_turn_means_the_same_path() {
        for (steering, speed_mps) in [(CAR, 0.4), (CAR, -0.4), (UNICYCLE, 0.4)] {
            let body = body(steering);
            let curvature = Turn::CurvaturePerM(1.5);
            let steering = Turn::SteeringRad(body.steering_of(curvature, speed_mps));
            let rate = Turn::YawRateRadps(body.yaw_rate_of(curvature, speed_mps));
            for turn in [curvature, steering, rate] {
                assert!(
                    (body.curvature_of(turn, speed_mps) - 1.5).abs() < 1e-9,
                    "{turn:?}"
                );
                assert!(
                    (body.yaw_rate_of(turn, speed_mps) - 1.5 * speed_mps).abs() < 1e-9,
                    "{turn:?}"
                );
            }
        }
    }

    #[test]
    fn left_stays_left_in_every_form() {
        let body = body(CAR);
        assert!(body.steering_of(Turn::CurvaturePerM(1.0), 0.3) > 0.0);
        assert!(body.steering_of(Turn::YawRateRadps(1.0), 0.3) > 0.0);
        assert!(body.yaw_rate_of(Turn::SteeringRad(0.2), 0.3) > 0.0);
        // Backwards, a yaw rate to the left needs the wheels to the right.
        assert!(body.steering_of(Turn::YawRateRadps(1.0), -0.3) < 0.0);
    }

    #[test]
    fn limits_and_speeds() {
        assert!((body(CAR).curvature_limit_per_m() - trig::tan(0.5) / 0.2).abs() < 1e-12);
        assert_eq!(body(UNICYCLE).curvature_limit_per_m(), f64::INFINITY);
        let turn = Turn::CurvaturePerM(0.0);
        let speed = |drive| body(CAR).speed_of(&Command { turn, drive });
        assert_eq!(speed(Drive::SpeedMps(0.3)), 0.3);
        assert_eq!(
            (speed(Drive::Throttle(0.5)), speed(Drive::Throttle(-0.5))),
            (0.5, 0.0)
        );
    }

    #[test]
    fn standing_still_a_yaw_rate_has_a_finite_steering_angle() {
        assert!(body(CAR).steering_of(Turn::YawRateRadps(1.0), 0.0).is_finite());
    }
}
