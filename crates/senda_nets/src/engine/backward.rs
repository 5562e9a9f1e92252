//! Backward through one layer.

use super::{Engine, Flow, Frame, Operation, Packed, Scratch, State, Statistics};
use crate::convolution;
use crate::lstm;
use crate::math;
use crate::window;

impl Engine {
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
