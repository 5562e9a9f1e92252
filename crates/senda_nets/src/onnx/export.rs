//! A network and its weights as an ONNX graph.

use super::*;
use crate::network::{Activation, Kind, Layer, Network, Shape, Tensor};
use crate::quantised::{Grid, is_kernel, kernel_steps};
use crate::weights::Weights;
use prost::Message;

/// The bytes of an ONNX file: `input` is `[batch, channels, height, width]`, `output` is `[batch, outputs]`. The state of
/// a recurrent layer goes in as `LAYER.h_in`, `LAYER.c_in` and comes out as `LAYER.h_out`, `LAYER.c_out`. With `grids`, kernels
/// and values are 8-bit, in `QuantizeLinear` and `DequantizeLinear`.
pub(crate) fn export(
    network: &Network,
    weights: &Weights,
    metadata: &[(&str, String)],
    grids: Option<&[Grid]>,
) -> Vec<u8> {
    let mut writer = Writer {
        weights: &weights.values,
        graph: GraphProto {
            name: network.name().to_owned(),
            input: vec![value("input", &image_dimensions(network.input()))],
            ..GraphProto::default()
        },
        names: vec!["input".to_owned()],
        ranks: vec![4],
        spare: 0,
        grids,
    };
    writer.names[0] = writer.on_grid(0, "input".to_owned());
    for layer in network.layers() {
        writer.layer(layer);
    }
    let last = writer.ranked(network.layers().len(), 2);
    writer.node("Identity", &[&last], "output", vec![]);
    let outputs = Dimension::Size(network.output_len());
    writer
        .graph
        .output
        .insert(0, value("output", &[Dimension::Batch, outputs]));
    let entry = |(key, value): &(&str, String)| StringEntry {
        key: (*key).to_owned(),
        value: value.clone(),
    };
    ModelProto {
        ir_version: 8,
        producer_name: "senda".to_owned(),
        producer_version: env!("CARGO_PKG_VERSION").to_owned(),
        graph: Some(writer.graph),
        opset_import: vec![OperatorSetId {
            domain: String::new(),
            version: OPSET,
        }],
        metadata_props: metadata.iter().map(entry).collect(),
    }
    .encode_to_vec()
}

impl Network {
    /// The network and its weights as an ONNX file; [`crate::Model::to_onnx`] adds what a driver needs to know.
    ///
    /// # Panics
    /// When there are not as many weights as the network has parameters ([`Weights::fits`] tells).
    pub fn to_onnx(&self, weights: &Weights) -> Vec<u8> {
        assert_eq!(
            weights.values.len(),
            self.parameter_count(),
            "weights of another network"
        );
        export(self, weights, &[], None)
    }
}

#[derive(Clone, Copy)]
enum Dimension {
    Batch,
    Size(usize),
}

fn image_dimensions(shape: Shape) -> [Dimension; 4] {
    [
        Dimension::Batch,
        Dimension::Size(shape.channels),
        Dimension::Size(shape.height),
        Dimension::Size(shape.width),
    ]
}

fn value(name: &str, dimensions: &[Dimension]) -> ValueInfoProto {
    let dim = dimensions
        .iter()
        .map(|dimension| match dimension {
            Dimension::Batch => DimensionProto {
                dim_value: 0,
                dim_param: "batch".to_owned(),
            },
            Dimension::Size(size) => DimensionProto {
                dim_value: *size as i64,
                dim_param: String::new(),
            },
        })
        .collect();
    ValueInfoProto {
        name: name.to_owned(),
        kind: Some(TypeProto {
            tensor_type: Some(TensorTypeProto {
                elem_type: FLOAT,
                shape: Some(TensorShapeProto { dim }),
            }),
        }),
    }
}

fn ints(name: &str, values: &[usize]) -> AttributeProto {
    AttributeProto {
        name: name.to_owned(),
        ints: values.iter().map(|value| *value as i64).collect(),
        kind: 7,
        ..AttributeProto::default()
    }
}

fn int(name: &str, value: i64) -> AttributeProto {
    AttributeProto {
        name: name.to_owned(),
        i: value,
        kind: 2,
        ..AttributeProto::default()
    }
}

fn float(name: &str, value: f32) -> AttributeProto {
    AttributeProto {
        name: name.to_owned(),
        f: value,
        kind: 1,
        ..AttributeProto::default()
    }
}

fn text(name: &str, value: &str) -> AttributeProto {
    AttributeProto {
        name: name.to_owned(),
        s: value.as_bytes().to_vec(),
        kind: 3,
        ..AttributeProto::default()
    }
}

struct Writer<'a> {
    weights: &'a [f32],
    graph: GraphProto,
    /// Name and number of dimensions of every node's value; 0 is the input.
    names: Vec<String>,
    ranks: Vec<usize>,
    spare: usize,
    grids: Option<&'a [Grid]>,
}

