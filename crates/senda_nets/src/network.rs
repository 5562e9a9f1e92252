//! A network as data: a list of layers with checked shapes.

use crate::error::NetworkError;
use crate::input::Colour;
use crate::parse;
use std::path::Path;
use std::sync::Arc;

/// Size of what flows between layers: planes of rows of columns. A flat vector has height and width 1.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Shape {
    /// Number of planes.
    pub channels: usize,
    /// Rows of a plane.
    pub height: usize,
    /// Columns of a plane.
    pub width: usize,
}

impl Shape {
    /// A vector.
    pub fn flat(length: usize) -> Self {
        Self {
            channels: length,
            height: 1,
            width: 1,
        }
    }

    /// Number of values.
    pub fn len(&self) -> usize {
        self.channels * self.height * self.width
    }

    /// Whether it holds no value at all; no layer has such an output.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Values of one plane.
    pub fn plane(&self) -> usize {
        self.height * self.width
    }

    /// Whether it is a vector.
    pub fn is_flat(&self) -> bool {
        self.plane() == 1
    }
}

impl std::fmt::Display for Shape {
    /// `66x200x3` (height, width, channels) as the papers write it; a vector is one number.
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        if self.is_flat() {
            write!(f, "{}", self.channels)
        } else {
            write!(f, "{}x{}x{}", self.height, self.width, self.channels)
        }
    }
}

/// What stands around the image of a convolution or pooling.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Padding {
    /// Nothing: the output shrinks.
    #[default]
    Valid,
    /// As many zeros as make the output `ceil(input / stride)`, the odd one below and to the right (Keras, TensorFlow).
    Same,
    /// Zeros above, left, below and right (PyTorch, darknet).
    Explicit([usize; 4]),
}

impl Padding {
    /// Zeros above, left, below, right for an input of this size.
    pub fn amounts(&self, input: Shape, kernel: [usize; 2], stride: [usize; 2]) -> [usize; 4] {
        match self {
            Self::Valid => [0; 4],
            Self::Explicit(amounts) => *amounts,
            Self::Same => {
                let total = |size: usize, kernel: usize, stride: usize| {
                    ((size.div_ceil(stride) - 1) * stride + kernel).saturating_sub(size)
                };
                let vertical = total(input.height, kernel[0], stride[0]);
                let horizontal = total(input.width, kernel[1], stride[1]);
                [
                    vertical / 2,
                    horizontal / 2,
                    vertical - vertical / 2,
                    horizontal - horizontal / 2,
                ]
            }
        }
    }
}

/// A function applied to every value of a layer's output.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum Activation {
    /// The value itself.
    #[default]
    Linear,
    /// `max(x, 0)`.
    Relu,
    /// `x` above zero, `slope · x` below. Darknet's slope is 0.1.
    LeakyRelu(f32),
    /// `min(max(x, 0), 6)`.
    Relu6,
    /// `x` above zero, `exp(x) - 1` below.
    Elu,
    /// `1 / (1 + exp(-x))`.
    Sigmoid,
    /// Hyperbolic tangent.
    Tanh,
}

