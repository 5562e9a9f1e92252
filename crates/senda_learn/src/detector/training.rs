//! Training a detector.

use super::Pictures;
use super::jitter::jitter;
use crate::LearnError;
use crate::augment::{Answers, Augmentation, augment};
use crate::checkpoint;
use crate::train::{Epoch, MOST_THREADS, News, Progress, Schedule, Trained};
use rand::{SeedableRng, seq::SliceRandom};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use senda_nets::{Boxed, DetectionLoss, DetectionSpec, InputSpec, Network, TrainOptions, Trainer, Weights};
use senda_run::Ears;
use serde::{Deserialize, Serialize};
use std::path::Path;

/// How to train a detector.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct DetectorTraining {
    /// Passes over the pictures.
    pub epochs: u32,
    /// Pictures a step.
    pub batch: usize,
    /// Adam's step size at the beginning; it falls smoothly to a fiftieth.
    pub learning_rate: f64,
    /// Part of the light, contrast and colours by which pictures are changed. They are never mirrored: digits have no mirror
    /// image.
    pub light: f64,
    /// Part of the picture by which it is moved, and of its size by which it is scaled, with its boxes.
    pub jitter: f64,
    /// Seed of the order and of the changes.
    pub seed: u64,
    /// Threads; 0: one for each core. The result does not depend on it.
    pub threads: usize,
}

impl Default for DetectorTraining {
    fn default() -> Self {
        Self {
            epochs: 12,
            batch: 16,
            learning_rate: 2e-3,
            light: 0.2,
            jitter: 0.2,
            seed: 1,
            threads: 0,
        }
    }
}

impl DetectorTraining {
    fn check(&self) -> Result<(), LearnError> {
        let wrong = |key, expected: &str, found: String| LearnError::Option {
            key,
            expected: expected.to_owned(),
            found,
        };
        if self.epochs == 0 {
            return Err(wrong("epochs", "at least 1", "0".into()));
        }
        if !(1..=4096).contains(&self.batch) {
            return Err(wrong("batch", "1 to 4096", self.batch.to_string()));
        }
        if !(self.learning_rate > 0.0 && self.learning_rate <= 1.0) {
            return Err(wrong(
                "learning_rate",
                "more than 0, at most 1",
                self.learning_rate.to_string(),
            ));
        }
        if self.threads > MOST_THREADS {
            return Err(wrong("threads", "0 to 1024", self.threads.to_string()));
        }
        if !(0.0..=0.9).contains(&self.light) {
            return Err(wrong("light", "0 to 0.9", self.light.to_string()));
        }
        if !(0.0..=0.5).contains(&self.jitter) {
            return Err(wrong("jitter", "0 to 0.5", self.jitter.to_string()));
        }
        Ok(())
    }
}

