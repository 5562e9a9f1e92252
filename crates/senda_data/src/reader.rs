//! From the messages of a recording to its steps.

use crate::container::{self, End, Item};
use crate::messages::{
    self, CAMERA_TOPIC, COMMAND, CompressedImage, EXPLANATION, OBSERVATION, POSE_TOPIC, Sensed, TRUTH,
};
use crate::warnings::Warnings;
use crate::{DataError, EncodedFrame, FORMAT, LostSteps, Recording, RecordingHeader, Step};
use prost::Message;
use senda_core::{Command, Encoded, Explanation, ImageFormat, Truth};
use std::collections::BTreeMap;
use std::io::Read;
use std::path::Path;

/// The warning about a recording that nobody finished.
pub const NO_SUMMARY: &str = "there is no summary: the run was ended before it was finished";

/// What a channel carries.
#[derive(Debug, Clone, PartialEq)]
enum Topic {
    Observation,
    Command,
    Truth,
    Explanation,
    Camera(String),
    /// Ours, but only for other programs.
    Pose,
    Foreign,
}

/// The messages of one step, as they come in.
#[derive(Debug, Default)]
struct Parts {
    log_time: u64,
    frames: Vec<EncodedFrame>,
    sensed: Option<Sensed>,
    command: Option<Command>,
    truth: Option<Truth>,
    explanation: Option<Explanation>,
}

#[derive(Debug, Default)]
struct Collected {
    channels: BTreeMap<u16, Topic>,
    steps: BTreeMap<u32, Parts>,
    /// Messages whose channel has not been declared yet: channel, sequence, time, bytes. The declaration may have been in
    /// a damaged chunk; the file's summary repeats it.
    undeclared: Vec<(u16, u32, u64, Vec<u8>)>,
    header: Option<BTreeMap<String, String>>,
    summary: Option<serde_json::Value>,
    warnings: Warnings,
    topics: Vec<String>,
}

pub(crate) fn read(path: &Path, from: impl Read) -> Result<Recording, DataError> {
    let mut collected = Collected::default();
    let end = container::walk(from, &mut |item| collected.item(item))
        .map_err(|source| DataError::read(path, source))?;
    if end == End::NotMcap {
        return Err(DataError::NotThat {
            path: path.to_owned(),
            expected: "a recording (MCAP)".into(),
            found: "a file that does not begin as MCAP does (empty, cut off at the very beginning, or something else)"
                .into(),
            advice: "give a file that senda recorded, or import other data with `senda data import`".into(),
        });
    }
    let Some(header) = &collected.header else {
        let found = match (end, collected.topics.as_slice()) {
            (End::Cut(byte), []) => format!("a file cut off at byte {byte}, before the header"),
            (_, []) => "an MCAP file without it".to_owned(),
            (_, topics) => format!("an MCAP file of another program, with {}", topics.join(", ")),
        };
        return Err(DataError::NotThat {
            path: path.to_owned(),
            expected: format!(
                "a recording of senda (MCAP metadata `{}`)",
                messages::HEADER_RECORD
            ),
            found,
            advice: "give a file that senda recorded".into(),
        });
    };
    let (header, unknown) = parse_header(path, header)?;
    for key in unknown {
        collected.warnings.add("unknown header keys", || {
            format!("header: {key}: unknown key, ignored")
        });
    }
    let late = std::mem::take(&mut collected.undeclared);
    for (channel, sequence, log_time, data) in late {
        match collected.channels.get(&channel).cloned() {
            Some(topic) => collected.message(&topic, sequence, log_time, &data),
            None => collected.warnings.add("messages of undeclared channels", || {
                format!("step {sequence}: a message of channel {channel}, which is not declared, is ignored")
            }),
        }
    }
    let (steps, lost) = collected.take_steps(end);
    Ok(Recording {
        header,
        steps,
        lost,
        summary: collected.summary,
        warnings: collected.warnings.finish(),
    })
}

