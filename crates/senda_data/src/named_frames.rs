//! Folders of pictures with the steering in the file name (FORMATS 4; A3 in SPEC).
//!
//! `v<ddHHMM>-f<frame>-a<angle>.png` and `video01_<frame>_<angle>.png`; the angle is in servo degrees, 90 straight on,
//! smaller is left. [`command_from_servo`] and [`servo_from_command`] are the only places that know.

use crate::imported::{Set, Taken};
use crate::store::{self, Store};
use crate::warnings::Warnings;
use crate::{DataError, EncodedFrame, Recording, Step};
use senda_core::{Body, Command, Drive, Encoded, Explanation, ImageFormat, Stamp, Steering, Turn};
use std::path::Path;

const EXPECTED: &str = "pictures named v<ddHHMM>-f<frame>-a<angle>.png or <name>_<frame>_<angle>.png (a folder, or a .tar.gz of one)";
/// Servo degrees from straight on to full lock (A2 in SPEC: 40..140).
const FULL_LOCK_DEG: f64 = 50.0;
/// Servo degrees straight on.
const STRAIGHT_DEG: f64 = 90.0;

/// The command that a servo angle (degrees) means for a body: full lock (40 and 140) is the body's own. The throttle is
/// unknown: 0.
pub fn command_from_servo(body: &Body, angle_deg: f64) -> Command {
    let left = (STRAIGHT_DEG - angle_deg) / FULL_LOCK_DEG;
    Command {
        turn: match body.steering {
            Steering::Ackermann {
                steering_limit_rad, ..
            } => Turn::SteeringRad(left * steering_limit_rad),
            Steering::Differential { .. } => Turn::YawRateRadps(left * body.yaw_rate_limit_radps),
        },
        drive: Drive::Throttle(0.0),
    }
}

/// The servo angle (degrees, 40..140) of a command.
pub fn servo_from_command(body: &Body, command: &Command) -> f64 {
    let speed_mps = body.speed_of(command);
    let (asked, limit) = match body.steering {
        Steering::Ackermann {
            steering_limit_rad, ..
        } => (body.steering_of(command.turn, speed_mps), steering_limit_rad),
        Steering::Differential { .. } => (
            body.yaw_rate_of(command.turn, speed_mps),
            body.yaw_rate_limit_radps,
        ),
    };
    let left = if limit > 0.0 {
        (asked / limit).clamp(-1.0, 1.0)
    } else {
        0.0
    };
    STRAIGHT_DEG - left * FULL_LOCK_DEG
}

/// What a file name says.
#[derive(Debug, Clone, PartialEq)]
pub struct NamedFrame {
    /// The run it belongs to: the beginning of the name.
    pub run: String,
    /// Number of the frame in the run.
    pub frame: u64,
    /// Servo angle (degrees).
    pub angle_deg: f64,
}

/// Reads a file name; `None` when it is not one of these, or its angle is not within 0 to 180.
pub fn parse_name(name: &str) -> Option<NamedFrame> {
    let (stem, end) = name.rsplit_once('.')?;
    if !["png", "jpg", "jpeg"].contains(&end.to_ascii_lowercase().as_str()) {
        return None;
    }
    let (run, frame, angle) = match stem.rsplit_once("-a") {
        Some((rest, angle)) => {
            let (run, frame) = rest.rsplit_once("-f")?;
            (run, frame, angle)
        }
        None => {
            let (rest, angle) = stem.rsplit_once('_')?;
            let (run, frame) = rest.rsplit_once('_')?;
            (run, frame, angle)
        }
    };
    // Pictures of the Udacity simulator end in seconds and milliseconds.
    if crate::udacity::CAMERAS
        .iter()
        .any(|camera| run.starts_with(camera))
    {
        return None;
    }
    let angle_deg: f64 = angle.parse().ok()?;
    (!run.is_empty() && (0.0..=180.0).contains(&angle_deg)).then_some(NamedFrame {
        run: run.to_owned(),
        frame: frame.parse().ok()?,
        angle_deg,
    })
}

/// Reads all runs as one recording, with an event where each begins. The body's first camera gives the name and
/// (scaled) the lens, its period the time between frames, which these names do not tell.
pub fn read(path: &Path, body: &Body) -> Result<Recording, DataError> {
    Ok(load(path, body)?.joined(body))
}

/// As [`read`], one recording a run.
pub fn read_runs(path: &Path, body: &Body) -> Result<Vec<Recording>, DataError> {
    Ok(load(path, body)?.apart(body))
}

