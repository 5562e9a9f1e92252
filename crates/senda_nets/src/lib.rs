//! Networks as files, and a small engine that trains and runs them on the CPU.

mod convolution;
mod dense;
mod engine;
mod error;
mod inference;
mod input;
mod kernel;
mod library;
mod lstm;
mod math;
mod model;
mod network;
mod parse;
mod reader;
mod text;
mod trainer;
mod weights;
mod window;
mod workers;

pub use error::{NetworkError, Problem};
pub use inference::Inference;
pub use input::{Colour, Crop, InputSpec, Preparer};
pub use model::{CameraMismatch, Model, ModelError, OutputSpec, Provenance};
pub use network::{Activation, Kind, Layer, Network, Padding, Shape, Tensor};
pub use trainer::{Loss, TrainError, TrainOptions, Trainer};
pub use weights::{Initialisation, Weights};
