//! The words that all of senda shares: images, observations, commands, and the two traits `Vehicle` and `Driver`.
//!
//! ```
//! use senda_core::{Command, Driver, Observation};
//! /// Drives straight on, whatever it sees.
//! struct Straight;
//! impl Driver for Straight {
//!     fn drive(&mut self, _observation: &Observation) -> Command {
//!         Command::curvature(0.0, 0.1)
//!     }
//! }
//! let command = Straight.drive(&Observation::default());
//! assert!(command.is_finite());
//! ```
//!
//! A [`Vehicle`] is sensed and actuated: the simulator, a robot, a recording. A [`Driver`] turns an [`Observation`]
//! into a [`Command`]. The true state ([`Truth`]) is not part of an observation; only a [`PrivilegedDriver`] gets it.
//!
//! This crate does not know any vehicle or driver, what lies in files ([`whole_file`] only puts them down safely), and no clock.

pub mod body;
pub mod bounded_file;
pub mod codec;
pub mod command;
pub mod driver;
pub mod edges;
pub mod explanation;
pub mod image;
pub mod jpeg_artefacts;
pub mod memory;
pub mod observation;
pub mod threads;
pub mod vehicle;
pub mod whole_file;

pub use body::{Body, Encoders, Steering};
pub use codec::{CodecError, Encoded, ImageFormat};
pub use command::{Command, Drive, Turn};
pub use driver::{Driver, PrivilegedDriver};
pub use edges::{Canny, Gradients};
pub use explanation::{Explanation, Shape, Signal};
pub use image::{Channels, Image};
pub use jpeg_artefacts::JpegArtefacts;
pub use observation::{Frame, Observation, Stamp, Wheels};
pub use vehicle::{Truth, Vehicle, VehicleError};
