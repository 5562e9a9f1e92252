//! Recordings of the Udacity simulator: `driving_log.csv` and `IMG/` (FORMATS 2).
//!
//! Steering -1 is full left (25°), +1 full right; speed is in miles an hour; paths are those of somebody's machine.
//! [`convert`] is the only place that knows signs and units.

pub mod convert;
mod line;
mod read;
mod write;

pub use line::{LogLine, parse_line};
pub use read::{read, read_runs};
pub use write::{UdacityOptions, write};

/// Frames a second that the simulator aims at.
pub const NOMINAL_HZ: f64 = 15.0;

/// Name of the log.
pub(crate) const LOG: &str = "driving_log.csv";
/// The cameras in the order of the log's columns.
pub(crate) const CAMERAS: [&str; 3] = ["center", "left", "right"];
