//! The digest that says whether two runs were the same.

use senda_core::{Command, Drive, Stamp, Truth, Turn};
use sha2::{Digest, Sha256};

/// SHA-256 over every step's time, true state and command, bit for bit.
#[derive(Default)]
pub struct TrajectoryDigest {
    hasher: Sha256,
}

impl TrajectoryDigest {
    /// Adds a step.
    pub fn step(&mut self, stamp: Stamp, truth: Option<&Truth>, command: &Command) {
        self.hasher.update(stamp.ns.to_le_bytes());
        if let Some(truth) = truth {
            let pose = truth.world_from_vehicle;
            for number in [
                pose.x_m,
                pose.y_m,
                pose.heading_rad,
                truth.speed_mps,
                truth.yaw_rate_radps,
            ] {
                self.hasher.update(number.to_bits().to_le_bytes());
            }
        }
        let (kind, turn) = match command.turn {
            Turn::CurvaturePerM(value) => (0u8, value),
            Turn::YawRateRadps(value) => (1, value),
            Turn::SteeringRad(value) => (2, value),
        };
        let (drive_kind, drive) = match command.drive {
            Drive::SpeedMps(value) => (0u8, value),
            Drive::Throttle(value) => (1, value),
        };
        self.hasher.update([kind, drive_kind]);
        self.hasher.update(turn.to_bits().to_le_bytes());
        self.hasher.update(drive.to_bits().to_le_bytes());
    }

    /// The digest in hexadecimal, 64 characters.
    pub fn finish(self) -> String {
        self.hasher
            .finalize()
            .iter()
            .map(|byte| format!("{byte:02x}"))
            .collect()
    }
}
