//! Training gives the same weights however often, on however many threads, and however often it is interrupted.

mod support;

use senda_learn::train::Trained;
use senda_learn::{Samples, Training};
use std::cell::Cell;
use support::{options, samples, train, train_from};

fn none() -> Samples {
    Samples::new(8 * 12, 1)
}

fn whole(options: &Training) -> Trained {
    train(&samples(50), &samples(10), options, None, &|| false).unwrap()
}

#[test]
fn twice_and_on_any_number_of_threads_the_same_weights() {
    let first = whole(&options());
    assert_eq!(first.history.len(), 3);
    for threads in [1, 2, 3] {
        let again = whole(&Training { threads, ..options() });
        assert_eq!(again, first, "{threads} threads");
    }
    let other = whole(&Training { seed: 2, ..options() });
    assert_ne!(other.weights, first.weights);
}

#[test]
fn it_learns() {
    let trained = train(
        &samples(48),
        &samples(12),
        &Training {
            epochs: 80,
            learning_rate: 5e-3,
            augmentation: senda_learn::Augmentation::MIRROR,
            ..options()
        },
        None,
        &|| false,
    )
    .unwrap();
    let last = trained.history.last().unwrap().validation.unwrap();
    assert!(
        last.mean_absolute < 0.5 * last.of_constant_median && last.correlation > 0.8,
        "{last:?}"
    );
}

/// 50 frames in batches of 8 are 7 steps an epoch, 21 in all. Killed before each of them: in the middle of an epoch, at its
/// end, before the first.
#[test]
fn interrupted_before_any_step_and_resumed_it_ends_the_same() {
    let expected = whole(&options());
    for steps in 0..21u32 {
        let folder = tempfile::tempdir().unwrap();
        let checkpoint = folder.path().join("checkpoint");
        let (training, validation) = (samples(50), samples(10));
        let left = Cell::new(steps);
        let interrupted = || left.replace(left.get().saturating_sub(1)) == 0;
        let first = train(
            &training,
            &validation,
            &options(),
            Some(&checkpoint),
            &interrupted,
        )
        .unwrap();
        assert!(first.interrupted);
        assert_eq!(checkpoint.exists(), steps >= 7, "after {steps} steps");
        let resumed = train(
            &training,
            &validation,
            &Training {
                threads: 2,
                ..options()
            },
            Some(&checkpoint),
            &|| false,
        )
        .unwrap();
        assert_eq!(resumed, expected, "interrupted before step {steps}");
    }
}

/// What broke: the first weights were not compared, so fine-tuning a second model in a used folder went on with the first.
#[test]
fn a_checkpoint_of_another_experiment_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let checkpoint = folder.path().join("checkpoint");
    let (training, validation) = (samples(50), samples(10));
    let run = |first, frames: &Samples, options: &Training| {
        train_from(first, frames, &validation, options, Some(&checkpoint), &|| false)
    };
    run(7, &training, &options()).unwrap();
    let others = [
        run(8, &training, &options()),
        run(7, &samples(49), &options()),
        run(
            7,
            &training,
            &Training {
                batch: 9,
                ..options()
            },
        ),
    ];
    for other in others {
        let message = other.unwrap_err().to_string();
        assert!(
            message.contains("checkpoint")
                && message.contains("others")
                && message.contains("another folder"),
            "{message}"
        );
    }
}

#[test]
fn a_checkpoint_cut_short_or_foreign_is_refused_with_words() {
    let folder = tempfile::tempdir().unwrap();
    let checkpoint = folder.path().join("checkpoint");
    let frames = samples(16);
    let run = || train(&frames, &none(), &options(), Some(&checkpoint), &|| false);
    run().unwrap();
    let good = std::fs::read(&checkpoint).unwrap();
    for length in (0..good.len()).step_by(37) {
        std::fs::write(&checkpoint, &good[..length]).unwrap();
        let message = run().unwrap_err().to_string();
        assert!(
            message.contains("checkpoint") && message.contains("delete it"),
            "{length}: {message}"
        );
    }
    std::fs::write(&checkpoint, "a shopping list, and nothing else").unwrap();
    assert!(run().unwrap_err().to_string().contains("no checkpoint at all"));
    std::fs::write(&checkpoint, &good).unwrap();
    run().unwrap();
}

