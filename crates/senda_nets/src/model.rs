//! Model files: a trained network with everything that a driver needs to know.
//!
//! The layout is that of safetensors, so that Python opens one with `safetensors.safe_open`: eight bytes of header length
//! (little-endian), a JSON header that places every tensor, the values as little-endian `f32` (kernels of a quantised model
//! as `i8`, with `NAME.scale` beside them). What is more than weights stands in the header's `__metadata__` under `senda`.

use crate::detection::DetectionSpec;
use crate::quantised::{self, Grid, is_kernel, kernel_steps, scale_name};
use crate::safetensors::{split, tensor_values};
use crate::{Inference, InputSpec, Network, Tensor, Weights};
use senda_core::{bounded_file, whole_file};
use senda_geom::{Camera, Vec2, Vec3};
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value, json};
use std::path::{Path, PathBuf};
use thiserror::Error;

/// The version that this program writes and reads.
const VERSION: u32 = 1;

/// Longer files are no model of ours: a network has at most 2^26 values, 268 MB, and a header 17 MB.
const MOST_BYTES: u64 = 300_000_000;

const MADE_BY: &str = "models are made by `senda train` and `senda learn`";

/// A trained network, ready to drive.
#[derive(Debug, Clone, PartialEq)]
pub struct Model {
    /// The layers.
    pub network: Network,
    /// Their weights.
    pub weights: Weights,
    /// How frames are prepared.
    pub input: InputSpec,
    /// What the outputs mean, in order.
    pub outputs: Vec<OutputSpec>,
    /// Where it came from.
    pub provenance: Provenance,
    /// For a quantised model, the steps of every node's values (the input first) but the output's; empty for all others.
    pub grids: Vec<Grid>,
    /// For a detector, what its output means; it has no `outputs` then.
    pub detection: Option<DetectionSpec>,
    /// Whether the state of recurrent layers is forgotten before every picture, because the network learned from single ones.
    pub forgets: bool,
}

/// One output of a network.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct OutputSpec {
    /// `steering`, `curvature`, `speed`, `throttle`.
    pub name: String,
    /// What 1 means, in words.
    #[serde(default)]
    pub unit: String,
}

/// How a model came about.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(default)]
pub struct Provenance {
    /// Version of senda that trained it.
    pub senda: String,
    /// Commit of that version.
    pub commit: String,
    /// Data that it learned from.
    pub data: Vec<String>,
    /// Worlds that it has seen.
    pub worlds: Vec<String>,
    /// Seed of the training.
    pub seed: u64,
    /// The command that made it.
    pub command: String,
    /// Figures: errors, success.
    pub metrics: Map<String, Value>,
    /// Anything else that a reader should know.
    pub notes: String,
}

/// Why a model file cannot be used.
#[derive(Debug, Error)]
pub enum ModelError {
    /// The system could not read or write it.
    #[error("{file}: {reason}")]
    File {
        /// Which file.
        file: String,
        /// What the system said.
        reason: String,
    },
    /// It is not a model file, or a damaged one.
    #[error("{file}: expected a model file of senda, but {found}; {help}")]
    Format {
        /// Which file.
        file: String,
        /// What is there instead.
        found: String,
        /// What to do.
        help: String,
    },
}

/// A camera that a model was not trained with, and how it differs.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[error("the model was trained with another camera: {differences}")]
pub struct CameraMismatch {
    /// Every difference, with both values.
    pub differences: String,
}

#[derive(Serialize, Deserialize)]
struct Head {
    version: u32,
    network: String,
    input: InputSpec,
    outputs: Vec<OutputSpec>,
    #[serde(default)]
    provenance: Provenance,
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    grids: Vec<Grid>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    detection: Option<DetectionSpec>,
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    forgets: bool,
}

impl Model {
    /// Whether weights and values have 8 bits.
    pub fn is_quantised(&self) -> bool {
        !self.grids.is_empty()
    }

