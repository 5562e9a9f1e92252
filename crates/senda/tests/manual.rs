//! A person at the wheel, as they type it: modes, scripts of keys, and a real terminal.

mod support;

use assert_cmd::Command;
use predicates::prelude::*;
use predicates::str::contains;
use std::path::{Path, PathBuf};
use support::{json, senda, text};

const PLACE: [&str; 6] = ["--world", "circuit-1", "--vehicle", "picar", "--image", "64x48"];

fn drive(folder: &Path, more: &[&str]) -> Vec<String> {
    ["drive"]
        .iter()
        .chain(&PLACE)
        .chain(more)
        .map(|word| (*word).to_owned())
        .chain(["--record".to_owned(), text(&folder.join("runs")).to_owned()])
        .collect()
}

fn recording(folder: &Path, driver: &str) -> PathBuf {
    folder.join(format!("runs/circuit-1-picar-{driver}-1.mcap"))
}

#[test]
fn a_wrong_mode_is_answered_with_a_guide_and_nothing_starts() {
    let folder = tempfile::tempdir().unwrap();
    let arguments = drive(folder.path(), &["--mode", "automatic"]);
    let words: Vec<&str> = arguments.iter().map(String::as_str).collect();
    let modes = ["manual", "auto", "training-manual", "training-auto"];
    let guide = modes
        .iter()
        .fold(contains("--mode automatic").boxed(), |all, mode| {
            all.and(contains(format!("\n  {mode} "))).boxed()
        });
    senda(&words).failure().stderr(guide).stdout("");
    assert!(!folder.path().join("runs").exists());
}

#[test]
fn without_a_terminal_it_says_what_to_do_and_leaves_nothing_behind() {
    let folder = tempfile::tempdir().unwrap();
    let arguments = drive(folder.path(), &["--mode", "training-manual"]);
    let words: Vec<&str> = arguments.iter().map(String::as_str).collect();
    Command::cargo_bin("senda")
        .unwrap()
        .args(&words)
        .write_stdin("wwww")
        .assert()
        .failure()
        .stderr(contains("no terminal").and(contains("--keys")));
    assert!(!recording(folder.path(), "manual").exists());
}

#[test]
fn flags_that_contradict_the_mode_are_refused() {
    senda(&["drive", "--mode", "manual", "--driver", "line"])
        .failure()
        .stderr(contains("in this mode you drive"));
    senda(&["drive", "--step", "2"])
        .failure()
        .stderr(contains("--mode manual"));
    senda(&["drive", "--mode", "manual", "--step", "9", "--keys", "/dev/null"])
        .failure()
        .stderr(contains("step_deg").and(contains("1 to 5")));
    senda(&[
        "drive",
        "--mode",
        "manual",
        "--gamepad",
        "/dev/input/no-such-gamepad",
    ])
    .failure()
    .stderr(contains("no-such-gamepad").or(contains("does not have")));
}

const KEYS: &str = "# a little slalom
0.1 go
0.5 left
0.5 left
0.8 right
1.2 straight
1.5 stop
";

#[test]
fn keys_from_a_file_are_a_drive_that_can_be_repeated_learned_from_and_named() {
    let folder = tempfile::tempdir().unwrap();
    let keys = folder.path().join("keys.txt");
    std::fs::write(&keys, KEYS).unwrap();
    let run = |name: &str| {
        let folder = folder.path().join(name);
        let more = ["--mode", "training-manual", "--step", "5", "--keys", text(&keys)];
        let arguments = drive(&folder, &more);
        senda(&arguments.iter().map(String::as_str).collect::<Vec<_>>()).success();
        std::fs::read(recording(&folder, "manual")).unwrap()
    };
    assert!(run("a") == run("b"), "the same keys gave another drive");
    let own = recording(&folder.path().join("a"), "manual");
    let pictures = folder.path().join("pictures");
    senda(&[
        "data",
        "export",
        text(&own),
        "--format",
        "named-frames",
        "--out",
        text(&pictures),
    ])
    .success();
    let mut angles: Vec<u32> = std::fs::read_dir(&pictures)
        .unwrap()
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .map(|name| {
            name.rsplit_once("-a")
                .unwrap()
                .1
                .split_once('.')
                .unwrap()
                .0
                .parse()
                .unwrap()
        })
        .collect();
    angles.sort_unstable();
    angles.dedup();
    // Smaller is left: twice 5° to the left, once back, then straight.
    assert_eq!(angles, [80, 85, 90]);
    let info = json(&["data", "info", text(&own), "--json"]);
    assert_eq!(info["driver"], "manual");
    let stats = json(&["data", "stats", text(&own), "--json"]);
    assert_eq!(stats["speeds"]["max_mps"], 0.16);
    assert_eq!(stats["speeds"]["min_mps"], 0.0);
    senda(&["replay", text(&own)])
        .failure()
        .stderr(contains("a person drove"));
}

