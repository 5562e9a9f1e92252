//! Where a vehicle would think it is by its wheels alone (C14 in SPEC).

use senda_core::{Body, Command, Encoders, Truth, Wheels};
use senda_data::Recording;
use senda_geom::{Pose2, angle};
use serde::{Deserialize, Serialize};

/// Reckons the pose from the ticks of both wheels.
#[derive(Debug, Clone)]
pub struct Odometer {
    body: Body,
    encoders: Encoders,
    start_from_vehicle: Pose2,
    before: Option<Wheels>,
    /// Which way each wheel turns, left and right: ±1.
    direction: [f64; 2],
}

impl Odometer {
    /// For a vehicle; `None` without encoders. Begins at the origin of its own frame.
    pub fn new(body: &Body) -> Option<Self> {
        Some(Self {
            encoders: body.encoders?,
            body: body.clone(),
            start_from_vehicle: Pose2::default(),
            before: None,
            direction: [1.0; 2],
        })
    }

    /// The pose, in the frame of the first step with ticks.
    pub fn pose(&self) -> Pose2 {
        self.start_from_vehicle
    }

    /// Takes what the wheels have counted so far, and the command that the vehicle gets now.
    pub fn step(&mut self, wheels: Option<Wheels>, command: &Command) -> Pose2 {
        if let Some(wheels) = wheels {
            if let Some(before) = self.before.replace(wheels) {
                let [left_m, right_m] = [
                    (wheels.left_ticks, before.left_ticks),
                    (wheels.right_ticks, before.right_ticks),
                ]
                .map(|(now, before)| now.saturating_sub(before) as f64 * self.encoders.tick_m);
                let (left_m, right_m) = (left_m * self.direction[0], right_m * self.direction[1]);
                self.start_from_vehicle = self.start_from_vehicle.advance(
                    0.5 * (left_m + right_m),
                    (right_m - left_m) / self.encoders.track_m,
                    1.0,
                );
            }
        }
        if !self.encoders.signed {
            self.turn_as_commanded(command);
        }
        self.start_from_vehicle
    }

    /// Encoders that count up only do not tell which way a wheel turned: the command does. A wheel that was told to stand
    /// rolls out the way it went.
    fn turn_as_commanded(&mut self, command: &Command) {
        let speed_mps = self.body.speed_of(command);
        let half_mps = 0.5 * self.encoders.track_m * self.body.yaw_rate_of(command.turn, speed_mps);
        for (direction, mps) in self
            .direction
            .iter_mut()
            .zip([speed_mps - half_mps, speed_mps + half_mps])
        {
            if mps != 0.0 {
                *direction = mps.signum();
            }
        }
    }
}

/// How far the reckoned pose ends from the true one.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(default)]
pub struct OdometryError {
    /// Distance from the true position (m).
    pub end_error_m: f64,
    /// Angle to the true heading (rad), 0 or more.
    pub end_error_rad: f64,
}

impl OdometryError {
    /// From the true states of a run, the first of them where the odometer began; `None` where either is missing.
    pub fn of(odometer: Option<&Odometer>, truths: &[Truth]) -> Option<Self> {
        // Without a single tick counted nothing was reckoned.
        let odometer = odometer.filter(|odometer| odometer.before.is_some())?;
        let reckoned = truths.first()?.world_from_vehicle.compose(odometer.pose());
        let truth = truths.last()?.world_from_vehicle;
        Some(Self {
            end_error_m: (reckoned.position() - truth.position()).length(),
            end_error_rad: angle::difference(reckoned.heading_rad, truth.heading_rad).abs(),
        })
    }
}

/// The odometer's path through a recorded run and where it ends; `None` without encoders or a true state to begin at.
pub fn of_recording(recording: &Recording) -> Option<(Vec<Pose2>, OdometryError)> {
    let mut odometer = Odometer::new(&recording.header.body)?;
    let world_from_start = recording.steps.first()?.truth?.world_from_vehicle;
    let path = recording
        .steps
        .iter()
        .map(|step| world_from_start.compose(odometer.step(step.wheels, &step.command)))
        .collect();
    let error = OdometryError::of(Some(&odometer), &recording.truths())?;
    Some((path, error))
}

#[cfg(test)]
mod tests {
    use super::*;
    use senda_core::Steering;

    fn odometer(signed: bool) -> Odometer {
        let body = Body {
            name: "robot".into(),
            steering: Steering::Differential { track_m: 0.1 },
            width_m: 0.1,
            length_m: 0.2,
            speed_limit_mps: 1.0,
            yaw_rate_limit_radps: 5.0,
            period_s: 0.05,
            encoders: Some(Encoders {
                tick_m: 0.001,
                track_m: 0.1,
                signed,
            }),
            cameras: vec![],
        };
        Odometer::new(&body).unwrap()
    }

    fn ticks(left_ticks: i64, right_ticks: i64) -> Option<Wheels> {
        Some(Wheels {
            left_ticks,
            right_ticks,
        })
    }

    /// A quarter circle to the left about a point 0.5 m away, then 1 m straight on: worked out by hand.
    #[test]
    fn a_known_drive_gives_the_known_pose() {
        let ahead = Command::yaw_rate(0.0, 0.2);
        let mut odometer = odometer(true);
        let quarter = std::f64::consts::FRAC_PI_2;
        let (left, right) = (450.0 * quarter, 550.0 * quarter);
        // The sensor's counts need not begin at 0.
        for part in 0..=100 {
            let part = f64::from(part) / 100.0;
            odometer.step(
                ticks(7000 + (left * part) as i64, -9000 + (right * part) as i64),
                &ahead,
            );
        }
        let pose = odometer.pose();
        assert!(
            (pose.position() - senda_geom::Vec2::new(0.5, 0.5)).length() < 0.01,
            "{pose:?}"
        );
        assert!((pose.heading_rad - quarter).abs() < 0.02, "{pose:?}");
        let (left, right) = (left as i64, right as i64);
        // A step without ticks loses none.
        odometer.step(None, &ahead);
        odometer.step(ticks(8000 + left, -8000 + right), &ahead);
        let pose = odometer.pose();
        assert!(
            (pose.position() - senda_geom::Vec2::new(0.5, 1.5)).length() < 0.03,
            "{pose:?}"
        );
    }

    /// Counted as forwards, a turn in place was a drive straight on.
    #[test]
    fn ticks_that_only_count_up_take_their_direction_from_the_command() {
        let mut odometer = odometer(false);
        odometer.step(ticks(0, 0), &Command::yaw_rate(1.0, 0.0));
        let pose = odometer.step(ticks(50, 50), &Command::yaw_rate(0.0, 0.0));
        assert!(
            pose.position().length() < 1e-9 && (pose.heading_rad - 1.0).abs() < 1e-9,
            "{pose:?}"
        );
        // Rolls out the same way.
        let pose = odometer.step(ticks(60, 60), &Command::yaw_rate(0.0, -0.1));
        assert!((pose.heading_rad - 1.2).abs() < 1e-9, "{pose:?}");
        let before = pose.position();
        let pose = odometer.step(ticks(160, 160), &Command::STOP);
        assert!(((pose.position() - before).length() - 0.1).abs() < 1e-9);
        assert!((pose.position() - before).dot(pose.forward()) < 0.0, "{pose:?}");
    }
}
