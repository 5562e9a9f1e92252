//! Weights that somebody else trained, for the layers that fit.

use crate::model::ModelError;
use crate::network::{Kind, Layer, Network};
use crate::onnx::{Imported, OnnxError};
use crate::safetensors::{split, tensor_values};
use crate::weights::Weights;
use senda_core::bounded_file;
use std::path::Path;
use thiserror::Error;

/// Why foreign weights could not be adopted.
#[derive(Debug, Error)]
pub enum AdoptError {
    /// The file could not be read.
    #[error(transparent)]
    File(#[from] ModelError),
    /// The ONNX file could not be taken in.
    #[error(transparent)]
    Onnx(#[from] OnnxError),
    /// Nothing in it fits.
    #[error(
        "{file}: expected weights for layers of {network}, but {problem}; for MobileNetV2 save torchvision's: \
         safetensors.torch.save_file(torchvision.models.mobilenet_v2(weights=\"DEFAULT\").state_dict(), \
         \"mobilenetv2.safetensors\"), or export that network with torch.onnx.export"
    )]
    Unfit {
        /// Path or other source.
        file: String,
        /// Name of the network.
        network: String,
        /// What was found.
        problem: String,
    },
}

/// What was adopted.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Adopted {
    /// Tensors that were filled.
    pub filled: Vec<String>,
    /// Tensors that keep what they had.
    pub kept: Vec<String>,
}

impl Weights {
    /// Takes weights from a safetensors file (tensors of the same names; PyTorch's and torchvision's fit the ready networks)
    /// or an ONNX file (layers in the same order), for the layers that they have in common. The others keep their weights.
    ///
    /// # Errors
    /// When the file cannot be read, a tensor has another shape, or nothing fits. Nothing is changed then.
    pub fn adopt(&mut self, network: &Network, path: &Path) -> Result<Adopted, AdoptError> {
        let file = path.display().to_string();
        let unfit = |problem: String| AdoptError::Unfit {
            file: file.clone(),
            network: network.name().to_owned(),
            problem,
        };
        let bytes = bounded_file::read(path, bounded_file::GIBIBYTE).map_err(|error| ModelError::File {
            file: file.clone(),
            reason: error.to_string(),
        })?;
        let mut changed = self.clone();
        let filled = if path.extension().is_some_and(|extension| extension == "onnx") {
            changed.adopt_layers(network, &Imported::from_bytes(&file, &bytes)?)
        } else {
            changed.adopt_tensors(network, &bytes)
        }
        .map_err(unfit)?;
        if filled.is_empty() {
            return Err(unfit(
                "none of its tensors has the name of one of them".to_owned(),
            ));
        }
        *self = changed;
        let kept = network
            .tensors()
            .map(|tensor| tensor.name.clone())
            .filter(|name| !filled.contains(name))
            .collect();
        Ok(Adopted { filled, kept })
    }

    fn adopt_tensors(&mut self, network: &Network, bytes: &[u8]) -> Result<Vec<String>, String> {
        let (header, data) = split(bytes)?;
        let mut filled = Vec::new();
        for tensor in network
            .tensors()
            .filter(|tensor| header.contains_key(&tensor.name))
        {
            let values = tensor_values(&header, data, &tensor.name, &tensor.shape)?;
            for (to, from) in self.values[tensor.range()].iter_mut().zip(values) {
                *to = from;
            }
            filled.push(tensor.name.clone());
        }
        Ok(filled)
    }

