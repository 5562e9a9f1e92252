//! From recordings and random worlds to a network that drives.

pub mod augment;
mod checkpoint;
pub mod correct;
mod error;
pub mod gather;
pub mod learn;
mod samples;
pub mod split;
mod store;
pub mod train;

pub use augment::{Answers, Augmentation};
pub use error::LearnError;
pub use learn::{Learned, Learning, learn};
pub use samples::{Run, Samples};
pub use split::Split;
pub use train::{Training, train};
