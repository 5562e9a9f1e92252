//! A network and its weights from an ONNX graph, as other frameworks write them.

use super::*;
use crate::model::ModelError;
use crate::network::{Network, Shape};
use crate::weights::Weights;
use prost::Message;
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
        let bytes = std::fs::read(path).map_err(|error| ModelError::File {
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

/// A tensor that does not depend on the input.
#[derive(Debug, Clone)]
struct Constant {
    shape: Vec<usize>,
    floats: Vec<f32>,
    wholes: Vec<i64>,
}

impl Constant {
    fn new(tensor: &TensorProto) -> Result<Self, String> {
        if tensor.data_location == 1 {
            return Err(format!(
                "values of {:?} in another file; save the model as one file",
                tensor.name
            ));
        }
        let shape: Option<Vec<usize>> = tensor
            .dims
            .iter()
            .map(|size| usize::try_from(*size).ok())
            .collect();
        let shape = shape.ok_or_else(|| format!("a negative size in {:?}", tensor.name))?;
        let (mut floats, mut wholes) = (tensor.float_data.clone(), tensor.int64_data.clone());
        if !tensor.raw_data.is_empty() {
            match tensor.data_type {
                FLOAT => {
                    let words = tensor.raw_data.chunks_exact(4);
                    floats = words
                        .map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]]))
                        .collect();
                }
                INT64 => {
                    let words = tensor.raw_data.chunks_exact(8);
                    wholes = words
                        .map(|b| i64::from_le_bytes([b[0], b[1], b[2], b[3], b[4], b[5], b[6], b[7]]))
                        .collect();
                }
                _ => {}
            }
        }
        let count = shape
            .iter()
            .try_fold(1usize, |product, size| product.checked_mul(*size));
        let len = match tensor.data_type {
            FLOAT => floats.len(),
            INT64 => wholes.len(),
            // Other types may stand in nodes that are not used; whoever needs them complains.
            _ => {
                return Ok(Self {
                    shape,
                    floats: Vec::new(),
                    wholes: Vec::new(),
                });
            }
        };
        if count != Some(len) {
            return Err(format!(
                "{len} values where the shape of {:?} is {shape:?}",
                tensor.name
            ));
        }
        Ok(Self {
            shape,
            floats,
            wholes,
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

    /// Kernel, stride and padding as lines of a network file, and the output's size.
    fn window(
        &self,
        node: &NodeProto,
        key: &str,
        kernel: [usize; 2],
        input: Shape,
    ) -> Result<(String, [usize; 2]), String> {
        let pair = |name: &str, default: i64| -> Result<[usize; 2], String> {
            match attribute_ints(node, name).as_deref() {
                None => Ok([default as usize; 2]),
                Some([a, b]) if (1..=64).contains(a) && (1..=64).contains(b) => {
                    Ok([*a as usize, *b as usize])
                }
                Some(other) => Err(format!("{name} {other:?}")),
            }
        };
        let stride = pair("strides", 1)?;
        if pair("dilations", 1)? != [1, 1] {
            return Err("dilations".to_owned());
        }
        if attribute(node, "ceil_mode").is_some_and(|attribute| attribute.i != 0) {
            return Err("ceil_mode".to_owned());
        }
        let pads = match attribute_text(node, "auto_pad").as_str() {
            "" | "NOTSET" => match attribute_ints(node, "pads").as_deref() {
                None => [0; 4],
                Some([a, b, c, d]) if [a, b, c, d].iter().all(|pad| (0..64).contains(*pad)) => {
                    [*a as usize, *b as usize, *c as usize, *d as usize]
                }
                Some(other) => return Err(format!("pads {other:?}")),
            },
            "VALID" => [0; 4],
            "SAME_UPPER" => crate::network::Padding::Same.amounts(input, kernel, stride),
            other => return Err(format!("auto_pad {other}")),
        };
        let size = |input: usize, before: usize, after: usize, kernel: usize, stride: usize| {
            (input + before + after)
                .checked_sub(kernel)
                .map(|rest| rest / stride + 1)
        };
        let height = size(input.height, pads[0], pads[2], kernel[0], stride[0]);
        let width = size(input.width, pads[1], pads[3], kernel[1], stride[1]);
        let (Some(height), Some(width)) = (height, width) else {
            return Err("a window larger than its input".to_owned());
        };
        let text = format!("{key} = {kernel:?}\nstride = {stride:?}\npadding = {pads:?}\n");
        Ok((text, [height, width]))
    }

    fn convolution(&mut self, node: &NodeProto) -> Result<(), String> {
        let value = self.planar(node)?;
        let weight = self.floats(node, 1)?;
        let [filters, group_channels, height, width] = weight.shape[..] else {
            return Err(format!(
                "a kernel of shape {:?}, not of two dimensions",
                weight.shape
            ));
        };
        let group = attribute(node, "group").map_or(1, |attribute| attribute.i);
        let is_depthwise = group > 1;
        let channels = value.shape.channels;
        if is_depthwise && (group as usize != channels || filters != channels || group_channels != 1) {
            return Err(format!(
                "{group} groups of {channels} channels; known are 1 or one for each channel"
            ));
        }
        if !is_depthwise && group_channels != channels {
            return Err(format!("a kernel for {group_channels} channels on {channels}"));
        }
        let (window, [out_height, out_width]) = self.window(node, "kernel", [height, width], value.shape)?;
        let has_bias = node.input.get(2).is_some_and(|name| !name.is_empty());
        self.weights.push(weight.floats);
        if has_bias {
            let bias = self.floats(node, 2)?;
            self.weights.push(bias.floats);
        }
        let shape = Shape {
            channels: filters,
            height: out_height,
            width: out_width,
        };
        if is_depthwise {
            let body = format!("{window}bias = {has_bias}");
            self.layer(node, "depthwise_convolution", &body, &[&value], shape);
        } else {
            let body = format!("filters = {filters}\n{window}bias = {has_bias}");
            self.layer(node, "convolution", &body, &[&value], shape);
        }
        Ok(())
    }

    fn pool(&mut self, node: &NodeProto) -> Result<(), String> {
        let value = self.planar(node)?;
        let kernel = match attribute_ints(node, "kernel_shape").as_deref() {
            Some([a, b]) if (1..=64).contains(a) && (1..=64).contains(b) => [*a as usize, *b as usize],
            other => return Err(format!("kernel_shape {other:?}")),
        };
        let (body, [height, width]) = self.window(node, "size", kernel, value.shape)?;
        let is_average = node.op_type == "AveragePool";
        let counts_padding = attribute(node, "count_include_pad").is_some_and(|attribute| attribute.i != 0);
        if is_average && counts_padding && !body.contains("padding = [0, 0, 0, 0]") {
            return Err("count_include_pad".to_owned());
        }
        let kind = if is_average { "average_pool" } else { "max_pool" };
        let shape = Shape {
            height,
            width,
            ..value.shape
        };
        self.layer(node, kind, &body, &[&value], shape);
        Ok(())
    }

    fn mean(&mut self, node: &NodeProto) -> Result<(), String> {
        let value = self.value(node, 0)?;
        let axes = attribute_ints(node, "axes").or_else(|| self.constant(node, 1).map(|c| c.wholes.clone()));
        let mut axes: Vec<i64> = axes
            .unwrap_or_default()
            .iter()
            .map(|axis| axis.rem_euclid(4))
            .collect();
        axes.sort_unstable();
        let expected = if value.layout == Layout::Planar {
            [2, 3]
        } else {
            [1, 2]
        };
        if axes != expected {
            return Err(format!("axes {axes:?}, not height and width"));
        }
        let shape = Shape::flat(value.shape.channels);
        self.layer(node, "global_average_pool", "", &[&value], shape);
        Ok(())
    }

    fn dense(&mut self, node: &NodeProto) -> Result<(), String> {
        let value = self.value(node, 0)?;
        let weight = self.floats(node, 1)?;
        let [rows, columns] = weight.shape[..] else {
            return Err(format!("a matrix of shape {:?}", weight.shape));
        };
        let flag = |name: &str| attribute(node, name).is_some_and(|attribute| attribute.i != 0);
        let factor = |name: &str| attribute(node, name).map_or(1.0, |attribute| attribute.f);
        if flag("transA") || factor("alpha") != 1.0 || factor("beta") != 1.0 {
            return Err("transA, alpha or beta".to_owned());
        }
        let (units, inputs) = if flag("transB") {
            (rows, columns)
        } else {
            (columns, rows)
        };
        if !value.shape.is_flat() || inputs != value.shape.channels {
            return Err(format!("a matrix for {inputs} inputs on {}", value.shape));
        }
        let at = |unit: usize, input: usize| {
            if flag("transB") {
                weight.floats[unit * inputs + input]
            } else {
                weight.floats[input * units + unit]
            }
        };
        let mut own = Vec::with_capacity(units * inputs);
        for unit in 0..units {
            for input in 0..inputs {
                own.push(at(unit, interleaved_place(value.layout, input)));
            }
        }
        self.weights.push(own);
        let has_bias = node.input.get(2).is_some_and(|name| !name.is_empty());
        if has_bias {
            let bias = self.floats(node, 2)?.floats;
            if bias.len() != units {
                return Err("a bias of another length".to_owned());
            }
            self.weights.push(bias);
        }
        let body = format!("units = {units}\nbias = {has_bias}");
        let planar = Value {
            layout: Layout::Planar,
            ..value
        };
        self.layer(node, "dense", &body, &[&planar], Shape::flat(units));
        Ok(())
    }

    fn flatten(&mut self, node: &NodeProto) -> Result<(), String> {
        let mut value = self.value(node, 0)?;
        if node.op_type == "Reshape" {
            let target = self
                .constant(node, 1)
                .map(|c| c.wholes.clone())
                .unwrap_or_default();
            let len = value.shape.len() as i64;
            let is_vector = matches!(target[..], [_, n] if n == -1 || n == len)
                || matches!(target[..], [_, n, 1, 1] if value.shape.is_flat() && (n == -1 || n == len));
            if !is_vector {
                return Err(format!("to {target:?}; known is one vector for each picture"));
            }
        } else if node.op_type == "Flatten" {
            let axis = attribute(node, "axis").map_or(1, |attribute| attribute.i);
            if axis != 1 {
                return Err(format!("axis {axis}"));
            }
        } else if value.shape.is_flat() {
            // Dimensions of size one come and go.
            self.name_output(node, value);
            return Ok(());
        } else {
            return Err("dimensions of a picture".to_owned());
        }
        if value.shape.is_flat() {
            self.name_output(node, value);
            return Ok(());
        }
        let shape = value.shape;
        value.layout = match value.layout {
            Layout::Interleaved => Layout::FlatInterleaved(shape),
            other => other,
        };
        self.layer(node, "flatten", "", &[&value], Shape::flat(shape.len()));
        Ok(())
    }

    fn transpose(&mut self, node: &NodeProto) -> Result<(), String> {
        let mut value = self.value(node, 0)?;
        let permutation = attribute_ints(node, "perm").unwrap_or_default();
        value.layout = match (&permutation[..], value.layout) {
            ([0, 3, 1, 2], Layout::Interleaved) => Layout::Planar,
            ([0, 2, 3, 1], Layout::Planar) => Layout::Interleaved,
            _ => return Err(format!("perm {permutation:?} here")),
        };
        self.name_output(node, value);
        Ok(())
    }

    /// Sums of values, or constants on values: a bias, or scaling of the input.
    fn arithmetic(&mut self, node: &NodeProto) -> Result<(), String> {
        let is_value = |index: usize| {
            node.input
                .get(index)
                .is_some_and(|name| self.values.contains_key(name))
        };
        if is_value(0) && is_value(1) {
            let (a, b) = (self.value(node, 0)?, self.value(node, 1)?);
            if node.op_type != "Add" || a.shape != b.shape || a.layout != b.layout {
                return Err("two values that are not a sum of equal shapes".to_owned());
            }
            self.layer(node, "add", "", &[&a, &b], a.shape);
            return Ok(());
        }
        let value_index = usize::from(!is_value(0));
        if value_index == 1 && matches!(node.op_type.as_str(), "Sub" | "Div") {
            return Err("a constant on the left".to_owned());
        }
        let value = self.value(node, value_index)?;
        let constant = self.floats(node, 1 - value_index)?;
        let channels = value.shape.channels;
        let numbers: Vec<f32> = match (constant.floats.len(), value.layout) {
            (1, _) => vec![constant.floats[0]; channels],
            (count, Layout::Planar | Layout::Interleaved) if count == channels => constant.floats,
            _ => {
                return Err(format!(
                    "a constant of shape {:?} on {}",
                    constant.shape, value.shape
                ));
            }
        };
        let apply = |number: f32| match node.op_type.as_str() {
            "Add" => (1.0, number),
            "Sub" => (1.0, -number),
            "Mul" => (number, 0.0),
            _ => (1.0 / number, 0.0),
        };
        let (factors, terms): (Vec<f32>, Vec<f32>) = numbers.into_iter().map(apply).unzip();
        // A frozen batch norm is a factor and a term for each channel.
        self.weights
            .extend([factors, terms, vec![0.0; channels], vec![1.0; channels]]);
        let body = "epsilon = 1e-9\ntrainable = false";
        self.layer(node, "batch_norm", body, &[&value], value.shape);
        Ok(())
    }

    fn resize(&mut self, node: &NodeProto) -> Result<(), String> {
        let value = self.planar(node)?;
        let mode = attribute_text(node, "mode");
        let coordinates = attribute_text(node, "coordinate_transformation_mode");
        let rounding = attribute_text(node, "nearest_mode");
        let scales = [2, 1]
            .into_iter()
            .filter_map(|index| self.constant(node, index))
            .find(|constant| constant.floats.len() == 4)
            .map(|constant| constant.floats.clone());
        let is_plain = coordinates == "asymmetric" && rounding == "floor"
            // Whole factors: these place the copies alike.
            || matches!(coordinates.as_str(), "" | "half_pixel" | "asymmetric") && mode != "linear";
        match scales.as_deref() {
            Some([1.0, 1.0, a, b]) if a == b && (1.0..=16.0).contains(a) && a.fract() == 0.0 && is_plain => {
                let factor = *a as usize;
                let shape = Shape {
                    height: value.shape.height * factor,
                    width: value.shape.width * factor,
                    ..value.shape
                };
                self.layer(node, "upsample", &format!("factor = {factor}"), &[&value], shape);
                Ok(())
            }
            other => Err(format!(
                "mode {mode:?}, scales {other:?}; known is nearest with a whole factor"
            )),
        }
    }
}

/// Where input `place` (planar) of a vector lies in the order of the file.
fn interleaved_place(layout: Layout, place: usize) -> usize {
    match layout {
        Layout::FlatInterleaved(shape) => {
            let (channel, pixel) = (place / shape.plane(), place % shape.plane());
            pixel * shape.channels + channel
        }
        _ => place,
    }
}

#[cfg(test)]
mod tests {
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
