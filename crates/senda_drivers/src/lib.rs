//! Drivers: `line` and `lane` follow painted lines by camera, `hough` steers by straight edges of a lane's coloured tape,
//! `expert` follows a path that it is told, `human` does so as a person would, and [`ManualDriver`] does what a person's hands
//! do.
//!
//! ```
//! use senda_core::{Body, Driver, Observation, Steering};
//! use senda_drivers::{LineDriver, LineOptions};
//! use senda_geom::{Camera, Lens, Mounting};
//! let camera = Camera {
//!     name: "center".into(),
//!     width_px: 160,
//!     height_px: 120,
//!     lens: Lens::pinhole(160, 120, 54f64.to_radians(), 42.3f64.to_radians()),
//!     mounting: Mounting { x_m: 0.04, y_m: 0.0, z_m: 0.095, yaw_rad: 0.0, tilt_rad: 33f64.to_radians(), roll_rad: 0.0 },
//! };
//! let body = Body {
//!     name: "gopigo".into(),
//!     steering: Steering::Differential { track_m: 0.11 },
//!     width_m: 0.14,
//!     length_m: 0.2,
//!     speed_limit_mps: 0.4,
//!     yaw_rate_limit_radps: 6.0,
//!     period_s: 0.05,
//!     encoders: None,
//!     cameras: vec![camera],
//! };
//! let mut driver = LineDriver::new(&body, LineOptions::default()).unwrap();
//! // Nothing seen yet: it stands and waits.
//! let command = driver.drive(&Observation::default());
//! assert_eq!(body.speed_of(&command), 0.0);
//! ```
//!
//! The way of a frame: [`sight`] finds candidates and puts them on the floor, [`mod@line`] or [`lane`] decide which of them
//! is the path, [`follow`] turns the path's state into a yaw rate, [`speed`] and [`loss`] decide how fast and when to
//! stop. [`study`] shows what the controller does without camera and world (C13). Two forms live side by side: the
//! document's ([`Form::Document`]) and one that uses the line's shape on the floor plane ([`Form::Curve`], C17). A third, for lanes, needs no obedient vehicle
//! ([`Form::Road`]).
//!
//! This crate does not know simulators, hardware, files and clocks; the true state reaches [`ExpertDriver`] and [`HumanDriver`]
//! only.

mod along_path;
mod association;
mod candidate;
pub mod detector;
pub mod expert;
pub mod follow;
mod helm;
pub mod hough;
mod hough_lanes;
mod hough_mask;
pub mod human;
pub mod lane;
mod lane_curve;
mod lane_document;
mod lane_pair;
mod lane_road;
pub mod line;
pub mod loss;
pub mod manual;
pub mod mission;
mod motion;
pub mod neural;
mod options;
mod path_memory;
pub mod pid;
mod response;
mod road_vote;
pub mod sight;
pub mod speed;
pub mod study;
#[cfg(test)]
mod test_vehicle;

pub use detector::NetworkDetector;
pub use expert::{ExpertDriver, ExpertOptions};
pub use follow::{FollowOptions, Form, LineState};
pub use hough::{HoughDriver, HoughDriverOptions, Mask};
pub use hough_lanes::Sides;
pub use human::{HumanDriver, HumanOptions};
pub use lane::{LaneDriver, LaneOptions, LaneShape};
pub use lane_road::RoadOptions;
pub use line::{ChoiceOptions, LineDriver, LineOptions};
pub use loss::{LossOptions, Mode, WhileLost};
pub use manual::{Hands, KeyScript, ManualDriver, ManualOptions};
pub use mission::{MissionDriver, MissionOptions};
pub use neural::{Answer, NeuralDriver, NeuralOptions, is_gap};
pub use options::DriverError;
pub use path_memory::TrackOptions;
pub use sight::{ContrastChoice, SightOptions};
pub use speed::SpeedOptions;
