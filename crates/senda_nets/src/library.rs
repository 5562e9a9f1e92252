//! Networks that every build carries: the files of `networks/`.

use crate::error::NetworkError;
use crate::network::{Kind, Network, Shape};

macro_rules! files {
    ($folder:literal: $($name:literal),* $(,)?) => {
        &[$(($name, include_str!(concat!("../../../", $folder, "/", $name, ".toml")))),*]
    };
}

/// Name and text of every ready network.
const NETWORKS: &[(&str, &str)] = files!("networks":
    "pilotnet",
    "tinypilotnet",
    "tinypilotnet-20x40",
    "tinypilotnet-64x128",
    "tinypilotnet-rgb",
    "tinypilotnet-rgb-20x40",
    "tinypilotnet-rgb-64x128",
    "stacked-tinypilotnet",
    "lstm-tinypilotnet",
    "early-lstm-tinypilotnet",
    "deeperlstm-tinypilotnet",
    "deepestlstm-tinypilotnet",
    "mobilenetv2-head",
    "lane-small",
);

impl Network {
    /// A ready network.
    ///
    /// # Errors
    /// When no network has this name; the error lists the nearest.
    pub fn named(name: &str) -> Result<Self, NetworkError> {
        match NETWORKS.iter().find(|(known, _)| *known == name) {
            Some((name, text)) => Self::parse(&format!("networks/{name}.toml"), text),
            None => {
                let known: Vec<&str> = Self::names().collect();
                Err(NetworkError::unknown_name(name, &known))
            }
        }
    }

    /// Names of the ready networks.
    pub fn names() -> impl Iterator<Item = &'static str> {
        NETWORKS.iter().map(|(name, _)| *name)
    }

    /// The same layers for another input.
    ///
    /// # Errors
    /// When the shapes no longer fit; the line is one of [`Network::to_toml`].
    pub fn with_input(&self, input: Shape) -> Result<Self, NetworkError> {
        self.rewritten(|parts| {
            if input.channels != parts.input.channels {
                (parts.colour, parts.stack) = (None, 1);
            }
            parts.input = input;
        })
    }

    /// The same layers with another number of outputs in the last dense layer (B4: steering alone, or with speed).
    ///
    /// # Errors
    /// When the last layer is not dense, or the number is zero.
    pub fn with_outputs(&self, count: usize) -> Result<Self, NetworkError> {
        self.rewritten(|parts| {
            if let Some(Kind::Dense { units, .. }) = parts.layers.last_mut().map(|layer| &mut layer.kind) {
                *units = count;
            }
        })
        .and_then(|network| {
            if network.output_len() == count {
                Ok(network)
            } else {
                Err(NetworkError::Read {
                    file: self.name().to_owned(),
                    reason: format!(
                        "expected a dense last layer to give {count} outputs, but found {}",
                        self.layers().last().map_or("none", |layer| layer.kind.name())
                    ),
                })
            }
        })
    }

    /// Which layers training changes, decided by name (A10: fine-tuning of the last layers only).
    ///
    /// # Errors
    /// None in practice: the shapes stay as they are.
    pub fn with_trainable(&self, is_trainable: impl Fn(&str) -> bool) -> Result<Self, NetworkError> {
        self.rewritten(|parts| {
            for layer in &mut parts.layers {
                layer.is_trainable = is_trainable(&layer.name);
            }
        })
    }

    pub(crate) fn rewritten(
        &self,
        change: impl FnOnce(&mut crate::network::Parts),
    ) -> Result<Self, NetworkError> {
        let mut parts = crate::network::Parts {
            name: self.parts.name.clone(),
            description: self.parts.description.clone(),
            input: self.parts.input,
            colour: self.parts.colour,
            stack: self.parts.stack,
            layers: self.parts.layers.clone(),
        };
        change(&mut parts);
        let changed = Self {
            parts: std::sync::Arc::new(parts),
        };
        Self::parse(self.name(), &changed.to_toml())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ready_networks_have_the_documented_sizes() {
        for (name, parameters, trainable) in [
            ("pilotnet", 252_219, 252_219),
            ("deepestlstm-tinypilotnet", 62_470, 62_470),
            ("mobilenetv2-head", 2_626_689, 368_705),
        ] {
            let network = Network::named(name).unwrap();
            assert_eq!(
                (network.parameter_count(), network.trainable_count()),
                (parameters, trainable),
                "{name}"
            );
        }
        let pilotnet = Network::named("pilotnet").unwrap();
        assert_eq!((pilotnet.multiply_adds() + 5_000) / 10_000, 2_688);
    }

    #[test]
    fn every_ready_network_reads_and_writes_back_the_same() {
        for name in Network::names() {
            let network = Network::named(name).unwrap();
            assert_eq!(network.name(), name);
            assert_eq!(
                Network::parse("x", &network.to_toml()).unwrap(),
                network,
                "{name}"
            );
        }
    }

    #[test]
    fn sizes_and_outputs_can_be_changed() {
        let tiny = Network::named("tinypilotnet").unwrap();
        let input = Shape {
            channels: 3,
            height: 20,
            width: 40,
        };
        let other = tiny.with_input(input).unwrap().with_outputs(2).unwrap();
        assert_eq!((other.input(), other.output_len()), (input, 2));
        assert!(tiny.with_input(Shape::flat(1)).is_err());
        assert!(tiny.with_outputs(0).is_err());
        let frozen = tiny.with_trainable(|name| name.starts_with("dense")).unwrap();
        assert_eq!(
            frozen.trainable_count(),
            frozen.layers().last().unwrap().parameter_count()
        );
    }
}
