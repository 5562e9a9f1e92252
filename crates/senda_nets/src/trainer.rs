//! Training: gradients of fixed groups of a batch, added in a fixed order, and Adam.

use crate::engine::{Engine, Frame, Mode, Operation, Packed, Scratch, State, Statistics};
use crate::network::{Kind, Network};
use crate::weights::Weights;
use crate::workers::Workers;
use serde::{Deserialize, Serialize};
use std::ops::Range;
use std::sync::{Mutex, MutexGuard, PoisonError, RwLock};
use thiserror::Error;

/// What training minimises: the mean over batch and outputs of a function of the error.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case", deny_unknown_fields)]
pub enum Loss {
    /// Its square (A9, B5).
    #[default]
    Mse,
    /// Half its square up to `delta`, linear beyond: a few wrong labels count less.
    Huber {
        /// Where it becomes linear, in units of the output.
        delta: f32,
    },
}

impl Loss {
    /// Loss and its derivative for one error.
    fn of(self, error: f32) -> (f32, f32) {
        match self {
            Self::Mse => (error * error, 2.0 * error),
            Self::Huber { delta } if error.abs() <= delta => (0.5 * error * error, error),
            Self::Huber { delta } => (
                delta * (error.abs() - 0.5 * delta),
                delta * if error > 0.0 { 1.0 } else { -1.0 },
            ),
        }
    }
}

/// How to train. The defaults are Keras's Adam.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct TrainOptions {
    /// Step size.
    pub learning_rate: f32,
    /// Adam: memory of the mean of gradients.
    pub beta1: f32,
    /// Adam: memory of the mean of their squares.
    pub beta2: f32,
    /// Adam: added to the root of the mean square.
    pub epsilon: f32,
    /// Part of each weight taken away in a step, in units of the learning rate (AdamW; Loshchilov and Hutter 2019).
    pub weight_decay: f32,
    /// Threads to use; the result does not depend on it.
    pub threads: usize,
    /// Seed of the dropout masks.
    pub seed: u64,
    /// What to minimise.
    pub loss: Loss,
    /// Weight of each output in the loss; empty: all 1.
    pub output_weights: Vec<f32>,
    /// Longest gradient; longer ones are shortened to it.
    pub clip_norm: Option<f32>,
}

impl Default for TrainOptions {
    fn default() -> Self {
        Self {
            learning_rate: 1e-3,
            beta1: 0.9,
            beta2: 0.999,
            epsilon: 1e-7,
            weight_decay: 0.0,
            threads: 1,
            seed: 0,
            loss: Loss::Mse,
            output_weights: Vec::new(),
            clip_norm: None,
        }
    }
}

/// Why training cannot begin or go on.
#[derive(Debug, Error)]
pub enum TrainError {
    /// Weights of another network, or not finite.
    #[error("expected {expected} finite weights, but found {found}")]
    Weights {
        /// Number that the network has.
        expected: usize,
        /// What there is.
        found: String,
    },
    /// The options and the network do not go together.
    #[error("{0}")]
    Options(String),
    /// A saved state of another network or another version, or a damaged one.
    #[error("expected a saved training state of this network, but found {0}")]
    State(String),
    /// No thread could be started.
    #[error("starting the training threads: {0}")]
    Threads(#[from] std::io::Error),
}

/// What one thread needs.
struct Worker {
    frames: Vec<Frame>,
    scratch: Scratch,
    state: State,
}

/// A fixed part of the batch.
struct Group {
    /// Only where layers need statistics of the whole batch: everyone waits in the middle, so threads change groups.
    frames: Vec<Frame>,
    state: State,
    gradient: Vec<f32>,
    loss: f64,
    /// Sums of each channel of a batch norm's input, then of squares.
    sums: Vec<f64>,
}

/// Weights that are changed block by block.
struct Block {
    first: usize,
    len: usize,
    gradient: usize,
}

/// Trains a network.
///
/// The same inputs give the same weights, bit for bit, whatever the number of threads and however often the training
/// was saved and resumed.
pub struct Trainer {
    engine: Engine,
    options: TrainOptions,
    weights: Weights,
    first_moment: Vec<f32>,
    second_moment: Vec<f32>,
    step: u64,
    packed: Packed,
    statistics: Vec<Statistics>,
    /// First layer of each part of the network between which the whole batch is waited for.
    stages: Vec<usize>,
    workers: Workers,
    worker_memory: Vec<Mutex<Worker>>,
    groups: Vec<Mutex<Group>>,
    blocks: Vec<Block>,
    /// Sums over groups of what each channel of a batch norm needs.
    totals: Vec<f64>,
}

impl std::fmt::Debug for Trainer {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Trainer")
            .field("network", &self.engine.network.name())
            .field("step", &self.step)
            .finish_non_exhaustive()
    }
}

