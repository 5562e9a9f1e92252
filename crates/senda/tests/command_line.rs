//! The real binary, as a user types it.

mod support;

use assert_cmd::Command;
use predicates::prelude::*;
use support::{json, senda, text};

const SHORT: [&str; 8] = [
    "--world",
    "straight",
    "--vehicle",
    "gopigo",
    "--driver",
    "line",
    "--time-limit",
    "3",
];

#[test]
fn without_arguments_it_greets_and_names_three_commands() {
    senda(&[]).success().stdout(
        predicate::str::contains("senda tour")
            .and(predicate::str::contains("senda drive"))
            .and(predicate::str::contains("senda replay")),
    );
}

/// They ended with a panic's words and exit code 101.
#[cfg(target_os = "linux")]
#[test]
fn a_full_disk_on_standard_output_is_an_error() {
    for arguments in [
        &[][..],
        &["world", "list"],
        &["world", "check", "oval"],
        &["net", "list"],
        &["net", "print", "pilotnet"],
        &["model", "info", "models/lane-small.senda"],
        &["study", "follow", "--duration", "1"],
        &["calibrate", "placement"],
        &["drive", "--time-limit", "0.5"],
    ] {
        let full = std::fs::File::options().write(true).open("/dev/full").unwrap();
        let output = std::process::Command::new(env!("CARGO_BIN_EXE_senda"))
            .current_dir(concat!(env!("CARGO_MANIFEST_DIR"), "/../.."))
            .args(arguments)
            .stdout(full)
            .output()
            .unwrap();
        let words = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(1), "{arguments:?}: {words}");
        assert!(
            words.contains("error: cannot print the result") && !words.contains("panicked"),
            "{arguments:?}: {words}"
        );
    }
}

/// "unexpected argument '-1'" told no range; and other complaints did not say what to do.
#[test]
fn values_out_of_range_are_told_their_range() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out.toml");
    for (arguments, words) in [
        (
            &["drive", "--latency", "-1"][..],
            "`latency_s` is -1, but must be 0 to 5",
        ),
        (&["drive", "--seed", "-1"], "invalid value '-1' for '--seed <S>'"),
        (
            &["study", "follow", "--kp", "-1"],
            "expected a number from 0 to 1000, but found -1",
        ),
        (
            &["world", "random", "--min-radius", "-1", "--out", text(&out)],
            "--min-radius",
        ),
        (
            &["world", "random", "--family", "random-lin", "--out", text(&out)],
            "did you mean \"random-line:",
        ),
        (
            &["sweep", "--sample", "0"],
            "`sample` is 0, but must be at least 1",
        ),
        (
            &["calibrate", "placement", "--near", "0.5", "--far", "0.07"],
            "a near limit above 0 and below the far one",
        ),
        (
            &["calibrate", "placement", "--height", "-1"],
            "--height -1: expected metres above 0",
        ),
        (&["calibrate", "placement", "--height", "nan"], "--height NaN"),
        (
            &["calibrate", "placement", "--view-deg", "0"],
            "--view-deg 0: expected",
        ),
        (
            &["calibrate", "placement", "--view-deg", "200"],
            "expected degrees above 0 and below 180",
        ),
        (
            &[
                "calibrate",
                "view-angle",
                "--page-px",
                "400",
                "--image-px",
                "320",
                "--distance",
                "0.5",
            ],
            "a page not larger than the picture",
        ),
        (
            &["drive", "--driver", "lane", "--option", "road.kept=-1"],
            "option `road.kept`: expected a number from 0 to",
        ),
        (
            &["drive", "--driver", "lane", "--option", "road.least_part=7"],
            "option `road.least_part`: expected a number from 0 to 2",
        ),
        (&["sweep", "--seeds", "0"], "`seeds` is 0, but must be at least 1"),
        (
            &["sweep", "--spread-offset", "-1"],
            "`start_spread.offset_m` is -1, but must be 0 to",
        ),
        (
            &["calibrate", "camera", "--out", text(&out)],
            "with --simulate the simulated camera takes it",
        ),
        (
            &["study", "follow", "--form", "curve", "--kp", "1.1,3"],
            "--kp: only the document's form has this gain",
        ),
        (
            &["drive", "--world", "straight", "--start-station", "999"],
            "`start.station_m` is 999, but must be 0.00 to 5.30",
        ),
    ] {
        let failed = senda(arguments).failure();
        let found = String::from_utf8_lossy(&failed.get_output().stderr).into_owned();
        assert!(found.contains(words), "{arguments:?}: {words:?} in {found}");
        assert!(!found.contains("unexpected argument"), "{found}");
    }
}

