//! Deliveries as a user types them: one whole, and the first seconds of others. Many whole ones are measured in
//! docs/results/deliveries.md.

use assert_cmd::Command;
use predicates::prelude::*;
use predicates::str::contains;
use std::path::Path;

fn senda(arguments: &[&str]) -> assert_cmd::assert::Assert {
    Command::cargo_bin("senda")
        .unwrap()
        .arg("deliver")
        .args(arguments)
        .assert()
}

fn json(arguments: &[&str]) -> serde_json::Value {
    let output = senda(arguments).success();
    serde_json::from_slice(&output.get_output().stdout).unwrap()
}

#[test]
fn a_delivery_begins_says_what_it_does_and_is_the_same_every_time() {
    let begin = ["--package", "I1", "--seed", "3", "--time-limit", "1", "--json"];
    let one = json(&begin);
    assert_eq!((&one["goal"], &one["package"]), (&1.into(), &"I1".into()));
    assert_eq!(one["delivered_to"], serde_json::Value::Null);
    for (key, value) in [("correct", false), ("returned", false)] {
        assert_eq!(one[key], value, "{key}");
    }
    for key in ["red_light_violations", "departures"] {
        assert_eq!(one[key], 0, "{key}");
    }
    assert!((one["time_s"].as_f64().unwrap() - 1.0).abs() < 0.1, "{one}");
    assert!(one["stops"].is_array() && one["ended"].is_string(), "{one}");
    let first = one["events"][0]["text"].as_str().unwrap();
    assert_eq!(first, "wait_package -> to_area: package read, I1");
    assert_eq!(json(&begin)["digest"], one["digest"]);
    let mut other = begin;
    other[3] = "4";
    assert_ne!(json(&other)["digest"], one["digest"], "other noise");
}

/// There and back, in small frames: past a light, by a sign and a code, square before every crossing.
#[test]
fn a_package_is_delivered_and_the_vehicle_comes_home() {
    let one = json(&["--package", "I0", "--seed", "6", "--image", "320x240", "--json"]);
    assert_eq!(one["delivered_to"], 0, "{one}");
    for (key, value) in [("correct", true), ("returned", true)] {
        assert_eq!(one[key], value, "{key}: {one}");
    }
    for key in ["red_light_violations", "departures"] {
        assert_eq!(one[key], 0, "{key}: {one}");
    }
    let stops = one["stops"].as_array().unwrap();
    assert_eq!(stops.len(), 3, "area, depot, start: {one}");
    let off_m = |stop: &serde_json::Value| stop["distance_error_m"].as_f64().unwrap().abs();
    let mean_m = stops.iter().map(off_m).sum::<f64>() / 3.0;
    assert!(mean_m < 0.01, "{mean_m} m: {one}");
}

#[test]
fn what_cannot_be_delivered_is_refused_by_name() {
    senda(&["--package", "I9"])
        .failure()
        .stderr(contains("\"I9\"").and(contains("I0, I1, I2")));
    senda(&["--world", "oval"])
        .failure()
        .stderr(contains("oval is no warehouse"));
    senda(&["--option", "detector=5"])
        .failure()
        .stderr(contains("detector").and(contains("classical")));
    senda(&["--option", "detector=no-such-file.senda"])
        .failure()
        .stderr(contains("detector: ").and(contains("no-such-file.senda")));
    senda(&["--option", "foo=1"])
        .failure()
        .stderr(contains("expected one of `detector`, `speed_mps`"));
}

/// The network in `models/` finds signs and lights instead of colours and shapes.
#[test]
fn a_trained_detector_can_be_chosen() {
    let model = concat!(env!("CARGO_MANIFEST_DIR"), "/../../models/detector-small.senda");
    let option = format!("detector={model:?}");
    let one = json(&[
        "--option",
        &option,
        "--image",
        "320x240",
        "--time-limit",
        "1",
        "--json",
    ]);
    assert!(one["frames"].as_u64().unwrap() > 10, "{one}");
    let lane = option.replace("detector-small", "lane-small");
    senda(&["--option", &lane])
        .failure()
        .stderr(contains("expected a detector"));
}

/// The vehicle file's own battery counts, in the drive and in its replay; it was the cart's for every vehicle.
#[test]
fn a_mission_ends_at_the_voltage_of_its_vehicles_battery() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let cart = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../vehicles/warehouse-cart.toml");
    let cart = std::fs::read_to_string(cart).unwrap();
    let line = cart.lines().find(|line| line.starts_with("empty_v")).unwrap();
    let (weak, runs) = (at("weak.toml"), at("runs"));
    std::fs::write(&weak, cart.replace(line, "empty_v = 99.0")).unwrap();
    let told = json(&[
        "--vehicle",
        weak.to_str().unwrap(),
        "--time-limit",
        "3",
        "--image",
        "160x120",
        "--record",
        runs.to_str().unwrap(),
        "--json",
    ]);
    let reason = told["reason"]["text"].as_str().unwrap();
    assert!(reason.contains("below 99.0 V"), "{reason}");
    let recording = std::fs::read_dir(&runs).unwrap().next().unwrap().unwrap().path();
    let mut replay = Command::cargo_bin("senda").unwrap();
    replay.arg("replay").arg(&recording).assert().success();
}
