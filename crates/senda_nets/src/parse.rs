//! From TOML to a checked list of layers.

use crate::error::{NetworkError, nearest_names};
use crate::input::{Colour, LARGEST_STACK};
use crate::network::{Activation, Kind, Layer, Network, Padding, Parts, Shape, Tensor};
use senda_toml::WordOrNumbers;
use std::sync::Arc;

const KINDS: &[&str] = &[
    "convolution",
    "depthwise_convolution",
    "max_pool",
    "average_pool",
    "global_average_pool",
    "dense",
    "flatten",
    "activation",
    "batch_norm",
    "dropout",
    "upsample",
    "concatenate",
    "add",
    "convolutional_lstm",
];

const COLOURS: &[&str] = &["rgb", "grey", "saturation"];

const ACTIVATIONS: &[&str] = &["linear", "relu", "leaky_relu", "relu6", "elu", "sigmoid", "tanh"];

/// Limits that keep a hostile file from asking for all memory: guesses, far above any network for a small vehicle.
const MOST_LAYERS: usize = 2_000;
const LARGEST_SIZE: usize = 4_096;
const MOST_VALUES: usize = 1 << 26;
const LARGEST_KERNEL: usize = 64;

type Source<'a> = senda_toml::Source<'a, NetworkError>;
type Table<'a> = senda_toml::Table<'a, NetworkError>;

pub(crate) fn parse(source_name: &str, toml: &str) -> Result<Network, NetworkError> {
    let source = Source::new(source_name, toml);
    let mut file = source.table()?;
    let stem = std::path::Path::new(source_name)
        .file_stem()
        .map_or("network".into(), |stem| stem.to_string_lossy().into_owned());
    let name = file.optional_string("name")?.unwrap_or(stem);
    let description = file.optional_string("description")?.unwrap_or_default();
    let mut table = file.required_table("input")?;
    let input = Shape {
        height: table.required_whole("height", 1, LARGEST_SIZE)?,
        width: table.required_whole("width", 1, LARGEST_SIZE)?,
        channels: table.required_whole("channels", 1, LARGEST_SIZE)?,
    };
    let colour = table.optional_word("colour", COLOURS)?.and_then(Colour::named);
    let stack = table.optional_whole("stack", 1, LARGEST_STACK)?.unwrap_or(1);
    if let Some(colour) = colour
        && colour.channels() * stack != input.channels
    {
        return Err(table.problem(
            "channels",
            format!(
                "{}: {stack} frames of {}",
                colour.channels() * stack,
                colour.channels()
            ),
            input.channels.to_string(),
            "",
        ));
    }
    if !input.channels.is_multiple_of(stack) {
        return Err(table.problem(
            "stack",
            format!("frames that share {} channels evenly", input.channels),
            stack.to_string(),
            "",
        ));
    }
    table.finish()?;
    if input.len() > MOST_VALUES {
        return Err(table.problem("", format!("at most {MOST_VALUES} values"), input.to_string(), ""));
    }
    let tables = file.tables("layer")?;
    file.finish()?;
    if tables.is_empty() {
        return Err(file.problem("layer", "at least one layer", "none", "write [[layer]]"));
    }
    if tables.len() > MOST_LAYERS {
        let found = tables.len().to_string();
        return Err(file.problem("layer", format!("at most {MOST_LAYERS} layers"), found, ""));
    }
    let mut builder = Builder {
        input,
        layers: Vec::with_capacity(tables.len()),
        offset: 0,
    };
    let headers: Vec<_> = tables.iter().map(Table::span).collect();
    for table in tables {
        builder.read(table)?;
    }
    for (index, layer) in builder.layers[..builder.layers.len() - 1].iter().enumerate() {
        if !builder.layers.iter().any(|user| user.from.contains(&(index + 1))) {
            return Err(source.problem(
                headers[index].clone(),
                format!("layer[{index}]"),
                "a layer that another one uses, or the last one",
                format!("{:?}, which nothing uses", layer.name),
                "name it in a later layer's from, or remove it",
            ));
        }
    }
    Ok(Network {
        parts: Arc::new(Parts {
            name,
            description,
            input,
            colour,
            stack,
            layers: builder.layers,
        }),
    })
}

struct Builder {
    input: Shape,
    layers: Vec<Layer>,
    offset: usize,
}

impl Builder {
    fn shape(&self, node: usize) -> Shape {
        match node.checked_sub(1) {
            None => self.input,
            Some(layer) => self.layers[layer].output,
        }
    }

