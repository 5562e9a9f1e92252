//! From recordings to a driving network, as a user types it.

mod support;
#[path = "support/wheel.rs"]
mod wheel;

use assert_cmd::Command;
use predicates::prelude::*;
use predicates::str::contains;
use std::path::Path;
use support::{json, senda, text};
use wheel::at_the_wheel;

/// A drive of a second with small images, told as JSON.
const A_SECOND: [&str; 5] = ["--image", "40x30", "--time-limit", "1", "--json"];

const NETWORK: &str = r#"
[input]
height = 8
width = 12
channels = 1

[[layer]]
kind = "convolution"
filters = 4
kernel = 3
stride = 2
activation = "elu"

[[layer]]
kind = "flatten"

[[layer]]
kind = "dense"
units = 64
activation = "relu"

[[layer]]
kind = "dense"
units = 1
"#;

/// Two short recordings of the expert and the tiny network, in a folder.
fn data(folder: &Path) {
    for seed in ["1", "2"] {
        senda(&[
            "drive",
            "--world",
            "oval-lane",
            "--vehicle",
            "picar",
            "--driver",
            "expert",
            "--image",
            "40x30",
            "--time-limit",
            "2",
            "--seed",
            seed,
            "--record",
            text(&folder.join("runs")),
        ])
        .success();
    }
    std::fs::write(folder.join("tiny.toml"), NETWORK).unwrap();
}

/// The arguments that train the tiny network on them.
fn training(folder: &Path, out: &str) -> Vec<String> {
    [
        "train",
        text(&folder.join("runs")),
        "--split",
        "runs",
        "--network",
        text(&folder.join("tiny.toml")),
        "--epochs",
        "2",
        "--jobs",
        "1",
        "--out",
        text(&folder.join(out)),
    ]
    .map(str::to_owned)
    .to_vec()
}

