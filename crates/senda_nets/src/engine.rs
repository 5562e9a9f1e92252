//! The executor: runs a list of layers forward and backward over buffers that are made once.

use crate::convolution::{self, buffer};
use crate::dense;
use crate::lstm;
use crate::math;
use crate::network::{Kind, Layer, Network, Tensor};
use crate::window::{self, Window};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
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
                    operation: plan(layer, chunk, needs[index + 1], flows[0] != Flow::Stop),
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

    pub(crate) fn frame(&self) -> Frame {
        let nodes = 0..self.layers.len() + 1;
        Frame {
            values: nodes
                .clone()
                .map(|node| buffer(self.chunk * self.node_len(node)))
                .collect(),
            gradients: nodes
                .map(|node| {
                    if self.node_needs_gradient[node] {
                        buffer(self.chunk * self.node_len(node))
                    } else {
                        Vec::new()
                    }
                })
                .collect(),
            kept: self
                .layers
                .iter()
                .map(|planned| {
                    vec![
                        0.0;
                        self.chunk
                            * match &planned.operation {
                                Operation::Dropout { .. } if planned.needs_gradient =>
                                    planned.layer.output.len(),
                                Operation::Lstm(_) => lstm::KEPT * planned.layer.output.len(),
                                _ => 0,
                            }
                    ]
                })
                .collect(),
        }
    }

    pub(crate) fn state(&self) -> State {
        let values: Vec<Vec<f32>> = self
            .layers
            .iter()
            .map(|planned| match planned.layer.state_len() {
                0 => Vec::new(),
                len => buffer(self.chunk * len),
            })
            .collect();
        State {
            gradients: values.clone(),
            values,
        }
    }

    pub(crate) fn scratch(&self) -> Scratch {
        let per_layer = |len: &dyn Fn(&Planned) -> usize| -> Vec<Vec<f32>> {
            self.layers
                .iter()
                .map(|planned| match len(planned) {
                    0 => Vec::new(),
                    len => buffer(len),
                })
                .collect()
        };
        let shared = self
            .layers
            .iter()
            .map(|planned| match &planned.operation {
                Operation::Convolution(plan) => plan.phase_len(),
                Operation::Dense(plan, _) => plan.scratch_len(self.chunk),
                Operation::Depthwise(window) => window.source_len(),
                Operation::Lstm(plan) => plan.scratch_len(),
                _ => 0,
            })
            .max()
            .unwrap_or(0);
        Scratch {
            sources: per_layer(&|planned| match &planned.operation {
                Operation::Convolution(plan) => plan.source_len(),
                Operation::Depthwise(window) => window.source_len(),
                Operation::Lstm(plan) => plan.input.source_len(),
                _ => 0,
            }),
            padded: per_layer(&|planned| match &planned.operation {
                Operation::Convolution(plan) => plan.gradient_len(),
                Operation::Lstm(plan) => plan.input.gradient_len(),
                _ => 0,
            }),
            state_sources: per_layer(&|planned| match &planned.operation {
                Operation::Lstm(plan) => plan.state.source_len(),
                _ => 0,
            }),
            state_padded: per_layer(&|planned| match &planned.operation {
                Operation::Lstm(plan) => plan.state.gradient_len(),
                _ => 0,
            }),
            cells: self
                .layers
                .iter()
                .map(|planned| match &planned.operation {
                    Operation::Lstm(plan) => plan.gradient_scratch(),
                    _ => lstm::GradientScratch::default(),
                })
                .collect(),
            shared: [buffer(shared), buffer(shared), buffer(shared)],
        }
    }

    /// Room for packed weights.
    pub(crate) fn packed(&self) -> Packed {
        let mut packed = Packed::default();
        for planned in &self.layers {
            let needs_input_gradient = planned.flows[0] != Flow::Stop;
            let (forward, backward) = match &planned.operation {
                Operation::Convolution(plan) => (plan.packed_len(), plan.packed_backward_len()),
                Operation::Dense(plan, _) => (
                    plan.packed_len(),
                    if needs_input_gradient {
                        plan.packed_len()
                    } else {
                        0
                    },
                ),
                Operation::Lstm(plan) => (plan.packed_len(), plan.packed_backward_len()),
                Operation::Normalise { .. } => (2 * planned.layer.output.channels, 0),
                _ => (0, 0),
            };
            packed.forward.push(buffer(forward));
            packed.backward.push(buffer(backward));
        }
        packed
    }

    /// Rearranges the weights of one layer.
    pub(crate) fn pack(&self, index: usize, weights: &[f32], packed: &mut Packed) {
        let planned = &self.layers[index];
        let (forward, backward) = (&mut packed.forward[index], &mut packed.backward[index]);
        let weight = planned.tensor(weights, "weight");
        match &planned.operation {
            Operation::Convolution(plan) => {
                plan.pack(weight, forward);
                plan.pack_backward(weight, backward);
            }
            Operation::Dense(plan, _) => {
                plan.pack(weight, forward);
                if planned.flows[0] != Flow::Stop {
                    backward[..weight.len()].copy_from_slice(weight);
                }
            }
            Operation::Lstm(plan) => {
                let recurrent = planned.tensor(weights, "recurrent_weight");
                plan.pack(weight, recurrent, forward, backward);
            }
            Operation::Normalise { epsilon, .. } => {
                let channels = planned.layer.output.channels;
                let mean = planned.tensor(weights, "running_mean");
                let variance = planned.tensor(weights, "running_var");
                let bias = planned.tensor(weights, "bias");
                for c in 0..channels {
                    let scale = weight[c] / (variance[c] + epsilon).sqrt();
                    forward[c] = scale;
                    forward[channels + c] = bias[c] - mean[c] * scale;
                }
            }
            _ => {}
        }
    }

    /// Runs one layer for the first `count` inputs of a frame.
    #[allow(
        clippy::too_many_arguments,
        reason = "a layer touches all of a thread's memory"
    )]
    pub(crate) fn forward(
        &self,
        index: usize,
        mode: Mode,
        weights: &[f32],
        packed: &Packed,
        frame: &mut Frame,
        state: &mut State,
        scratch: &mut Scratch,
        count: usize,
    ) {
        let planned = &self.layers[index];
        let layer = &planned.layer;
        let mut output = std::mem::take(&mut frame.values[index + 1]);
        let input = &frame.values[layer.from[0]];
        let (in_len, out_len) = (layer.inputs[0].len(), layer.output.len());
        let forward = &packed.forward[index];
        let bias = planned.tensor(weights, "bias");
        let [shared, spare, _] = &mut scratch.shared;
        match &planned.operation {
            Operation::Convolution(plan) => {
                for image in 0..count {
                    let output = &mut output[image * out_len..(image + 1) * out_len];
                    let source = &mut scratch.sources[index];
                    plan.forward(forward, bias, &input[image * in_len..], source, output);
                }
            }
            Operation::Dense(plan, _) => {
                plan.forward(
                    forward,
                    bias,
                    &input[..count * in_len],
                    count,
                    shared,
                    &mut output,
                );
            }
            Operation::Lstm(plan) => {
                for image in 0..count {
                    plan.forward(
                        forward,
                        bias,
                        &input[image * in_len..],
                        &mut state.values[index][image * 2 * out_len..],
                        &mut frame.kept[index][image * lstm::KEPT * out_len..][..lstm::KEPT * out_len],
                        [&mut scratch.sources[index], &mut scratch.state_sources[index]],
                        [shared, spare],
                        &mut output[image * out_len..(image + 1) * out_len],
                    );
                }
            }
            Operation::Normalise { .. } => {
                let plane = layer.output.plane();
                let channels = layer.output.channels;
                let gamma = planned.tensor(weights, "weight");
                for (place, (from, to)) in input[..count * in_len]
                    .chunks_exact(plane)
                    .zip(output.chunks_exact_mut(plane))
                    .enumerate()
                {
                    let c = place % channels;
                    let (factor, term) = match (&planned.operation, mode) {
                        (
                            Operation::Normalise { uses_batch: true, .. },
                            Mode::Training { statistics, .. },
                        ) => {
                            let factor = gamma[c] * statistics[index].inverse_deviation[c];
                            (factor, bias[c] - statistics[index].mean[c] * factor)
                        }
                        _ => (forward[c], forward[channels + c]),
                    };
                    math::scale(factor, term, from, to);
                }
            }
            Operation::Dropout { rate } => {
                let kept = &mut frame.kept[index];
                match mode {
                    Mode::Training {
                        seed,
                        step,
                        first_image,
                        ..
                    } if *rate > 0.0 => {
                        for image in 0..count {
                            let place = image * out_len..(image + 1) * out_len;
                            draw_mask(
                                *rate,
                                [seed, step, index as u64, (first_image + image) as u64],
                                &input[place.clone()],
                                &mut output[place.clone()],
                                kept.get_mut(place),
                            );
                        }
                    }
                    _ => {
                        output[..count * out_len].copy_from_slice(&input[..count * in_len]);
                        kept.fill(1.0);
                    }
                }
            }
            Operation::Copy => output[..count * out_len].copy_from_slice(&input[..count * in_len]),
            Operation::Concatenate => {
                for image in 0..count {
                    let mut at = image * out_len;
                    for (node, shape) in layer.from.iter().zip(&layer.inputs) {
                        let from = &frame.values[*node][image * shape.len()..(image + 1) * shape.len()];
                        output[at..at + from.len()].copy_from_slice(from);
                        at += from.len();
                    }
                }
            }
            Operation::Add => {
                output[..count * out_len].copy_from_slice(&input[..count * in_len]);
                for node in &layer.from[1..] {
                    math::add(
                        &frame.values[*node][..count * in_len],
                        &mut output[..count * out_len],
                    );
                }
            }
            Operation::GlobalAveragePool => {
                let plane = layer.inputs[0].plane();
                for (values, to) in input[..count * in_len].chunks_exact(plane).zip(&mut output) {
                    *to = convolution::sum(values) / plane as f32;
                }
            }
            each => {
                for image in 0..count {
                    let from = &input[image * in_len..(image + 1) * in_len];
                    let to = &mut output[image * out_len..(image + 1) * out_len];
                    match each {
                        Operation::Depthwise(window) => {
                            let weight = planned.tensor(weights, "weight");
                            window.depthwise(weight, bias, from, &mut scratch.sources[index], to);
                        }
                        Operation::MaxPool(window) => window.max(from, to),
                        Operation::AveragePool(window) => window.average(from, to),
                        Operation::Upsample { factor } => {
                            window::upsample(layer.inputs[0], *factor, from, to);
                        }
                        _ => {}
                    }
                }
            }
        }
        math::activate(layer.activation, &mut output[..count * out_len]);
        frame.values[index + 1] = output;
    }

    /// Multiplies the gradient of a layer's output by the derivative of its activation.
    pub(crate) fn differentiate(&self, index: usize, frame: &mut Frame, count: usize) {
        let layer = &self.layers[index].layer;
        let len = count * layer.output.len();
        math::differentiate(
            layer.activation,
            &frame.values[index + 1][..len],
            &mut frame.gradients[index + 1][..len],
        );
    }

    /// The backward pass of one layer, after [`Engine::differentiate`]: adds to (or, with `is_first`, sets) the gradient
    /// of its weights and writes those of its inputs.
    #[allow(
        clippy::too_many_arguments,
        reason = "a layer touches all of a thread's memory"
    )]
    pub(crate) fn backward(
        &self,
        index: usize,
        statistics: &[Statistics],
        weights: &[f32],
        packed: &Packed,
        frame: &mut Frame,
        state: &mut State,
        scratch: &mut Scratch,
        gradient: &mut [f32],
        is_first: bool,
        count: usize,
    ) {
        let planned = &self.layers[index];
        let layer = &planned.layer;
        let range = |tensor: usize| planned.gradient_ranges.get(tensor).cloned().flatten();
        let (in_len, out_len) = (layer.inputs[0].len(), layer.output.len());
        let flow = planned.flows[0];
        let accumulates = flow == Flow::Add;
        let own = std::mem::take(&mut frame.gradients[index + 1]);
        let mut result = std::mem::take(&mut frame.gradients[layer.from[0]]);
        let input = &frame.values[layer.from[0]];
        let backward = &packed.backward[index];
        let [shared, spare, third] = &mut scratch.shared;
        match &planned.operation {
            Operation::Convolution(plan) => {
                for image in 0..count {
                    let own = &own[image * out_len..(image + 1) * out_len];
                    let accumulate = image > 0 || !is_first;
                    if let Some(range) = range(1) {
                        plan.bias_gradient(own, &mut gradient[range], accumulate);
                    }
                    plan.spread(own, &mut scratch.padded[index]);
                    if let Some(range) = range(0) {
                        let image = &input[image * in_len..];
                        let source = if plan.is_direct() {
                            image
                        } else {
                            plan.split(image, &mut scratch.sources[index]);
                            &scratch.sources[index]
                        };
                        plan.weight_gradient(
                            &scratch.padded[index],
                            source,
                            &mut gradient[range],
                            accumulate,
                        );
                    }
                    if flow != Flow::Stop {
                        plan.input_gradient(
                            backward,
                            &scratch.padded[index],
                            shared,
                            &mut result[image * in_len..(image + 1) * in_len],
                            accumulates,
                        );
                    }
                }
            }
            Operation::Dense(plan, offsets) => {
                let own = &own[..count * out_len];
                if let Some(range) = range(1) {
                    let to = &mut gradient[range];
                    for (image, own) in own.chunks_exact(out_len).enumerate() {
                        math::put(own, to, image > 0 || !is_first);
                    }
                }
                if let Some(range) = range(0) {
                    if is_first {
                        plan.weight_gradient(own, input, count, offsets, &mut gradient[range]);
                    } else {
                        let len = range.len();
                        if third.len() < len {
                            third.resize(len, 0.0);
                        }
                        plan.weight_gradient(own, input, count, offsets, third);
                        math::add(&third[..len], &mut gradient[range]);
                    }
                }
                if flow != Flow::Stop {
                    if accumulates {
                        plan.input_gradient(backward, own, count, shared, spare);
                        math::add(&spare[..count * in_len], &mut result[..count * in_len]);
                    } else {
                        plan.input_gradient(backward, own, count, shared, &mut result);
                    }
                }
            }
            Operation::Lstm(plan) => {
                for image in 0..count {
                    let [weight, recurrent, bias] = [range(0), range(1), range(2)];
                    let first = weight.as_ref().map_or(0, |range| range.start);
                    let all = weight.is_some().then(|| {
                        let end = bias.as_ref().map_or(first, |range| range.end);
                        &mut gradient[first..end]
                    });
                    let split = recurrent.map_or(0, |range| range.start - first);
                    plan.backward(
                        backward,
                        &input[image * in_len..],
                        &frame.kept[index][image * lstm::KEPT * out_len..][..lstm::KEPT * out_len],
                        &own[image * out_len..(image + 1) * out_len],
                        &mut state.gradients[index][image * 2 * out_len..(image + 1) * 2 * out_len],
                        [
                            &mut scratch.sources[index],
                            &mut scratch.padded[index],
                            &mut scratch.state_sources[index],
                            &mut scratch.state_padded[index],
                        ],
                        [shared, spare],
                        &mut scratch.cells[index],
                        all.map(|all| lstm::WeightGradients {
                            all,
                            split,
                            image,
                            is_last: image + 1 == count,
                            is_first,
                        }),
                        (flow != Flow::Stop)
                            .then(|| (&mut result[image * in_len..(image + 1) * in_len], accumulates)),
                    );
                }
            }
            Operation::Depthwise(window) => {
                let mut gradients = range(0).map(|range| &mut gradient[range]);
                if let (true, Some(gradients)) = (is_first, &mut gradients) {
                    gradients.fill(0.0);
                }
                if flow == Flow::Set {
                    result[..count * in_len].fill(0.0);
                }
                for image in 0..count {
                    window.depthwise_gradient(
                        planned.tensor(weights, "weight"),
                        &input[image * in_len..(image + 1) * in_len],
                        &own[image * out_len..(image + 1) * out_len],
                        [&mut scratch.sources[index], shared],
                        gradients.as_deref_mut(),
                        (flow != Flow::Stop).then(|| &mut result[image * in_len..(image + 1) * in_len]),
                    );
                }
                if let Some(range) = range(1) {
                    let plane = layer.output.plane();
                    let channels = layer.output.channels;
                    let to = &mut gradient[range];
                    if is_first {
                        to.fill(0.0);
                    }
                    for (place, own) in own[..count * out_len].chunks_exact(plane).enumerate() {
                        to[place % channels] += convolution::sum(own);
                    }
                }
            }
            Operation::Normalise { uses_batch, .. } if flow != Flow::Stop => {
                let plane = layer.output.plane();
                let channels = layer.output.channels;
                let gamma = planned.tensor(weights, "weight");
                let places = own[..count * out_len].chunks_exact(plane);
                for (place, (own, to)) in places.zip(result.chunks_exact_mut(plane)).enumerate() {
                    let c = place % channels;
                    let (factor, slope, term) = if *uses_batch {
                        // dx = γ/σ · (dy - mean(dy) - x̂ · mean(dy · x̂)), as a line in dy and x.
                        let statistics = &statistics[index];
                        let factor = gamma[c] * statistics.inverse_deviation[c];
                        let product = statistics.gradient_product[c] / statistics.count;
                        let slope = -factor * product * statistics.inverse_deviation[c];
                        let mean = statistics.gradient_sum[c] / statistics.count;
                        (factor, slope, -factor * mean - slope * statistics.mean[c])
                    } else {
                        (packed.forward[index][c], 0.0, 0.0)
                    };
                    let input = &input[place * plane..(place + 1) * plane];
                    for ((to, own), x) in to.iter_mut().zip(own).zip(input) {
                        let value = own * factor + x * slope + term;
                        *to = if accumulates { *to + value } else { value };
                    }
                }
            }
            Operation::Normalise { .. } => {}
            Operation::Dropout { .. } if flow != Flow::Stop => {
                let kept = &frame.kept[index];
                for ((to, own), kept) in result.iter_mut().zip(&own).zip(kept).take(count * out_len) {
                    let value = own * kept;
                    *to = if accumulates { *to + value } else { value };
                }
            }
            Operation::Dropout { .. } => {}
            Operation::Copy if flow != Flow::Stop => {
                math::put(
                    &own[..count * out_len],
                    &mut result[..count * in_len],
                    accumulates,
                );
            }
            Operation::Copy => {}
            Operation::Add => {
                if flow != Flow::Stop {
                    math::put(
                        &own[..count * out_len],
                        &mut result[..count * in_len],
                        accumulates,
                    );
                }
                frame.gradients[layer.from[0]] = std::mem::take(&mut result);
                for (node, flow) in layer.from.iter().zip(&planned.flows).skip(1) {
                    if *flow != Flow::Stop {
                        let to = &mut frame.gradients[*node][..count * in_len];
                        math::put(&own[..count * out_len], to, *flow == Flow::Add);
                    }
                }
                result = std::mem::take(&mut frame.gradients[layer.from[0]]);
            }
            Operation::Concatenate => {
                frame.gradients[layer.from[0]] = std::mem::take(&mut result);
                let mut at = 0;
                for ((node, shape), flow) in layer.from.iter().zip(&layer.inputs).zip(&planned.flows) {
                    if *flow != Flow::Stop {
                        for image in 0..count {
                            let from = &own[image * out_len + at..][..shape.len()];
                            let to = &mut frame.gradients[*node][image * shape.len()..][..shape.len()];
                            math::put(from, to, *flow == Flow::Add);
                        }
                    }
                    at += shape.len();
                }
                result = std::mem::take(&mut frame.gradients[layer.from[0]]);
            }
            Operation::GlobalAveragePool if flow != Flow::Stop => {
                let plane = layer.inputs[0].plane();
                for (own, to) in own[..count * out_len].iter().zip(result.chunks_exact_mut(plane)) {
                    let share = own / plane as f32;
                    for to in to {
                        *to = if accumulates { *to + share } else { share };
                    }
                }
            }
            each if flow != Flow::Stop => {
                if !accumulates {
                    result[..count * in_len].fill(0.0);
                }
                for image in 0..count {
                    let from = &own[image * out_len..(image + 1) * out_len];
                    let to = &mut result[image * in_len..(image + 1) * in_len];
                    match each {
                        Operation::MaxPool(window) => {
                            window.max_gradient(&input[image * in_len..], from, to);
                        }
                        Operation::AveragePool(window) => window.average_gradient(from, to),
                        Operation::Upsample { factor } => {
                            window::upsample_gradient(layer.inputs[0], *factor, from, to);
                        }
                        _ => {}
                    }
                }
            }
            _ => {}
        }
        frame.gradients[layer.from[0]] = result;
        frame.gradients[index + 1] = own;
    }
}