#[test]
fn the_summary_has_every_promised_field() {
    let summary = json(&[&["drive", "--json"], &SHORT[..]].concat());
    for field in [
        "completed",
        "laps",
        "departures",
        "lost",
        "lane_error_mean_m",
        "lane_error_max_m",
        "heading_error_mean_rad",
        "heading_error_max_rad",
        "lap_time_s",
        "distance_m",
        "frames",
        "digest",
        "wall_s",
    ] {
        assert!(summary.get(field).is_some(), "{field} is missing");
    }
    assert!(summary["frames"].as_u64().unwrap() > 20);
}

#[test]
fn the_same_run_gives_the_same_bytes_and_its_replay_the_same_commands() {
    let folder = tempfile::tempdir().unwrap();
    let record = |name: &str| -> Vec<u8> {
        let path = folder.path().join(name);
        senda(&[&["drive", "--seed", "5", "--record", text(&path)], &SHORT[..]].concat()).success();
        std::fs::read(path.join("straight-gopigo-line-5.mcap")).unwrap()
    };
    assert!(
        record("a") == record("b"),
        "two recordings of the same run differ"
    );
    let recording = folder.path().join("a/straight-gopigo-line-5.mcap");
    let report = folder.path().join("replay.html");
    let replay = json(&["replay", text(&recording), "--json", "--report", text(&report)]);
    assert_eq!(replay["different_commands"], 0);
    // Wall times are in no recording: the replay measures them again.
    let [mean_s, longest_s] =
        ["frame_time_mean_s", "frame_time_max_s"].map(|key| replay[key].as_f64().unwrap());
    assert!(0.0 < mean_s && mean_s <= longest_s);
    assert!(std::fs::read_to_string(&report).unwrap().contains("Time spent"));
    senda(&["replay", text(&recording)])
        .success()
        .stdout(predicate::str::contains("time a frame: mean"));
    assert!(!std::fs::read_to_string(&report).unwrap().contains("no summary"));
    assert!(replay["steps"].as_u64().unwrap() > 20);
    let other = json(&[&["drive", "--json", "--seed", "6"], &SHORT[..]].concat());
    let same = json(&[&["drive", "--json", "--seed", "5"], &SHORT[..]].concat());
    assert_ne!(other["digest"], same["digest"]);
}

#[test]
fn a_recording_cut_short_is_read_up_to_the_break() {
    let folder = tempfile::tempdir().unwrap();
    senda(&[&["drive", "--record", text(folder.path())], &SHORT[..]].concat()).success();
    let path = folder.path().join("straight-gopigo-line-1.mcap");
    let whole = std::fs::read(&path).unwrap();
    std::fs::write(&path, &whole[..whole.len() * 6 / 10]).unwrap();
    let info = senda(&["data", "info", text(&path)]).success();
    let output = String::from_utf8_lossy(&info.get_output().stdout).into_owned()
        + &String::from_utf8_lossy(&info.get_output().stderr);
    assert!(
        output.contains("cut") || output.contains("break") || output.contains("ends"),
        "{output}"
    );
    senda(&["replay", text(&path)]).success();
}

#[test]
fn a_speed_beyond_the_vehicles_is_warned_of() {
    senda(&[&["drive", "--speed", "5"], &SHORT[..]].concat())
        .success()
        .stderr(predicate::str::contains("gopigo goes 0.40 m/s at most"));
    senda(&[&["drive", "--speed", "0.2"], &SHORT[..]].concat())
        .success()
        .stderr(predicate::str::contains("at most").not());
}

