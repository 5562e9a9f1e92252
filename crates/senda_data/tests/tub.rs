//! Donkeycar tubs, good and bad.

mod support;

use senda_core::{Command, Drive, Observation, Stamp, Turn, Vehicle};
use senda_data::tub::{self, TubOptions};
use senda_data::{Recording, Replay};
use std::fs;
use std::path::Path;
use support::{car, recording};

/// A tub of so many records in a folder, as Donkeycar writes it, with a change to its catalog.
fn tub_folder(folder: &Path, records: usize, change: impl Fn(String) -> String) {
    fs::create_dir_all(folder.join("images")).unwrap();
    let mut catalog = String::new();
    for i in 0..records {
        let angle = ((i % 11) as f64 - 5.0) / 10.0;
        catalog += &format!(
            "{{\"_index\": {i}, \"_session_id\": \"22-11-29_0\", \"_timestamp_ms\": {}, \"cam/image_array\": \"{i}_cam_image_array_.jpg\", \"user/angle\": {angle}, \"user/mode\": \"user\", \"user/throttle\": 0.25}}\n",
            1_669_759_744_666u64 + 50 * i as u64
        );
        let jpeg = senda_core::codec::encode_jpeg(&support::picture(16, 12, i), 80).unwrap();
        fs::write(
            folder.join(format!("images/{i}_cam_image_array_.jpg")),
            jpeg.bytes,
        )
        .unwrap();
    }
    fs::write(folder.join("catalog_0.catalog"), change(catalog)).unwrap();
    let manifest = "[\"cam/image_array\", \"user/angle\", \"user/throttle\", \"user/mode\"]\n[\"image_array\", \"float\", \"float\", \"str\"]\n{}\n{\"created_at\": 1.5}\n{\"paths\": [\"catalog_0.catalog\"], \"current_index\": 10, \"max_len\": 1000, \"deleted_indexes\": [2]}\n";
    fs::write(folder.join("manifest.json"), manifest).unwrap();
}

/// Reads a changed tub of ten records (number 2 deleted) and checks the indexes that are left, by their angles, and the
/// words of the warnings.
fn check(change: impl Fn(String) -> String, also: impl Fn(&Path), left: &[usize], words: &[&str]) {
    let folder = tempfile::tempdir().unwrap();
    tub_folder(folder.path(), 10, change);
    also(folder.path());
    let recording = tub::read(folder.path(), &car()).unwrap();
    let found: Vec<_> = recording
        .steps
        .iter()
        .map(|step| match step.command.turn {
            Turn::SteeringRad(angle) => ((-angle / 0.4 + 0.5) * 10.0).round() as usize,
            other => panic!("{other:?}"),
        })
        .collect();
    assert_eq!(found, left);
    for word in words {
        assert!(
            recording.warnings.iter().any(|w| w.contains(word)),
            "expected {word:?} in {:#?}",
            recording.warnings
        );
    }
    if words.is_empty() {
        assert_eq!(recording.warnings.len(), 1, "{:#?}", recording.warnings);
    }
}

const WITHOUT_2: [usize; 9] = [0, 1, 3, 4, 5, 6, 7, 8, 9];

#[test]
fn a_good_tub_with_a_deleted_record() {
    check(|c| c, |_| {}, &WITHOUT_2, &["1 records are marked as deleted"]);
    let folder = tempfile::tempdir().unwrap();
    tub_folder(folder.path(), 10, |c| c);
    let recording = tub::read(folder.path(), &car()).unwrap();
    assert_eq!(recording.steps[1].stamp, Stamp::from_ns(50_000_000));
    // The deleted record leaves its gap.
    assert_eq!(recording.steps[2].stamp, Stamp::from_ns(150_000_000));
    assert_eq!(recording.steps[0].command.drive, Drive::Throttle(0.25));
    assert_eq!(recording.steps[0].frames[0].camera, "center");
    assert_eq!(recording.header.driver, "human");
    assert!((recording.header.body.period_s - 0.05).abs() < 1e-6);
}

#[test]
fn macos_shadows_are_not_catalogs() {
    let shadow = |folder: &Path| {
        fs::write(folder.join("._catalog_0.catalog"), b"\0\x05\x16\x07").unwrap();
        fs::write(folder.join("._manifest.json"), b"\0\x05\x16\x07").unwrap();
    };
    check(|c| c, shadow, &WITHOUT_2, &[]);
}