impl Collected {
    fn item(&mut self, item: Item<'_>) {
        match item {
            Item::Channel(channel) => {
                let topic = Topic::of(&channel.topic, &channel.encoding);
                if !self.topics.contains(&channel.topic) {
                    if topic == Topic::Foreign {
                        self.warnings.add("unknown channels", || {
                            format!(
                                "channel {} ({}) is not one of senda's: ignored",
                                channel.topic, channel.encoding
                            )
                        });
                    }
                    self.topics.push(channel.topic);
                }
                self.channels.insert(channel.id, topic);
            }
            Item::Message(message) => match self.channels.get(&message.channel).cloned() {
                Some(topic) => self.message(&topic, message.sequence, message.log_time, message.data),
                None => self.undeclared.push((
                    message.channel,
                    message.sequence,
                    message.log_time,
                    message.data.to_vec(),
                )),
            },
            Item::Metadata(name, map) if name == messages::HEADER_RECORD => {
                self.header.get_or_insert(map);
            }
            Item::Metadata(name, map) if name == messages::SUMMARY_RECORD => {
                let text = map.get("json").map(String::as_str).unwrap_or_default();
                match serde_json::from_str(text) {
                    Ok(summary) => self.summary = Some(summary),
                    Err(reason) => self.warnings.add("damaged summaries", || {
                        format!("the summary is not JSON ({reason}): left out")
                    }),
                }
            }
            Item::Metadata(..) => {}
            Item::Damaged(reason) => self.warnings.add("damaged places", || reason),
        }
    }

    fn message(&mut self, topic: &Topic, sequence: u32, log_time: u64, data: &[u8]) {
        if matches!(topic, Topic::Pose | Topic::Foreign) {
            return;
        }
        let parts = self.steps.entry(sequence).or_default();
        parts.log_time = log_time;
        let outcome = match topic {
            Topic::Observation => json(data).map(|value| parts.sensed = Some(value)),
            Topic::Command => json(data).map(|value| parts.command = Some(value)),
            Topic::Truth => json(data).map(|value| parts.truth = Some(value)),
            Topic::Explanation => json(data).map(|value| parts.explanation = Some(value)),
            Topic::Camera(name) => frame(name, data).map(|frame| parts.frames.push(frame)),
            Topic::Pose | Topic::Foreign => Ok(()),
        };
        if let Err(reason) = outcome {
            self.warnings.add("damaged messages", || {
                format!(
                    "step {sequence}, {:.3} s: {topic:?}: {reason}: left out",
                    log_time as f64 * 1e-9
                )
            });
        }
    }

    fn take_steps(&mut self, end: End) -> (Vec<Step>, Vec<LostSteps>) {
        let mut steps = Vec::with_capacity(self.steps.len());
        let mut lost = Vec::new();
        // Recorded steps are numbered from 0.
        let mut next = 0;
        let last = self.steps.keys().next_back().copied();
        for (sequence, parts) in std::mem::take(&mut self.steps) {
            let time_s = parts.log_time as f64 * 1e-9;
            match (parts.sensed, parts.command) {
                (Some(sensed), Some(command)) => {
                    if sequence > next {
                        let (before, count) = (steps.len(), sequence - next);
                        lost.push(LostSteps { before, count });
                    }
                    next = sequence.saturating_add(1);
                    steps.push(Step {
                        stamp: sensed.stamp,
                        frames: parts.frames,
                        speed_mps: sensed.speed_mps,
                        wheels: sensed.wheels,
                        battery_v: sensed.battery_v,
                        command,
                        truth: parts.truth,
                        explanation: parts.explanation.unwrap_or_default(),
                    });
                }
                // The break goes through this step: the warning about the break says it all.
                _ if end != End::Whole && Some(sequence) == last => {}
                (sensed, _) => self.warnings.add("incomplete steps", || {
                    let missing = if sensed.is_none() {
                        "observation"
                    } else {
                        "command"
                    };
                    format!("step {sequence}, {time_s:.3} s: its {missing} is missing: step left out")
                }),
            }
        }
        if let End::Cut(byte) = end {
            let until = steps.last().map_or_else(
                || "no step could be read".to_owned(),
                |step| {
                    format!(
                        "{} steps up to {:.3} s could be read",
                        steps.len(),
                        step.stamp.as_s()
                    )
                },
            );
            self.warnings.add("breaks", || {
                format!("the file is cut off after byte {byte}: {until}")
            });
        } else if self.summary.is_none() {
            self.warnings.add("missing summaries", || NO_SUMMARY.into());
        }
        (steps, lost)
    }
}

