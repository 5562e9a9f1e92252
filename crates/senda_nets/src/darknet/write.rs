//! Writing `.cfg` files.

use super::{Darknet, DarknetError};
use crate::network::{Activation, Kind, Layer, Padding};
use std::fmt::Write;

impl Darknet {
    /// The network as a `.cfg` file's text.
    ///
    /// # Errors
    /// When a layer is not one of darknet's, is named.
    pub fn to_cfg(&self) -> Result<String, DarknetError> {
        let layers = self.network.layers();
        let input = self.network.input();
        let mut out = format!(
            "[net]\nwidth={}\nheight={}\nchannels={}\n",
            input.width, input.height, input.channels
        );
        // Number of the section that gives each node's value; the input has none.
        let mut sections: Vec<Option<usize>> = vec![None];
        let mut count = 0;
        let mut heads = self.detection.heads.iter();
        let all: Vec<[f32; 2]> = self
            .detection
            .heads
            .iter()
            .flat_map(|head| head.anchors_px.clone())
            .collect();
        let mut first_anchor = 0;
        for (index, layer) in layers.iter().enumerate() {
            let foreign = |found: String| DarknetError::Foreign {
                layer: layer.name.clone(),
                found,
            };
            let is_last = index + 1 == layers.len();
            if is_last && layer.kind == Kind::Concatenate && layer.output.is_flat() {
                // The heads side by side: darknet keeps them apart.
                break;
            }
            let norm = norm_after(layers, index);
            if let Kind::BatchNorm { .. } = layer.kind {
                let is_partner =
                    index > 0 && layer.from == [index] && norm_after(layers, index - 1) == Some(index);
                if !is_partner {
                    return Err(foreign(
                        "a batch norm that does not follow a convolution without bias".into(),
                    ));
                }
                sections.push(sections[index]);
                continue;
            }
            let from = sections[layer.from[0]];
            let several = matches!(layer.kind, Kind::Concatenate | Kind::Add);
            if !several && from.map_or(count > 0, |from| from + 1 != count) {
                let Some(from) = from else {
                    return Err(foreign(
                        "the input as its source, which only the first layer can have".into(),
                    ));
                };
                let _ = write!(out, "\n[route]\nlayers={from}\n");
                count += 1;
            }
            match &layer.kind {
                Kind::Convolution { .. } => convolution(&mut out, layer, norm.map(|at| &layers[at]))?,
                Kind::MaxPool {
                    size: [size, wide],
                    stride: [stride, other],
                    padding,
                } if size == wide && stride == other => {
                    let [top, left, bottom, right] =
                        padding.amounts(layer.inputs[0], [*size; 2], [*stride; 2]);
                    let shape = layer.inputs[0];
                    // The reader leaves out what no window reaches; any padding that gives this output will do.
                    let fits = |padding: &usize| {
                        let along = |length: usize, output: usize| {
                            (length + padding)
                                .checked_sub(*size)
                                .map(|left| left / stride + 1)
                                == Some(output)
                        };
                        padding / 2 == top
                            && padding / 2 == left
                            && along(shape.height, layer.output.height)
                            && along(shape.width, layer.output.width)
                            && bottom.max(right) <= padding - padding / 2
                    };
                    let Some(padding) = std::iter::once(size - 1).chain(0..2 * size - 1).find(fits) else {
                        return Err(foreign(format!("padding {:?}", [top, left, bottom, right])));
                    };
                    let _ = write!(out, "\n[maxpool]\nsize={size}\nstride={stride}\n");
                    if padding != size - 1 {
                        let _ = writeln!(out, "padding={padding}");
                    }
                }
                Kind::GlobalAveragePool => out.push_str("\n[avgpool]\n"),
                Kind::Upsample { factor } => {
                    let _ = write!(out, "\n[upsample]\nstride={factor}\n");
                }
                Kind::Dropout { rate } => {
                    let _ = write!(out, "\n[dropout]\nprobability={rate}\n");
                }
                Kind::Concatenate | Kind::Add => {
                    let from: Option<Vec<usize>> = layer.from.iter().map(|node| sections[*node]).collect();
                    let Some(from) = from else {
                        return Err(foreign("the input among its sources".into()));
                    };
                    if layer.kind == Kind::Concatenate {
                        let names: Vec<String> = from.iter().map(ToString::to_string).collect();
                        let _ = write!(out, "\n[route]\nlayers={}\n", names.join(","));
                    } else {
                        let [one, other] = from[..] else {
                            return Err(foreign(format!("a sum of {} layers", from.len())));
                        };
                        if one + 1 != count {
                            let _ = write!(out, "\n[route]\nlayers={one}\n");
                            count += 1;
                        }
                        let _ = write!(
                            out,
                            "\n[shortcut]\nfrom={other}\nactivation={}\n",
                            activation(layer)?
                        );
                    }
                }
                Kind::Flatten => {
                    let Some(head) = heads.next() else {
                        return Err(foreign("a vector that is no head".into()));
                    };
                    let mask: Vec<String> = (first_anchor..first_anchor + head.anchors_px.len())
                        .map(|i| i.to_string())
                        .collect();
                    first_anchor += head.anchors_px.len();
                    let anchors: Vec<String> = all
                        .iter()
                        .map(|[width, height]| format!("{width},{height}"))
                        .collect();
                    let _ = write!(
                        out,
                        "\n[yolo]\nmask={}\nanchors={}\nclasses={}\nnum={}\nignore_thresh=.7\ntruth_thresh=1\nrandom=0\njitter=.3\n",
                        mask.join(","),
                        anchors.join(", "),
                        self.detection.classes.len(),
                        all.len()
                    );
                }
                other => return Err(foreign(other.name().to_owned())),
            }
            // What follows a head goes back to what came before it.
            sections.push(if layer.kind == Kind::Flatten {
                from
            } else {
                Some(count)
            });
            count += 1;
        }
        Ok(out)
    }
}

