//! The convolutional LSTM cell (Shi et al. 2015, equation 3 without peepholes; gates as Keras orders them).

use crate::convolution::{self, buffer};
use crate::kernel::{Level, Position, Product};
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
    gradient: Option<WeightPlan>,
}

/// How the gradient of both kernels is computed: as one product of the gates' gradients and of what each gate saw, over the places
/// of a few images. A state is a small picture with many taps, and summing it tap by tap ([`crate::kernel::Correlation`]) spends
/// most of its time on the ends of short sums.
#[derive(Debug, Clone)]
struct WeightPlan {
    level: Level,
    /// Images whose places are summed in one chain.
    images: usize,
    /// Where each place's row of taps begins.
    offsets: Vec<u32>,
    positions: Vec<Position>,
    taps: [usize; 2],
}

/// Places summed in one chain, at least: enough that the ends of sums do not count, few enough to stay in the cache (measured).
const CHAIN: usize = 128;

/// Memory for [`WeightPlan`]: taps and gates by place, and the sum.
#[derive(Debug, Clone, Default)]
pub(crate) struct GradientScratch {
    taps: Vec<f32>,
    gates: Vec<f32>,
    sum: Vec<f32>,
    /// Images collected.
    images: usize,
}

impl WeightPlan {
    fn new(input: &convolution::Plan, state: &convolution::Plan, chunk: usize) -> Self {
        let taps = [input.depth(), state.depth()];
        let all = taps[0] + taps[1];
        let plane = input.output.plane();
        let images = CHAIN.div_ceil(plane).clamp(1, chunk);
        let level = convolution::best_level(all);
        Self {
            level,
            images,
            offsets: (0..images * plane).map(|place| (place * all) as u32).collect(),
            positions: convolution::positions(level, [1, all], |_| 0, all),
            taps,
        }
    }

    /// Adds the sum over the collected images to the gradient, or puts it there.
    fn finish(
        &self,
        gates: usize,
        plane: usize,
        scratch: &mut GradientScratch,
        into: [&mut [f32]; 2],
        accumulate: bool,
    ) {
        let depth = std::mem::take(&mut scratch.images) * plane;
        let all = self.taps[0] + self.taps[1];
        let Some(last) = depth.checked_sub(1) else { return };
        Product {
            level: self.level,
            left: &scratch.gates,
            left_step: gates,
            rows: gates,
            start: &[],
            source: &scratch.taps,
            offsets: &self.offsets[..depth],
            largest_offset: last * all,
            positions: &self.positions,
            output_pitch: all,
        }
        .run(&mut scratch.sum);
        let [weight, recurrent] = into;
        let rows = weight
            .chunks_exact_mut(self.taps[0])
            .zip(recurrent.chunks_exact_mut(self.taps[1]));
        for ((weight, recurrent), sum) in rows.zip(scratch.sum.chunks_exact(all)) {
            let (input, state) = sum.split_at(self.taps[0]);
            math::put(input, weight, accumulate);
            math::put(state, recurrent, accumulate);
        }
    }
}

impl Plan {
    pub(crate) fn new(
        input: Shape,
        output: Shape,
        kernel: [usize; 2],
        stride: [usize; 2],
        padding: Padding,
    ) -> Self {
        let gates = Shape {
            channels: 4 * output.channels,
            ..output
        };
        Self {
            input: convolution::Plan::new(input, gates, kernel, stride, padding),
            state: convolution::Plan::new(output, gates, kernel, [1, 1], Padding::Same).buffered(),
            len: output.len(),
            gradient: None,
        }
    }

    /// Adds what the backward pass needs, for at most `chunk` images at once.
    pub(crate) fn with_backward(self, chunk: usize, needs_input_gradient: bool) -> Self {
        let input = self.input.with_backward(needs_input_gradient);
        let state = self.state.with_backward(true);
        Self {
            gradient: Some(WeightPlan::new(&input, &state, chunk)),
            input,
            state,
            len: self.len,
        }
    }

