//! From the simulator's pictures to a detector, as a user types it.

mod support;
#[path = "support/wheel.rs"]
mod wheel;

use predicates::prelude::*;
use predicates::str::contains;
use std::path::Path;
use support::{json, senda, text};
use wheel::at_the_wheel;

/// A few small pictures and a detector that was trained for a moment.
fn trained(folder: &Path) -> serde_json::Value {
    let made = json(&[
        "detector",
        "data",
        text(folder),
        "--train",
        "6",
        "--valid",
        "3",
        "--image",
        "80x60",
        "--json",
    ]);
    assert_eq!(made["train"], 6);
    train(folder, "a.senda", &["--folder", text(&folder.join("kept"))])
}

fn train(folder: &Path, out: &str, more: &[&str]) -> serde_json::Value {
    let (data, out) = (folder.join("set.data"), folder.join(out));
    let mut arguments = vec![
        "detector",
        "train",
        text(&data),
        "--input",
        "80x64",
        "--epochs",
        "3",
        "--batch",
        "3",
    ];
    arguments.extend(["--out", text(&out), "--json"]);
    arguments.extend(more);
    json(&arguments)
}

#[test]
fn pictures_are_made_learned_and_judged_twice_the_same() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let result = trained(folder.path());
    let history = result["history"].as_array().unwrap();
    assert_eq!(history.len(), 3);
    let loss = |epoch: usize| history[epoch]["training_loss"].as_f64().unwrap();
    assert!(loss(2) < loss(0), "{result}");
    // The same layers go on with larger pictures.
    let (own, larger) = (at("a.senda"), at("larger.senda"));
    json(&[
        "detector",
        "train",
        text(&at("set.data")),
        "--from",
        text(&own),
        "--input",
        "96x80",
        "--epochs",
        "1",
        "--out",
        text(&larger),
        "--json",
    ]);
    let input = |model: &Path| json(&["model", "info", text(model), "--json"])["input"].clone();
    assert_ne!(input(&own), input(&larger));
    // Another number of threads, and a start from the kept checkpoint: the same.
    let other = train(folder.path(), "b.senda", &["--jobs", "1"]);
    let resumed = train(folder.path(), "c.senda", &["--folder", text(&at("kept"))]);
    for other in [&other, &resumed] {
        assert_eq!(other["history"], result["history"]);
        assert_eq!(other["validation"], result["validation"]);
    }
    let judged = json(&[
        "detector",
        "evaluate",
        text(&at("a.senda")),
        text(&at("set.data")),
        "--json",
    ]);
    assert_eq!(judged["scores"], result["validation"]);
    assert_eq!(judged["pictures"], 3);

    let classical = json(&[
        "detector",
        "evaluate",
        "classical",
        text(&at("set.data")),
        "--json",
    ]);
    assert_eq!(classical["pictures"], 3);
    let truths = |scores: &serde_json::Value| -> u64 {
        let classes = scores["scores"]["classes"].as_array().unwrap();
        classes
            .iter()
            .map(|class| class["truths"].as_u64().unwrap())
            .sum()
    };
    assert_eq!(truths(&classical), truths(&judged));

    let list = std::fs::read_to_string(at("valid.txt")).unwrap();
    let picture = at(list.lines().next().unwrap());
    let drawn = at("drawn.png");
    let run = [
        "detector",
        "run",
        text(&at("a.senda")),
        text(&picture),
        "--threshold",
        "0",
        "--json",
    ]
    .map(str::to_owned);
    let run: Vec<&str> = run.iter().map(String::as_str).collect();
    let found = json(&[&run[..], &["--out", text(&drawn)]].concat());
    assert!(!found["found"].as_array().unwrap().is_empty());
    assert!(std::fs::read(&drawn).unwrap().starts_with(b"\x89PNG"));

    // Darknet's files of it are read back.
    senda(&["detector", "export", text(&at("a.senda")), text(&at("dark"))]).success();
    let cfg = at("dark/detector.cfg");
    let weights = at("dark/detector.weights");
    train(
        folder.path(),
        "d.senda",
        &["--network", text(&cfg), "--weights", text(&weights)],
    );
    // A detector is no driver.
    senda(&at_the_wheel("oval-lane", "picar", text(&at("a.senda"))))
        .failure()
        .stderr(contains("steering"));
}

