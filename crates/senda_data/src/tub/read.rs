//! Reading a tub.

use super::line::{TubLine, TubRecord, parse_line};
use super::{ANGLE_KEY, IMAGE_KEY, NOMINAL_HZ, THROTTLE_KEY, catalog_number, convert, is_tub_file, manifest};
use crate::imported::{MODE, Set, Taken};
use crate::store::{self, Store};
use crate::warnings::Warnings;
use crate::{DataError, EncodedFrame, Recording, Step};
use senda_core::{Body, Encoded, Explanation, Stamp};
use std::path::Path;

const EXPECTED: &str =
    "a Donkeycar tub (a folder with manifest.json and catalog_0.catalog, or a .tar.gz of one)";
/// Readings beyond ±1 by less than this are a joystick's calibration and are limited; beyond it the label is wrong.
const TOLERATED: f64 = 1.1;

/// Reads a whole tub as one recording: a folder, or a `.tar.gz`, `.tgz` or `.tar` of one.
///
/// `body` is the vehicle that recorded it: its steering limit gives the angles their size, its first camera the name and
/// (scaled to the pictures' size) the lens. Records that cannot be used are left out with a warning. A tub of several
/// sessions is one recording here, with an event where each begins; [`read_runs`] keeps them apart.
pub fn read(path: &Path, body: &Body) -> Result<Recording, DataError> {
    let (set, driver) = load(path, body)?;
    Ok(driven_by(driver.as_ref(), set.joined(body)))
}

/// Reads a tub as one recording per session: sequences never cross runs. What concerns the whole tub is warned of in
/// the first.
pub fn read_runs(path: &Path, body: &Body) -> Result<Vec<Recording>, DataError> {
    let (set, driver) = load(path, body)?;
    let runs = set.apart(body).into_iter();
    Ok(runs.map(|run| driven_by(driver.as_ref(), run)).collect())
}

/// The recording with the driver that the tub names, if it names one.
fn driven_by(driver: Option<&String>, mut recording: Recording) -> Recording {
    if let Some(driver) = driver {
        recording.header.driver.clone_from(driver);
    }
    recording
}

/// The set, and who drove it if the tub says.
fn load(path: &Path, body: &Body) -> Result<(Set, Option<String>), DataError> {
    let mut warnings = Warnings::default();
    let mut store = Store::open(path, EXPECTED, &mut warnings)?;
    let folder = store.find("tubs", &is_tub_file, &mut warnings)?;
    let Some(folder) = folder else {
        return Err(DataError::NotThat {
            path: path.to_owned(),
            expected: EXPECTED.into(),
            found: "neither manifest.json nor a catalog".into(),
            advice: "give the folder that holds them".into(),
        });
    };
    let (records, driver) = records(&store, &folder, &mut warnings)?;
    let mut taken = Vec::with_capacity(records.len());
    for (place, record) in records {
        if let Some(step) = step(&mut store, &folder, &place, &record, body, &mut warnings) {
            taken.push(Taken {
                run: record.session,
                time_ns: record.timestamp_ms.and_then(|ms| ms.checked_mul(1_000_000)),
                step,
            });
        }
    }
    let set = Set {
        format: "tub",
        source: store.name(),
        nominal_s: 1.0 / NOMINAL_HZ,
        records: taken,
        warnings,
    };
    Ok((set, driver))
}

/// Where a record was written, for warnings: `catalog_0.catalog:17`.
type Place = String;
type Records = Vec<(Place, TubRecord)>;

fn records(
    store: &Store,
    folder: &str,
    warnings: &mut Warnings,
) -> Result<(Records, Option<String>), DataError> {
    let files = store.files_in(folder)?;
    let manifest_name = store::join(folder, "manifest.json");
    let manifest = match store.read(&manifest_name)? {
        Some(bytes) => manifest::parse(&store.show(&manifest_name), &bytes, warnings),
        None => {
            warnings.add("manifests missing", || {
                "manifest.json is missing: catalogs are taken by their names, deleted records are unknown"
                    .into()
            });
            manifest::Manifest::default()
        }
    };
    let mut catalogs: Vec<&String> = files
        .iter()
        .filter(|name| catalog_number(name).is_some())
        .collect();
    catalogs.sort_by_key(|name| catalog_number(name));
    for listed in &manifest.catalogs {
        if !catalogs.contains(&listed) {
            warnings.add("catalogs missing", || {
                format!("manifest.json names {listed:?}, which is missing: its records are lost")
            });
        }
    }
    let mut all = Records::new();
    for catalog in catalogs {
        let name = store::join(folder, catalog);
        // Listed a moment ago; gone only if somebody deletes it while we read.
        let bytes = store.read(&name)?.unwrap_or_default();
        for (number, line) in bytes.split(|byte| *byte == b'\n').enumerate() {
            match parse_line(line) {
                Ok(TubLine::Empty) => {}
                Ok(TubLine::Record(record)) => all.push((format!("{catalog}:{}", number + 1), record)),
                Err(reason) => warnings.add("damaged lines", || {
                    format!("{}:{}: {reason}: line left out", store.show(&name), number + 1)
                }),
            }
        }
    }
    let before = all.len();
    all.retain(|(_, record)| !manifest.deleted.contains(&record.index));
    if all.len() < before {
        let deleted = before - all.len();
        warnings.add("deleted records", || {
            format!("{deleted} records are marked as deleted: left out")
        });
    }
    if !all.is_sorted_by_key(|(_, record)| record.index) {
        warnings.add("order", || {
            "records are not in the order of their _index: sorted".into()
        });
        all.sort_by_key(|(_, record)| record.index);
    }
    all.dedup_by(|later, earlier| {
        let same = later.1.index == earlier.1.index;
        if same {
            warnings.add("repeated records", || {
                format!("{}: _index {} was there before: left out", later.0, later.1.index)
            });
        }
        same
    });
    Ok((all, manifest.driver))
}

