//! The weights that a training begins with.

use crate::{LearnError, train::Training};
use senda_nets::{Network, Weights};
use std::path::Path;

/// Fresh weights, and over them those of `from` for the layers that fit: a model, a safetensors or an ONNX file ([`Weights::adopt`]). Then
/// what the user should know of it.
pub fn begin(
    network: &Network,
    training: &Training,
    seed: u64,
    from: Option<&Path>,
) -> Result<(Weights, Option<String>), LearnError> {
    let mut weights = Weights::initialised(network, training.initialisation, seed);
    let Some(path) = from else {
        let frozen = frozen_layers(network);
        let note = (frozen > 0).then(|| {
            format!(
                "warning: {frozen} layers of {} are not trained and hold random values: give trained ones with --from FILE, for \
                 MobileNetV2 torchvision's (docs/networks.md tells how to save them)",
                network.name()
            )
        });
        return Ok((weights, note));
    };
    let adopted = weights.adopt(network, path)?;
    let kept = match &adopted.kept[..] {
        [] => "all of the network's".to_owned(),
        kept => format!("fresh ones stay in {}", kept.join(", ")),
    };
    let note = format!(
        "{}: {} tensors taken; {kept}",
        path.display(),
        adopted.filled.len()
    );
    Ok((weights, Some(note)))
}

/// How many layers have weights and are not trained: they must come from elsewhere.
pub fn frozen_layers(network: &Network) -> usize {
    let frozen = network
        .layers()
        .iter()
        .filter(|layer| !layer.is_trainable && !layer.tensors.is_empty());
    frozen.count()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frozen_layers_want_weights_and_get_them_by_name() {
        let training = Training::default();
        let network = Network::named("mobilenetv2-head").unwrap();
        let (random, note) = begin(&network, &training, 1, None).unwrap();
        assert!(note.unwrap().contains("not trained and hold random values"));

        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("other.onnx");
        std::fs::write(&path, network.to_onnx(&random)).unwrap();
        let (same, note) = begin(&network, &training, 2, Some(&path)).unwrap();
        assert_eq!(same, random);
        assert!(note.unwrap().ends_with("tensors taken; all of the network's"));

        let tiny = Network::named("tinypilotnet").unwrap();
        assert_eq!(begin(&tiny, &training, 1, None).unwrap().1, None);
        let error = begin(&tiny, &training, 1, Some(&path)).unwrap_err().to_string();
        assert!(error.contains("other.onnx"), "{error}");
    }
}
