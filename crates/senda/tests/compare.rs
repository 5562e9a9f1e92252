//! A comparison of networks, as a user types it: whole, in parts, and what is said when something is missing.

use assert_cmd::Command;
use predicates::prelude::*;
use predicates::str::contains;
use std::path::Path;

const NETWORK: &str = "[input]\nheight = 6\nwidth = 12\nchannels = 1\n\n[[layer]]\nkind = \"flatten\"\n\n[[layer]]\nkind = \"dense\"\nunits = 1\n";

const PLAN: &str = r#"
name = "tiny"
description = "One network twice"
vehicle = "picar"
speed_mps = 0.3
seeds = 2
baseline = "grey"

[data]
driver = "expert"
training = ["oval-lane"]
held_out = ["straight-lane"]
side_camera_shift = 0.0
time_limit_s = 1.0

[training]
epochs = 1
batch = 8

[judging]
worlds = ["s-curves-lane"]
time_limit_s = 0.6

[[row]]
name = "grey"
network = "own.toml"
colour = "grey"
"#;

const MINE: &str = "[[row]]\nname = \"mine\"\nnetwork = \"own.toml\"\ncontrol = \"one-network\"\n";

fn senda(folder: &Path, arguments: &str) -> assert_cmd::assert::Assert {
    Command::cargo_bin("senda")
        .unwrap()
        .current_dir(folder)
        .args(arguments.split(' '))
        .assert()
}

fn printed(folder: &Path, arguments: &str) -> Vec<u8> {
    senda(folder, arguments).success().get_output().stdout.clone()
}

#[test]
fn parts_joined_tell_the_same_as_the_whole_and_an_own_network_joins_in() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    for (name, text) in [("own.toml", NETWORK), ("plan.toml", PLAN), ("mine.toml", MINE)] {
        std::fs::write(at.join(name), text).unwrap();
    }
    senda(at, "compare plan.toml --dry-run")
        .success()
        .stderr(contains("0 of 6 results there"));
    let whole = printed(
        at,
        "compare plan.toml --add mine.toml --folder whole --json --report r.html --markdown r.md",
    );
    let told: serde_json::Value = serde_json::from_slice(&whole).unwrap();
    assert_eq!(told["rows"].as_array().unwrap().len(), 2);
    assert_eq!(told["rows"][1]["row"], "mine/one-network");
    let html = std::fs::read_to_string(at.join("r.html")).unwrap();
    for says in ["Control: steering only", "Frame by frame", "Hard curve 1", "mine"] {
        assert!(html.contains(says), "{says}");
    }
    let markdown = std::fs::read_to_string(at.join("r.md")).unwrap();
    let plot = markdown
        .split("](r/")
        .nth(1)
        .and_then(|rest| rest.split(')').next())
        .unwrap();
    assert!(
        at.join("r").join(plot).is_file() && markdown.contains("| mine | one network |"),
        "{markdown}"
    );

    // Both parts, joined and with one forgotten.
    for part in ["1", "2"] {
        let line = format!("compare plan.toml --add mine.toml --shard {part}/2 --folder p{part} --jobs 1");
        senda(at, &line).success();
    }
    let joined = printed(at, "merge p1 p2 p1 --out joined --json");
    assert_eq!(joined, whole);
    let alone = senda(at, "merge p1 --out half").failure();
    alone.stderr(contains(
        "part 2/2 is missing: senda compare half/plan.toml --shard 2/2",
    ));

    senda(at, "compare plan.toml --shard 3/2")
        .failure()
        .stderr(contains("1/4 (the first of four)"));
    senda(at, "compare --preset document-x")
        .failure()
        .stderr(contains("document-b"));
    std::fs::write(at.join("bad.toml"), PLAN.replace("epochs", "epoch")).unwrap();
    let bad = senda(at, "compare bad.toml").failure();
    bad.stderr(contains("bad.toml:17").and(contains("epochs")));
}