impl Writer<'_> {
    fn node(&mut self, operation: &str, inputs: &[&str], output: &str, attribute: Vec<AttributeProto>) {
        self.graph.node.push(NodeProto {
            input: inputs.iter().map(|name| (*name).to_owned()).collect(),
            output: vec![output.to_owned()],
            name: format!("{operation}:{output}"),
            op_type: operation.to_owned(),
            attribute,
            domain: String::new(),
        });
    }

    /// A node whose output nobody needs to know.
    fn inner(&mut self, operation: &str, inputs: &[&str], attribute: Vec<AttributeProto>) -> String {
        self.spare += 1;
        let name = format!("value.{}", self.spare);
        self.node(operation, inputs, &name, attribute);
        name
    }

    fn constant(&mut self, name: &str, shape: &[usize], values: &[f32]) -> String {
        self.graph.initializer.push(TensorProto {
            dims: shape.iter().map(|size| *size as i64).collect(),
            data_type: FLOAT,
            name: name.to_owned(),
            raw_data: values.iter().flat_map(|value| value.to_le_bytes()).collect(),
            ..TensorProto::default()
        });
        name.to_owned()
    }

    fn whole_constant(&mut self, name: &str, values: &[i64]) -> String {
        self.graph.initializer.push(TensorProto {
            dims: vec![values.len() as i64],
            data_type: INT64,
            name: name.to_owned(),
            raw_data: values.iter().flat_map(|value| value.to_le_bytes()).collect(),
            ..TensorProto::default()
        });
        name.to_owned()
    }

    fn bytes_constant(&mut self, name: &str, shape: &[usize], data_type: i32, raw_data: Vec<u8>) -> String {
        self.graph.initializer.push(TensorProto {
            dims: shape.iter().map(|size| *size as i64).collect(),
            data_type,
            name: name.to_owned(),
            raw_data,
            ..TensorProto::default()
        });
        name.to_owned()
    }

    /// A tensor of weights; kernels of 8 bits where there are grids.
    fn weight(&mut self, tensor: &Tensor) -> String {
        if self.grids.is_none() || !is_kernel(tensor) {
            let weights = self.weights;
            return self.constant(&tensor.name, &tensor.shape, &weights[tensor.range()]);
        }
        let (steps, scales) = kernel_steps(tensor, self.weights);
        let rows = [scales.len()];
        let bytes = steps.into_iter().map(|step| step.to_le_bytes()[0]).collect();
        let steps = self.bytes_constant(&tensor.name, &tensor.shape, INT8, bytes);
        let scale = self.constant(&format!("{}.scale", tensor.name), &rows, &scales);
        let zero = self.bytes_constant(
            &format!("{}.zero", tensor.name),
            &rows,
            INT8,
            vec![0; scales.len()],
        );
        self.inner("DequantizeLinear", &[&steps, &scale, &zero], vec![int("axis", 0)])
    }

    /// The value of a node on its grid, where there is one.
    fn on_grid(&mut self, node: usize, value: String) -> String {
        let Some(grid) = self.grids.and_then(|grids| grids.get(node)).copied() else {
            return value;
        };
        let scale = self.constant(&format!("grid.{node}.scale"), &[], &[grid.scale]);
        let zero = self.bytes_constant(&format!("grid.{node}.zero"), &[], UINT8, vec![grid.zero]);
        let steps = self.inner("QuantizeLinear", &[&value, &scale, &zero], vec![]);
        self.inner("DequantizeLinear", &[&steps, &scale, &zero], vec![])
    }

    /// The value of a node with this number of dimensions.
    fn ranked(&mut self, node: usize, rank: usize) -> String {
        let name = self.names[node].clone();
        match (self.ranks[node], rank) {
            (4, 2) => self.inner("Flatten", &[&name], vec![]),
            (2, 4) => {
                self.spare += 1;
                let axes = self.whole_constant(&format!("axes.{}", self.spare), &[2, 3]);
                self.inner("Unsqueeze", &[&name, &axes], vec![])
            }
            _ => name,
        }
    }

    fn layer(&mut self, layer: &Layer) {
        let tensors: Vec<String> = layer.tensors.iter().map(|tensor| self.weight(tensor)).collect();
        let rank = match layer.kind {
            Kind::Dense { .. } | Kind::Flatten => 2,
            Kind::Activation | Kind::BatchNorm { .. } | Kind::Dropout { .. } => self.ranks[layer.from[0]],
            _ => 4,
        };
        let inputs: Vec<String> = layer.from.iter().map(|node| self.ranked(*node, rank)).collect();
        let input = inputs[0].clone();
        let mut all: Vec<&str> = vec![&input];
        all.extend(tensors.iter().map(String::as_str));
        let window = |kernel, stride, padding: &crate::network::Padding| {
            vec![
                ints("kernel_shape", kernel),
                ints("strides", stride),
                ints(
                    "pads",
                    &padding.amounts(layer.inputs[0], [kernel[0], kernel[1]], [stride[0], stride[1]]),
                ),
            ]
        };
        let value = match &layer.kind {
            Kind::Convolution {
                kernel,
                stride,
                padding,
                ..
            } => self.inner("Conv", &all, window(kernel, stride, padding)),
            Kind::DepthwiseConvolution {
                kernel,
                stride,
                padding,
                ..
            } => {
                let mut attributes = window(kernel, stride, padding);
                attributes.push(int("group", layer.output.channels as i64));
                self.inner("Conv", &all, attributes)
            }
            Kind::MaxPool {
                size,
                stride,
                padding,
            } => self.inner("MaxPool", &all, window(size, stride, padding)),
            Kind::AveragePool {
                size,
                stride,
                padding,
            } => self.inner("AveragePool", &all, window(size, stride, padding)),
            Kind::GlobalAveragePool => self.inner("GlobalAveragePool", &all, vec![]),
            Kind::Dense { .. } => self.inner("Gemm", &all, vec![int("transB", 1)]),
            Kind::Flatten | Kind::Activation | Kind::Dropout { .. } => input.clone(),
            Kind::BatchNorm { epsilon, .. } => {
                self.inner("BatchNormalization", &all, vec![float("epsilon", *epsilon)])
            }
            Kind::Upsample { factor } => {
                let factor = *factor as f32;
                let scales = self.constant(
                    &format!("{}.scales", layer.name),
                    &[4],
                    &[1.0, 1.0, factor, factor],
                );
                let modes = vec![
                    text("mode", "nearest"),
                    text("nearest_mode", "floor"),
                    text("coordinate_transformation_mode", "asymmetric"),
                ];
                self.inner("Resize", &[&input, "", &scales], modes)
            }
            Kind::Concatenate => {
                let all: Vec<&str> = inputs.iter().map(String::as_str).collect();
                self.inner("Concat", &all, vec![int("axis", 1)])
            }
            Kind::Add => inputs[1..].iter().fold(input.clone(), |sum, other| {
                self.inner("Add", &[&sum, other], vec![])
            }),
            Kind::ConvolutionalLstm {
                kernel,
                stride,
                padding,
                ..
            } => self.lstm(layer, &input, &tensors, window(kernel, stride, padding)),
        };
        let value = self.activation(layer.activation, &value);
        let value = self.on_grid(self.names.len(), value);
        self.names.push(value);
        self.ranks.push(rank);
    }

    fn activation(&mut self, activation: Activation, input: &str) -> String {
        match activation {
            Activation::Linear => input.to_owned(),
            Activation::Relu => self.inner("Relu", &[input], vec![]),
            Activation::LeakyRelu(slope) => self.inner("LeakyRelu", &[input], vec![float("alpha", slope)]),
            Activation::Relu6 => {
                self.spare += 1;
                let low = self.constant(&format!("zero.{}", self.spare), &[], &[0.0]);
                let high = self.constant(&format!("six.{}", self.spare), &[], &[6.0]);
                self.inner("Clip", &[input, &low, &high], vec![])
            }
            Activation::Elu => self.inner("Elu", &[input], vec![float("alpha", 1.0)]),
            Activation::Sigmoid => self.inner("Sigmoid", &[input], vec![]),
            Activation::Tanh => self.inner("Tanh", &[input], vec![]),
        }
    }

    fn lstm(
        &mut self,
        layer: &Layer,
        input: &str,
        tensors: &[String],
        attributes: Vec<AttributeProto>,
    ) -> String {
        let [weight, recurrent, bias] = tensors else {
            return input.to_owned();
        };
        let Kind::ConvolutionalLstm { filters, kernel, .. } = layer.kind else {
            return input.to_owned();
        };
        let state = image_dimensions(layer.output);
        let port = |what: &str| format!("{}.{what}", layer.name);
        for name in ["h_in", "c_in"] {
            self.graph.input.push(value(&port(name), &state));
        }
        for name in ["h_out", "c_out"] {
            self.graph.output.push(value(&port(name), &state));
        }
        let pads = crate::network::Padding::Same.amounts(layer.output, kernel, [1, 1]);
        let own = vec![ints("kernel_shape", &kernel), ints("pads", &pads)];
        let from_input = self.inner("Conv", &[input, weight, bias], attributes);
        let from_state = self.inner("Conv", &[&port("h_in"), recurrent], own);
        let gates = self.inner("Add", &[&from_input, &from_state], vec![]);
        let sizes = self.whole_constant(&port("gates"), &[filters as i64; 4]);
        let names: Vec<String> = ["i", "f", "g", "o"].iter().map(|gate| port(gate)).collect();
        self.graph.node.push(NodeProto {
            input: vec![gates, sizes],
            output: names.clone(),
            name: port("split"),
            op_type: "Split".to_owned(),
            attribute: vec![int("axis", 1)],
            domain: String::new(),
        });
        let sigmoid = |writer: &mut Self, name: &str| writer.inner("Sigmoid", &[name], vec![]);
        let (i, f, o) = (
            sigmoid(self, &names[0]),
            sigmoid(self, &names[1]),
            sigmoid(self, &names[3]),
        );
        let g = self.inner("Tanh", &[&names[2]], vec![]);
        let kept = self.inner("Mul", &[&f, &port("c_in")], vec![]);
        let new = self.inner("Mul", &[&i, &g], vec![]);
        self.node("Add", &[&kept, &new], &port("c_out"), vec![]);
        let shown = self.inner("Tanh", &[&port("c_out")], vec![]);
        self.node("Mul", &[&o, &shown], &port("h_out"), vec![]);
        port("h_out")
    }
}
