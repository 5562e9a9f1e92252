//! What every camera driver must survive, whatever it is fed. No assertion about good driving here.

mod support;

use senda_core::{Channels, Driver, Explanation, Frame, Image, Observation, Stamp};
use senda_drivers::{
    DriverError, Form, HoughDriver, HoughDriverOptions, LaneDriver, LaneOptions, LineDriver, LineOptions,
    Mask, SightOptions, TrackOptions,
};
use support::{Eye, Floor, gopigo, kit_car, straight};

/// Every camera driver in every form, new.
fn drivers() -> Vec<(String, Box<dyn Driver>)> {
    let mut all: Vec<(String, Box<dyn Driver>)> = Vec::new();
    for form in [Form::Document, Form::Curve, Form::PurePursuit] {
        for body in [gopigo(160, 120), kit_car()] {
            let line = LineOptions {
                form,
                ..LineOptions::default()
            };
            let lane = LaneOptions {
                form,
                ..LaneOptions::default()
            };
            all.push((
                format!("line {form:?} {}", body.name),
                Box::new(LineDriver::new(&body, line).unwrap()),
            ));
            all.push((
                format!("lane {form:?} {}", body.name),
                Box::new(LaneDriver::new(&body, lane).unwrap()),
            ));
        }
    }
    for mask in [Mask::Colour, Mask::Strength] {
        for body in [gopigo(160, 120), kit_car()] {
            let hough = HoughDriverOptions {
                mask,
                ..HoughDriverOptions::default()
            };
            all.push((
                format!("hough {mask:?} {}", body.name),
                Box::new(HoughDriver::new(&body, hough).unwrap()),
            ));
        }
    }
    all
}

fn observation(time_s: f64, image: Option<Image>) -> Observation {
    let stamp = Stamp::from_s(time_s);
    Observation {
        stamp,
        frames: image
            .into_iter()
            .map(|image| Frame {
                camera: "center".into(),
                stamp,
                image,
                encoded: None,
            })
            .collect(),
        ..Observation::default()
    }
}

fn feed(driver: &mut dyn Driver, name: &str, observation: &Observation) {
    let command = driver.drive(observation);
    assert!(command.is_finite(), "{name}: {command:?}");
    let mut explanation = Explanation::default();
    driver.explain(&mut explanation);
    assert!(
        explanation.signals.iter().any(|signal| signal.name == "found"),
        "{name}"
    );
}

fn striped(width: usize, height: usize, channels: Channels, shift: usize) -> Image {
    let mut image = Image::new(width, height, channels);
    let count = channels.count();
    for y in 0..height {
        for (i, value) in image.row_mut(y).iter_mut().enumerate() {
            let x = i / count + shift;
            *value = if (x * 10 / width.max(1)) % 5 == 2 { 30 } else { 190 };
        }
    }
    image
}

/// One dark line straight ahead of the robot of document C.
fn line_ahead() -> Image {
    let path = straight(2.0);
    let mut floor = Floor::around(&path, 0.7, 170);
    floor.stripe(&path, 0.018, 40, None);
    let mut image = Image::default();
    Eye::new(&gopigo(160, 120).cameras[0]).draw(&floor, path.pose_at(0.3), &mut image);
    image
}

#[test]
fn nothing_to_see_at_all() {
    for (name, mut driver) in drivers() {
        for step in 0..200 {
            feed(&mut *driver, &name, &observation(0.05 * f64::from(step), None));
        }
        assert!(driver.is_done(), "{name} waits forever");
    }
}

#[test]
fn images_of_every_size_and_kind_also_in_the_middle_of_a_run() {
    let sizes = [
        (1, 1),
        (0, 0),
        (2, 500),
        (160, 120),
        (15, 15),
        (17, 16),
        (320, 240),
        (123, 92),
        (161, 3),
    ];
    for (name, mut driver) in drivers() {
        for (step, (width, height)) in sizes.iter().cycle().take(3 * sizes.len()).enumerate() {
            let channels = if step % 2 == 0 {
                Channels::Gray
            } else {
                Channels::Rgb
            };
            let image = striped(*width, *height, channels, step);
            feed(&mut *driver, &name, &observation(0.05 * step as f64, Some(image)));
        }
    }
}

#[test]
fn black_white_and_noisy_pictures() {
    for (name, mut driver) in drivers() {
        let mut state = 12345u64;
        for step in 0..60 {
            let mut image = Image::new(160, 120, Channels::Rgb);
            match step % 3 {
                0 => {}
                1 => image.pixels_mut().fill(255),
                _ => {
                    for value in image.pixels_mut() {
                        state = state
                            .wrapping_mul(6364136223846793005)
                            .wrapping_add(1442695040888963407);
                        *value = (state >> 56) as u8;
                    }
                }
            }
            feed(
                &mut *driver,
                &name,
                &observation(0.05 * f64::from(step), Some(image)),
            );
        }
    }
}

