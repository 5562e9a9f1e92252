//! `.weights` files: a short header, then every convolution's values.

use super::DarknetError;
use crate::network::{Kind, Layer, Network, Tensor};
use crate::weights::Weights;

/// Values of a `.weights` file for one network.
#[derive(Debug, Clone, PartialEq)]
pub struct DarknetWeights {
    /// The network's weights.
    pub weights: Weights,
    /// Pictures that darknet had trained on.
    pub seen: u64,
    /// Convolutions that were read.
    pub convolutions: usize,
}

/// One convolution's tensors in the file's order: biases, [scales, means, variances], weights.
struct Block<'a> {
    name: &'a str,
    tensors: Vec<&'a Tensor>,
}

fn blocks(network: &Network) -> Result<Vec<Block<'_>>, DarknetError> {
    let layers = network.layers();
    let mut blocks = Vec::new();
    let mut norms = vec![false; layers.len()];
    for (index, layer) in layers.iter().enumerate() {
        let foreign = |found: &str| DarknetError::Foreign {
            layer: layer.name.clone(),
            found: found.to_owned(),
        };
        let tensor = |layer: &'_ Layer, suffix: &str| -> Option<usize> {
            layer
                .tensors
                .iter()
                .position(|tensor| tensor.name.ends_with(suffix))
        };
        match layer.kind {
            Kind::Convolution { bias: true, .. } => {
                let (Some(weight), Some(bias)) = (tensor(layer, ".weight"), tensor(layer, ".bias")) else {
                    continue;
                };
                blocks.push(Block {
                    name: &layer.name,
                    tensors: vec![&layer.tensors[bias], &layer.tensors[weight]],
                });
            }
            Kind::Convolution { bias: false, .. } => {
                let follower = layers.iter().position(|other| other.from == [index + 1]);
                let Some(norm) = follower.filter(|at| matches!(layers[*at].kind, Kind::BatchNorm { .. }))
                else {
                    return Err(foreign("a convolution with neither bias nor batch norm"));
                };
                norms[norm] = true;
                let mut tensors = Vec::new();
                for suffix in [".bias", ".weight", ".running_mean", ".running_var"] {
                    tensors.extend(tensor(&layers[norm], suffix).map(|at| &layers[norm].tensors[at]));
                }
                tensors.extend(&layer.tensors);
                blocks.push(Block {
                    name: &layer.name,
                    tensors,
                });
            }
            Kind::BatchNorm { .. } if norms[index] => {}
            _ if layer.tensors.is_empty() => {}
            _ => return Err(foreign(layer.kind.name())),
        }
    }
    Ok(blocks)
}

fn word(bytes: &[u8]) -> u32 {
    u32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]])
}

impl DarknetWeights {
    /// Reads a `.weights` file's bytes; `file` is for messages. With `initial`, a file may end after any convolution (darknet's
    /// `partial` files, such as `yolov3-tiny.conv.15`), and no more than `most` convolutions are taken: the others keep
    /// their initial values. Without it the file must fit exactly.
    ///
    /// # Errors
    /// When the file is cut short, too long, or holds values that are no numbers.
    pub fn from_bytes(
        file: &str,
        bytes: &[u8],
        network: &Network,
        initial: Option<(&Weights, usize)>,
    ) -> Result<Self, DarknetError> {
        let wrong = |expected: String, found: String, help: &str| DarknetError::Weights {
            file: file.to_owned(),
            expected,
            found,
            help: help.to_owned(),
        };
        let cut = "copy or download it again";
        if bytes.len() < 16 {
            let found = format!("{} bytes", bytes.len());
            return Err(wrong("darknet weights".into(), found, cut));
        }
        let (major, minor) = (word(bytes), word(&bytes[4..]));
        if major > 1_000 || minor > 1_000 {
            let found = format!("version {major}.{minor}");
            return Err(wrong(
                "darknet weights of a version below 1000".into(),
                found,
                "is it another kind of file?",
            ));
        }
        let (seen, start) = if major * 10 + minor >= 2 {
            if bytes.len() < 20 {
                let found = format!("{} bytes", bytes.len());
                return Err(wrong("a header of 20 bytes".into(), found, cut));
            }
            (
                u64::from(word(&bytes[12..])) | u64::from(word(&bytes[16..])) << 32,
                20,
            )
        } else {
            (u64::from(word(&bytes[12..])), 16)
        };
        let blocks = blocks(network)?;
        let mut rest = &bytes[start..];
        let most = initial.map_or(usize::MAX, |(_, most)| most);
        let mut weights = match initial {
            Some((weights, _)) => weights.clone(),
            None => Weights {
                values: vec![0.0; network.parameter_count()],
            },
        };
        let mut convolutions = 0;
        for block in blocks.iter().take(most) {
            if rest.is_empty() && initial.is_some() {
                break;
            }
            for tensor in &block.tensors {
                let Some((own, after)) = rest.split_at_checked(4 * tensor.len()) else {
                    let expected = format!(
                        "{} more values for {:?} of {:?}",
                        tensor.len(),
                        tensor.name,
                        block.name
                    );
                    let help = "it was cut short or belongs to another network (number of classes?)";
                    return Err(wrong(expected, format!("{} bytes", rest.len()), help));
                };
                rest = after;
                let values = &mut weights.values[tensor.range()];
                for (value, bytes) in values.iter_mut().zip(own.chunks_exact(4)) {
                    *value = f32::from_bits(word(bytes));
                }
                if values.iter().any(|value| !value.is_finite()) {
                    let found = format!("values in {:?} that are none", tensor.name);
                    return Err(wrong(
                        "finite numbers".into(),
                        found,
                        "it is damaged or belongs to another network",
                    ));
                }
            }
            convolutions += 1;
        }
        let is_whole = initial.is_none() || most >= blocks.len();
        if is_whole && !rest.is_empty() {
            let expected = format!("{} bytes for this network", bytes.len() - rest.len());
            let found = format!("{} more", rest.len());
            return Err(wrong(
                expected,
                found,
                "it belongs to another network (number of classes?)",
            ));
        }
        // A variance below zero has no root.
        for layer in network.layers() {
            for tensor in layer
                .tensors
                .iter()
                .filter(|tensor| tensor.name.ends_with(".running_var"))
            {
                if weights.values[tensor.range()]
                    .iter()
                    .any(|variance| *variance < 0.0)
                {
                    let found = format!("one below 0 in {:?}", tensor.name);
                    return Err(wrong(
                        "variances".into(),
                        found,
                        "it is damaged or belongs to another network",
                    ));
                }
            }
        }
        Ok(Self {
            weights,
            seen,
            convolutions,
        })
    }

    /// The file's bytes, of version 0.2.0.
    ///
    /// # Errors
    /// When the network has layers with weights that darknet's files cannot hold.
    pub fn to_bytes(&self, network: &Network) -> Result<Vec<u8>, DarknetError> {
        let mut bytes = Vec::with_capacity(20 + 4 * self.weights.values.len());
        for number in [0u32, 2, 0] {
            bytes.extend_from_slice(&number.to_le_bytes());
        }
        bytes.extend_from_slice(&self.seen.to_le_bytes());
        for block in blocks(network)? {
            for tensor in block.tensors {
                for value in &self.weights.values[tensor.range()] {
                    bytes.extend_from_slice(&value.to_le_bytes());
                }
            }
        }
        Ok(bytes)
    }
}
