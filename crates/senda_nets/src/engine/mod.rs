//! The executor: runs a list of layers forward and backward over buffers that are made once.

mod backward;
mod buffers;
mod forward;
mod plan;

use crate::convolution;
use crate::dense;
use crate::lstm;
use crate::network::{Layer, Network, Tensor};
use crate::window::Window;
use std::ops::Range;

/// How one layer is computed.
#[derive(Debug, Clone)]
pub(crate) enum Operation {
    Convolution(convolution::Plan),
    Depthwise(Window),
    Dense(dense::Plan, Vec<u32>),
    MaxPool(Window),
    AveragePool(Window),
    GlobalAveragePool,
    /// Flatten, and layers that are only an activation.
    Copy,
    Normalise {
        epsilon: f32,
        uses_batch: bool,
    },
    Dropout {
        rate: f32,
    },
    Upsample {
        factor: usize,
    },
    Concatenate,
    Add,
    Lstm(lstm::Plan),
}

/// What becomes of the gradient of one of a layer's inputs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Flow {
    /// Nobody needs it.
    Stop,
    /// This layer is the first to write it.
    Set,
    /// Another one has written before.
    Add,
}

/// One layer, planned.
#[derive(Debug, Clone)]
pub(crate) struct Planned {
    pub(crate) layer: Layer,
    pub(crate) operation: Operation,
    pub(crate) flows: Vec<Flow>,
    /// Whether the backward pass visits it.
    pub(crate) needs_gradient: bool,
    /// Where the gradient of each of its tensors lies, if it is trained.
    pub(crate) gradient_ranges: Vec<Option<Range<usize>>>,
}

impl Planned {
    pub(crate) fn tensor<'a>(&self, weights: &'a [f32], suffix: &str) -> &'a [f32] {
        let is_it = |tensor: &&Tensor| tensor.name.rsplit('.').next() == Some(suffix);
        match self.layer.tensors.iter().find(is_it) {
            Some(tensor) => &weights[tensor.range()],
            None => &[],
        }
    }

    /// Whether any of its weights is trained.
    pub(crate) fn is_trained(&self) -> bool {
        self.gradient_ranges.iter().any(Option::is_some)
    }
}

/// A network ready to run with at most `chunk` inputs at once.
#[derive(Debug, Clone)]
pub(crate) struct Engine {
    pub(crate) network: Network,
    pub(crate) layers: Vec<Planned>,
    pub(crate) chunk: usize,
    pub(crate) gradient_len: usize,
    /// Which nodes (0 is the input) carry a gradient.
    node_needs_gradient: Vec<bool>,
}

/// Weights rearranged for the kernels, one entry a layer.
#[derive(Debug, Clone, Default)]
pub(crate) struct Packed {
    forward: Vec<Vec<f32>>,
    backward: Vec<Vec<f32>>,
}

/// Values and gradients of every node for one moment.
#[derive(Debug, Clone)]
pub(crate) struct Frame {
    pub(crate) values: Vec<Vec<f32>>,
    pub(crate) gradients: Vec<Vec<f32>>,
    /// What a layer keeps for its backward pass: dropout masks, gates.
    pub(crate) kept: Vec<Vec<f32>>,
}

/// Memory of one thread that no result depends on.
#[derive(Debug, Clone)]
pub(crate) struct Scratch {
    /// Padded and split images, one buffer a layer: their margins stay zero.
    sources: Vec<Vec<f32>>,
    /// Gradients with margins, one buffer a layer.
    padded: Vec<Vec<f32>>,
    /// The same two for the state's convolution of a recurrent layer.
    state_sources: Vec<Vec<f32>>,
    state_padded: Vec<Vec<f32>>,
    /// What the gradient of a recurrent layer's weights is summed from.
    cells: Vec<lstm::GradientScratch>,
    shared: [Vec<f32>; 3],
}

/// Mean and inverse deviation of each channel, and the two sums of the backward pass.
#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) struct Statistics {
    pub(crate) mean: Vec<f32>,
    pub(crate) inverse_deviation: Vec<f32>,
    pub(crate) gradient_sum: Vec<f32>,
    pub(crate) gradient_product: Vec<f32>,
    /// Values that each sum ran over.
    pub(crate) count: f32,
}

/// What a forward pass is for.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Mode<'a> {
    Inference,
    Training {
        /// Seed and step of the dropout masks, and the index of the first image.
        seed: u64,
        step: u64,
        first_image: usize,
        statistics: &'a [Statistics],
    },
}

/// Carried state and its gradient, one buffer a layer.
#[derive(Debug, Clone, Default)]
pub(crate) struct State {
    pub(crate) values: Vec<Vec<f32>>,
    pub(crate) gradients: Vec<Vec<f32>>,
}

impl State {
    /// Every sequence begins anew.
    pub(crate) fn forget(&mut self) {
        for values in &mut self.values {
            values.fill(0.0);
        }
    }
}

impl Engine {
    pub(crate) fn new(network: &Network, chunk: usize, is_for_training: bool) -> Self {
        let count = network.layers().len();
        let mut needs = vec![false; count + 1];
        for (index, layer) in network.layers().iter().enumerate() {
            needs[index + 1] = is_for_training
                && (layer.trainable_count() > 0 || layer.from.iter().any(|node| needs[*node]));
        }
        let mut flows: Vec<Vec<Flow>> = vec![Vec::new(); count];
        let mut is_written = vec![false; count + 1];
        for (index, layer) in network.layers().iter().enumerate().rev() {
            for node in &layer.from {
                flows[index].push(match (needs[*node], is_written[*node]) {
                    (false, _) => Flow::Stop,
                    (true, false) => Flow::Set,
                    (true, true) => Flow::Add,
                });
                is_written[*node] = true;
            }
        }
        let mut gradient_len = 0;
        let layers = network
            .layers()
            .iter()
            .zip(flows)
            .enumerate()
            .map(|(index, (layer, flows))| {
                let gradient_ranges = layer
                    .tensors
                    .iter()
                    .map(|tensor| {
                        (is_for_training && tensor.is_trainable).then(|| {
                            let start = gradient_len;
                            gradient_len += tensor.len();
                            start..gradient_len
                        })
                    })
                    .collect();
                Planned {
                    operation: plan::plan(layer, chunk, needs[index + 1], flows[0] != Flow::Stop),
                    layer: layer.clone(),
                    flows,
                    needs_gradient: needs[index + 1],
                    gradient_ranges,
                }
            })
            .collect();
        Self {
            network: network.clone(),
            layers,
            chunk,
            gradient_len,
            node_needs_gradient: needs,
        }
    }

    fn node_len(&self, node: usize) -> usize {
        match node.checked_sub(1) {
            None => self.network.input().len(),
            Some(layer) => self.layers[layer].layer.output.len(),
        }
    }
}