#[test]
fn mistakes_are_answered_with_what_to_do() {
    senda(&["drive", "--world", "ovall"])
        .failure()
        .stderr(predicate::str::contains("oval"));
    senda(&["drive", "--driver", "lime"])
        .failure()
        .stderr(predicate::str::contains("expected one of line, lane"));
    senda(&["drive", "--option", "no_such_option=1"])
        .failure()
        .stderr(predicate::str::contains("no_such_option"));
    senda(&["drive", "--laps", "0"])
        .failure()
        .stderr(predicate::str::contains("laps"));
    senda(&["drive", "--world", "missing.toml"])
        .failure()
        .stderr(predicate::str::contains("missing.toml: expected a world file"));
    senda(&["replay", "missing.mcap"])
        .failure()
        .stderr(predicate::str::contains("missing.mcap"));
}

#[test]
fn a_broken_world_names_the_line_and_the_nearest_key() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("mine.toml");
    for (content, expected) in [
        ("", "empty"),
        ("name = \"x\"\n[path\n", "2"),
        (
            "name = \"x\"\n[path]\npieces = [{ kind = \"straight\", length_m = 1 }]\n[[markings]]\nwidth_m = 0.02\ncolour = \"black\"\n[flor]\nkind = \"plain\"\n",
            "floor",
        ),
    ] {
        std::fs::write(&path, content).unwrap();
        senda(&["world", "check", text(&path)])
            .failure()
            .stderr(predicate::str::contains("mine.toml").and(predicate::str::contains(expected)));
    }
}

#[test]
fn reports_are_one_file_with_everything_inside() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.html");
    senda(&[&["drive", "--report", text(&path)], &SHORT[..]].concat()).success();
    let page = std::fs::read_to_string(path).unwrap();
    assert!(page.starts_with("<!doctype html>") || page.starts_with("<!DOCTYPE html>"));
    assert!(
        page.contains("data:image/jpeg;base64") || page.contains("/9j/"),
        "no pictures inside"
    );
    for foreign in ["src=\"http", "href=\"http", "@import"] {
        assert!(!page.contains(foreign), "the page refers to {foreign}");
    }
}

#[test]
fn a_sweep_gives_rates_with_intervals_and_goes_on_where_it_was() {
    let folder = tempfile::tempdir().unwrap();
    let results = folder.path().join("results.jsonl");
    let arguments = [
        &[
            "sweep",
            "--json",
            "--worlds",
            "straight,oval",
            "--seeds",
            "2",
            "--results",
            text(&results),
        ],
        &["--vehicle", "gopigo", "--driver", "line", "--time-limit", "1"][..],
    ]
    .concat();
    let first = json(&arguments);
    assert_eq!(
        (&first["runs"], &first["interrupted"]),
        (&4.into(), &false.into())
    );
    let lines = std::fs::read_to_string(&results).unwrap().lines().count();
    assert_eq!(lines, 4);
    json(&arguments);
    assert_eq!(std::fs::read_to_string(&results).unwrap().lines().count(), 4);
}

#[cfg(unix)]
#[test]
fn an_interrupted_recording_stays_readable() {
    let folder = tempfile::tempdir().unwrap();
    let program = assert_cmd::cargo::cargo_bin("senda");
    let mut child = std::process::Command::new(program)
        .args([
            "drive",
            "--world",
            "oval",
            "--driver",
            "line",
            "--laps",
            "1000",
            "--record",
            text(folder.path()),
        ])
        .stdout(std::process::Stdio::null())
        .stderr(std::process::Stdio::null())
        .spawn()
        .unwrap();
    let path = folder.path().join("oval-gopigo-line-1.mcap");
    // Wait until something was written, then interrupt as Ctrl-C does.
    while std::fs::metadata(&path).map_or(0, |file| file.len()) < 200_000 {
        assert!(child.try_wait().unwrap().is_none(), "the run ended by itself");
        std::thread::yield_now();
    }
    interrupt(&child);
    assert_eq!(child.wait().unwrap().code(), Some(130));
    senda(&["replay", text(&path)]).success();
}

/// Sends what Ctrl-C sends.
#[cfg(unix)]
fn interrupt(child: &std::process::Child) {
    let killed = std::process::Command::new("kill")
        .args(["-INT", &child.id().to_string()])
        .status()
        .unwrap();
    assert!(killed.success());
}