#[test]
fn a_mistake_in_a_file_of_keys_is_named_with_its_line() {
    let folder = tempfile::tempdir().unwrap();
    let keys = folder.path().join("keys.txt");
    std::fs::write(&keys, "0 go\n1 jump\n").unwrap();
    senda(&["drive", "--mode", "manual", "--keys", text(&keys)])
        .failure()
        .stderr(contains("keys.txt:2").and(contains("straight")));
}

#[test]
fn training_auto_records_what_the_driver_does() {
    let folder = tempfile::tempdir().unwrap();
    let more = [
        "--mode",
        "training-auto",
        "--driver",
        "hough",
        "--time-limit",
        "1",
    ];
    let arguments = drive(folder.path(), &more);
    senda(&arguments.iter().map(String::as_str).collect::<Vec<_>>()).success();
    assert!(recording(folder.path(), "hough").exists());
}

// Elsewhere a terminal's other end would be handed on to the programs that run beside, and never be closed.
#[cfg(target_os = "linux")]
mod terminal {
    use super::*;
    use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
    use std::fs::File;
    use std::io::{Read, Write};
    use std::process::{Child, Stdio};

    /// A drive in a terminal of its own.
    struct Person {
        child: Child,
        hands: File,
        seen: Vec<u8>,
    }

