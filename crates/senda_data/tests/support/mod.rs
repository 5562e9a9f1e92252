//! What the tests of all data formats share.
#![allow(dead_code, reason = "every test file uses its own part")]

use senda_core::codec::{encode_jpeg, encode_png};
use senda_core::{
    Body, Channels, Command, Drive, Explanation, Frame, Image, Observation, Stamp, Steering, Truth, Turn,
    Wheels,
};
use senda_data::{Recording, RecordingHeader, RecordingWriter};
use senda_geom::{Camera, Lens, Mounting, Pose2};
use std::io::Cursor;
use std::path::PathBuf;

pub(crate) fn camera(name: &str, width_px: u32, height_px: u32) -> Camera {
    Camera {
        name: name.into(),
        width_px,
        height_px,
        lens: Lens::pinhole(width_px, height_px, 0.94, 0.74),
        mounting: Mounting {
            x_m: 0.05,
            y_m: 0.0,
            z_m: 0.095,
            yaw_rad: 0.0,
            tilt_rad: 0.576,
            roll_rad: 0.0,
        },
    }
}

/// A car with one camera of 16x12 px.
pub(crate) fn car() -> Body {
    Body {
        name: "car".into(),
        steering: Steering::Ackermann {
            wheelbase_m: 0.17,
            steering_limit_rad: 0.4,
        },
        width_m: 0.2,
        length_m: 0.3,
        speed_limit_mps: 2.0,
        yaw_rate_limit_radps: 4.0,
        period_s: 0.05,
        encoders: None,
        cameras: vec![camera("center", 16, 12)],
    }
}

pub(crate) fn header(body: Body) -> RecordingHeader {
    RecordingHeader {
        senda: "0.1.0".into(),
        commit: "abc123".into(),
        scenario: "vehicle = \"car\"\n".into(),
        world: Some("name = \"oval\"\n".into()),
        reversed: true,
        body,
        driver: "line".into(),
        seed: u64::MAX,
    }
}

pub(crate) fn picture(width: usize, height: usize, number: usize) -> Image {
    let pixels = (0..width * height * 3)
        .map(|i| (i * 7 + number * 13) as u8)
        .collect();
    Image::from_pixels(width, height, Channels::Rgb, pixels).unwrap()
}

/// What one step of a run gives to the writer; every optional thing is there in some steps and not in others.
pub(crate) struct Moment {
    pub(crate) observation: Observation,
    pub(crate) command: Command,
    pub(crate) truth: Option<Truth>,
    pub(crate) explanation: Explanation,
}

pub(crate) fn moment(number: usize) -> Moment {
    let stamp = Stamp::from_ns(number as u64 * 50_000_000 + 7);
    let third = number % 3;
    let image = picture(16, 12, number);
    let encoded = match third {
        0 => Some(encode_jpeg(&image, 80).unwrap()),
        1 => Some(encode_png(&image).unwrap()),
        _ => None,
    };
    let image = match &encoded {
        Some(encoded) => encoded.decode().unwrap(),
        None => image,
    };
    // An odd fraction, so that a decimal digit lost anywhere shows.
    let odd = (number as f64 + 0.1) / 3.0;
    let mut explanation = Explanation::default();
    if third != 1 {
        explanation.signal("d_m", odd * 1e-3);
        explanation.text([1.5, 2.5], "né", "red");
        explanation.event("line lost");
    }
    Moment {
        observation: Observation {
            stamp,
            frames: vec![Frame {
                camera: "center".into(),
                stamp: Stamp::from_ns(stamp.ns.saturating_sub(3)),
                image,
                encoded,
            }],
            speed_mps: (third == 0).then_some(odd),
            wheels: (third == 1).then_some(Wheels {
                left_ticks: -5,
                right_ticks: i64::MAX,
            }),
            battery_v: (third == 2).then_some(11.1),
        },
        command: match third {
            0 => Command::curvature(-odd, 0.13),
            1 => Command::yaw_rate(odd, 0.16),
            _ => Command {
                turn: Turn::SteeringRad(0.25 * odd / (1.0 + odd)),
                drive: Drive::Throttle(0.1),
            },
        },
        truth: (third != 0).then_some(Truth {
            stamp,
            world_from_vehicle: Pose2::new(odd, -odd, 1.0 / (1.0 + odd)),
            speed_mps: odd,
            yaw_rate_radps: -odd,
            steering_rad: 0.1,
            battery_v: 11.1,
        }),
        explanation,
    }
}

pub(crate) fn record(steps: usize) -> Vec<u8> {
    let mut writer = RecordingWriter::new(Cursor::new(Vec::new()), &header(car())).unwrap();
    for number in 0..steps {
        let it = moment(number);
        writer
            .step(&it.observation, &it.command, it.truth.as_ref(), &it.explanation)
            .unwrap();
    }
    let summary = serde_json::json!({"completed": true, "laps": 1.5});
    writer.finish(&summary).unwrap().into_inner()
}

pub(crate) fn recording(steps: usize) -> Recording {
    Recording::from_bytes(&record(steps)).unwrap()
}

/// A file that lies beside the repository, or `None` (with a word) where it is absent.
pub(crate) fn shared(name: &str) -> Option<PathBuf> {
    let path = PathBuf::from(env!("CARGO_MANIFEST_DIR"))
        .join("../../../shared/data")
        .join(name);
    if path.exists() {
        return Some(path);
    }
    #[allow(clippy::print_stderr, reason = "a skipped check says so")]
    {
        eprintln!("skipped: {} is absent", path.display());
    }
    None
}