fn step(
    store: &mut Store,
    folder: &str,
    place: &str,
    record: &TubRecord,
    body: &Body,
    warnings: &mut Warnings,
) -> Option<Step> {
    let (angle_key, throttle_key) = driven_keys(record);
    let angle = reading(record, angle_key, place, warnings)?;
    let throttle = match record.numbers.get(throttle_key) {
        Some(_) => reading(record, throttle_key, place, warnings)?,
        None => {
            warnings.add("throttles missing", || {
                format!("{place}: {throttle_key} is missing: 0 is taken")
            });
            0.0
        }
    };
    let frames = frames(store, folder, place, record, body, warnings)?;
    let mut explanation = Explanation::default();
    if let Some(mode) = record.mode.as_deref().filter(|mode| *mode != "user") {
        explanation.event(format!("{MODE}{mode}"));
    }
    for (key, value) in &record.numbers {
        // The driven ones are the command; the others are kept under their own names.
        if key != angle_key && key != throttle_key {
            explanation.signal(key, *value);
        }
    }
    Some(Step {
        stamp: Stamp::default(),
        frames,
        speed_mps: record.numbers.get("enc/speed").copied(),
        wheels: None,
        battery_v: None,
        command: convert::command_from_tub(body, angle, throttle),
        truth: None,
        explanation,
    })
}

/// Which angle and throttle the car obeyed: the person's, unless an autopilot drove.
fn driven_keys(record: &TubRecord) -> (&'static str, &'static str) {
    let has = |key: &str| record.numbers.contains_key(key);
    match record.mode.as_deref() {
        Some("local") if has("pilot/angle") && has("pilot/throttle") => ("pilot/angle", "pilot/throttle"),
        Some("local" | "local_angle") if has("pilot/angle") => ("pilot/angle", THROTTLE_KEY),
        _ => (ANGLE_KEY, THROTTLE_KEY),
    }
}

fn reading(record: &TubRecord, key: &str, place: &str, warnings: &mut Warnings) -> Option<f64> {
    let Some(value) = record.numbers.get(key).copied() else {
        warnings.add("records without an angle", || {
            format!("{place}: {key} is missing: record left out")
        });
        return None;
    };
    if value.abs() > TOLERATED {
        warnings.add("labels out of range", || {
            format!("{place}: {key}: expected -1 to 1, but found {value}: record left out")
        });
        return None;
    }
    if value.abs() > 1.0 {
        warnings.add("labels limited", || {
            format!("{place}: {key}: expected -1 to 1, but found {value}: limited")
        });
    }
    Some(value.clamp(-1.0, 1.0))
}

/// `None` when the record has no picture at all: nothing can be learned or judged from it.
fn frames(
    store: &mut Store,
    folder: &str,
    place: &str,
    record: &TubRecord,
    body: &Body,
    warnings: &mut Warnings,
) -> Option<Vec<EncodedFrame>> {
    let mut frames = Vec::with_capacity(record.images.len());
    for (key, file) in &record.images {
        let Some(file) = store::file_name(file) else {
            warnings.add("pictures without a name", || {
                format!("{place}: {key}: {file:?} names no file")
            });
            continue;
        };
        let name = store::join(folder, &format!("images/{file}"));
        let bytes = match store.take(&name) {
            Ok(Some(bytes)) => bytes,
            Ok(None) => {
                warnings.add("pictures missing", || {
                    format!("{place}: images/{file} is missing: left out")
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
                camera: camera_name(key, body),
                stamp: Stamp::default(),
                encoded,
            }),
            Err(reason) => warnings.add("pictures damaged", || format!("{place}: images/{file}: {reason}")),
        }
    }
    if frames.is_empty() {
        if record.images.is_empty() {
            warnings.add("records without a picture", || {
                format!("{place}: no picture is named: record left out")
            });
        }
        return None;
    }
    Some(frames)
}

/// Their camera keys in our names: the plain one is the body's first camera, `cam/image_array_left` is `left`.
fn camera_name(key: &str, body: &Body) -> String {
    if key == IMAGE_KEY {
        return body
            .cameras
            .first()
            .map_or_else(|| "center".into(), |camera| camera.name.clone());
    }
    match key
        .strip_prefix(IMAGE_KEY)
        .and_then(|rest| rest.strip_prefix('_'))
    {
        Some(name) if !name.is_empty() => name.to_owned(),
        _ => key.replace('/', "_"),
    }
}
