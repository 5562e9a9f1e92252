//! Writing a folder that programs made for the simulator read.

use super::{CAMERAS, LOG, convert};
use crate::{DataError, Recording, calendar};
use senda_core::{ImageFormat, codec};
use std::fmt::Write as _;
use std::path::Path;

/// Quality of pictures that were recorded lossless: these folders hold JPEG (guess: no visible artefacts).
const JPEG_QUALITY: u8 = 95;

/// What a log says that a recording does not know.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct UdacityOptions {
    /// When the recording began (ms since 1970), for the pictures' names.
    pub began_ms: u64,
}

impl Default for UdacityOptions {
    /// 2026-01-01: a recording has no date, and a clock would make the same conversion give other names.
    fn default() -> Self {
        Self {
            began_ms: 1_767_225_600_000,
        }
    }
}

/// Writes `driving_log.csv` and `IMG/` into a new or empty folder; the number of rows is returned. Cameras named
/// `center`, `left` and `right` go into their columns, another first camera into the centre's. Steps without a picture
/// have no row.
pub fn write(recording: &Recording, folder: &Path, options: &UdacityOptions) -> Result<usize, DataError> {
    let images = folder.join("IMG");
    std::fs::create_dir_all(&images).map_err(|e| DataError::write(&images, "nothing was saved", e))?;
    let log_path = folder.join(LOG);
    if log_path.exists() {
        return Err(DataError::NotThat {
            path: folder.to_owned(),
            expected: "a new or empty folder".into(),
            found: format!("a folder that already holds {LOG}"),
            advice: "give another folder, or remove that one".into(),
        });
    }
    let body = &recording.header.body;
    let mut log = String::new();
    let mut rows = 0;
    for step in &recording.steps {
        let time = time_words(options.began_ms.saturating_add(step.stamp.ns / 1_000_000));
        let mut columns = [const { String::new() }; 3];
        for (position, frame) in step.frames.iter().enumerate() {
            let column = CAMERAS.iter().position(|name| *name == frame.camera);
            let Some(column) = column.or((position == 0).then_some(0)) else {
                continue;
            };
            let jpeg = match frame.encoded.format {
                ImageFormat::Jpeg => frame.encoded.bytes.clone(),
                ImageFormat::Png => {
                    let Ok(jpeg) = frame
                        .encoded
                        .decode()
                        .and_then(|image| codec::encode_jpeg(&image, JPEG_QUALITY))
                    else {
                        continue;
                    };
                    jpeg.bytes
                }
            };
            let name = format!("{}_{time}.jpg", CAMERAS[column]);
            let path = images.join(&name);
            std::fs::write(&path, jpeg).map_err(|e| {
                DataError::write(&path, format!("{rows} pictures were written, but no {LOG}"), e)
            })?;
            columns[column] = format!("IMG/{name}");
        }
        if columns.iter().all(String::is_empty) {
            continue;
        }
        let (steering, throttle, brake) = convert::log_from_step(body, step);
        let speed_mps = step.speed_mps.or(step.truth.map(|truth| truth.speed_mps));
        let speed_mph = speed_mps.unwrap_or(0.0) / convert::MPS_PER_MPH;
        let [center, left, right] = columns;
        writeln!(
            log,
            "{center},{left},{right},{steering},{throttle},{brake},{speed_mph}"
        )
        .expect("strings grow");
        rows += 1;
    }
    std::fs::write(&log_path, log)
        .map_err(|e| DataError::write(&log_path, "the pictures were written", e))?;
    Ok(rows)
}

/// `yyyy_MM_dd_HH_mm_ss_fff`.
fn time_words(ms: u64) -> String {
    let date = calendar::date(ms / 86_400_000);
    let (s, ms) = (ms / 1000 % 86_400, ms % 1000);
    format!(
        "{:04}_{:02}_{:02}_{:02}_{:02}_{:02}_{ms:03}",
        date.year,
        date.month,
        date.day,
        s / 3600,
        s / 60 % 60,
        s % 60
    )
}
