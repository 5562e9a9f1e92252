//! Edits beside data, what looks suspicious in them, and what is written for other programs.

mod support;

use senda_core::{Command, Turn};
use senda_data::stats::Suspicion;
use senda_data::{
    Edits, Format, Recording, export, named_frames, open_edited_runs, open_runs, stats, tub, udacity,
};
use std::fs;
use std::path::{Path, PathBuf};
use support::{car, recording};

/// A folder with `run.mcap` of so many steps, all steering `angle(step)` radians.
fn recorded(steps: usize, angle: impl Fn(usize) -> f64) -> (tempfile::TempDir, PathBuf, Recording) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.mcap");
    let mut run = recording(steps);
    for (number, step) in run.steps.iter_mut().enumerate() {
        step.command = Command::steering(angle(number), 0.5);
    }
    run.save(&path).unwrap();
    (folder, path, run)
}

#[test]
fn edits_leave_frames_out_and_correct_labels_and_the_recording_stays_as_it_is() {
    let (_folder, path, run) = recorded(10, |_| 0.1);
    let before = fs::read(&path).unwrap();
    let mut edits = Edits::default();
    edits.drop_steps(0, 0, 3);
    edits.correct(0, 5, -10.0);
    edits.save(&path).unwrap();
    let edited = open_edited_runs(&path, &car()).unwrap();
    assert_eq!(edited[0].steps.len(), 7);
    assert_eq!(edited[0].steps[0].stamp, run.steps[3].stamp);
    assert_eq!(
        edited[0].steps[2].command.turn,
        Turn::SteeringRad(-10f64.to_radians())
    );
    assert_eq!(edited[0].steps[3].command.turn, Turn::SteeringRad(0.1));
    assert_eq!(fs::read(&path).unwrap(), before);
    assert_eq!(open_runs(&path, &car()).unwrap()[0].steps.len(), 10);
}

#[test]
fn edits_that_do_not_fit_the_data_are_warned_of_and_broken_files_named() {
    let (_folder, path, _) = recorded(4, |_| 0.0);
    let mut edits = Edits::default();
    edits.steps = vec![40];
    edits.drop_steps(0, 30, 40);
    edits.correct(0, 35, 1.0);
    edits.save(&path).unwrap();
    let run = open_edited_runs(&path, &car()).unwrap().remove(0);
    assert_eq!(run.steps.len(), 4);
    let warnings = run.warnings.join("\n");
    assert!(
        warnings.contains("made for 40 steps") && warnings.contains("2 edits"),
        "{warnings}"
    );
    fs::write(
        Edits::path_of(&path),
        "version = 1\n[[drop]]\nfrom = 1\nto = \"x\"\n",
    )
    .unwrap();
    let message = open_edited_runs(&path, &car()).unwrap_err().to_string();
    assert!(
        message.contains("run.mcap.edits.toml") && message.contains("line 4"),
        "{message}"
    );
}

#[test]
fn every_recording_of_a_folder_and_every_run_of_a_foreign_set_has_edits_of_its_own() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["a.mcap", "b.mcap"] {
        recording(6).save(&folder.path().join(name)).unwrap();
    }
    let mut edits = Edits::default();
    edits.drop_steps(0, 0, 2);
    edits.save(&folder.path().join("b.mcap")).unwrap();
    let lengths = |path: &Path| -> Vec<usize> {
        let runs = open_edited_runs(path, &car()).unwrap();
        runs.iter().map(|run| run.steps.len()).collect()
    };
    assert_eq!(lengths(folder.path()), [6, 4]);

    let set = folder.path().join("named");
    for run in ["v010000", "v020000"] {
        named_frames::write(&recording(6), &set, run).unwrap();
    }
    let mut edits = Edits::default();
    edits.drop_steps(1, 5, 6);
    edits.save(&set).unwrap();
    assert!(folder.path().join("named.edits.toml").exists());
    assert_eq!(lengths(&set), [6, 5]);
}

#[test]
fn figures_are_those_of_what_is_kept() {
    let (_folder, path, _) = recorded(10, |number| if number < 5 { 0.0 } else { 0.2 });
    let all = stats(&path, &car()).unwrap();
    assert_eq!((all.kept, all.recorded), (10, 10));
    assert!((all.straight_share - 0.5).abs() < 1e-9);
    assert!((all.duration_s - 0.45).abs() < 1e-6, "{}", all.duration_s);
    assert!((all.steering.mean_rad - 0.1).abs() < 1e-9);
    let mut edits = Edits::default();
    edits.drop_steps(0, 0, 5);
    edits.correct(0, 9, 0.0);
    edits.save(&path).unwrap();
    let kept = stats(&path, &car()).unwrap();
    assert_eq!((kept.kept, kept.corrected), (5, 1));
    assert!((kept.straight_share - 0.2).abs() < 1e-9);
    assert!((kept.steering.mean_rad - 0.16).abs() < 1e-9);
    assert!((kept.speeds.mean_mps - 0.5).abs() < 1e-9);
    assert_eq!(kept.steering.counts.iter().sum::<usize>(), 5);
}

