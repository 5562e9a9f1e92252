//! From a frame to boxes.

use super::{Boxed, DetectionSpec, suppress};
use crate::inference::Inference;
use crate::input::InputSpec;
use crate::model::Model;
use crate::preparer::Eye;
use senda_core::Image;

/// A detector's model, ready to run. Nothing is allocated per frame once a frame of the size was seen and as many boxes.
pub struct Finder {
    inference: Inference,
    detection: DetectionSpec,
    input: InputSpec,
    eye: Eye,
    values: Vec<f32>,
    found: Vec<Boxed>,
    threshold: f32,
    overlap: f32,
}

/// Boxes that are looked at in a frame, the surest ones: what a broken network says of every cell must not take for ever.
const MOST_BOXES: usize = 1_000;

impl Finder {
    /// For boxes above a confidence; of boxes of one class that overlap by more than `overlap` the surest is kept (darknet's
    /// is 0.45). Batch norms are folded. `None`: the model is no detector.
    pub fn new(model: &Model, threshold: f32, overlap: f32) -> Option<Self> {
        let detection = model.detection.clone()?;
        let inference = if model.is_quantised() {
            model.inference()
        } else {
            let (network, weights) = model.network.folded(&model.weights);
            Inference::new(&network, &weights, 1)
        };
        Some(Self {
            inference,
            detection,
            values: vec![0.0; model.input.len()],
            input: model.input.clone(),
            eye: Eye::new(&model.input),
            found: Vec::new(),
            threshold,
            overlap,
        })
    }

    /// Names of the classes.
    pub fn classes(&self) -> &[String] {
        &self.detection.classes
    }

    /// What is in a frame of any size, the surest first, in parts of the frame.
    ///
    /// # Panics
    /// When the frame has no pixels.
    pub fn find(&mut self, frame: &Image) -> &[Boxed] {
        self.values.copy_from_slice(self.eye.see(frame));
        self.run();
        let crop = self.input.crop;
        let part = |low: f64, high: f64| (low as f32, (1.0 - low - high) as f32);
        let ((left, across), (top, down)) = (part(crop.left, crop.right), part(crop.top, crop.bottom));
        for one in &mut self.found {
            one.rect.x = left + one.rect.x * across;
            one.rect.y = top + one.rect.y * down;
            one.rect.width *= across;
            one.rect.height *= down;
        }
        &self.found
    }

    /// The same for a prepared frame's bytes ([`crate::Preparer::prepare_bytes`]), in parts of the prepared picture.
    ///
    /// # Panics
    /// When there are not as many bytes as the input has values.
    pub fn find_prepared(&mut self, bytes: &[u8]) -> &[Boxed] {
        assert_eq!(bytes.len(), self.values.len(), "a frame of another size");
        self.input.normalise(bytes, &mut self.values);
        self.run();
        &self.found
    }

    fn run(&mut self) {
        let output = self.inference.run(&self.values);
        let size = [self.input.width, self.input.height];
        self.detection
            .decode(output, size, self.threshold, &mut self.found);
        self.found.sort_by(|a, b| b.confidence.total_cmp(&a.confidence));
        self.found.truncate(MOST_BOXES);
        suppress(&mut self.found, self.overlap);
    }
}