/// A bit that the disk lost among the weights was learned on from.
#[test]
fn a_checkpoint_with_one_other_bit_or_of_an_older_version_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let checkpoint = folder.path().join("checkpoint");
    let frames = samples(16);
    let run = || train(&frames, &none(), &options(), Some(&checkpoint), &|| false);
    run().unwrap();
    let good = std::fs::read(&checkpoint).unwrap();
    for at in (0..good.len()).step_by(101).chain([good.len() - 1]) {
        let mut bytes = good.clone();
        bytes[at] ^= 1;
        std::fs::write(&checkpoint, &bytes).unwrap();
        let message = run().unwrap_err().to_string();
        assert!(message.contains("delete it"), "byte {at}: {message}");
    }
    let at = good
        .windows(11)
        .position(|bytes| bytes == b"\"version\":2")
        .unwrap();
    let mut older = good.clone();
    older[at + 10] = b'1';
    std::fs::write(&checkpoint, &older).unwrap();
    let message = run().unwrap_err().to_string();
    assert!(
        message.contains("it has version 1 and this program reads 2"),
        "{message}"
    );
    std::fs::write(&checkpoint, &good).unwrap();
    run().unwrap();
}

/// A folder where the partial file should go stands for a disk that takes nothing more.
#[test]
fn what_cannot_be_saved_leaves_the_last_good_checkpoint() {
    let folder = tempfile::tempdir().unwrap();
    let checkpoint = folder.path().join("checkpoint");
    let frames = samples(16);
    let steps = Cell::new(2);
    let after_an_epoch = || steps.replace(steps.get() - 1) == 0;
    train(&frames, &none(), &options(), Some(&checkpoint), &after_an_epoch).unwrap();
    let good = std::fs::read(&checkpoint).unwrap();
    let obstacle = folder.path().join("checkpoint.partial");
    std::fs::create_dir(&obstacle).unwrap();
    let error = train(&frames, &none(), &options(), Some(&checkpoint), &|| false).unwrap_err();
    assert!(error.to_string().contains("checkpoint"), "{error}");
    assert_eq!(std::fs::read(&checkpoint).unwrap(), good);
    std::fs::remove_dir(&obstacle).unwrap();
    let resumed = train(&frames, &none(), &options(), Some(&checkpoint), &|| false).unwrap();
    let expected = train(&frames, &none(), &options(), None, &|| false).unwrap();
    assert_eq!(resumed, expected);
}

#[test]
fn no_frames_are_an_error_and_one_frame_is_enough() {
    let message = train(&none(), &none(), &options(), None, &|| false)
        .unwrap_err()
        .to_string();
    assert!(
        message.contains("none") && message.contains("record"),
        "{message}"
    );
    let one = train(&samples(1), &none(), &options(), None, &|| false).unwrap();
    assert!(one.weights.values.iter().all(|value| value.is_finite()));
    let judged = train(&samples(1), &samples(1), &options(), None, &|| false).unwrap();
    assert_eq!(judged.history[0].validation.unwrap().correlation, 0.0);
}

#[test]
fn labels_that_are_no_numbers_or_far_out_of_range_are_refused_by_place() {
    for wrong in [f32::NAN, f32::INFINITY, -11.0, 1e30] {
        let mut bad = samples(8);
        bad.begin_run("second", "");
        bad.push(&[0; 96], &[0.0]);
        bad.push(&[0; 96], &[wrong]);
        for (training, validation) in [(&bad, &none()), (&samples(8), &bad)] {
            let message = train(training, validation, &options(), None, &|| false)
                .unwrap_err()
                .to_string();
            assert!(
                message.contains("run second, frame 1") && message.contains("label"),
                "{message}"
            );
        }
    }
}

#[test]
fn a_learning_rate_that_is_too_high_is_an_error_or_ends_with_numbers() {
    let wild = Training {
        learning_rate: 10.0,
        epochs: 30,
        ..options()
    };
    match train(&samples(20), &none(), &wild, None, &|| false) {
        Ok(trained) => assert!(
            trained
                .history
                .iter()
                .all(|epoch| epoch.training_loss.is_finite())
        ),
        Err(error) => assert!(error.to_string().contains("learning rate"), "{error}"),
    }
}

#[test]
fn patience_ends_training_and_the_best_epoch_is_kept() {
    let patient = Training {
        epochs: 60,
        patience: 2,
        learning_rate: 0.02,
        ..options()
    };
    let trained = train(&samples(20), &samples(5), &patient, None, &|| false).unwrap();
    let error = |number: u32| {
        trained.history[number as usize - 1]
            .validation
            .unwrap()
            .mean_squared
    };
    let best = trained.best_epoch;
    assert!((1..=trained.history.len() as u32).all(|number| error(best) <= error(number)));
    assert!(trained.history.len() < 60);
    assert_eq!(trained.history.len() as u32, best + 2);
}