fn with<'a>(arguments: &'a [String], more: &[&'a str]) -> Vec<&'a str> {
    arguments
        .iter()
        .map(String::as_str)
        .chain(more.iter().copied())
        .collect()
}

#[test]
fn networks_are_listed_shown_and_printed() {
    senda(&["net", "list"])
        .success()
        .stdout(contains("pilotnet").and(contains("mobilenetv2-head")));
    let pilotnet = json(&["net", "show", "pilotnet", "--json"]);
    assert_eq!(pilotnet["parameters"], 252_219);
    let multiply_adds = pilotnet["multiply_adds"].as_f64().unwrap();
    assert!((multiply_adds * 1e-6 - 26.88).abs() < 0.02, "{multiply_adds}");
    senda(&["net", "show", "pilotnet"])
        .success()
        .stdout(contains("252219 parameters"));
    let folder = tempfile::tempdir().unwrap();
    let copy = folder.path().join("mine.toml");
    let printed = senda(&["net", "print", "pilotnet"]).success();
    std::fs::write(&copy, &printed.get_output().stdout).unwrap();
    let own = json(&["net", "show", text(&copy), "--json"]);
    assert_eq!(own["parameters"], 252_219);
}

#[test]
fn wrong_networks_are_answered_with_the_nearest_name_or_the_line() {
    senda(&["net", "show", "pilotnett"])
        .failure()
        .stderr(contains("did you mean \"pilotnet\""));
    let folder = tempfile::tempdir().unwrap();
    let broken = folder.path().join("broken.toml");
    std::fs::write(&broken, NETWORK.replace("filters", "filterz")).unwrap();
    senda(&["net", "show", text(&broken)])
        .failure()
        .stderr(contains("broken.toml:9").and(contains("filters")));
    senda(&["net", "show", "missing.toml"])
        .failure()
        .stderr(contains("missing.toml"));
}

#[test]
fn recorded_trained_and_driven_twice_the_same() {
    let folder = tempfile::tempdir().unwrap();
    data(folder.path());
    let arguments = training(folder.path(), "a.senda");
    let report = folder.path().join("training.html");
    let result = json(&with(&arguments, &["--json", "--report", text(&report)]));
    let page = std::fs::read_to_string(&report).unwrap();
    for words in [
        "Loss over the epochs",
        "is kept",
        "validation",
        "How often which steering",
    ] {
        assert!(page.contains(words), "the report has no {words}");
    }
    assert!(result["training_frames"].as_u64().unwrap() > 5, "{result}");
    assert!(result["validation_frames"].as_u64().unwrap() > 5, "{result}");
    assert_eq!(result["history"].as_array().unwrap().len(), 2);

    let model = folder.path().join("a.senda");
    let info = json(&["model", "info", text(&model), "--json"]);
    assert_eq!(info["outputs"][0]["name"], "steering");
    assert_eq!(info["input"]["width"], 12);
    assert!(info["input"]["camera"].is_object(), "{info}");
    senda(&["model", "info", text(&model)])
        .success()
        .stdout(contains("steering").and(contains("camera")));

    let drive = |vehicle: &str| -> Vec<String> {
        let arguments = [&at_the_wheel("oval-lane", vehicle, text(&model))[..], &A_SECOND].concat();
        arguments.into_iter().map(str::to_owned).collect()
    };
    let first = json(&with(&drive("picar"), &[]));
    let second = json(&with(&drive("picar"), &[]));
    assert_eq!(first["digest"], second["digest"]);
    // Trained again: the same weights, so the same drive.
    senda(&with(&training(folder.path(), "b.senda"), &[])).success();
    let other_file = json(&["model", "info", text(&folder.path().join("b.senda")), "--json"]);
    assert_eq!(other_file["provenance"]["metrics"], info["provenance"]["metrics"]);

    // The gopigo's camera sits elsewhere: refused by name, unless one insists.
    senda(&with(&drive("gopigo"), &[])).failure().stderr(
        contains("another camera")
            .and(contains("then"))
            .and(contains("any_camera")),
    );
    senda(&with(&drive("gopigo"), &["--option", "any_camera=true"])).success();
}

#[test]
fn models_go_out_come_back_and_shrink_to_8_bits() {
    let folder = tempfile::tempdir().unwrap();
    data(folder.path());
    let at = |name: &str| folder.path().join(name);
    senda(&with(&training(folder.path(), "a.senda"), &[])).success();
    let (model, onnx, back) = (at("a.senda"), at("a.onnx"), at("back.senda"));
    let exported = json(&["model", "export", text(&model), text(&onnx), "--json"]);
    assert_eq!(exported["input"], serde_json::json!([1, 8, 12]));

    // What it wrote itself says everything; the same drive comes of it.
    senda(&["model", "import", text(&onnx), "--out", text(&back)]).success();
    let drive = |model: &Path| -> serde_json::Value {
        json(&[&at_the_wheel("oval-lane", "picar", text(model))[..], &A_SECOND].concat())
    };
    assert_eq!(drive(&model)["digest"], drive(&back)["digest"]);
    // Where it comes from was lost on the way.
    let made = |model: &Path| json(&["model", "info", text(model), "--json"])["provenance"].clone();
    let (before, after) = (made(&model), made(&back));
    for key in ["seed", "worlds", "metrics", "data", "command"] {
        assert_eq!(before[key], after[key], "{key}");
    }
    assert!(
        after["notes"].as_str().unwrap().contains("model import"),
        "{after}"
    );
    senda(&["evaluate", text(&onnx)])
        .failure()
        .stderr(contains("senda model import"));
    for (wrong, words) in [
        (["--runs", "0"], "at least 1"),
        (["--speeds", "0"], "more than 0 m/s"),
        (["--worlds", "cirkuit-1"], "circuit-1"),
    ] {
        senda(&[&["evaluate", text(&model)], &wrong[..]].concat())
            .failure()
            .stderr(contains(words).and(contains("could not be run").not()));
    }
    let known = [
        "evaluate",
        text(&model),
        "--worlds",
        "oval-lane",
        "--runs",
        "1",
        "--image",
        "40x30",
        "--json",
    ];
    assert!(json(&known)["warnings"].to_string().contains("1 of the 1 worlds"));
    // Two followers, one document.
    let both = json(&[&known[..], &["--beside-lane"]].concat());
    assert_eq!(both["runs"], both["beside"]["runs"]);
    assert_eq!(both["beside"]["rows"][0]["completed"]["count"], 1, "{both}");
    senda(&[
        "evaluate",
        text(&model),
        "--against",
        "runs",
        "--report",
        "page.html",
    ])
    .failure()
    .stderr(contains("cannot be used with"));

    // Others must be told.
    let mut bytes = std::fs::read(&onnx).unwrap();
    for at in 0..bytes.len().saturating_sub(6) {
        if bytes[at..].starts_with(b"senda.") {
            bytes[at] = b'x';
        }
    }
    let foreign = at("foreign.onnx");
    std::fs::write(&foreign, bytes).unwrap();
    let import = |more: &[&str]| {
        let mut arguments = vec!["model", "import", text(&foreign), "-o", text(&back)];
        arguments.extend(more);
        senda(&arguments)
    };
    import(&[]).failure().stderr(contains("--values"));
    import(&["--values", "-1,1"])
        .failure()
        .stderr(contains("--outputs"));
    import(&["--values", "-1,1", "--outputs", "steering,speed"])
        .failure()
        .stderr(contains("each of the network's 1 output"));
    import(&["--values", "-1,1", "--outputs", "stearing"])
        .failure()
        .stderr(contains("stearing"));
    let spec = at("spec.toml");
    std::fs::write(&spec, "outputs = [\"steering\"]\nvalues = [-1.0, 1.0]\n").unwrap();
    import(&["--spec", text(&spec)]).success();
    assert_eq!(drive(&model)["digest"], drive(&back)["digest"]);
    std::fs::write(&spec, "outputz = []\n").unwrap();
    import(&["--spec", text(&spec)])
        .failure()
        .stderr(contains("spec.toml").and(contains("outputz")));

    let small = at("a8.senda");
    let runs = at("runs");
    let quantise = |source: &str| -> Vec<String> {
        [
            "model",
            "quantise",
            text(&model),
            "--calibrate",
            source,
            "--frames",
            "16",
            "--out",
            text(&small),
        ]
        .map(str::to_owned)
        .to_vec()
    };
    let result = json(&with(&quantise(text(&runs)), &["--json"]));
    let largest = result["differences"][0]["largest"].as_f64().unwrap();
    assert!(largest > 0.0 && largest < 0.1, "{result}");
    assert!(result["bytes"].as_u64() < result["bytes_before"].as_u64());
    let info = json(&["model", "info", text(&small), "--json"]);
    assert_eq!(info["quantised"], true);
    assert!(drive(&small)["frames"].as_u64().unwrap() > 5);
    senda(&["model", "export", text(&small), text(&onnx)]).success();
    senda(&["model", "import", text(&onnx), "--out", text(&back)])
        .failure()
        .stderr(contains("QuantizeLinear"));
    senda(&["model", "quantise", text(&small), "--calibrate", text(&runs)])
        .failure()
        .stderr(contains("8 bits").and(contains("can be quantised").not()));
    senda(&[
        "model",
        "quantise",
        text(&model),
        "--calibrate",
        text(&runs),
        "--frames",
        "1",
    ])
    .failure()
    .stderr(contains("frames: expected at least 2"));
    senda(&with(&quantise("random-circuit:9000"), &[])).success();
    senda(&with(&quantise("random-corcuit:9000"), &[]))
        .failure()
        .stderr(contains("random-corcuit"));
}

#[test]
fn what_is_no_model_is_refused_with_words() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("list.senda");
    std::fs::write(&path, "milk, bread, butter").unwrap();
    let drive = |model: &Path| {
        let wheel = at_the_wheel("oval-lane", "picar", text(model));
        senda(&[&wheel[..], &["--time-limit", "1"]].concat()).failure()
    };
    drive(&path).stderr(contains("list.senda").and(contains("expected a model file")));
    drive(&folder.path().join("missing.senda")).stderr(contains("missing.senda"));
    let info = |path: &str| senda(&["model", "info", path]).failure();
    info("missing.senda").stderr(contains("found no such file; models are made by `senda train`"));
    info(text(folder.path())).stderr(contains("it is a folder"));
    #[cfg(unix)]
    {
        // Read until the memory was full.
        info("/dev/zero").stderr(contains("it is a device"));
        senda(&["model", "import", "/dev/zero"])
            .failure()
            .stderr(contains("device"));
    }
    senda(&["model", "info", text(&path)])
        .failure()
        .stderr(contains("list.senda").and(contains("expected a model file")));
}