/// Starts a command, interrupts it as soon as it is `ready`, and gives what it printed. The program must end with 130.
#[cfg(target_os = "linux")]
fn interrupted(arguments: &[&str], ready: &dyn Fn() -> bool) -> String {
    let program = assert_cmd::cargo::cargo_bin("senda");
    let mut child = std::process::Command::new(program)
        .args(arguments)
        .stdout(std::process::Stdio::piped())
        .stderr(std::process::Stdio::null())
        .spawn()
        .unwrap();
    // Before the program listens, the signal would end it at once.
    let listens = |id: u32| {
        let status = std::fs::read_to_string(format!("/proc/{id}/status")).unwrap_or_default();
        let caught = status.lines().find_map(|line| line.strip_prefix("SigCgt:"));
        caught.is_some_and(|mask| u64::from_str_radix(mask.trim(), 16).unwrap() & 2 != 0)
    };
    while !(listens(child.id()) && ready()) {
        assert!(child.try_wait().unwrap().is_none(), "it ended by itself");
        std::thread::yield_now();
    }
    interrupt(&child);
    let output = child.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(130));
    String::from_utf8(output.stdout).unwrap()
}

/// They ended with 0, as if they had done all of it.
#[cfg(target_os = "linux")]
#[test]
fn what_is_interrupted_says_so_and_keeps_what_it_has() {
    let folder = tempfile::tempdir().unwrap();
    let (results, tour) = (
        folder.path().join("results.jsonl"),
        folder.path().join("tour.html"),
    );
    let sweep = [
        &["sweep", "--json", "--seeds", "5000", "--results", text(&results)],
        &SHORT[..],
    ]
    .concat();
    let lines = || std::fs::read_to_string(&results).map_or(0, |text| text.lines().count());
    let told = interrupted(&sweep, &|| lines() > 0);
    let told: serde_json::Value = serde_json::from_str(&told).unwrap();
    assert_eq!(
        (&told["interrupted"], &told["wanted"]),
        (&true.into(), &5000.into())
    );
    assert_eq!(told["runs"].as_u64().unwrap(), lines() as u64);

    let told = interrupted(&["tour", "--report", text(&tour)], &|| true);
    assert!(told.contains("interrupted: 6 of 6 runs are cut short"), "{told}");
    assert!(
        std::fs::read_to_string(&tour)
            .unwrap()
            .contains("interrupted after")
    );

    let learn = ["learn", "--json", "--folder", text(folder.path())];
    let experiment = folder.path().join("experiment.toml");
    let told = interrupted(&learn, &|| experiment.exists());
    let told: serde_json::Value = serde_json::from_str(&told).unwrap();
    assert_eq!(
        (&told["interrupted"], &told["rounds"]),
        (&true.into(), &serde_json::json!([]))
    );

    let told = interrupted(&["drive", "--laps", "1000"], &|| true);
    assert!(told.contains("interrupted after 0 %"), "{told}");

    let drive = [
        "drive",
        "--world",
        "oval",
        "--time-limit",
        "30",
        "--record",
        text(folder.path()),
    ];
    senda(&drive).success();
    let (recording, report) = (
        folder.path().join("oval-gopigo-line-1.mcap"),
        folder.path().join("replay.html"),
    );
    let told = interrupted(&["replay", text(&recording), "--report", text(&report)], &|| true);
    assert!(told.contains("interrupted after "), "{told}");
    assert!(
        std::fs::read_to_string(&report)
            .unwrap()
            .contains("interrupted after ")
    );
}

/// Rates over no run at all were given as the result of the sweep.
#[test]
fn a_sweep_with_runs_that_could_not_be_run_says_how_many_and_fails() {
    let sweep = |worlds: &str| {
        let arguments = [
            "sweep",
            "--driver",
            "line",
            "--time-limit",
            "1",
            "--worlds",
            worlds,
        ];
        senda(&arguments).failure().code(1)
    };
    sweep("oval,no-such-world")
        .stdout(predicate::str::contains(
            "1 of 2 runs could not be run and count in no rate",
        ))
        .stderr(predicate::str::contains(
            "error: 1 of 2 runs could not be run; the first: senda drive --world no-such-world",
        ));
    sweep("no-such-world").stderr(predicate::str::contains("error: 1 of 1 runs could not be run"));
}

