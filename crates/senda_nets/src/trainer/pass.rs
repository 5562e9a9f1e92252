//! One group of a batch, forward and backward.

use super::{Batch, Group, Judge, TrainOptions};
use crate::engine::{Engine, Frame, Mode, Packed, Scratch, Statistics};

/// Everything that a task reads while it computes the gradient of one group.
pub(super) struct Pass<'a> {
    pub(super) engine: &'a Engine,
    pub(super) packed: &'a Packed,
    pub(super) weights: &'a [f32],
    pub(super) statistics: &'a [Statistics],
    pub(super) options: &'a TrainOptions,
    pub(super) step: u64,
    pub(super) batch: Batch<'a>,
    pub(super) index: usize,
}

impl Pass<'_> {
    fn first(&self) -> usize {
        self.index * self.engine.chunk
    }

    pub(super) fn count(&self) -> usize {
        self.engine.chunk.min(self.batch.sequences - self.first())
    }

    pub(super) fn run(&self, frames: &mut [Frame], group: &mut Group, scratch: &mut Scratch) {
        for (step, frame) in frames.iter_mut().enumerate().take(self.batch.steps) {
            self.load(frame, step);
            for layer in 0..self.engine.layers.len() {
                self.forward(layer, frame, group, scratch, step);
            }
        }
        for gradients in &mut group.state.gradients {
            gradients.fill(0.0);
        }
        group.loss = 0.0;
        for (step, frame) in frames.iter_mut().enumerate().take(self.batch.steps).rev() {
            group.loss += self.loss(frame, step);
            for layer in (0..self.engine.layers.len()).rev() {
                if self.engine.layers[layer].needs_gradient {
                    self.engine.differentiate(layer, frame, self.count());
                    let is_first = step + 1 == self.batch.steps;
                    self.backward(layer, frame, group, scratch, is_first);
                }
            }
        }
    }

    pub(super) fn load(&self, frame: &mut Frame, step: usize) {
        let len = self.engine.network.input().len();
        let place = (step * self.batch.sequences + self.first()) * len;
        let values = self.count() * len;
        frame.values[0][..values].copy_from_slice(&self.batch.inputs[place..place + values]);
    }

    pub(super) fn forward(
        &self,
        layer: usize,
        frame: &mut Frame,
        group: &mut Group,
        scratch: &mut Scratch,
        step: usize,
    ) {
        let mode = Mode::Training {
            seed: self.options.seed,
            step: self.step,
            first_image: step * self.batch.sequences + self.first(),
            statistics: self.statistics,
        };
        self.engine.forward(
            layer,
            mode,
            self.weights,
            self.packed,
            frame,
            &mut group.state,
            scratch,
            self.count(),
        );
    }

    pub(super) fn backward(
        &self,
        layer: usize,
        frame: &mut Frame,
        group: &mut Group,
        scratch: &mut Scratch,
        is_first: bool,
    ) {
        self.engine.backward(
            layer,
            self.statistics,
            self.weights,
            self.packed,
            frame,
            &mut group.state,
            scratch,
            &mut group.gradient,
            is_first,
            self.count(),
        );
    }

    /// This group's part of the loss; its gradient goes to the last layer's output.
    pub(super) fn loss(&self, frame: &mut Frame, step: usize) -> f64 {
        let outputs = self.engine.network.output_len();
        let node = self.engine.layers.len();
        if let Some(judge) = self.batch.judge {
            return self.judged(frame, judge);
        }
        let total = (self.batch.steps * self.batch.sequences * outputs) as f32;
        let mut sum = 0.0;
        for image in 0..self.count() {
            let sample = step * self.batch.sequences + self.first() + image;
            let sample_weight = self.batch.sample_weights.map_or(1.0, |weights| weights[sample]);
            for output in 0..outputs {
                let place = image * outputs + output;
                let weights = &self.options.output_weights;
                let weight = sample_weight * weights.get(output).copied().unwrap_or(1.0) / total;
                let error = frame.values[node][place] - self.batch.targets[sample * outputs + output];
                let (loss, slope) = self.options.loss.of(error);
                sum += f64::from(weight) * f64::from(loss);
                if let Some(gradient) = frame.gradients[node].get_mut(place) {
                    *gradient = weight * slope;
                }
            }
        }
        sum
    }

    fn judged(&self, frame: &mut Frame, judge: &Judge) -> f64 {
        let outputs = self.engine.network.output_len();
        let node = self.engine.layers.len();
        let share = 1.0 / self.batch.sequences as f32;
        let mut sum = 0.0;
        for image in 0..self.count() {
            let range = image * outputs..(image + 1) * outputs;
            let gradient = &mut frame.gradients[node][range.clone()];
            sum += judge(self.first() + image, &frame.values[node][range], gradient) * f64::from(share);
            for slope in gradient {
                *slope *= share;
            }
        }
        sum
    }
}