fn load(path: &Path, body: &Body) -> Result<Set, DataError> {
    let mut warnings = Warnings::default();
    let mut store = Store::open(path, EXPECTED, &mut warnings)?;
    let Some(folder) = store.find(
        "folders of pictures",
        &|name| parse_name(name).is_some(),
        &mut warnings,
    )?
    else {
        return Err(DataError::NotThat {
            path: path.to_owned(),
            expected: EXPECTED.into(),
            found: "no such picture".into(),
            advice: "give the folder that holds them".into(),
        });
    };
    let mut pictures: Vec<(NamedFrame, String)> = Vec::new();
    for name in store.files_in(&folder)? {
        match parse_name(&name) {
            Some(named) => pictures.push((named, name)),
            None => warnings.add("other files", || {
                format!("{name}: not a picture with an angle in its name: left out")
            }),
        }
    }
    pictures.sort_by(|(a, _), (b, _)| (&a.run, a.frame).cmp(&(&b.run, b.frame)));
    let camera = body
        .cameras
        .first()
        .map_or("center", |camera| camera.name.as_str());
    let period_s = if body.period_s > 0.0 { body.period_s } else { 0.05 };
    warnings.add("times unknown", || {
        format!(
            "names tell no times: the vehicle's {:.1} frames a second are taken",
            1.0 / period_s
        )
    });
    let mut records = Vec::with_capacity(pictures.len());
    for (named, name) in pictures {
        let encoded = match store.take(&store::join(&folder, &name)) {
            Ok(bytes) => Encoded::recognise(bytes.unwrap_or_default()).map_err(|e| e.to_string()),
            Err(reason) => Err(reason.to_string()),
        };
        let encoded = match encoded {
            Ok(encoded) => encoded,
            Err(reason) => {
                warnings.add("pictures damaged", || format!("{name}: {reason}: left out"));
                continue;
            }
        };
        records.push(Taken {
            run: Some(named.run),
            time_ns: named.frame.checked_mul(Stamp::from_s(period_s).ns),
            step: Step {
                stamp: Stamp::default(),
                frames: vec![EncodedFrame {
                    camera: camera.to_owned(),
                    stamp: Stamp::default(),
                    encoded,
                }],
                speed_mps: None,
                wheels: None,
                battery_v: None,
                command: command_from_servo(body, named.angle_deg),
                truth: None,
                explanation: Explanation::default(),
            },
        });
    }
    Ok(Set {
        format: "named_frames",
        source: store.name(),
        nominal_s: period_s,
        records,
        warnings,
    })
}

/// Writes the first camera's pictures into a new or existing folder as `<run>-f<frame>-a<angle>`, the angle in whole
/// degrees as the original; the number of pictures is returned. `run` is `v<ddHHMM>` in the original.
pub fn write(recording: &Recording, folder: &Path, run: &str) -> Result<usize, DataError> {
    std::fs::create_dir_all(folder).map_err(|e| DataError::write(folder, "nothing was saved", e))?;
    let mut written = 0;
    for (number, step) in recording.steps.iter().enumerate() {
        let Some(frame) = step.frames.first() else {
            continue;
        };
        let angle_deg = servo_from_command(&recording.header.body, &step.command).round();
        let end = match frame.encoded.format {
            ImageFormat::Jpeg => "jpg",
            ImageFormat::Png => "png",
        };
        let path = folder.join(format!("{run}-f{number:05}-a{angle_deg}.{end}"));
        std::fs::write(&path, &frame.encoded.bytes)
            .map_err(|e| DataError::write(&path, format!("{written} pictures were written"), e))?;
        written += 1;
    }
    Ok(written)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn smaller_than_90_is_left_and_ours_is_positive() {
        let body = Body {
            name: "car".into(),
            steering: Steering::Ackermann {
                wheelbase_m: 0.14,
                steering_limit_rad: 0.5,
            },
            width_m: 0.1,
            length_m: 0.2,
            speed_limit_mps: 1.0,
            yaw_rate_limit_radps: 3.0,
            period_s: 0.05,
            encoders: None,
            cameras: vec![],
        };
        assert_eq!(command_from_servo(&body, 40.0).turn, Turn::SteeringRad(0.5));
        assert_eq!(command_from_servo(&body, 90.0).turn, Turn::SteeringRad(0.0));
        assert_eq!(command_from_servo(&body, 115.0).turn, Turn::SteeringRad(-0.25));
        for angle_deg in [40.0, 75.0, 90.0, 140.0] {
            let back = servo_from_command(&body, &command_from_servo(&body, angle_deg));
            assert!((back - angle_deg).abs() < 1e-9);
        }
    }

    #[test]
    fn names_of_both_kinds() {
        let check = |name: &str, expected: Option<(&str, u64, f64)>| {
            let found = parse_name(name);
            let found = found
                .as_ref()
                .map(|named| (named.run.as_str(), named.frame, named.angle_deg));
            assert_eq!(found, expected, "{name}");
        };
        check("v251130-f00012-a87.png", Some(("v251130", 12, 87.0)));
        check("video01_000_085.png", Some(("video01", 0, 85.0)));
        check("my_video_3_90.5.png", Some(("my_video", 3, 90.5)));
        check("v251130-f12-a300.png", None);
        check("v251130-f12-aNaN.png", None);
        check("center_2016_12_01_13_30_48_120.jpg", None);
        check("12_cam_image_array_.jpg", None);
        check("notes.txt", None);
        check("_1_2.png", None);
        check("", None);
    }
}
