//! Detectors that every build carries: the `.cfg` files of `networks/`.

use super::{Darknet, DarknetError};
use crate::network::{Kind, Layer, Network, Shape};
use crate::{InputSpec, Model, Provenance, Weights};
use std::path::Path;

const DETECTORS: &[(&str, &str)] = &[
    ("detector", include_str!("../../../../networks/detector.cfg")),
    (
        "detector-small",
        include_str!("../../../../networks/detector-small.cfg"),
    ),
    (
        "yolov3-tiny",
        include_str!("../../../../networks/yolov3-tiny.cfg"),
    ),
];

impl Darknet {
    /// A ready detector by name, or a `.cfg` file.
    ///
    /// # Errors
    /// When there is neither, or the file is wrong.
    pub fn find(name: &str) -> Result<Self, DarknetError> {
        if let Some((name, text)) = DETECTORS.iter().find(|(known, _)| *known == name) {
            return Self::parse(name, text);
        }
        let text = std::fs::read(Path::new(name)).map_err(|error| DarknetError::File {
            file: name.to_owned(),
            reason: format!(
                "{error}; ready detectors are {}",
                Self::names().collect::<Vec<_>>().join(", ")
            ),
        })?;
        // Remarks may be in any encoding.
        Self::parse(name, &String::from_utf8_lossy(&text))
    }

    /// Names of the ready detectors.
    pub fn names() -> impl Iterator<Item = &'static str> {
        DETECTORS.iter().map(|(name, _)| *name)
    }

    /// The same layers for classes of these names: the convolutions before the heads get as many channels as they need.
    ///
    /// # Errors
    /// When there are none or too many, or a head does not follow a convolution.
    pub fn with_classes(&self, names: &[String]) -> Result<Self, DarknetError> {
        let mut heads = self.detection.heads.iter();
        let mut filters = Vec::new();
        for layer in self
            .network
            .layers()
            .iter()
            .filter(|layer| layer.kind == Kind::Flatten)
        {
            let anchors = heads.next().map_or(0, |head| head.anchors_px.len());
            filters.push((layer.from[0], anchors * (names.len() + 5)));
        }
        let network = self.changed(self.network.input(), |index, layer| {
            let wanted = filters.iter().find(|(node, _)| *node == index + 1);
            if let (Some((_, wanted)), Kind::Convolution { filters, .. }) = (wanted, &mut layer.kind) {
                *filters = *wanted;
            }
        })?;
        let mut detection = self.detection.clone();
        detection.classes = names.to_vec();
        self.checked(network, detection)
    }

    /// The same layers for another input (px).
    ///
    /// # Errors
    /// When the layers no longer fit.
    pub fn with_input(&self, width: usize, height: usize) -> Result<Self, DarknetError> {
        let input = Shape {
            width,
            height,
            ..self.network.input()
        };
        let network = self.changed(input, |_, _| {})?;
        let mut detection = self.detection.clone();
        let heads = network
            .layers()
            .iter()
            .filter(|layer| layer.kind == Kind::Flatten);
        for (head, layer) in detection.heads.iter_mut().zip(heads) {
            (head.height, head.width) = (layer.inputs[0].height, layer.inputs[0].width);
        }
        self.checked(network, detection)
    }

    fn changed(&self, input: Shape, change: impl Fn(usize, &mut Layer)) -> Result<Network, DarknetError> {
        let rewritten = self.network.rewritten(|parts| {
            parts.input = input;
            for (index, layer) in parts.layers.iter_mut().enumerate() {
                change(index, layer);
            }
        });
        rewritten.map_err(|error| DarknetError::Foreign {
            layer: self.network.name().to_owned(),
            found: error.to_string(),
        })
    }

    fn checked(&self, network: Network, detection: crate::DetectionSpec) -> Result<Self, DarknetError> {
        match detection.fault(&network) {
            Some(found) => Err(DarknetError::Foreign {
                layer: network.name().to_owned(),
                found,
            }),
            None => Ok(Self {
                network,
                detection,
                warnings: self.warnings.clone(),
            }),
        }
    }

    /// A model of this detector with weights, that scales pictures as darknet does and says nothing of where it comes from.
    pub fn into_model(self, weights: Weights) -> Model {
        Model {
            weights,
            input: InputSpec {
                scale: 1.0 / 255.0,
                offset: 0.0,
                ..InputSpec::of(self.network.input())
            },
            network: self.network,
            outputs: vec![],
            provenance: Provenance::default(),
            grids: vec![],
            detection: Some(self.detection),
            forgets: false,
        }
    }
}
