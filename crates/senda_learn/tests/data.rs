//! From recordings to samples: what is damaged costs only itself, and labels follow camera and side.

mod support;

use senda_core::Explanation;
use senda_data::Recording;
use senda_drivers::Answer;
use senda_learn::gather::{Selection, recordings};
use senda_learn::{LearnError, Samples};
use senda_nets::InputSpec;
use senda_run::Scenario;
use std::path::PathBuf;
use support::{car, network, recording};

fn read(
    runs: &[Recording],
    answers: &[Answer],
    selection: &Selection,
) -> Result<(Samples, Vec<String>), LearnError> {
    let folder = tempfile::tempdir().unwrap();
    let paths: Vec<PathBuf> = (0..runs.len())
        .map(|number| folder.path().join(format!("{number}.mcap")))
        .collect();
    for (run, path) in runs.iter().zip(&paths) {
        run.save(path).unwrap();
    }
    let data = recordings(
        &paths,
        &car(),
        &InputSpec::of(network().input()),
        answers,
        selection,
        &mut |_, _| {},
    )?;
    // These recordings were put together by hand and have no summary; that is always said.
    let warnings = data
        .warnings
        .into_iter()
        .filter(|warning| !warning.contains("no summary"));
    Ok((data.samples, warnings.collect()))
}

fn everything() -> Selection {
    Selection {
        skip_first: 0,
        ..Selection::default()
    }
}

/// The part of top speed was learned as a throttle: a network that had learned to hold 8 m/s drove at 12.
#[test]
fn a_throttle_is_the_pedal_that_held_the_speed_and_its_absence_is_said() {
    let mut run = recording(5, "lake", &["center"]);
    run.header.scenario = Scenario::new("lake", "sedan", "manual").to_toml();
    let throttle =
        |run: &Recording| read(std::slice::from_ref(run), &[Answer::Throttle], &everything()).unwrap();
    let (_, warnings) = throttle(&run);
    assert!(
        warnings.len() == 1 && warnings[0].contains("part of top speed"),
        "{warnings:?}"
    );
    for step in &mut run.steps {
        step.explanation.signal(Explanation::PEDAL, 0.04);
    }
    let (samples, warnings) = throttle(&run);
    assert!(warnings.is_empty(), "{warnings:?}");
    assert_eq!(samples.target(0), [0.04]);
}

#[test]
fn labels_are_the_steering_as_part_of_full_lock() {
    let (samples, warnings) = read(
        &[recording(20, "oval", &["center"])],
        &[Answer::Steering, Answer::Speed],
        &everything(),
    )
    .unwrap();
    assert!(warnings.is_empty(), "{warnings:?}");
    assert_eq!(samples.len(), 20);
    assert_eq!(samples.runs[0].world, "oval");
    for number in 0..20 {
        assert!((samples.target(number)[0] - 0.01 * number as f32).abs() < 1e-6);
        assert!((samples.target(number)[1] - 0.5).abs() < 1e-6);
    }
}

#[test]
fn damaged_pictures_cost_only_themselves() {
    let mut damaged = recording(20, "oval", &["center"]);
    damaged.steps[5].frames[0].encoded.bytes.truncate(40);
    damaged.steps[9].frames[0].encoded.bytes = b"no picture at all".to_vec();
    let (whole, _) = read(
        &[recording(20, "oval", &["center"])],
        &[Answer::Steering],
        &everything(),
    )
    .unwrap();
    let (samples, warnings) = read(&[damaged], &[Answer::Steering], &everything()).unwrap();
    assert_eq!(samples.len(), 18);
    assert!(
        warnings.iter().any(|warning| warning.contains("2 frames")),
        "{warnings:?}"
    );
    for (number, original) in (0..20).filter(|n| ![5, 9].contains(n)).enumerate() {
        assert_eq!(samples.frame(number), whole.frame(original));
        assert_eq!(samples.target(number), whole.target(original));
    }
}

#[test]
fn the_beginning_the_end_and_standing_still_are_left_out() {
    let mut run = recording(20, "oval", &["center"]);
    for step in &mut run.steps[10..13] {
        step.command.drive = senda_core::Drive::SpeedMps(0.0);
    }
    let selection = Selection {
        skip_first: 3,
        skip_last: 2,
        ..Selection::default()
    };
    let (samples, _) = read(&[run], &[Answer::Steering], &selection).unwrap();
    assert_eq!(samples.len(), 20 - 3 - 2 - 3);
    assert!((samples.target(0)[0] - 0.03).abs() < 1e-6);
    let (short, _) = read(
        &[recording(2, "oval", &["center"])],
        &[Answer::Steering],
        &selection,
    )
    .unwrap();
    assert!(short.is_empty() && short.runs.is_empty());
}

/// Pictures with the angle in their names tell neither speed nor throttle. That was taken for standing, and nothing was left.
#[test]
fn what_says_nothing_of_motion_is_not_taken_for_standing() {
    let mut silent = recording(12, "oval", &["center"]);
    for step in &mut silent.steps {
        step.command.drive = senda_core::Drive::Throttle(0.0);
        step.speed_mps = None;
    }
    let (samples, warnings) = read(&[silent.clone()], &[Answer::Steering], &everything()).unwrap();
    assert_eq!(samples.len(), 12);
    assert!(warnings[0].contains("neither speed nor throttle"), "{warnings:?}");
    // One pedal says that there is a throttle, and then its absence is standing.
    silent.steps[3].command.drive = senda_core::Drive::Throttle(0.2);
    let (samples, warnings) = read(&[silent], &[Answer::Steering], &everything()).unwrap();
    assert_eq!((samples.len(), warnings.len()), (1, 0), "{warnings:?}");
}