#[test]
fn training_without_sense_is_refused_with_words() {
    let folder = tempfile::tempdir().unwrap();
    data(folder.path());
    let arguments = training(folder.path(), "a.senda");
    senda(&with(&arguments, &["--validation-share", "1.5"]))
        .failure()
        .stderr(contains("validation_share"));
    senda(&with(&arguments, &["--learning-rate", "0"]))
        .failure()
        .stderr(contains("learning_rate"));
    senda(&["train"]).failure().stderr(contains("--record"));
    let runs = folder.path().join("runs");
    let tiny = folder.path().join("tiny.toml");
    let split = |how: &str| {
        senda(&[
            "train",
            text(&runs),
            "--network",
            text(&tiny),
            "--split",
            how,
            "--out",
            text(&folder.path().join("b.senda")),
        ])
        .failure()
    };
    split("random-frames").stderr(contains("leaks").and(contains("--allow-leak")));
    split("worlds").stderr(contains("two worlds"));
    split("circles").stderr(contains("circles"));
    let empty = folder.path().join("empty");
    std::fs::create_dir(&empty).unwrap();
    senda(&["train", text(&empty)])
        .failure()
        .stderr(contains("empty"));
    assert!(!folder.path().join("b.senda").exists());
}

/// Document A's own kind of data, pictures with the angle in their names, could not be trained: all of it counted as standing.
#[test]
fn every_foreign_format_is_trained_on_and_named_in_the_model() {
    let folder = tempfile::tempdir().unwrap();
    data(folder.path());
    let at = |name: &str| folder.path().join(name);
    let run = at("runs/oval-lane-picar-expert-1.mcap");
    let (model, tiny) = (at("a.senda"), at("tiny.toml"));
    let train = |sources: &[&str]| {
        let arguments = [
            &["train"],
            sources,
            &[
                "--network",
                text(&tiny),
                "--split",
                "time",
                "--epochs",
                "1",
                "--json",
                "--out",
                text(&model),
            ],
        ]
        .concat();
        json(&arguments)
    };
    let frames = |trained: &serde_json::Value| {
        trained["training_frames"].as_u64().unwrap() + trained["validation_frames"].as_u64().unwrap()
    };
    let own = frames(&train(&[text(&run)]));
    let exported: Vec<_> = ["named-frames", "tub", "udacity"]
        .iter()
        .map(|format| at(format))
        .collect();
    for out in &exported {
        let format = out.file_name().unwrap().to_str().unwrap();
        senda(&[
            "data",
            "export",
            text(&run),
            "--format",
            format,
            "--out",
            text(out),
        ])
        .success();
        let trained = train(&[text(out)]);
        assert_eq!(frames(&trained), own, "{format}: {trained}");
    }
    let all: Vec<&str> = exported.iter().map(|path| text(path)).collect();
    assert_eq!(frames(&train(&all)), 3 * own);
    let imported = at("imported");
    senda(&[
        "data",
        "import",
        all[0],
        "--vehicle",
        "picar",
        "--out",
        text(&imported),
    ])
    .success();
    assert_eq!(frames(&train(&[text(&imported)])), own);
    // What gives nothing is said and not claimed.
    let empty = at("empty");
    std::fs::create_dir(&empty).unwrap();
    std::fs::copy(
        exported[0].join(first_picture(&exported[0])),
        empty.join("v000001-f00000-a90.jpg"),
    )
    .unwrap();
    let trained = train(&[all[0], text(&empty)]);
    assert!(
        trained["warnings"]
            .to_string()
            .contains("of 1 recorded frames, 1 lie at the ends"),
        "{trained}"
    );
    let info = json(&["model", "info", text(&model), "--json"]);
    assert_eq!(info["provenance"]["data"], serde_json::json!([all[0]]));
    senda(&["train", text(&empty)])
        .failure()
        .stderr(contains("skip_first"));
}