    /// Ready to run one input at a time; a quantised model's values lie on its grids, and one that forgets has no state.
    pub fn inference(&self) -> Inference {
        Inference::new(&self.network, &self.weights, 1)
            .on_grids(&self.grids)
            .forgetting(self.forgets)
    }

    /// The file's bytes.
    pub fn to_bytes(&self) -> Vec<u8> {
        let head = Head {
            version: VERSION,
            network: self.network.to_toml(),
            input: self.input.clone(),
            outputs: self.outputs.clone(),
            provenance: self.provenance.clone(),
            grids: self.grids.clone(),
            detection: self.detection.clone(),
            forgets: self.forgets,
        };
        let mut header = Map::new();
        let text = serde_json::to_string(&head).unwrap_or_default();
        header.insert("__metadata__".to_owned(), json!({"format": "pt", "senda": text}));
        let mut data: Vec<u8> = Vec::with_capacity(4 * self.weights.values.len());
        let mut put = |name: String, dtype: &str, shape: &[usize], bytes: &mut dyn Iterator<Item = u8>| {
            let start = data.len();
            data.extend(bytes);
            let entry = json!({"dtype": dtype, "shape": shape, "data_offsets": [start, data.len()]});
            header.insert(name, entry);
        };
        let floats =
            |values: &[f32]| -> Vec<u8> { values.iter().flat_map(|value| value.to_le_bytes()).collect() };
        let values = &self.weights.values;
        let in_steps = |tensor: &&Tensor| self.is_quantised() && is_kernel(tensor);
        for tensor in self.network.tensors() {
            if in_steps(&tensor) {
                let (_, scales) = kernel_steps(tensor, values);
                let bytes = floats(&scales);
                put(scale_name(tensor), "F32", &[scales.len()], &mut bytes.into_iter());
            } else {
                let bytes = floats(&values[tensor.range()]);
                put(tensor.name.clone(), "F32", &tensor.shape, &mut bytes.into_iter());
            }
        }
        // Bytes last: the floats before them then lie at multiples of four.
        for tensor in self.network.tensors().filter(in_steps) {
            let (steps, _) = kernel_steps(tensor, values);
            let mut bytes = steps.into_iter().map(|step| step.to_le_bytes()[0]);
            put(tensor.name.clone(), "I8", &tensor.shape, &mut bytes);
        }
        let mut header = serde_json::to_vec(&Value::Object(header)).unwrap_or_default();
        // Values are aligned to eight bytes, as safetensors wants it.
        header.resize(header.len().next_multiple_of(8), b' ');
        let mut bytes = Vec::with_capacity(8 + header.len() + data.len());
        bytes.extend_from_slice(&(header.len() as u64).to_le_bytes());
        bytes.extend_from_slice(&header);
        bytes.extend_from_slice(&data);
        bytes
    }

    /// Writes the file: beside the old one, then in its place, so that a full disk leaves the old one whole.
    pub fn save(&self, path: &Path) -> Result<(), ModelError> {
        whole_file::replace(path, |file| file.write_all(&self.to_bytes()))
            .map_err(|error| file_error(path, &error))
    }

    /// As [`Self::save`], but a file that lies there already stays as `NAME.earlier`, where the answer says: it may have cost hours.
    pub fn save_keeping_earlier(&self, path: &Path) -> Result<Option<PathBuf>, ModelError> {
        whole_file::replace_keeping_earlier(path, |file| file.write_all(&self.to_bytes()))
            .map_err(|error| file_error(path, &error))
    }

    /// The model as an ONNX file, for other programs: `input` is `[batch, channels, height, width]` as
    /// [`InputSpec`] prepares it, `output` is `[batch, outputs]`. Both specifications are in its metadata. The state of a
    /// recurrent layer goes in and comes out as values of its own. A quantised model has `QuantizeLinear` and
    /// `DequantizeLinear` around every layer, which the compilers of accelerators understand.
    pub fn to_onnx(&self) -> Vec<u8> {
        let metadata = [
            ("senda.input", json!(self.input).to_string()),
            ("senda.outputs", json!(self.outputs).to_string()),
            ("senda.provenance", json!(self.provenance).to_string()),
        ];
        let grids = self.is_quantised().then_some(self.grids.as_slice());
        crate::onnx::export(&self.network, &self.weights, &metadata, grids)
    }