#[test]
fn without_a_manifest_everything_is_read() {
    let remove = |folder: &Path| fs::remove_file(folder.join("manifest.json")).unwrap();
    let all: Vec<usize> = (0..10).collect();
    check(|c| c, remove, &all, &["manifest.json is missing"]);
}

#[test]
fn a_manifest_that_is_not_json_is_as_none() {
    let spoil = |folder: &Path| fs::write(folder.join("manifest.json"), b"\xff\xfe{").unwrap();
    let all: Vec<usize> = (0..10).collect();
    check(
        |c| c,
        spoil,
        &all,
        &[
            "manifest.json:1: expected a JSON value",
            "catalogs are taken by their names",
        ],
    );
}

#[test]
fn missing_and_damaged_pictures_cost_their_records() {
    let remove = |folder: &Path| {
        for i in [4, 5] {
            fs::remove_file(folder.join(format!("images/{i}_cam_image_array_.jpg"))).unwrap();
        }
        fs::write(folder.join("images/6_cam_image_array_.jpg"), b"").unwrap();
    };
    check(
        |c| c,
        remove,
        &[0, 1, 3, 7, 8, 9],
        &[
            "catalog_0.catalog:5: images/4_cam_image_array_.jpg is missing",
            "catalog_0.catalog:7: images/6",
        ],
    );
}

#[test]
fn a_thousand_missing_pictures_are_a_few_lines() {
    let folder = tempfile::tempdir().unwrap();
    tub_folder(folder.path(), 60, |c| c);
    fs::remove_dir_all(folder.path().join("images")).unwrap();
    let recording = tub::read(folder.path(), &car()).unwrap();
    assert!(recording.steps.is_empty());
    assert!(recording.warnings.len() < 10, "{:#?}", recording.warnings);
    assert!(
        recording
            .warnings
            .iter()
            .any(|w| w.contains("54 more pictures missing (59 in all)"))
    );
}

#[test]
fn broken_lines_cost_themselves_and_name_their_place() {
    let break_line = |catalog: String| {
        catalog
            .replace("\"_index\": 3,", "\"_index\": 3")
            .replace("\"_index\": 7", "\"_index\": -7")
    };
    check(
        break_line,
        |_| {},
        &[0, 1, 4, 5, 6, 8, 9],
        &[
            "catalog_0.catalog:4: expected a JSON object",
            "catalog_0.catalog:8: _index",
        ],
    );
}

#[test]
fn empty_records_are_nothing() {
    let empty = |catalog: String| catalog.replacen('{', "{\"__empty__\": true}\n{", 3);
    check(empty, |_| {}, &WITHOUT_2, &[]);
}

#[test]
fn labels_out_of_range_and_missing_ones() {
    let spoil = |catalog: String| {
        catalog
            .replace("\"user/angle\": 0.4", "\"user/angle\": 7.5")
            .replace("\"user/angle\": -0.1", "\"user/ankle\": -0.1")
            .replace("\"user/angle\": 0.5", "\"user/angle\": 1.05")
    };
    check(
        spoil,
        |_| {},
        &[0, 1, 3, 5, 6, 7, 8],
        &[
            "catalog_0.catalog:10: user/angle: expected -1 to 1, but found 7.5: record left out",
            "catalog_0.catalog:5: user/angle is missing",
        ],
    );
}

#[test]
fn missing_session_ids_are_one_session() {
    let without = |catalog: String| catalog.replace("\"_session_id\": \"22-11-29_0\", ", "");
    check(without, |_| {}, &WITHOUT_2, &[]);
}

#[test]
fn sessions_are_kept_apart_on_request() {
    let folder = tempfile::tempdir().unwrap();
    tub_folder(folder.path(), 10, |catalog| {
        let mut lines: Vec<_> = catalog.lines().map(str::to_owned).collect();
        for line in &mut lines[6..] {
            *line = line.replace("22-11-29_0", "22-11-29_1");
        }
        lines.join("\n")
    });
    let apart = tub::read_runs(folder.path(), &car()).unwrap();
    assert_eq!(apart.iter().map(|r| r.steps.len()).collect::<Vec<_>>(), [5, 4]);
    assert_eq!(apart[1].steps[0].stamp, Stamp::default());
    let joined = tub::read(folder.path(), &car()).unwrap();
    assert_eq!(joined.steps[5].explanation.events, ["run 22-11-29_1 begins"]);
}

