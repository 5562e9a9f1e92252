//! A whole recorded run in memory.

use crate::{DataError, RecordingWriter, reader};
use senda_core::{Body, Command, Drive, Encoded, Explanation, Frame, Observation, Stamp, Truth, Wheels};
use serde::{Deserialize, Serialize};
use std::io::{Seek, Write};
use std::path::Path;

/// The version of the recording format that this program writes, and the newest it reads (`senda_format`).
pub const FORMAT: u32 = 1;

/// How a run came about: enough to repeat it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RecordingHeader {
    /// Version of senda that recorded it.
    pub senda: String,
    /// Commit that program was built from; empty where unknown.
    pub commit: String,
    /// The resolved scenario (TOML).
    pub scenario: String,
    /// The resolved world (TOML), where the run had one.
    pub world: Option<String>,
    /// Whether the world was driven the other way round.
    pub reversed: bool,
    /// Shape, limits and cameras of the vehicle.
    pub body: Body,
    /// Name of the driver.
    pub driver: String,
    /// Seed of the run.
    pub seed: u64,
}

/// One camera's picture as the sensor delivered it.
#[derive(Clone, PartialEq, Eq)]
pub struct EncodedFrame {
    /// The camera's name.
    pub camera: String,
    /// When it was exposed.
    pub stamp: Stamp,
    /// The compressed bytes, never re-encoded.
    pub encoded: Encoded,
}

impl std::fmt::Debug for EncodedFrame {
    /// Without the bytes: nobody reads them.
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Encoded { format, bytes } = &self.encoded;
        write!(
            f,
            "{}@{}ns {format:?} {} bytes",
            self.camera,
            self.stamp.ns,
            bytes.len()
        )
    }
}

/// One turn of the drive loop: what was sensed, what was commanded, and why.
#[derive(Debug, Clone, PartialEq)]
pub struct Step {
    /// When the observation was made.
    pub stamp: Stamp,
    /// The pictures, in the order that the vehicle delivered them.
    pub frames: Vec<EncodedFrame>,
    /// Measured forward speed (m/s).
    pub speed_mps: Option<f64>,
    /// Wheel encoders.
    pub wheels: Option<Wheels>,
    /// Battery voltage (V).
    pub battery_v: Option<f64>,
    /// The command that went to the vehicle, after the guard.
    pub command: Command,
    /// The true state, where it was known.
    pub truth: Option<Truth>,
    /// How the command came about.
    pub explanation: Explanation,
}

impl Step {
    /// How far a pedal was pressed (-1..1): by the command, or by the vehicle's own speed control where it was recorded.
    pub fn pedal(&self) -> Option<f64> {
        match self.command.drive {
            Drive::Throttle(pedal) => Some(pedal),
            Drive::SpeedMps(_) => self
                .explanation
                .signal_named(Explanation::PEDAL)
                .filter(|pedal| pedal.is_finite()),
        }
    }

    /// The observation of this step. Frames that cannot be decoded are left out; their number is the second value.
    pub fn observation(&self) -> (Observation, usize) {
        let mut observation = Observation::default();
        let damaged = self.observation_into(&mut observation);
        (observation, damaged)
    }

    /// As [`Step::observation`], reusing the memory of `observation`.
    pub fn observation_into(&self, observation: &mut Observation) -> usize {
        observation.stamp = self.stamp;
        observation.speed_mps = self.speed_mps;
        observation.wheels = self.wheels;
        observation.battery_v = self.battery_v;
        let mut good = 0;
        for recorded in &self.frames {
            if observation.frames.len() == good {
                observation.frames.push(Frame::default());
            }
            let frame = &mut observation.frames[good];
            if recorded.encoded.decode_into(&mut frame.image).is_err() {
                continue;
            }
            frame.camera.clone_from(&recorded.camera);
            frame.stamp = recorded.stamp;
            match &mut frame.encoded {
                Some(encoded) => {
                    encoded.format = recorded.encoded.format;
                    encoded.bytes.clone_from(&recorded.encoded.bytes);
                }
                empty => *empty = Some(recorded.encoded.clone()),
            }
            good += 1;
        }
        observation.frames.truncate(good);
        self.frames.len() - good
    }
}

/// A recorded run.
#[derive(Debug, Clone, PartialEq)]
pub struct Recording {
    /// How it came about.
    pub header: RecordingHeader,
    /// The steps in the order of driving.
    pub steps: Vec<Step>,
    /// The run's figures, if the run ended properly.
    pub summary: Option<serde_json::Value>,
    /// What was damaged, missing or guessed while reading.
    pub warnings: Vec<String>,
    /// Where steps are missing because the file was damaged; its end is not counted.
    pub lost: Vec<LostSteps>,
}

/// Steps in a row that a damaged file does not hold any more.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct LostSteps {
    /// They came before this one of the steps that are left.
    pub before: usize,
    /// How many.
    pub count: u32,
}

impl Recording {
    /// Reads a recording (MCAP) of senda. A file that was cut short gives the steps up to the break and a warning.
    pub fn read(path: &Path) -> Result<Self, DataError> {
        let file = std::fs::File::open(path).map_err(|e| DataError::read(path, e))?;
        reader::read(path, std::io::BufReader::with_capacity(1 << 16, file))
    }

    /// As [`Recording::read`], from bytes in memory.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, DataError> {
        reader::read(Path::new("recording in memory"), bytes)
    }

    /// Writes it with its summary. The same recording gives the same bytes.
    pub fn write<W: Write + Seek>(&self, to: W) -> Result<W, DataError> {
        self.write_with(RecordingWriter::new(to, &self.header)?)
    }

    /// Writes it to a file, replacing what is there.
    pub fn save(&self, path: &Path) -> Result<(), DataError> {
        self.write_with(RecordingWriter::create(path, &self.header)?)?;
        Ok(())
    }

    fn write_with<W: Write + Seek>(&self, mut writer: RecordingWriter<W>) -> Result<W, DataError> {
        for step in &self.steps {
            writer.recorded_step(step)?;
        }
        match &self.summary {
            Some(summary) => writer.finish(summary),
            None => writer.finish_without_summary(),
        }
    }

    /// Time from the first to the last step (s).
    pub fn duration_s(&self) -> f64 {
        match (self.steps.first(), self.steps.last()) {
            (Some(first), Some(last)) => last.stamp.since_s(first.stamp),
            _ => 0.0,
        }
    }

    /// The true states, where they were recorded.
    pub fn truths(&self) -> Vec<Truth> {
        self.steps.iter().filter_map(|step| step.truth).collect()
    }
}
