//! Training: gradients of fixed groups of a batch, added in a fixed order, and Adam.

mod descend;
mod options;
mod pass;
mod predict;
mod saved;
mod staged;

pub use options::{Loss, TrainError, TrainOptions};

use crate::engine::{Engine, Frame, Operation, Packed, Scratch, State, Statistics};
use crate::network::Network;
use crate::weights::Weights;
use crate::workers::Workers;
use pass::Pass;
use std::sync::{Mutex, MutexGuard, PoisonError};

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

    /// Forgets the state of every sequence.
    pub fn reset_state(&mut self) {
        for group in &self.groups {
            lock(group).state.forget();
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
            self.each_pass(batch, |pass, worker, group| {
                pass.run(&mut worker.frames, group, &mut worker.scratch);
            });
        } else {
            self.staged_gradients(batch);
        }
        let loss: f64 = self.groups[..groups].iter().map(|group| lock(group).loss).sum();
        loss as f32
    }

    /// Does something for every group of a batch, on all threads.
    fn each_pass(&mut self, batch: Batch, work: impl Fn(&Pass, &mut Worker, &mut Group) + Sync) {
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
            work(&pass, worker, group);
        });
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
