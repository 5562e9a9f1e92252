//! Writing a tub that Donkeycar's own reader accepts.

use super::{ANGLE_KEY, IMAGE_KEY, THROTTLE_KEY, convert};
use crate::imported::MODE;
use crate::{DataError, Recording, Step, calendar};
use senda_core::{Encoded, ImageFormat, codec};
use serde::Serialize;
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::io::{self, Write};
use std::path::{Path, PathBuf};

/// Records in a catalog, as in the original.
const CATALOG_RECORDS: usize = 1000;
/// Quality of pictures that were recorded lossless: tubs hold JPEG (guess: no visible artefacts).
const JPEG_QUALITY: u8 = 95;

/// What a tub says that a recording does not know.
#[derive(Debug, Clone, PartialEq)]
pub struct TubOptions {
    /// When the recording began (ms since 1970), for `created_at`, the times and the session's name.
    pub began_ms: u64,
    /// Number of the session on its day.
    pub session: u32,
}

impl Default for TubOptions {
    /// 2026-01-01: a recording has no date, and a clock would make the same conversion give other bytes.
    fn default() -> Self {
        Self {
            began_ms: 1_767_225_600_000,
            session: 0,
        }
    }
}

/// What became of a recording's steps.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
pub struct Written {
    /// Records written.
    pub records: usize,
    /// Steps without a usable picture: tubs have no place for them.
    pub skipped: usize,
    /// Pictures that were not JPEG and were encoded.
    pub reencoded: usize,
}

/// Writes a recording as a tub into a new or empty folder. Pictures of the first camera only, as in the original.
pub fn write(recording: &Recording, folder: &Path, options: &TubOptions) -> Result<Written, DataError> {
    let mut tub = Tub::create(recording, folder, options)?;
    for step in &recording.steps {
        tub.add(step)?;
    }
    tub.finish()
}

struct Tub<'a> {
    recording: &'a Recording,
    folder: &'a Path,
    options: &'a TubOptions,
    session: String,
    catalog: Vec<u8>,
    line_lengths: Vec<usize>,
    paths: Vec<String>,
    written: Written,
}

impl<'a> Tub<'a> {
    fn create(
        recording: &'a Recording,
        folder: &'a Path,
        options: &'a TubOptions,
    ) -> Result<Self, DataError> {
        let images = folder.join("images");
        std::fs::create_dir_all(&images).map_err(|e| DataError::write(&images, "nothing was saved", e))?;
        let manifest = folder.join("manifest.json");
        if manifest.exists() {
            return Err(DataError::NotThat {
                path: folder.to_owned(),
                expected: "a new or empty folder".into(),
                found: "a folder that already holds a tub".into(),
                advice: "give another folder, or remove that one".into(),
            });
        }
        let date = calendar::date(options.began_ms / 86_400_000);
        Ok(Self {
            recording,
            folder,
            options,
            session: format!(
                "{:02}-{:02}-{:02}_{}",
                date.year % 100,
                date.month,
                date.day,
                options.session
            ),
            catalog: Vec::new(),
            line_lengths: Vec::new(),
            paths: Vec::new(),
            written: Written::default(),
        })
    }

    fn add(&mut self, step: &Step) -> Result<(), DataError> {
        let first = self.recording.header.body.cameras.first();
        let frame = match first {
            Some(camera) => step.frames.iter().find(|frame| frame.camera == camera.name),
            None => step.frames.first(),
        };
        let Some(jpeg) = frame.and_then(|frame| self.as_jpeg(&frame.encoded)) else {
            self.written.skipped += 1;
            return Ok(());
        };
        let index = self.written.records;
        let picture = format!("{index}_{}_.jpg", IMAGE_KEY.replace('/', "_"));
        self.save(&format!("images/{picture}"), &jpeg)?;
        let (angle, throttle) = convert::tub_from_command(&self.recording.header.body, &step.command);
        let throttle = step.pedal().map_or(throttle, |pedal| pedal.clamp(-1.0, 1.0));
        let mode = step
            .explanation
            .events
            .iter()
            .find_map(|event| event.strip_prefix(MODE));
        // The keys under which the reader finds what was driven, and what the person's are then.
        let (angle_key, throttle_key) = match mode {
            Some("local") => ("pilot/angle", "pilot/throttle"),
            Some("local_angle") => ("pilot/angle", THROTTLE_KEY),
            _ => (ANGLE_KEY, THROTTLE_KEY),
        };
        let mut record: BTreeMap<String, Value> = BTreeMap::new();
        for signal in &step.explanation.signals {
            // Only what came from a tub: our own signals have no `/` in their names.
            if signal.name.contains('/') && signal.value.is_finite() {
                record.insert(signal.name.clone(), json!(signal.value));
            }
        }
        record.insert("_index".into(), json!(index));
        record.insert("_session_id".into(), json!(self.session));
        let time_ms = self.options.began_ms.saturating_add(step.stamp.ns / 1_000_000);
        record.insert("_timestamp_ms".into(), json!(time_ms));
        record.insert(IMAGE_KEY.into(), json!(picture));
        record.insert(angle_key.into(), json!(angle));
        record.insert(throttle_key.into(), json!(throttle));
        record.insert("user/mode".into(), json!(mode.unwrap_or("user")));
        if let Some(speed_mps) = step.speed_mps {
            record.insert("enc/speed".into(), json!(speed_mps));
        }
        let line = python_line(&record);
        // Their reader seeks by these lengths, counted in characters.
        self.line_lengths.push(line.chars().count());
        self.catalog.extend_from_slice(line.as_bytes());
        self.written.records += 1;
        if self.line_lengths.len() == CATALOG_RECORDS {
            self.close_catalog()?;
        }
        Ok(())
    }

