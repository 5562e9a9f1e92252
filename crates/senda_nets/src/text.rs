//! Writing a network so that reading it gives the same network back.

use crate::network::{Activation, Kind, Layer, Network, Padding};
use std::fmt::Write;

impl Network {
    /// The resolved network file: every name, default and source written out. `parse(to_toml()) == self`.
    pub fn to_toml(&self) -> String {
        let mut out = String::new();
        // Writing to a String cannot fail; the results are dropped throughout.
        let _ = writeln!(out, "name = {}", quoted(self.name()));
        let _ = writeln!(out, "description = {}", quoted(self.description()));
        let input = self.input();
        let _ = writeln!(
            out,
            "\n[input]\nheight = {}\nwidth = {}\nchannels = {}",
            input.height, input.width, input.channels
        );
        if let Some(colour) = self.colour() {
            let _ = writeln!(out, "colour = {}", quoted(colour.name()));
        }
        if self.stack() > 1 {
            let _ = writeln!(out, "stack = {}", self.stack());
        }
        for (index, layer) in self.layers().iter().enumerate() {
            let _ = writeln!(
                out,
                "\n[[layer]]\nname = {}\nkind = {}",
                quoted(&layer.name),
                quoted(layer.kind.name())
            );
            self.write_from(&mut out, index, layer);
            write_kind(&mut out, &layer.kind);
            write_activation(&mut out, layer);
            if !layer.is_trainable {
                let _ = writeln!(out, "trainable = false");
            }
        }
        out
    }

    fn write_from(&self, out: &mut String, index: usize, layer: &Layer) {
        let name = |node: usize| match node.checked_sub(1) {
            None => "\"input\"".to_owned(),
            Some(layer) => quoted(&self.layers()[layer].name),
        };
        match layer.from[..] {
            [node] if node == index => {}
            [node] => {
                let _ = writeln!(out, "from = {}", name(node));
            }
            _ => {
                let names: Vec<String> = layer.from.iter().map(|node| name(*node)).collect();
                let _ = writeln!(out, "from = [{}]", names.join(", "));
            }
        }
    }
}

fn write_kind(out: &mut String, kind: &Kind) {
    match kind {
        Kind::Convolution {
            filters,
            kernel,
            stride,
            padding,
            bias,
        } => {
            let _ = writeln!(out, "filters = {filters}");
            window(out, "kernel", *kernel, *stride, *padding);
            let _ = writeln!(out, "bias = {bias}");
        }
        Kind::DepthwiseConvolution {
            kernel,
            stride,
            padding,
            bias,
        } => {
            window(out, "kernel", *kernel, *stride, *padding);
            let _ = writeln!(out, "bias = {bias}");
        }
        Kind::MaxPool {
            size,
            stride,
            padding,
        }
        | Kind::AveragePool {
            size,
            stride,
            padding,
        } => {
            window(out, "size", *size, *stride, *padding);
        }
        Kind::Dense { units, bias } => {
            let _ = writeln!(out, "units = {units}\nbias = {bias}");
        }
        Kind::BatchNorm { epsilon, momentum } => {
            let _ = writeln!(out, "epsilon = {epsilon:?}\nmomentum = {momentum:?}");
        }
        Kind::Dropout { rate } => {
            let _ = writeln!(out, "rate = {rate:?}");
        }
        Kind::Upsample { factor } => {
            let _ = writeln!(out, "factor = {factor}");
        }
        Kind::ConvolutionalLstm {
            filters,
            kernel,
            stride,
            padding,
        } => {
            let _ = writeln!(out, "filters = {filters}");
            window(out, "kernel", *kernel, *stride, *padding);
        }
        Kind::GlobalAveragePool | Kind::Flatten | Kind::Activation | Kind::Concatenate | Kind::Add => {}
    }
}

fn window(out: &mut String, key: &str, size: [usize; 2], stride: [usize; 2], padding: Padding) {
    let _ = writeln!(out, "{key} = {size:?}\nstride = {stride:?}");
    let _ = match padding {
        Padding::Valid => writeln!(out, "padding = \"valid\""),
        Padding::Same => writeln!(out, "padding = \"same\""),
        Padding::Explicit(amounts) => writeln!(out, "padding = {amounts:?}"),
    };
}

fn write_activation(out: &mut String, layer: &Layer) {
    let word = match layer.activation {
        Activation::Linear => "linear",
        Activation::Relu => "relu",
        Activation::LeakyRelu(slope) => {
            let _ = writeln!(out, "slope = {slope:?}");
            "leaky_relu"
        }
        Activation::Relu6 => "relu6",
        Activation::Elu => "elu",
        Activation::Sigmoid => "sigmoid",
        Activation::Tanh => "tanh",
    };
    if word != "linear" || layer.kind == Kind::Activation {
        let _ = writeln!(out, "activation = \"{word}\"");
    }
}

/// Text in quotes with everything escaped that TOML asks for.
pub(crate) fn quoted(text: &str) -> String {
    let mut out = String::with_capacity(text.len() + 2);
    out.push('"');
    for c in text.chars() {
        match c {
            '"' => out.push_str("\\\""),
            '\\' => out.push_str("\\\\"),
            '\n' => out.push_str("\\n"),
            c if c.is_control() => {
                let _ = write!(out, "\\u{:04X}", c as u32);
            }
            c => out.push(c),
        }
    }
    out.push('"');
    out
}