/// Values of all activations of a group: bounds a thread's memory for large networks. Measured: small ones gain nothing
/// from larger groups.
const GROUP_VALUES: usize = 1 << 22;
const GROUP: usize = 4;
/// Weights that are updated as one task.
const BLOCK: usize = 1 << 14;

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    // A panicking task is reported by the threads; buffers are rewritten from the start.
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// One call's data: `steps` moments of `sequences` inputs.
#[derive(Clone, Copy)]
struct Batch<'a> {
    steps: usize,
    sequences: usize,
    inputs: &'a [f32],
    targets: &'a [f32],
    sample_weights: Option<&'a [f32]>,
    /// Instead of targets: what one sample's outputs cost, and the slope of that.
    judge: Option<&'a Judge<'a>>,
}

/// Loss of one sample's outputs, whose gradient replaces what is in the last argument.
type Judge<'a> = dyn Fn(usize, &[f32], &mut [f32]) -> f64 + Sync + 'a;

impl Trainer {
    /// Prepares training from the given weights.
    ///
    /// # Errors
    /// When weights or options do not fit the network, or no thread can be started.
    pub fn new(network: Network, weights: Weights, options: TrainOptions) -> Result<Self, TrainError> {
        if !weights.fits(&network) {
            return Err(TrainError::Weights {
                expected: network.parameter_count(),
                found: format!("{} (or a value that is not finite)", weights.values.len()),
            });
        }
        let outputs = network.output_len();
        if !options.output_weights.is_empty() && options.output_weights.len() != outputs {
            return Err(TrainError::Options(format!(
                "output_weights: expected {outputs} numbers, but found {}",
                options.output_weights.len()
            )));
        }
        let values: usize = network.layers().iter().map(|layer| layer.output.len()).sum();
        let group = (GROUP_VALUES / values.max(1)).clamp(1, GROUP);
        let engine = Engine::new(&network, group, true);
        let uses_batch = |index: &usize| {
            matches!(
                engine.layers[*index].operation,
                Operation::Normalise { uses_batch: true, .. }
            )
        };
        let stages: Vec<usize> = std::iter::once(0)
            .chain((0..engine.layers.len()).filter(uses_batch))
            .collect();
        if stages.len() > 1 && network.is_recurrent() {
            return Err(TrainError::Options(
                "expected no trained batch_norm in a recurrent network, but found one; set trainable = false in it"
                    .to_owned(),
            ));
        }
        let mut blocks = Vec::new();
        for planned in &engine.layers {
            for (tensor, range) in planned.layer.tensors.iter().zip(&planned.gradient_ranges) {
                let Some(range) = range else { continue };
                for start in (0..tensor.len()).step_by(BLOCK) {
                    blocks.push(Block {
                        first: tensor.offset + start,
                        len: BLOCK.min(tensor.len() - start),
                        gradient: range.start + start,
                    });
                }
            }
        }
        let workers = Workers::new(options.threads)?;
        let worker_memory = (0..workers.count())
            .map(|_| {
                Mutex::new(Worker {
                    frames: vec![engine.frame()],
                    scratch: engine.scratch(),
                    state: engine.state(),
                })
            })
            .collect();
        let mut packed = engine.packed();
        for index in 0..engine.layers.len() {
            engine.pack(index, &weights.values, &mut packed);
        }
        let statistics = engine
            .layers
            .iter()
            .map(|planned| match planned.operation {
                Operation::Normalise { uses_batch: true, .. } => {
                    let zeros = vec![0.0; planned.layer.output.channels];
                    Statistics {
                        mean: zeros.clone(),
                        inverse_deviation: zeros.clone(),
                        gradient_sum: zeros.clone(),
                        gradient_product: zeros,
                        count: 1.0,
                    }
                }
                _ => Statistics::default(),
            })
            .collect();
        Ok(Self {
            first_moment: vec![0.0; engine.gradient_len],
            second_moment: vec![0.0; engine.gradient_len],
            step: 0,
            packed,
            statistics,
            totals: Vec::new(),
            stages,
            workers,
            worker_memory,
            groups: Vec::new(),
            blocks,
            engine,
            options,
            weights,
        })
    }

