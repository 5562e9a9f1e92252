//! What leads from step to step, without a simulator: time-outs, batteries, blindness.

use super::*;
use senda_core::{Frame, Image, Steering};
use senda_geom::{Camera, Lens, Mounting};

fn body() -> Body {
    Body {
        name: "cart".into(),
        steering: Steering::Differential { track_m: 0.155 },
        width_m: 0.16,
        length_m: 0.24,
        speed_limit_mps: 0.5,
        yaw_rate_limit_radps: 6.0,
        period_s: 0.05,
        encoders: None,
        cameras: vec![Camera {
            name: "center".into(),
            width_px: 320,
            height_px: 240,
            lens: Lens::pinhole(320, 240, 60f64.to_radians(), 46.8f64.to_radians()),
            mounting: Mounting {
                x_m: 0.0,
                y_m: 0.0,
                z_m: 0.2,
                yaw_rad: 0.0,
                tilt_rad: 20f64.to_radians(),
                roll_rad: 0.0,
            },
        }],
    }
}

fn grey(time_s: f64, battery_v: Option<f64>) -> Observation {
    let mut image = Image::new(320, 240, senda_core::Channels::Rgb);
    image.pixels_mut().fill(150);
    Observation {
        stamp: Stamp::from_s(time_s),
        frames: vec![Frame {
            camera: "center".into(),
            image,
            ..Frame::default()
        }],
        battery_v,
        ..Observation::default()
    }
}

/// Drives frames of bare floor until the mission is over; returns the events.
fn until_done(driver: &mut MissionDriver, battery_v: Option<f64>, limit_s: f64) -> Vec<String> {
    let mut events = Vec::new();
    let mut explanation = Explanation::default();
    let mut time_s = 0.0;
    while !driver.is_done() && time_s < limit_s {
        driver.drive(&grey(time_s, battery_v));
        explanation.clear();
        driver.explain(&mut explanation);
        events.append(&mut explanation.events);
        time_s += 0.05;
    }
    events
}

fn driver(options: MissionOptions) -> MissionDriver {
    MissionDriver::new(&body(), options).unwrap()
}

#[test]
fn without_a_package_it_stands_and_says_so() {
    let mut driver = driver(MissionOptions {
        package_limit_s: 2.0,
        ..MissionOptions::default()
    });
    let events = until_done(&mut driver, None, 10.0);
    assert_eq!(
        events,
        ["wait_package -> failed: time over; no package was shown"]
    );
    assert_eq!(driver.drive(&grey(20.0, None)), Command::STOP);
    assert_eq!(driver.reason(), Some("no package was shown"));
}

/// D13: an empty battery ends the mission wherever it is; a moment's sag does not.
#[test]
fn an_empty_battery_ends_the_mission_and_a_sag_does_not() {
    let mut first = driver(MissionOptions::default());
    let events = until_done(&mut first, Some(13.0), 10.0);
    assert!(
        events[0].contains("battery empty") && events[0].contains("13.2 V"),
        "{events:?}"
    );
    let mut second = driver(MissionOptions::default());
    for i in 0..40 {
        let sags = i % 10 < 5;
        second.drive(&grey(0.05 * f64::from(i), Some(if sags { 13.0 } else { 13.6 })));
    }
    assert_eq!(second.step(), Step::WaitPackage);
}

/// A line that is gone: it stops, looks around, and gives up with a reason.
#[test]
fn a_lost_line_is_looked_for_and_then_given_up() {
    let mut driver = driver(MissionOptions::default());
    driver.step = Step::Return;
    let events = until_done(&mut driver, None, 60.0);
    assert_eq!(events.len(), 2, "{events:?}");
    assert!(events[0].starts_with("return -> find_line: line lost"));
    assert!(events[1].contains("the line was lost and not found again"));
}

/// A frame with a crossing this far ahead (m), or without one.
fn with_crossing(time_s: f64, distance_m: Option<f64>) -> Observation {
    let mut observation = grey(time_s, None);
    let camera = &body().cameras[0];
    let image = &mut observation.frames[0].image;
    for v in 0..image.height() {
        for (u, pixel) in image.row_mut(v).as_chunks_mut::<3>().0.iter_mut().enumerate() {
            let at = camera.floor_from_pixel(senda_geom::Vec2::new(u as f64 + 0.5, v as f64 + 0.5));
            let Some((at, from_m)) = at.zip(distance_m) else {
                continue;
            };
            let is_bar = ((at.y + 0.1) / 0.022).rem_euclid(2.0) < 1.0;
            if (from_m..from_m + 0.08).contains(&at.x) && at.y.abs() < 0.1 && is_bar {
                *pixel = [204, 30, 38];
            }
        }
    }
    observation
}

