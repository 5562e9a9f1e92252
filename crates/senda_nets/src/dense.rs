//! Dense layers forward and backward, through the same kernel as convolutions.

use crate::kernel::{Level, Position, Product};
use crate::math;

/// Everything about a dense layer that does not depend on weights or inputs.
#[derive(Debug, Clone)]
pub(crate) struct Plan {
    level: Level,
    inputs: usize,
    units: usize,
    /// Rows of the transposed weights.
    forward_offsets: Vec<u32>,
    /// Rows of the weights.
    backward_offsets: Vec<u32>,
    unit_positions: Vec<Position>,
    input_positions: Vec<Position>,
}

impl Plan {
    pub(crate) fn new(inputs: usize, units: usize) -> Self {
        let level = Level::detect();
        let multiples = |count: usize, step: usize| (0..count).map(|k| (k * step) as u32).collect();
        Self {
            level,
            inputs,
            units,
            forward_offsets: multiples(inputs, units),
            backward_offsets: multiples(units, inputs),
            unit_positions: positions(level, units),
            input_positions: positions(level, inputs),
        }
    }

    pub(crate) fn packed_len(&self) -> usize {
        self.inputs * self.units
    }

    /// Values of scratch for `count` inputs: the larger vector of each, transposed.
    pub(crate) fn scratch_len(&self, count: usize) -> usize {
        count * self.inputs.max(self.units)
    }

    /// Weights `[units][inputs]` into `[inputs][units]`.
    pub(crate) fn pack(&self, weights: &[f32], packed: &mut [f32]) {
        transpose(weights, self.units, self.inputs, packed);
    }

    /// Forward for `count` vectors at once.
    pub(crate) fn forward(
        &self,
        packed: &[f32],
        bias: &[f32],
        input: &[f32],
        count: usize,
        scratch: &mut [f32],
        output: &mut [f32],
    ) {
        let left = transposed(input, count, self.inputs, scratch);
        Product {
            level: self.level,
            left,
            left_step: count,
            rows: count,
            start: &[],
            source: packed,
            offsets: &self.forward_offsets,
            largest_offset: (self.inputs - 1) * self.units,
            positions: &self.unit_positions,
            output_pitch: self.units,
        }
        .run(output);
        if !bias.is_empty() {
            for row in output[..count * self.units].chunks_exact_mut(self.units) {
                math::add(bias, row);
            }
        }
    }

    /// Gradient of the weights from the gradient of the output.
    pub(crate) fn weight_gradient(
        &self,
        gradient: &[f32],
        input: &[f32],
        count: usize,
        offsets: &[u32],
        result: &mut [f32],
    ) {
        Product {
            level: self.level,
            left: gradient,
            left_step: self.units,
            rows: self.units,
            start: &[],
            source: input,
            offsets: &offsets[..count],
            largest_offset: (count - 1) * self.inputs,
            positions: &self.input_positions,
            output_pitch: self.inputs,
        }
        .run(result);
    }

    /// Gradient of the input from the gradient of the output; `weights` has room for wide loads behind it.
    pub(crate) fn input_gradient(
        &self,
        weights: &[f32],
        gradient: &[f32],
        count: usize,
        scratch: &mut [f32],
        result: &mut [f32],
    ) {
        let left = transposed(gradient, count, self.units, scratch);
        Product {
            level: self.level,
            left,
            left_step: count,
            rows: count,
            start: &[],
            source: weights,
            offsets: &self.backward_offsets,
            largest_offset: (self.units - 1) * self.inputs,
            positions: &self.input_positions,
            output_pitch: self.inputs,
        }
        .run(result);
    }

    /// Where each of `count` inputs begins; for [`Plan::weight_gradient`].
    pub(crate) fn image_offsets(&self, count: usize) -> Vec<u32> {
        (0..count).map(|image| (image * self.inputs) as u32).collect()
    }
}

fn transposed<'a>(values: &'a [f32], rows: usize, columns: usize, scratch: &'a mut [f32]) -> &'a [f32] {
    if rows == 1 {
        values
    } else {
        transpose(values, rows, columns, scratch);
        scratch
    }
}

fn transpose(values: &[f32], rows: usize, columns: usize, result: &mut [f32]) {
    // Blocks keep both sides in the nearest cache.
    const BLOCK: usize = 16;
    for row in (0..rows).step_by(BLOCK) {
        for column in (0..columns).step_by(BLOCK) {
            for c in column..(column + BLOCK).min(columns) {
                for r in row..(row + BLOCK).min(rows) {
                    result[c * rows + r] = values[r * columns + c];
                }
            }
        }
    }
}

fn positions(level: Level, width: usize) -> Vec<Position> {
    let lanes = level.lanes();
    (0..width)
        .step_by(lanes)
        .map(|x| Position {
            source: x as u32,
            output: x as u32,
            len: lanes.min(width - x) as u32,
        })
        .collect()
}
