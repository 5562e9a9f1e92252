//! Training: epochs over samples, the best weights kept, resumable after a kill at any moment to the same result.

use crate::augment::{Answers, Augmentation, augment};
use crate::balance::Balance;
use crate::checkpoint;
use crate::order::{self, Portion};
use crate::{LearnError, Samples};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use senda_nets::{Initialisation, InputSpec, Network, TrainOptions, Trainer, Weights};
use senda_run::Ears;
use serde::{Deserialize, Serialize};
use std::path::Path;

/// How to train. The default is A9 in SPEC: Adam at 1e-3, batches of 32, mean squared error, ten epochs, the best kept.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Training {
    /// Passes over the training samples.
    pub epochs: u32,
    /// How fresh weights are drawn.
    pub initialisation: Initialisation,
    /// Samples a step; for a network that learns sequences, runs side by side.
    pub batch: usize,
    /// Frames of a run that a network with a memory learns from at once (back-propagation through time, truncated to them);
    /// the memory is carried on from one such sequence to the next and forgotten where a run ends (B5 in SPEC). 1: single
    /// frames in any order, without memory. Networks without a memory always learn from single frames.
    pub sequence: usize,
    /// Adam's step size at the beginning.
    pub learning_rate: f64,
    /// How it changes.
    pub schedule: Schedule,
    /// Stop when validation has not improved for this many epochs; 0: never.
    pub patience: u32,
    /// Frames with a large answer count up to 1 + this times as much as frames that go straight.
    pub curve_weight: f64,
    /// How far rare answers are raised against frequent ones, 0 to 1: each of 21 equal ranges of the answer that turns (else of
    /// the first one) counts as 1 / (its frames)^this. 0: as often as they occur; 1: every range as much as any other.
    pub balance: f64,
    /// Every epoch shows every frame twice, as it is and mirrored with the turn negated (A9 in SPEC); an epoch has twice as
    /// many steps then. `augmentation.mirror` draws nothing.
    pub both_ways: bool,
    /// Changes to training frames.
    pub augmentation: Augmentation,
    /// Seed of the order, the changes and of dropout.
    pub seed: u64,
    /// Threads; 0: one for each core. The result does not depend on it.
    pub threads: usize,
}

/// Threads beyond this are a slip of the finger: the system runs out of them.
pub const MOST_THREADS: usize = 1024;

impl Default for Training {
    fn default() -> Self {
        Self {
            epochs: 10,
            initialisation: Initialisation::default(),
            batch: 32,
            sequence: 16,
            learning_rate: 1e-3,
            schedule: Schedule::Constant,
            patience: 0,
            curve_weight: 0.0,
            balance: 0.0,
            both_ways: false,
            augmentation: Augmentation::default(),
            seed: 1,
            threads: 0,
        }
    }
}

/// How the learning rate changes over the epochs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Schedule {
    /// Not at all.
    #[default]
    Constant,
    /// Down to a fiftieth along a smooth curve (3x² - 2x³), step by step.
    Smooth,
}

impl Schedule {
    /// The factor at a part 0..=1 of the way.
    pub(crate) fn factor(self, part: f64) -> f64 {
        match self {
            Self::Constant => 1.0,
            Self::Smooth => 1.0 - 0.98 * part * part * (3.0 - 2.0 * part),
        }
    }
}

impl Training {
    /// Refuses what cannot be trained with.
    pub fn check(&self) -> Result<(), LearnError> {
        let wrong = |key, expected: &str, found: String| {
            Err(LearnError::Option {
                key,
                expected: expected.to_owned(),
                found,
            })
        };
        if self.epochs == 0 || self.epochs > 100_000 {
            return wrong("epochs", "1 to 100000", self.epochs.to_string());
        }
        if self.batch == 0 || self.batch > 65_536 {
            return wrong("batch", "1 to 65536", self.batch.to_string());
        }
        if self.sequence == 0 || self.sequence > 1024 {
            return wrong("sequence", "1 to 1024", self.sequence.to_string());
        }
        if !(self.learning_rate > 0.0 && self.learning_rate <= 10.0) {
            return wrong(
                "learning_rate",
                "more than 0, at most 10",
                self.learning_rate.to_string(),
            );
        }
        if !(0.0..=1000.0).contains(&self.curve_weight) {
            return wrong("curve_weight", "0 to 1000", self.curve_weight.to_string());
        }
        if !(0.0..=1.0).contains(&self.balance) {
            return wrong("balance", "0 to 1", self.balance.to_string());
        }
        if self.threads > MOST_THREADS {
            return wrong("threads", "0 to 1024", self.threads.to_string());
        }
        match self.augmentation.fault() {
            Some((key, range, value)) => wrong(key, range, value.to_string()),
            None => Ok(()),
        }
    }

