//! Forward through one layer.

use super::{Engine, Frame, Mode, Operation, Packed, Scratch, State};
use crate::convolution;
use crate::lstm;
use crate::math;
use crate::window;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

impl Engine {
    /// Runs all layers, without dropout and by running statistics, for the first `count` inputs of a frame.
    pub(crate) fn infer(
        &self,
        weights: &[f32],
        packed: &Packed,
        frame: &mut Frame,
        state: &mut State,
        scratch: &mut Scratch,
        count: usize,
    ) {
        for index in 0..self.layers.len() {
            self.forward(
                index,
                Mode::Inference,
                weights,
                packed,
                frame,
                state,
                scratch,
                count,
            );
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
