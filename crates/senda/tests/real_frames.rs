//! Frames of vehicles that senda does not drive, their cameras and their wheels, as a user meets them.

mod support;

use predicates::prelude::*;
use predicates::str::contains;
use senda_run::photograph;
use senda_vision::calibration::Sheet;
use senda_world::VehicleSpec;
use std::path::{Path, PathBuf};
use support::{json, senda, text};

/// A tub of what the GoPiGo saw while its own driver kept the lane.
fn gopigo_tub(folder: &Path) -> PathBuf {
    let drive = [
        "drive",
        "--world",
        "s-curves-lane",
        "--vehicle",
        "gopigo",
        "--driver",
        "lane",
    ];
    let tub = folder.join("tub");
    senda(&[&drive[..], &["--time-limit", "8", "--record", text(folder)]].concat()).success();
    let run = folder.join("s-curves-lane-gopigo-lane-1.mcap");
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
    tub
}

/// The sizes of a racing car's lane were set for every vehicle, and stayed when somebody chose the form: no lane was found in
/// frames on which the same driver had just driven.
#[test]
fn frames_of_a_small_vehicle_show_their_lane() {
    let folder = tempfile::tempdir().unwrap();
    let tub = gopigo_tub(folder.path());
    let report = folder.path().join("replay.html");
    // Its driver was said to be a human.
    assert_eq!(json(&["data", "info", text(&tub), "--json"])["driver"], "lane");
    for (form, least_r) in [("road", 0.7), ("curve", 0.95)] {
        let option = format!("form={form}");
        let mut replay = vec![
            "replay",
            text(&tub),
            "--vehicle",
            "gopigo",
            "--driver",
            "lane",
            "--json",
            "--report",
            text(&report),
        ];
        if form != "road" {
            replay.extend(["--option", &option]);
        }
        let output = senda(&replay)
            .success()
            .stderr(contains(format!("form=\"{form}\"")));
        let figures: serde_json::Value = serde_json::from_slice(&output.get_output().stdout).unwrap();
        assert_eq!(figures["found_rate"], 1.0, "{form}");
        if form == "road" {
            // Steered along the road (`road.centring=0`), the plot of d was a line at 0.
            let plotted = std::fs::read_to_string(&report).unwrap();
            let d = plotted.split_once(r#""signal d_m":{"#).unwrap().1;
            let values = d
                .split_once(r#""values":["#)
                .unwrap()
                .1
                .split(']')
                .next()
                .unwrap();
            let largest = values
                .split(',')
                .filter_map(|value| value.parse::<f64>().ok())
                .fold(0.0, f64::max);
            assert!(largest > 0.5, "{values}");
        }
        let r = figures["agreement"]["correlation"].as_f64().unwrap();
        assert!(r > least_r, "{form}: {r}");
    }
}

/// A calibration could not be given for recorded frames, and what belongs to a vehicle was left out without a word.
#[test]
fn a_calibration_tells_where_the_floor_of_recorded_frames_is() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let tub = gopigo_tub(folder.path());
    let [own, unknown, other] = ["own.toml", "unknown.toml", "other.toml"].map(at);
    let calibrate = ["calibrate", "camera", "--simulate", "--accept", "--out"];
    senda(&[&calibrate[..], &[text(&own)]].concat()).success();
    senda(&[&calibrate[..], &[text(&unknown), "--unknown-lens"]].concat())
        .success()
        .stdout(contains("height 9.").and(contains("tilt 3")));
    senda(&[&calibrate[..], &[text(&other), "--vehicle", "picar"]].concat()).success();
    let replay = ["replay", text(&tub), "--vehicle", "gopigo", "--json"];
    let figures = |more: &[&str]| json(&[&replay[..], more].concat());
    let bare = figures(&[]);
    // What the simulated camera's mounting is off by changes commands a little.
    for file in [&own, &unknown] {
        let told = figures(&["--calibration", text(file)]);
        assert_eq!(told["found_rate"], 1.0, "{}", file.display());
        assert_ne!(told["agreement"], bare["agreement"]);
    }
    senda(&[&replay[..], &["--calibration", text(&other)]].concat())
        .success()
        .stderr(contains("the calibration is of another vehicle"));
    let drive = [
        "drive",
        "--world",
        "oval",
        "--time-limit",
        "2",
        "--calibration",
        text(&unknown),
    ];
    senda(&drive).success();
    let run = at("s-curves-lane-gopigo-lane-1.mcap");
    senda(&["replay", text(&run), "--vehicle", "picar"])
        .success()
        .stderr(contains("it brings its own vehicle, gopigo"));
}

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

/// "The driver stopped" was said of what the guard had done, and nothing told of the guard.
#[test]
fn who_stopped_a_vehicle_is_told() {
    let drive = [
        "drive",
        "--world",
        "oval",
        "--driver",
        "line",
        "--vehicle",
        "gopigo",
    ];
    let late = [&drive[..], &["--latency", "0.5", "--json"]].concat();
    let output = senda(&late).stderr(contains("the guard stops a vehicle"));
    let figures: serde_json::Value = serde_json::from_slice(&output.get_output().stdout).unwrap();
    assert_eq!(
        figures["ended"],
        "the guard stopped it: no picture younger than 0.5 s"
    );
    assert!(figures["guard_stops"].as_u64().unwrap() > 50, "{figures}");
    let figures = json(&[&drive[..], &["--time-limit", "2", "--json"]].concat());
    assert_eq!(figures["guard_stops"], 0);
}

/// A data set without a single usable record was a success of every command.
#[test]
fn data_without_anything_usable_are_a_failure() {
    let folder = tempfile::tempdir().unwrap();
    let (tub, out) = (folder.path().join("tub"), folder.path().join("out"));
    std::fs::create_dir(&tub).unwrap();
    let record = r#"{"_index": 0, "cam/image_array": "0_cam_image_array_.jpg", "user/angle": 7.5, "user/throttle": 0.1}"#;
    std::fs::write(tub.join("catalog_0.catalog"), record).unwrap();
    let cause = contains("expected -1 to 1, but found 7.5");
    senda(&["data", "info", text(&tub)])
        .failure()
        .stdout(cause.clone())
        .stderr(contains("none"));
    senda(&["replay", text(&tub)])
        .failure()
        .stderr(cause.clone().and(contains("none")));
    senda(&["data", "import", text(&tub), "--out", text(&out)])
        .failure()
        .stderr(cause.clone());
    senda(&["data", "stats", text(&tub)])
        .failure()
        .stdout(cause.clone())
        .stderr(contains("none"));
    let export = ["--format", "tub", "--out", text(&out)];
    senda(&[&["data", "export", text(&tub)], &export[..]].concat())
        .failure()
        .stderr(cause);
    assert!(!out.exists());
}