    /// Whether this network learns from frames in their order, and carries its memory from one to the next.
    pub fn is_ordered(&self, network: &Network) -> bool {
        network.is_recurrent() && self.sequence > 1
    }

    /// Whether a model trained so is to forget before every picture ([`senda_nets::Model::forgets`]).
    pub fn forgets(&self, network: &Network) -> bool {
        network.is_recurrent() && !self.is_ordered(network)
    }
}

/// What an epoch brought.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Epoch {
    /// Its number, from 1.
    pub number: u32,
    /// Mean loss over the training batches, as they were trained.
    pub training_loss: f64,
    /// Errors on the validation samples; `None` where there are none.
    pub validation: Option<Errors>,
    /// Learning rate at its end.
    pub learning_rate: f64,
}

/// Errors of the first output over samples, in that output's units.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Errors {
    /// Mean squared error over all outputs: the loss without weights.
    pub mean_squared: f64,
    /// Mean absolute error of the first output.
    pub mean_absolute: f64,
    /// Mean absolute error of always answering the median.
    pub of_constant_median: f64,
    /// Correlation of answer and target (Pearson); 0 where one of them does not vary.
    pub correlation: f64,
    /// Number of samples.
    pub count: usize,
}

impl Errors {
    /// Mean squared and mean absolute error in degrees (°², °), where an output of 1 is called so many degrees: 50 of document A's
    /// servo (A2 in SPEC), or the wheels' own angle at full lock.
    pub fn in_degrees(&self, full_lock_deg: f64) -> [f64; 2] {
        [
            self.mean_squared * full_lock_deg * full_lock_deg,
            self.mean_absolute * full_lock_deg,
        ]
    }
}

/// A trained network's weights and how it went.
#[derive(Debug, Clone, PartialEq)]
pub struct Trained {
    /// The weights of the best epoch: least validation error, else the last epoch's.
    pub weights: Weights,
    /// Which epoch that was.
    pub best_epoch: u32,
    /// All epochs.
    pub history: Vec<Epoch>,
    /// Whether somebody interrupted.
    pub interrupted: bool,
}

/// What is said while training.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum News {
    /// Steps done of all steps, with the running loss.
    Step {
        /// Done.
        done: u64,
        /// Of how many.
        of: u64,
        /// Mean loss of this epoch so far.
        loss: f64,
    },
    /// An epoch is over.
    Epoch(Epoch),
}

/// What is trained, on what, and how.
pub struct Lesson<'a> {
    /// The layers.
    pub network: &'a Network,
    /// How frames were prepared.
    pub input: &'a InputSpec,
    /// Which outputs turn with the picture.
    pub answers: &'a Answers,
    /// What is learned.
    pub training: &'a Samples,
    /// What judges; may be empty.
    pub validation: &'a Samples,
    /// How.
    pub options: &'a Training,
    /// Where the state is kept after every epoch. If the file is there, training goes on from it; the end is the same as
    /// without interruption.
    pub checkpoint: Option<&'a Path>,
}

/// Refuses what [`train`] would refuse before its first step: options, data, and the checkpoint of another experiment.
pub fn check(lesson: &Lesson, weights: &Weights) -> Result<(), LearnError> {
    check_data(lesson)?;
    match lesson.checkpoint.filter(|path| path.exists()) {
        Some(path) => checkpoint::check(path, &checkpoint::fingerprint(lesson, weights)),
        None => Ok(()),
    }
}