/// A limit on file sizes stands for the full disk: writing fails in the middle of a file in the same way.
#[test]
#[cfg(unix)]
fn a_full_disk_ends_the_run_with_its_words_and_keeps_what_was_written() {
    let folder = tempfile::tempdir().unwrap();
    let program = assert_cmd::cargo::cargo_bin("senda");
    let arguments = [&["drive", "--record", text(folder.path())], &SHORT[..]].concat();
    Command::new("sh")
        .args(["-c", "trap '' XFSZ; ulimit -f 128; exec \"$0\" \"$@\""])
        .arg(program)
        .args(arguments)
        .assert()
        .failure()
        .stderr(
            predicate::str::contains("straight-gopigo-line-1.mcap")
                .and(predicate::str::contains("panicked").not()),
        );
    let path = folder.path().join("straight-gopigo-line-1.mcap");
    let replay = json(&["replay", text(&path), "--json"]);
    assert!(replay["steps"].as_u64().unwrap() > 5);
}

#[test]
#[cfg(unix)]
fn a_reader_that_has_enough_is_no_error() {
    let program = assert_cmd::cargo::cargo_bin("senda");
    Command::new("sh")
        .args(["-c", "\"$0\" world random --seed 3 | head -c 1"])
        .arg(program)
        .assert()
        .success()
        .stderr(predicate::str::contains("panicked").not());
}

#[test]
fn worlds_are_drawn_made_and_printed() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    senda(&["world", "draw", "oval", "--out", text(&at("oval.svg"))]).success();
    senda(&["world", "draw", "oval", "--out", text(&at("oval.png"))]).success();
    // Boards are a PDF, which lay under any name.
    senda(&["world", "boards", "warehouse", "--out", text(&at("boards.png"))])
        .failure()
        .stderr(predicate::str::contains(
            "boards.png: expected a name that ends in .pdf",
        ));
    senda(&["world", "random", "--seed", "3", "--out", text(&at("made.toml"))]).success();
    senda(&["world", "check", text(&at("made.toml")), "oval"]).success();
    let stores = at("stores.toml");
    let family = [
        "world",
        "random",
        "--family",
        "random-warehouse",
        "--out",
        text(&stores),
    ];
    senda(&family).success();
    senda(&["world", "check", text(&stores)]).success();
    senda(&[&family[..], &["--length", "4,9"]].concat())
        .failure()
        .stderr(predicate::str::contains("its own measures"));
    senda(&["world", "print", "oval", "--out", text(&at("oval.pdf"))]).success();
    // Pages without an ending were pages that no program opened.
    senda(&["world", "print", "circuit-5", "--out", text(&at("pages"))]).success();
    let mut pages = std::fs::read_dir(at("pages")).unwrap();
    assert!(pages.all(|page| {
        page.unwrap()
            .path()
            .extension()
            .is_some_and(|ending| ending == "svg")
    }));
    senda(&["world", "print", "oval", "--out", text(&at("oval.txt"))])
        .failure()
        .stderr(predicate::str::contains("ends in .pdf").and(predicate::str::contains("`txt`")));
    assert!(!at("oval.txt").exists());
    // A road lap through way points, and what is wrong with a file of them.
    let points = "140,0\n100,80\n0,100\n-100,70\n-140,0\n-90,-80\n10,-100\n110,-70\n";
    std::fs::write(at("points.csv"), points).unwrap();
    let (points, lap) = (at("points.csv"), at("lap.toml"));
    senda(&["world", "from-waypoints", text(&points), "-o", text(&lap)]).success();
    senda(&["world", "check", "--vehicle", "sedan", text(&lap)]).success();
    senda(&[
        "world",
        "from-waypoints",
        text(&points),
        "--scale",
        "0.001",
        "-o",
        text(&lap),
    ])
    .failure()
    .stderr(predicates::str::contains("--scale"));
    assert!(std::fs::read(at("oval.pdf")).unwrap().starts_with(b"%PDF"));
    assert!(std::fs::read(at("oval.png")).unwrap().starts_with(b"\x89PNG"));
}