    /// Memory for the gradient of the weights.
    pub(crate) fn gradient_scratch(&self) -> GradientScratch {
        let Some(plan) = &self.gradient else {
            return GradientScratch::default();
        };
        let gates = self.input.output.channels;
        let all = plan.taps[0] + plan.taps[1];
        GradientScratch {
            taps: buffer(plan.offsets.len() * all),
            gates: buffer(plan.offsets.len() * gates),
            sum: buffer(gates * all),
            images: 0,
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
        cell(
            &gates[..4 * len],
            &mut state[..2 * len],
            &mut kept[2 * len..7 * len],
        );
        output.copy_from_slice(&state[..len]);
    }

    /// The same step backward. `carried` holds the gradients of the state after the step and becomes those before it.
    /// The gradients of the kernels are summed over several images: call this for every image of a moment, in order.
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
        scratch: &mut GradientScratch,
        weights: Option<WeightGradients>,
        result: Option<(&mut [f32], bool)>,
    ) {
        let len = self.len;
        let (before, kept) = kept.split_at(2 * len);
        let gates = &mut gates[..4 * len];
        cell_gradient(
            &before[len..],
            &kept[..5 * len],
            &gradient[..len],
            &mut carried[..2 * len],
            gates,
        );
        let (input_packed, state_packed) = packed.split_at(self.input.packed_backward_len());
        if let (Some(plan), Some(weights)) = (&self.gradient, weights) {
            let (weight, rest) = weights.all.split_at_mut(weights.split);
            let biases = self.input.output.channels;
            let (recurrent, bias) = rest.split_at_mut(rest.len() - biases);
            self.input
                .bias_gradient(gates, bias, weights.image > 0 || !weights.is_first);
            let plane = self.input.output.plane();
            let first = scratch.images * plane;
            let pitch = plan.taps[0] + plan.taps[1];
            let taps = &mut scratch.taps[first * pitch..(first + plane) * pitch];
            let source = if self.input.is_direct() {
                image
            } else {
                self.input.split(image, source);
                source
            };
            self.input.windows(source, taps, pitch);
            self.state.split(&before[..len], state_source);
            self.state.windows(state_source, &mut taps[plan.taps[0]..], pitch);
            for (gate, values) in gates.chunks_exact(plane).enumerate() {
                let to = scratch.gates[first * biases + gate..].iter_mut().step_by(biases);
                for (to, value) in to.zip(values) {
                    *to = *value;
                }
            }
            scratch.images += 1;
            if weights.is_last || scratch.images == plan.images {
                let adds = weights.image >= plan.images || !weights.is_first;
                plan.finish(biases, plane, scratch, [weight, recurrent], adds);
            }
        }
        self.state.spread(gates, state_padded);
        if let Some((result, accumulate)) = result {
            self.input.spread(gates, padded);
            self.input
                .input_gradient(input_packed, padded, shared, result, accumulate);
        }
        self.state
            .input_gradient(state_packed, state_padded, shared, &mut carried[..len], false);
    }
}

/// Where the gradients of a cell's weights go.
pub(crate) struct WeightGradients<'a> {
    /// Kernels of input and state, and biases, one after another.
    pub(crate) all: &'a mut [f32],
    /// Where the state's kernels begin.
    pub(crate) split: usize,
    /// Which image of the moment this is.
    pub(crate) image: usize,
    /// Whether no image of this moment follows.
    pub(crate) is_last: bool,
    /// Whether this moment is the first to write the gradients.
    pub(crate) is_first: bool,
}

math::vectorised! {
    /// One step of all cells: from the gates before their activation and the state (h, then c) to the state after it. Keeps the
    /// activated gates and tanh(c).
    fn cell(gates: &[f32], state: &mut [f32], kept: &mut [f32]) {
        let len = state.len() / 2;
        let (hidden, memory) = state.split_at_mut(len);
        let [input, forget, cell, out] = [0, 1, 2, 3].map(|gate| &gates[gate * len..(gate + 1) * len]);
        let (kept_input, rest) = kept.split_at_mut(len);
        let (kept_forget, rest) = rest.split_at_mut(len);
        let (kept_cell, rest) = rest.split_at_mut(len);
        let (kept_out, rest) = rest.split_at_mut(len);
        let kept_shown = &mut rest[..len];
        for i in 0..len {
            kept_input[i] = math::sigmoid(input[i]);
            kept_forget[i] = math::sigmoid(forget[i]);
            kept_cell[i] = math::tanh(cell[i]);
            kept_out[i] = math::sigmoid(out[i]);
            memory[i] = kept_forget[i] * memory[i] + kept_input[i] * kept_cell[i];
            kept_shown[i] = math::tanh(memory[i]);
            hidden[i] = kept_out[i] * kept_shown[i];
        }
    }
}

math::vectorised! {
    /// Gradients of the gates before their activation. `carried` holds the gradients of h and c after the step; that of c becomes
    /// the one before it.
    fn cell_gradient(memory: &[f32], kept: &[f32], gradient: &[f32], carried: &mut [f32], gates: &mut [f32]) {
        let len = gradient.len();
        let [input, forget, cell, out, shown] = [0, 1, 2, 3, 4].map(|k| &kept[k * len..(k + 1) * len]);
        let memory = &memory[..len];
        let (hidden_carried, memory_carried) = carried.split_at_mut(len);
        let (of_input, rest) = gates.split_at_mut(len);
        let (of_forget, rest) = rest.split_at_mut(len);
        let (of_cell, rest) = rest.split_at_mut(len);
        let of_out = &mut rest[..len];
        for i in 0..len {
            let hidden = gradient[i] + hidden_carried[i];
            let inner = hidden * out[i] * (1.0 - shown[i] * shown[i]) + memory_carried[i];
            of_input[i] = inner * cell[i] * input[i] * (1.0 - input[i]);
            of_forget[i] = inner * memory[i] * forget[i] * (1.0 - forget[i]);
            of_cell[i] = inner * input[i] * (1.0 - cell[i] * cell[i]);
            of_out[i] = hidden * shown[i] * out[i] * (1.0 - out[i]);
            memory_carried[i] = inner * forget[i];
        }
    }
}
