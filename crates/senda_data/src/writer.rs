//! Writing a recording while the run goes on.
//!
//! A recording is one MCAP file (<https://mcap.dev/spec>), not compressed, `senda_format` 1:
//!
//! | where | what |
//! |---|---|
//! | metadata `senda.header`, first in the file | `senda_format`, `senda`, `commit`, `scenario`, `world` (where there is one), `reversed`, `body` (JSON), `driver`, `seed` |
//! | `/camera/<name>` | `foxglove.CompressedImage` (protobuf): the sensor's own bytes, or PNG of a frame that came raw |
//! | `/observation` | JSON: stamp, speed, wheels, battery |
//! | `/truth` | JSON: the true state, where it is known |
//! | `/pose` | `foxglove.PoseInFrame` (protobuf) of the true state, for other programs; not read back |
//! | `/explanation` | JSON: signals, shapes, events |
//! | `/command` | JSON: what went to the vehicle; the last message of a step |
//! | metadata `senda.summary`, last in the file | `json`: the run's figures, if it ended properly |
//!
//! A message's sequence is the number of its step, its log time the step's stamp, its publish time the moment of
//! exposure (pictures) or of truth. Numbers that are not finite are `null`.

use crate::messages::{
    self, COMMAND, CompressedImage, EXPLANATION, JsonChannel, OBSERVATION, PoseInFrame, Sensed, TRUTH,
};
use crate::{DataError, FORMAT, RecordingHeader, Step};
use mcap::records::{MessageHeader, Metadata};
use prost::Message;
use senda_core::{Command, Encoded, Explanation, ImageFormat, Observation, Stamp, Truth};
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufWriter, Seek, Write};
use std::path::{Path, PathBuf};

/// A chunk is closed and given to the operating system after this much run time: what a killed program may lose.
const CHUNK_NS: u64 = 1_000_000_000;
/// … or after this many bytes, whichever comes first (guess: a second of three cameras).
const CHUNK_BYTES: usize = 1 << 20;

/// What to leave out of a recording.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct RecordingOptions {
    /// Pictures are recorded in every n-th step only (1: all). Such a recording cannot be replayed to equal commands.
    pub frames_every: u32,
}

impl Default for RecordingOptions {
    fn default() -> Self {
        Self { frames_every: 1 }
    }
}

/// Writes one run into one MCAP file, step by step.
///
/// Everything is written in chunks that end with a step, each at most a second of the run: a program that is killed
/// leaves a file that reads up to its last chunk. Dropping the writer closes the file properly, only without a summary.
/// The same calls give the same bytes: nothing in the file comes from a clock or from this program's build.
pub struct RecordingWriter<W: Write + Seek> {
    path: PathBuf,
    writer: mcap::Writer<W>,
    options: RecordingOptions,
    channels: Channels,
    image: CompressedImage,
    pose: PoseInFrame,
    buffer: Vec<u8>,
    steps: u64,
    saved_steps: u64,
    chunk_bytes: usize,
    chunk_began: Option<Stamp>,
}

struct Channels {
    image_schema: u16,
    observation: u16,
    command: u16,
    truth: u16,
    explanation: u16,
    pose: u16,
    cameras: Vec<(String, u16)>,
}

impl RecordingWriter<BufWriter<File>> {
    /// Creates (or replaces) a file.
    pub fn create(path: &Path, header: &RecordingHeader) -> Result<Self, DataError> {
        let file = File::create(path).map_err(|e| DataError::write(path, "nothing was saved", e))?;
        Self::begin(path, BufWriter::new(file), header, RecordingOptions::default())
    }

    /// As [`RecordingWriter::create`], leaving something out.
    pub fn create_with(
        path: &Path,
        header: &RecordingHeader,
        options: RecordingOptions,
    ) -> Result<Self, DataError> {
        let file = File::create(path).map_err(|e| DataError::write(path, "nothing was saved", e))?;
        Self::begin(path, BufWriter::new(file), header, options)
    }
}

impl<W: Write + Seek> RecordingWriter<W> {
    /// Begins a recording: the header and the channels are written (and flushed) at once.
    pub fn new(to: W, header: &RecordingHeader) -> Result<Self, DataError> {
        Self::begin(Path::new("recording"), to, header, RecordingOptions::default())
    }

    /// As [`RecordingWriter::new`], leaving something out.
    pub fn with_options(
        to: W,
        header: &RecordingHeader,
        options: RecordingOptions,
    ) -> Result<Self, DataError> {
        Self::begin(Path::new("recording"), to, header, options)
    }

    fn begin(
        path: &Path,
        to: W,
        header: &RecordingHeader,
        options: RecordingOptions,
    ) -> Result<Self, DataError> {
        let fail = |error| DataError::write(path, "nothing was saved", into_io(error));
        // Without seeking a chunk goes out in one piece when it is complete, so a kill never leaves one whose length
        // is still a placeholder.
        let mut writer = mcap::WriteOptions::new()
            .compression(None)
            .chunk_size(None)
            .disable_seeking(true)
            .profile("")
            .library("senda")
            .create(to)
            .map_err(fail)?;
        writer.write_metadata(&header_record(header)).map_err(fail)?;
        let channels = Channels::add(&mut writer, header).map_err(fail)?;
        writer.flush().map_err(fail)?;
        Ok(Self {
            path: path.to_owned(),
            writer,
            options,
            channels,
            image: CompressedImage::default(),
            pose: PoseInFrame::default(),
            buffer: Vec::new(),
            steps: 0,
            saved_steps: 0,
            chunk_bytes: 0,
            chunk_began: None,
        })
    }