    /// The network.
    pub fn network(&self) -> &Network {
        &self.engine.network
    }

    /// The weights as they are now.
    pub fn weights(&self) -> &Weights {
        &self.weights
    }

    /// Steps taken so far.
    pub fn steps(&self) -> u64 {
        self.step
    }

    /// The options, with the learning rate as it is now.
    pub fn options(&self) -> &TrainOptions {
        &self.options
    }

    /// Changes the step size from the next step on.
    pub fn set_learning_rate(&mut self, learning_rate: f32) {
        self.options.learning_rate = learning_rate;
    }

    /// One step of gradient descent on a batch of planar inputs, concatenated. Gives the batch's loss before the step.
    /// A recurrent network carries its state on from the step before, each place of the batch being a sequence.
    ///
    /// # Panics
    /// When the lengths do not fit the network or each other.
    pub fn step(&mut self, inputs: &[f32], targets: &[f32], sample_weights: Option<&[f32]>) -> f32 {
        let count = inputs.len() / self.engine.network.input().len();
        self.step_sequence(1, count, inputs, targets, sample_weights)
    }

    /// One step of gradient descent on `steps` moments of `sequences` parallel sequences (back-propagation through time,
    /// truncated to these moments). `inputs` and `targets` are ordered by moment, then by sequence. The state is carried
    /// on from the call before, without its gradient; [`Trainer::reset_state`] and [`Trainer::reset_sequence`] forget it.
    ///
    /// # Panics
    /// When the lengths do not fit the network or each other.
    pub fn step_sequence(
        &mut self,
        steps: usize,
        sequences: usize,
        inputs: &[f32],
        targets: &[f32],
        sample_weights: Option<&[f32]>,
    ) -> f32 {
        let batch = Batch {
            steps,
            sequences,
            inputs,
            targets,
            sample_weights,
            judge: None,
        };
        let loss = self.gradients(batch);
        self.descend(batch.groups(self.engine.chunk));
        loss
    }

