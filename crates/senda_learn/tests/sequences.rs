//! Networks with a memory learn from runs in their order; what they remember never crosses a run's end or a gap.

mod support;

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use senda_learn::train::{Lesson, Trained};
use senda_learn::{Answers, Augmentation, LearnError, Samples, Training};
use senda_nets::{Initialisation, InputSpec, Network, Weights};
use senda_run::Ears;
use std::cell::Cell;
use std::path::Path;

/// Sees four pixels; remembers in three channels.
const NETWORK: &str = r#"
[input]
height = 2
width = 2
channels = 1

[[layer]]
kind = "convolutional_lstm"
filters = 3
kernel = 1
padding = "same"

[[layer]]
kind = "flatten"

[[layer]]
kind = "dense"
units = 1
"#;

fn network() -> Network {
    Network::parse("memory.toml", NETWORK).unwrap()
}

fn first_weights() -> Weights {
    Weights::initialised(&network(), Initialisation::Glorot, 5)
}

/// Runs of frames that are dark or bright at random. The answer is how bright the frame before was, which no frame shows.
fn brightness(runs: usize, frames: usize, seed: u64) -> Samples {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut samples = Samples::new(4, 1);
    for _ in 0..runs {
        samples.begin_run("flicker", "");
        let mut before = 0.0;
        for _ in 0..frames {
            let is_bright: bool = rng.random();
            samples.push(&[if is_bright { 230 } else { 20 }; 4], &[before]);
            before = if is_bright { 0.5 } else { -0.5 };
        }
    }
    samples
}

fn options(sequence: usize) -> Training {
    Training {
        epochs: 3,
        batch: 5,
        sequence,
        learning_rate: 0.02,
        augmentation: Augmentation::default(),
        threads: 1,
        ..Training::default()
    }
}

fn train(
    training: &Samples,
    validation: &Samples,
    options: &Training,
    checkpoint: Option<&Path>,
    interrupted: &dyn Fn() -> bool,
) -> Result<Trained, LearnError> {
    let network = network();
    let mut ears = Ears {
        progress: Box::new(|_| {}),
        interrupted: Box::new(interrupted),
        clock_ns: Box::new(|| 0),
    };
    senda_learn::train(
        &Lesson {
            input: &InputSpec::of(network.input()),
            network: &network,
            answers: &Answers { is_turn: vec![false] },
            training,
            validation,
            options,
            checkpoint,
        },
        first_weights(),
        &mut ears,
        &mut |_| {},
    )
}

fn whole(training: &Samples, options: &Training) -> Trained {
    train(training, &brightness(3, 15, 9), options, None, &|| false).unwrap()
}

/// The kernel that reads the state: it learns only where there is one.
fn memory_kernel(weights: &Weights) -> Vec<f32> {
    let network = network();
    let tensor = network
        .tensors()
        .find(|tensor| tensor.name.ends_with("recurrent_weight"));
    weights.values[tensor.unwrap().range()].to_vec()
}

#[test]
fn what_only_a_memory_can_answer_is_learned_in_sequences_and_not_from_single_frames() {
    let error = |sequence| {
        let options = Training {
            epochs: 40,
            augmentation: Augmentation::NONE,
            ..options(sequence)
        };
        let trained = whole(&brightness(12, 40, 1), &options);
        let best = trained.history[trained.best_epoch as usize - 1];
        best.validation.unwrap().mean_absolute
    };
    let (with, without) = (error(8), error(1));
    assert!(with < 0.1, "with memory: {with}");
    assert!(without > 0.4, "without memory: {without}");
}

#[test]
fn runs_of_one_frame_and_frames_with_gaps_between_teach_the_memory_nothing() {
    let first = memory_kernel(&first_weights());
    let long = brightness(2, 30, 1);
    assert_ne!(memory_kernel(&whole(&long, &options(8)).weights), first);
    let mut gaps = Samples::new(4, 1);
    gaps.begin_run("gaps", "");
    for frame in 0..long.len() {
        gaps.skip();
        gaps.push(long.frame(frame), long.target(frame));
    }
    for apart in [brightness(60, 1, 1), gaps] {
        let trained = whole(&apart, &options(8));
        assert_ne!(trained.weights, first_weights());
        assert_eq!(memory_kernel(&trained.weights), first);
    }
}