/// Every command below the given ones, as `senda world list`, with its help.
fn commands(above: &[&str]) -> Vec<(String, String)> {
    let help = senda(&[above, &["--help"]].concat()).success();
    let help = String::from_utf8(help.get_output().stdout.clone()).unwrap();
    let Some((_, list)) = help.split_once("Commands:\n") else {
        return vec![(above.join(" "), help)];
    };
    list.lines()
        .take_while(|line| !line.trim().is_empty())
        .filter_map(|line| line.strip_prefix("  ")?.split(' ').next())
        .filter(|name| !name.is_empty() && *name != "help")
        .flat_map(|name| commands(&[above, &[name]].concat()))
        .collect()
}

/// `world list`, `calibrate placement` and others printed for people only.
#[test]
fn whatever_a_command_prints_for_people_it_gives_as_json_too() {
    let all = commands(&[]);
    assert!(all.len() > 35, "{}", all.len());
    // A page's path, and a file that is TOML already.
    let without = ["report", "net print"];
    for (name, help) in &all {
        assert_eq!(
            help.contains("--json"),
            !without.contains(&name.as_str()),
            "senda {name}"
        );
    }
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let list = json(&["world", "list", "--json"]);
    assert!(
        list["worlds"]
            .as_array()
            .unwrap()
            .iter()
            .any(|world| world["name"] == "oval")
    );
    assert!(list["families"].as_array().unwrap().len() >= 10);
    let checked = json(&["world", "check", "oval", "--json"]);
    assert_eq!(checked[0]["closed"], true);
    let refused = senda(&["world", "check", "oval", text(&at("none.toml")), "--json"]).failure();
    let refused: serde_json::Value = serde_json::from_slice(&refused.get_output().stdout).unwrap();
    assert!(refused[1]["error"].as_str().unwrap().contains("none.toml"));
    let (drawn, made, pages) = (at("o.svg"), at("m.toml"), at("o.pdf"));
    assert!(json(&["world", "draw", "oval", "--out", text(&drawn), "--json"])["file"].is_string());
    let random = json(&["world", "random", "--out", text(&made), "--json"]);
    assert!(random["length_m"].as_f64().unwrap() > 3.9);
    let print = json(&["world", "print", "oval", "--out", text(&pages), "--json"]);
    assert!(print["sheets"].as_u64().unwrap() > 3);
    let table = json(&["calibrate", "placement", "--json"]);
    assert!(table[0]["far_m"].is_null() && table[0]["near_m"].as_f64().unwrap() > 0.0);
    let mountings = json(&[
        "calibrate",
        "placement",
        "--near",
        "0.07",
        "--far",
        "0.45",
        "--json",
    ]);
    assert_eq!(mountings.as_array().unwrap().len(), 2);
    let page = ["--page-px", "219", "--image-px", "480", "--distance", "0.84"];
    let angle = json(&[&["calibrate", "view-angle", "--json"], &page[..]].concat());
    assert!((angle["view_rad"].as_f64().unwrap() - 0.739).abs() < 1e-3);
    let sheet = json(&["calibrate", "sheet", "--out", text(&pages), "--json"]);
    assert_eq!(sheet["sheet"]["near_square_m"], 0.14);
    std::fs::write(at("turns.csv"), "100,0.7,9.3\n150,1.2,9.3\n200,1.7,9.3\n").unwrap();
    let motors = json(&["calibrate", "motors", text(&at("turns.csv")), "--json"]);
    assert!(motors["slope_per_turnps"].as_f64().unwrap() > 0.0);
    let networks = json(&["net", "list", "--json"]);
    assert!(networks[0]["parameters"].as_u64().unwrap() > 0);
}