#[test]
fn where_no_frame_is_left_the_reasons_are_counted() {
    let mut run = recording(9, "oval", &["center"]);
    for step in &mut run.steps[..6] {
        step.command.drive = senda_core::Drive::SpeedMps(0.0);
    }
    run.steps[6].frames.clear();
    run.steps[7].frames[0].encoded.bytes.truncate(40);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    run.save(&path).unwrap();
    let selection = Selection {
        skip_first: 2,
        skip_last: 1,
        ..Selection::default()
    };
    let input = InputSpec::of(network().input());
    let paths = [path];
    let data = recordings(
        &paths,
        &car(),
        &input,
        &[Answer::Steering],
        &selection,
        &mut |_, _| {},
    )
    .unwrap();
    assert!(data.used.is_empty());
    let message = data.expect_frames(&paths).unwrap_err().to_string();
    for words in [
        "a.mcap",
        "of 9 recorded",
        "3 lie at the ends",
        "4 were taken while",
        "1 have no picture",
        "1 cannot be read",
    ] {
        assert!(message.contains(words), "{message}");
    }
    assert!(
        data.warnings
            .iter()
            .any(|warning| warning.contains("none of its frames"))
    );
}

#[test]
fn what_is_named_twice_counts_once() {
    let folder = tempfile::tempdir().unwrap();
    let runs = folder.path().join("runs");
    std::fs::create_dir(&runs).unwrap();
    for name in ["a.mcap", "b.mcap"] {
        recording(10, "oval", &["center"]).save(&runs.join(name)).unwrap();
    }
    let input = InputSpec::of(network().input());
    let read = |paths: &[PathBuf]| {
        recordings(
            paths,
            &car(),
            &input,
            &[Answer::Steering],
            &everything(),
            &mut |_, _| {},
        )
        .unwrap()
    };
    let once = read(std::slice::from_ref(&runs));
    let again = read(&[runs.clone(), runs.join("../runs"), runs.join("b.mcap")]);
    assert_eq!(again.samples, once.samples);
    assert_eq!(again.used, [runs]);
    let twice = |warning: &&String| warning.contains("named twice");
    assert_eq!(again.warnings.iter().filter(twice).count(), 3);
}

/// Standing, broken and lost frames leave gaps that no sequence goes on across.
#[test]
fn stretches_end_where_frames_were_left_out_or_lost() {
    let mut run = recording(24, "oval", &["center"]);
    run.steps[5].command.drive = senda_core::Drive::SpeedMps(0.0);
    run.steps[9].frames[0].encoded.bytes.truncate(30);
    run.steps[14].frames.clear();
    run.steps.remove(20);
    let (samples, _) = read(
        &[run, recording(3, "oval", &["center"])],
        &[Answer::Steering],
        &everything(),
    )
    .unwrap();
    assert_eq!(samples.runs.len(), 2);
    assert_eq!(samples.stretches(), [0..5, 5..8, 8..12, 12..17, 17..20, 20..23]);
}

/// Braking into a curve teaches as much as driving through it (B5); only a car that does not move stands.
#[test]
fn a_car_that_brakes_or_coasts_is_not_standing() {
    let mut run = recording(12, "lake", &["center"]);
    for (number, step) in run.steps.iter_mut().enumerate() {
        let pedal = [0.4, 0.0, -0.3][number % 3];
        step.command.drive = senda_core::Drive::Throttle(pedal);
        step.speed_mps = Some(if number < 9 { 8.0 } else { 0.0 });
    }
    let selection = Selection {
        skip_first: 0,
        ..Selection::default()
    };
    let (samples, _) = read(&[run], &[Answer::Steering, Answer::Throttle], &selection).unwrap();
    // The last three are at a standstill, and one of them pulls away.
    assert_eq!(samples.len(), 10);
    assert!((samples.target(2)[1] + 0.3).abs() < 1e-6);
}

/// B5: from the left camera's place the way back is to the right, which is negative.
#[test]
fn side_cameras_teach_the_way_back() {
    let run = recording(10, "oval", &["center", "left", "right"]);
    let (one, _) = read(std::slice::from_ref(&run), &[Answer::Steering], &everything()).unwrap();
    assert_eq!(one.len(), 10);
    let selection = Selection {
        side_camera_shift: 0.2,
        ..everything()
    };
    let (three, _) = read(&[run], &[Answer::Steering, Answer::Speed], &selection).unwrap();
    assert_eq!((three.len(), three.runs.len()), (30, 3));
    for number in 0..10 {
        let own = three.target(number)[0];
        assert!((three.target(10 + number)[0] - (own - 0.2)).abs() < 1e-6, "left");
        assert!((three.target(20 + number)[0] - (own + 0.2)).abs() < 1e-6, "right");
        assert_eq!(three.target(10 + number)[1], three.target(number)[1], "speed");
    }
    assert!(three.runs.iter().all(|run| run.world == "oval"));
}

/// A top speed of nothing makes the part of it that is driven infinite.
#[test]
fn a_label_out_of_range_costs_only_its_frame() {
    let mut run = recording(6, "oval", &["center"]);
    run.header.body.speed_limit_mps = 1e-3;
    run.steps[2].command.drive = senda_core::Drive::SpeedMps(0.001);
    let (samples, warnings) = read(&[run], &[Answer::Steering, Answer::Speed], &everything()).unwrap();
    assert!(
        samples.targets.iter().all(|target| target.abs() <= 10.0),
        "{:?}",
        samples.targets
    );
    assert_eq!(samples.len() == 6, warnings.is_empty(), "{warnings:?}");
}
