//! Reading a folder of the simulator.

use super::line::{LogLine, parse_line};
use super::{CAMERAS, LOG, NOMINAL_HZ, convert};
use crate::calendar::{self, Date};
use crate::imported::{Set, Taken};
use crate::store::{self, Store};
use crate::warnings::Warnings;
use crate::{DataError, EncodedFrame, Recording, Step};
use senda_core::{Body, Encoded, Explanation, Stamp};
use std::path::Path;

const EXPECTED: &str =
    "a recording of the Udacity simulator (a folder with driving_log.csv and IMG, or a .tar.gz of one)";
/// A pause longer than this (ns) between two rows is a new run: recording was stopped and begun again (guess).
const PAUSE_NS: u64 = 2_000_000_000;

/// Reads a whole log as one recording: the folder of `driving_log.csv`, that file, or an archive of the folder. Steering
/// keeps its physical size (25° full); `body` gives the cameras' lenses. A pause of more than two seconds begins a new
/// run, marked by an event here and kept apart by [`read_runs`].
pub fn read(path: &Path, body: &Body) -> Result<Recording, DataError> {
    Ok(load(path)?.joined(body))
}

/// As [`read`], one recording a run.
pub fn read_runs(path: &Path, body: &Body) -> Result<Vec<Recording>, DataError> {
    Ok(load(path)?.apart(body))
}

fn load(path: &Path) -> Result<Set, DataError> {
    let mut warnings = Warnings::default();
    let is_csv = path
        .extension()
        .is_some_and(|end| end.eq_ignore_ascii_case("csv"))
        && path.is_file();
    let (folder, log) = match (
        is_csv,
        path.parent(),
        path.file_name().and_then(|name| name.to_str()),
    ) {
        (true, Some(parent), Some(name)) => (parent, name),
        _ => (path, LOG),
    };
    // A bare file name has an empty parent, which is this folder.
    let folder = if folder.as_os_str().is_empty() {
        Path::new(".")
    } else {
        folder
    };
    let mut store = Store::open(folder, EXPECTED, &mut warnings)?;
    let Some(folder) = store.find("logs", &|name| name == log, &mut warnings)? else {
        return Err(DataError::NotThat {
            path: path.to_owned(),
            expected: EXPECTED.into(),
            found: format!("no {LOG}"),
            advice: "give the folder that holds it".into(),
        });
    };
    let name = store::join(&folder, log);
    let shown = store.show(&name);
    let bytes = store.read(&name)?.unwrap_or_default();
    let mut records: Vec<Taken> = Vec::new();
    let (mut run, mut before) = (0, None);
    for (number, line) in bytes.split(|byte| *byte == b'\n').enumerate() {
        let place = format!("{log}:{}", number + 1);
        match parse_line(line) {
            Ok(LogLine::Empty) => {}
            Ok(LogLine::Record {
                pictures,
                steering,
                throttle,
                brake,
                speed_mph,
            }) => {
                let frames = frames(&mut store, &folder, &place, &pictures, &mut warnings);
                if frames.is_empty() {
                    continue;
                }
                let time_ns = pictures.iter().find_map(|path| time_of(store::file_name(path)?));
                if let (Some(before), Some(now)) = (before, time_ns)
                    && now.saturating_sub(before) > PAUSE_NS
                {
                    run += 1;
                }
                before = time_ns.or(before);
                records.push(Taken {
                    run: Some(format!("{}", run + 1)),
                    time_ns,
                    step: Step {
                        stamp: Stamp::default(),
                        frames,
                        speed_mps: Some(speed_mph * convert::MPS_PER_MPH),
                        wheels: None,
                        battery_v: None,
                        command: convert::command_from_log(steering, throttle, brake),
                        truth: None,
                        explanation: Explanation::default(),
                    },
                });
            }
            Err(reason) => warnings.add("damaged lines", || {
                format!("{shown}:{}: {reason}: line left out", number + 1)
            }),
        }
    }
    Ok(Set {
        format: "udacity",
        source: store.name(),
        nominal_s: 1.0 / NOMINAL_HZ,
        records,
        warnings,
    })
}

fn frames(
    store: &mut Store,
    folder: &str,
    place: &str,
    pictures: &[String; 3],
    warnings: &mut Warnings,
) -> Vec<EncodedFrame> {
    let mut frames = Vec::with_capacity(3);
    for (camera, path) in CAMERAS.into_iter().zip(pictures) {
        // Logs of one camera leave the other columns empty.
        let Some(file) = store::file_name(path) else {
            continue;
        };
        let name = store::join(folder, &format!("IMG/{file}"));
        let bytes = match store.take(&name) {
            Ok(Some(bytes)) => bytes,
            Ok(None) => {
                warnings.add("pictures missing", || {
                    format!("{place}: IMG/{file} is missing: left out")
                });
                continue;
            }
            Err(reason) => {
                warnings.add("pictures unreadable", || format!("{place}: {reason}"));
                continue;
            }
        };
        match Encoded::recognise(bytes) {
            Ok(encoded) => frames.push(EncodedFrame {
                camera: camera.to_owned(),
                stamp: Stamp::default(),
                encoded,
            }),
            Err(reason) => warnings.add("pictures damaged", || format!("{place}: IMG/{file}: {reason}")),
        }
    }
    frames
}

/// Time (ns since 1970) in a name such as `center_2016_12_01_13_30_48_287.jpg`.
fn time_of(file: &str) -> Option<u64> {
    let stem = file.rsplit_once('.')?.0;
    let mut parts = stem.rsplit('_').map(|part| part.parse::<u64>().ok());
    let mut next = || parts.next().flatten();
    let (ms, s, min, h) = (next()?, next()?, next()?, next()?);
    let (day, month, year) = (next()?, next()?, next()?);
    let days = calendar::days(Date { year, month, day })?;
    if h > 23 || min > 59 || s > 60 || ms > 999 {
        return None;
    }
    let seconds = ((days * 24 + h) * 60 + min) * 60 + s;
    Some((seconds * 1000 + ms) * 1_000_000)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_in_names() {
        let first = time_of("center_2016_12_01_13_30_48_287.jpg").unwrap();
        let next = time_of("left_2016_12_01_13_30_48_404.jpg").unwrap();
        assert_eq!(next - first, 117_000_000);
        assert_eq!(first / 1_000_000_000, 1_480_599_048);
        for bad in [
            "center.jpg",
            "center_2016_13_01_13_30_48_287.jpg",
            "x_1_1_1_1_1_1_1.jpg",
            "",
            "_._",
        ] {
            assert_eq!(time_of(bad), None, "{bad}");
        }
    }
}