    /// One step of gradient descent on a loss that targets cannot express: `judge` takes a sample's place in the batch and its
    /// outputs, gives their loss and writes its gradient. Gives the mean over the batch, before the step.
    ///
    /// # Panics
    /// When the inputs are no whole number of samples, or none.
    pub fn step_judged(&mut self, inputs: &[f32], judge: &Judge) -> f32 {
        let batch = Batch {
            steps: 1,
            sequences: inputs.len() / self.engine.network.input().len(),
            inputs,
            targets: &[],
            sample_weights: None,
            judge: Some(judge),
        };
        let loss = self.gradients(batch);
        self.descend(batch.groups(self.engine.chunk));
        loss
    }

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
            for values in &mut worker.state.values {
                values.fill(0.0);
            }
            let frame = &mut worker.frames[0];
            for step in 0..steps {
                let place = step * sequences + first;
                frame.values[0][..count * in_len]
                    .copy_from_slice(&inputs[place * in_len..(place + count) * in_len]);
                for index in 0..engine.layers.len() {
                    engine.forward(
                        index,
                        Mode::Inference,
                        &weights.values,
                        packed,
                        frame,
                        &mut worker.state,
                        &mut worker.scratch,
                        count,
                    );
                }
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
            for values in &mut worker.state.values {
                values.fill(0.0);
            }
            let frame = &mut worker.frames[0];
            for number in runs[run].clone() {
                read(number, &mut frame.values[0][..in_len]);
                for index in 0..engine.layers.len() {
                    engine.forward(
                        index,
                        Mode::Inference,
                        &weights.values,
                        packed,
                        frame,
                        &mut worker.state,
                        &mut worker.scratch,
                        1,
                    );
                }
                let from = &frame.values[engine.layers.len()][..out_len];
                let mut outputs = outputs.write().unwrap_or_else(PoisonError::into_inner);
                outputs[number * out_len..(number + 1) * out_len].copy_from_slice(from);
            }
        });
    }

    /// Forgets the state of every sequence.
    pub fn reset_state(&mut self) {
        for group in &self.groups {
            for values in &mut lock(group).state.values {
                values.fill(0.0);
            }
        }
    }

    /// Forgets the state of one sequence: it begins anew.
    pub fn reset_sequence(&mut self, sequence: usize) {
        let chunk = self.engine.chunk;
        if let Some(group) = self.groups.get(sequence / chunk) {
            let state = &mut lock(group).state;
            for (planned, values) in self.engine.layers.iter().zip(&mut state.values) {
                let len = planned.layer.state_len();
                if len > 0 {
                    values[(sequence % chunk) * len..(sequence % chunk + 1) * len].fill(0.0);
                }
            }
        }
    }

    /// The mean gradient of a batch by the trained weights, in the order of [`Network::tensors`] without the frozen
    /// ones, and the loss. Changes no weights; counts as no step.
    ///
    /// # Panics
    /// When the lengths do not fit the network or each other.
    pub fn gradient(
        &mut self,
        steps: usize,
        sequences: usize,
        inputs: &[f32],
        targets: &[f32],
    ) -> (Vec<f32>, f32) {
        let batch = Batch {
            steps,
            sequences,
            inputs,
            targets,
            sample_weights: None,
            judge: None,
        };
        let running: Vec<f32> = self.weights.values.clone();
        let loss = self.gradients(batch);
        // Batch norms have moved their running statistics.
        self.weights.values = running;
        let mut sum = vec![0.0; self.engine.gradient_len];
        for group in &self.groups[..batch.groups(self.engine.chunk)] {
            crate::math::add(&lock(group).gradient, &mut sum);
        }
        (sum, loss)
    }

    fn grow(&mut self, batch: Batch) {
        let frames_per_group = if self.stages.len() > 1 { 1 } else { 0 };
        while self.groups.len() < batch.groups(self.engine.chunk) {
            self.groups.push(Mutex::new(Group {
                frames: (0..frames_per_group).map(|_| self.engine.frame()).collect(),
                state: self.engine.state(),
                gradient: vec![0.0; self.engine.gradient_len],
                loss: 0.0,
                sums: Vec::new(),
            }));
        }
        for worker in &self.worker_memory {
            let worker = &mut *lock(worker);
            while worker.frames.len() < batch.steps {
                worker.frames.push(self.engine.frame());
            }
        }
    }

    /// Gradients of every group; the loss.
    fn gradients(&mut self, batch: Batch) -> f32 {
        batch.check(&self.engine.network);
        self.grow(batch);
        let groups = batch.groups(self.engine.chunk);
        if self.stages.len() == 1 {
            let (engine, memory) = (&self.engine, &self.worker_memory);
            let (packed, weights, statistics) = (&self.packed, &self.weights.values, &self.statistics);
            let (options, step, all) = (&self.options, self.step, &self.groups);
            self.workers.run(groups, &|worker, index| {
                let Worker { frames, scratch, .. } = &mut *lock(&memory[worker]);
                let group = &mut *lock(&all[index]);
                let pass = Pass {
                    engine,
                    packed,
                    weights,
                    statistics,
                    options,
                    step,
                    batch,
                    index,
                };
                pass.run(frames, group, scratch);
            });
        } else {
            self.staged_gradients(batch);
        }
        let loss: f64 = self.groups[..groups].iter().map(|group| lock(group).loss).sum();
        loss as f32
    }

    /// The same with statistics of the whole batch at every batch norm.
    fn staged_gradients(&mut self, batch: Batch) {
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
        work: impl Fn(&Pass, &mut Frame, &mut Group, &mut Scratch, std::ops::Range<usize>) + Sync,
        stage: usize,
    ) {
        let end = self
            .stages
            .get(stage + 1)
            .copied()
            .unwrap_or(self.engine.layers.len());
        let range = self.stages[stage]..end;
        let (engine, memory) = (&self.engine, &self.worker_memory);
        let (packed, weights, statistics) = (&self.packed, &self.weights.values, &self.statistics);
        let (options, step, all) = (&self.options, self.step, &self.groups);
        self.workers.run(batch.groups(engine.chunk), &|worker, index| {
            let worker = &mut *lock(&memory[worker]);
            let group = &mut *lock(&all[index]);
            let pass = Pass {
                engine,
                packed,
                weights,
                statistics,
                options,
                step,
                batch,
                index,
            };
            let mut frames = std::mem::take(&mut group.frames);
            work(&pass, &mut frames[0], group, &mut worker.scratch, range.clone());
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
                        plane
                            .iter()
                            .map(|x| (f64::from(*x) - mean) * (f64::from(*x) - mean))
                            .sum::<f64>()
                    } else {
                        plane.iter().map(|x| f64::from(*x)).sum::<f64>()
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

    /// Adds the groups' gradients in order, and takes a step of Adam.
    fn descend(&mut self, groups: usize) {
        self.step += 1;
        let options = &self.options;
        let scale = match options.clip_norm {
            None => 1.0,
            Some(limit) => {
                let norm = self.gradient_norm(groups);
                if norm > f64::from(limit) {
                    (f64::from(limit) / norm) as f32
                } else {
                    1.0
                }
            }
        };
        let power = |beta: f32| senda_geom::trig::pow(f64::from(beta), self.step as f64);
        let rate = f64::from(options.learning_rate) * (1.0 - power(options.beta2)).sqrt()
            / (1.0 - power(options.beta1));
        // Keras adds epsilon to the uncorrected root, as the end of section 2 of Kingma and Ba (2015) has it.
        let rate = rate as f32;
        let decay = options.learning_rate * options.weight_decay;
        for block in &self.blocks {
            let range = block.gradient..block.gradient + block.len;
            let Some((first, rest)) = self.groups[..groups].split_first() else {
                return;
            };
            let first = &mut lock(first).gradient[range.clone()];
            for group in rest {
                crate::math::add(&lock(group).gradient[range.clone()], first);
            }
            adam(
                [options.beta1, options.beta2, options.epsilon, rate, decay, scale],
                first,
                &mut self.first_moment[range.clone()],
                &mut self.second_moment[range],
                &mut self.weights.values[block.first..block.first + block.len],
            );
        }
        for index in 0..self.engine.layers.len() {
            if self.engine.layers[index].is_trained() {
                self.engine.pack(index, &self.weights.values, &mut self.packed);
            }
        }
    }

    fn gradient_norm(&self, groups: usize) -> f64 {
        let mut square = 0.0f64;
        for i in 0..self.engine.gradient_len {
            let sum: f32 = self.groups[..groups]
                .iter()
                .map(|group| lock(group).gradient[i])
                .sum();
            square += f64::from(sum) * f64::from(sum);
        }
        square.sqrt()
    }

    /// Everything that the next steps depend on: weights, Adam's moments, the number of steps and the learning rate. The
    /// state carried between sequences is not part of it: save between runs.
    pub fn state(&self) -> Vec<u8> {
        let count = self.weights.values.len() + 2 * self.first_moment.len();
        let mut bytes = Vec::with_capacity(STATE_HEADER + 4 * count);
        bytes.extend_from_slice(STATE_MAGIC);
        bytes.extend_from_slice(&(self.weights.values.len() as u64).to_le_bytes());
        bytes.extend_from_slice(&(self.first_moment.len() as u64).to_le_bytes());
        bytes.extend_from_slice(&self.step.to_le_bytes());
        bytes.extend_from_slice(&self.options.seed.to_le_bytes());
        bytes.extend_from_slice(&self.options.learning_rate.to_le_bytes());
        for value in self
            .weights
            .values
            .iter()
            .chain(&self.first_moment)
            .chain(&self.second_moment)
        {
            bytes.extend_from_slice(&value.to_le_bytes());
        }
        bytes
    }

    /// Goes on where [`Trainer::state`] was taken: the same steps then give the same weights, bit for bit.
    ///
    /// # Errors
    /// When the bytes are not such a state, or one of another network. Nothing is changed then.
    pub fn resume(&mut self, bytes: &[u8]) -> Result<(), TrainError> {
        let wrong = |found: &str| TrainError::State(found.to_owned());
        let Some(header) = bytes.get(..STATE_HEADER) else {
            return Err(wrong("too few bytes"));
        };
        if &header[..8] != STATE_MAGIC {
            return Err(wrong("other bytes, or another version"));
        }
        let number = |index: usize| {
            let mut eight = [0; 8];
            eight.copy_from_slice(&header[8 + 8 * index..16 + 8 * index]);
            u64::from_le_bytes(eight)
        };
        let (weights, moments) = (self.weights.values.len(), self.first_moment.len());
        if number(0) != weights as u64 || number(1) != moments as u64 {
            return Err(wrong("one of another network"));
        }
        if bytes.len() != STATE_HEADER + 4 * (weights + 2 * moments) {
            return Err(wrong("one that was cut short"));
        }
        let float = |bytes: &[u8]| f32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]);
        let mut values = bytes[STATE_HEADER..].chunks_exact(4).map(float);
        for place in self
            .weights
            .values
            .iter_mut()
            .chain(&mut self.first_moment)
            .chain(&mut self.second_moment)
        {
            *place = values.next().unwrap_or_default();
        }
        self.step = number(2);
        self.options.seed = number(3);
        self.options.learning_rate = float(&header[40..44]);
        for index in 0..self.engine.layers.len() {
            self.engine.pack(index, &self.weights.values, &mut self.packed);
        }
        self.reset_state();
        Ok(())
    }
}

