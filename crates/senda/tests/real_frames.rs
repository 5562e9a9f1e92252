//! Frames of vehicles that senda does not drive, their cameras and their wheels, as a user meets them.

mod support;

use predicates::str::contains;
use support::{json, text};

/// C14: ticks were recorded and nothing made a path of them.
#[test]
fn the_wheels_alone_tell_a_path() {
    let folder = tempfile::tempdir().unwrap();
    let report = folder.path().join("report.html");
    let drive = [
        "drive",
        "--world",
        "oval",
        "--driver",
        "line",
        "--time-limit",
        "12",
        "--json",
    ];
    let figures = json(&[&drive[..], &["--vehicle", "gopigo", "--report", text(&report)]].concat());
    let (way_m, end_m) = (
        figures["distance_m"].as_f64().unwrap(),
        figures["odometry"]["end_error_m"].as_f64().unwrap(),
    );
    // Wheels that slip by 3 %, and are 1 % unlike: not exact, and far from lost.
    assert!(way_m > 1.0 && 0.0 < end_m && end_m < 0.15 * way_m, "{figures}");
    assert!(figures["odometry"]["end_error_rad"].as_f64().unwrap() < 0.5);
    let page = std::fs::read_to_string(&report).unwrap();
    assert!(page.contains("<title>odometry</title>") && page.contains("Odometry ends off by"));
    // Wheels without encoders tell none.
    let figures = json(&[&drive[..], &["--vehicle", "unicycle"]].concat());
    assert_eq!(figures.get("odometry"), None);
}