fn first_picture(folder: &Path) -> String {
    let mut names: Vec<String> = std::fs::read_dir(folder)
        .unwrap()
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .collect();
    names.sort();
    names.remove(0)
}

/// It failed only after all epochs, and a link was replaced by a file.
#[test]
fn where_the_model_goes_is_checked_before_training_and_links_stay() {
    let folder = tempfile::tempdir().unwrap();
    data(folder.path());
    senda(&with(&training(folder.path(), "tiny.toml/a.senda"), &[]))
        .failure()
        .stderr(contains("tiny.toml").and(contains("epoch").not()));
    senda(&with(&training(folder.path(), "runs"), &[]))
        .failure()
        .stderr(contains("found a folder").and(contains("epoch").not()));
    let wrong = folder.path().join("tiny.toml/b.senda");
    let experiment = folder.path().join("experiment");
    let learn = ["learn", "--folder", text(&experiment), "--out", text(&wrong)];
    senda(&learn).failure().stderr(contains("tiny.toml"));
    assert!(!experiment.exists());
    #[cfg(unix)]
    {
        let link = folder.path().join("link");
        std::os::unix::fs::symlink("made/far.senda", &link).unwrap();
        std::fs::create_dir(folder.path().join("made")).unwrap();
        let arguments = training(folder.path(), "link");
        senda(&with(&arguments, &["--report", "/dev/null"])).success();
        senda(&with(&arguments, &[]))
            .success()
            .stderr(contains("far.senda.earlier"));
        assert!(link.is_symlink());
        senda(&["model", "info", text(&folder.path().join("made/far.senda"))]).success();
    }
}