    fn read(&mut self, mut table: Table) -> Result<(), NetworkError> {
        let Some(word) = table.optional_word("kind", KINDS)? else {
            return Err(table.missing("kind", &format!("one of {}", KINDS.join(", "))));
        };
        let name = self.read_name(&mut table, word)?;
        let from = self.read_from(&mut table, word)?;
        let kind = read_kind(&mut table, word)?;
        let activation = read_activation(&mut table, &kind)?;
        let is_trainable = table.bool("trainable", true)?;
        table.finish()?;
        let inputs: Vec<Shape> = from.iter().map(|node| self.shape(*node)).collect();
        let output = output_shape(&table, &kind, &inputs)?;
        let (tensors, multiply_adds) = self.weights_of(&kind, inputs[0], output, is_trainable);
        let total = tensors
            .iter()
            .try_fold(self.offset, |sum, (_, shape, _)| {
                shape
                    .iter()
                    .try_fold(1usize, |product, size| product.checked_mul(*size))
                    .and_then(|len| sum.checked_add(len))
            })
            .filter(|total| *total <= MOST_VALUES);
        if total.is_none() {
            return Err(table.problem("", format!("at most {MOST_VALUES} weights"), "more", ""));
        }
        let mut layer = Layer {
            name,
            kind,
            activation,
            is_trainable,
            from,
            inputs,
            output,
            tensors: Vec::with_capacity(tensors.len()),
            multiply_adds,
        };
        for (suffix, shape, is_trainable) in tensors {
            let tensor = Tensor {
                name: format!("{}.{suffix}", layer.name),
                shape,
                offset: self.offset,
                is_trainable,
            };
            self.offset += tensor.len();
            layer.tensors.push(tensor);
        }
        self.layers.push(layer);
        Ok(())
    }

    fn read_name(&self, table: &mut Table, word: &str) -> Result<String, NetworkError> {
        let is_taken = |name: &str| name == "input" || self.layers.iter().any(|layer| layer.name == name);
        match table.optional_string("name")? {
            Some(name) if is_taken(&name) || name.is_empty() => {
                Err(table.problem("name", "a name that no other layer has", format!("{name:?}"), ""))
            }
            Some(name) => Ok(name),
            // The position makes it unique unless the file itself uses such a name.
            None => {
                let mut name = format!("{word}_{}", self.layers.len() + 1);
                while is_taken(&name) {
                    name.push('_');
                }
                Ok(name)
            }
        }
    }

    fn read_from(&self, table: &mut Table, word: &str) -> Result<Vec<usize>, NetworkError> {
        let several = matches!(word, "concatenate" | "add");
        let Some(names) = table.optional_strings("from")? else {
            if several {
                return Err(table.missing("from", "an array of layer names"));
            }
            return Ok(vec![self.layers.len()]);
        };
        let expected = if several { 2..=64 } else { 1..=1 };
        if !expected.contains(&names.len()) {
            return Err(table.problem(
                "from",
                if several {
                    "two or more layer names"
                } else {
                    "one layer name"
                },
                format!("{} names", names.len()),
                "",
            ));
        }
        let mut nodes = Vec::with_capacity(names.len());
        for name in names {
            let position = self.layers.iter().position(|layer| layer.name == name);
            match position {
                Some(layer) => nodes.push(layer + 1),
                None if name == "input" => nodes.push(0),
                None => {
                    let mut known = vec!["input"];
                    known.extend(self.layers.iter().map(|layer| layer.name.as_str()));
                    let help = match nearest_names(&name, &known).first() {
                        Some(nearest) => format!("did you mean {nearest:?}?"),
                        None => format!("known here: {}", known.join(", ")),
                    };
                    return Err(table.problem(
                        "from",
                        "\"input\" or the name of an earlier layer",
                        format!("{name:?}"),
                        help,
                    ));
                }
            }
        }
        Ok(nodes)
    }

