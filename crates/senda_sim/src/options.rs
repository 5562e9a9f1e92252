//! What a simulated run is given besides world and vehicle.

use crate::render::Sharpness;
use serde::{Deserialize, Serialize};
use thiserror::Error;

/// Options of a [`crate::Simulator`]. The default is seed 0 at the world's start, cameras on, no disturbances.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct SimOptions {
    /// Seed of everything random. The same seed gives the same run.
    pub seed: u64,
    /// Where the vehicle starts.
    pub start: Start,
    /// The run ends after this time (s); `None`: never.
    pub duration_s: Option<f64>,
    /// Which observations have pictures.
    pub images: Images,
    /// How the cameras hand their pictures over.
    pub delivery: Delivery,
    /// How many of the vehicle's cameras take them, from the first one on; `None`: all. The others' pictures cost as much, and
    /// nothing that the first ones see depends on them.
    pub cameras: Option<usize>,
    /// Further delay (s) from the exposure to the observation, on top of the camera's own.
    pub extra_latency_s: f64,
    /// Part of the frames that get lost on the way, 0..=1; those of several cameras together.
    pub lost_frames: f64,
    /// Pushes from outside.
    pub pushes: Option<Pushes>,
    /// Side of a texel of the floor (m); `None`: fitting the cameras.
    pub metres_per_texel: Option<f64>,
    /// How texture detail is matched to pixels.
    pub sharpness: Sharpness,
}

/// Where a run starts.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Start {
    /// Station on the world's path (m); `None`: where the world's laps begin.
    pub station_m: Option<f64>,
    /// Distance to the left of the path (m).
    pub offset_m: f64,
    /// Heading relative to the path's (rad), left positive.
    pub heading_rad: f64,
    /// Speed with which it rolls already (m/s).
    pub speed_mps: f64,
}

/// Which observations have pictures. Drivers that know the true state need none.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Images {
    /// All.
    #[default]
    Always,
    /// The first and every n-th after it.
    Every(u32),
    /// None: more than 100,000 steps a second.
    Never,
}

/// How the cameras hand their pictures over. The pixels are the same.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Delivery {
    /// With the compressed bytes where the camera compresses: what recordings keep.
    #[default]
    Compressed,
    /// Pixels only, with the artefacts of the compression in them: faster.
    Pixels,
}

/// Pushes: for a moment the vehicle turns although nobody steers. Learning by correction needs the recoveries.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Pushes {
    /// Mean time between pushes (s); the times are random (exponentially distributed).
    pub every_s: f64,
    /// How long one lasts (s).
    pub lasts_s: f64,
    /// Standard deviation of the yaw rate that it adds (rad/s).
    pub yaw_rate_std_radps: f64,
}

/// Why a simulation cannot begin.
#[derive(Debug, Error, Clone, PartialEq)]
pub enum SimError {
    /// An option is out of its range.
    #[error("{key}: expected {expected}, but found {found}; {help}")]
    Option {
        /// Name of the option.
        key: &'static str,
        /// What it may be.
        expected: String,
        /// What it is.
        found: String,
        /// What to do.
        help: &'static str,
    },
}

impl SimOptions {
    pub(crate) fn check(&self) -> Result<(), SimError> {
        let wrong = |key, expected: &str, found: f64, help| {
            Err(SimError::Option {
                key,
                expected: expected.to_owned(),
                found: found.to_string(),
                help,
            })
        };
        let Start {
            station_m,
            offset_m,
            heading_rad,
            speed_mps,
        } = self.start;
        for (key, value) in [
            ("start.station_m", station_m.unwrap_or(0.0)),
            ("start.offset_m", offset_m),
            ("start.heading_rad", heading_rad),
            ("start.speed_mps", speed_mps),
        ] {
            if !(-1e6..1e6).contains(&value) {
                return wrong(key, "a number", value, "check where it was computed");
            }
        }
        if let Some(duration_s) = self.duration_s
            && !(0.0..=1e9).contains(&duration_s)
        {
            return wrong(
                "duration_s",
                "0 or more seconds",
                duration_s,
                "leave it out to run without end",
            );
        }
        if !(0.0..=5.0).contains(&self.extra_latency_s) {
            return wrong(
                "extra_latency_s",
                "0 to 5 seconds",
                self.extra_latency_s,
                "use seconds",
            );
        }
        if !(0.0..=1.0).contains(&self.lost_frames) {
            return wrong(
                "lost_frames",
                "a part from 0 to 1",
                self.lost_frames,
                "5 % is 0.05",
            );
        }
        if let Some(size) = self.metres_per_texel
            && !(1e-4..=1.0).contains(&size)
        {
            return wrong(
                "metres_per_texel",
                "0.0001 to 1 m",
                size,
                "leave it out to fit the cameras",
            );
        }
        if let Some(pushes) = &self.pushes
            && !(pushes.every_s > 0.0 && pushes.lasts_s >= 0.0 && pushes.yaw_rate_std_radps.is_finite())
        {
            return wrong(
                "pushes.every_s",
                "more than 0 seconds",
                pushes.every_s,
                "leave pushes out for none",
            );
        }
        Ok(())
    }
}