/// What a layer computes. Pairs are `[vertical, horizontal]`.
#[derive(Debug, Clone, PartialEq)]
pub enum Kind {
    /// Convolution (correlation, as everywhere in this field).
    Convolution {
        /// Output channels.
        filters: usize,
        /// Kernel size.
        kernel: [usize; 2],
        /// Step between outputs.
        stride: [usize; 2],
        /// Zeros around the input.
        padding: Padding,
        /// Whether a learned value is added to every channel.
        bias: bool,
    },
    /// One small kernel for each channel.
    DepthwiseConvolution {
        /// Kernel size.
        kernel: [usize; 2],
        /// Step between outputs.
        stride: [usize; 2],
        /// Zeros around the input.
        padding: Padding,
        /// Whether a learned value is added to every channel.
        bias: bool,
    },
    /// Largest value of a window; padding never wins.
    MaxPool {
        /// Window.
        size: [usize; 2],
        /// Step between windows.
        stride: [usize; 2],
        /// Places around the input.
        padding: Padding,
    },
    /// Mean of a window; padding is not counted.
    AveragePool {
        /// Window.
        size: [usize; 2],
        /// Step between windows.
        stride: [usize; 2],
        /// Places around the input.
        padding: Padding,
    },
    /// Mean of each plane.
    GlobalAveragePool,
    /// Every output from every input of a vector.
    Dense {
        /// Outputs.
        units: usize,
        /// Whether a learned value is added to every output.
        bias: bool,
    },
    /// The same values as one vector: channel by channel, row by row.
    Flatten,
    /// Only the activation function.
    Activation,
    /// Batch normalisation (Ioffe and Szegedy 2015): statistics of the batch while training, running ones otherwise.
    BatchNorm {
        /// Added to the variance.
        epsilon: f32,
        /// Part of the running statistics that a training step keeps.
        momentum: f32,
    },
    /// While training, zeroes each value with this probability and scales the others up.
    Dropout {
        /// Probability of a zero.
        rate: f32,
    },
    /// Repeats rows and columns.
    Upsample {
        /// How often.
        factor: usize,
    },
    /// Planes of several layers one after another.
    Concatenate,
    /// Sum of several layers of the same shape.
    Add,
    /// Convolutional LSTM (Shi et al. 2015, without peepholes): gates input, forget, cell, output; the state is carried
    /// from frame to frame.
    ConvolutionalLstm {
        /// Channels of the state and of the output.
        filters: usize,
        /// Kernel size, for the input and for the state.
        kernel: [usize; 2],
        /// Step of the input's convolution; the state's is 1.
        stride: [usize; 2],
        /// Zeros around the input; the state's convolution keeps its size.
        padding: Padding,
    },
}

impl Kind {
    /// The word that network files use.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Convolution { .. } => "convolution",
            Self::DepthwiseConvolution { .. } => "depthwise_convolution",
            Self::MaxPool { .. } => "max_pool",
            Self::AveragePool { .. } => "average_pool",
            Self::GlobalAveragePool => "global_average_pool",
            Self::Dense { .. } => "dense",
            Self::Flatten => "flatten",
            Self::Activation => "activation",
            Self::BatchNorm { .. } => "batch_norm",
            Self::Dropout { .. } => "dropout",
            Self::Upsample { .. } => "upsample",
            Self::Concatenate => "concatenate",
            Self::Add => "add",
            Self::ConvolutionalLstm { .. } => "convolutional_lstm",
        }
    }
}

/// A named block of values in [`crate::Weights`].
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Tensor {
    /// `layer.weight`, `layer.bias`, `layer.running_mean`, …: PyTorch's names.
    pub name: String,
    /// PyTorch's shapes: `[out, in, height, width]` for convolutions, `[out, in]` for dense layers.
    pub shape: Vec<usize>,
    /// Place of the first value.
    pub offset: usize,
    /// Whether a gradient moves it (running statistics and frozen layers: no).
    pub is_trainable: bool,
}

impl Tensor {
    /// Number of values.
    pub fn len(&self) -> usize {
        self.shape.iter().product()
    }

    /// Whether it has no values; no layer has such a tensor.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Where its values lie.
    pub fn range(&self) -> std::ops::Range<usize> {
        self.offset..self.offset + self.len()
    }
}

/// One layer with everything resolved.
#[derive(Debug, Clone, PartialEq)]
pub struct Layer {
    /// Its name, by which others refer to it.
    pub name: String,
    /// What it computes.
    pub kind: Kind,
    /// Applied to its output.
    pub activation: Activation,
    /// Whether training changes its weights.
    pub is_trainable: bool,
    /// Where its input comes from: 0 is the network's input, `i + 1` is layer `i`.
    pub from: Vec<usize>,
    /// Shapes of its inputs.
    pub inputs: Vec<Shape>,
    /// Shape of its output.
    pub output: Shape,
    /// Its weights.
    pub tensors: Vec<Tensor>,
    /// Multiply-adds of its convolutions or products for one input.
    pub multiply_adds: u64,
}