    /// Reads a file.
    pub fn load(path: &Path) -> Result<Self, ModelError> {
        let name = path.display().to_string();
        let bytes = bounded_file::read(path, MOST_BYTES).map_err(|error| ModelError::Format {
            file: name.clone(),
            found: match error.kind() {
                std::io::ErrorKind::NotFound => "found no such file".to_owned(),
                std::io::ErrorKind::InvalidInput => error.to_string(),
                _ => format!("it cannot be read: {error}"),
            },
            help: MADE_BY.to_owned(),
        })?;
        Self::from_bytes(&name, &bytes).map_err(|error| match error {
            ModelError::Format { file, .. } if path.extension().is_some_and(|end| end == "onnx") => {
                ModelError::Format {
                    found: "its name is that of an ONNX file".to_owned(),
                    help: format!("make a model of it: `senda model import {file}`"),
                    file,
                }
            }
            other => other,
        })
    }

    /// Reads a file's bytes; `name` is for messages.
    pub fn from_bytes(name: &str, bytes: &[u8]) -> Result<Self, ModelError> {
        let wrong = |found: String, help: &str| ModelError::Format {
            file: name.to_owned(),
            found,
            help: help.to_owned(),
        };
        let none = |found: &str| wrong(found.to_owned(), MADE_BY);
        let (header, data) = split(bytes).map_err(|found| none(&found))?;
        let text = header
            .get("__metadata__")
            .and_then(|metadata| metadata.get("senda"))
            .and_then(Value::as_str)
            .ok_or_else(|| {
                wrong(
                    "it holds weights without a description".to_owned(),
                    "bring networks of other programs in with `senda model import`",
                )
            })?;
        let version = serde_json::from_str::<Value>(text)
            .ok()
            .and_then(|head| head.get("version").and_then(Value::as_u64));
        if version != Some(u64::from(VERSION)) {
            let found = version.map_or("no version".to_owned(), |version| format!("version {version}"));
            return Err(wrong(
                format!("it has {found} and this program reads version {VERSION}"),
                "use the program that made it, or train it anew",
            ));
        }
        let head: Head = serde_json::from_str(text)
            .map_err(|error| wrong(format!("its description is damaged ({error})"), "train it anew"))?;
        let network = Network::parse(name, &head.network)
            .map_err(|error| wrong(format!("its network is damaged ({error})"), "train it anew"))?;
        if let Some(fault) = head.input.fault(network.input()) {
            return Err(wrong(
                format!("its input does not fit ({fault})"),
                "train it anew",
            ));
        }
        if let Some(detection) = &head.detection {
            let fault = detection.fault(&network);
            let both = (!head.outputs.is_empty()).then(|| "it describes outputs beside boxes".to_owned());
            if let Some(fault) = fault.or(both) {
                return Err(wrong(format!("its boxes do not fit ({fault})"), "train it anew"));
            }
        } else if head.outputs.len() != network.output_len() {
            return Err(wrong(
                format!(
                    "it describes {} outputs of {}",
                    head.outputs.len(),
                    network.output_len()
                ),
                "train it anew",
            ));
        }
        let steps = network.layers().len();
        let is_quantised = !head.grids.is_empty();
        if is_quantised && (head.grids.len() != steps || !head.grids.iter().all(Grid::is_good)) {
            return Err(wrong(
                format!(
                    "its 8-bit steps are damaged ({} for {steps} layers)",
                    head.grids.len()
                ),
                "quantise it anew",
            ));
        }
        let weights = read_weights(&network, &header, data, is_quantised)
            .map_err(|found| wrong(found, "copy it again, or train it anew"))?;
        Ok(Self {
            network,
            weights,
            input: head.input,
            outputs: head.outputs,
            provenance: head.provenance,
            grids: head.grids,
            detection: head.detection,
            forgets: head.forgets,
        })
    }

