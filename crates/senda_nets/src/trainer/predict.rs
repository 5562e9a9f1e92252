//! Outputs and losses with the weights as they are, on all threads.

use super::{Trainer, lock};
use std::ops::Range;
use std::sync::{PoisonError, RwLock};

impl Trainer {
    /// Loss of a batch with the weights as they are; running statistics, no dropout, fresh state.
    ///
    /// # Panics
    /// When the lengths do not fit the network or each other.
    pub fn evaluate(&mut self, inputs: &[f32], targets: &[f32]) -> f32 {
        let outputs = self.engine.network.output_len();
        let mut predictions = vec![0.0; targets.len()];
        self.predict(inputs, &mut predictions);
        let weights = &self.options.output_weights;
        let loss = self.options.loss;
        let errors = predictions.iter().zip(targets).enumerate();
        let sum: f64 = errors
            .map(|(i, (prediction, target))| {
                let weight = weights.get(i % outputs).copied().unwrap_or(1.0);
                f64::from(weight * loss.of(prediction - target).0)
            })
            .sum();
        (sum / targets.len().max(1) as f64) as f32
    }

    /// Outputs for any number of inputs with the weights as they are; fresh state for each.
    ///
    /// # Panics
    /// When the lengths do not fit the network or each other.
    pub fn predict(&mut self, inputs: &[f32], outputs: &mut [f32]) {
        let count = inputs.len() / self.engine.network.input().len();
        self.predict_sequence(1, count, inputs, outputs);
    }

    /// Outputs for `steps` moments of `sequences` sequences, from a fresh state; order as in [`Trainer::step_sequence`].
    ///
    /// # Panics
    /// When the lengths do not fit the network or each other.
    pub fn predict_sequence(&mut self, steps: usize, sequences: usize, inputs: &[f32], outputs: &mut [f32]) {
        let engine = &self.engine;
        let (in_len, out_len) = (engine.network.input().len(), engine.network.output_len());
        assert!(
            inputs.len() == steps * sequences * in_len && outputs.len() == steps * sequences * out_len,
            "inputs or outputs of another length"
        );
        let (chunk, packed, weights, memory) =
            (engine.chunk, &self.packed, &self.weights, &self.worker_memory);
        // Groups lie apart in memory when there are several moments: each writes through the lock.
        let outputs = RwLock::new(outputs);
        self.workers.run(sequences.div_ceil(chunk), &|worker, group| {
            let worker = &mut *lock(&memory[worker]);
            let first = group * chunk;
            let count = chunk.min(sequences - first);
            worker.state.forget();
            let frame = &mut worker.frames[0];
            for step in 0..steps {
                let place = step * sequences + first;
                frame.values[0][..count * in_len]
                    .copy_from_slice(&inputs[place * in_len..(place + count) * in_len]);
                let (state, scratch) = (&mut worker.state, &mut worker.scratch);
                engine.infer(&weights.values, packed, frame, state, scratch, count);
                let from = &frame.values[engine.layers.len()][..count * out_len];
                let mut outputs = outputs.write().unwrap_or_else(PoisonError::into_inner);
                outputs[place * out_len..(place + count) * out_len].copy_from_slice(from);
            }
        });
    }

    /// Outputs for every frame of runs, each from a fresh state that it carries on in order. Frames are numbered: `runs` are
    /// ranges of them, `read` puts a frame's input (planar) where it is told to, and its outputs land at its own place.
    ///
    /// # Panics
    /// When `outputs` ends before the last frame's.
    pub fn predict_runs(
        &mut self,
        runs: &[Range<usize>],
        read: &(dyn Fn(usize, &mut [f32]) + Sync),
        outputs: &mut [f32],
    ) {
        let engine = &self.engine;
        let (in_len, out_len) = (engine.network.input().len(), engine.network.output_len());
        let (packed, weights, memory) = (&self.packed, &self.weights, &self.worker_memory);
        let outputs = RwLock::new(outputs);
        self.workers.run(runs.len(), &|worker, run| {
            let worker = &mut *lock(&memory[worker]);
            worker.state.forget();
            let frame = &mut worker.frames[0];
            for number in runs[run].clone() {
                read(number, &mut frame.values[0][..in_len]);
                let (state, scratch) = (&mut worker.state, &mut worker.scratch);
                engine.infer(&weights.values, packed, frame, state, scratch, 1);
                let from = &frame.values[engine.layers.len()][..out_len];
                let mut outputs = outputs.write().unwrap_or_else(PoisonError::into_inner);
                outputs[number * out_len..(number + 1) * out_len].copy_from_slice(from);
            }
        });
    }
}
