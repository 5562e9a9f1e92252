//! Data hygiene, as a user types it.

mod support;

use predicates::prelude::*;
use predicates::str::contains;
use std::path::{Path, PathBuf};
use support::{json, senda, text};

/// Records a short drive of the expert; the file's path is returned.
fn record(folder: &Path, world: &str) -> PathBuf {
    senda(&[
        "drive",
        "--world",
        world,
        "--vehicle",
        "picar",
        "--driver",
        "expert",
        "--image",
        "80x60",
        "--time-limit",
        "1.5",
        "--record",
        text(folder),
    ])
    .success();
    folder.join(format!("{world}-picar-expert-1.mcap"))
}

#[test]
fn frames_are_dropped_labels_corrected_listed_and_taken_back() {
    let folder = tempfile::tempdir().unwrap();
    let run = record(folder.path(), "oval-lane");
    let run = text(&run);
    let all = json(&["data", "stats", run, "--json"]);
    let recorded = all["kept"].as_u64().unwrap();
    assert!(recorded > 20);
    senda(&[
        "data",
        "clean",
        run,
        "--drop-first",
        "3",
        "--drop-last",
        "2",
        "--drop",
        "10..12",
        "--correct",
        "15=-12.5",
    ])
    .success()
    .stdout(contains("steps 10..12 are left out").and(contains("step 15: steering -12.50°")));
    let stats = json(&["data", "stats", run, "--json"]);
    assert_eq!(stats["kept"].as_u64().unwrap(), recorded - 7);
    assert_eq!(stats["corrected"], 1);
    let list = json(&["data", "clean", run, "--list", "--json"]);
    assert_eq!(list[0]["drop"][2]["to"], 12);
    assert_eq!(list[0]["angle"][0]["steering_deg"], -12.5);
    senda(&["data", "clean", run, "--undo", "3"]).success();
    assert_eq!(json(&["data", "stats", run, "--json"])["kept"], recorded - 5);
    senda(&["data", "clean", run, "--undo", "9"])
        .failure()
        .stderr(contains("one of the 3 edits"));
    senda(&["data", "clean", run, "--reset"])
        .success()
        .stdout(contains("no edits"));
    assert_eq!(json(&["data", "stats", run, "--json"]), all);
    senda(&["data", "clean", run, "--drop", "5..5"])
        .failure()
        .stderr(contains("A below B"));
    senda(&["data", "clean", run, "--correct", "100000=3"])
        .failure()
        .stderr(contains("expected steps below"));
    senda(&["data", "clean", run, "--correct", "1=nan"]).failure();
}

#[test]
fn what_was_dropped_is_not_learned_from() {
    let folder = tempfile::tempdir().unwrap();
    let run = record(folder.path(), "oval-lane");
    let frames = || {
        let split = ["data", "split", text(&run), "--split", "time", "--json"];
        let split = json(&split);
        split["training_frames"].as_u64().unwrap() + split["validation_frames"].as_u64().unwrap()
    };
    let all = frames();
    senda(&["data", "clean", text(&run), "--drop-first", "6"]).success();
    assert_eq!(frames(), all - 6);
}

#[test]
fn a_split_by_world_is_shown_and_written_and_a_leak_refused() {
    let folder = tempfile::tempdir().unwrap();
    let runs = folder.path().join("runs");
    for world in ["oval-lane", "circuit-1"] {
        record(&runs, world);
    }
    let plan = folder.path().join("plan.toml");
    let split = json(&["data", "split", text(&runs), "--out", text(&plan), "--json"]);
    assert_ne!(split["training"][0]["world"], split["validation"][0]["world"]);
    assert_eq!(split["leaks"], false);
    let again = json(&["data", "split", "--plan", text(&plan), "--json"]);
    assert_eq!(again, split);
    senda(&["data", "split", text(&runs), "--split", "random-frames"])
        .failure()
        .stderr(contains("leaks"));
    senda(&[
        "data",
        "split",
        text(&runs),
        "--split",
        "random-frames",
        "--allow-leak",
        "--out",
        text(&plan),
    ])
    .success()
    .stdout(contains("LEAKS"));
    // The plan kept the split without the leave to leak, and could not be used.
    senda(&["data", "split", "--plan", text(&plan)])
        .success()
        .stdout(contains("LEAKS"));
}