/// Zeroes some values and scales up the others. The mask depends on nothing but the four numbers.
fn draw_mask(rate: f32, place: [u64; 4], from: &[f32], to: &mut [f32], mut kept: Option<&mut [f32]>) {
    let mut seed = [0u8; 32];
    for (bytes, number) in seed.chunks_exact_mut(8).zip(place) {
        bytes.copy_from_slice(&number.to_le_bytes());
    }
    let mut random = ChaCha8Rng::from_seed(seed);
    let scale = 1.0 / (1.0 - rate);
    // Comparing whole numbers keeps the same masks on every machine.
    let threshold = (f64::from(rate) * 4_294_967_296.0) as u32;
    for (i, (from, to)) in from.iter().zip(to).enumerate() {
        let factor = if random.random::<u32>() < threshold {
            0.0
        } else {
            scale
        };
        *to = from * factor;
        if let Some(kept) = &mut kept {
            kept[i] = factor;
        }
    }
}

fn plan(layer: &Layer, chunk: usize, needs_gradient: bool, needs_input_gradient: bool) -> Operation {
    let (input, output) = (layer.inputs[0], layer.output);
    let has_gradient = |plan: convolution::Plan| {
        if needs_gradient {
            plan.with_backward(needs_input_gradient)
        } else {
            plan
        }
    };
    match layer.kind {
        Kind::Convolution {
            kernel,
            stride,
            padding,
            ..
        } => Operation::Convolution(has_gradient(convolution::Plan::new(
            input, output, kernel, stride, padding,
        ))),
        Kind::DepthwiseConvolution {
            kernel,
            stride,
            padding,
            ..
        } => Operation::Depthwise(Window::new(input, output, kernel, stride, padding)),
        Kind::MaxPool {
            size,
            stride,
            padding,
        } => Operation::MaxPool(Window::new(input, output, size, stride, padding)),
        Kind::AveragePool {
            size,
            stride,
            padding,
        } => Operation::AveragePool(Window::new(input, output, size, stride, padding)),
        Kind::GlobalAveragePool => Operation::GlobalAveragePool,
        Kind::Dense { units, .. } => {
            let plan = dense::Plan::new(input.len(), units);
            let offsets = plan.image_offsets(chunk);
            Operation::Dense(plan, offsets)
        }
        Kind::Flatten | Kind::Activation => Operation::Copy,
        Kind::BatchNorm { epsilon, .. } => Operation::Normalise {
            epsilon,
            uses_batch: needs_gradient && layer.is_trainable,
        },
        Kind::Dropout { rate } => Operation::Dropout { rate },
        Kind::Upsample { factor } => Operation::Upsample { factor },
        Kind::Concatenate => Operation::Concatenate,
        Kind::Add => Operation::Add,
        Kind::ConvolutionalLstm {
            kernel,
            stride,
            padding,
            ..
        } => {
            let plan = lstm::Plan::new(input, output, kernel, stride, padding);
            Operation::Lstm(match needs_gradient {
                true => plan.with_backward(chunk, needs_input_gradient),
                false => plan,
            })
        }
    }
}