    /// Records one step. Frames keep the sensor's own bytes; frames that came uncompressed are stored as PNG.
    pub fn step(
        &mut self,
        observation: &Observation,
        command: &Command,
        truth: Option<&Truth>,
        explanation: &Explanation,
    ) -> Result<(), DataError> {
        self.refuse_nonsense(command)?;
        let with_frames = self
            .steps
            .is_multiple_of(u64::from(self.options.frames_every.max(1)));
        for frame in observation.frames.iter().filter(|_| with_frames) {
            match &frame.encoded {
                Some(encoded) => self.frame(observation.stamp, &frame.camera, frame.stamp, encoded)?,
                // A camera that missed its frame.
                None if frame.image.is_empty() => {}
                None => {
                    let encoded = senda_core::codec::encode_png(&frame.image).map_err(|reason| {
                        DataError::Unrecordable {
                            step: self.steps,
                            what: format!("frame of camera {}", frame.camera),
                            expected: "an image that fits a PNG".into(),
                            found: reason.to_string(),
                        }
                    })?;
                    self.frame(observation.stamp, &frame.camera, frame.stamp, &encoded)?;
                }
            }
        }
        let sensed = Sensed {
            stamp: observation.stamp,
            speed_mps: observation.speed_mps,
            wheels: observation.wheels,
            battery_v: observation.battery_v,
        };
        self.rest(&sensed, command, truth, explanation)
    }

    /// Records a step that already is in recorded form: copies and imports.
    pub fn recorded_step(&mut self, step: &Step) -> Result<(), DataError> {
        self.refuse_nonsense(&step.command)?;
        for frame in &step.frames {
            self.frame(step.stamp, &frame.camera, frame.stamp, &frame.encoded)?;
        }
        let sensed = Sensed {
            stamp: step.stamp,
            speed_mps: step.speed_mps,
            wheels: step.wheels,
            battery_v: step.battery_v,
        };
        self.rest(&sensed, &step.command, step.truth.as_ref(), &step.explanation)
    }

    /// Steps recorded so far.
    pub fn steps(&self) -> u64 {
        self.steps
    }

    /// Gives everything recorded so far to the operating system.
    pub fn flush(&mut self) -> Result<(), DataError> {
        self.writer.flush().map_err(|e| self.failed(e))?;
        self.saved_steps = self.steps;
        self.chunk_bytes = 0;
        self.chunk_began = None;
        Ok(())
    }

    /// Ends the recording with the run's figures.
    pub fn finish(mut self, summary: &serde_json::Value) -> Result<W, DataError> {
        let record = Metadata {
            name: messages::SUMMARY_RECORD.into(),
            metadata: BTreeMap::from([("json".to_owned(), summary.to_string())]),
        };
        self.writer.write_metadata(&record).map_err(|e| self.failed(e))?;
        self.finish_without_summary()
    }

    /// Ends the recording of a run that has no figures.
    pub fn finish_without_summary(mut self) -> Result<W, DataError> {
        self.writer.finish().map_err(|e| self.failed(e))?;
        self.saved_steps = self.steps;
        let Self {
            path, writer, steps, ..
        } = self;
        let mut inner = writer.into_inner();
        inner
            .flush()
            .map_err(|e| DataError::write(&path, saved_words(steps), e))?;
        Ok(inner)
    }

    fn frame(
        &mut self,
        step: Stamp,
        camera: &str,
        exposed: Stamp,
        encoded: &Encoded,
    ) -> Result<(), DataError> {
        let known = self.channels.cameras.iter().find(|(name, _)| name == camera);
        let channel = match known {
            Some((_, channel)) => *channel,
            None => self
                .channels
                .add_camera(&mut self.writer, camera)
                .map_err(|e| self.failed(e))?,
        };
        let image = &mut self.image;
        image.timestamp = Some(messages::timestamp(exposed));
        image.data.clear();
        image.data.extend_from_slice(&encoded.bytes);
        image.format.clear();
        image.format.push_str(match encoded.format {
            ImageFormat::Jpeg => "jpeg",
            ImageFormat::Png => "png",
        });
        image.frame_id.clear();
        image.frame_id.push_str(camera);
        self.buffer.clear();
        self.image.encode(&mut self.buffer).expect("a vector grows");
        self.message(channel, step, exposed)
    }

