//! A simulated vehicle: moves, wears cameras and wheels with all their faults, and looks at a painted floor.
//!
//! ```
//! use senda_core::{Command, Observation, Vehicle};
//! use senda_sim::{SimOptions, Simulator};
//! use senda_world::{VehicleSpec, World};
//!
//! let (world, vehicle) = (World::named("oval").unwrap(), VehicleSpec::named("gopigo").unwrap());
//! let options = SimOptions { seed: 7, metres_per_texel: Some(0.01), ..SimOptions::default() };
//! let mut simulator = Simulator::new(world, &vehicle, options).unwrap();
//! let mut observation = Observation::default();
//! for _ in 0..3 {
//!     simulator.observe(&mut observation).unwrap();
//!     simulator.actuate(&Command::curvature(0.0, 0.13)).unwrap();
//! }
//! assert_eq!(observation.frames[0].image.width(), 160);
//! assert!(simulator.truth().unwrap().speed_mps > 0.0);
//! ```
//!
//! [`Simulator`] is the whole vehicle. [`Dynamics`] moves without a world; [`render`] draws pictures without a
//! vehicle. The same seed gives the same bytes, on every machine and with or without vector instructions.
//!
//! This crate reads no clock, opens no files and does not know who drives. It has no contacts: things are seen, not
//! felt, and the floor is flat.

pub mod bench;
pub mod dynamics;
pub mod options;
mod random;
pub mod render;
mod sensor;
pub mod simulator;

pub use dynamics::Dynamics;
pub use options::{Delivery, Images, Pushes, SimError, SimOptions, Start};
pub use simulator::{Simulator, fitting_texel_m};
