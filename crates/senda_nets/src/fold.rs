//! Batch norms worked into the layers before them: fewer layers, the same function.

use crate::network::{Activation, Kind, Network, Parts};
use crate::weights::Weights;
use std::sync::Arc;

impl Network {
    /// The same function with every batch norm folded into the convolution or dense layer before it, where only the batch norm
    /// reads that layer and it has no activation of its own. Outputs change by rounding alone; for driving and export, not
    /// for training.
    ///
    /// # Panics
    /// When there are not as many weights as the network has parameters ([`Weights::fits`] tells).
    pub fn folded(&self, weights: &Weights) -> (Self, Weights) {
        assert_eq!(
            weights.values.len(),
            self.parameter_count(),
            "weights of another network"
        );
        let layers = self.layers();
        let partner = |index: usize| -> Option<usize> {
            let before = layers[index].from[0].checked_sub(1)?;
            let readers = layers
                .iter()
                .filter(|layer| layer.from.contains(&(before + 1)))
                .count();
            let is_foldable = matches!(layers[index].kind, Kind::BatchNorm { .. })
                && matches!(
                    layers[before].kind,
                    Kind::Convolution { .. } | Kind::DepthwiseConvolution { .. } | Kind::Dense { .. }
                )
                && layers[before].activation == Activation::Linear
                && readers == 1;
            is_foldable.then_some(before)
        };
        let mut parts = Parts {
            name: self.name().to_owned(),
            description: self.description().to_owned(),
            input: self.input(),
            colour: self.colour(),
            stack: self.stack(),
            layers: Vec::new(),
        };
        let mut values: Vec<Vec<f32>> = Vec::new();
        // Where each node of the old list is in the new one.
        let mut places = vec![0];
        for (index, layer) in layers.iter().enumerate() {
            if let Some(before) = partner(index) {
                let place = places[before + 1];
                places.push(place);
                let folded = &mut parts.layers[place - 1];
                folded.activation = layer.activation;
                continue;
            }
            let mut layer = layer.clone();
            layer.from = layer.from.iter().map(|node| places[*node]).collect();
            let of = |suffix: &str, layer: &crate::network::Layer| -> Option<Vec<f32>> {
                let tensor = layer
                    .tensors
                    .iter()
                    .find(|tensor| tensor.name.ends_with(suffix))?;
                Some(weights.values[tensor.range()].to_vec())
            };
            let norm = (index + 1..layers.len()).find(|later| partner(*later) == Some(index));
            if let Some(norm) = norm.map(|norm| &layers[norm]) {
                let channels = layer.output.channels;
                let epsilon = match norm.kind {
                    Kind::BatchNorm { epsilon, .. } => epsilon,
                    _ => 0.0,
                };
                let get = |suffix: &str| of(suffix, norm).unwrap_or_default();
                let (gamma, beta) = (get(".weight"), get(".bias"));
                let (mean, variance) = (get(".running_mean"), get(".running_var"));
                let mut kernel = of(".weight", &layer).unwrap_or_default();
                let mut bias = of(".bias", &layer).unwrap_or_else(|| vec![0.0; channels]);
                let row = kernel.len() / channels;
                for c in 0..channels {
                    let factor = gamma[c] / (variance[c] + epsilon).sqrt();
                    kernel[c * row..(c + 1) * row]
                        .iter_mut()
                        .for_each(|weight| *weight *= factor);
                    bias[c] = (bias[c] - mean[c]) * factor + beta[c];
                }
                values.extend([kernel, bias]);
                match &mut layer.kind {
                    Kind::Convolution { bias, .. }
                    | Kind::DepthwiseConvolution { bias, .. }
                    | Kind::Dense { bias, .. } => *bias = true,
                    _ => {}
                }
            } else {
                let all = layer
                    .tensors
                    .iter()
                    .map(|tensor| weights.values[tensor.range()].to_vec());
                values.extend(all);
            }
            parts.layers.push(layer);
            places.push(parts.layers.len());
        }
        let folded = Self {
            parts: Arc::new(parts),
        };
        // Shapes are as they were, so reading back what was written cannot fail.
        let network = Self::parse(self.name(), &folded.to_toml()).expect("a folded network is a good one");
        let weights = Weights {
            values: values.concat(),
        };
        (network, weights)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::inference::Inference;

    #[test]
    fn folding_keeps_the_function() {
        for text in [
            include_str!("../tests/networks/mixed.toml"),
            include_str!("../tests/networks/frozen.toml"),
            include_str!("../../../networks/mobilenetv2-head.toml"),
        ] {
            let mut network = Network::parse("x", text).unwrap();
            if network.multiply_adds() > 100_000_000 {
                let small = crate::network::Shape {
                    channels: 3,
                    height: 96,
                    width: 96,
                };
                network = network.with_input(small).unwrap();
            }
            let mut weights = Weights::random(&network, 1);
            for (i, value) in weights.values.iter_mut().enumerate() {
                *value += 0.1 * ((i * 7 % 11) as f32 / 11.0);
            }
            let (folded, folded_weights) = network.folded(&weights);
            let is_norm = |layer: &&crate::network::Layer| matches!(layer.kind, Kind::BatchNorm { .. });
            let norms = |network: &Network| network.layers().iter().filter(is_norm).count();
            let left = norms(&folded);
            // One that adds up with others, one behind an activation: these two stay.
            assert_eq!(left, if text.contains("upsample") { 2 } else { 0 });
            assert!(left < norms(&network) || left == 2);
            let input: Vec<f32> = (0..network.input().len())
                .map(|i| (i % 17) as f32 / 17.0)
                .collect();
            let own = Inference::new(&network, &weights, 1).run(&input).to_vec();
            let other = Inference::new(&folded, &folded_weights, 1).run(&input).to_vec();
            for (own, other) in own.iter().zip(&other) {
                assert!((own - other).abs() <= 1e-4 * own.abs().max(1.0), "{own} {other}");
            }
        }
    }
}
