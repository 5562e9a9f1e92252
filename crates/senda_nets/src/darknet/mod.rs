//! Darknet's network files (D7 in SPEC): `.cfg` is a list of layers, `.weights` their values.

mod cfg;
mod library;
#[cfg(test)]
mod tests;
mod weights;
mod write;

use crate::detection::DetectionSpec;
use crate::network::Network;
use thiserror::Error;

pub use weights::DarknetWeights;

/// Why a darknet file cannot be used.
#[derive(Debug, Error)]
pub enum DarknetError {
    /// The system could not read it.
    #[error("{file}: {reason}")]
    File {
        /// Which file.
        file: String,
        /// What the system said.
        reason: String,
    },
    /// Something in a `.cfg` is wrong or unknown here.
    #[error("{file}:{line}: expected {expected}, but found {found}")]
    Cfg {
        /// Which file.
        file: String,
        /// Line, counted from 1.
        line: usize,
        /// What would have been right.
        expected: String,
        /// What is there.
        found: String,
    },
    /// A `.weights` file does not fit the network.
    #[error("{file}: expected {expected}, but found {found}; {help}")]
    Weights {
        /// Which file.
        file: String,
        /// What would have been right.
        expected: String,
        /// What is there.
        found: String,
        /// What to do.
        help: String,
    },
    /// A network that darknet cannot express.
    #[error("layer {layer:?}: expected one that darknet's files can hold, but found {found}")]
    Foreign {
        /// Its name.
        layer: String,
        /// What about it.
        found: String,
    },
}

/// What a `.cfg` file describes.
#[derive(Debug, Clone, PartialEq)]
pub struct Darknet {
    /// The layers. Every `[yolo]` is a flattened head; several heads are concatenated in their order.
    pub network: Network,
    /// What the output means; classes are named by their number.
    pub detection: DetectionSpec,
    /// Keys that this reader does not know and left out.
    pub warnings: Vec<String>,
}