    /// Names, shapes and trainability of a layer's weights, and its multiply-adds.
    #[allow(clippy::type_complexity, reason = "used once, a line below")]
    fn weights_of(
        &self,
        kind: &Kind,
        input: Shape,
        output: Shape,
        is_trainable: bool,
    ) -> (Vec<(&'static str, Vec<usize>, bool)>, u64) {
        let channels = input.channels;
        let mut tensors = Vec::new();
        let mut push = |name, shape: &[usize], moves: bool| {
            tensors.push((name, shape.to_vec(), moves && is_trainable));
        };
        let product = |sizes: &[usize]| {
            sizes
                .iter()
                .fold(1u64, |product, size| product.saturating_mul(*size as u64))
        };
        let multiply_adds = match *kind {
            Kind::Convolution {
                filters,
                kernel: [h, w],
                bias,
                ..
            } => {
                push("weight", &[filters, channels, h, w], true);
                if bias {
                    push("bias", &[filters], true);
                }
                product(&[output.plane(), filters, channels, h, w])
            }
            Kind::DepthwiseConvolution {
                kernel: [h, w], bias, ..
            } => {
                push("weight", &[channels, 1, h, w], true);
                if bias {
                    push("bias", &[channels], true);
                }
                product(&[output.plane(), channels, h, w])
            }
            Kind::Dense { units, bias } => {
                push("weight", &[units, channels], true);
                if bias {
                    push("bias", &[units], true);
                }
                product(&[units, channels])
            }
            Kind::BatchNorm { .. } => {
                push("weight", &[channels], true);
                push("bias", &[channels], true);
                push("running_mean", &[channels], false);
                push("running_var", &[channels], false);
                0
            }
            Kind::ConvolutionalLstm {
                filters,
                kernel: [h, w],
                ..
            } => {
                push("weight", &[4 * filters, channels, h, w], true);
                push("recurrent_weight", &[4 * filters, filters, h, w], true);
                push("bias", &[4 * filters], true);
                product(&[output.plane(), 4 * filters, channels + filters, h, w])
            }
            _ => 0,
        };
        (tensors, multiply_adds)
    }
}

fn optional_f32(
    table: &mut Table,
    key: &'static str,
    lowest: f64,
    highest: f64,
) -> Result<Option<f32>, NetworkError> {
    let number = table.optional_f64(key, lowest, highest)?;
    Ok(number.map(|number| number as f32))
}

fn read_padding(table: &mut Table) -> Result<Padding, NetworkError> {
    let expected = "\"valid\", \"same\", a whole number, or [top, left, bottom, right]";
    match table.optional_word_or_numbers("padding", &["valid", "same"], LARGEST_KERNEL, expected)? {
        None | Some(WordOrNumbers::Word("valid")) => Ok(Padding::Valid),
        Some(WordOrNumbers::Word(_)) => Ok(Padding::Same),
        Some(WordOrNumbers::Numbers(numbers)) => match numbers[..] {
            [all] => Ok(Padding::Explicit([all; 4])),
            [top, left, bottom, right] => Ok(Padding::Explicit([top, left, bottom, right])),
            _ => Err(table.problem("padding", expected, format!("{} numbers", numbers.len()), "")),
        },
    }
}

fn read_kind(table: &mut Table, word: &str) -> Result<Kind, NetworkError> {
    Ok(match word {
        "convolution" => Kind::Convolution {
            filters: table.required_whole("filters", 1, LARGEST_SIZE)?,
            kernel: table.required_pair("kernel", 1, LARGEST_KERNEL)?,
            stride: table
                .optional_pair("stride", 1, LARGEST_KERNEL)?
                .unwrap_or([1; 2]),
            padding: read_padding(table)?,
            bias: table.bool("bias", true)?,
        },
        "depthwise_convolution" => Kind::DepthwiseConvolution {
            kernel: table.required_pair("kernel", 1, LARGEST_KERNEL)?,
            stride: table
                .optional_pair("stride", 1, LARGEST_KERNEL)?
                .unwrap_or([1; 2]),
            padding: read_padding(table)?,
            bias: table.bool("bias", true)?,
        },
        "max_pool" | "average_pool" => {
            let size = table.required_pair("size", 1, LARGEST_KERNEL)?;
            let stride = table.optional_pair("stride", 1, LARGEST_KERNEL)?.unwrap_or(size);
            let padding = read_padding(table)?;
            if word == "max_pool" {
                Kind::MaxPool {
                    size,
                    stride,
                    padding,
                }
            } else {
                Kind::AveragePool {
                    size,
                    stride,
                    padding,
                }
            }
        }
        "global_average_pool" => Kind::GlobalAveragePool,
        "dense" => Kind::Dense {
            units: table.required_whole("units", 1, 1 << 20)?,
            bias: table.bool("bias", true)?,
        },
        "flatten" => Kind::Flatten,
        "activation" => Kind::Activation,
        "batch_norm" => Kind::BatchNorm {
            // Keras's defaults.
            epsilon: optional_f32(table, "epsilon", 1e-9, 1.0)?.unwrap_or(1e-3),
            momentum: optional_f32(table, "momentum", 0.0, 1.0)?.unwrap_or(0.99),
        },
        "dropout" => match optional_f32(table, "rate", 0.0, 0.99)? {
            Some(rate) => Kind::Dropout { rate },
            None => return Err(table.missing("rate", "a number from 0 to 0.99")),
        },
        "upsample" => Kind::Upsample {
            factor: table.required_whole("factor", 1, 16)?,
        },
        "concatenate" => Kind::Concatenate,
        "add" => Kind::Add,
        _ => Kind::ConvolutionalLstm {
            filters: table.required_whole("filters", 1, LARGEST_SIZE)?,
            kernel: table.required_pair("kernel", 1, LARGEST_KERNEL)?,
            stride: table
                .optional_pair("stride", 1, LARGEST_KERNEL)?
                .unwrap_or([1; 2]),
            padding: read_padding(table)?,
        },
    })
}

fn read_activation(table: &mut Table, kind: &Kind) -> Result<Activation, NetworkError> {
    // Elsewhere an activation would be ambiguous or undoes what the layer is for.
    let can_have_one = matches!(
        kind,
        Kind::Convolution { .. }
            | Kind::DepthwiseConvolution { .. }
            | Kind::Dense { .. }
            | Kind::Activation
            | Kind::BatchNorm { .. }
            | Kind::Add
    );
    if !can_have_one {
        return Ok(Activation::Linear);
    }
    let word = table.optional_word("activation", ACTIVATIONS)?;
    if word.is_none() && matches!(kind, Kind::Activation) {
        return Err(table.missing("activation", &format!("one of {}", ACTIVATIONS.join(", "))));
    }
    Ok(match word {
        None | Some("linear") => Activation::Linear,
        Some("relu") => Activation::Relu,
        Some("leaky_relu") => Activation::LeakyRelu(optional_f32(table, "slope", 0.0, 1.0)?.unwrap_or(0.1)),
        Some("relu6") => Activation::Relu6,
        Some("elu") => Activation::Elu,
        Some("sigmoid") => Activation::Sigmoid,
        Some(_) => Activation::Tanh,
    })
}

fn output_shape(table: &Table, kind: &Kind, inputs: &[Shape]) -> Result<Shape, NetworkError> {
    let input = inputs[0];
    let window = |kernel: [usize; 2], stride: [usize; 2], padding: &Padding, channels: usize, key: &str| {
        let [top, left, bottom, right] = padding.amounts(input, kernel, stride);
        let (height, width) = (input.height + top + bottom, input.width + left + right);
        if kernel[0] > height || kernel[1] > width {
            return Err(table.problem(
                key,
                format!("a window that fits into the input of {height}x{width}"),
                format!("{}x{}", kernel[0], kernel[1]),
                "use a smaller window, padding = \"same\", or fewer layers that shrink",
            ));
        }
        if top >= kernel[0] || left >= kernel[1] || bottom >= kernel[0] || right >= kernel[1] {
            return Err(table.problem(
                "padding",
                "less than the window",
                format!("[{top}, {left}, {bottom}, {right}]"),
                "",
            ));
        }
        Ok(Shape {
            channels,
            height: (height - kernel[0]) / stride[0] + 1,
            width: (width - kernel[1]) / stride[1] + 1,
        })
    };
    let shape = match kind {
        Kind::Convolution {
            filters,
            kernel,
            stride,
            padding,
            ..
        }
        | Kind::ConvolutionalLstm {
            filters,
            kernel,
            stride,
            padding,
        } => window(*kernel, *stride, padding, *filters, "kernel")?,
        Kind::DepthwiseConvolution {
            kernel,
            stride,
            padding,
            ..
        } => window(*kernel, *stride, padding, input.channels, "kernel")?,
        Kind::MaxPool {
            size,
            stride,
            padding,
        }
        | Kind::AveragePool {
            size,
            stride,
            padding,
        } => window(*size, *stride, padding, input.channels, "size")?,
        Kind::GlobalAveragePool => Shape::flat(input.channels),
        Kind::Dense { units, .. } => {
            if !input.is_flat() {
                return Err(table.problem(
                    "kind",
                    "a vector as input",
                    input.to_string(),
                    "put a layer of kind \"flatten\" before it",
                ));
            }
            Shape::flat(*units)
        }
        Kind::Flatten => Shape::flat(input.len()),
        Kind::Upsample { factor } => Shape {
            height: input.height * factor,
            width: input.width * factor,
            ..input
        },
        Kind::Concatenate => {
            if let Some(other) = inputs
                .iter()
                .find(|other| (other.height, other.width) != (input.height, input.width))
            {
                return Err(table.problem(
                    "from",
                    format!("the same height and width as {input}"),
                    other.to_string(),
                    "",
                ));
            }
            Shape {
                channels: inputs.iter().map(|shape| shape.channels).sum(),
                ..input
            }
        }
        Kind::Add => {
            if let Some(other) = inputs.iter().find(|other| **other != input) {
                return Err(table.problem("from", format!("the shape {input}"), other.to_string(), ""));
            }
            input
        }
        Kind::Activation | Kind::BatchNorm { .. } | Kind::Dropout { .. } => input,
    };
    let values = shape
        .channels
        .checked_mul(shape.height)
        .and_then(|product| product.checked_mul(shape.width));
    match values {
        Some(values) if values <= MOST_VALUES => Ok(shape),
        _ => Err(table.problem("", format!("at most {MOST_VALUES} values"), shape.to_string(), "")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const GOOD: &str = "[input]\nheight = 8\nwidth = 8\nchannels = 1\n[[layer]]\nkind = \"flatten\"\n[[layer]]\nkind = \"dense\"\nunits = 2\n";

    fn check(text: &str, expected: &str) {
        let error = parse("mine.toml", text).expect_err(text).to_string();
        assert!(error.contains(expected), "{error}\nlacks {expected}");
    }

    #[test]
    fn mistakes_are_shown_at_their_line_with_the_nearest_name() {
        assert_eq!(parse("nets/mine.toml", GOOD).unwrap().name(), "mine");
        check(
            &GOOD.replace("units", "unit"),
            "mine.toml:9: layer[1].unit: expected the key \"units\"",
        );
        check(
            &GOOD.replace("flatten", "flaten"),
            "mine.toml:6: layer[0].kind: expected one of",
        );
        check(&GOOD.replace("flatten", "flaten"), "did you mean \"flatten\"?");
        check(
            &GOOD.replace("units = 2", "units = -2"),
            "expected a whole number from 1",
        );
        check(
            &GOOD.replace("units = 2", "units = 2\nactivation = \"elo\""),
            "did you mean \"elu\"?",
        );
        check(
            &GOOD.replace("units = 2", "units = 2\nslope = 1"),
            "the unknown key \"slope\"",
        );
        check(&GOOD.replace("width", "widht"), "mine.toml:3: input.widht");
        check(
            "[input]\nheight = 8\nwidth = 8\nchannels = 1",
            "at least one layer",
        );
        check("", "expected a table [input]");
        check("a = ", "expected TOML");
    }

    #[test]
    fn shapes_that_do_not_fit_are_refused() {
        let with = |layers: &str| {
            let mut text = "[input]\nheight = 8\nwidth = 9\nchannels = 1\n".to_owned();
            for layer in layers.split(';') {
                text += &format!("[[layer]]\n{}\n", layer.replace(',', "\n"));
            }
            text
        };
        check(
            &with("kind = \"dense\",units = 1"),
            "expected a vector as input, but found 8x9x1",
        );
        check(
            &with("kind = \"convolution\",filters = 2,kernel = 9"),
            "mine.toml:8: layer[0].kernel: expected a window that fits into the input of 8x9, but found 9x9",
        );
        check(
            &with("kind = \"max_pool\",size = 2,padding = 2"),
            "less than the window",
        );
        check(&with("kind = \"dropout\",rate = 1.5"), "a number from 0 to 0.99");
        let two = "name = \"a\",kind = \"max_pool\",size = 2;name = \"b\",kind = \"flatten\";kind = \"add\",from = [\"a\" \"b\"]";
        let two = with(two).replace("\"a\" \"b\"", "\"a\", \"b\"");
        check(&two, "expected the shape 4x4x1, but found 16");
        check(
            &two.replace("\"a\", \"b\"", "\"aa\", \"b\""),
            "did you mean \"a\"?",
        );
        check(&two.replace("add", "concatenate"), "the same height and width");
        check(
            &with("name = \"a\",kind = \"flatten\";name = \"a\",kind = \"flatten\""),
            "a name that no other layer has",
        );
        check(
            &with("name = \"a\",kind = \"flatten\";kind = \"flatten\",from = \"input\""),
            "mine.toml:5: layer[0]: expected a layer that another one uses",
        );
        check(
            &with("kind = \"flatten\";kind = \"dense\",units = 1000000;kind = \"dense\",units = 1000000"),
            "weights",
        );
    }

    proptest! {
        #[test]
        fn no_text_makes_the_reader_panic(at in 0usize..2000, what in "[\\[\\]a-z=0-9\" .\n-]{0,6}") {
            let text = include_str!("../../../networks/deeperlstm-tinypilotnet.toml");
            let at = at.min(text.len());
            let _ = parse("x", &format!("{}{what}{}", &text[..at], &text[(at + what.len()).min(text.len())..]));
        }
    }
}
