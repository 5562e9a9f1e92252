//! Constants of the remembered path.

use crate::options::{DriverError, check};
use serde::{Deserialize, Serialize};

/// Constants of the remembered path and of the guess at the vehicle's own motion.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct TrackOptions {
    /// How late commands act (s): for predicting the vehicle's own motion. A robot on a toy's bus: 0.05 (guess).
    pub delay_s: f64,
    /// Time constant with which the vehicle follows commands (s): 0.08 (guess).
    pub lag_s: f64,
    /// A line's points may lie this far from where the path is expected (m). C8: 0.04.
    pub gate_m: f64,
    /// The gate grows by this per metre of distance to the point: tilt and calibration errors do.
    pub gate_slope: f64,
    /// The path's direction and curvature are taken over this distance to both sides (m).
    pub window_m: f64,
    /// The curvature that is fed forward is taken this far ahead (m).
    pub preview_m: f64,
    /// The same as time at the present speed (s), added.
    pub preview_s: f64,
    /// Remembered behind the axle (m).
    pub behind_m: f64,
    /// How much one sighting may be outweighed by memory: so many equal sightings (at least 1).
    pub sightings: f64,
    /// Uncertainty that driving adds, sideways (m per square root of metre driven).
    pub drift_m: f64,
}

impl Default for TrackOptions {
    fn default() -> Self {
        Self {
            delay_s: 0.05,
            lag_s: 0.08,
            gate_m: 0.04,
            gate_slope: 0.05,
            window_m: 0.07,
            preview_m: 0.0,
            preview_s: 0.0,
            behind_m: 0.15,
            sightings: 6.0,
            drift_m: 0.02,
        }
    }
}

impl TrackOptions {
    /// Refuses what makes no sense.
    pub fn validate(&self) -> Result<(), DriverError> {
        check("track.delay_s", self.delay_s, 0.0, 5.0)?;
        check("track.lag_s", self.lag_s, 0.0, 5.0)?;
        check("track.gate_m", self.gate_m, 0.001, 10.0)?;
        check("track.gate_slope", self.gate_slope, 0.0, 10.0)?;
        check("track.window_m", self.window_m, 0.01, 10.0)?;
        check("track.preview_m", self.preview_m, 0.0, 10.0)?;
        check("track.preview_s", self.preview_s, 0.0, 10.0)?;
        check("track.behind_m", self.behind_m, 0.0, 10.0)?;
        check("track.sightings", self.sightings, 1.0, 1e6)?;
        check("track.drift_m", self.drift_m, 0.0, 10.0)
    }
}