fn norm_after(layers: &[Layer], index: usize) -> Option<usize> {
    let bare = matches!(layers[index].kind, Kind::Convolution { bias: false, .. })
        && layers[index].activation == Activation::Linear;
    let next = layers.get(index + 1)?;
    let is_norm = matches!(next.kind, Kind::BatchNorm { .. }) && next.from == [index + 1];
    (bare && is_norm).then_some(index + 1)
}

fn activation(layer: &Layer) -> Result<&'static str, DarknetError> {
    Ok(match layer.activation {
        Activation::Linear => "linear",
        Activation::LeakyRelu(0.1) => "leaky",
        Activation::LeakyRelu(slope) => {
            return Err(DarknetError::Foreign {
                layer: layer.name.clone(),
                found: format!("a leaky_relu with slope {slope} (darknet's is 0.1)"),
            });
        }
        Activation::Relu => "relu",
        Activation::Relu6 => "relu6",
        Activation::Elu => "elu",
        Activation::Sigmoid => "logistic",
        Activation::Tanh => "tanh",
    })
}

fn convolution(out: &mut String, layer: &Layer, norm: Option<&Layer>) -> Result<(), DarknetError> {
    let foreign = |found: &str| DarknetError::Foreign {
        layer: layer.name.clone(),
        found: found.to_owned(),
    };
    let Kind::Convolution {
        filters,
        kernel,
        stride,
        padding,
        bias,
    } = &layer.kind
    else {
        return Ok(());
    };
    if kernel[0] != kernel[1] || stride[0] != stride[1] {
        return Err(foreign("a window that is no square"));
    }
    if !bias && norm.is_none() {
        return Err(foreign("a convolution with neither bias nor batch norm"));
    }
    if let Some(Kind::BatchNorm { epsilon, .. }) = norm.map(|norm| &norm.kind)
        && (epsilon - 1e-5).abs() > 1e-8
    {
        return Err(foreign("a batch norm whose epsilon is not darknet's 1e-5"));
    }
    let pads = match padding {
        Padding::Valid => [0; 4],
        other => other.amounts(layer.inputs[0], *kernel, *stride),
    };
    if pads.iter().any(|pad| *pad != pads[0]) {
        return Err(foreign("padding that differs from side to side"));
    }
    out.push_str("\n[convolutional]\n");
    if norm.is_some() {
        out.push_str("batch_normalize=1\n");
    }
    let _ = write!(
        out,
        "filters={filters}\nsize={}\nstride={}\n",
        kernel[0], stride[0]
    );
    if pads[0] == kernel[0] / 2 {
        out.push_str("pad=1\n");
    } else {
        let _ = writeln!(out, "padding={}", pads[0]);
    }
    let _ = writeln!(out, "activation={}", activation(norm.unwrap_or(layer))?);
    Ok(())
}