/// What was asked for beside a model to go on from was ignored without a word.
#[test]
fn a_model_that_is_fine_tuned_keeps_its_network_and_pictures() {
    let folder = tempfile::tempdir().unwrap();
    data(folder.path());
    let arguments = training(folder.path(), "a.senda");
    senda(&with(&arguments, &["--crop-top", "0.25"])).success();
    let model = folder.path().join("a.senda");
    let runs = folder.path().join("runs");
    let out = folder.path().join("b.senda");
    let base = [
        "train",
        text(&runs),
        "--split",
        "runs",
        "--epochs",
        "1",
        "--out",
        text(&out),
        "--from",
        text(&model),
    ];
    let fine = |more: &[&str]| senda(&[&base[..], more].concat());
    for (wrong, words) in [
        (&["--network", "tinypilotnet"][..], ["tiny,", "tinypilotnet"]),
        (&["--colour", "saturation"], ["grey", "saturation"]),
        (&["--crop-top", "0.3"], ["0.25", "0.3"]),
        (&["--edges"], ["none", "low"]),
        (&["--stack", "2"], ["expected 1", "found 2"]),
    ] {
        fine(wrong).failure().stderr(
            contains(words[0])
                .and(contains(words[1]))
                .and(contains("a.senda")),
        );
    }
    let plan = folder.path().join("plan.toml");
    std::fs::write(&plan, "answers = [\"speed\"]\n").unwrap();
    fine(&["--plan", text(&plan)])
        .failure()
        .stderr(contains("expected steering").and(contains("found speed")));
    fine(&[
        "--crop-top",
        "0.25",
        "--colour",
        "grey",
        "--network",
        text(&folder.path().join("tiny.toml")),
    ])
    .success();
    fine(&[]).success();
}

/// Only the new data were named: an evaluation on what the base had learned warned of nothing.
#[test]
fn a_model_that_is_fine_tuned_remembers_what_its_base_learned() {
    let folder = tempfile::tempdir().unwrap();
    data(folder.path());
    let at = |name: &str| folder.path().join(name);
    let (base, out, frames) = (at("a.senda"), at("b.senda"), at("frames"));
    senda(&with(&training(folder.path(), "a.senda"), &[])).success();
    let run = at("runs/oval-lane-picar-expert-1.mcap");
    let export = ["--format", "named-frames", "--out", text(&frames)];
    senda(&[&["data", "export", text(&run)], &export[..]].concat()).success();
    let onnx = at("a.onnx");
    senda(&["model", "export", text(&base), text(&onnx)]).success();
    let network = at("tiny.toml");
    for (from, more) in [(&base, &[][..]), (&onnx, &["--network", text(&network)])] {
        let train = [
            "train",
            text(&frames),
            "--split",
            "time",
            "--epochs",
            "1",
            "--jobs",
            "1",
            "--out",
            text(&out),
            "--from",
            text(from),
        ];
        senda(&[&train[..], more].concat()).success();
        let info = json(&["model", "info", text(&out), "--json"]);
        assert_eq!(
            info["provenance"]["worlds"],
            serde_json::json!(["oval-lane"]),
            "{info}"
        );
        let learned = info["provenance"]["data"].as_array().unwrap();
        assert_eq!(learned[0], text(&at("runs")));
        assert!(learned[1].as_str().unwrap().starts_with(text(from)));
        assert_eq!(learned[2], text(&frames));
    }
    let drive = [
        "--worlds",
        "oval-lane",
        "--runs",
        "1",
        "--image",
        "40x30",
        "--json",
    ];
    let evaluated = json(&[&["evaluate", text(&out)], &drive[..]].concat());
    assert!(
        evaluated["warnings"].to_string().contains("1 of the 1 worlds"),
        "{evaluated}"
    );
}

