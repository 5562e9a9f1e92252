//! A network and its weights from an ONNX graph, as other frameworks write them.

mod constant;
mod layers;

use super::*;
use crate::model::ModelError;
use crate::network::{Network, Shape};
use crate::weights::Weights;
use constant::Constant;
use prost::Message;
use senda_core::bounded_file;
use std::collections::BTreeMap;
use std::fmt::Write;
use std::path::Path;
use thiserror::Error;

/// Why an ONNX file could not be taken in.
#[derive(Debug, Error)]
pub enum OnnxError {
    /// It could not be read.
    #[error(transparent)]
    File(#[from] ModelError),
    /// It is not ONNX, or damaged.
    #[error("{file}: expected an ONNX model, but found {found}")]
    NotOnnx {
        /// Path or other source.
        file: String,
        /// What was found.
        found: String,
    },
    /// The engine has no such operation, or not with these attributes.
    #[error("{file}: node {node:?}: expected operations that this engine has, but found {found}; {known}")]
    Lacking {
        /// Path or other source.
        file: String,
        /// Name of the node.
        node: String,
        /// Operation, and what about it is not supported.
        found: String,
        /// The supported ones.
        known: &'static str,
    },
}

const KNOWN: &str = "known: Add, AveragePool, BatchNormalization, Clip (0 to 6), Concat, Constant, Conv, Div, Dropout, \
    Elu, Flatten, Gemm, GlobalAveragePool, Identity, LeakyRelu, MatMul, MaxPool, Mul, ReduceMean, Relu, Reshape, Resize, \
    Sigmoid, Squeeze, Sub, Tanh, Transpose, Upsample";

/// What an ONNX file held.
#[derive(Debug, Clone, PartialEq)]
pub struct Imported {
    /// The layers.
    pub network: Network,
    /// Their weights.
    pub weights: Weights,
    /// The file's own notes, such as the input specification of a model that senda exported.
    pub metadata: BTreeMap<String, String>,
}

impl Imported {
    /// Reads an ONNX file.
    ///
    /// # Errors
    /// When it cannot be read, is damaged, or uses operations that the engine lacks (named).
    pub fn load(path: &Path) -> Result<Self, OnnxError> {
        let file = path.display().to_string();
        let bytes = bounded_file::read(path, bounded_file::GIBIBYTE).map_err(|error| ModelError::File {
            file: file.clone(),
            reason: error.to_string(),
        })?;
        Self::from_bytes(&file, &bytes)
    }

    /// Reads an ONNX file's bytes; `source_name` is for error messages.
    ///
    /// # Errors
    /// When they are damaged, or use operations that the engine lacks (named).
    pub fn from_bytes(source_name: &str, bytes: &[u8]) -> Result<Self, OnnxError> {
        let not_onnx = |found: String| OnnxError::NotOnnx {
            file: source_name.to_owned(),
            found,
        };
        let model = ModelProto::decode(bytes).map_err(|error| not_onnx(error.to_string()))?;
        if model.opset_import.is_empty() {
            return Err(not_onnx(
                "no version of the operators: it was cut short, or is something else".to_owned(),
            ));
        }
        let graph = model.graph.ok_or_else(|| not_onnx("no graph".to_owned()))?;
        let mut reader = Reader {
            constants: BTreeMap::new(),
            values: BTreeMap::new(),
            text: String::new(),
            count: 0,
            last: String::new(),
            weights: Vec::new(),
        };
        for tensor in &graph.initializer {
            let constant = Constant::new(tensor).map_err(not_onnx)?;
            reader.constants.insert(tensor.name.clone(), constant);
        }
        reader.input(&graph).map_err(not_onnx)?;
        for node in &graph.node {
            reader.node(node).map_err(|found| OnnxError::Lacking {
                file: source_name.to_owned(),
                node: node.name.clone(),
                found: format!("{}: {found}", node.op_type),
                known: KNOWN,
            })?;
        }
        let [output] = &graph.output[..] else {
            return Err(not_onnx(format!("{} outputs, not one", graph.output.len())));
        };
        let value = reader.values.get(&output.name).cloned();
        let value = value.ok_or_else(|| not_onnx(format!("no value for the output {:?}", output.name)))?;
        reader.finish(&value);
        let stem = Path::new(source_name)
            .file_stem()
            .unwrap_or_default()
            .to_string_lossy();
        let name = if graph.name.is_empty() {
            stem.into_owned()
        } else {
            graph.name.clone()
        };
        let network = Network::parse(&name, &reader.text).map_err(|error| not_onnx(error.to_string()))?;
        let weights = Weights {
            values: reader.weights.concat(),
        };
        if !weights.fits(&network) {
            return Err(not_onnx(
                "weights that do not fit the layers, or are not finite".to_owned(),
            ));
        }
        Ok(Self {
            network,
            weights,
            metadata: model
                .metadata_props
                .into_iter()
                .map(|entry| (entry.key, entry.value))
                .collect(),
        })
    }
}

/// How the numbers of a value lie.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Layout {
    /// Channels first, as here.
    Planar,
    /// Channels last, as Keras has them: only on paper, until a transposition or flattening decides.
    Interleaved,
    /// A vector of what was interleaved: weights of the next dense layer are in that order.
    FlatInterleaved(Shape),
}