impl Topic {
    fn of(topic: &str, encoding: &str) -> Self {
        match (topic, encoding) {
            (t, "json") if t == OBSERVATION.topic => Self::Observation,
            (t, "json") if t == COMMAND.topic => Self::Command,
            (t, "json") if t == TRUTH.topic => Self::Truth,
            (t, "json") if t == EXPLANATION.topic => Self::Explanation,
            (t, "protobuf") if t == POSE_TOPIC => Self::Pose,
            (t, "protobuf") => match t.strip_prefix(CAMERA_TOPIC) {
                Some(camera) => Self::Camera(camera.to_owned()),
                None => Self::Foreign,
            },
            _ => Self::Foreign,
        }
    }
}

fn json<T: serde::de::DeserializeOwned>(data: &[u8]) -> Result<T, String> {
    serde_json::from_slice(data).map_err(|e| e.to_string())
}

fn frame(camera: &str, data: &[u8]) -> Result<EncodedFrame, String> {
    let image = CompressedImage::decode(data).map_err(|e| e.to_string())?;
    let format = match image.format.as_str() {
        "jpeg" => ImageFormat::Jpeg,
        "png" => ImageFormat::Png,
        other => return Err(format!("image format: expected jpeg or png, but found {other:?}")),
    };
    let stamp = image.timestamp.as_ref().and_then(messages::stamp);
    Ok(EncodedFrame {
        camera: camera.to_owned(),
        stamp: stamp.ok_or("the frame has no valid time")?,
        encoded: Encoded {
            format,
            bytes: image.data,
        },
    })
}

type Unknown = Vec<String>;

fn parse_header(
    path: &Path,
    map: &BTreeMap<String, String>,
) -> Result<(RecordingHeader, Unknown), DataError> {
    let value = |key: &str, expected: &str, found: &str| DataError::Value {
        path: path.to_owned(),
        key: format!("header: {key}"),
        expected: expected.to_owned(),
        found: found.to_owned(),
    };
    let get = |key: &str| {
        map.get(key)
            .map(String::as_str)
            .ok_or_else(|| value(key, "a value", "nothing"))
    };
    let format = get("senda_format")?;
    match format.parse::<u32>() {
        Ok(1..=FORMAT) => {}
        Ok(0) | Err(_) => return Err(value("senda_format", "a whole number from 1", format)),
        Ok(_) => {
            return Err(DataError::Newer {
                path: path.to_owned(),
                supported: FORMAT,
                found: format.to_owned(),
                by: get("senda").unwrap_or("an unknown version").to_owned(),
            });
        }
    }
    let body = get("body")?;
    let header = RecordingHeader {
        senda: get("senda")?.to_owned(),
        commit: get("commit")?.to_owned(),
        scenario: get("scenario")?.to_owned(),
        world: map.get("world").cloned(),
        reversed: match get("reversed")? {
            "true" => true,
            "false" => false,
            other => return Err(value("reversed", "true or false", other)),
        },
        body: serde_json::from_str(body)
            .map_err(|e| value("body", "a vehicle's body as JSON", &e.to_string()))?,
        driver: get("driver")?.to_owned(),
        seed: get("seed").and_then(|seed| seed.parse().map_err(|_| value("seed", "a whole number", seed)))?,
    };
    const KNOWN: [&str; 9] = [
        "senda_format",
        "senda",
        "commit",
        "scenario",
        "world",
        "reversed",
        "body",
        "driver",
        "seed",
    ];
    let unknown = map
        .keys()
        .filter(|key| !KNOWN.contains(&key.as_str()))
        .cloned()
        .collect();
    Ok((header, unknown))
}