/// It lacked what the model of `--from` decides, and trained a fresh PilotNet.
#[test]
fn the_experiment_of_a_folder_trains_the_same_again() {
    let folder = tempfile::tempdir().unwrap();
    data(folder.path());
    let at = |name: &str| folder.path().join(name);
    senda(&with(
        &training(folder.path(), "a.senda"),
        &["--crop-top", "0.25"],
    ))
    .success();
    std::fs::remove_file(at("tiny.toml")).unwrap();
    let (model, runs, kept) = (at("a.senda"), at("runs"), at("kept"));
    let (out, again) = (at("b.senda"), at("c.senda"));
    let first = [
        "train",
        text(&runs),
        "--split",
        "random-frames",
        "--allow-leak",
        "--epochs",
        "1",
        "--from",
        text(&model),
        "--folder",
        text(&kept),
        "--json",
        "--out",
        text(&out),
    ];
    let first = json(&first);
    let plan = kept.join("experiment.toml");
    let words = std::fs::read_to_string(&plan).unwrap();
    for key in [
        "from = ",
        "network = ",
        "colour = \"grey\"",
        "allow_leak = true",
        "top = 0.25",
        "stack = 1",
    ] {
        assert!(words.contains(key), "{key}: {words}");
    }
    let second = json(&["train", "--plan", text(&plan), "--out", text(&again), "--json"]);
    assert_eq!(first["history"], second["history"]);
    let info = |path: &Path| json(&["model", "info", text(path), "--json"]);
    assert_eq!(info(&out)["input"], info(&again)["input"]);
}

/// The options of the refused experiment stood over those of the one that the folder holds.
#[test]
fn a_refused_experiment_leaves_the_folder_as_it_was() {
    let folder = tempfile::tempdir().unwrap();
    data(folder.path());
    let kept = folder.path().join("kept");
    let arguments = training(folder.path(), "a.senda");
    let arguments = with(&arguments, &["--folder", text(&kept)]);
    senda(&arguments).success();
    let files = || ["experiment.toml", "checkpoint"].map(|name| std::fs::read(kept.join(name)).unwrap());
    let before = files();
    senda(&[&arguments[..], &["--learning-rate", "0.01"]].concat())
        .failure()
        .stderr(contains("expected a checkpoint of this experiment"));
    senda(&[&arguments[..], &["--batch", "0"]].concat())
        .failure()
        .stderr(contains("batch"));
    assert!(before == files());
}

/// Weights that are worse than no network replaced a good model without a word.
#[test]
fn a_training_that_diverged_is_told() {
    let folder = tempfile::tempdir().unwrap();
    data(folder.path());
    let report = folder.path().join("report.html");
    let arguments = training(folder.path(), "a.senda");
    let diverged = with(
        &arguments,
        &["--learning-rate", "10", "--report", text(&report), "--json"],
    );
    let words = "where always answering the median has";
    let assert = senda(&diverged).success().stderr(contains(words));
    let result: serde_json::Value = serde_json::from_slice(&assert.get_output().stdout).unwrap();
    assert!(result["warnings"].to_string().contains(words), "{result}");
    assert!(std::fs::read_to_string(&report).unwrap().contains(words));
    senda(&["model", "info", text(&folder.path().join("a.senda"))])
        .success()
        .stdout(contains(words));
}