#[derive(Debug, Clone)]
struct Value {
    /// Name of the layer, `input` at first.
    layer: String,
    shape: Shape,
    layout: Layout,
}

struct Reader {
    constants: BTreeMap<String, Constant>,
    values: BTreeMap<String, Value>,
    text: String,
    count: usize,
    last: String,
    weights: Vec<Vec<f32>>,
}

fn attribute<'a>(node: &'a NodeProto, name: &str) -> Option<&'a AttributeProto> {
    node.attribute.iter().find(|attribute| attribute.name == name)
}

fn attribute_ints(node: &NodeProto, name: &str) -> Option<Vec<i64>> {
    attribute(node, name).map(|attribute| attribute.ints.clone())
}

fn attribute_text(node: &NodeProto, name: &str) -> String {
    let bytes = attribute(node, name).map(|attribute| attribute.s.clone());
    String::from_utf8_lossy(&bytes.unwrap_or_default()).into_owned()
}

impl Reader {
    fn input(&mut self, graph: &GraphProto) -> Result<(), String> {
        // Old files list weights among the inputs.
        let inputs: Vec<&ValueInfoProto> = graph
            .input
            .iter()
            .filter(|input| !self.constants.contains_key(&input.name))
            .collect();
        let [input] = inputs[..] else {
            return Err(format!("{} inputs, not one", inputs.len()));
        };
        let dims: Vec<usize> = input
            .kind
            .iter()
            .flat_map(|kind| &kind.tensor_type)
            .flat_map(|tensor| &tensor.shape)
            .flat_map(|shape| &shape.dim)
            .map(|dim| usize::try_from(dim.dim_value).unwrap_or(0))
            .collect();
        // A small last dimension behind larger ones is a picture with its channels last.
        let (layout, shape) = match dims[..] {
            [_, channels] => (Layout::Planar, Shape::flat(channels)),
            [_, height, width, channels] if channels <= 4 && height > 4 => (
                Layout::Interleaved,
                Shape {
                    channels,
                    height,
                    width,
                },
            ),
            [_, channels, height, width] => (
                Layout::Planar,
                Shape {
                    channels,
                    height,
                    width,
                },
            ),
            _ => {
                return Err(format!(
                    "an input of shape {dims:?}, not a batch of pictures or vectors"
                ));
            }
        };
        if shape.channels == 0 || shape.height == 0 || shape.width == 0 {
            return Err(format!(
                "an input of unknown size {dims:?}; export with a fixed size"
            ));
        }
        let _ = writeln!(
            self.text,
            "[input]\nheight = {}\nwidth = {}\nchannels = {}",
            shape.height, shape.width, shape.channels
        );
        let value = Value {
            layer: "input".to_owned(),
            shape,
            layout,
        };
        self.values.insert(input.name.clone(), value);
        Ok(())
    }

    fn value(&self, node: &NodeProto, index: usize) -> Result<Value, String> {
        let name = node.input.get(index).map_or("", String::as_str);
        self.values
            .get(name)
            .cloned()
            .ok_or_else(|| format!("input {index} ({name:?}) is not a value computed before"))
    }

    fn constant(&self, node: &NodeProto, index: usize) -> Option<&Constant> {
        self.constants.get(node.input.get(index)?)
    }