fn check_data(lesson: &Lesson) -> Result<(), LearnError> {
    lesson.options.check()?;
    if lesson.training.is_empty() {
        return Err(LearnError::NoFrames {
            what: "training".into(),
            help: "record some with `senda drive --record`, or give other data".into(),
        });
    }
    lesson.training.check_targets("training data")?;
    lesson.validation.check_targets("validation data")
}

/// Trains a network from these weights on.
pub fn train(
    lesson: &Lesson,
    weights: Weights,
    ears: &mut Ears,
    news: &mut dyn FnMut(News),
) -> Result<Trained, LearnError> {
    let Lesson {
        network,
        input,
        answers,
        training,
        validation,
        options,
        checkpoint,
    } = *lesson;
    check_data(lesson)?;
    let fingerprint = checkpoint::fingerprint(lesson, &weights);
    let mut trainer = Trainer::new(
        network.clone(),
        weights,
        TrainOptions {
            learning_rate: options.learning_rate as f32,
            threads: if options.threads == 0 {
                rayon::current_num_threads()
            } else {
                options.threads
            },
            seed: options.seed,
            ..TrainOptions::default()
        },
    )?;
    let mut progress = match checkpoint {
        Some(path) => checkpoint::load(path, &fingerprint, &mut trainer)?,
        None => None,
    }
    .unwrap_or_default();

    let mut assembler = Assembler::new(input, answers, options, training);
    let is_ordered = options.is_ordered(network);
    for number in progress.history.len() as u32 + 1..=options.epochs {
        if options.patience > 0 && number > progress.best_epoch + options.patience && progress.best_epoch > 0
        {
            break;
        }
        let mut rng = ChaCha8Rng::seed_from_u64(options.seed);
        rng.set_stream(u64::from(number));
        let portions = if is_ordered {
            order::in_order(
                training,
                options.both_ways,
                options.sequence,
                options.batch,
                &mut rng,
            )
        } else {
            order::shuffled(training.len(), options.both_ways, options.batch, &mut rng)
        };
        let steps_per_epoch = portions.len() as u64;
        let of = steps_per_epoch * u64::from(options.epochs);
        let (mut loss_sum, mut count) = (0.0, 0usize);
        let mut learning_rate = 0.0;
        for (step, portion) in portions.iter().enumerate() {
            if (ears.interrupted)() {
                progress.interrupted = true;
                return Ok(progress.finish(trainer.weights()));
            }
            let done = u64::from(number - 1) * steps_per_epoch + step as u64;
            learning_rate = options.learning_rate * options.schedule.factor(done as f64 / of as f64);
            trainer.set_learning_rate(learning_rate as f32);
            assembler.assemble(portion, number);
            for stream in &portion.begins {
                trainer.reset_sequence(*stream);
            }
            let is_weighted = is_ordered || options.curve_weight > 0.0 || options.balance > 0.0;
            let loss = f64::from(trainer.step_sequence(
                portion.moments,
                portion.streams,
                &assembler.inputs,
                &assembler.targets,
                is_weighted.then_some(&assembler.weights[..]),
            ));
            if !loss.is_finite() {
                return Err(LearnError::Diverged {
                    steps: done,
                    learning_rate,
                });
            }
            loss_sum += loss * portion.len() as f64;
            count += portion.len();
            (ears.progress)((done + 1) as f64 / of as f64);
            news(News::Step {
                done: done + 1,
                of,
                loss: loss_sum / count as f64,
            });
        }
        // The last step's loss was that of the weights before it.
        if !trainer.weights().fits(network) {
            return Err(LearnError::Diverged {
                steps: u64::from(number) * steps_per_epoch,
                learning_rate,
            });
        }
        let judged = (!validation.is_empty()).then(|| {
            if is_ordered {
                errors_in_order(&mut trainer, input, validation)
            } else {
                errors(&mut trainer, input, validation, options.batch)
            }
        });
        let epoch = Epoch {
            number,
            training_loss: loss_sum / count.max(1) as f64,
            validation: judged,
            learning_rate,
        };
        progress.epoch(epoch, trainer.weights());
        if let Some(path) = checkpoint {
            checkpoint::save(path, &fingerprint, &trainer, &progress)?;
        }
        news(News::Epoch(epoch));
    }
    Ok(progress.finish(trainer.weights()))
}

