//! From recordings and random worlds to a network that drives.
//!
//! ```
//! use senda_learn::{Samples, Split, split::split};
//! // Two runs on two circuits: one is held out whole, since neighbouring frames are almost the same picture.
//! let mut samples = Samples::new(1, 1);
//! for circuit in ["oval", "bean"] {
//!     samples.begin_run(circuit, circuit);
//!     for frame in 0..10 {
//!         samples.push(&[frame], &[0.0]);
//!     }
//! }
//! let (training, validation) = split(&samples, Split::Worlds, 0.5, 0, 1, false).unwrap();
//! assert_ne!(training.runs[0].world, validation.runs[0].world);
//! ```
//!
//! Two ways lead to a model file. [`gather`] reads recordings, [`mod@split`] holds some out, [`mod@train`] fits a network to the rest
//! (A7 to A10 in SPEC). [`mod@learn`] needs no data: the expert drives random worlds, the network learns, drives itself and is
//! corrected ([`correct`], DAgger).
//!
//! This crate does not know the command line, hardware, how layers compute (that is `senda_nets`) and how a run goes (that is
//! `senda_run`).

pub mod augment;
mod balance;
pub mod beginning;
mod checkpoint;
pub mod correct;
pub mod detector;
mod error;
pub mod gather;
pub mod learn;
pub mod offline;
mod order;
pub mod quantise;
mod samples;
pub mod split;
mod store;
pub mod train;
mod treatments;
pub mod trial;

pub use augment::{Answers, Augmentation};
pub use error::LearnError;
pub use learn::{Learned, Learning, learn};
pub use samples::{Run, Samples, TARGET_LIMIT};
pub use split::Split;
pub use train::{Training, train};
