//! Networks on an 8-bit grid, for accelerators that know nothing finer (A14 in SPEC).

use crate::inference::Inference;
use crate::model::Model;
use crate::network::{Kind, Network, Tensor};
use crate::safetensors::{tensor_bytes, tensor_values};
use crate::weights::Weights;
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};
use thiserror::Error;

/// A value's 256 steps: `(step - zero) · scale`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Grid {
    /// Distance between steps.
    pub scale: f32,
    /// The step that means zero.
    pub zero: u8,
}

impl Grid {
    fn spanning(low: f32, high: f32) -> Self {
        // Zero must lie on the grid exactly: it is what padding adds.
        let (low, high) = (low.min(0.0), high.max(0.0));
        let scale = ((high - low) / 255.0).max(SMALLEST_SCALE);
        Self {
            scale,
            zero: (-low / scale).round().clamp(0.0, 255.0) as u8,
        }
    }

    /// Moves values to the nearest step.
    pub(crate) fn snap(self, values: &mut [f32]) {
        let zero = f32::from(self.zero);
        for value in values {
            // Rounding half to even, as ONNX and the accelerators do.
            let step = (*value / self.scale).round_ties_even() + zero;
            *value = (step.clamp(0.0, 255.0) - zero) * self.scale;
        }
    }

    /// Whether values can be snapped to it.
    pub(crate) fn is_good(&self) -> bool {
        self.scale.is_finite() && self.scale > 0.0
    }
}

/// Scale of what is always zero; anything above zero would do.
const SMALLEST_SCALE: f32 = 1e-12;

/// Why a model cannot be taken to 8 bits.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
pub enum QuantiseError {
    /// It already is.
    #[error(
        "expected a model with full weights, but found one of 8 bits; quantise the one that it was made from"
    )]
    Already,
    /// Ranges cannot be found without whole samples.
    #[error(
        "expected samples of {expected} values each, but found {found} values; give frames to calibrate with"
    )]
    Samples {
        /// Values of one sample.
        expected: usize,
        /// Values given.
        found: usize,
    },
}

/// Whether a tensor is stored in steps; biases, scales and statistics are not.
pub(crate) fn is_kernel(tensor: &Tensor) -> bool {
    tensor.shape.len() >= 2
}

/// One scale for each output channel. Scales have 17 significant bits, so that every step times its scale is exact, and
/// steps and scales found again from those products are the same.
fn row_scales(tensor: &Tensor, values: &[f32]) -> Vec<f32> {
    let row = tensor.len() / tensor.shape[0];
    let rows = values[tensor.range()].chunks_exact(row);
    rows.map(|row| {
        let largest = row.iter().fold(0.0f32, |largest, w| largest.max(w.abs()));
        f32::from_bits((largest / 127.0).max(SMALLEST_SCALE).to_bits() & !0x7f)
    })
    .collect()
}

/// Steps and scales of a kernel.
pub(crate) fn kernel_steps(tensor: &Tensor, values: &[f32]) -> (Vec<i8>, Vec<f32>) {
    let scales = row_scales(tensor, values);
    let row = tensor.len() / tensor.shape[0];
    let values = values[tensor.range()].iter().enumerate();
    let steps = values
        .map(|(i, value)| (value / scales[i / row]).round_ties_even().clamp(-127.0, 127.0) as i8)
        .collect();
    (steps, scales)
}

/// The values that steps and scales stand for.
fn kernel_values(steps: impl ExactSizeIterator<Item = i8>, scales: &[f32]) -> impl Iterator<Item = f32> {
    let row = (steps.len() / scales.len().max(1)).max(1);
    steps
        .enumerate()
        .map(move |(i, step)| f32::from(step) * scales[i / row])
}

impl Model {
    /// The same model with weights of 8 bits, a scale for each output channel, and with values between layers of 8 bits, a
    /// scale for each layer. Batch norms are folded first ([`Network::folded`]); biases, gates and the network's output stay as
    /// they are. `samples` are prepared inputs like those it will see, one after another: they decide the range of every
    /// layer. A few hundred frames of several circuits are enough.
    ///
    /// Running it here shows what the grid costs in driving: it computes with floating point on the grid, which is what integer
    /// arithmetic gives but for the rounding of long sums.
    ///
    /// # Errors
    /// When it is quantised already, or there is not one whole sample.
    pub fn quantised(&self, samples: &[f32]) -> Result<Self, QuantiseError> {
        if self.is_quantised() {
            return Err(QuantiseError::Already);
        }
        let len = self.network.input().len();
        if samples.len() < len || !samples.len().is_multiple_of(len) {
            return Err(QuantiseError::Samples {
                expected: len,
                found: samples.len(),
            });
        }
        let (network, mut weights) = self.network.folded(&self.weights);
        for tensor in network.tensors().filter(|tensor| is_kernel(tensor)) {
            let (steps, scales) = kernel_steps(tensor, &weights.values);
            let block = weights.values[tensor.range()].iter_mut();
            block
                .zip(kernel_values(steps.into_iter(), &scales))
                .for_each(|(weight, snapped)| *weight = snapped);
        }
        let mut ranges = vec![[0.0f32; 2]; network.layers().len()];
        let mut inference = Inference::new(&network, &weights, 1);
        for sample in samples.chunks_exact(len) {
            inference.run(sample);
            for (node, [low, high]) in ranges.iter_mut().enumerate() {
                for value in inference.node_values(node) {
                    *low = low.min(*value);
                    *high = high.max(*value);
                }
            }
        }
        let mut grids: Vec<Grid> = ranges
            .iter()
            .map(|[low, high]| Grid::spanning(*low, *high))
            .collect();
        for (index, layer) in network.layers().iter().enumerate() {
            // Layers that only move values keep the steps they come with.
            let moves = matches!(
                layer.kind,
                Kind::Flatten | Kind::MaxPool { .. } | Kind::Dropout { .. } | Kind::Upsample { .. }
            );
            if moves && index + 1 < grids.len() {
                grids[index + 1] = grids[layer.from[0]];
            }
        }
        Ok(Self {
            network,
            weights,
            grids,
            ..self.clone()
        })
    }
}