    /// `None` when the picture cannot be decoded.
    fn as_jpeg(&mut self, encoded: &Encoded) -> Option<Vec<u8>> {
        if encoded.format == ImageFormat::Jpeg {
            return Some(encoded.bytes.clone());
        }
        let jpeg = codec::encode_jpeg(&encoded.decode().ok()?, JPEG_QUALITY).ok()?;
        self.written.reencoded += 1;
        Some(jpeg.bytes)
    }

    fn close_catalog(&mut self) -> Result<(), DataError> {
        let number = self.paths.len();
        let name = format!("catalog_{number}.catalog");
        let about_name = format!("{name}_manifest");
        let about = BTreeMap::from([
            ("created_at".to_owned(), self.created_at()),
            ("line_lengths".to_owned(), json!(self.line_lengths)),
            ("path".to_owned(), json!(about_name)),
            ("start_index".to_owned(), json!(number * CATALOG_RECORDS)),
        ]);
        self.save(&about_name, python_line(&about).as_bytes())?;
        let catalog = std::mem::take(&mut self.catalog);
        self.save(&name, &catalog)?;
        self.line_lengths.clear();
        self.paths.push(name);
        Ok(())
    }

    fn finish(mut self) -> Result<Written, DataError> {
        if !self.line_lengths.is_empty() || self.paths.is_empty() {
            self.close_catalog()?;
        }
        let number: u32 = self.options.session;
        let lines = [
            json!([IMAGE_KEY, ANGLE_KEY, THROTTLE_KEY, "user/mode"]),
            json!(["image_array", "float", "float", "str"]),
            self.metadata(),
            json!({
                "created_at": self.created_at(),
                "sessions": {"all_full_ids": [self.session], "last_id": number, "last_full_id": self.session},
            }),
            json!({
                "paths": self.paths,
                "current_index": self.written.records,
                "max_len": CATALOG_RECORDS,
                "deleted_indexes": [],
            }),
        ];
        let text: String = lines.iter().map(python_line).collect();
        self.save("manifest.json", text.as_bytes())?;
        Ok(self.written)
    }

    /// Who drove, unless it was a person, as the reader takes it without.
    fn metadata(&self) -> Value {
        match self.recording.header.driver.as_str() {
            "" | "human" => json!({}),
            driver => json!({ "driver": driver }),
        }
    }

    fn created_at(&self) -> Value {
        json!(self.options.began_ms as f64 * 1e-3)
    }

    fn save(&self, name: &str, bytes: &[u8]) -> Result<(), DataError> {
        let path: PathBuf = self.folder.join(name);
        std::fs::write(&path, bytes).map_err(|e| {
            let saved = format!(
                "{} records were written, but the tub has no manifest",
                self.written.records
            );
            DataError::write(&path, saved, e)
        })
    }
}

/// One line of JSON with the separators that Python's `json.dumps` uses, and its end.
fn python_line<T: Serialize>(value: &T) -> String {
    let mut bytes = Vec::new();
    let mut serializer = serde_json::Serializer::with_formatter(&mut bytes, PythonStyle);
    value
        .serialize(&mut serializer)
        .expect("plain numbers and words always become JSON");
    bytes.push(b'\n');
    String::from_utf8(bytes).expect("JSON is UTF-8")
}

/// `", "` and `": "` as separators.
struct PythonStyle;

impl serde_json::ser::Formatter for PythonStyle {
    fn begin_array_value<W: ?Sized + Write>(&mut self, writer: &mut W, first: bool) -> io::Result<()> {
        writer.write_all(if first { b"" } else { b", " })
    }

    fn begin_object_key<W: ?Sized + Write>(&mut self, writer: &mut W, first: bool) -> io::Result<()> {
        writer.write_all(if first { b"" } else { b", " })
    }

    fn begin_object_value<W: ?Sized + Write>(&mut self, writer: &mut W) -> io::Result<()> {
        writer.write_all(b": ")
    }
}
