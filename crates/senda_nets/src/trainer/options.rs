//! How to train, and why it may not begin.

use serde::{Deserialize, Serialize};
use thiserror::Error;

/// What training minimises: the mean over batch and outputs of a function of the error.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case", deny_unknown_fields)]
pub enum Loss {
    /// Its square (A9, B5).
    #[default]
    Mse,
    /// Half its square up to `delta`, linear beyond: a few wrong labels count less.
    Huber {
        /// Where it becomes linear, in units of the output.
        delta: f32,
    },
}

impl Loss {
    /// Loss and its derivative for one error.
    pub(super) fn of(self, error: f32) -> (f32, f32) {
        match self {
            Self::Mse => (error * error, 2.0 * error),
            Self::Huber { delta } if error.abs() <= delta => (0.5 * error * error, error),
            Self::Huber { delta } => (
                delta * (error.abs() - 0.5 * delta),
                delta * if error > 0.0 { 1.0 } else { -1.0 },
            ),
        }
    }
}

/// How to train. The defaults are Keras's Adam.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct TrainOptions {
    /// Step size.
    pub learning_rate: f32,
    /// Adam: memory of the mean of gradients.
    pub beta1: f32,
    /// Adam: memory of the mean of their squares.
    pub beta2: f32,
    /// Adam: added to the root of the mean square.
    pub epsilon: f32,
    /// Part of each weight taken away in a step, in units of the learning rate (AdamW; Loshchilov and Hutter 2019).
    pub weight_decay: f32,
    /// Threads to use; the result does not depend on it.
    pub threads: usize,
    /// Seed of the dropout masks.
    pub seed: u64,
    /// What to minimise.
    pub loss: Loss,
    /// Weight of each output in the loss; empty: all 1.
    pub output_weights: Vec<f32>,
    /// Longest gradient; longer ones are shortened to it.
    pub clip_norm: Option<f32>,
}

impl Default for TrainOptions {
    fn default() -> Self {
        Self {
            learning_rate: 1e-3,
            beta1: 0.9,
            beta2: 0.999,
            epsilon: 1e-7,
            weight_decay: 0.0,
            threads: 1,
            seed: 0,
            loss: Loss::Mse,
            output_weights: Vec::new(),
            clip_norm: None,
        }
    }
}

/// Why training cannot begin or go on.
#[derive(Debug, Error)]
pub enum TrainError {
    /// Weights of another network, or not finite.
    #[error("expected {expected} finite weights, but found {found}")]
    Weights {
        /// Number that the network has.
        expected: usize,
        /// What there is.
        found: String,
    },
    /// The options and the network do not go together.
    #[error("{0}")]
    Options(String),
    /// A saved state of another network or another version, or a damaged one.
    #[error("expected a saved training state of this network, but found {0}")]
    State(String),
    /// No thread could be started.
    #[error("starting the training threads: {0}")]
    Threads(#[from] std::io::Error),
}