const STATE_MAGIC: &[u8; 8] = b"sendatr1";
const STATE_HEADER: usize = 44;

crate::math::vectorised! {
    /// One step of Adam (Kingma and Ba 2015) with decoupled weight decay.
    fn adam(
        constants: [f32; 6],
        gradient: &[f32],
        first: &mut [f32],
        second: &mut [f32],
        weights: &mut [f32],
    ) {
        let [beta1, beta2, epsilon, rate, decay, scale] = constants;
        let moments = first.iter_mut().zip(second.iter_mut());
        for ((gradient, (first, second)), weight) in gradient.iter().zip(moments).zip(weights) {
            let gradient = *gradient * scale;
            *first = *first * beta1 + gradient * (1.0 - beta1);
            *second = *second * beta2 + gradient * gradient * (1.0 - beta2);
            *weight -= rate * *first / (second.sqrt() + epsilon) + decay * *weight;
        }
    }
}

impl Batch<'_> {
    fn groups(&self, chunk: usize) -> usize {
        self.sequences.div_ceil(chunk)
    }

    fn check(&self, network: &Network) {
        let count = self.steps * self.sequences;
        assert!(
            count > 0
                && self.inputs.len() == count * network.input().len()
                && (self.judge.is_some() || self.targets.len() == count * network.output_len())
                && self.sample_weights.is_none_or(|weights| weights.len() == count),
            "expected {count} inputs, targets and sample weights, but found {}, {} and {:?} values",
            self.inputs.len(),
            self.targets.len(),
            self.sample_weights.map(<[f32]>::len)
        );
    }
}