    fn sits_down(folder: &Path) -> Person {
        let hands = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC).unwrap();
        grantpt(&hands).unwrap();
        unlockpt(&hands).unwrap();
        let name = ptsname(&hands, Vec::new()).unwrap().into_string().unwrap();
        let terminal = File::options().read(true).write(true).open(name).unwrap();
        let child = std::process::Command::new(assert_cmd::cargo::cargo_bin!("senda"))
            .args(drive(folder, &["--mode", "training-manual"]))
            .stdin(Stdio::from(terminal.try_clone().unwrap()))
            .stdout(Stdio::null())
            .stderr(Stdio::from(terminal))
            .spawn()
            .unwrap();
        Person {
            child,
            hands: File::from(hands),
            seen: Vec::new(),
        }
    }

    impl Person {
        fn presses(&mut self, keys: &[u8]) {
            self.hands.write_all(keys).unwrap();
        }

        /// Looks at the terminal until the words are there, or the program has ended and closed it.
        fn looks_for(&mut self, words: &str) {
            let mut piece = [0; 4096];
            while !String::from_utf8_lossy(&self.seen).contains(words) {
                // The end of the other side is an error on some systems and nothing on others.
                match self.hands.read(&mut piece) {
                    Ok(count) if count > 0 => self.seen.extend_from_slice(&piece[..count]),
                    _ => return,
                }
            }
        }

        /// What stood in the terminal once the program has ended well.
        fn sees_it_end(mut self) -> String {
            self.looks_for("nothing that ever stands there");
            assert!(self.child.wait().unwrap().success());
            String::from_utf8_lossy(&self.seen).into_owned()
        }
    }

    /// Speeds of a recording's steps (m/s), and the last angle (servo degrees).
    fn driven(folder: &Path) -> (Vec<f64>, f64) {
        let run = senda_data::Recording::read(&recording(folder, "manual")).unwrap();
        let body = &run.header.body;
        let speeds = run
            .steps
            .iter()
            .map(|step| body.speed_of(&step.command))
            .collect();
        let last = &run.steps.last().unwrap().command;
        assert!(run.summary.is_some(), "it did not end in good order");
        (speeds, senda_data::named_frames::servo_from_command(body, last))
    }

    #[test]
    fn keys_drive_the_picture_is_shown_and_q_ends_the_run() {
        let folder = tempfile::tempdir().unwrap();
        let mut person = sits_down(folder.path());
        // The keys may wait in the terminal until the program reads them.
        person.presses(b"w\x1b[D\x1b[D\x1b[Cq");
        let seen = person.sees_it_end();
        assert!(seen.contains('▀') && seen.contains("\x1b[38;2;"), "no picture");
        assert!(seen.contains("steer, go, stop"), "no help");
        assert!(seen.contains("\x1b[?1049l"), "the terminal was not given back");
        let (speeds, angle_deg) = driven(folder.path());
        assert_eq!(angle_deg, 87.0);
        assert_eq!(speeds.last(), Some(&0.0));
    }

    #[test]
    fn a_signal_to_end_stops_the_vehicle_and_the_recording_is_whole() {
        let folder = tempfile::tempdir().unwrap();
        let mut person = sits_down(folder.path());
        person.presses(b"w");
        person.looks_for("speed 0.16 m/s");
        let id = rustix::process::Pid::from_child(&person.child);
        rustix::process::kill_process(id, rustix::process::Signal::TERM).unwrap();
        person.sees_it_end();
        let (speeds, _) = driven(folder.path());
        assert!(speeds.contains(&0.16), "it never drove");
        assert_eq!(speeds.last(), Some(&0.0));
    }

    #[test]
    fn when_the_keyboard_is_gone_the_vehicle_stops_and_the_recording_is_whole() {
        let folder = tempfile::tempdir().unwrap();
        let mut person = sits_down(folder.path());
        person.presses(b"w");
        person.looks_for("speed 0.16 m/s");
        let Person { mut child, hands, .. } = person;
        drop(hands);
        assert!(child.wait().unwrap().success());
        let (speeds, _) = driven(folder.path());
        assert!(speeds.contains(&0.16), "it never drove");
        assert_eq!(speeds.last(), Some(&0.0));
    }
}

/// Throttle was 0.6 all along (8 of 13.4 m/s) and brake 0, also while the car was stopping.
#[test]
fn a_persons_lap_in_the_car_says_how_far_the_pedals_were_pressed() {
    let folder = tempfile::tempdir().unwrap();
    let keys = folder.path().join("keys.txt");
    std::fs::write(&keys, "0 go\n9 stop\n11 quit\n").unwrap();
    let (runs, log) = (folder.path().join("runs"), folder.path().join("log"));
    senda(&[
        "drive",
        "--world",
        "lake",
        "--vehicle",
        "sedan",
        "--mode",
        "manual",
        "--speed",
        "8",
        "--image",
        "32x16",
        "--keys",
        text(&keys),
        "--record",
        text(&runs),
    ])
    .success();
    let own = runs.join("lake-sedan-manual-1.mcap");
    senda(&[
        "data",
        "export",
        text(&own),
        "--format",
        "udacity",
        "--out",
        text(&log),
    ])
    .success();
    let rows: Vec<Vec<f64>> = std::fs::read_to_string(log.join("driving_log.csv"))
        .unwrap()
        .lines()
        .map(|row| {
            row.split(',')
                .skip(3)
                .map(|field| field.parse().unwrap())
                .collect()
        })
        .collect();
    let [throttle, brake] = [1, 2];
    assert_eq!(rows[0][throttle], 1.0, "it sets off");
    let cruising = &rows[8 * 14];
    assert!(
        cruising[throttle] > 0.01 && cruising[throttle] < 0.15,
        "{cruising:?}"
    );
    assert_eq!(cruising[brake], 0.0);
    let stopping = &rows[9 * 14 + 7];
    assert!(
        stopping[brake] == 1.0 && stopping[throttle] == 0.0,
        "{stopping:?}"
    );
}