#[test]
fn recordings_go_to_other_programs_and_come_back() {
    let folder = tempfile::tempdir().unwrap();
    let run = record(folder.path(), "oval-lane");
    senda(&["data", "clean", text(&run), "--drop-first", "5"]).success();
    let kept = json(&["data", "stats", text(&run), "--json"])["kept"].clone();
    for format in ["tub", "udacity", "named-frames"] {
        let out = folder.path().join(format);
        let arguments = [
            "data",
            "export",
            text(&run),
            "--format",
            format,
            "--out",
            text(&out),
            "--json",
        ];
        assert_eq!(json(&arguments)[0]["frames"], kept);
        let info = json(&["data", "info", text(&out), "--vehicle", "picar", "--json"]);
        assert_eq!(info["format"], format.replace('-', "_"));
        assert_eq!(info["steps"], kept);
        senda(&arguments)
            .failure()
            .stderr(contains("new or empty folder"));
    }
    senda(&[
        "data",
        "export",
        text(&run),
        "--format",
        "recording",
        "--out",
        "x",
    ])
    .failure()
    .stderr(contains("named-frames"));
}

/// Imported data were taken for a run of senda: another driver by default, other options, no agreement, a report without a name.
#[test]
fn imported_data_are_replayed_and_reported_like_the_data_themselves() {
    let folder = tempfile::tempdir().unwrap();
    let (tub, imported) = (folder.path().join("tub"), folder.path().join("imported"));
    let run = record(folder.path(), "oval-lane");
    senda(&[
        "data",
        "export",
        text(&run),
        "--format",
        "tub",
        "--out",
        text(&tub),
    ])
    .success();
    let import = [
        "data",
        "import",
        text(&tub),
        "--vehicle",
        "picar",
        "--out",
        text(&imported),
        "--json",
    ];
    let file = json(&import)[0]["path"].as_str().unwrap().to_owned();
    for driver in [&[][..], &["--driver", "lane"]] {
        let replay = |data: &str| {
            let report = folder.path().join("replay.html");
            let arguments = [
                "replay",
                data,
                "--vehicle",
                "picar",
                "--json",
                "--report",
                text(&report),
            ];
            let figures = json(&[&arguments[..], driver].concat());
            let page = std::fs::read_to_string(&report).unwrap();
            assert!(page.contains("Agreement with the human") && page.contains("Time spent"));
            assert!(figures["frame_time_max_s"].as_f64().unwrap() > 0.0);
            figures
        };
        let (of_tub, of_import) = (replay(text(&tub)), replay(&file));
        assert_eq!(of_tub["driver"], "lane");
        assert!(of_tub["agreement"]["frames"].as_u64().unwrap() > 20);
        for figure in [
            "steps",
            "found_rate",
            "lost",
            "driver",
            "agreement",
            "different_commands",
        ] {
            assert_eq!(of_tub[figure], of_import[figure], "{figure}");
        }
    }
    let report = folder.path().join("report.html");
    senda(&["report", &file, "--out", text(&report)]).success();
    let page = std::fs::read_to_string(report).unwrap();
    assert!(page.contains("expert on picar, tub tub"));
    assert!(!page.contains("<h2> on </h2>"));
}