/// What a checkpoint keeps besides the trainer.
#[derive(Debug, Clone, PartialEq, Default)]
pub(crate) struct Progress {
    pub(crate) history: Vec<Epoch>,
    pub(crate) best: Option<Weights>,
    pub(crate) best_epoch: u32,
    pub(crate) interrupted: bool,
}

impl Progress {
    pub(crate) fn epoch(&mut self, epoch: Epoch, weights: &Weights) {
        let error = |epoch: &Epoch| {
            epoch
                .validation
                .map_or(-f64::from(epoch.number), |e| e.mean_squared)
        };
        let best = self.history.iter().map(error).fold(f64::INFINITY, f64::min);
        if error(&epoch) < best {
            self.best = Some(weights.clone());
            self.best_epoch = epoch.number;
        }
        self.history.push(epoch);
    }

    pub(crate) fn finish(self, last: &Weights) -> Trained {
        Trained {
            weights: self.best.unwrap_or_else(|| last.clone()),
            best_epoch: self.best_epoch,
            history: self.history,
            interrupted: self.interrupted,
        }
    }
}

/// Puts batches together; its buffers are reused.
struct Assembler<'a> {
    input: &'a InputSpec,
    answers: &'a Answers,
    options: &'a Training,
    samples: &'a Samples,
    shape: [usize; 3],
    balance: Balance,
    frame: Vec<u8>,
    inputs: Vec<f32>,
    targets: Vec<f32>,
    weights: Vec<f32>,
}

impl<'a> Assembler<'a> {
    fn new(input: &'a InputSpec, answers: &'a Answers, options: &'a Training, samples: &'a Samples) -> Self {
        Self {
            input,
            answers,
            options,
            samples,
            shape: [input.channels(), input.height, input.width],
            balance: Balance::new(
                samples,
                answers,
                options.balance,
                if options.both_ways {
                    0.5
                } else {
                    options.augmentation.mirror
                },
            ),
            frame: vec![0; samples.frame_len],
            inputs: Vec::new(),
            targets: Vec::new(),
            weights: Vec::new(),
        }
    }

    /// Every sample's changes depend on the seed, the epoch and the sample alone; in a sequence on its first sample: what is
    /// drawn there holds for all of them, or the memory would hold another world than the picture. Places without a frame
    /// count nothing, and the others as much more that the loss is their mean.
    fn assemble(&mut self, portion: &Portion, epoch: u32) {
        let length = self.samples.frame_len;
        self.inputs.clear();
        self.inputs.resize(portion.places.len() * length, 0.0);
        self.targets.clear();
        self.weights.clear();
        let share = portion.places.len() as f32 / portion.len() as f32;
        for (place, at) in portion.places.iter().enumerate() {
            let from = self.targets.len();
            let Some(at) = at else {
                self.targets.resize(from + self.samples.outputs, 0.0);
                self.weights.push(0.0);
                continue;
            };
            let mut rng = ChaCha8Rng::seed_from_u64(self.options.seed ^ 0xa5a5_5a5a);
            rng.set_stream((u64::from(epoch) << 40) | at.draw as u64);
            self.frame.copy_from_slice(self.samples.frame(at.frame));
            self.targets.extend_from_slice(self.samples.target(at.frame));
            let mut changes = self.options.augmentation;
            if self.options.both_ways {
                changes.mirror = f64::from(u8::from(at.draw >= self.samples.len()));
            }
            augment(
                &changes,
                self.shape,
                &mut self.frame,
                &mut self.targets[from..],
                self.answers,
                &mut rng,
            );
            let largest = self.targets[from..]
                .iter()
                .fold(0.0f32, |most, target| most.max(target.abs()));
            let curve = 1.0 + self.options.curve_weight as f32 * largest.min(1.0);
            self.weights
                .push(share * curve * self.balance.weight(&self.targets[from..]));
            self.input.normalise(
                &self.frame,
                &mut self.inputs[place * length..(place + 1) * length],
            );
        }
    }
}

