//! What is refused leaves nothing behind, and what has no effect or says too much is told.

mod support;

use predicates::prelude::*;
use predicates::str::contains;
use support::{json, senda, text};

const SHORT: [&str; 7] = [
    "drive",
    "--world",
    "straight",
    "--driver",
    "line",
    "--time-limit",
    "0.5",
];

/// A file without a byte stayed, the recording was blamed, and the folder could not be read any more.
#[test]
fn a_refused_run_leaves_no_recording() {
    let top = tempfile::tempdir().unwrap();
    let folder = top.path().join("runs");
    let broken = top.path().join("broken.toml");
    std::fs::write(&broken, "name = ").unwrap();
    let record = ["--record", text(&folder)];
    for (refused, words) in [
        (&["--world", "nope"][..], "nope"),
        (&["--driver", "lime"], "expected one of line, lane"),
        (&["--driver", "neural"], "--model"),
        (&["--world", text(&broken)], "broken.toml"),
    ] {
        senda(&[&["drive"], refused, &record].concat())
            .failure()
            .stderr(contains(words).and(contains("while recording").not()));
        assert!(!folder.exists(), "{refused:?}");
    }
    senda(&[&SHORT[..], &record].concat()).success();
    // What an earlier version left behind is passed over.
    let (good, empty) = (folder.join("straight-gopigo-line-1.mcap"), folder.join("a.mcap"));
    std::fs::write(&empty, b"").unwrap();
    let info = json(&["data", "info", text(&folder), "--json"]);
    assert_eq!(info["runs"], 1);
    assert!(info["warnings"][0].as_str().unwrap().contains("a.mcap: left out"));
    let report = ["report", "--out", text(&top.path().join("r.html"))].map(str::to_owned);
    let report: Vec<&str> = report.iter().map(String::as_str).collect();
    senda(&[&report[..], &[text(&empty), text(&good)]].concat())
        .success()
        .stderr(contains("a.mcap: left out"));
    senda(&[&report[..], &[text(&empty)]].concat()).failure();
    std::fs::remove_file(&good).unwrap();
    senda(&["data", "info", text(&folder)])
        .failure()
        .stderr(contains("none among the 1 of that name"));
}

/// 100,000 threads ended in a panic, or never.
#[test]
fn more_threads_than_a_system_has_are_refused() {
    for command in [
        &["train", "data"][..],
        &["evaluate", "model.senda"],
        &["sweep"],
        &["compare", "--preset", "document-b"],
        &["detector", "train", "set.data"],
    ] {
        for jobs in ["100000", "-1", "many"] {
            senda(&[command, &[&format!("--jobs={jobs}")]].concat())
                .failure()
                .stderr(contains("--jobs").and(contains("1 to 1024")).and(contains(jobs)));
        }
    }
    let folder = tempfile::tempdir().unwrap();
    let (plan, runs) = (folder.path().join("plan.toml"), folder.path().join("runs"));
    std::fs::write(&plan, "[training]\nthreads = 100000\n").unwrap();
    senda(&[&SHORT[..], &["--record", text(&runs)]].concat()).success();
    let train = [
        "train",
        text(&runs),
        "--plan",
        text(&plan),
        "--split",
        "time",
        "--network",
        "tinypilotnet",
    ];
    senda(&train)
        .failure()
        .stderr(contains("threads: expected 0 to 1024").and(contains("100000")));
}

/// The same run three times, and three seeds of a driver without chance, counted as three runs.
#[test]
fn sweeps_say_which_runs_tell_nothing_new() {
    let sweep = |more: &[&str]| {
        let common = ["sweep", "--json", "--vehicle", "unicycle", "--driver", "expert"];
        let value = json(&[&common[..], &["--time-limit", "0.5"], more].concat());
        (value["runs"].as_u64().unwrap(), value["warnings"].to_string())
    };
    let (runs, warnings) = sweep(&["--worlds", "straight,straight,straight"]);
    assert_eq!(runs, 1);
    assert!(warnings.contains("2 runs equal others"), "{warnings}");
    let (runs, warnings) = sweep(&["--world", "straight", "--seeds", "3"]);
    assert_eq!(runs, 3);
    assert!(warnings.contains("2 of 3 runs were driven exactly"), "{warnings}");
    let (_, warnings) = sweep(&["--world", "straight", "--speeds", "0.1,0.2"]);
    assert_eq!(warnings, "[]");
}

/// A world that had been edited since was given its old figures.
#[test]
fn a_sweep_goes_on_only_from_runs_of_the_same_world() {
    let folder = tempfile::tempdir().unwrap();
    let [world, results] = ["w.toml", "r.jsonl"].map(|name| folder.path().join(name));
    let write = |length_m: f64| {
        let path = format!("[path]\npieces = [{{ kind = \"straight\", length_m = {length_m} }}]\n");
        let marking = "[[markings]]\nwidth_m = 0.02\ncolour = \"black\"\n";
        std::fs::write(&world, path + marking).unwrap();
    };
    let lines = || {
        let sweep = ["sweep", "--driver", "line", "--time-limit", "0.5", "--world"];
        senda(&[&sweep[..], &[text(&world), "--results", text(&results)]].concat()).success();
        std::fs::read_to_string(&results).unwrap().lines().count()
    };
    write(3.0);
    assert_eq!((lines(), lines()), (1, 1));
    write(4.0);
    assert_eq!(lines(), 2);
}

/// A recording says all that is needed to repeat it, and no command read it.
#[test]
fn a_recording_is_driven_again() {
    let folder = tempfile::tempdir().unwrap();
    let [first, second] = ["first", "second"].map(|name| folder.path().join(name));
    senda(&[&SHORT[..], &["--seed", "4", "--record", text(&first)]].concat()).success();
    let run = first.join("straight-gopigo-line-4.mcap");
    senda(&["drive", "--scenario", text(&run), "--record", text(&second)]).success();
    let again = second.join("straight-gopigo-line-4.mcap");
    assert!(std::fs::read(run).unwrap() == std::fs::read(again).unwrap());
}

/// TOML was written into pictures, the tightest curve was told nowhere, and a coarser picture came without a word.
#[test]
fn made_up_and_drawn_worlds_say_what_they_are() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let random = ["world", "random", "--out"];
    senda(&[&random[..], &[text(&at("w.png"))]].concat())
        .failure()
        .stderr(contains("w.png: expected a name that ends in .toml"));
    assert!(!at("w.png").exists());
    let made = json(&[&random[..], &[text(&at("w.toml")), "--json"]].concat());
    let checked = json(&["world", "check", text(&at("w.toml")), "--json"]);
    let radius_m = made["tightest_radius_m"].as_f64().unwrap();
    assert!((0.29..1.0).contains(&radius_m), "{radius_m}");
    assert_eq!(checked[0]["tightest_radius_m"], radius_m);
    // A name stands for one world: this one is 14 mm longer than its family's longest, and has always been.
    let track = json(
        &[
            &random[..],
            &[
                text(&at("t.toml")),
                "--family",
                "random-track",
                "--seed",
                "19",
                "--json",
            ],
        ]
        .concat(),
    );
    let named = json(&["world", "check", "random-track:19", "--json"]);
    assert_eq!(track["length_m"], named[0]["length_m"]);
    let coarse = std::fs::read_to_string(at("w.toml")).unwrap();
    std::fs::write(at("w.toml"), format!("texel_m = 0.05\n{coarse}")).unwrap();
    senda(&["world", "draw", text(&at("w.toml")), "--out", text(&at("w.png"))])
        .success()
        .stderr(contains("20 pixels a metre, not with --resolution 250"));
}