    fn floats(&self, node: &NodeProto, index: usize) -> Result<Constant, String> {
        match self.constant(node, index) {
            Some(constant) if !constant.floats.is_empty() => Ok(constant.clone()),
            _ => Err(format!("input {index} is not a constant of 32-bit floats")),
        }
    }

    fn name_output(&mut self, node: &NodeProto, value: Value) {
        if let Some(name) = node.output.first() {
            self.values.insert(name.clone(), value);
        }
    }

    /// Writes a layer and names its value.
    fn layer(&mut self, node: &NodeProto, kind: &str, body: &str, from: &[&Value], shape: Shape) {
        self.count += 1;
        let name = format!("{kind}_{}", self.count);
        let sources: Vec<String> = from.iter().map(|value| format!("{:?}", value.layer)).collect();
        let _ = writeln!(
            self.text,
            "\n[[layer]]\nname = \"{name}\"\nkind = \"{kind}\"\nfrom = [{}]\n{body}",
            sources.join(", ")
        );
        self.last.clone_from(&name);
        let layout = from.first().map_or(Layout::Planar, |value| value.layout);
        self.name_output(
            node,
            Value {
                layer: name,
                shape,
                layout,
            },
        );
    }

    fn finish(&mut self, output: &Value) {
        if self.last == output.layer {
            return;
        }
        // Other layers stand behind the output, or it is the input itself: here the last layer is the output.
        let _ = writeln!(
            self.text,
            "\n[[layer]]\nkind = \"flatten\"\nfrom = {:?}",
            output.layer
        );
    }

    fn planar(&self, node: &NodeProto) -> Result<Value, String> {
        let value = self.value(node, 0)?;
        match value.layout {
            Layout::Planar => Ok(value),
            _ if value.shape.is_flat() => Ok(value),
            _ => Err("pictures with channels last; expected a Transpose before it".to_owned()),
        }
    }

    fn node(&mut self, node: &NodeProto) -> Result<(), String> {
        match node.op_type.as_str() {
            "Constant" => {
                let Some(tensor) = attribute(node, "value").and_then(|attribute| attribute.t.as_ref()) else {
                    return Err("no value".to_owned());
                };
                let constant = Constant::new(tensor)?;
                if let Some(name) = node.output.first() {
                    self.constants.insert(name.clone(), constant);
                }
            }
            "Identity" | "Dropout" | "Cast" => {
                if let Some(constant) = self.constant(node, 0).cloned() {
                    if let Some(name) = node.output.first() {
                        self.constants.insert(name.clone(), constant);
                    }
                } else {
                    let value = self.value(node, 0)?;
                    self.name_output(node, value);
                }
            }
            "Conv" => self.convolution(node)?,
            "MaxPool" | "AveragePool" => self.pool(node)?,
            "GlobalAveragePool" => {
                let value = self.planar(node)?;
                let shape = Shape::flat(value.shape.channels);
                self.layer(node, "global_average_pool", "", &[&value], shape);
            }
            "ReduceMean" => self.mean(node)?,
            "Gemm" | "MatMul" => self.dense(node)?,
            "Flatten" | "Reshape" | "Squeeze" | "Unsqueeze" => self.flatten(node)?,
            "Transpose" => self.transpose(node)?,
            "Relu" => self.activation(node, "relu", "")?,
            "Sigmoid" => self.activation(node, "sigmoid", "")?,
            "Tanh" => self.activation(node, "tanh", "")?,
            "Elu" => {
                let alpha = attribute(node, "alpha").map_or(1.0, |attribute| attribute.f);
                if alpha != 1.0 {
                    return Err(format!("alpha {alpha}, not 1"));
                }
                self.activation(node, "elu", "")?;
            }
            "LeakyRelu" => {
                let slope = attribute(node, "alpha").map_or(0.01, |attribute| attribute.f);
                self.activation(node, "leaky_relu", &format!("slope = {slope:?}"))?;
            }
            "Clip" => {
                let limit = |index: usize, name: &str| {
                    let constant = self.constant(node, index).and_then(|c| c.floats.first().copied());
                    constant.or(attribute(node, name).map(|attribute| attribute.f))
                };
                match (limit(1, "min"), limit(2, "max")) {
                    (Some(0.0), Some(6.0)) => self.activation(node, "relu6", "")?,
                    (low, high) => return Err(format!("limits {low:?} and {high:?}, not 0 and 6")),
                }
            }
            "BatchNormalization" => {
                let value = self.planar(node)?;
                for index in 1..5 {
                    let constant = self.floats(node, index)?;
                    if constant.floats.len() != value.shape.channels {
                        return Err("statistics for another number of channels".to_owned());
                    }
                    self.weights.push(constant.floats);
                }
                let epsilon = attribute(node, "epsilon").map_or(1e-5, |attribute| attribute.f);
                let body = format!("epsilon = {epsilon:?}");
                self.layer(node, "batch_norm", &body, &[&value], value.shape);
            }
            "Add" | "Sub" | "Mul" | "Div" => self.arithmetic(node)?,
            "Concat" => {
                let values: Result<Vec<Value>, String> = (0..node.input.len())
                    .map(|index| self.value(node, index))
                    .collect();
                let values = values?;
                let axis = attribute(node, "axis").map_or(1, |attribute| attribute.i);
                let first = values.first().cloned().ok_or("no inputs")?;
                let is_channel = match first.layout {
                    Layout::Planar => axis == 1 || (axis == -1 && first.shape.is_flat()),
                    Layout::Interleaved => axis == 3 || axis == -1,
                    Layout::FlatInterleaved(_) => false,
                };
                if !is_channel || values.iter().any(|value| value.layout != first.layout) {
                    return Err(format!("axis {axis}, not the channels"));
                }
                let channels = values.iter().map(|value| value.shape.channels).sum();
                let all: Vec<&Value> = values.iter().collect();
                self.layer(
                    node,
                    "concatenate",
                    "",
                    &all,
                    Shape {
                        channels,
                        ..first.shape
                    },
                );
            }
            "Resize" | "Upsample" => self.resize(node)?,
            _ => return Err("no such operation here".to_owned()),
        }
        Ok(())
    }