/// What the mission does before a crossing that stays this far ahead for so long (s), and is then gone.
fn stopping(distance_m: f64, until_s: f64) -> Vec<String> {
    let mut driver = driver(MissionOptions::default());
    driver.step = Step::StopAtArea;
    let mut events = Vec::new();
    let mut explanation = Explanation::default();
    for frame in 0..320 {
        let time_s = 0.05 * f64::from(frame);
        driver.drive(&with_crossing(time_s, (time_s < until_s).then_some(distance_m)));
        explanation.clear();
        driver.explain(&mut explanation);
        events.append(&mut explanation.events);
        if !events.is_empty() {
            break;
        }
    }
    events
}

/// It went on to search for the sign as if it stood before an area.
#[test]
fn a_crossing_that_it_never_stands_before_is_no_stop() {
    assert_eq!(
        stopping(0.30, 2.0),
        ["stop_at_area -> to_area: no crossing to be seen"]
    );
    assert_eq!(
        stopping(0.36, 99.0),
        ["stop_at_area -> failed: time over; it did not come to stand square before the crossing"]
    );
    assert_eq!(
        stopping(0.275, 99.0),
        ["stop_at_area -> search: stands nearly square"]
    );
    assert_eq!(stopping(0.26, 99.0), ["stop_at_area -> search: stands square"]);
}

/// A red spot again and again: the way that it takes ends.
#[test]
fn a_crossing_is_not_looked_for_for_ever() {
    let mut driver = driver(MissionOptions::default());
    driver.step = Step::ToArea;
    driver.way.step_m = 5.0;
    driver.enter(When::CrossingAhead, Step::StopAtArea);
    driver.enter(When::NoCrossingThere, Step::ToArea);
    assert!(driver.way.step_m >= 5.0 && driver.way.stop_m == 0.0);
    driver.enter(When::LineLost, Step::FindLine);
    assert!(driver.way.step_m == 0.0);
}

/// A sign that is not there: it turns all around twice, then gives up.
#[test]
fn a_sign_that_is_not_there_ends_the_mission() {
    let mut driver = driver(MissionOptions::default());
    driver.step = Step::Search;
    let events = until_done(&mut driver, None, 120.0);
    assert_eq!(
        events,
        ["search -> failed: time over; no sign was found before the junction"]
    );
    assert!(driver.counts.leg == 0 && driver.way.turned_rad.abs() < 1.2);
}

/// A sign led into a street whose code is another depot's: the code counts, nothing is unloaded there.
#[test]
fn a_sign_that_the_code_contradicts_brings_the_package_back() {
    let mut driver = driver(MissionOptions::default());
    (driver.step, driver.goal) = (Step::TakeStreet, Some(2));
    driver.codes.depot = Some(0);
    driver.drive(&grey(0.05, None));
    assert_eq!(driver.step(), Step::Return);
    let reason = driver.reason().unwrap();
    assert!(
        reason.contains("expected depot 2") && reason.contains("depot 0"),
        "{reason}"
    );
    assert!(!driver.delivered);
    // Said once, not at every junction on the way home.
    driver.events.clear();
    driver.enter(When::JunctionAhead, Step::CrossBack);
    driver.enter(When::LineBelow, Step::Return);
    assert_eq!(driver.events.len(), 2);
    assert!(
        driver.events.iter().all(|event| !event.contains("expected")),
        "{:?}",
        driver.events
    );
    assert!(driver.reason().is_some());
}

/// A mission that waits for a light.
fn waiting(options: MissionOptions) -> MissionDriver {
    let mut driver = driver(options);
    driver.step = Step::WaitGreen;
    driver.light.begin_waiting(Stamp::default());
    driver
}

#[test]
fn a_light_that_never_turns_ends_the_mission() {
    let mut driver = waiting(MissionOptions {
        light_limit_s: 3.0,
        ..MissionOptions::default()
    });
    let events = until_done(&mut driver, None, 20.0);
    assert_eq!(
        events,
        ["wait_green -> failed: time over; the light was not seen to turn green, and not at all for 3.1 s"]
    );
}

/// Grey frames show no light: it is searched for again, and the mission does not wait for it for ever.
#[test]
fn a_light_that_is_not_there_is_searched_for_again() {
    let mut driver = waiting(MissionOptions {
        light_there_s: 2.0,
        ..MissionOptions::default()
    });
    let events = until_done(&mut driver, None, 60.0);
    assert_eq!(
        events,
        [
            "wait_green -> search: no light to be seen",
            "search -> failed: time over; no sign was found before the junction"
        ]
    );
}

/// Without frames it stands, whatever it was about to do, and goes on when they come again.
#[test]
fn without_frames_it_stands() {
    let mut driver = driver(MissionOptions::default());
    driver.step = Step::Return;
    driver.drive(&grey(0.0, None));
    assert_eq!(driver.drive(&blind(0.5)), Command::STOP);
}