#[test]
fn times_that_stand_still_jump_or_run_backwards() {
    for (name, mut driver) in drivers() {
        for (step, time_s) in [0.0, 0.0, 0.05, 0.05, 100.0, 3.0, 3.05, 1e9, 0.0]
            .into_iter()
            .enumerate()
        {
            let mut seen = observation(time_s, Some(striped(160, 120, Channels::Gray, step)));
            seen.speed_mps = Some(if step % 2 == 0 { f64::NAN } else { 0.1 });
            feed(&mut *driver, &name, &seen);
            // An old frame, and one from the future.
            seen.frames[0].stamp = Stamp::from_s(time_s + if step % 2 == 0 { 5.0 } else { -5.0 });
            feed(&mut *driver, &name, &seen);
        }
    }
}

#[test]
fn a_camera_slower_than_the_loop_is_no_loss() {
    let body = gopigo(160, 120);
    let mut driver = LineDriver::new(&body, LineOptions::default()).unwrap();
    let image = line_ahead();
    for step in 0..200 {
        let mut seen = observation(0.05 * f64::from(step), Some(image.clone()));
        // A new frame in every fourth observation only.
        seen.frames[0].stamp = Stamp::from_s(0.05 * f64::from(step - step % 4) + 1e-3);
        feed(&mut driver, "line", &seen);
    }
    assert!(!driver.is_done());
}

#[test]
fn frames_of_an_unknown_camera_are_used_when_there_is_no_other() {
    let body = gopigo(160, 120);
    let mut driver = LineDriver::new(&body, LineOptions::default()).unwrap();
    let mut seen = observation(0.0, Some(line_ahead()));
    seen.frames[0].camera = "front".into();
    feed(&mut driver, "line", &seen);
    assert!(body.speed_of(&driver.drive(&seen)) > 0.0);
}

#[test]
fn impossible_vehicles_and_options_are_refused_with_the_key() {
    let mut blind = gopigo(160, 120);
    blind.cameras.clear();
    assert!(matches!(
        LineDriver::new(&blind, LineOptions::default()),
        Err(DriverError::NoCamera { .. })
    ));
    let mut sky = gopigo(160, 120);
    sky.cameras[0].mounting.tilt_rad = -1.0;
    assert!(matches!(
        LaneDriver::new(&sky, LaneOptions::default()),
        Err(DriverError::NoFloor { .. })
    ));
    let wrong = LineOptions {
        sight: SightOptions {
            line_width_m: f64::NAN,
            ..SightOptions::default()
        },
        ..LineOptions::default()
    };
    let message = LineDriver::new(&gopigo(160, 120), wrong)
        .err()
        .unwrap()
        .to_string();
    assert!(message.contains("sight.line_width_m"), "{message}");
    let wrong = LaneOptions {
        track: TrackOptions {
            window_m: 0.0,
            ..TrackOptions::default()
        },
        ..LaneOptions::default()
    };
    let message = LaneDriver::new(&gopigo(160, 120), wrong)
        .err()
        .unwrap()
        .to_string();
    assert!(message.contains("track.window_m"), "{message}");
}

#[test]
fn options_survive_toml_and_unknown_keys_are_refused() {
    let body = gopigo(160, 120);
    let line: LineOptions =
        toml::from_str("form = \"document\"\n[speed]\ncruise_mps = 0.11\n[follow.pid]\nkp_per_s = 1.3")
            .unwrap();
    assert_eq!(line.form, Form::Document);
    assert!((line.speed.cruise_mps - 0.11).abs() < 1e-12 && (line.follow.pid.kp_per_s - 1.3).abs() < 1e-12);
    let driver = LineDriver::new(&body, line.clone()).unwrap();
    let back: LineOptions = driver.parameters().try_into().unwrap();
    assert_eq!(back, line);
    let lane = LaneDriver::new(&body, LaneOptions::default()).unwrap();
    let back: LaneOptions = lane.parameters().try_into().unwrap();
    assert_eq!(back, LaneOptions::default());
    let hough = HoughDriver::new(&body, HoughDriverOptions::default()).unwrap();
    let back: HoughDriverOptions = hough.parameters().try_into().unwrap();
    assert_eq!(back, HoughDriverOptions::default());
    assert!(toml::from_str::<HoughDriverOptions>("masc = \"colour\"").is_err());
    assert!(toml::from_str::<LineOptions>("speeed = 1").is_err());
    assert!(toml::from_str::<LaneOptions>("[shape]\nwidth = 0.2").is_err());
}
