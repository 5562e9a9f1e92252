//! What is inside a recording's messages: Foxglove's protobuf messages, and JSON with its schemas.

use prost::Message;
use prost_types::field_descriptor_proto::{Label, Type};
use prost_types::{DescriptorProto, FieldDescriptorProto, FileDescriptorProto, FileDescriptorSet, Timestamp};
use senda_core::{Stamp, Truth, Wheels};
use senda_geom::trig;
use serde::{Deserialize, Serialize};

/// `foxglove.CompressedImage`, field numbers as in Foxglove's published schema.
#[derive(Clone, PartialEq, Message)]
pub(crate) struct CompressedImage {
    #[prost(message, optional, tag = "1")]
    pub(crate) timestamp: Option<Timestamp>,
    #[prost(bytes = "vec", tag = "2")]
    pub(crate) data: Vec<u8>,
    #[prost(string, tag = "3")]
    pub(crate) format: String,
    #[prost(string, tag = "4")]
    pub(crate) frame_id: String,
}

#[derive(Clone, Copy, PartialEq, Message)]
pub(crate) struct Vector3 {
    #[prost(double, tag = "1")]
    x: f64,
    #[prost(double, tag = "2")]
    y: f64,
    #[prost(double, tag = "3")]
    z: f64,
}

#[derive(Clone, Copy, PartialEq, Message)]
pub(crate) struct Quaternion {
    #[prost(double, tag = "1")]
    x: f64,
    #[prost(double, tag = "2")]
    y: f64,
    #[prost(double, tag = "3")]
    z: f64,
    #[prost(double, tag = "4")]
    w: f64,
}

#[derive(Clone, Copy, PartialEq, Message)]
pub(crate) struct Pose {
    #[prost(message, optional, tag = "1")]
    position: Option<Vector3>,
    #[prost(message, optional, tag = "2")]
    orientation: Option<Quaternion>,
}

/// `foxglove.PoseInFrame`: lets other programs draw the driven path. Our own reader uses `/truth`.
#[derive(Clone, PartialEq, Message)]
pub(crate) struct PoseInFrame {
    #[prost(message, optional, tag = "1")]
    timestamp: Option<Timestamp>,
    #[prost(string, tag = "2")]
    frame_id: String,
    #[prost(message, optional, tag = "3")]
    pose: Option<Pose>,
}

impl PoseInFrame {
    pub(crate) fn update(&mut self, truth: &Truth) {
        let pose = truth.world_from_vehicle;
        let (sin, cos) = trig::sincos(0.5 * pose.heading_rad);
        self.timestamp = Some(timestamp(truth.stamp));
        if self.frame_id.is_empty() {
            self.frame_id.push_str("world");
        }
        self.pose = Some(Pose {
            position: Some(Vector3 {
                x: pose.x_m,
                y: pose.y_m,
                z: 0.0,
            }),
            orientation: Some(Quaternion {
                x: 0.0,
                y: 0.0,
                z: sin,
                w: cos,
            }),
        });
    }
}

/// `/observation` as JSON: what was sensed besides pictures.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(crate) struct Sensed {
    pub(crate) stamp: Stamp,
    #[serde(default)]
    pub(crate) speed_mps: Option<f64>,
    #[serde(default)]
    pub(crate) wheels: Option<Wheels>,
    #[serde(default)]
    pub(crate) battery_v: Option<f64>,
}

pub(crate) fn timestamp(stamp: Stamp) -> Timestamp {
    Timestamp {
        seconds: (stamp.ns / 1_000_000_000) as i64,
        nanos: (stamp.ns % 1_000_000_000) as i32,
    }
}

/// `None` for times before the run began or beyond what nanoseconds can count.
pub(crate) fn stamp(timestamp: &Timestamp) -> Option<Stamp> {
    let seconds = u64::try_from(timestamp.seconds).ok()?;
    let nanos = u64::try_from(timestamp.nanos).ok()?;
    Some(Stamp::from_ns(
        seconds.checked_mul(1_000_000_000)?.checked_add(nanos)?,
    ))
}

fn field(name: &str, number: i32, kind: Type) -> FieldDescriptorProto {
    FieldDescriptorProto {
        name: Some(name.into()),
        number: Some(number),
        label: Some(Label::Optional as i32),
        r#type: Some(kind as i32),
        json_name: Some(name.into()),
        ..Default::default()
    }
}

fn part(name: &str, number: i32, of: &str) -> FieldDescriptorProto {
    FieldDescriptorProto {
        type_name: Some(of.into()),
        ..field(name, number, Type::Message)
    }
}

fn file(
    package: &str,
    name: &str,
    imports: &[&str],
    fields: Vec<FieldDescriptorProto>,
) -> FileDescriptorProto {
    let path = |name: &str| match name {
        "Timestamp" => "google/protobuf/timestamp.proto".to_owned(),
        other => format!("foxglove/{other}.proto"),
    };
    FileDescriptorProto {
        name: Some(path(name)),
        package: Some(package.into()),
        dependency: imports.iter().map(|name| path(name)).collect(),
        message_type: vec![DescriptorProto {
            name: Some(name.into()),
            field: fields,
            ..Default::default()
        }],
        syntax: Some("proto3".into()),
        ..Default::default()
    }
}

fn timestamp_file() -> FileDescriptorProto {
    let fields = vec![field("seconds", 1, Type::Int64), field("nanos", 2, Type::Int32)];
    file("google.protobuf", "Timestamp", &[], fields)
}

const TIMESTAMP: &str = ".google.protobuf.Timestamp";