/// Options out of range and vehicles without a camera are refused with words.
#[test]
fn nonsense_is_refused() {
    let mut blind = body();
    blind.cameras.clear();
    assert!(MissionDriver::new(&blind, MissionOptions::default()).is_err());
    let options = MissionOptions {
        speed_mps: f64::NAN,
        ..MissionOptions::default()
    };
    let error = MissionDriver::new(&body(), options).err().unwrap().to_string();
    assert!(error.contains("speed_mps"), "{error}");
}

/// D12 in SPEC, at the level of sources: nothing in the mission's folder names the true state, so it cannot use it. (The types
/// say the same: a `Driver` is handed an `Observation`, which holds none.)
#[test]
fn the_mission_cannot_know_the_true_state() {
    let here = std::path::Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut read = Vec::new();
    for entry in std::fs::read_dir(here.join("src/mission")).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_name().unwrap().to_str().unwrap().to_owned();
        if name == "tests.rs" {
            continue;
        }
        let source = std::fs::read_to_string(&path).unwrap();
        for word in ["Truth", "Privileged", "senda_sim", "senda_world", "drive_knowing"] {
            assert!(!source.contains(word), "{name}: {word}");
        }
        read.push(name);
    }
    // Where the work is done, and that no folder within was passed over.
    for name in ["mod.rs", "conditions.rs", "halt.rs", "perceive.rs"] {
        assert!(read.iter().any(|read| read == name), "{name} in {read:?}");
    }
    assert!(read.iter().all(|name| name.ends_with(".rs")), "{read:?}");
    let manifest = include_str!("../../Cargo.toml");
    let dependencies = manifest.split("[dev-dependencies]").next().unwrap();
    assert!(!dependencies.contains("senda_sim") && !dependencies.contains("senda_world"));
}

/// It drove over the start's crossing and round again, over the area's too, red or not.
#[test]
fn a_crossing_on_the_way_back_without_the_starts_code_ends_the_mission() {
    let returning = |from: Step, when: When| {
        let mut driver = driver(MissionOptions::default());
        (driver.step, driver.way.stop_m) = (from, 1.0);
        driver.enter(when, Step::Return);
        driver.way.stop_m = 1.0;
        driver.events.clear();
        driver
    };
    let mut home = returning(Step::Unload, When::TimeOver);
    for frame in 0..2 {
        home.drive(&with_crossing(0.05 * f64::from(frame), Some(0.3)));
    }
    assert_eq!(home.step(), Step::Failed);
    assert_eq!(
        home.reason(),
        Some("a crossing without the start's code before it")
    );
    // The crossing of the depot that turned it back is driven over, the next one is not.
    let mut turned = returning(Step::TakeStreet, When::OthersCode);
    for frame in 0..4 {
        turned.drive(&with_crossing(0.05 * f64::from(frame), Some(0.3)));
    }
    assert!(turned.step() == Step::Return && turned.way.stop_m < 0.1);
    turned.way.stop_m = 1.0;
    for frame in 4..8 {
        turned.drive(&with_crossing(0.05 * f64::from(frame), Some(0.3)));
    }
    assert_eq!(turned.step(), Step::Failed);
}

fn blind(time_s: f64) -> Observation {
    Observation {
        stamp: Stamp::from_s(time_s),
        ..Observation::default()
    }
}

/// A search had no end without pictures.
#[test]
fn a_mission_without_pictures_ends_wherever_it_is() {
    for step in [Step::WaitPackage, Step::Search, Step::FindLine, Step::StopAtDepot] {
        let mut driver = driver(MissionOptions::default());
        driver.step = step;
        for frame in 0..240 {
            driver.drive(&blind(0.05 * f64::from(frame)));
        }
        assert_eq!(driver.step(), Step::Failed, "{step:?}");
        assert_eq!(driver.reason(), Some("no picture has come for 10 s"));
    }
}

/// A camera that failed beside a depot counted as standing square before it.
#[test]
fn standing_blind_is_no_stop() {
    let mut driver = driver(MissionOptions::default());
    driver.step = Step::StopAtDepot;
    driver.drive(&with_crossing(0.0, Some(0.36)));
    for frame in 1..60 {
        driver.drive(&blind(0.05 * f64::from(frame)));
    }
    assert_eq!(driver.step(), Step::StopAtDepot);
}

/// Lost and found again without end.
#[test]
fn a_line_that_is_lost_again_and_again_ends_the_mission() {
    let mut driver = driver(MissionOptions::default());
    driver.step = Step::ToArea;
    for _ in 0..9 {
        driver.enter(When::LineLost, Step::FindLine);
        driver.enter(When::LineFound, Step::ToArea);
    }
    driver.enter(When::LineLost, Step::FindLine);
    driver.drive(&grey(0.05, None));
    assert_eq!(driver.step(), Step::Failed);
    assert_eq!(driver.reason(), Some("the line was lost 10 times"));
    driver.step = Step::Unload;
    driver.enter(When::TimeOver, Step::Return);
    assert_eq!(driver.losses, 0);
}
