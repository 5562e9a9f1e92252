//! What a mission may be told.

use crate::options::{DriverError, check};
use senda_vision::street::colours::ColourLimits;
use senda_vision::{ClassicalOptions, QrLimits};
use serde::{Deserialize, Serialize};

/// Options of [`crate::MissionDriver`]. Lengths on the floor, times in the vehicle's own time.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct MissionOptions {
    /// Cruising speed (m/s).
    pub speed_mps: f64,
    /// Where to stop: the crossing's near edge this far ahead of the vehicle's origin (m).
    pub stop_m: f64,
    /// A crossing this near is approached (m).
    pub approach_m: f64,
    /// Distance at which the line is aimed at (m).
    pub look_ahead_m: f64,
    /// How long unloading takes (s).
    pub unload_s: f64,
    /// The detector looks at one frame in so many (D8).
    pub detect_every: u32,
    /// Codes are looked for in one frame in so many.
    pub read_every: u32,
    /// Yaw rate of turning in place (rad/s).
    pub turn_radps: f64,
    /// How far it turns to either side in search of sign and light (rad).
    pub search_rad: f64,
    /// Boards and lights whose boxes are lower than this part of the frame's width belong to other areas.
    pub sign_part: f64,
    /// Codes smaller than this part of the frame's width belong to other places.
    pub code_part: f64,
    /// A light that is green for so long without having been red before counts as green (s).
    pub green_patience_s: f64,
    /// Longest wait for a package (s).
    pub package_limit_s: f64,
    /// Longest wait for green (s).
    pub light_limit_s: f64,
    /// A light that is waited for and not seen for so long is none (s): longer than red and green of any light together.
    pub light_there_s: f64,
    /// Longest way without the crossing, junction or code that is looked for (m).
    pub way_limit_m: f64,
    /// Voltage below which the mission is given up (V, D13); 0: never.
    pub empty_v: f64,
    /// Limits of colours (D3).
    pub colours: ColourLimits,
    /// Bounds of code reading.
    pub codes: QrLimits,
    /// A trained detector's boxes count from this confidence on (0 ..= 1).
    pub sure: f64,
    /// The classical detector's limits.
    pub classical: ClassicalOptions,
}

impl Default for MissionOptions {
    /// Tuned on warehouses with seeds below 10000.
    fn default() -> Self {
        Self {
            speed_mps: 0.20,
            stop_m: 0.26,
            approach_m: 0.40,
            look_ahead_m: 0.31,
            unload_s: 3.0,
            detect_every: 5,
            read_every: 2,
            turn_radps: 0.6,
            search_rad: 0.9,
            sign_part: 0.12,
            code_part: 0.085,
            green_patience_s: 25.0,
            package_limit_s: 60.0,
            light_limit_s: 60.0,
            light_there_s: 20.0,
            way_limit_m: 8.0,
            empty_v: 13.2,
            colours: ColourLimits::default(),
            codes: QrLimits::default(),
            sure: 0.5,
            classical: ClassicalOptions::default(),
        }
    }
}

impl MissionOptions {
    /// Another cruising speed, if one is given.
    pub fn set_speed(&mut self, speed_mps: Option<f64>) {
        if let Some(speed_mps) = speed_mps {
            self.speed_mps = speed_mps;
        }
    }

    pub(super) fn check(&self) -> Result<(), DriverError> {
        check("speed_mps", self.speed_mps, 0.03, 1.0)?;
        check("stop_m", self.stop_m, 0.05, 1.0)?;
        check("approach_m", self.approach_m, self.stop_m, 1.5)?;
        check("look_ahead_m", self.look_ahead_m, 0.05, 1.0)?;
        check("unload_s", self.unload_s, 0.0, 600.0)?;
        check("detect_every", f64::from(self.detect_every), 1.0, 1000.0)?;
        check("read_every", f64::from(self.read_every), 1.0, 1000.0)?;
        check("turn_radps", self.turn_radps, 0.1, 5.0)?;
        check("search_rad", self.search_rad, 0.1, 3.0)?;
        check("sign_part", self.sign_part, 0.0, 1.0)?;
        check("code_part", self.code_part, 0.0, 1.0)?;
        check("green_patience_s", self.green_patience_s, 0.0, 1e4)?;
        check("package_limit_s", self.package_limit_s, 0.0, 1e5)?;
        check("light_limit_s", self.light_limit_s, 0.0, 1e5)?;
        check("light_there_s", self.light_there_s, 0.0, 1e5)?;
        check("way_limit_m", self.way_limit_m, 0.5, 1e4)?;
        check("empty_v", self.empty_v, 0.0, 1e3)?;
        check("sure", self.sure, 0.0, 1.0)
    }
}
