//! How a layer is computed.

use super::Operation;
use crate::convolution;
use crate::dense;
use crate::lstm;
use crate::network::{Kind, Layer};
use crate::window::Window;

pub(super) fn plan(
    layer: &Layer,
    chunk: usize,
    needs_gradient: bool,
    needs_input_gradient: bool,
) -> Operation {
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