/// New lists lay beside old pictures.
#[test]
fn a_set_replaces_only_a_set() {
    let folder = tempfile::tempdir().unwrap();
    let set = folder.path().join("set");
    let make = |train: &str| {
        senda(&[
            "detector",
            "data",
            text(&set),
            "--train",
            train,
            "--valid",
            "0",
            "--image",
            "80x60",
        ])
    };
    make("0").failure().stderr(contains("at least one picture"));
    let count = || std::fs::read_dir(set.join("train")).unwrap().count();
    make("3").success();
    assert_eq!(count(), 6, "pictures and labels");
    make("1").success();
    assert_eq!(count(), 2);
    std::fs::write(set.join("train/notes.md"), "mine").unwrap();
    make("2").failure().stderr(contains("notes.md"));
    std::fs::remove_file(set.join("train/notes.md")).unwrap();
    std::fs::write(set.join("mine.jpg"), "mine").unwrap();
    make("2").failure().stderr(contains("mine.jpg"));
    std::fs::remove_file(set.join("mine.jpg")).unwrap();
    senda(&["detector", "data", text(&set), "--vehicle", "nobody"]).failure();
    assert_eq!(count(), 2, "nothing is touched");
}

#[test]
fn broken_sets_and_files_are_refused_with_words() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    trained(folder.path());
    let fails = |arguments: &[&str], words: &str| {
        senda(&[&["detector"], arguments].concat())
            .failure()
            .stderr(contains(words).and(contains("panicked").not()));
    };
    let data = at("set.data");
    fails(&["train", text(&at("missing.data"))], "missing.data");
    fails(&["train", text(&data), "--network", "yolov9"], "detector-small");
    fails(&["train", text(&data), "--epochs", "0"], "epochs");
    let cut = at("cut.weights");
    std::fs::write(&cut, [0u8; 30]).unwrap();
    fails(&["train", text(&data), "--weights", text(&cut)], "cut.weights");
    let cfg = at("odd.cfg");
    std::fs::write(&cfg, "[net]\nwidth=32\nheight=32\n[reorg]\n").unwrap();
    fails(&["train", text(&data), "--network", text(&cfg)], "odd.cfg:4");
    let lane = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../models/lane-small.senda");
    fails(&["evaluate", text(&lane), text(&data)], "expected a detector");
    fails(&["run", text(&at("a.senda")), text(&data)], "set.data");
    fails(&["run", "classical", "a.jpg", "--threshold", "7"], "from 0 to 1");
    fails(
        &["run", "classical", "a.jpg", "-o", "b.jpg"],
        "b.jpg: expected a name that ends in .png",
    );
    let own = at("a.senda");
    let other = ["--from", text(&own), "--network", "yolov3-tiny"];
    fails(&[&["train", text(&data)], &other[..]].concat(), "--network");
    senda(&["detector", "export", text(&own), text(&at("dark"))]).success();
    let weights = at("dark/detector.weights");
    // Back again, it is the same detector.
    let [cfg, names] = ["dark/detector.cfg", "dark/detector.names"].map(at);
    let back = at("back.senda");
    let import = [
        "import",
        text(&cfg),
        text(&weights),
        text(&names),
        "-o",
        text(&back),
    ];
    senda(&[&["detector"], &import[..]].concat()).success();
    let scores =
        |model: &Path| json(&["detector", "evaluate", text(model), text(&data), "--json"])["scores"].clone();
    assert_eq!(scores(&own), scores(&back));
    std::fs::write(&names, "lamp\n").unwrap();
    fails(&import, "detector.names: expected 4 names");
    fails(&[&import[..3], &[text(&data)]].concat(), "expected 4 names");
    fails(&["import", text(&cfg), text(&names), text(&names)], "expected");
    fails(
        &[
            "train",
            text(&data),
            "--weights",
            text(&weights),
            "--convolutions",
            "99",
        ],
        "--convolutions: expected at most ",
    );
    let nameless = at("nameless.data");
    std::fs::write(&nameless, "classes=4\nvalid=valid.txt\n").unwrap();
    fails(
        &["evaluate", "classical", text(&nameless)],
        "expected the key names",
    );

    // A picture and a label that are broken cost only themselves.
    let first = std::fs::read_to_string(at("train.txt")).unwrap();
    let first = at(first.lines().next().unwrap());
    std::fs::write(&first, "no picture").unwrap();
    let label = std::fs::read_to_string(at("valid.txt")).unwrap();
    let label = at(label.lines().next().unwrap()).with_extension("txt");
    std::fs::write(&label, "9 0.5 0.5 0.1 0.1\n").unwrap();
    senda(&[
        "detector",
        "train",
        text(&data),
        "--input",
        "80x64",
        "--epochs",
        "1",
        "--out",
        text(&at("e.senda")),
        "--json",
    ])
    .success()
    .stdout(contains("\"training_pictures\": 5"))
    .stderr(contains("left out"));
    std::fs::write(at("train.txt"), "").unwrap();
    fails(&["train", text(&data)], "train.txt");
}
