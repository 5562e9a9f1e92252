//! A vehicle for tests: kinematics with delay and lag, no world and no camera of its own.

use crate::motion::CommandModel;
use senda_core::{Body, Command, Stamp, Steering, Truth};
use senda_geom::{Camera, Lens, Mounting, Pose2};

/// The robot of document C: 11 cm track, camera 54° x 42.3° at 9.5 cm, 33° down.
pub(crate) fn gopigo() -> Body {
    Body {
        name: "gopigo".into(),
        steering: Steering::Differential { track_m: 0.11 },
        width_m: 0.11,
        length_m: 0.15,
        speed_limit_mps: 0.6,
        yaw_rate_limit_radps: 6.0,
        period_s: 0.05,
        encoders: None,
        cameras: vec![Camera {
            name: "center".into(),
            width_px: 160,
            height_px: 120,
            lens: Lens::pinhole(160, 120, 54f64.to_radians(), 42.3f64.to_radians()),
            mounting: Mounting {
                x_m: 0.06,
                y_m: 0.0,
                z_m: 0.095,
                yaw_rad: 0.0,
                tilt_rad: 33f64.to_radians(),
                roll_rad: 0.0,
            },
        }],
    }
}

/// A front-steered car of a kit's size.
pub(crate) fn car() -> Body {
    Body {
        name: "car".into(),
        steering: Steering::Ackermann {
            wheelbase_m: 0.17,
            steering_limit_rad: 0.5,
        },
        speed_limit_mps: 2.0,
        ..gopigo()
    }
}

/// Moves exactly as commanded, after a delay and with a lag.
pub(crate) struct DelayedVehicle {
    body: Body,
    model: CommandModel,
    pose: Pose2,
    stamp: Stamp,
}

impl DelayedVehicle {
    pub(crate) fn new(body: &Body, start: Pose2, delay_s: f64, lag_s: f64) -> Self {
        let mut model = CommandModel::new(delay_s, lag_s);
        model.advance(Stamp::default(), None);
        Self {
            body: body.clone(),
            model,
            pose: start,
            stamp: Stamp::default(),
        }
    }

    pub(crate) fn stamp(&self) -> Stamp {
        self.stamp
    }

    pub(crate) fn truth(&self) -> Truth {
        Truth {
            stamp: self.stamp,
            world_from_vehicle: self.pose,
            speed_mps: self.model.speed_mps(),
            yaw_rate_radps: self.model.yaw_rate_radps(),
            ..Truth::default()
        }
    }

    pub(crate) fn step(&mut self, command: &Command, time_s: f64) {
        let speed = self
            .body
            .speed_of(command)
            .clamp(-self.body.speed_limit_mps, self.body.speed_limit_mps);
        let limit = self
            .body
            .yaw_rate_limit_radps
            .min(self.body.curvature_limit_per_m() * speed.abs());
        let rate = self.body.yaw_rate_of(command.turn, speed).clamp(-limit, limit);
        self.model.command(self.stamp, speed, rate);
        self.stamp = Stamp::from_s(self.stamp.as_s() + time_s);
        let motion = self.model.advance(self.stamp, None);
        self.pose = self.pose.compose(motion);
    }
}
