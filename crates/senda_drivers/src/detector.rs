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
