//! What a network looks at, two networks at the wheel, and errors against what was done: as a user types it.

mod support;
#[path = "support/wheel.rs"]
mod wheel;

use predicates::prelude::*;
use predicates::str::contains;
use std::path::Path;
use support::{json, senda, text};
use wheel::at_the_wheel;

const MODEL: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../models/lane-small.senda");

/// A second of the shipped network on a road, and its recording.
fn drive(folder: &Path, more: &[&str]) -> serde_json::Value {
    let runs = folder.join("runs");
    let short = ["--time-limit", "1", "--record", text(&runs), "--json"];
    json(&[&at_the_wheel("unseen-1", "picar", MODEL)[..], &short, more].concat())
}

#[test]
fn a_run_is_looked_at_in_pictures_and_in_the_reports_player() {
    let folder = tempfile::tempdir().unwrap();
    let report = folder.path().join("run.html");
    drive(folder.path(), &["--report", text(&report), "--look"]);
    let recording = std::fs::read_dir(folder.path().join("runs"))
        .unwrap()
        .next()
        .unwrap()
        .unwrap()
        .path();
    let page = std::fs::read_to_string(&report).unwrap();
    assert!(page.contains("where it looks") && page.contains("\"look\":\"data:image/jpeg"));

    let again = folder.path().join("again.html");
    senda(&["report", text(&recording), "--look", MODEL, "--out", text(&again)]).success();
    assert!(
        std::fs::read_to_string(&again)
            .unwrap()
            .contains("VisualBackProp")
    );

    let out = folder.path().join("look");
    let written = json(&[
        "look",
        MODEL,
        text(&recording),
        "-o",
        text(&out),
        "--frames",
        "3",
        "--json",
    ]);
    let written = written.as_array().unwrap();
    assert_eq!(written.len(), 3);
    for one in written {
        assert!(one["answers"]["steering"].is_number());
        let bytes = std::fs::read(one["picture"].as_str().unwrap()).unwrap();
        assert_eq!(bytes[1..4], *b"PNG");
    }
    // One of these pictures is a picture that can be looked at.
    let first = written[0]["picture"].as_str().unwrap();
    let single = folder.path().join("single.png");
    senda(&["look", MODEL, first, "-o", text(&single)])
        .success()
        .stdout(contains("steering"));
    assert!(single.exists());
}

#[test]
fn what_cannot_be_looked_at_is_said_in_words() {
    let folder = tempfile::tempdir().unwrap();
    let broken = folder.path().join("broken.jpg");
    std::fs::write(&broken, b"no picture").unwrap();
    let fails = |arguments: &[&str], words: &str| {
        senda(arguments)
            .failure()
            .stderr(contains(words).and(contains("panicked").not()));
    };
    fails(&["look", MODEL, "nowhere.png"], "no such file");
    fails(&["look", MODEL, text(&broken)], "broken.jpg");
    fails(&["look", text(&broken), text(&broken)], "model");
    fails(&["look", MODEL, text(folder.path()), "--frames", "0"], "--frames");
    fails(
        &[
            "drive",
            "--world",
            "oval-lane",
            "--driver",
            "lane",
            "--report",
            text(&folder.path().join("x.html")),
            "--look",
        ],
        "--driver neural",
    );
}

#[test]
fn errors_against_what_was_done_and_two_networks_at_the_wheel() {
    let folder = tempfile::tempdir().unwrap();
    drive(folder.path(), &[]);
    let runs = folder.path().join("runs");
    // What the network itself drove, it answers again; a recording's JPEGs are what it saw.
    let found = json(&[
        "evaluate",
        MODEL,
        "--vehicle",
        "picar",
        "--against",
        text(&runs),
        "--json",
    ]);
    assert_eq!(found[0]["output"], "steering");
    assert!(found[0]["root_mean_square"].as_f64().unwrap() < 0.05, "{found}");
    senda(&["evaluate", MODEL, "--against", text(&runs)])
        .success()
        .stdout(contains("RMSE"));

    // A second network that steers has no place beside the first.
    let second = format!("throttle_model={MODEL}");
    senda(
        &[
            &at_the_wheel("unseen-1", "picar", MODEL)[..],
            &["--option", &second],
        ]
        .concat(),
    )
    .failure()
    .stderr(contains("throttle or speed alone"));

    let plan = folder.path().join("pedals.toml");
    std::fs::write(&plan, "network = \"tinypilotnet\"\nanswers = [\"throttle\"]\nedges = { low = 50, high = 90 }\n[training]\nepochs = 1\n").unwrap();
    let pedals = folder.path().join("pedals.senda");
    senda(&[
        "train",
        text(&runs),
        "--plan",
        text(&plan),
        "--split",
        "time",
        "--out",
        text(&pedals),
    ])
    .success();
    senda(&["model", "info", text(&pedals)])
        .success()
        .stdout(contains("saturation").and(contains("thresholds 50 and 90")));
    let summary = drive(
        folder.path(),
        &[
            "--seed",
            "5",
            "--option",
            &format!("throttle_model={}", text(&pedals)),
        ],
    );
    assert!(summary["autonomy"].is_number());
    senda(&[
        "train",
        text(&runs),
        "--network",
        "stacked-tinypilotnet",
        "--stack",
        "3",
    ])
    .failure()
    .stderr(contains("4 channels"));
}
