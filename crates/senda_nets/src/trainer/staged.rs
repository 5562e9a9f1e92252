//! Gradients where batch norms need statistics of the whole batch: at each of them everyone waits for everyone.

use super::pass::Pass;
use super::{Batch, Group, Trainer, lock};
use crate::engine::{Frame, Scratch};
use crate::network::Kind;
use std::ops::Range;

impl Trainer {
    /// The same with statistics of the whole batch at every batch norm.
    pub(super) fn staged_gradients(&mut self, batch: Batch) {
        let groups = batch.groups(self.engine.chunk);
        let last = self.stages.len() - 1;
        for stage in 0..=last {
            if stage > 0 {
                self.measure(self.stages[stage], batch);
            }
            self.each_group(
                batch,
                |pass, frame, group, scratch, range| {
                    if range.start == 0 {
                        pass.load(frame, 0);
                    }
                    for layer in range {
                        pass.forward(layer, frame, group, scratch, 0);
                    }
                },
                stage,
            );
        }
        for stage in (0..=last).rev() {
            self.each_group(
                batch,
                |pass, frame, group, scratch, range| {
                    let end = pass.engine.layers.len();
                    if range.end == end {
                        group.loss = pass.loss(frame, 0);
                    } else {
                        pass.backward(range.end, frame, group, scratch, true);
                    }
                    for layer in range.rev() {
                        if !pass.engine.layers[layer].needs_gradient {
                            continue;
                        }
                        pass.engine.differentiate(layer, frame, pass.count());
                        let is_batch_norm = !pass.statistics[layer].mean.is_empty();
                        if is_batch_norm {
                            pass.sum_gradients(layer, frame, group);
                        } else {
                            pass.backward(layer, frame, group, scratch, true);
                        }
                    }
                },
                stage,
            );
            if stage > 0 {
                self.combine_gradients(self.stages[stage], groups);
            }
        }
    }

    fn each_group(
        &mut self,
        batch: Batch,
        work: impl Fn(&Pass, &mut Frame, &mut Group, &mut Scratch, Range<usize>) + Sync,
        stage: usize,
    ) {
        let end = self
            .stages
            .get(stage + 1)
            .copied()
            .unwrap_or(self.engine.layers.len());
        let range = self.stages[stage]..end;
        self.each_pass(batch, |pass, worker, group| {
            let mut frames = std::mem::take(&mut group.frames);
            work(pass, &mut frames[0], group, &mut worker.scratch, range.clone());
            group.frames = frames;
        });
    }

    /// Mean and deviation of a batch norm's input over the whole batch, and the running statistics.
    fn measure(&mut self, index: usize, batch: Batch) {
        let engine = &self.engine;
        let planned = &engine.layers[index];
        let shape = planned.layer.output;
        let groups = batch.groups(engine.chunk);
        let count = (batch.sequences * shape.plane()) as f64;
        let statistics = &mut self.statistics[index];
        let node = planned.layer.from[0];
        // Two passes: the mean first, then squares of what is left, which loses no digits.
        for is_square in [false, true] {
            let totals = &mut self.totals;
            totals.clear();
            totals.resize(shape.channels, 0.0);
            for (number, group) in self.groups[..groups].iter().enumerate() {
                let group = &mut *lock(group);
                let images = engine.chunk.min(batch.sequences - number * engine.chunk);
                let values = &group.frames[0].values[node][..images * shape.len()];
                for (place, plane) in values.chunks_exact(shape.plane()).enumerate() {
                    let c = place % shape.channels;
                    let mean = f64::from(statistics.mean[c]);
                    totals[c] += if is_square {
                        sum_of(plane, |x| (f64::from(x) - mean) * (f64::from(x) - mean))
                    } else {
                        sum_of(plane, f64::from)
                    };
                }
            }
            for (c, total) in totals.iter().enumerate() {
                if !is_square {
                    statistics.mean[c] = (total / count) as f32;
                    continue;
                }
                let variance = (total / count) as f32;
                let Kind::BatchNorm { epsilon, momentum } = planned.layer.kind else {
                    continue;
                };
                statistics.inverse_deviation[c] = 1.0 / (variance + epsilon).sqrt();
                statistics.count = count as f32;
                let [.., mean_tensor, variance_tensor] = &planned.layer.tensors[..] else {
                    continue;
                };
                let values = &mut self.weights.values;
                for (place, new) in [
                    (mean_tensor.offset + c, statistics.mean[c]),
                    (variance_tensor.offset + c, variance),
                ] {
                    values[place] = values[place] * momentum + new * (1.0 - momentum);
                }
            }
        }
    }

    fn combine_gradients(&mut self, index: usize, groups: usize) {
        let statistics = &mut self.statistics[index];
        let channels = statistics.mean.len();
        let totals = &mut self.totals;
        totals.clear();
        totals.resize(2 * channels, 0.0);
        for group in &self.groups[..groups] {
            for (total, sum) in totals.iter_mut().zip(&lock(group).sums) {
                *total += sum;
            }
        }
        for c in 0..channels {
            statistics.gradient_sum[c] = totals[c] as f32;
            statistics.gradient_product[c] = totals[channels + c] as f32;
        }
    }
}

impl Pass<'_> {
    /// This group's sums of a batch norm's gradient and of its product with the normalised input, which are also the
    /// gradients of its weights.
    fn sum_gradients(&self, layer: usize, frame: &Frame, group: &mut Group) {
        let planned = &self.engine.layers[layer];
        let shape = planned.layer.output;
        let statistics = &self.statistics[layer];
        let len = self.count() * shape.len();
        let gradients = frame.gradients[layer + 1][..len].chunks_exact(shape.plane());
        let values = frame.values[planned.layer.from[0]][..len].chunks_exact(shape.plane());
        group.sums.clear();
        group.sums.resize(2 * shape.channels, 0.0);
        for (place, (gradients, values)) in gradients.zip(values).enumerate() {
            let c = place % shape.channels;
            let (mean, factor) = (statistics.mean[c], statistics.inverse_deviation[c]);
            group.sums[c] += sum_of(gradients, f64::from);
            group.sums[shape.channels + c] += chains(
                gradients.chunks(CHAINS).zip(values.chunks(CHAINS)),
                |(gradients, values), sums| {
                    for ((sum, gradient), value) in sums.iter_mut().zip(gradients).zip(values) {
                        *sum += f64::from(gradient * ((value - mean) * factor));
                    }
                },
            );
        }
        if let [Some(weight), Some(bias), ..] = &planned.gradient_ranges[..] {
            for c in 0..shape.channels {
                group.gradient[weight.start + c] = group.sums[shape.channels + c] as f32;
                group.gradient[bias.start + c] = group.sums[c] as f32;
            }
        }
    }
}

/// Sums are added in so many chains side by side, then those in their order: faster than one, and the same everywhere.
const CHAINS: usize = 8;

fn chains<T>(parts: impl Iterator<Item = T>, add: impl Fn(T, &mut [f64; CHAINS])) -> f64 {
    let mut sums = [0.0; CHAINS];
    for part in parts {
        add(part, &mut sums);
    }
    sums.iter().sum()
}

fn sum_of(values: &[f32], term: impl Fn(f32) -> f64) -> f64 {
    chains(values.chunks(CHAINS), |part, sums| {
        for (sum, value) in sums.iter_mut().zip(part) {
            *sum += term(*value);
        }
    })
}
