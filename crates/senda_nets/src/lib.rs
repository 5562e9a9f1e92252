//! Networks as files, and a small engine that trains and runs them on the CPU.

mod error;
mod input;
mod library;
mod model;
mod network;
mod parse;
mod reader;
mod text;
mod weights;

pub use error::{NetworkError, Problem};
pub use input::{Colour, Crop, InputSpec, Preparer};
pub use model::{CameraMismatch, Model, ModelError, OutputSpec, Provenance};
pub use network::{Activation, Kind, Layer, Network, Padding, Shape, Tensor};
pub use weights::Weights;
