//! The last check before a command reaches a vehicle.

use senda_core::{Body, Command, Drive, Observation, Stamp, Turn};

/// A vehicle that has not seen a picture for this long stops (s). At the documents' speeds (0.07 to 0.2 m/s) that is at
/// most 10 cm driven blind. A guess, to be measured on hardware.
pub(crate) const BLIND_LIMIT_S: f64 = 0.5;

/// Why the guard replaced a command by a stop.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum GuardStop {
    /// The newest picture was too old.
    Blind,
    /// The command was no number.
    NoNumber,
}

impl GuardStop {
    /// In words, for people.
    pub fn words(self) -> &'static str {
        match self {
            Self::Blind => "the guard stopped it: no picture younger than 0.5 s",
            Self::NoNumber => "the guard stopped it: the driver's command was no number",
        }
    }
}

/// Lets only safe commands through: finite, within the vehicle's limits, and based on fresh pictures.
#[derive(Debug, Clone)]
pub struct Guard {
    body: Body,
    last_picture: Option<Stamp>,
    stops: u64,
    stop: Option<GuardStop>,
}

impl Guard {
    /// For a vehicle.
    pub fn new(body: &Body) -> Self {
        Self {
            body: body.clone(),
            last_picture: None,
            stops: 0,
            stop: None,
        }
    }

    /// How many commands were replaced by a stop.
    pub fn stops(&self) -> u64 {
        self.stops
    }

    /// Why the last command was replaced; `None` where it was not.
    pub fn stop(&self) -> Option<GuardStop> {
        self.stop
    }

    /// The command that may be carried out: clamped to the vehicle's limits, or a stop where it is not finite or the
    /// newest picture is too old. Vehicles without cameras are never blind.
    pub fn check(&mut self, observation: &Observation, command: Command) -> Command {
        let newest = observation.frames.iter().map(|frame| frame.stamp).max();
        self.last_picture = newest.max(self.last_picture);
        let seen = self.last_picture.unwrap_or_default();
        let blind = !self.body.cameras.is_empty() && observation.stamp.since_s(seen) > BLIND_LIMIT_S;
        self.stop = match (blind, command.is_finite()) {
            (true, _) => Some(GuardStop::Blind),
            (false, false) => Some(GuardStop::NoNumber),
            (false, true) => None,
        };
        if self.stop.is_some() {
            self.stops += 1;
            return Command::STOP;
        }
        let body = &self.body;
        let drive = match command.drive {
            Drive::SpeedMps(speed) => {
                Drive::SpeedMps(speed.clamp(-body.speed_limit_mps, body.speed_limit_mps))
            }
            Drive::Throttle(part) => Drive::Throttle(part.clamp(-1.0, 1.0)),
        };
        let turn = match command.turn {
            Turn::YawRateRadps(rate) => {
                Turn::YawRateRadps(rate.clamp(-body.yaw_rate_limit_radps, body.yaw_rate_limit_radps))
            }
            Turn::CurvaturePerM(curvature) => {
                let limit = body.curvature_limit_per_m();
                Turn::CurvaturePerM(curvature.clamp(-limit, limit))
            }
            // A steering angle beyond a right angle has no meaning on any vehicle; the actuator knows its own limit.
            Turn::SteeringRad(angle) => {
                Turn::SteeringRad(angle.clamp(-std::f64::consts::FRAC_PI_2, std::f64::consts::FRAC_PI_2))
            }
        };
        Command { turn, drive }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use senda_core::{Frame, Steering};
    use senda_geom::{Camera, Lens, Mounting};

    fn body() -> Body {
        let mounting = Mounting {
            x_m: 0.0,
            y_m: 0.0,
            z_m: 0.1,
            yaw_rad: 0.0,
            tilt_rad: 0.5,
            roll_rad: 0.0,
        };
        let lens = Lens::pinhole(4, 4, 1.0, 1.0);
        Body {
            name: "test".into(),
            steering: Steering::Ackermann {
                wheelbase_m: 0.2,
                steering_limit_rad: 0.5,
            },
            width_m: 0.1,
            length_m: 0.2,
            speed_limit_mps: 1.0,
            yaw_rate_limit_radps: 3.0,
            period_s: 0.05,
            encoders: None,
            cameras: vec![Camera {
                name: "center".into(),
                width_px: 4,
                height_px: 4,
                lens,
                mounting,
            }],
        }
    }

    fn at(stamp_s: f64, picture: bool) -> Observation {
        let stamp = Stamp::from_s(stamp_s);
        let frames = if picture {
            vec![Frame {
                stamp,
                ..Frame::default()
            }]
        } else {
            vec![]
        };
        Observation {
            stamp,
            frames,
            ..Observation::default()
        }
    }

    #[test]
    fn limits_hold_and_nonsense_stops() {
        let mut guard = Guard::new(&body());
        let fast = guard.check(&at(0.0, true), Command::yaw_rate(99.0, 99.0));
        assert_eq!(fast, Command::yaw_rate(3.0, 1.0));
        assert_eq!(
            guard.check(&at(0.1, true), Command::curvature(f64::NAN, 0.1)),
            Command::STOP
        );
        let tight = guard.check(&at(0.2, true), Command::curvature(1e9, 0.1));
        assert!(matches!(tight.turn, Turn::CurvaturePerM(c) if c < 10.0));
        assert_eq!(guard.stops(), 1);
    }

    #[test]
    fn a_blind_vehicle_stops_and_goes_on_when_it_sees_again() {
        let mut guard = Guard::new(&body());
        let go = Command::curvature(0.0, 0.1);
        assert_eq!(guard.check(&at(0.0, true), go), go);
        assert_eq!(guard.check(&at(0.4, false), go), go);
        assert_eq!(guard.check(&at(0.6, false), go), Command::STOP);
        assert_eq!(guard.stop(), Some(GuardStop::Blind));
        assert!(GuardStop::Blind.words().contains(&format!("{BLIND_LIMIT_S} s")));
        assert_eq!(guard.check(&at(0.7, true), go), go);
        assert_eq!(guard.stop(), None);
    }
}