#[test]
fn a_camera_that_was_moved_is_noticed() {
    let folder = tempfile::tempdir().unwrap();
    // The same place on a floor with a pattern, as the camera sees it before and after the vehicle was turned by 2°.
    let photo = |name: &str, heading_deg: &str, light: &str| -> PathBuf {
        let runs = folder.path().join(name);
        senda(&[
            "drive",
            "--world",
            "oval-lane",
            "--vehicle",
            "picar",
            "--driver",
            "expert",
            "--floor",
            "speckled",
            "--light",
            light,
            "--time-limit",
            "0.3",
            "--start-heading-deg",
            heading_deg,
            "--record",
            text(&runs),
        ])
        .success();
        let pictures = folder.path().join(format!("{name}-pictures"));
        let run = runs.join("oval-lane-picar-expert-1.mcap");
        senda(&[
            "data",
            "export",
            text(&run),
            "--format",
            "named-frames",
            "--out",
            text(&pictures),
        ])
        .success();
        let mut all: Vec<_> = std::fs::read_dir(&pictures)
            .unwrap()
            .map(|entry| entry.unwrap().path())
            .collect();
        all.sort();
        all.remove(0)
    };
    let (reference, dimmer, turned) = (
        photo("reference", "0", "daylight"),
        photo("dimmer", "0", "lamp"),
        photo("turned", "2", "daylight"),
    );
    let compare = |today: &Path| {
        json(&[
            "data",
            "stats",
            text(today),
            "--reference",
            text(&reference),
            "--json",
        ])["reference"]
            .clone()
    };
    let same = compare(&dimmer);
    assert_eq!(same["verdict"], "same", "{same}");
    let moved = compare(&turned);
    assert_eq!(moved["verdict"], "moved", "{moved}");
    // Turned to the left, the camera sees the scene further to the right.
    assert!(moved["right_px"].as_f64().unwrap() > 4.0, "{moved}");
    let run = folder.path().join("turned/oval-lane-picar-expert-1.mcap");
    senda(&["data", "stats", text(&run), "--reference", text(&reference)])
        .success()
        .stdout(contains("MOVED"));
}

#[test]
fn data_sets_that_are_none_are_named() {
    let folder = tempfile::tempdir().unwrap();
    for what in ["stats", "clean", "split"] {
        senda(&["data", what, text(folder.path())])
            .failure()
            .stderr(contains("expected a recording"));
    }
    let picture = folder.path().join("picture.png");
    std::fs::write(&picture, b"no picture").unwrap();
    let run = record(folder.path(), "oval-lane");
    senda(&["data", "stats", text(&run), "--reference", text(&picture)])
        .failure()
        .stderr(contains("expected a picture"));
}

/// As text it ended with 1, as JSON with 0; and a damaged place was blamed on senda.
#[test]
fn replays_end_with_the_same_code_in_words_and_as_json() {
    let folder = tempfile::tempdir().unwrap();
    let runs = folder.path().join("runs");
    senda(&["drive", "--time-limit", "4", "--record", text(&runs)]).success();
    let file = runs.join("oval-gopigo-line-1.mcap");
    let whole = senda_data::Recording::read(&file).unwrap();

    let mut other = whole.clone();
    other.steps[2].command = senda_core::Command::STOP;
    other.steps[3].command = senda_core::Command::curvature(1.0, 0.1);
    let other_file = folder.path().join("other.mcap");
    other.save(&other_file).unwrap();
    senda(&["replay", text(&other_file)]).code(1);
    let found = senda(&["replay", text(&other_file), "--json"])
        .code(1)
        .stderr(predicates::str::contains("senda is broken"));
    let found: serde_json::Value = serde_json::from_slice(&found.get_output().stdout).unwrap();
    assert!(found["different_commands"].as_u64().unwrap() >= 1);

    let mut bytes = std::fs::read(&file).unwrap();
    let picture = &whole.steps[whole.steps.len() / 2].frames[0].encoded.bytes;
    let at = bytes
        .windows(picture.len())
        .position(|found| found == picture)
        .unwrap();
    bytes[at + 100..at + 300].fill(0);
    let damaged = folder.path().join("damaged.mcap");
    std::fs::write(&damaged, bytes).unwrap();
    senda(&["replay", text(&damaged)])
        .success()
        .stdout(predicates::str::contains("where the recording is damaged"));
    let found = json(&["replay", text(&damaged), "--json"]);
    assert!(found["gaps"][0]["steps"].as_u64().unwrap() > 0, "{found}");
    assert!(found["warnings"][0].as_str().unwrap().contains("is damaged"));
}