    fn rest(
        &mut self,
        sensed: &Sensed,
        command: &Command,
        truth: Option<&Truth>,
        explanation: &Explanation,
    ) -> Result<(), DataError> {
        let stamp = sensed.stamp;
        self.json(self.channels.observation, stamp, sensed)?;
        if let Some(truth) = truth {
            self.json(self.channels.truth, stamp, truth)?;
            self.pose.update(truth);
            self.buffer.clear();
            self.pose.encode(&mut self.buffer).expect("a vector grows");
            self.message(self.channels.pose, stamp, truth.stamp)?;
        }
        self.json(self.channels.explanation, stamp, explanation)?;
        // The command comes last: a step that has one is complete.
        self.json(self.channels.command, stamp, command)?;
        self.steps += 1;
        let began = *self.chunk_began.get_or_insert(stamp);
        if self.chunk_bytes >= CHUNK_BYTES || stamp.ns.saturating_sub(began.ns) >= CHUNK_NS {
            self.flush()?;
        }
        Ok(())
    }

    fn json<T: serde::Serialize>(&mut self, channel: u16, stamp: Stamp, value: &T) -> Result<(), DataError> {
        self.buffer.clear();
        serde_json::to_writer(&mut self.buffer, value).expect("plain numbers and words always become JSON");
        self.message(channel, stamp, stamp)
    }

    fn message(&mut self, channel_id: u16, log: Stamp, publish: Stamp) -> Result<(), DataError> {
        let header = MessageHeader {
            channel_id,
            // The number of the step holds its messages together, whatever order another program leaves them in.
            sequence: self.steps as u32,
            log_time: log.ns,
            publish_time: publish.ns,
        };
        self.chunk_bytes += self.buffer.len();
        self.writer
            .write_to_known_channel(&header, &self.buffer)
            .map_err(|e| self.failed(e))
    }

    fn refuse_nonsense(&self, command: &Command) -> Result<(), DataError> {
        if command.is_finite() {
            return Ok(());
        }
        Err(DataError::Unrecordable {
            step: self.steps,
            what: "command".into(),
            expected: "finite numbers".into(),
            found: format!("{command:?}"),
        })
    }

    fn failed(&self, error: mcap::McapError) -> DataError {
        DataError::write(&self.path, saved_words(self.saved_steps), into_io(error))
    }
}

fn saved_words(steps: u64) -> String {
    match steps {
        0 => "no step was saved".into(),
        1 => "the first step is saved and readable".into(),
        n => format!("the first {n} steps are saved and readable"),
    }
}

fn into_io(error: mcap::McapError) -> std::io::Error {
    match error {
        mcap::McapError::Io(error) => error,
        mcap::McapError::AttemptedWriteAfterFailure => {
            std::io::Error::other("an earlier write failed; begin a new recording")
        }
        other => std::io::Error::other(other),
    }
}

fn header_record(header: &RecordingHeader) -> Metadata {
    let mut metadata = BTreeMap::from([
        ("senda_format".to_owned(), FORMAT.to_string()),
        ("senda".to_owned(), header.senda.clone()),
        ("commit".to_owned(), header.commit.clone()),
        ("scenario".to_owned(), header.scenario.clone()),
        ("reversed".to_owned(), header.reversed.to_string()),
        (
            "body".to_owned(),
            serde_json::to_string(&header.body).expect("plain numbers and words always become JSON"),
        ),
        ("driver".to_owned(), header.driver.clone()),
        ("seed".to_owned(), header.seed.to_string()),
    ]);
    if let Some(world) = &header.world {
        metadata.insert("world".to_owned(), world.clone());
    }
    Metadata {
        name: messages::HEADER_RECORD.into(),
        metadata,
    }
}

impl Channels {
    fn add<W: Write + Seek>(
        writer: &mut mcap::Writer<W>,
        header: &RecordingHeader,
    ) -> mcap::McapResult<Self> {
        let nothing = BTreeMap::new();
        let mut json = |channel: &JsonChannel| {
            let schema = writer.add_schema(channel.schema, "jsonschema", channel.text.as_bytes())?;
            writer.add_channel(schema, channel.topic, "json", &nothing)
        };
        let [observation, command, truth, explanation] = [
            json(&OBSERVATION)?,
            json(&COMMAND)?,
            json(&TRUTH)?,
            json(&EXPLANATION)?,
        ];
        let pose_schema = writer.add_schema("foxglove.PoseInFrame", "protobuf", &messages::pose_schema())?;
        let pose = writer.add_channel(pose_schema, messages::POSE_TOPIC, "protobuf", &nothing)?;
        let image_schema = writer.add_schema(
            "foxglove.CompressedImage",
            "protobuf",
            &messages::compressed_image_schema(),
        )?;
        let mut channels = Self {
            image_schema,
            observation,
            command,
            truth,
            explanation,
            pose,
            cameras: Vec::new(),
        };
        for camera in &header.body.cameras {
            channels.add_camera(writer, &camera.name)?;
        }
        Ok(channels)
    }

    fn add_camera<W: Write + Seek>(
        &mut self,
        writer: &mut mcap::Writer<W>,
        camera: &str,
    ) -> mcap::McapResult<u16> {
        let topic = format!("{}{camera}", messages::CAMERA_TOPIC);
        let id = writer.add_channel(self.image_schema, &topic, "protobuf", &BTreeMap::new())?;
        self.cameras.push((camera.to_owned(), id));
        Ok(id)
    }
}