    /// Whether a vehicle's camera sees the floor as the one that the model was trained with.
    ///
    /// # Errors
    /// Every difference by name: height, place, tilt, turn, lens, shape of the picture.
    pub fn check_camera(&self, camera: &Camera) -> Result<(), CameraMismatch> {
        let Some(trained) = &self.input.camera else {
            return Ok(());
        };
        let differences = differences(trained, camera);
        if differences.is_empty() {
            return Ok(());
        }
        Err(CameraMismatch {
            differences: differences.join(", "),
        })
    }
}

fn file_error(path: &Path, error: &std::io::Error) -> ModelError {
    ModelError::File {
        file: path.display().to_string(),
        reason: error.to_string(),
    }
}

fn read_weights(
    network: &Network,
    header: &Map<String, Value>,
    data: &[u8],
    is_quantised: bool,
) -> Result<Weights, String> {
    // A hostile header asks for no more memory than the file has bytes.
    let smallest = if is_quantised { 1 } else { 4 };
    if network.parameter_count() > data.len() / smallest {
        return Err("one that was cut short: weights are missing at its end".to_owned());
    }
    let weights = if is_quantised {
        quantised::read_weights(network, header, data)?
    } else {
        let mut weights = Weights {
            values: vec![0f32; network.parameter_count()],
        };
        for tensor in network.tensors() {
            let read = tensor_values(header, data, &tensor.name, &tensor.shape)?;
            for (value, read) in weights.values[tensor.range()].iter_mut().zip(read) {
                *value = read;
            }
        }
        weights
    };
    if weights.values.iter().any(|value| !value.is_finite()) {
        return Err("weights that are no numbers".to_owned());
    }
    Ok(weights)
}

/// Tolerances (guesses, about what a careful remounting keeps): a tenth of the height, 3 cm of place, 3° of direction,
/// a tenth of the view angle, 3 % of the picture's shape.
fn differences(trained: &Camera, own: &Camera) -> Vec<String> {
    let mut found = Vec::new();
    let (a, b) = (&trained.mounting, &own.mounting);
    if (a.z_m - b.z_m).abs() > 0.1 * a.z_m.abs() + 0.002 {
        found.push(format!("height {:.3} m then, {:.3} m now", a.z_m, b.z_m));
    }
    for (name, then, now) in [("ahead", a.x_m, b.x_m), ("to the left", a.y_m, b.y_m)] {
        if (then - now).abs() > 0.03_f64.max(0.1 * a.z_m) {
            found.push(format!("{name} {then:.3} m then, {now:.3} m now"));
        }
    }
    for (name, then, now) in [
        ("tilt", a.tilt_rad, b.tilt_rad),
        ("turned", a.yaw_rad, b.yaw_rad),
        ("rolled", a.roll_rad, b.roll_rad),
    ] {
        if (then - now).abs() > 3f64.to_radians() {
            found.push(format!(
                "{name} {:.1}° then, {:.1}° now",
                then.to_degrees(),
                now.to_degrees()
            ));
        }
    }
    let shape = |camera: &Camera| f64::from(camera.width_px) / f64::from(camera.height_px.max(1));
    if (shape(trained) / shape(own) - 1.0).abs() > 0.03 {
        found.push(format!(
            "pictures of {}x{} then, {}x{} now",
            trained.width_px, trained.height_px, own.width_px, own.height_px
        ));
    }
    let (then, now) = (half_view(trained), half_view(own));
    if (then / now - 1.0).abs() > 0.1 {
        found.push(format!(
            "view {:.0}° then, {:.0}° now (middle half of the picture)",
            then.to_degrees(),
            now.to_degrees()
        ));
    }
    found
}

