//! The convolutional LSTM cell (Shi et al. 2015, equation 3 without peepholes; gates as Keras orders them).

use crate::convolution;
use crate::math;
use crate::network::{Padding, Shape};

/// Values kept for the backward pass, in units of the output's length: h and c before, i, f, g, o, tanh(c).
pub(crate) const KEPT: usize = 7;

/// The two convolutions of a cell.
#[derive(Debug, Clone)]
pub(crate) struct Plan {
    pub(crate) input: convolution::Plan,
    pub(crate) state: convolution::Plan,
    len: usize,
}

impl Plan {
    pub(crate) fn new(
        input: Shape,
        output: Shape,
        kernel: [usize; 2],
        stride: [usize; 2],
        padding: Padding,
        needs_gradient: bool,
        needs_input_gradient: bool,
    ) -> Self {
        let gates = Shape {
            channels: 4 * output.channels,
            ..output
        };
        let mut plans = [
            convolution::Plan::new(input, gates, kernel, stride, padding),
            convolution::Plan::new(output, gates, kernel, [1, 1], Padding::Same).buffered(),
        ];
        if needs_gradient {
            let [input, state] = plans;
            plans = [
                input.with_backward(needs_input_gradient),
                state.with_backward(true),
            ];
        }
        let [input, state] = plans;
        Self {
            input,
            state,
            len: output.len(),
        }
    }

    pub(crate) fn packed_len(&self) -> usize {
        self.input.packed_len() + self.state.packed_len()
    }

    pub(crate) fn packed_backward_len(&self) -> usize {
        self.input.packed_backward_len() + self.state.packed_backward_len()
    }

    pub(crate) fn scratch_len(&self) -> usize {
        let phases = self.input.phase_len().max(self.state.phase_len());
        (4 * self.len).max(phases)
    }

    pub(crate) fn pack(&self, weight: &[f32], recurrent: &[f32], forward: &mut [f32], backward: &mut [f32]) {
        let (input, state) = forward.split_at_mut(self.input.packed_len());
        self.input.pack(weight, input);
        self.state.pack(recurrent, state);
        let (input, state) = backward.split_at_mut(self.input.packed_backward_len());
        self.input.pack_backward(weight, input);
        self.state.pack_backward(recurrent, state);
    }

    /// One step for one sequence; `state` is h then c, and becomes the new one.
    #[allow(
        clippy::too_many_arguments,
        reason = "a cell touches all of a thread's memory"
    )]
    pub(crate) fn forward(
        &self,
        packed: &[f32],
        bias: &[f32],
        image: &[f32],
        state: &mut [f32],
        kept: &mut [f32],
        [source, state_source]: [&mut [f32]; 2],
        [gates, from_state]: [&mut [f32]; 2],
        output: &mut [f32],
    ) {
        let len = self.len;
        let (input_packed, state_packed) = packed.split_at(self.input.packed_len());
        self.input.forward(input_packed, bias, image, source, gates);
        self.state
            .forward(state_packed, &[], state, state_source, from_state);
        math::add(&from_state[..4 * len], &mut gates[..4 * len]);
        kept[..2 * len].copy_from_slice(&state[..2 * len]);
        for i in 0..len {
            let input = math::sigmoid(gates[i]);
            let forget = math::sigmoid(gates[len + i]);
            let cell = math::tanh(gates[2 * len + i]);
            let out = math::sigmoid(gates[3 * len + i]);
            let memory = forget * state[len + i] + input * cell;
            let shown = math::tanh(memory);
            for (k, value) in [input, forget, cell, out, shown].into_iter().enumerate() {
                kept[(2 + k) * len + i] = value;
            }
            state[len + i] = memory;
            state[i] = out * shown;
        }
        output.copy_from_slice(&state[..len]);
    }

    /// The same step backward. `carried` holds the gradients of the state after the step and becomes those before it.
    /// `weights` are the gradients of all three tensors, where the second begins, and whether to add.
    #[allow(
        clippy::too_many_arguments,
        reason = "a cell touches all of a thread's memory"
    )]
    pub(crate) fn backward(
        &self,
        packed: &[f32],
        image: &[f32],
        kept: &[f32],
        gradient: &[f32],
        carried: &mut [f32],
        [source, padded, state_source, state_padded]: [&mut [f32]; 4],
        [gates, shared]: [&mut [f32]; 2],
        weights: Option<(&mut [f32], usize, bool)>,
        result: Option<(&mut [f32], bool)>,
    ) {
        let len = self.len;
        let (before, kept) = kept.split_at(2 * len);
        for i in 0..len {
            let [input, forget, cell, out, shown] = [0, 1, 2, 3, 4].map(|k| kept[k * len + i]);
            let hidden = gradient[i] + carried[i];
            let memory = hidden * out * (1.0 - shown * shown) + carried[len + i];
            gates[i] = memory * cell * input * (1.0 - input);
            gates[len + i] = memory * before[len + i] * forget * (1.0 - forget);
            gates[2 * len + i] = memory * input * (1.0 - cell * cell);
            gates[3 * len + i] = hidden * shown * out * (1.0 - out);
            carried[len + i] = memory * forget;
        }
        let gates = &gates[..4 * len];
        let (input_packed, state_packed) = packed.split_at(self.input.packed_backward_len());
        self.input.spread(gates, padded);
        self.state.spread(gates, state_padded);
        if let Some((weights, split, accumulate)) = weights {
            let (weight, rest) = weights.split_at_mut(split);
            let biases = self.input.output.channels;
            let (recurrent, bias) = rest.split_at_mut(rest.len() - biases);
            self.input.bias_gradient(gates, bias, accumulate);
            let source = if self.input.is_direct() {
                image
            } else {
                self.input.split(image, source);
                source
            };
            self.input.weight_gradient(padded, source, weight, accumulate);
            self.state.split(&before[..len], state_source);
            self.state
                .weight_gradient(state_padded, state_source, recurrent, accumulate);
        }
        if let Some((result, accumulate)) = result {
            self.input
                .input_gradient(input_packed, padded, shared, result, accumulate);
        }
        self.state
            .input_gradient(state_packed, state_padded, shared, &mut carried[..len], false);
    }
}