/// Trains a detector from these weights on. With a checkpoint it goes on after an interruption, to the same end.
///
/// # Errors
/// Options out of range, no pictures, a checkpoint of another experiment, or a loss that is no number.
#[allow(clippy::too_many_arguments, reason = "an experiment has these parts")]
pub fn train(
    network: &Network,
    detection: &DetectionSpec,
    input: &InputSpec,
    pictures: &Pictures,
    options: &DetectorTraining,
    weights: Weights,
    file: Option<&Path>,
    ears: &mut Ears,
    news: &mut dyn FnMut(News),
) -> Result<Trained, LearnError> {
    options.check()?;
    if pictures.is_empty() {
        return Err(LearnError::NoFrames {
            what: "training".into(),
            help: "make some with `senda detector data`".into(),
        });
    }
    let same = DetectorTraining {
        threads: 0,
        ..options.clone()
    };
    let words = serde_json::to_vec(&(detection, input, &same, &pictures.truths)).unwrap_or_default();
    let fingerprint = checkpoint::fingerprint_of(
        &[network.to_toml().as_bytes(), &words, &pictures.pixels],
        &weights,
    );
    let mut trainer = Trainer::new(
        network.clone(),
        weights,
        TrainOptions {
            learning_rate: options.learning_rate as f32,
            threads: match options.threads {
                0 => rayon::current_num_threads(),
                threads => threads,
            },
            seed: options.seed,
            ..TrainOptions::default()
        },
    )?;
    let mut progress: Progress = match file {
        Some(path) => checkpoint::load(path, &fingerprint, &mut trainer)?.unwrap_or_default(),
        None => Progress::default(),
    };
    let loss = DetectionLoss::new(detection.clone(), [input.width, input.height]);
    let changes = Augmentation {
        mirror: 0.0,
        brightness: options.light,
        contrast: options.light,
        colour: 0.5 * options.light,
        shadow: 0.0,
        shift: 0.0,
        ..Augmentation::default()
    };
    let nothing = Answers { is_turn: Vec::new() };
    let shape = [input.channels(), input.height, input.width];
    let len = input.len();
    // A picture and its boxes, changed by what its own seed says, on whatever thread.
    let prepare = |number: u32, index: usize, values: &mut [f32], [bytes, source]: &mut [Vec<u8>; 2]| {
        bytes.clear();
        bytes.extend_from_slice(pictures.picture(index));
        let mut own = ChaCha8Rng::seed_from_u64(options.seed ^ u64::from(number) << 32);
        own.set_stream(index as u64 + 1);
        let boxes = jitter(
            options.jitter,
            shape,
            bytes,
            &pictures.truths[index],
            source,
            &mut own,
        );
        augment(&changes, shape, bytes, &mut [], &nothing, &mut own);
        input.normalise(bytes, values);
        boxes
    };
    let mut inputs: Vec<f32> = Vec::new();
    let mut order: Vec<usize> = Vec::new();
    let mut truths: Vec<Vec<Boxed>> = Vec::new();
    let steps = pictures.len().div_ceil(options.batch) as u64;
    let of = steps * u64::from(options.epochs);
    for number in progress.history.len() as u32 + 1..=options.epochs {
        order.clear();
        order.extend(0..pictures.len());
        let mut rng = ChaCha8Rng::seed_from_u64(options.seed);
        rng.set_stream(u64::from(number));
        order.shuffle(&mut rng);
        let (mut sum, mut count, mut learning_rate) = (0.0, 0usize, 0.0);
        for (step, batch) in order.chunks(options.batch).enumerate() {
            if (ears.interrupted)() {
                progress.interrupted = true;
                return Ok(progress.finish(trainer.weights()));
            }
            let done = u64::from(number - 1) * steps + step as u64;
            learning_rate = options.learning_rate * Schedule::Smooth.factor(done as f64 / of as f64);
            trainer.set_learning_rate(learning_rate as f32);
            inputs.resize(batch.len() * len, 0.0);
            batch
                .par_iter()
                .zip(inputs.par_chunks_exact_mut(len))
                .map_init(Default::default, |scratch, (index, values)| {
                    prepare(number, *index, values, scratch)
                })
                .collect_into_vec(&mut truths);
            let judge = |place: usize, output: &[f32], gradient: &mut [f32]| {
                loss.of(output, &truths[place], gradient)
            };
            let loss = f64::from(trainer.step_judged(&inputs, &judge));
            if !loss.is_finite() || !trainer.weights().fits(network) {
                return Err(LearnError::Diverged {
                    steps: done,
                    learning_rate,
                });
            }
            sum += loss * batch.len() as f64;
            count += batch.len();
            (ears.progress)((done + 1) as f64 / of as f64);
            news(News::Step {
                done: done + 1,
                of,
                loss: sum / count as f64,
            });
        }
        let epoch = Epoch {
            number,
            training_loss: sum / count.max(1) as f64,
            validation: None,
            learning_rate,
        };
        progress.epoch(epoch, trainer.weights());
        if let Some(path) = file {
            checkpoint::save(path, &fingerprint, &trainer, &progress)?;
        }
        news(News::Epoch(epoch));
    }
    Ok(progress.finish(trainer.weights()))
}
