//! Recordings of runs (MCAP), and other people's data formats turned into them.
//!
//! ```
//! use senda_core::{Command, Observation, Stamp, Vehicle};
//! use senda_data::{Recording, RecordingHeader, RecordingWriter, Replay};
//! # use senda_core::{Body, Steering};
//! # let body = Body { name: "robot".into(), steering: Steering::Differential { track_m: 0.11 }, width_m: 0.11, length_m: 0.2,
//! #     speed_limit_mps: 0.3, yaw_rate_limit_radps: 3.0, period_s: 0.05, encoders: None, cameras: vec![] };
//! # let header = RecordingHeader { senda: "0.1.0".into(), commit: String::new(), scenario: String::new(), world: None,
//! #     reversed: false, body, driver: "line".into(), seed: 1 };
//! let mut writer = RecordingWriter::new(std::io::Cursor::new(Vec::new()), &header)?;
//! let command = Command::yaw_rate(0.2, 0.1);
//! let observation = Observation { stamp: Stamp::from_s(0.05), ..Default::default() };
//! writer.step(&observation, &command, None, &Default::default())?;
//! let file = writer.finish(&serde_json::json!({"completed": true}))?.into_inner();
//!
//! let recording = Recording::from_bytes(&file)?;
//! assert_eq!(recording.steps[0].command, command);
//! let mut replay = Replay::new(recording);
//! let mut seen = Observation::default();
//! while replay.observe(&mut seen)? {
//!     replay.actuate(&command)?; // compared, not carried out
//! }
//! assert_eq!(replay.differences(), 0);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! [`RecordingWriter`] streams a run into one MCAP file that Foxglove and Rerun open; [`Recording`] reads it back, also when
//! it was cut short; [`Replay`] is a recording as a vehicle. [`tub`], [`udacity`] and [`named_frames`] read and write other
//! people's formats; [`open()`] takes any of them by path, [`info()`] says what is in it, [`import()`] turns it into recordings.
//! What should not be learned from is left out by [`edits`], a file beside the data; [`stats()`] looks for such frames and
//! [`export()`] writes what is left for other programs.
//!
//! This crate does not know how a recording came about (simulator, robot, person) and prints nothing. Recordings and other
//! people's data are never changed: edits lie beside them. A recording is read into memory whole.

pub mod darknet;
pub mod edits;
pub mod error;
pub mod export;
pub mod import;
pub mod info;
pub mod named_frames;
pub mod open;
pub mod recording;
pub mod replay;
pub mod stats;
pub mod tub;
pub mod udacity;
pub mod writer;

mod calendar;
mod container;
mod imported;
mod messages;
mod reader;
mod store;
mod warnings;

pub use edits::{Edits, open_edited_runs};
pub use error::DataError;
pub use export::{Exported, export};
pub use import::{Imported, import};
pub use imported::Origin;
pub use info::{Info, info};
pub use open::{Format, open, open_runs};
pub use reader::NO_SUMMARY;
pub use recording::{EncodedFrame, FORMAT, LostSteps, Recording, RecordingHeader, Step};
pub use replay::{Difference, Replay};
pub use stats::{Stats, stats};
pub use writer::{RecordingOptions, RecordingWriter};
