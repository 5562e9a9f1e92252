//! Networks as files, and a small engine that trains and runs them on the CPU with the same bits on every machine.
//!
//! ```
//! use senda_nets::{Eye, Inference, InputSpec, Network, TrainOptions, Trainer, Weights};
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let network = Network::named("tinypilotnet")?;
//! assert_eq!(network.parameter_count(), 761);
//!
//! // Frames become planar inputs: channel, row, column. Batches are concatenated.
//! let mut eye = Eye::new(&InputSpec::of(network.input()));
//! let input = eye.see(&senda_core::Image::new(320, 240, senda_core::Channels::Rgb)).to_vec();
//!
//! let mut trainer = Trainer::new(network.clone(), Weights::random(&network, 1), TrainOptions::default())?;
//! let before = trainer.step(&input, &[0.25], None);
//! for _ in 0..20 {
//!     trainer.step(&input, &[0.25], None);
//! }
//! assert!(trainer.evaluate(&input, &[0.25]) < before);
//!
//! let mut inference = Inference::new(&network, trainer.weights(), 1);
//! println!("steering {}", inference.run(&input)[0]);
//!
//! let error = Network::parse("mine.toml", "[input]\nheight = 9\nwidht = 9").unwrap_err();
//! assert!(error.to_string().contains("mine.toml:3: input.widht"));
//! # Ok(())
//! # }
//! ```
//!
//! A [`Model`] is one file with network, weights, input specification, outputs and provenance.
//!
//! This crate does not know the simulator, recordings or data sets, reads no clock, and has no automatic
//! differentiation: each layer's backward pass is written by hand and checked against differences and PyTorch.

mod adopt;
mod convolution;
mod darknet;
mod dense;
mod detection;
mod engine;
mod error;
mod fold;
mod inference;
mod input;
mod kernel;
mod library;
mod lstm;
mod math;
mod model;
mod network;
mod onnx;
mod parse;
mod preparer;
mod quantised;
mod safetensors;
mod saliency;
mod text;
mod trainer;
mod weights;
mod window;
mod workers;

pub use adopt::{AdoptError, Adopted};
pub use darknet::{Darknet, DarknetError, DarknetWeights};
pub use detection::{
    Boxed, ClassScore, DetectionLoss, DetectionSpec, Finder, Head, Rect, Scorer, Scores, suppress,
};
pub use error::{NetworkError, Problem};
pub use inference::Inference;
pub use input::{Colour, Crop, Edges, InputSpec, View};
pub use model::{CameraMismatch, Model, ModelError, OutputSpec, Provenance};
pub use network::{Activation, Kind, Layer, Network, Padding, Shape, Tensor};
pub use onnx::{Imported, OnnxError};
pub use preparer::{Eye, FrameStack, Preparer};
pub use quantised::{Grid, QuantiseError};
pub use saliency::{Gaze, Saliency, heat, overlay};
pub use trainer::{Loss, TrainError, TrainOptions, Trainer};
pub use weights::{Initialisation, Weights};