/// The weights of a quantised model's file.
pub(crate) fn read_weights(
    network: &Network,
    header: &Map<String, Value>,
    data: &[u8],
) -> Result<Weights, String> {
    let mut values = Vec::new();
    for tensor in network.tensors() {
        if !is_kernel(tensor) {
            values.extend(tensor_values(header, data, &tensor.name, &tensor.shape)?);
            continue;
        }
        let scales: Vec<f32> =
            tensor_values(header, data, &scale_name(tensor), &tensor.shape[..1])?.collect();
        let bytes = tensor_bytes(header, data, &tensor.name, &tensor.shape, "I8", 1)?;
        let steps = bytes.iter().map(|byte| i8::from_le_bytes([*byte]));
        values.extend(kernel_values(steps, &scales));
    }
    Ok(Weights { values })
}

/// Where a kernel's scales lie in a file.
pub(crate) fn scale_name(tensor: &Tensor) -> String {
    format!("{}.scale", tensor.name)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::input::InputSpec;
    use crate::model::{OutputSpec, Provenance};

    fn model() -> Model {
        let network = Network::named("pilotnet").unwrap();
        Model {
            weights: Weights::random(&network, 1),
            input: InputSpec::of(network.input()),
            network,
            outputs: vec![OutputSpec {
                name: "steering".to_owned(),
                unit: "rad".to_owned(),
            }],
            provenance: Provenance::default(),
            grids: vec![],
            detection: None,
            forgets: false,
        }
    }

    fn samples(count: usize) -> Vec<f32> {
        (0..count * 66 * 200 * 3)
            .map(|i| ((i * 31 + i / 97) % 255) as f32 / 127.5 - 1.0)
            .collect()
    }

    #[test]
    fn eight_bits_are_close_and_a_quarter_of_the_size() {
        let model = model();
        let quantised = model.quantised(&samples(3)).unwrap();
        let sample = &samples(1);
        let (exact, coarse) = (
            model.inference().run(sample)[0],
            quantised.inference().run(sample)[0],
        );
        assert_ne!(exact, coarse);
        assert!(
            (exact - coarse).abs() < 0.05 * exact.abs().max(0.1),
            "{exact} {coarse}"
        );
        assert!(3 * quantised.to_bytes().len() < model.to_bytes().len());
    }

    #[test]
    fn what_cannot_be_quantised_says_why() {
        let quantised = model().quantised(&samples(1)).unwrap();
        assert_eq!(quantised.quantised(&samples(1)), Err(QuantiseError::Already));
        let error = model().quantised(&samples(1)[1..]).unwrap_err().to_string();
        assert!(
            error.contains("39600 values each") && error.contains("39599"),
            "{error}"
        );
    }

    #[test]
    fn saved_is_loaded_and_drives_the_same() {
        let quantised = model().quantised(&samples(1)).unwrap();
        let bytes = quantised.to_bytes();
        let loaded = Model::from_bytes("x", &bytes).unwrap();
        assert_eq!(loaded, quantised);
        assert_eq!(
            loaded.inference().run(&samples(1)),
            quantised.inference().run(&samples(1))
        );
        for end in (0..bytes.len()).step_by(977) {
            assert!(Model::from_bytes("cut", &bytes[..end]).is_err());
        }
    }

    #[test]
    fn zero_is_on_every_grid() {
        for (low, high) in [(-1.0, 1.0), (0.0, 3.0), (0.5, 2.0), (-7.0, -1.0), (0.0, 0.0)] {
            let mut values = [0.0, low, high, 1e9];
            Grid::spanning(low, high).snap(&mut values);
            assert_eq!(values[0], 0.0);
            assert!((values[1] - low).abs() <= 0.02 && (values[2] - high).abs() <= 0.02);
            assert!(values[3] <= high.max(0.0) + 0.02);
        }
    }
}
