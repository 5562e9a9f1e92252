//! Frames of vehicles that senda does not drive, their cameras and their wheels, as a user meets them.

mod support;

use predicates::prelude::*;
use predicates::str::contains;
use senda_run::photograph;
use senda_vision::calibration::Sheet;
use senda_world::VehicleSpec;
use std::path::PathBuf;
use support::{json, senda, text};

/// A photograph by another lens, or of another shape, gave a camera 3 cm too high and was accepted.
#[test]
fn photographs_by_another_lens_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let own = include_str!("../../../vehicles/gopigo.toml");
    let lens = "horizontal_view_deg = 54, vertical_view_deg = 42.3";
    let photograph = |name: &str, lens_now: &str, [width_px, height_px]: [u32; 2]| {
        assert!(own.contains(lens));
        let spec = VehicleSpec::parse(name, &own.replace(lens, lens_now)).unwrap().0;
        let spec = spec.with_camera_size(width_px, height_px);
        let sheet =
            Sheet::for_camera(&VehicleSpec::named("gopigo").unwrap().body().cameras[0], false).unwrap();
        let image = photograph::of_sheet(&spec, &sheet, 1).unwrap();
        let file = folder.path().join(name);
        std::fs::write(&file, senda_core::codec::encode_png(&image).unwrap().bytes).unwrap();
        file
    };
    let wide = photograph(
        "wide.png",
        "horizontal_view_deg = 70, vertical_view_deg = 55.4",
        [640, 480],
    );
    let shape = photograph(
        "shape.png",
        "horizontal_view_deg = 62, vertical_view_deg = 37.3",
        [640, 360],
    );
    let out = folder.path().join("calibration.toml");
    let calibrate = |photo: &PathBuf| {
        [
            "calibrate",
            "camera",
            text(photo),
            "--accept",
            "--out",
            text(&out),
        ]
        .map(str::to_owned)
    };
    for (photo, warned) in [(&wide, false), (&shape, true)] {
        let words = calibrate(photo);
        let words: Vec<&str> = words.iter().map(String::as_str).collect();
        let refused = senda(&words)
            .failure()
            .stderr(contains("another lens").and(contains("--unknown-lens")));
        let stderr = String::from_utf8_lossy(&refused.get_output().stderr).into_owned();
        assert_eq!(
            stderr.contains("its lens was stretched to fit"),
            warned,
            "{stderr}"
        );
        assert!(!out.exists());
        let told = json(&[&words[..], &["--unknown-lens", "--json"]].concat());
        let mounting = &told["camera"]["mounting"];
        let (height_m, tilt_rad) = (
            mounting["z_m"].as_f64().unwrap(),
            mounting["tilt_rad"].as_f64().unwrap(),
        );
        assert!(
            (height_m - 0.095).abs() < 0.004 && (tilt_rad.to_degrees() - 33.0).abs() < 1.5,
            "{mounting}"
        );
        std::fs::remove_file(&out).unwrap();
    }
}

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