#[test]
fn suspicious_frames_are_found_by_their_recorded_number() {
    let (_folder, path, mut run) = recorded(9, |number| if number == 7 { 0.6 } else { 0.0 });
    run.steps[2].frames[0].encoded.bytes.truncate(40);
    run.steps[4].frames[0].encoded = run.steps[3].frames[0].encoded.clone();
    run.steps[5].frames.clear();
    run.save(&path).unwrap();
    let mut edits = Edits::default();
    edits.drop_steps(0, 0, 2);
    edits.save(&path).unwrap();
    let found: Vec<_> = stats(&path, &car())
        .unwrap()
        .suspicious
        .iter()
        .map(|found| (found.step, found.why))
        .collect();
    assert_eq!(
        found,
        [
            (2, Suspicion::BrokenImage),
            (4, Suspicion::RepeatedImage),
            (5, Suspicion::NoImage),
            (7, Suspicion::BeyondLock),
        ]
    );
    // What was dropped or corrected is nobody's worry.
    edits.drop_steps(0, 2, 6);
    edits.correct(0, 7, 5.0);
    edits.save(&path).unwrap();
    assert_eq!(stats(&path, &car()).unwrap().suspicious, []);
}

#[test]
fn empty_and_one_frame_sets_have_figures() {
    for steps in [0, 1] {
        let (_folder, path, _) = recorded(steps, |_| 0.1);
        let stats = stats(&path, &car()).unwrap();
        assert_eq!((stats.kept, stats.duration_s), (steps, 0.0));
        assert!(stats.straight_share == 0.0 && stats.steering.mean_rad.is_finite());
        assert!(stats.to_string().contains("steps"));
    }
}

#[test]
fn what_is_exported_is_what_the_edits_left_in_every_format() {
    for (format, precision_rad) in [
        (Format::Tub, 1e-9),
        (Format::Udacity, 1e-9),
        (Format::NamedFrames, 0.5 / 50.0 * 0.4 + 1e-9),
    ] {
        let (folder, path, _) = recorded(8, |number| 0.02 * number as f64);
        let mut edits = Edits::default();
        edits.drop_steps(0, 0, 2);
        edits.correct(0, 7, -10.0);
        edits.save(&path).unwrap();
        let to = folder.path().join("out");
        let written = export(&path, &car(), format, &to).unwrap();
        assert_eq!(written.iter().map(|run| run.frames).sum::<usize>(), 6);
        let again = match format {
            Format::Tub => tub::read(&to, &car()),
            Format::Udacity => udacity::read(&to, &car()),
            _ => named_frames::read(&to, &car()),
        }
        .unwrap();
        let expected = [0.04, 0.06, 0.08, 0.10, 0.12, -10f64.to_radians()];
        for (step, expected) in again.steps.iter().zip(expected) {
            let angle = car().steering_of(step.command.turn, 0.5);
            assert!(
                (angle - expected).abs() <= precision_rad,
                "{format:?}: {angle} {expected}"
            );
        }
        let message = export(&path, &car(), format, &to).unwrap_err().to_string();
        assert!(message.contains("new or empty folder"), "{message}");
    }
}

/// A small car's full lock is more than the 25° of the Udacity format: its curves were cut off without a word.
#[test]
fn labels_that_a_format_cannot_hold_are_counted() {
    let (folder, path, mut run) = recorded(8, |number| 0.1 * number as f64);
    // 0.5, 0.6 and 0.7 rad are more than 25°.
    run.header.body.steering = senda_core::Steering::Ackermann {
        wheelbase_m: 0.17,
        steering_limit_rad: 0.8,
    };
    run.save(&path).unwrap();
    let told = |format: Format| {
        let to = folder.path().join(format.name());
        export(&path, &car(), format, &to).unwrap()[0].warnings.join("\n")
    };
    assert!(told(Format::Udacity).contains("3 of 8 labels"));
    assert!(!told(Format::Tub).contains("labels"));
}

#[test]
fn the_real_tub_is_looked_through() {
    let Some(path) = support::shared("donkeycar_warehouse_tub.tar.gz") else {
        return;
    };
    let stats = stats(&path, &car()).unwrap();
    assert_eq!(stats.kept, stats.steering.counts.iter().sum::<usize>());
    assert!(stats.kept > 500 && stats.straight_share < 1.0, "{stats}");
}
