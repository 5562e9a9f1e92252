//! Signs and lights by a trained network (D7 in SPEC).

use crate::options::DriverError;
use senda_core::Image;
use senda_nets::{Finder, Model};
use senda_vision::{Detection, Detector, ObjectClass};

/// Of boxes of one class that overlap by more than this, the surest is kept: darknet's.
const OVERLAP: f32 = 0.45;

/// A detector's model as a [`Detector`].
pub struct NetworkDetector {
    finder: Finder,
    classes: Vec<ObjectClass>,
    found: Vec<Detection>,
}

impl NetworkDetector {
    /// For boxes that are surer than `threshold` (0 ..= 1). The model's classes must be named as in [`ObjectClass::name`].
    ///
    /// # Errors
    /// When the model is no detector, or of other things.
    pub fn new(model: &Model, threshold: f32) -> Result<Self, DriverError> {
        let Some(finder) = Finder::new(model, threshold, OVERLAP) else {
            return Err(DriverError::Model {
                reason: "expected a detector, as `senda detector train` makes them, but found a model that gives no boxes"
                    .into(),
            });
        };
        let classes = finder
            .classes()
            .iter()
            .map(|name| {
                ObjectClass::parse(name).ok_or_else(|| DriverError::Model {
                    reason: format!("expected classes named green-light, red-light or sign-0 to sign-9, but found {name:?}"),
                })
            })
            .collect::<Result<_, _>>()?;
        Ok(Self {
            finder,
            classes,
            found: Vec::new(),
        })
    }
}

impl Detector for NetworkDetector {
    fn detect(&mut self, frame: &Image) -> &[Detection] {
        self.found.clear();
        if frame.is_empty() {
            return &self.found;
        }
        let (width, height) = (frame.width() as f32, frame.height() as f32);
        for one in self.finder.find(frame) {
            let across = |middle: f32, size: f32, full: f32| {
                [middle - 0.5 * size, middle + 0.5 * size].map(|edge| (edge * full).clamp(0.0, full))
            };
            let [left, right] = across(one.rect.x, one.rect.width, width);
            let [top, bottom] = across(one.rect.y, one.rect.height, height);
            self.found.push(Detection {
                class: self.classes[one.class],
                box_px: [left, top, right, bottom],
                confidence: one.confidence,
            });
        }
        &self.found
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use senda_core::Channels;
    use senda_nets::{Crop, Darknet, Network, Weights};

    fn model(classes: [&str; 4]) -> Model {
        let darknet = Darknet::find("detector-small")
            .unwrap()
            .with_classes(&classes.map(str::to_owned))
            .unwrap();
        let weights = Weights::random(&darknet.network, 5);
        darknet.into_model(weights)
    }

    fn frame() -> Image {
        let pixels = (0..320 * 240 * 3).map(|i| (i * 31 % 251) as u8).collect();
        Image::from_pixels(320, 240, Channels::Rgb, pixels).unwrap()
    }

    #[test]
    fn boxes_are_pixels_of_the_frame_and_the_same_every_time() {
        let mut model = model(
            ObjectClass::DOCUMENT
                .map(|class| class.name())
                .each_ref()
                .map(String::as_str),
        );
        // What is cut off above moves boxes down again.
        for top in [0.0, 0.5] {
            model.input.crop = Crop {
                top,
                ..Crop::default()
            };
            let mut detector = NetworkDetector::new(&model, 0.05).unwrap();
            let found = detector.detect(&frame()).to_vec();
            assert!(!found.is_empty());
            for one in &found {
                let [left, upper, right, lower] = one.box_px;
                assert!(0.0 <= left && left < right && right <= 320.0, "{one:?}");
                assert!(upper < lower && lower <= 240.0, "{one:?}");
                assert!(one.middle_px()[1] >= 240.0 * top as f32, "{one:?}");
            }
            assert!(found.is_sorted_by(|a, b| a.confidence >= b.confidence));
            assert_eq!(detector.detect(&frame()), found);
            assert!(detector.detect(&Image::default()).is_empty());
        }
    }

    #[test]
    fn models_of_other_things_are_refused() {
        let error = NetworkDetector::new(&model(["green-light", "red-light", "cat", "dog"]), 0.5);
        assert!(error.err().unwrap().to_string().contains("\"cat\""));
        let mut driver = model(["a", "b", "c", "d"]);
        driver.network = Network::named("tinypilotnet").unwrap();
        driver.detection = None;
        let error = NetworkDetector::new(&driver, 0.5);
        assert!(error.err().unwrap().to_string().contains("gives no boxes"));
    }
}