/// Errors of finished weights on samples as they were recorded: no treatment, no dropout.
pub fn judge(lesson: &Lesson, weights: &Weights, samples: &Samples) -> Result<Errors, LearnError> {
    let options = TrainOptions {
        threads: match lesson.options.threads {
            0 => rayon::current_num_threads(),
            threads => threads,
        },
        ..TrainOptions::default()
    };
    let mut trainer = Trainer::new(lesson.network.clone(), weights.clone(), options)?;
    Ok(if lesson.options.is_ordered(lesson.network) {
        errors_in_order(&mut trainer, lesson.input, samples)
    } else {
        errors(&mut trainer, lesson.input, samples, lesson.options.batch)
    })
}

/// Answers for all samples, in order, each without memory of the ones before.
pub fn answer(trainer: &mut Trainer, input: &InputSpec, samples: &Samples, batch: usize) -> Vec<f32> {
    let mut inputs = Vec::new();
    let mut answers = vec![0.0; samples.len() * samples.outputs];
    for first in (0..samples.len()).step_by(batch) {
        let last = (first + batch).min(samples.len());
        inputs.resize((last - first) * samples.frame_len, 0.0);
        input.normalise(
            &samples.pixels[first * samples.frame_len..last * samples.frame_len],
            &mut inputs,
        );
        trainer.predict(
            &inputs,
            &mut answers[first * samples.outputs..last * samples.outputs],
        );
    }
    answers
}

/// Errors of the network in a trainer, dropout off.
pub fn errors(trainer: &mut Trainer, input: &InputSpec, samples: &Samples, batch: usize) -> Errors {
    let answers = answer(trainer, input, samples, batch);
    compare(&answers, &samples.targets, samples.outputs)
}

/// The same with a memory that is carried on through every run, as it is while driving.
pub fn errors_in_order(trainer: &mut Trainer, input: &InputSpec, samples: &Samples) -> Errors {
    let mut answers = vec![0.0; samples.len() * samples.outputs];
    trainer.predict_runs(
        &samples.stretches(),
        &|frame, to| input.normalise(samples.frame(frame), to),
        &mut answers,
    );
    compare(&answers, &samples.targets, samples.outputs)
}

/// Errors of answers against targets, both with `outputs` values a sample.
pub fn compare(answers: &[f32], targets: &[f32], outputs: usize) -> Errors {
    let count = targets.len() / outputs.max(1);
    if count == 0 {
        return Errors::default();
    }
    let squared: f64 = answers
        .iter()
        .zip(targets)
        .map(|(a, t)| f64::from(*a) - f64::from(*t))
        .map(|off| off * off)
        .sum();
    let first =
        |values: &[f32]| -> Vec<f64> { values.iter().step_by(outputs).map(|v| f64::from(*v)).collect() };
    let (answers, targets) = (first(answers), first(targets));
    let n = count as f64;
    let mean = |values: &[f64]| values.iter().sum::<f64>() / n;
    let (mean_a, mean_t) = (mean(&answers), mean(&targets));
    let product = |x: &[f64], mx: f64, y: &[f64], my: f64| -> f64 {
        x.iter().zip(y).map(|(x, y)| (x - mx) * (y - my)).sum()
    };
    let spread =
        (product(&answers, mean_a, &answers, mean_a) * product(&targets, mean_t, &targets, mean_t)).sqrt();
    let mut sorted = targets.clone();
    sorted.sort_by(f64::total_cmp);
    let median = sorted[sorted.len() / 2];
    Errors {
        mean_squared: squared / (n * outputs as f64),
        mean_absolute: answers
            .iter()
            .zip(&targets)
            .map(|(a, t)| (a - t).abs())
            .sum::<f64>()
            / n,
        of_constant_median: targets.iter().map(|t| (t - median).abs()).sum::<f64>() / n,
        correlation: if spread > 0.0 {
            product(&answers, mean_a, &targets, mean_t) / spread
        } else {
            0.0
        },
        count,
    }
}