#[test]
fn converted_times_are_replaced_by_the_nominal_rate() {
    let convert = |catalog: String| {
        let mut catalog = catalog;
        for i in 0..10 {
            catalog = catalog.replace(
                &format!("{}", 1_669_759_744_666u64 + 50 * i),
                &format!("{}", 1_669_759_744_666u64 + 2 * i),
            );
        }
        catalog
    };
    check(
        convert,
        |_| {},
        &WITHOUT_2,
        &["2.0 ms apart", "nominal 20.0 frames a second"],
    );
}

#[test]
fn an_autopilots_commands_are_its_own() {
    let autopilot = |catalog: String| {
        catalog.replacen(
            "\"user/angle\": -0.5, \"user/mode\": \"user\", ",
            "\"pilot/angle\": 0.9, \"user/angle\": 0.0, \"user/mode\": \"local_angle\", ",
            1,
        )
    };
    let folder = tempfile::tempdir().unwrap();
    tub_folder(folder.path(), 3, autopilot);
    let mut recording = tub::read(folder.path(), &car()).unwrap();
    // Told as driven by a human throughout.
    assert_eq!(recording.header.driver, "human and autopilot");
    let step = recording.steps.remove(0);
    assert_eq!(step.command.turn, Turn::SteeringRad(-0.9 * 0.4));
    assert_eq!(step.explanation.events, ["mode local_angle"]);
    assert_eq!(step.explanation.signals[0].name, "user/angle");
}

#[test]
fn a_catalog_that_names_files_outside_gets_nothing_from_there() {
    let folder = tempfile::tempdir().unwrap();
    let inside = folder.path().join("tub");
    tub_folder(&inside, 3, |catalog| {
        catalog.replacen("0_cam_image_array_.jpg", "../../secret.jpg", 1)
    });
    fs::copy(
        inside.join("images/1_cam_image_array_.jpg"),
        folder.path().join("secret.jpg"),
    )
    .unwrap();
    let recording = tub::read(&inside, &car()).unwrap();
    assert_eq!(recording.steps.len(), 1);
    assert!(
        recording
            .warnings
            .iter()
            .any(|w| w.contains("images/secret.jpg is missing"))
    );
}

#[test]
fn a_folder_above_the_tub_is_good_enough() {
    let folder = tempfile::tempdir().unwrap();
    tub_folder(&folder.path().join("data/tub_1"), 3, |c| c);
    assert_eq!(tub::read(folder.path(), &car()).unwrap().steps.len(), 2);
}

#[test]
fn no_tub_at_all_says_what_was_expected() {
    let folder = tempfile::tempdir().unwrap();
    let check = |path: &Path, words: &str| {
        let error = tub::read(path, &car()).unwrap_err().to_string();
        assert!(error.contains(words), "{error}");
    };
    check(folder.path(), "neither manifest.json nor a catalog");
    check(&folder.path().join("absent"), "cannot be read");
    let file = folder.path().join("tub.zip");
    fs::write(&file, b"PK\x03\x04").unwrap();
    check(&file, "no archive");
    fs::write(&file, b"").unwrap();
    check(&file, "an empty file");
}

fn written(recording: &Recording, folder: &Path) -> tub::Written {
    tub::write(recording, folder, &TubOptions::default()).unwrap()
}

#[test]
fn a_written_tub_reads_back() {
    let folder = tempfile::tempdir().unwrap();
    let recording = recording(9);
    let about = written(&recording, folder.path());
    assert_eq!((about.records, about.skipped, about.reencoded), (9, 0, 6));
    let back = tub::read(folder.path(), &car()).unwrap();
    assert_eq!(back.warnings, Vec::<String>::new());
    assert_eq!(back.steps.len(), 9);
    for (number, (step, original)) in back.steps.iter().zip(&recording.steps).enumerate() {
        let (angle, throttle) = tub::convert::tub_from_command(&car(), &original.command);
        let Command { turn, drive } = step.command;
        let Turn::SteeringRad(steering_rad) = turn else {
            panic!("{turn:?}");
        };
        assert!((steering_rad + angle * 0.4).abs() < 1e-12);
        assert_eq!(drive, Drive::Throttle(throttle));
        assert_eq!(step.speed_mps, original.speed_mps);
        if number % 3 == 0 {
            assert_eq!(
                step.frames[0].encoded, original.frames[0].encoded,
                "JPEG bytes are kept"
            );
        }
    }
    // And once more: now nothing changes any longer.
    let again = tempfile::tempdir().unwrap();
    written(&back, again.path());
    let twice = tub::read(again.path(), &car()).unwrap();
    assert_eq!(twice.steps, back.steps);
    assert!(
        tub::write(&back, again.path(), &TubOptions::default()).is_err(),
        "never writes over a tub"
    );
}

