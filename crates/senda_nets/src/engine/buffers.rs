//! Memory of frames, states and scratch, and weights packed for the kernels.

use super::{Engine, Flow, Frame, Operation, Packed, Planned, Scratch, State};
use crate::convolution::buffer;
use crate::lstm;

impl Engine {
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
                Operation::Depthwise(window) => window.scratch_len(),
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
}