/// Only one vehicle could be calibrated: the squares lay outside the others' pictures.
#[test]
fn every_ready_vehicle_near_the_floor_can_be_calibrated() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    for vehicle in ["picar", "donkeycar", "warehouse-cart"] {
        let (sheet, file) = (at("sheet.pdf"), at("calibration.toml"));
        senda(&["calibrate", "sheet", "--vehicle", vehicle, "--out", text(&sheet)]).success();
        let camera = ["calibrate", "camera", "--simulate", "--vehicle", vehicle];
        senda(&[&camera[..], &["--accept", "--out", text(&file)]].concat()).success();
        // Another vehicle's was taken without a word, and its driver found no line.
        for (driven, warned) in [(vehicle, false), ("gopigo", true)] {
            let drive = ["drive", "--vehicle", driven, "--time-limit", "1"];
            let words = predicate::str::contains("the calibration is of another vehicle");
            let output = senda(&[&drive[..], &["--calibration", text(&file)]].concat()).success();
            assert_eq!(
                words.eval(&String::from_utf8_lossy(&output.get_output().stderr)),
                warned,
                "{vehicle}'s on {driven}"
            );
        }
    }
    senda(&[
        "calibrate",
        "sheet",
        "--vehicle",
        "sedan",
        "--out",
        text(&at("sheet.pdf")),
    ])
    .failure()
    .stderr(predicate::str::contains("sedan").and(predicate::str::contains("mount the camera lower")));
    // Nearer than the camera sees: what to do can be done.
    let near = [
        "calibrate",
        "camera",
        "--simulate",
        "--vehicle",
        "picar",
        "--near-square",
        "0.14",
    ];
    senda(&[&near[..], &["--out", text(&at("calibration.toml"))]].concat())
        .failure()
        .stderr(predicate::str::contains("--near-square"));
}

/// The command's delay was not the study's own, and none of the document's findings (C13) showed.
#[test]
fn the_study_shows_by_itself_what_the_document_found() {
    let found = json(&["study", "follow", "--json"]);
    let traces = &found["traces"];
    let verdicts = |kp: f64, look_ahead_m: f64| -> Vec<String> {
        let of = traces
            .as_array()
            .unwrap()
            .iter()
            .filter(|trace| trace["gains"]["kp_per_s"] == kp && trace["look_ahead_m"] == look_ahead_m);
        of.map(|trace| trace["verdict"].as_str().unwrap().to_owned())
            .collect()
    };
    assert_eq!(verdicts(1.1, 0.4), ["converges", "converges"]);
    // Unstable above Kp 2.5 and at a small look-ahead, slow at one of 100 cm.
    for swings in [verdicts(3.0, 0.4), verdicts(1.1, 0.05)].concat() {
        assert!(["oscillates", "unstable"].contains(&swings.as_str()), "{swings}");
    }
    assert!(verdicts(1.1, 1.0).contains(&"slow".to_owned()));
    let output = senda(&["study", "follow"]).success();
    let told = String::from_utf8_lossy(&output.get_output().stdout).into_owned();
    let gain: f64 = told
        .lines()
        .find(|line| line.starts_with("At L = 40 cm"))
        .and_then(|line| line.trim_end_matches('.').rsplit(' ').next()?.parse().ok())
        .unwrap();
    assert!((gain - 2.5).abs() < 0.1, "{told}");
    let limits = found["limits"].as_array().unwrap();
    let limit = limits.iter().find(|limit| limit["look_ahead_m"] == 0.4).unwrap();
    assert!((limit["stable_kp_per_s"][1].as_f64().unwrap() - gain).abs() < 0.01);
}

#[test]
fn the_study_says_what_it_calls_settled_and_where_it_rests() {
    let folder = tempfile::tempdir().unwrap();
    let report = folder.path().join("study.html");
    let biased = [
        "study",
        "follow",
        "--kp",
        "1.1",
        "--look-ahead",
        "0.4",
        "--d-bias",
        "0.07",
    ];
    senda(&[&biased[..], &["--report", text(&report)]].concat())
        .success()
        .stdout(
            predicate::str::contains("beside the line, d -7.0 cm")
                .and(predicate::str::contains("within 1 cm of where the course rests"))
                .and(predicate::str::contains("converges").not()),
        );
    assert!(
        std::fs::read_to_string(&report)
            .unwrap()
            .contains("within 1 cm of where the course rests")
            && std::fs::read_to_string(&report)
                .unwrap()
                .contains("small errors grow above Kp")
    );
    let trace = json(&[&biased[..], &["--json"]].concat())["traces"][0].clone();
    assert_eq!(
        (&trace["verdict"], &trace["settled_d_m"]),
        (&"beside".into(), &0.01.into())
    );
    assert!((trace["rest_d_m"].as_f64().unwrap() + 0.07).abs() < 1e-6);
}
