//! The values that training finds.

use crate::network::{Kind, Network};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// How fresh kernels are drawn; biases are zero in both.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Initialisation {
    /// Glorot uniform, Keras' default (A9 in SPEC): up to √(6 / (inputs + outputs)).
    Glorot,
    /// PyTorch's default: up to 1 / √inputs. Smaller kernels begin smoother and learn more general answers from few frames.
    #[default]
    Small,
}

/// All weights of a network as one vector, running statistics of batch norms included; [`Network::tensors`] says what
/// lies where.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Weights {
    /// The values.
    pub values: Vec<f32>,
}

impl Weights {
    /// Fresh weights as Keras draws them: Glorot uniform for kernels, zero for biases (one for the forget gates), batch
    /// norms that change nothing.
    pub fn random(network: &Network, seed: u64) -> Self {
        Self::initialised(network, Initialisation::Glorot, seed)
    }

    /// Fresh weights, drawn as asked.
    pub fn initialised(network: &Network, how: Initialisation, seed: u64) -> Self {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let mut values = vec![0.0; network.parameter_count()];
        for layer in network.layers() {
            for tensor in &layer.tensors {
                let block = &mut values[tensor.range()];
                let suffix = tensor.name.rsplit('.').next().unwrap_or_default();
                match (&layer.kind, suffix) {
                    (Kind::BatchNorm { .. }, "weight" | "running_var") => block.fill(1.0),
                    (Kind::ConvolutionalLstm { filters, .. }, "bias") => {
                        block[*filters..2 * filters].fill(1.0);
                    }
                    (_, "weight" | "recurrent_weight") => {
                        // The four gates of an LSTM are four kernels in one tensor; Keras counts all of them.
                        let window: usize = tensor.shape[2..].iter().product();
                        let fan_in = tensor.shape[1] * window;
                        let fan_out = tensor.shape[0] * window;
                        let limit = match how {
                            Initialisation::Glorot => (6.0 / (fan_in + fan_out) as f32).sqrt(),
                            Initialisation::Small => (1.0 / fan_in.max(1) as f32).sqrt(),
                        };
                        for value in block {
                            *value = random.random_range(-limit..limit);
                        }
                    }
                    _ => {}
                }
            }
        }
        Self { values }
    }

    /// Whether there are as many as the network needs, all finite.
    pub fn fits(&self, network: &Network) -> bool {
        self.values.len() == network.parameter_count() && self.values.iter().all(|value| value.is_finite())
    }
}