    /// Convolutions in order, each with the batch norm behind it if there is one; until the first that does not fit.
    fn adopt_layers(&mut self, network: &Network, other: &Imported) -> Result<Vec<String>, String> {
        let (own, theirs) = (units(network), units(&other.network));
        let mut filled = Vec::new();
        for (own, theirs) in own.iter().zip(&theirs) {
            let shape = |unit: &Unit| unit.weighted.tensors[0].shape.clone();
            if shape(own) != shape(theirs) {
                break;
            }
            let tensor = |layer: &Layer, suffix: &str| {
                let found = layer.tensors.iter().find(|tensor| tensor.name.ends_with(suffix));
                found.map(|tensor| other.weights.values[tensor.range()].to_vec())
            };
            let mut puts = vec![(
                &own.weighted.tensors[0],
                tensor(theirs.weighted, ".weight").unwrap_or_default(),
            )];
            let bias = tensor(theirs.weighted, ".bias");
            let own_bias = own.weighted.tensors.get(1);
            match (own.norm, theirs.norm, own_bias, bias) {
                (None, None, None, None) => {}
                (None, None, Some(to), Some(bias)) => puts.push((to, bias)),
                (Some(norm), Some(their_norm), None, None) => {
                    for (to, from) in norm.tensors.iter().zip(&their_norm.tensors) {
                        puts.push((to, other.weights.values[from.range()].to_vec()));
                    }
                }
                // Exporters fold a batch norm into the convolution: here it becomes one that only adds the bias.
                (Some(norm), None, None, Some(bias)) => {
                    let Kind::BatchNorm { epsilon, .. } = norm.kind else {
                        break;
                    };
                    let channels = bias.len();
                    let neutral = [
                        vec![(1.0 + epsilon).sqrt(); channels],
                        bias,
                        vec![0.0; channels],
                        vec![1.0; channels],
                    ];
                    puts.extend(norm.tensors.iter().zip(neutral));
                }
                _ => break,
            }
            for (tensor, values) in puts {
                self.values[tensor.range()].copy_from_slice(&values);
                filled.push(tensor.name.clone());
            }
        }
        match own.first().zip(theirs.first()) {
            Some((own, theirs)) if filled.is_empty() => Err(format!(
                "its first layer has weights of shape {:?} instead of {:?}",
                theirs.weighted.tensors[0].shape, own.weighted.tensors[0].shape
            )),
            _ => Ok(filled),
        }
    }
}

/// A layer with a kernel, and the batch norm that reads it.
struct Unit<'a> {
    weighted: &'a Layer,
    norm: Option<&'a Layer>,
}

fn units(network: &Network) -> Vec<Unit<'_>> {
    let layers = network.layers();
    let mut units = Vec::new();
    for (index, layer) in layers.iter().enumerate() {
        let has_kernel = matches!(
            layer.kind,
            Kind::Convolution { .. } | Kind::DepthwiseConvolution { .. } | Kind::Dense { .. }
        );
        if has_kernel {
            let reads_it =
                |other: &&Layer| matches!(other.kind, Kind::BatchNorm { .. }) && other.from == [index + 1];
            units.push(Unit {
                weighted: layer,
                norm: layers.iter().find(reads_it),
            });
        }
    }
    units
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn weights_are_taken_by_name_or_by_order() {
        let folder = tempfile::tempdir().unwrap();
        let network = Network::named("tinypilotnet").unwrap();
        let (trained, fresh) = (Weights::random(&network, 1), Weights::random(&network, 2));
        let path = folder.path().join("tiny.onnx");
        std::fs::write(&path, network.to_onnx(&trained)).unwrap();
        let mut weights = fresh.clone();
        let adopted = weights.adopt(&network, &path).unwrap();
        assert_eq!((weights, adopted.kept), (trained, Vec::new()));

        // Another head: its layers keep their weights.
        let other = network.with_outputs(3).unwrap();
        let mut weights = Weights::random(&other, 2);
        let adopted = weights.adopt(&other, &path).unwrap();
        assert_eq!(adopted.kept, ["dense_7.weight", "dense_7.bias"]);

        let mut weights = Weights::random(&Network::named("pilotnet").unwrap(), 2);
        let before = weights.clone();
        let error = weights
            .adopt(&Network::named("pilotnet").unwrap(), &path)
            .unwrap_err();
        assert!(
            error
                .to_string()
                .contains("[8, 1, 3, 3] instead of [24, 3, 5, 5]"),
            "{error}"
        );
        std::fs::write(folder.path().join("none.safetensors"), b"\x02\0\0\0\0\0\0\0{}").unwrap();
        let error = weights
            .adopt(&network, &folder.path().join("none.safetensors"))
            .unwrap_err()
            .to_string();
        assert!(
            error.contains("none of its tensors") && error.contains("torchvision"),
            "{error}"
        );
        assert_eq!(weights, before);
    }
}
