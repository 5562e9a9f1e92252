//! What can be driven.

use crate::{Body, Command, Observation, Stamp};
use senda_geom::Pose2;
use serde::{Deserialize, Serialize};
use thiserror::Error;

/// The true state, known to simulators (and to recordings of them): for metrics, labels and the expert only.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Truth {
    /// When.
    pub stamp: Stamp,
    /// Pose of the vehicle in the world.
    pub world_from_vehicle: Pose2,
    /// Forward speed (m/s).
    pub speed_mps: f64,
    /// Yaw rate (rad/s).
    pub yaw_rate_radps: f64,
    /// Angle of the front wheels (rad); 0 where there are none.
    pub steering_rad: f64,
    /// Battery voltage (V); 0 where none is modelled.
    pub battery_v: f64,
}

/// Why a vehicle stopped sensing or acting.
#[derive(Debug, Error)]
pub enum VehicleError {
    /// A sensor or its source failed.
    #[error("{sensor}: {reason}")]
    Sensor {
        /// Which sensor or file.
        sensor: String,
        /// What happened and what to do.
        reason: String,
    },
    /// A command could not be carried out.
    #[error("{actuator}: {reason}")]
    Actuator {
        /// Which actuator.
        actuator: String,
        /// What happened and what to do.
        reason: String,
    },
}

/// Sensed and actuated: the simulator, a robot, a foreign simulator, a recording.
pub trait Vehicle {
    /// Shape, limits and cameras.
    fn body(&self) -> &Body;

    /// Waits (in the vehicle's own time) for the next observation and writes it into `observation`, whose memory is
    /// reused. `false`: there will be no more.
    fn observe(&mut self, observation: &mut Observation) -> Result<bool, VehicleError>;

    /// Takes a command. It holds until the next one.
    fn actuate(&mut self, command: &Command) -> Result<(), VehicleError>;

    /// The pedal (-1..1) that the vehicle's own speed control presses for a command in m/s at the last observation, where it has
    /// pedals; `None` for a command that is one.
    fn pedal(&self, command: &Command) -> Option<f64> {
        let _ = command;
        None
    }

    /// The true state at the last observation, where the vehicle knows it.
    fn truth(&self) -> Option<&Truth> {
        None
    }
}