impl Layer {
    /// Number of weights, running statistics included.
    pub fn parameter_count(&self) -> usize {
        self.tensors.iter().map(Tensor::len).sum()
    }

    /// Number of weights that training changes.
    pub fn trainable_count(&self) -> usize {
        self.tensors
            .iter()
            .filter(|t| t.is_trainable)
            .map(Tensor::len)
            .sum()
    }

    /// Values carried from one frame to the next.
    pub fn state_len(&self) -> usize {
        match self.kind {
            Kind::ConvolutionalLstm { .. } => 2 * self.output.len(),
            _ => 0,
        }
    }
}

#[derive(Debug, PartialEq)]
pub(crate) struct Parts {
    pub(crate) name: String,
    pub(crate) description: String,
    pub(crate) input: Shape,
    pub(crate) colour: Option<Colour>,
    pub(crate) stack: usize,
    pub(crate) layers: Vec<Layer>,
}

/// A list of layers whose shapes fit. Cheap to clone.
#[derive(Debug, Clone, PartialEq)]
pub struct Network {
    pub(crate) parts: Arc<Parts>,
}

impl Network {
    /// Reads a network file. `source_name` is for error messages; its stem is the name of a network that has none.
    ///
    /// # Errors
    /// Unknown keys and kinds, values out of range and shapes that do not fit, each at its line.
    pub fn parse(source_name: &str, toml: &str) -> Result<Self, NetworkError> {
        parse::parse(source_name, toml)
    }

    /// Reads a network file from disk.
    ///
    /// # Errors
    /// Like [`Network::parse`], and when the file cannot be read.
    pub fn load(path: &Path) -> Result<Self, NetworkError> {
        let file = path.display().to_string();
        let text = std::fs::read_to_string(path).map_err(|error| NetworkError::Read {
            file: file.clone(),
            reason: error.to_string(),
        })?;
        Self::parse(&file, &text)
    }

    /// The network's name.
    pub fn name(&self) -> &str {
        &self.parts.name
    }

    /// What it is and where it comes from.
    pub fn description(&self) -> &str {
        &self.parts.description
    }

    /// Shape of one input.
    pub fn input(&self) -> Shape {
        self.parts.input
    }

    /// Colour space of its input, where its file says; experiments may say otherwise.
    pub fn colour(&self) -> Option<Colour> {
        self.parts.colour
    }

    /// Frames that its input's channels are shared out among.
    pub fn stack(&self) -> usize {
        self.parts.stack
    }

    /// Values of one output.
    pub fn output_len(&self) -> usize {
        self.parts.layers.last().map_or(0, |layer| layer.output.len())
    }

    /// The layers, in order.
    pub fn layers(&self) -> &[Layer] {
        &self.parts.layers
    }

    /// All blocks of weights, in the order in which they lie in [`crate::Weights`].
    pub fn tensors(&self) -> impl Iterator<Item = &Tensor> {
        self.parts.layers.iter().flat_map(|layer| &layer.tensors)
    }

    /// Number of weights, running statistics included.
    pub fn parameter_count(&self) -> usize {
        self.parts.layers.iter().map(Layer::parameter_count).sum()
    }

    /// Number of weights that training changes.
    pub fn trainable_count(&self) -> usize {
        self.parts.layers.iter().map(Layer::trainable_count).sum()
    }

    /// Multiply-adds for one input.
    pub fn multiply_adds(&self) -> u64 {
        self.parts.layers.iter().map(|layer| layer.multiply_adds).sum()
    }

    /// Whether it carries state from frame to frame.
    pub fn is_recurrent(&self) -> bool {
        self.state_len() > 0
    }

    /// Values of the carried state.
    pub fn state_len(&self) -> usize {
        self.parts.layers.iter().map(Layer::state_len).sum()
    }
}