/// Angle (rad) between the rays through a quarter and three quarters of the picture's width, halfway down.
fn half_view(camera: &Camera) -> f64 {
    let ray = |part: f64| -> Vec3 {
        let pixel = Vec2::new(
            part * f64::from(camera.width_px),
            0.5 * f64::from(camera.height_px),
        );
        camera.lens.ray(pixel).normalize_or_zero()
    };
    let cos = ray(0.25).dot(ray(0.75)).clamp(-1.0, 1.0);
    senda_geom::trig::acos(cos)
}

#[cfg(test)]
mod tests {
    use super::*;
    use senda_geom::{Lens, Mounting};

    fn camera() -> Camera {
        Camera {
            name: "center".into(),
            width_px: 160,
            height_px: 120,
            lens: Lens::pinhole(160, 120, 1.0, 0.8),
            mounting: Mounting {
                x_m: 0.1,
                y_m: 0.0,
                z_m: 0.2,
                yaw_rad: 0.0,
                tilt_rad: 0.5,
                roll_rad: 0.0,
            },
        }
    }

    fn model() -> Model {
        let network = Network::named("tinypilotnet").unwrap();
        Model {
            weights: Weights::random(&network, 7),
            input: InputSpec {
                camera: Some(camera()),
                ..InputSpec::of(network.input())
            },
            outputs: vec![OutputSpec {
                name: "steering".into(),
                unit: "part of full lock".into(),
            }],
            provenance: Provenance {
                seed: 7,
                worlds: vec!["oval".into()],
                ..Provenance::default()
            },
            grids: vec![],
            detection: None,
            forgets: false,
            network,
        }
    }

    #[test]
    fn what_is_saved_is_loaded() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.senda");
        model().save(&path).unwrap();
        assert_eq!(Model::load(&path).unwrap(), model());
        let forgetful = Model {
            forgets: true,
            ..model()
        };
        assert_eq!(Model::from_bytes("m", &forgetful.to_bytes()).unwrap(), forgetful);
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
    }

    #[test]
    fn a_cut_or_damaged_file_is_refused_with_words() {
        let whole = model().to_bytes();
        for length in (0..whole.len()).step_by(13) {
            let error = Model::from_bytes("m", &whole[..length]).unwrap_err().to_string();
            assert!(error.starts_with("m: expected a model file"), "{error}");
        }
        for (damaged, word) in [
            (b"not a model at all, but some text".to_vec(), "something else"),
            (whole.iter().map(|byte| byte ^ 0x55).collect(), "something else"),
            (
                replaced(&whole, "\\\"version\\\":1", "\\\"version\\\":9"),
                "version 9",
            ),
            (replaced(&whole, "senda\":\"", "sendb\":\""), "import"),
        ] {
            let error = Model::from_bytes("m", &damaged).unwrap_err().to_string();
            assert!(error.contains(word), "{error}");
        }
        let mut no_number = whole.clone();
        let end = no_number.len();
        no_number[end - 4..].copy_from_slice(&f32::NAN.to_le_bytes());
        assert!(
            Model::from_bytes("m", &no_number)
                .unwrap_err()
                .to_string()
                .contains("no numbers")
        );
    }

    fn replaced(bytes: &[u8], from: &str, to: &str) -> Vec<u8> {
        let at = bytes
            .windows(from.len())
            .position(|window| window == from.as_bytes())
            .unwrap();
        let mut out = bytes.to_vec();
        out[at..at + to.len()].copy_from_slice(to.as_bytes());
        out
    }

    #[test]
    fn another_camera_is_named() {
        let model = model();
        assert_eq!(model.check_camera(&camera()), Ok(()));
        assert_eq!(model.check_camera(&camera().resized(320, 240)), Ok(()));
        let mut other = camera();
        other.mounting.tilt_rad = 0.7;
        other.lens = Lens::equidistant(160, 120, 2.1);
        let text = model.check_camera(&other).unwrap_err().to_string();
        assert!(
            text.contains("tilt 28.6° then, 40.1° now") && text.contains("view"),
            "{text}"
        );
        assert!(!text.contains("height"), "{text}");
    }
}