    fn activation(&mut self, node: &NodeProto, word: &str, body: &str) -> Result<(), String> {
        let value = self.value(node, 0)?;
        let body = format!("activation = \"{word}\"\n{body}");
        self.layer(node, "activation", &body, &[&value], value.shape);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::layers::interleaved_place;
    use super::*;
    use crate::inference::Inference;

    fn outputs(network: &Network, weights: &Weights) -> Vec<f32> {
        let input: Vec<f32> = (0..network.input().len())
            .map(|i| ((i * 7) % 13) as f32 / 13.0 - 0.4)
            .collect();
        Inference::new(network, weights, 1).run(&input).to_vec()
    }

    #[test]
    fn exported_is_imported() {
        for name in Network::names() {
            let network = Network::named(name).unwrap();
            let weights = Weights::random(&network, 2);
            let bytes = export(&network, &weights, &[("note", "mine".to_owned())], None);
            let imported = Imported::from_bytes("x.onnx", &bytes);
            if network.is_recurrent() {
                assert!(imported.unwrap_err().to_string().contains("inputs, not one"));
                continue;
            }
            let imported = imported.unwrap();
            assert_eq!(imported.network.name(), name);
            assert_eq!(imported.metadata["note"], "mine");
            let (own, other) = (
                outputs(&network, &weights),
                outputs(&imported.network, &imported.weights),
            );
            assert_eq!(own, other, "{name}");
        }
    }

    #[test]
    fn what_is_not_onnx_or_lacks_here_is_named() {
        let network = Network::named("tinypilotnet").unwrap();
        let bytes = export(&network, &Weights::random(&network, 2), &[], None);
        for end in 0..bytes.len() {
            assert!(Imported::from_bytes("cut.onnx", &bytes[..end]).is_err(), "{end}");
        }
        let mut model = ModelProto::decode(&bytes[..]).unwrap();
        model.graph.as_mut().unwrap().node[1].op_type = "Gelu".to_owned();
        let error = Imported::from_bytes("x.onnx", &model.encode_to_vec())
            .unwrap_err()
            .to_string();
        assert!(
            error.contains("Gelu: no such operation here") && error.contains("known: Add"),
            "{error}"
        );
    }

    #[test]
    fn flattening_with_channels_last_reorders_the_weights() {
        let shape = Shape {
            channels: 2,
            height: 1,
            width: 3,
        };
        let order: Vec<usize> = (0..6)
            .map(|place| interleaved_place(Layout::FlatInterleaved(shape), place))
            .collect();
        assert_eq!(order, [0, 2, 4, 1, 3, 5]);
    }
}