#[test]
fn a_sequence_of_one_is_frame_by_frame_without_memory() {
    let frames = brightness(1, 60, 1);
    let single = whole(&frames, &options(1));
    assert_eq!(memory_kernel(&single.weights), memory_kernel(&first_weights()));
    // Which frame follows which does not matter, then.
    let mut apart = Samples::new(4, 1);
    for frame in 0..frames.len() {
        apart.begin_run("alone", "");
        apart.push(frames.frame(frame), frames.target(frame));
    }
    let network = network();
    assert_eq!(whole(&apart, &options(1)), single);
    assert!(options(1).forgets(&network) && !options(2).forgets(&network));
    assert!(options(2).is_ordered(&network) && !options(2).is_ordered(&support::network()));
}

/// A network without a memory does not mind: the key has a default that recurrent ones need.
#[test]
fn networks_without_a_memory_learn_from_single_frames_whatever_the_sequence() {
    let run = |sequence| {
        let options = Training {
            sequence,
            ..support::options()
        };
        support::train(
            &support::samples(20),
            &support::samples(5),
            &options,
            None,
            &|| false,
        )
        .unwrap()
    };
    assert_eq!(run(1), run(16));
}

#[test]
fn threads_change_nothing_and_interrupted_before_any_step_it_ends_the_same() {
    let training = brightness(4, 33, 1);
    let expected = whole(&training, &options(8));
    for threads in [2, 3] {
        let options = Training {
            threads,
            ..options(8)
        };
        assert_eq!(whole(&training, &options), expected, "{threads} threads");
    }
    let mut steps = 0u32;
    loop {
        let folder = tempfile::tempdir().unwrap();
        let checkpoint = folder.path().join("checkpoint");
        let left = Cell::new(steps);
        let validation = brightness(3, 15, 9);
        let interrupted = || left.replace(left.get().saturating_sub(1)) == 0;
        let run = |threads, interrupted: &dyn Fn() -> bool| {
            let options = Training {
                threads,
                ..options(8)
            };
            train(&training, &validation, &options, Some(&checkpoint), interrupted).unwrap()
        };
        if !run(1, &interrupted).interrupted {
            break;
        }
        assert_eq!(run(2, &|| false), expected, "interrupted before step {steps}");
        steps += 1;
    }
    assert!(steps > 9, "{steps}");
}

#[test]
fn runs_are_judged_with_the_memory_of_their_own_past_only() {
    let judge = |runs: &[&Samples]| {
        let mut all = Samples::new(4, 1);
        for run in runs {
            all.append(run);
        }
        train(&brightness(4, 33, 1), &all, &options(8), None, &|| false)
            .unwrap()
            .history[0]
            .validation
            .unwrap()
            .mean_squared
    };
    let (a, b) = (brightness(1, 20, 3), brightness(1, 20, 4));
    let mean = 0.5 * (judge(&[&a]) + judge(&[&b]));
    assert!((judge(&[&a, &b]) - mean).abs() < 1e-12);
    assert!((judge(&[&b, &a]) - mean).abs() < 1e-12);
}

#[test]
fn a_checkpoint_of_runs_that_were_cut_otherwise_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let checkpoint = folder.path().join("checkpoint");
    let one = brightness(1, 40, 1);
    let mut cut = one.part(|_| 0..20);
    cut.append(&one.part(|_| 20..40));
    assert_eq!(cut.pixels, one.pixels);
    let run = |training: &Samples| {
        let none = Samples::new(4, 1);
        train(training, &none, &options(8), Some(&checkpoint), &|| false)
    };
    run(&one).unwrap();
    let message = run(&cut).unwrap_err().to_string();
    assert!(message.contains("others"), "{message}");
}