/// Everything that a task reads while it computes the gradient of one group.
struct Pass<'a> {
    engine: &'a Engine,
    packed: &'a Packed,
    weights: &'a [f32],
    statistics: &'a [Statistics],
    options: &'a TrainOptions,
    step: u64,
    batch: Batch<'a>,
    index: usize,
}

impl Pass<'_> {
    fn first(&self) -> usize {
        self.index * self.engine.chunk
    }

    fn count(&self) -> usize {
        self.engine.chunk.min(self.batch.sequences - self.first())
    }

    fn run(&self, frames: &mut [Frame], group: &mut Group, scratch: &mut Scratch) {
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

    fn load(&self, frame: &mut Frame, step: usize) {
        let len = self.engine.network.input().len();
        let place = (step * self.batch.sequences + self.first()) * len;
        let values = self.count() * len;
        frame.values[0][..values].copy_from_slice(&self.batch.inputs[place..place + values]);
    }

    fn forward(
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

    fn backward(
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
    fn loss(&self, frame: &mut Frame, step: usize) -> f64 {
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
            let (mut sum, mut product) = (0.0f64, 0.0f64);
            for (gradient, value) in gradients.iter().zip(values) {
                let normal = (value - statistics.mean[c]) * statistics.inverse_deviation[c];
                sum += f64::from(*gradient);
                product += f64::from(gradient * normal);
            }
            group.sums[c] += sum;
            group.sums[shape.channels + c] += product;
        }
        if let [Some(weight), Some(bias), ..] = &planned.gradient_ranges[..] {
            for c in 0..shape.channels {
                group.gradient[weight.start + c] = group.sums[shape.channels + c] as f32;
                group.gradient[bias.start + c] = group.sums[c] as f32;
            }
        }
    }
}
