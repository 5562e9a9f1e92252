//! Recordings of runs (MCAP), and other people's data formats turned into them.
//!
//! This crate does not know how a recording came about, and prints nothing.

pub mod error;
pub mod named_frames;
pub mod recording;
pub mod replay;
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

pub use error::DataError;
pub use recording::{EncodedFrame, FORMAT, Recording, RecordingHeader, Step};
pub use replay::{Difference, Replay};
pub use writer::{RecordingOptions, RecordingWriter};