#[test]
fn line_lengths_let_their_reader_seek() {
    let folder = tempfile::tempdir().unwrap();
    let mut recording = recording(3);
    let steps = recording.steps.clone();
    // More than one catalog.
    recording.steps = (0..1001).map(|_| steps[0].clone()).collect();
    written(&recording, folder.path());
    for (number, records) in [(0, 1000), (1, 1)] {
        let catalog = fs::read_to_string(folder.path().join(format!("catalog_{number}.catalog"))).unwrap();
        let about = fs::read(folder.path().join(format!("catalog_{number}.catalog_manifest"))).unwrap();
        let about: serde_json::Value = serde_json::from_slice(&about).unwrap();
        assert_eq!(about["start_index"], number * 1000);
        let lengths: Vec<usize> = serde_json::from_value(about["line_lengths"].clone()).unwrap();
        let real: Vec<_> = catalog
            .split_inclusive('\n')
            .map(|line| line.chars().count())
            .collect();
        assert_eq!(lengths, real);
        assert_eq!(real.len(), records);
        let first = catalog.lines().next().unwrap();
        assert!(
            first.starts_with(&format!("{{\"_index\": {}, \"_session_id\": \"26-01-01_0\", \"_timestamp_ms\": 1767225600000, \"cam/image_array\": \"", number * 1000)),
            "{first}"
        );
    }
    let manifest = fs::read_to_string(folder.path().join("manifest.json")).unwrap();
    let lines: Vec<_> = manifest.lines().collect();
    assert_eq!(lines.len(), 5);
    assert_eq!(
        lines[0],
        r#"["cam/image_array", "user/angle", "user/throttle", "user/mode"]"#
    );
    assert!(lines[4].contains(r#""current_index": 1001"#), "{}", lines[4]);
}

#[test]
fn pictures_of_another_size_scale_the_camera() {
    let folder = tempfile::tempdir().unwrap();
    tub_folder(folder.path(), 3, |c| c);
    let mut body = car();
    body.cameras[0] = support::camera("front", 32, 24);
    let recording = tub::read(folder.path(), &body).unwrap();
    let camera = &recording.header.body.cameras[0];
    assert_eq!(
        (camera.name.as_str(), camera.width_px, camera.height_px),
        ("front", 16, 12)
    );
    assert_eq!(recording.steps[0].frames[0].camera, "front");
    assert_eq!(recording.warnings.len(), 1, "same shape: nothing to warn of");
    body.cameras[0] = support::camera("front", 32, 16);
    let recording = tub::read(folder.path(), &body).unwrap();
    assert!(
        recording
            .warnings
            .iter()
            .any(|w| w.contains("lens was stretched"))
    );
}

#[test]
fn the_real_warehouse_tub() {
    let Some(path) = support::shared("donkeycar_warehouse_tub.tar.gz") else {
        return;
    };
    let mut body = car();
    body.cameras[0] = support::camera("center", 160, 120);
    let recording = tub::read(&path, &body).unwrap();
    assert_eq!(recording.steps.len(), 1000);
    assert_eq!(recording.warnings.len(), 1, "{:#?}", recording.warnings);
    assert!(recording.warnings[0].contains("nominal 20.0 frames a second"));
    assert!((recording.duration_s() - 49.95).abs() < 1e-9);
    let theirs: Vec<_> = recording
        .steps
        .iter()
        .map(|step| tub::convert::tub_from_command(&body, &step.command).0)
        .collect();
    let least = theirs.iter().copied().fold(f64::INFINITY, f64::min);
    let most = theirs.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    assert!((least + 0.857).abs() < 1e-3 && most == 1.0, "{least} {most}");
    let mut replay = Replay::new(recording);
    let mut observation = Observation::default();
    while replay.observe(&mut observation).unwrap() {
        let frame = observation.first_frame().unwrap();
        assert_eq!((frame.image.width(), frame.image.height()), (160, 120));
    }
    assert_eq!(replay.damaged_frames(), 0);
}