#[test]
fn judging_by_what_was_learned_is_named() {
    let folder = tempfile::tempdir().unwrap();
    data(folder.path());
    let arguments = training(folder.path(), "a.senda");
    let runs = folder.path().join("runs");
    let leak = json(&with(&arguments, &["--validation", text(&runs), "--json"]));
    assert!(
        leak["warnings"].to_string().contains("2 of the 2 files"),
        "{leak}"
    );
    let twice = json(&with(&arguments, &[text(&runs), "--json"]));
    assert!(twice["warnings"].to_string().contains("named twice"), "{twice}");
    assert_eq!(
        twice["training_frames"],
        leak["training_frames"].as_u64().unwrap() / 2
    );
}

#[test]
fn a_data_set_of_one_frame_is_learned_or_refused_with_words() {
    let folder = tempfile::tempdir().unwrap();
    data(folder.path());
    let plan = folder.path().join("one.toml");
    // Of 42 frames of each of two runs.
    std::fs::write(&plan, "full_lock_deg = 50.0\n[selection]\nskip_first = 41\n").unwrap();
    let arguments = training(folder.path(), "a.senda");
    let of_one = json(&with(
        &arguments,
        &["--plan", text(&plan), "--both-ways", "--json"],
    ));
    assert_eq!(of_one["training_frames"], 1, "{of_one}");
    let (part, degrees) = (
        of_one["on_validation"]["mean_absolute"].as_f64().unwrap(),
        of_one["on_validation"]["mean_absolute_deg"].as_f64().unwrap(),
    );
    assert!((50.0 * part - degrees).abs() < 1e-9, "{of_one}");
    std::fs::write(&plan, "[selection]\nskip_first = 42\n").unwrap();
    senda(&with(&arguments, &["--plan", text(&plan)]))
        .failure()
        .stderr(contains("found none"));
    senda(&with(&arguments, &["--full-lock-deg=-3"]))
        .failure()
        .stderr(contains("full_lock_deg"));
}

/// What it printed was the text of a finished training.
#[test]
#[cfg(unix)]
fn an_interrupted_training_keeps_its_best_weights_and_goes_on() {
    let folder = tempfile::tempdir().unwrap();
    data(folder.path());
    let (kept, model) = (folder.path().join("kept"), folder.path().join("a.senda"));
    let mut arguments = training(folder.path(), "a.senda");
    let epochs = 1 + arguments
        .iter()
        .position(|argument| argument == "--epochs")
        .unwrap();
    arguments[epochs] = "90000".into();
    let mut child = std::process::Command::new(assert_cmd::cargo::cargo_bin("senda"))
        .args(with(&arguments, &["--folder", text(&kept)]))
        .stdout(std::process::Stdio::null())
        .stderr(std::process::Stdio::piped())
        .spawn()
        .unwrap();
    while !kept.join("checkpoint").exists() {
        assert!(
            child.try_wait().unwrap().is_none(),
            "the training ended by itself"
        );
        std::thread::yield_now();
    }
    let killed = std::process::Command::new("kill")
        .args(["-INT", &child.id().to_string()])
        .status()
        .unwrap();
    assert!(killed.success());
    let ended = child.wait_with_output().unwrap();
    assert_eq!(ended.status.code(), Some(130));
    let words = String::from_utf8(ended.stderr).unwrap();
    let told = format!("of 90000: the same command goes on from {}", text(&kept));
    assert!(
        words.contains("interrupted after epoch") && words.contains(&told),
        "{words}"
    );
    let info = json(&["model", "info", text(&model), "--json"]);
    let figure = info["provenance"]["metrics"]["interrupted"].as_str().unwrap();
    let page = std::fs::read_to_string(kept.join("report.html")).unwrap();
    assert!(page.contains(&format!("Interrupted {figure}.")), "{figure}");
    assert!(kept.join("checkpoint").exists() && !kept.join("checkpoint.partial").exists());
}