/// The `FileDescriptorSet` of `foxglove.CompressedImage`, serialized, as MCAP wants it for a protobuf schema.
pub(crate) fn compressed_image_schema() -> Vec<u8> {
    let image = vec![
        part("timestamp", 1, TIMESTAMP),
        field("frame_id", 4, Type::String),
        field("data", 2, Type::Bytes),
        field("format", 3, Type::String),
    ];
    FileDescriptorSet {
        file: vec![
            timestamp_file(),
            file("foxglove", "CompressedImage", &["Timestamp"], image),
        ],
    }
    .encode_to_vec()
}

/// The `FileDescriptorSet` of `foxglove.PoseInFrame`, serialized.
pub(crate) fn pose_schema() -> Vec<u8> {
    let doubles = |names: &[&str]| -> Vec<_> {
        names
            .iter()
            .zip(1..)
            .map(|(name, n)| field(name, n, Type::Double))
            .collect()
    };
    let pose = vec![
        part("position", 1, ".foxglove.Vector3"),
        part("orientation", 2, ".foxglove.Quaternion"),
    ];
    let in_frame = vec![
        part("timestamp", 1, TIMESTAMP),
        field("frame_id", 2, Type::String),
        part("pose", 3, ".foxglove.Pose"),
    ];
    FileDescriptorSet {
        file: vec![
            timestamp_file(),
            file("foxglove", "Vector3", &[], doubles(&["x", "y", "z"])),
            file("foxglove", "Quaternion", &[], doubles(&["x", "y", "z", "w"])),
            file("foxglove", "Pose", &["Vector3", "Quaternion"], pose),
            file("foxglove", "PoseInFrame", &["Timestamp", "Pose"], in_frame),
        ],
    }
    .encode_to_vec()
}

/// A JSON channel: topic, schema name, JSON schema.
pub(crate) struct JsonChannel {
    pub(crate) topic: &'static str,
    pub(crate) schema: &'static str,
    pub(crate) text: &'static str,
}

pub(crate) const OBSERVATION: JsonChannel = JsonChannel {
    topic: "/observation",
    schema: "senda.Observation",
    text: r#"{"type":"object","description":"What was sensed besides pictures","properties":{
"stamp":{"type":"integer","description":"ns since the run began"},
"speed_mps":{"type":["number","null"],"description":"measured forward speed, m/s"},
"wheels":{"type":["object","null"],"description":"encoder ticks since the run began","properties":{"left_ticks":{"type":"integer"},"right_ticks":{"type":"integer"}}},
"battery_v":{"type":["number","null"],"description":"V"}}}"#,
};

pub(crate) const COMMAND: JsonChannel = JsonChannel {
    topic: "/command",
    schema: "senda.Command",
    text: r#"{"type":"object","description":"What was asked of the vehicle, after the guard; left positive","properties":{
"turn":{"type":"object","description":"exactly one of these","properties":{"curvature_per_m":{"type":"number","description":"1/m"},"yaw_rate_radps":{"type":"number","description":"rad/s"},"steering_rad":{"type":"number","description":"angle of the front wheels, rad"}}},
"drive":{"type":"object","description":"exactly one of these","properties":{"speed_mps":{"type":"number","description":"m/s"},"throttle":{"type":"number","description":"-1..1, negative brakes"}}}}}"#,
};

pub(crate) const TRUTH: JsonChannel = JsonChannel {
    topic: "/truth",
    schema: "senda.Truth",
    text: r#"{"type":"object","description":"The true state, where it is known; x forward, y left, counter-clockwise positive","properties":{
"stamp":{"type":"integer","description":"ns since the run began"},
"world_from_vehicle":{"type":"object","properties":{"x_m":{"type":"number"},"y_m":{"type":"number"},"heading_rad":{"type":"number"}}},
"speed_mps":{"type":"number","description":"m/s"},
"yaw_rate_radps":{"type":"number","description":"rad/s"},
"steering_rad":{"type":"number","description":"angle of the front wheels, rad"},
"battery_v":{"type":"number","description":"V"}}}"#,
};

pub(crate) const EXPLANATION: JsonChannel = JsonChannel {
    topic: "/explanation",
    schema: "senda.Explanation",
    text: r#"{"type":"object","description":"How the command came about","properties":{
"signals":{"type":"array","items":{"type":"object","properties":{"name":{"type":"string"},"value":{"type":["number","null"]}}}},
"shapes":{"type":"array","description":"drawn over the first camera's picture, px","items":{"type":"object","properties":{"kind":{"type":"string"}}}},
"events":{"type":"array","items":{"type":"string"}}}}"#,
};

/// Topic of the pose for other programs.
pub(crate) const POSE_TOPIC: &str = "/pose";
/// Beginning of the cameras' topics; the camera's name follows.
pub(crate) const CAMERA_TOPIC: &str = "/camera/";
/// Name of the MCAP metadata record with the header.
pub(crate) const HEADER_RECORD: &str = "senda.header";
/// Name of the MCAP metadata record with the summary.
pub(crate) const SUMMARY_RECORD: &str = "senda.summary";

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn json_schemas_are_json() {
        for channel in [OBSERVATION, COMMAND, TRUTH, EXPLANATION] {
            serde_json::from_str::<serde_json::Value>(channel.text).unwrap();
        }
    }

    #[test]
    fn stamps_survive_protobuf() {
        for ns in [0, 1, 999_999_999, 1_000_000_000, u64::MAX] {
            assert_eq!(stamp(&timestamp(Stamp::from_ns(ns))), Some(Stamp::from_ns(ns)));
        }
        let early = Timestamp {
            seconds: -1,
            nanos: 0,
        };
        assert_eq!(stamp(&early), None);
    }
}