/// A limit on file sizes stands for the full disk: room for the options, none for the weights.
#[test]
#[cfg(unix)]
fn a_full_disk_is_named_and_nothing_half_written_stays() {
    let folder = tempfile::tempdir().unwrap();
    data(folder.path());
    let kept = folder.path().join("kept");
    let arguments = training(folder.path(), "a.senda");
    let arguments = with(&arguments, &["--folder", text(&kept)]);
    Command::new("sh")
        .args(["-c", "trap '' XFSZ; ulimit -f 16; exec \"$0\" \"$@\""])
        .arg(assert_cmd::cargo::cargo_bin("senda"))
        .args(&arguments)
        .assert()
        .failure()
        .stderr(contains("checkpoint").and(contains("panicked").not()));
    assert!(!kept.join("checkpoint").exists() && !kept.join("checkpoint.partial").exists());
    senda(&arguments).success();
    assert!(kept.join("checkpoint").exists());
}

/// The weights were gone, and nothing said how to keep them.
#[test]
#[cfg(target_os = "linux")]
fn a_model_that_finds_no_room_is_had_from_the_checkpoint() {
    let folder = tempfile::tempdir().unwrap();
    data(folder.path());
    let kept = folder.path().join("kept");
    let mut arguments = training(folder.path(), "a.senda");
    let good = arguments.clone();
    *arguments.last_mut().unwrap() = "/dev/full".into();
    senda(&with(&arguments, &[]))
        .failure()
        .stderr(contains("/dev/full").and(contains("the weights are lost: with --folder")));
    senda(&with(&arguments, &["--folder", text(&kept)]))
        .failure()
        .stderr(contains("goes on from the checkpoint in").and(contains(text(&kept))));
    // Nothing is trained again.
    senda(&with(&good, &["--folder", text(&kept)]))
        .success()
        .stderr(contains("epoch 1").not());
}

#[test]
fn learning_on_a_tiny_budget_makes_a_model_that_drives() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("tiny.toml"), NETWORK).unwrap();
    let plan = folder.path().join("plan.toml");
    std::fs::write(
        &plan,
        "round_epochs = 1\n[gathering]\nimage_px = [40, 30]\ndrive_frames = 6\n[training]\nepochs = 1\n",
    )
    .unwrap();
    let model = folder.path().join("model.senda");
    let experiment = folder.path().join("experiment");
    let tiny = folder.path().join("tiny.toml");
    let learn = |more: &[&str]| -> serde_json::Value {
        let arguments = [
            "learn",
            "--plan",
            text(&plan),
            "--network",
            text(&tiny),
            "--expert-frames",
            "20",
            "--rounds",
            "1",
            "--round-frames",
            "20",
            "--epochs",
            "1",
            "--trial-runs",
            "0",
            "--folder",
            text(&experiment),
            "--json",
        ];
        json(&[&arguments[..], more].concat())
    };
    let result = learn(&["--out", text(&model)]);
    assert_eq!(result["rounds"].as_array().unwrap().len(), 2);
    // The budget is the least; the model says what it was, not what was asked for.
    let [expert, all] = [0, 1].map(|round| result["rounds"][round]["frames"].as_u64().unwrap());
    assert!(expert >= 20 && all >= expert + 20, "{result}");
    let info = json(&["model", "info", text(&model), "--json"]);
    let told = format!(
        "{expert} frames by the expert, {} frames of 1 rounds",
        all - expert
    );
    assert!(
        info["provenance"]["data"][0].as_str().unwrap().starts_with(&told),
        "{info}"
    );
    let page = std::fs::read_to_string(folder.path().join("experiment/report.html")).unwrap();
    assert!(page.contains("Learning by correction") && page.contains("Loss over the epochs"));
    let drive = json(&[&at_the_wheel("unseen-1", "picar", text(&model))[..], &A_SECOND].concat());
    assert!(drive["frames"].as_u64().unwrap() > 5);
    // What it goes on from stays known.
    std::fs::remove_dir_all(&experiment).unwrap();
    let further = folder.path().join("further.senda");
    learn(&["--from", text(&model), "--out", text(&further)]);
    let further = json(&["model", "info", text(&further), "--json"])["provenance"]["data"].clone();
    assert_eq!(further[0], info["provenance"]["data"][0]);
    assert!(
        further[1].as_str().unwrap().starts_with(text(&model)),
        "{further}"
    );
    std::fs::write(&plan, "epochz = 1\n").unwrap();
    senda(&["learn", "--plan", text(&plan)])
        .failure()
        .stderr(contains("plan.toml").and(contains("epochz")));
}
